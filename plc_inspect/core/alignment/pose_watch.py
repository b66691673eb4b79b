# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Detects impossible poses: steps that no vehicle flies, and poses that freeze in flight."""

from collections import deque
from dataclasses import dataclass, field, replace
import enum
import math

import numpy as np

from plc_inspect.core.alignment.rigid_move import find_heading, RigidMove
from plc_inspect.results import Float64

WINDOW = 0.15
"""
Duration of the poses, two at least, that give the velocity before a step [s].
Source: judgement: long against the noise of an odometry, short against a turn.
"""
ACCELERATION = 12.0
"""Greatest plausible acceleration [m/s2].  Source: judgement: 1.2 g, in a gust."""
MOST_CHANGE = 15.0
"""
Greatest plausible difference of the velocities before and after a break [m/s].
Source: judgement: an apparent step may have been a collision, or a turn on the spot.
"""
TURNING = 8.0
"""Greatest plausible angular acceleration about the vertical [rad/s2].  Source: judgement."""
LEAST_STEP, LEAST_TURN = 0.06, 0.009
"""
Smallest step that can be distinguished from noise [m], [rad].
Source: judgement; 0.5 degrees.
"""
TIMES_NOISE = 6.0
"""Least ratio of a step to the usual prediction error of poses.  Source: judgement."""
SMOOTHING = 0.02
"""Weight of a pose in the mean of that error.  Source: judgement: half a second at 100 Hz."""
MOVING = 0.5
"""
Speed from which equal poses count as frozen: slower vehicles may stop at once [m/s].
Source: derived: ACCELERATION.
"""
FROZEN = 0.15
"""Time after which equal poses count as frozen [s].  Source: judgement."""
FROZEN_POSES = 4
"""Least number of equal poses. Source: judgement: some odometry publishes each pose twice."""
FIRST = 0.3
"""
A first change of position this soon after the first pose is no step: with repeated positions, the
vehicle may already have been flying [s].
Source: derived: positions at 5 Hz.
"""
LEAST_CHANGE = 1e-12
"""Divisor of a change of position between two poses, at least [m2].  Source: numerical."""
LONG_GAP = 5.0
"""Longest gap of poses over which the next one is predicted [s].  Source: judgement."""


class Oddity(enum.Enum):
    """What is wrong with the pose just seen."""

    STEP = 'step'
    FROZEN = 'frozen'
    THAWED = 'thawed'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Break:
    """A break: poses before and after it do not fit together."""

    oddity: Oddity
    before_ns: int
    """Last plausible pose [ns]."""
    after_ns: int
    """First pose after [ns]."""
    size: float
    """Distance between predicted and reported position [m]."""
    turn: float
    """Difference between predicted and reported heading [rad]."""
    move: RigidMove
    """Moves poses after the break to the prediction."""
    sigma: float
    """Standard deviation of the predicted position, per axis [m]."""
    velocity: Float64 = field(default_factory=lambda: np.full(3, np.nan))
    """(3,) before it [m/s]; NaN unknown."""

    def judge(self, velocity: Float64) -> 'Break':
        """
        Return what is left of a step by the velocity after it, as the vehicle may have turned.

        Somewhere between the poses it came to fly so; what this explains is no step.

        Parameters
        ----------
        velocity : (3,) float64
            After it [m/s].

        """
        change = (velocity - self.velocity) * (self.after_ns - self.before_ns) * 1e-9
        shift, square = self.move.shift, max(float(change @ change), LEAST_CHANGE)
        shift = shift + np.clip(-shift @ change / square, 0.0, 1.0) * change
        return replace(
            self, size=float(np.linalg.norm(shift)), move=replace(self.move, shift=shift),
            sigma=math.hypot(self.sigma, math.sqrt(square / 12.0)),
        )

    def describe(self) -> str:
        """Return it in one line."""
        if self.oddity is Oddity.THAWED:
            seconds = (self.after_ns - self.before_ns) * 1e-9
            return f'the odometry stood still for {seconds:.1f} s while the vehicle moved'
        turn = f' and {np.degrees(self.turn):.1f} degrees' if abs(self.turn) > LEAST_TURN else ''
        return f'the odometry stepped by {self.size:.2f} m{turn}'


@dataclass(frozen=True, slots=True)
class _Pose:
    stamp: int
    x: float
    y: float
    z: float
    yaw: float

    @property
    def place(self) -> tuple[float, float, float]:
        return self.x, self.y, self.z


