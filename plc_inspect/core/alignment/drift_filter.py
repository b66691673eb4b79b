# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How far the odometry is off, and how fast that grows: a Kalman filter over fits."""

import numpy as np

from plc_inspect.core.alignment.registration import Fit
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.results import Float64

SHIFT, TURN, RATE = 0.02, 0.002, 0.05
"""Standard deviations at the start [m], [rad], [m/s].  Source: judgement."""
SHIFT_WALK, TURN_WALK, RATE_WALK = 0.01, 0.0003, 0.02
"""
How far the odometry's error wanders in a second [m], [rad], and its rate [m/s].
Source: judgement: twice the slip of a good odometry, 0.2 % of the way at 5 m/s.
"""
MOST_RATE = 0.5
"""Drifts are no faster [m/s].  Source: judgement."""
_SIZE = 7
"""Figures of the state.  Source: numerical: shift, turn, rate."""


class DriftFilter:
    """Shift, turn, and rate of the shift; the shift is of the vehicle's place."""

    def __init__(self, move: RigidMove, stamp_ns: int, covariance: Float64 | None = None) -> None:
        self._centre = move.centre
        self._mean: Float64 = np.zeros(_SIZE)
        self._mean[:3], self._mean[3] = move.shift, move.yaw
        self._spread = np.diag(np.array([SHIFT] * 3 + [TURN] + [RATE] * 3) ** 2)
        if covariance is not None:
            self._spread[:4, :4] = covariance
        self._stamp = stamp_ns

    @property
    def move(self) -> RigidMove:
        """What brings points of now into the map frame."""
        return RigidMove(self._mean[:3].copy(), float(self._mean[3]), self._centre)

    @property
    def covariance(self) -> Float64:
        """(4, 4) of shift and turn [m2, rad2]."""
        return self._spread[:4, :4].copy()

    def move_at(self, stamp_ns: int) -> RigidMove:
        """Return the move at a time near the last [ns]."""
        ahead = (stamp_ns - self._stamp) * 1e-9
        return RigidMove(
            self._mean[:3] + ahead * self._mean[4:], float(self._mean[3]), self._centre
        )

    def predict(self, stamp_ns: int, place: Float64) -> None:
        """Go on to a time [ns] and the vehicle's place (3,) [m] in the odometry's frame."""
        seconds = max(0.0, (stamp_ns - self._stamp) * 1e-9)
        self._stamp = stamp_ns
        away = place - self._centre
        moved = self.move.about(place)
        grow = np.eye(_SIZE)
        grow[:3, 3] = -away[1], away[0], 0.0
        grow[:3, 4:] = seconds * np.eye(3)
        self._mean[:3] = moved.shift + seconds * self._mean[4:]
        self._centre = moved.centre
        walk = np.array([SHIFT_WALK] * 3 + [TURN_WALK] + [RATE_WALK] * 3) ** 2
        self._spread = grow @ self._spread @ grow.T + np.diag(walk * seconds)

    def update(self, fit: Fit) -> None:
        """Take a fit that began at ``move`` and ``covariance``."""
        before = self._spread[:4, :4]
        gain = self._spread[:, :4] @ np.linalg.inv(before)
        off = np.append(fit.move.shift, fit.move.yaw) - self._mean[:4]
        self._mean = self._mean + gain @ off
        self._mean[4:] = np.clip(self._mean[4:], -MOST_RATE, MOST_RATE)
        self._spread = self._spread + gain @ (fit.covariance - before) @ gain.T
