# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Inserts scans into the map by the poses of the vehicle, for the node and for replays.

A scan waits, for a bounded time, until the odometry brackets all its points.  Then it is deskewed
and inserted as a whole, or dropped as a whole and counted with the reason.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import islice
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plc_inspect.config import Settings
from plc_inspect.core.alignment.follower import Follower
from plc_inspect.core.alignment.frame_watch import FramedPose
from plc_inspect.core.alignment.parts import BY_RATE, Part, Seen
from plc_inspect.core.mapping.map_entry import MapEntry
from plc_inspect.core.mapping.placement import is_placed, Placer, WaitingScan
from plc_inspect.core.mapping.pose_buffer import PoseBuffer, PoseStatus
from plc_inspect.core.mapping.pose_gate import break_odd, PoseGate
from plc_inspect.core.mapping.scan_clock import ScanClock, WaitClock
from plc_inspect.core.mapping.scan_counters import Counters, DropReason, gather_counters
from plc_inspect.core.mapping.scan_gate import ScanGate
from plc_inspect.core.mapping.scan_points import (
    check_points,
    find_ends,
    judge_times,
    select_points,
)
from plc_inspect.core.mapping.scan_timing import ScanTiming
from plc_inspect.core.setup.mount import Mount
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.results import Float32

QUEUE_SIZE = 64
"""Most scans that wait for poses.  Source: numerical: 3.2 s at 20 Hz, the Puck Lite's fastest."""
RESERVED_VOXELS = 8_000_000
"""
Voxels allocated at the start, so that no scan pays for growing.
Source: derived: the default of map.max_voxels.
"""


