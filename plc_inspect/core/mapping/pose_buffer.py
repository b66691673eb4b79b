# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A bounded buffer of the vehicle's poses, for interpolation between them.

Frames: a pose is ``T_map_base``, the base of the vehicle in the frame of the odometry.  Stamps
are int64 nanoseconds, quaternions x y z w of unit length.
"""

from collections import Counter
from dataclasses import dataclass
import enum
import math

from numba import njit
import numpy as np
from numpy.typing import ArrayLike

from plc_inspect.config import InputSettings
from plc_inspect.core.alignment.pose_watch import LEAST_STEP, LEAST_TURN
from plc_inspect.core.mapping.scan_clock import SetBack
from plc_inspect.errors import DataError
from plc_inspect.results import Float64, Int64, UInt8

DEFAULT_CAPACITY = 8192
"""
Poses kept.
Source: numerical: 80 s at 100 Hz, 8 s at 1 kHz; scans wait for 1 s (input.max_wait).
"""
MAX_TURN_RATE = 35.0
"""
Greatest plausible turn rate between two poses [rad/s].
Source: derived: 2000 degrees/s, as far as gyroscopes measure.
"""
QUATERNION_TOLERANCE = 0.01
"""Greatest difference of a quaternion's length from 1.  Source: judgement; not measured."""
PERIODS = 16
"""Intervals between poses over which the median is taken.  Source: judgement; not measured."""


class PoseStatus(enum.Enum):
    """What the buffer did with a pose."""

    ACCEPTED = 'accepted'
    RESTARTED = 'accepted, buffer restarted after stamps went back'
    NOT_FINITE = 'not finite'
    BAD_QUATERNION = 'quaternion not of unit length'
    NOT_LATER = 'stamp repeated or backward'

    @property
    def accepted(self) -> bool:
        """Whether the pose is now in the buffer."""
        return self in (PoseStatus.ACCEPTED, PoseStatus.RESTARTED)