class PoseWatch:
    """Examines each accepted pose; not thread-safe."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Reset; the next pose is not compared."""
        self._window: deque[_Pose] = deque()
        self._velocity: tuple[float, float, float, float] | None = None
        self._usual = 0.0
        self._equal = 0
        self._frozen: _Pose | None = None
        self._since: _Pose | None = None
        self._doubts = False
        self._first_stamp: int | None = None
        """Stamp of the first pose, until the position changes."""

    @property
    def frozen(self) -> bool:
        """Whether the poses are frozen while the vehicle moves."""
        return self._frozen is not None

    @property
    def believed_ns(self) -> int | None:
        """Stamp of the last pose before possibly frozen ones [ns], None if there are none."""
        return self._since.stamp if self._doubts and self._since is not None else None

    @property
    def velocity_since(self) -> Float64 | None:
        """(3,) since the last break, by poses of WINDOW or longer [m/s]; None before."""
        if not self._window:
            return None
        first, last = self._window[0], self._window[-1]
        seconds = (last.stamp - first.stamp) * 1e-9
        if seconds < WINDOW:
            return None
        result: Float64 = (np.array(last.place) - np.array(first.place)) / seconds
        return result

    def see(self, stamp_ns: int, position: Float64, quaternion: Float64) -> Break | None:
        """
        Examine a pose, and return the break before it, if any.

        Parameters
        ----------
        stamp_ns : int
            Later than the one before [ns].
        position : Float64
            (3,) [m].
        quaternion : Float64
            (4,) x y z w.

        Returns
        -------
        Break or None

        """
        x, y, z = position.tolist()
        pose = _Pose(stamp_ns, x, y, z, find_heading(quaternion))
        if not self._window:
            self._window.append(pose)
            self._first_stamp = stamp_ns
            return None
        last = self._window[-1]
        if pose.place == last.place:
            return self._stand(pose, last)
        self._equal, self._doubts = 0, False
        if self._frozen is not None:
            origin, self._frozen = self._frozen, None
            found = self._expect(origin, pose, Oddity.THAWED)
            self._begin(pose)
            return found
        first, self._first_stamp = self._first_stamp, None
        seconds = (pose.stamp - last.stamp) * 1e-9
        if seconds > LONG_GAP or (first is not None and stamp_ns - first < FIRST * 1e9):
            self._begin(pose)
            self._velocity = None
            return None
        self._measure()
        if self._velocity is None:
            self._window.append(pose)
            return None
        found = self._expect(last, pose, Oddity.STEP)
        room = 0.5 * seconds * (seconds + self._length)
        limit = LEAST_STEP + ACCELERATION * room + TIMES_NOISE * self._usual
        if len(self._window) < 3:  # right after a break, by the velocity of before
            limit += MOST_CHANGE * seconds
        if found.size > limit or abs(found.turn) > LEAST_TURN + TURNING * room:
            self._begin(pose)
            return found
        self._usual += SMOOTHING * (min(found.size, limit) - self._usual)
        self._window.append(pose)
        self._shorten()
        return None

    def _begin(self, pose: _Pose) -> None:
        """Keep the velocity before the break until there are poses for a new one."""
        self._window.clear()
        self._window.append(pose)

    @property
    def _length(self) -> float:
        return max((self._window[-1].stamp - self._window[0].stamp) * 1e-9, WINDOW)

    def _measure(self) -> None:
        """Measure the velocity over the window, if it is long enough."""
        first, last = self._window[0], self._window[-1]
        seconds = (last.stamp - first.stamp) * 1e-9
        # over less, the noise of positions looks like a change of velocity
        if len(self._window) < 3 or seconds < LEAST_STEP / MOST_CHANGE:
            return
        self._velocity = (
            (last.x - first.x) / seconds, (last.y - first.y) / seconds,
            (last.z - first.z) / seconds, _wrap(last.yaw - first.yaw) / seconds,
        )

    def _stand(self, pose: _Pose, last: _Pose) -> Break | None:
        """Examine a pose that equals the last one."""
        if self._frozen is not None:
            return None
        self._measure()
        if not self._equal or self._since is None:
            self._since = last
        self._equal += 1
        speed = math.hypot(*self._velocity[:3]) if self._velocity else 0.0
        if speed < MOVING:
            self._doubts = False
            self._window.append(pose)
            self._shorten()
            return None
        stood = (pose.stamp - self._since.stamp) * 1e-9
        self._doubts = stood < FROZEN or self._equal < FROZEN_POSES
        if self._doubts:
            return None
        self._frozen = self._since
        return Break(
            oddity=Oddity.FROZEN, before_ns=self._since.stamp, after_ns=pose.stamp, size=0.0,
            turn=0.0, move=RigidMove(), sigma=0.0,
        )

    def _shorten(self) -> None:
        while len(self._window) > 3 and (
            self._window[-1].stamp - self._window[1].stamp
        ) * 1e-9 >= WINDOW:
            self._window.popleft()

    def _expect(self, last: _Pose, pose: _Pose, oddity: Oddity) -> Break:
        seconds = (pose.stamp - last.stamp) * 1e-9
        vx, vy, vz, turning = self._velocity or (0.0, 0.0, 0.0, 0.0)
        should = np.array([
            last.x + vx * seconds, last.y + vy * seconds, last.z + vz * seconds,
        ])
        place = np.array(pose.place)
        turn = _wrap(pose.yaw - last.yaw - turning * min(seconds, WINDOW))
        return Break(
            oddity=oddity, before_ns=last.stamp, after_ns=pose.stamp,
            size=float(np.linalg.norm(place - should)), turn=turn,
            move=RigidMove(should - place, -turn, place),
            sigma=0.02 + self._usual + 0.25 * ACCELERATION * seconds * (seconds + WINDOW),
            velocity=np.array([vx, vy, vz]),
        )


def _wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)