class Accumulator:
    """
    Builds the map from poses and scans in order of arrival; owned by one thread.

    The frame of the first pose is the map frame.  Where poses come in another frame, step or
    drift, ``follower`` moves scans to fit the map.  Scans in another frame than the first one are
    rejected.  Scans in the frame of the odometry are inserted without deskewing.

    Parameters
    ----------
    settings : Settings
        ``input`` and ``map`` are used.
    recorded : bool
        Arrival times are those of a recording.

    """

    def __init__(self, settings: Settings, *, recorded: bool = False) -> None:
        self.poses = PoseBuffer(settings.input)
        self.entry = MapEntry(settings.map)
        self.placer = Placer(settings.input)
        """Frames of the vehicle and mount of the lidar."""
        self.follower = Follower()
        """Corrects scans for steps and drift of the odometry."""
        self.pose_gate = PoseGate(settings.input)
        self.configure(settings)
        self.map.reserve(RESERVED_VOXELS)
        self._clock, self._waits = ScanClock(), WaitClock(recorded=recorded)
        self._queue: deque[WaitingScan] = deque()
        self._rest: Iterator[None] = iter(())  # work of the last scan; a break needs all of it
        self._counts: Counter[str] = Counter()
        self._dropped: Counter[DropReason] = Counter()
        self._lidar_frame = ''
        self.mount: Mount | None = None  # for the scans in the map
        self._gate, self.timing = ScanGate(), ScanTiming()
        self.last_inserted: int | None = None
        """Stamp of the scan inserted last [ns], None before the first."""
        self._before: Counters | None = None

    def resume(
        self, frames: tuple[str, str] | None, before: Counters | None, last_inserted: int | None,
        mount: Mount | None = None,
    ) -> None:
        """Continue a flight with its frames, counts, last inserted stamp [ns] and mount."""
        self.pose_gate.frames, self._before = frames, before
        self.last_inserted, self.mount = last_inserted, mount

    def configure(self, settings: Settings) -> None:
        """Use other settings from now on, other than structural ones."""
        source = settings.input
        self._min_range, self._max_range = source.min_range, source.max_range
        self._max_wait = source.max_wait
        for part in (self.placer, self.poses, self.pose_gate):
            part.configure(source)
        self.map.configure(settings.map)

    @property
    def map(self) -> VoxelMap:
        """All points inserted."""
        return self.entry.map

    @property
    def doubt(self) -> str:
        """Why the odometry cannot be trusted, so that no result may be reported; '' if it can."""
        return self.pose_gate.doubt or self.follower.doubt

    @property
    def waits(self) -> bool:
        """Whether scans wait for poses."""
        return bool(self._queue)

    @property
    def frames(self) -> tuple[str, str] | None:
        """Frames of the odometry and of the base; None before the first pose."""
        return self.pose_gate.frames

    @property
    def frame_id(self) -> str:
        """Frame of the odometry, '' before the first pose."""
        return self.frames[0] if self.frames else ''

    def add_pose(
        self, stamp_ns: int, position: ArrayLike, quaternion: ArrayLike, *,
        frame_id: str = '', child_frame_id: str = '', now: float | None = None,
        tell: Callable[[], None] | None = None,
    ) -> bool:
        """
        Add one pose of the vehicle, and insert the scans that it brackets.

        Parameters
        ----------
        stamp_ns : int
            Time of the pose [ns].
        position : array_like
            (3,) base in the map frame [m].
        quaternion : array_like
            (4,) x y z w.
        frame_id, child_frame_id : str
            Frame of the pose, and of the base.
        now : float or None
            Time of arrival by a steady clock or the recording's clock [s].
        tell : callable or None
            Called if True is returned, before scans are inserted, which takes many times longer.

        Returns
        -------
        bool
            Whether the pose was accepted or waits for the next one; if not, the counters say why.

        """
        given = FramedPose(
            stamp_ns, np.array(position, dtype=np.float64),
            np.array(quaternion, dtype=np.float64), (frame_id, child_frame_id),
        )
        taken = self.pose_gate.judge(given)
        if taken is None:
            self._counts['poses of another frame'] += 1
        elif not taken and tell:
            tell()
        every = taken or []
        accepted = [self._take_pose(pose, tell if pose is every[-1] else None) for pose in every]
        self.expire(now)
        return accepted[-1] if accepted else taken is not None

    def _take_pose(self, pose: FramedPose, tell: Callable[[], None] | None = None) -> bool:
        status = self.poses.insert(pose.stamp_ns, pose.position, pose.quaternion)
        if status.accepted:
            self.pose_gate.frames = pose.frames
            if status is PoseStatus.RESTARTED:
                self._forget_times()
            if break_odd(self.poses, self.follower):
                self._forget_times()
            try:
                if tell:
                    tell()
            finally:  # what cannot be told keeps no scan from the map
                deque(islice(self._rest, None if self.follower.waits else 1), maxlen=0)
                self._drain()
                self._enter(self.follower.settle(pose.stamp_ns))
        return status.accepted

    def add_scan(
        self, stamp_ns: int, xyz: Float32, time: NDArray[np.float64] | None = None, *,
        frame_id: str = '', num_not_finite: int = 0, layout: str = '', now: float | None = None,
    ) -> None:
        """
        Add one scan; it is inserted once the odometry brackets its points.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the scan [ns].
        xyz : Float32
            (N, 3) points in the lidar frame [m].
        time : NDArray[np.float64] or None
            (N,) time of each point relative to the stamp [s], >= 0 where that is of the first
            packet, <= 0 where it is of the last.  None: all points are taken at the stamp.
        frame_id : str
            Frame of the scan.
        num_not_finite : int
            Points that were not finite and were removed from ``xyz``, to be counted.
        layout : str
            Order of the coordinates in the message; scans must keep to that of the first.
        now : float or None
            Time of arrival by a steady clock or the recording's clock [s]; without it a scan
            waits until the queue is full.

        Raises
        ------
        DataError
            The shapes do not match, or a time is implausible; the scan is not counted.

        """
        # keep finite points within range; those in the map frame are judged later
        points, times = check_points(xyz, time)
        placed = is_placed(frame_id, self.frame_id)
        low, high = (0.0, math.inf) if placed else (self._min_range, self._max_range)
        kept, stamps, not_finite, near, far, worst = select_points(
            points, times, stamp_ns, low, high
        )
        timed = judge_times(time, len(kept), worst) or placed or not len(kept)
        self._counts['scans'] += 1
        reason = self._gate.judge(
            frame_id, layout, stamp_ns, find_ends(stamps, stamp_ns), self._clock.period, timed
        )
        if reason is not None:
            self._dropped[reason] += 1
            return
        stamps = self.timing.shift(stamp_ns, stamps)
        first, last = find_ends(stamps, stamp_ns)
        # count, and queue the scan in place of the oldest where the queue is full
        self._clock.note_lead(last, self.poses.last_stamp)
        self._lidar_frame = frame_id
        self._counts['points'] += len(points) + num_not_finite
        self._counts['not finite'] += not_finite + num_not_finite
        self._counts['too near'] += near
        self._counts['too far'] += far
        self._counts['scans without time'] += not timed
        self._clock.add(stamp_ns)
        if len(self._queue) == QUEUE_SIZE:
            self._queue.popleft()
            self._dropped[DropReason.QUEUE_FULL] += 1
        heard = None if now is None else self._waits.hear(now, self._max_wait)
        self._queue.append(WaitingScan(stamp_ns, kept, stamps, first, last, heard, placed))
        self._drain()
        self.expire(now)

    def refuse(self, reason: DropReason) -> None:
        """Count a scan that was refused before it was read."""
        self._counts['scans'] += 1
        self._dropped[reason] += 1

    def expire(self, now: float | None) -> None:
        """Drop scans that waited longer than ``max_wait`` by ``now`` [s]; none if that is None."""
        if now is None:
            return
        heard = self._waits.hear(now, self._max_wait)
        for scan in self._take_waiting():
            if scan.arrival is None or heard - scan.arrival <= self._max_wait:
                self._queue.append(scan)
            else:
                self._dropped[DropReason.WAITED_TOO_LONG] += 1

    def finish(self) -> None:
        """End a recording: drop the waiting scans, which no pose will bracket any more."""
        for pose in self.pose_gate.release():
            self._take_pose(pose)
        for _ in self._take_waiting():
            self._dropped[DropReason.NO_POSE_AFTER] += 1
        deque(self._rest, maxlen=0)
        self._enter(self.follower.settle(0, at_once=True))

    def reset(self, *, keep_map: bool = False) -> None:
        """
        Forget poses and waiting scans, as after a backward jump of time; keep the counters.

        Parameters
        ----------
        keep_map : bool
            Keep the map and the frames.

        """
        self.poses.clear()
        self._clock = self._clock.restarted()
        self.entry.forget_times()
        self._forget_times()
        if not keep_map:
            self.follower.clear()
            self.entry.clear()
            self.pose_gate.clear()
            self.last_inserted = self.mount = None
            self._gate = ScanGate()
            self.timing.clear()

    def _forget_times(self) -> None:
        """Take poses and scans of any time from now on; drop what waits, as its time is over."""
        self._dropped[DropReason.RESET] += len(self._queue)
        self._queue.clear()
        self._gate.forget_times()
        self.pose_gate.forget_times()
        self.timing.forget_times()
        self._rest = iter(())
        self.follower.forget_times()

    def _take_waiting(self) -> Iterator[WaitingScan]:
        """Yield the scans that wait now, and take each out of the queue."""
        return (self._queue.popleft() for _ in range(len(self._queue)))

    def _drain(self) -> None:
        """Insert or drop every scan that the odometry has passed."""
        newest = self.poses.last_stamp
        if newest is None or len(self.poses) < 2 or self.poses.in_doubt or not self._queue:
            return
        for scan in self._take_waiting():
            if scan.last > min(newest, self.follower.watch.believed_ns or newest):
                self._queue.append(scan)
            else:
                self._insert(scan)

    def _insert(self, scan: WaitingScan) -> None:
        deque(self._rest, maxlen=0)
        early = is_placed(self._lidar_frame, self.frame_id) and not scan.placed
        if early or self._gate.is_disproved(scan.stamp_ns):  # early: the map frame was unknown
            self._dropped[DropReason.NO_POSE_BEFORE if early else DropReason.DISPROVED] += 1
            return
        self._follow_mount()
        found = self.placer.place(scan, self.poses)
        if isinstance(found, DropReason):
            self._dropped[found] += 1
            if found in (DropReason.POSE_JUMP, DropReason.POSE_FROZEN):
                self.timing.forget_looks()
            return
        self._counts['too near'] += found.num_near
        self._counts['too far'] += found.num_far
        seen = Seen(found.points, found.stamps, found.apart, scan.stamp_ns)
        self._enter(self.follower.take(seen))
        self._rest = self._compare(scan)

    def _compare(self, scan: WaitingScan) -> Iterator[None]:
        """Compare a scan with those before it, in pieces of which each keeps a pose waiting."""
        for cause in self.timing.look(scan, self.placer, self.poses):
            if cause:
                self._begin_anew(cause)
            yield
        self.follower.steady.hear(self.timing.steady)
        for part in self.follower.catch_up():
            self._enter([part])
            yield

    def _enter(self, ready: Iterable[Seen | Part | None]) -> None:
        """Insert scans into the map; begin it anew at a part that does not fit into it."""
        for item in (item for item in ready if item is not None):
            if isinstance(item, Part):
                self.entry.begin_anew(item.describe(), holds=not self.doubt and item.by != BY_RATE)
                continue
            insertion = self.entry.enter(item)
            if insertion is None and self.entry.is_away(item):
                back = self.follower.move.inverse()
                self._begin_anew('the odometry left the range of the map', holds=True)
                item = replace(item, points=back.apply(item.points))
                insertion = self.entry.enter(item)
            if insertion is None:
                self._dropped[DropReason.OUT_OF_MAP] += 1
                continue
            self.last_inserted = item.stamp_ns
            self._counts['scans inserted'] += 1
            self._counts['points inserted'] += insertion.num_points
            self._counts['map full'] += insertion.num_refused

    def _follow_mount(self) -> None:
        """Begin the map anew if the mount of the lidar differs from that of the scans in it."""
        self.placer.set_frames(self.frames, self._lidar_frame)
        before, self.mount = self.mount, self.placer.mount
        if before is not None and not self.mount.equals(before) and len(self.map):
            self.timing.forget_looks()
            self._begin_anew(f'the mount of the lidar has changed: {self.mount.describe()}')

    def _begin_anew(self, cause: str, *, holds: bool = False) -> None:
        self.follower.clear()
        self.entry.begin_anew(cause, holds=holds)

    def counters(self) -> Counters:
        """Return the counts since the start."""
        dropped = self._dropped + Counter({DropReason.BEGUN_ANEW: self.follower.num_given_up})
        waiting = len(self._queue) + self.follower.num_waiting
        now = gather_counters(
            self._counts, dropped, self.poses, self._clock, waiting, self.entry.num_restarts
        )
        return now if self._before is None else now.add(self._before)