class Bracket(enum.IntEnum):
    """Whether a stamp lies between two poses that can be interpolated."""

    OK = 0
    BEFORE = 1
    """Earlier than all poses of the buffer."""
    AFTER = 2
    """Later than all poses of the buffer."""
    GAP = 3
    """The poses on both sides are farther apart than ``max_pose_gap``."""
    JUMP = 4
    """The poses on both sides do not belong together; see ``alignment.pose_watch``."""
    FROZEN = 5
    """The poses on both sides are the same while the vehicle moves."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseArrays:
    """The poses of a buffer, ascending in time; views, valid until the next insertion."""

    stamps: Int64
    """(M,) [ns]."""
    positions: Float64
    """(M, 3) [m]."""
    quaternions: Float64
    """(M, 4) x y z w, unit length."""
    intervals: UInt8
    """(M,) Bracket (all but BEFORE and AFTER) of the interval that ends at each pose; first OK."""


class PoseBuffer:
    """
    Bounded buffer of poses in order of time; the oldest are dropped first.

    Rejects and counts poses that are not finite, whose quaternion is not of unit length or whose
    stamp is not later than the newest.  When it has rejected poses in a row for their stamps
    although these ascend, until ``SetBack`` tells that the clock of the odometry was set back, the
    buffer is cleared and starts again with the last of them.

    Parameters
    ----------
    settings : InputSettings
        ``max_pose_gap`` and ``max_speed`` are used.
    capacity : int
        Number of poses kept, at least 2.

    Raises
    ------
    DataError
        The capacity is less than 2.

    """

    def __init__(self, settings: InputSettings, capacity: int = DEFAULT_CAPACITY) -> None:
        if capacity < 2:
            raise DataError(f'a pose buffer holds at least 2 poses, got capacity {capacity}')
        self.configure(settings)
        self._capacity = capacity
        # Twice the capacity, so that the live poses are always one contiguous slice.
        self._stamps: Int64 = np.empty(2 * capacity, dtype=np.int64)
        self._poses: Float64 = np.empty((2 * capacity, 7), dtype=np.float64)
        self._intervals: UInt8 = np.empty(2 * capacity, dtype=np.uint8)
        self._counts: Counter[PoseStatus] = Counter()
        self._interval_counts: Counter[Bracket] = Counter()
        self._set_back = SetBack()
        self.clear()

    def configure(self, settings: InputSettings) -> None:
        """Use another ``max_pose_gap`` and ``max_speed`` for intervals from now on."""
        self._max_gap_ns = round(settings.max_pose_gap * 1e9)
        self._max_speed = settings.max_speed

    def __len__(self) -> int:
        """Return the number of poses in the buffer."""
        return self._end - self._start

    @property
    def last_stamp(self) -> int | None:
        """Stamp of the newest pose [ns], None when empty."""
        return int(self._stamps[self._end - 1]) if len(self) else None

    @property
    def in_doubt(self) -> bool:
        """Whether poses came since the newest that are not later: the clock may be set back."""
        return self._set_back.count > 0

    @property
    def period(self) -> float | None:
        """Median time between the newest poses [s], None while there are fewer than 3."""
        newest = self._stamps[max(self._start, self._end - PERIODS - 1) : self._end]
        return float(np.median(np.diff(newest))) * 1e-9 if len(newest) > 2 else None

    @property
    def counts(self) -> dict[PoseStatus, int]:
        """Number of poses by status since the buffer was made."""
        return dict(self._counts)

    @property
    def num_gaps(self) -> int:
        """Intervals longer than ``max_pose_gap`` since the buffer was made."""
        return self._interval_counts[Bracket.GAP]

    @property
    def num_jumps(self) -> int:
        """Intervals that no vehicle can fly since the buffer was made."""
        return self._interval_counts[Bracket.JUMP]

    def clear(self) -> None:
        """Forget all poses; the counts stay."""
        self._start = 0
        self._end = 0
        self._set_back.clear()
        self.num_refused = 0
        """Poses refused for their stamps right before the newest, although these ascend."""

    def restart(self) -> None:
        """Forget all poses but the newest, as before it the clock was set back."""
        self._start = self._end - 1
        self._intervals[self._start] = Bracket.OK
        self._counts[PoseStatus.ACCEPTED] -= 1
        self._counts[PoseStatus.RESTARTED] += 1

    def insert(self, stamp_ns: int, position: ArrayLike, quaternion: ArrayLike) -> PoseStatus:
        """
        Add one pose.

        Parameters
        ----------
        stamp_ns : int
            Time of the pose [ns].
        position : array_like
            (3,) base in the map frame [m].
        quaternion : array_like
            (4,) x y z w.

        Returns
        -------
        PoseStatus
            Whether the pose was accepted, and if not, why.

        """
        pose = np.empty(7, dtype=np.float64)
        pose[:3] = position
        pose[3:] = quaternion
        status = self._check(stamp_ns, pose)
        self._counts[status] += 1
        if status is PoseStatus.RESTARTED:
            self.clear()
        if status.accepted:
            self._append(stamp_ns, pose)
        return status

    def break_last(self, bracket: Bracket, after_ns: int | None = None) -> None:
        """
        Forbid interpolation over the interval that ends at the newest pose.

        Parameters
        ----------
        bracket : Bracket
            The reason.
        after_ns : int or None
            Intervals that end later than this are broken too [ns].

        """
        for last in range(self._end - 1, self._start, -1):
            if last < self._end - 1 and (after_ns is None or self._stamps[last] <= after_ns):
                break
            before = Bracket(int(self._intervals[last]))
            if before in (Bracket.OK, Bracket.JUMP):
                self._interval_counts[before] -= 1
                self._interval_counts[bracket] += 1
                self._intervals[last] = bracket

    def _check(self, stamp_ns: int, pose: Float64) -> PoseStatus:
        if not np.isfinite(pose).all():
            return PoseStatus.NOT_FINITE
        norm = math.sqrt(float(pose[3:] @ pose[3:]))
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            return PoseStatus.BAD_QUATERNION
        pose[3:] /= norm
        last = self.last_stamp
        if last is None or stamp_ns > last:
            self.num_refused = self._set_back.count
            self._set_back.clear()
            return PoseStatus.ACCEPTED
        return PoseStatus.RESTARTED if self._set_back.add(stamp_ns) else PoseStatus.NOT_LATER

    def _append(self, stamp_ns: int, pose: Float64) -> None:
        if self._end == 2 * self._capacity:
            live = slice(self._end - self._capacity + 1, self._end)
            for array in (self._stamps, self._poses, self._intervals):
                array[: self._capacity - 1] = array[live]
            self._start, self._end = 0, self._capacity - 1
        end = self._end
        interval = Bracket.OK
        if end > self._start:
            interval = self._judge(stamp_ns, pose)
            self._interval_counts[interval] += 1
        self._stamps[end] = stamp_ns
        self._poses[end] = pose
        self._intervals[end] = interval
        self._end = end + 1
        self._start = max(self._start, self._end - self._capacity)

    def _judge(self, stamp_ns: int, pose: Float64) -> Bracket:
        """Tell whether the interval from the newest pose to this one can be interpolated."""
        last = self._poses[self._end - 1]
        gap_ns = stamp_ns - int(self._stamps[self._end - 1])
        seconds = gap_ns * 1e-9
        if gap_ns > self._max_gap_ns:
            return Bracket.GAP
        cosine = min(1.0, abs(float(last[3:] @ pose[3:])))
        angle = 2.0 * math.acos(cosine)
        # noise and jitter are no motion, however close the stamps
        if (
            math.dist(last[:3], pose[:3]) > LEAST_STEP + self._max_speed * seconds
            or angle > LEAST_TURN + MAX_TURN_RATE * seconds
        ):
            return Bracket.JUMP
        return Bracket.OK

    def arrays(self) -> PoseArrays:
        """Return the live poses as views, without a copy."""
        live = slice(self._start, self._end)
        poses = self._poses[live]
        return PoseArrays(self._stamps[live], poses[:, :3], poses[:, 3:], self._intervals[live])


@njit(cache=True, nogil=True)
def bracket_stamps(
    stamps: Int64, pose_stamps: Int64, intervals: UInt8
) -> tuple[Int64, UInt8]:
    """
    Find the pose that ends the interval in which each stamp lies.

    Parameters
    ----------
    stamps : Int64
        (N,) times in any order [ns]; nearly ordered ones cost O(1) each, others O(log M).
    pose_stamps : Int64
        (M,) ascending [ns].
    intervals : UInt8
        (M,) Bracket of the interval that ends at each pose.

    Returns
    -------
    tuple[Int64, UInt8]
        (N,) index of the later pose, and (N,) Bracket; the index is valid only if OK.

    """
    num_poses = len(pose_stamps)
    upper = np.zeros(len(stamps), dtype=np.int64)
    bracket = np.zeros(len(stamps), dtype=np.uint8)
    k = 1  # the last interval found: nearly ordered stamps lie in it or in the next
    for i in range(len(stamps)):
        stamp = stamps[i]
        # nothing is extrapolated
        if num_poses == 0 or stamp > pose_stamps[-1]:
            bracket[i] = 2
            continue
        if stamp < pose_stamps[0]:
            bracket[i] = 1
            continue
        if num_poses == 1:
            bracket[i] = 2
            continue
        # the interval that holds the stamp
        if not (pose_stamps[k - 1] <= stamp <= pose_stamps[k]):
            if k + 1 < num_poses and pose_stamps[k] <= stamp <= pose_stamps[k + 1]:
                k += 1
            else:
                k = min(max(np.searchsorted(pose_stamps, stamp), 1), num_poses - 1)
        found = k
        # a stamp that equals a pose's lies in two intervals: take the one that is OK
        if intervals[k] != 0:
            if stamp == pose_stamps[k] and k + 1 < num_poses and intervals[k + 1] == 0:
                found = k + 1
            elif stamp == pose_stamps[k - 1] and k > 1 and intervals[k - 1] == 0:
                found = k - 1
        upper[i] = found
        bracket[i] = intervals[found]
    return upper, bracket
