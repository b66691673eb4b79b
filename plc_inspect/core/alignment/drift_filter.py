# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Error of the odometry and its rate, estimated by a Kalman filter over registrations."""

import numpy as np

from plc_inspect.core.alignment.registration import Fit
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.results import Float64

SHIFT, TURN, RATE = 0.02, 0.002, 0.05
"""Standard deviations at the start [m], [rad], [m/s].  Source: judgement."""
SHIFT_WALK, TURN_WALK, RATE_WALK = 0.01, 0.0003, 0.02
"""
Random walk of the odometry's error per second [m], [rad], and of its rate [m/s].
Source: judgement: twice the slip of a good odometry, 0.2 % of the way at 5 m/s.
"""
SCALE, SCALE_WALK = 0.03, 0.0005
"""
Standard deviation of the scale error of positions at the start, and its random walk per second.
Source: judgement: a monocular camera, a barometer or a wheel measures distance to 1 %.
"""
MOST_RATE = 0.5
"""Greatest drift [m/s].  Source: judgement."""
_SIZE = 8
"""Size of the state.  Source: numerical: shift, turn, rate, share of the way."""
SLOWEST = 1.0
"""Speed below which scale error and drift cannot be separated [m/s].  Source: judgement."""


class DriftFilter:
    """
    Filter of shift (at the vehicle), turn, rate of the shift, and scale error of positions.

    Drift grows with time whatever the vehicle does; a scale error grows along its path.
    """

    def __init__(self, move: RigidMove, stamp_ns: int, covariance: Float64 | None = None) -> None:
        self._centre = move.centre
        self._mean: Float64 = np.zeros(_SIZE)
        self._mean[:3], self._mean[3] = move.shift, move.yaw
        self._spread = np.diag(np.array([SHIFT] * 3 + [TURN] + [RATE] * 3 + [SCALE]) ** 2)
        if covariance is not None:
            self._spread[:4, :4] = covariance
        self._stamp = stamp_ns
        self._velocity = np.zeros(3)

    @property
    def move(self) -> RigidMove:
        """Move of present points into the map frame."""
        return RigidMove(self._mean[:3].copy(), float(self._mean[3]), self._centre)

    @property
    def covariance(self) -> Float64:
        """(4, 4) of shift and turn [m2, rad2]."""
        return self._spread[:4, :4].copy()

    def move_at(self, stamp_ns: int) -> RigidMove:
        """Return the move at a time near the last [ns]."""
        ahead = (stamp_ns - self._stamp) * 1e-9
        return RigidMove(
            self._mean[:3] + ahead * (self._mean[4:7] + self._mean[7] * self._velocity),
            float(self._mean[3]), self._centre,
        )

    def measure_share(self) -> tuple[float, float]:
        """
        Return the scale error of the odometry along the path, and its standard deviation.

        Positive if positions are too short.  Valid for the present course: without a turn, drift
        and scale error cannot be separated.  0 and infinity at a standstill.
        """
        square = float(self._velocity @ self._velocity)
        if square < SLOWEST**2:
            return 0.0, np.inf
        along = np.zeros(_SIZE)
        along[4:7], along[7] = self._velocity / square, 1.0
        return float(along @ self._mean), float(np.sqrt(along @ self._spread @ along))

    def measure_aside(self) -> tuple[float, float]:
        """Return the drift across the path [m/s], and its standard deviation."""
        aside = self._mean[4:7] + self._mean[7] * self._velocity
        if self.speed > SLOWEST:
            way = self._velocity / self.speed
            aside = aside - (aside @ way) * way
        return (
            float(np.linalg.norm(aside)),
            float(np.sqrt(np.linalg.eigvalsh(self._spread[4:7, 4:7])[-1])),
        )

    def begin_anew(self, shift: Float64, share: float, sigma: float) -> None:
        """
        Restart with a shift (3,) [m], a scale error and an empty map.

        Drift with time is then part of the scale error.
        """
        self._mean[:3], self._mean[7] = shift, share
        self._mean[4:7] = 0.0
        own = np.array([0, 1, 2, 7])
        self._spread[own], self._spread[:, own] = 0.0, 0.0
        self._spread[own, own] = np.array([SHIFT, SHIFT, SHIFT, sigma]) ** 2

    def carry(self, other: 'DriftFilter') -> None:
        """Take over the scale error of another filter."""
        self._mean[7], self._spread[7, 7] = other._mean[7], other._spread[7, 7]
        self._velocity = other._velocity

    @property
    def speed(self) -> float:
        """Speed of the vehicle [m/s]."""
        return float(np.linalg.norm(self._velocity))

    def predict(self, stamp_ns: int, place: Float64) -> float:
        """
        Predict to a time [ns] and the vehicle's position (3,) [m] in the odometry's frame.

        Return the distance flown since the last one [m].
        """
        seconds = max(0.0, (stamp_ns - self._stamp) * 1e-9)
        self._stamp = stamp_ns
        away = place - self._centre
        moved = self.move.about(place)
        grow = np.eye(_SIZE)
        grow[:3, 3] = -away[1], away[0], 0.0
        grow[:3, 4:7] = seconds * np.eye(3)
        grow[:3, 7] = away
        self._mean[:3] = moved.shift + seconds * self._mean[4:7] + self._mean[7] * away
        self._centre = moved.centre
        if seconds > 0.0:
            self._velocity = away / seconds
        walk = np.array([SHIFT_WALK] * 3 + [TURN_WALK] + [RATE_WALK] * 3 + [SCALE_WALK]) ** 2
        self._spread = grow @ self._spread @ grow.T + np.diag(walk * seconds)
        return float(np.linalg.norm(away))

    def update(self, fit: Fit) -> None:
        """Update by a registration that started from ``move`` and ``covariance``."""
        before = self._spread[:4, :4]
        gain = self._spread[:, :4] @ np.linalg.inv(before)
        off = np.append(fit.move.shift, fit.move.yaw) - self._mean[:4]
        self._mean = self._mean + gain @ off
        self._mean[4:7] = np.clip(self._mean[4:7], -MOST_RATE, MOST_RATE)
        self._spread = self._spread + gain @ (fit.covariance - before) @ gain.T
