# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What comes in: scans and odometry into the map, counted, complained of, bounded."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
import math
from threading import Event, Thread
import time
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import PointCloud2

from plc_inspect.config import Settings
from plc_inspect.core.alignment.parts import Part
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.live.owed_cells import NEAR, OwedCells
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.mapping.eviction import Evictor
from plc_inspect.core.mapping.flown_way import FlownWay
from plc_inspect.core.mapping.map_entry import MapEntry
from plc_inspect.core.mapping.scan_counters import Counters, DropReason
from plc_inspect.core.mapping.standstill import explain_standstill
from plc_inspect.core.setup.mount import Mount
from plc_inspect.core.setup.moving_frames import MovingFrames
from plc_inspect.core.voxel_buffer.voxel_changes import StoredMap
from plc_inspect.errors import DataError
from plc_inspect.flight_record.plain_values import from_plain
from plc_inspect.flight_record.resumption import read_mount
from plc_inspect.messages.poses import (
    pose_from_message,
    poses_from_transforms,
    StampedPose,
    transforms_from_message,
)
from plc_inspect.messages.scans import scan_from_message
from plc_inspect.offline.records.flight import MAP_FULL
from plc_inspect.results import Float64
from plc_inspect.ros.background.system_memory import take_memory
from plc_inspect.ros.node.complaints import Complaints
from plc_inspect.ros.node.diagnostics import Health, LossReporter

TOLD = 30.0
"""A step of the odometry is told of in /diagnostics for so long [s]."""
MOST_REFUSED = 0.01
"""Share of the points that a full map may refuse until its gaps could be taken for ends."""


class Intake:
    """
    Poses, waiting scans and the map, for the executor's thread only.

    Parameters
    ----------
    settings : Settings
        At the start.
    health : Health
        Counts go there.
    warn : callable
        Takes a line of text for the log.

    """

    def __init__(
        self, settings: Settings, health: Health, warn: Callable[[str], object]
    ) -> None:
        self.accumulator = Accumulator(settings)
        self.evictor = Evictor(self.accumulator.map)
        self.way, self.owed = FlownWay(), OwedCells()
        self.vehicle: Float64 | None = None
        """(3,) where the vehicle is in the map [m], None before the first pose."""
        self.told_vehicle: Float64 | None = None
        """The same in the frame of the odometry as it is now."""
        self.first_stamp: int | None = None
        """Stamp of the first scan [ns]."""
        self.on_restart: Callable[[], object] = lambda: None
        """Called when the map has begun anew."""
        self.accepts: Callable[[Mapping[str, Any], float], bool] = lambda info, now: True
        """Tells whether a scan is of the driver that is listened to."""
        self.on_pose: Callable[[StampedPose, RigidMove | None, MapEntry, bool], None] = (
            lambda pose, move, cells, late: None
        )
        """
        Called with each pose that is taken, the move into the map frame, None where nobody knows
        the vehicle's place, the cells of the map, and whether newer poses wait.
        """
        self.judge_pose: Callable[[StampedPose], bool] | None = None
        """Tells of the first poses after an interruption whether they are to be taken."""
        self.judge_scan: Callable[[str], bool] | None = None
        """The same of the first scans, by their frame."""
        self._interrupted: list[int | None] = []
        self._num_parts, self._told_since = 0, -TOLD
        self._pose_before: int | None = None
        self._num_restarts = 0
        self._refused_before = self._inserted_before = 0
        self._health = health
        self._settings = settings.input
        self._moving = MovingFrames(
            self.accumulator.placer.frames, settings.input.map_frame, settings.input.base_frame
        )
        self._complaints = Complaints(warn)
        self._losses = LossReporter(warn)
        self._taker: Thread | None = None
        self._stop_taking = Event()

    def take_memory(self) -> None:
        """
        Take the map's memory in a thread, so that no scan waits for it in flight.

        Call it when all is loaded: a machine that has to find half a gigabyte anew takes a second,
        in which all else that needs memory, as loading does, becomes slow.
        """
        self.leave_memory()
        self._stop_taking = Event()
        self._taker = Thread(
            target=take_memory, args=(self.accumulator.map.memory, self._stop_taking),
            name='plc_memory', daemon=True,
        )
        self._taker.start()

    def leave_memory(self) -> None:
        """Stop taking memory; it takes a few milliseconds."""
        self._stop_taking.set()
        if self._taker is not None:
            self._taker.join()
            self._taker = None

    def take_scan(self, message: PointCloud2, info: Mapping[str, Any]) -> None:
        """Put a scan in, or count why not; ``info`` is what rclpy tells of the message."""
        now = time.monotonic()
        if not self.accepts(info, now):
            self.accumulator.refuse(DropReason.OTHER_DRIVER)
            return
        self._health.last_scan = now
        if self.judge_scan is not None and not self.judge_scan(message.header.frame_id):
            self.accumulator.refuse(DropReason.OTHER_MOUNT)
            return
        try:
            scan = scan_from_message(message)
            self.accumulator.add_scan(
                scan.stamp_ns, scan.xyz, scan.time, frame_id=scan.frame_id,
                num_not_finite=scan.num_not_finite, layout=scan.layout, now=now,
            )
        except DataError as error:
            self._complain_of('scan', f'scan dropped, malformed: {error}', error)
            return
        if self.first_stamp is None:
            self.first_stamp = scan.stamp_ns
        self._follow_restart()
        self.evictor.step(self.vehicle)

    def take_odometry(
        self, message: Odometry | PoseStamped | PoseWithCovarianceStamped, late: bool = False
    ) -> None:
        """
        Put a pose in; what is rejected is counted by the accumulator.

        A pose is late where others wait behind it: nobody is told how near the vehicle was then.
        """
        try:
            self._take_pose(pose_from_message(message), late)
        except DataError as error:
            self._complain_of_pose(error)

    def take_moving(self, message: Any, late: bool = False) -> None:
        """Put the poses of a tf2_msgs/TFMessage of /tf in, as ``take_odometry``."""
        try:
            for pose in poses_from_transforms(message, self._moving, self._settings):
                self._take_pose(pose, late)
        except DataError as error:
            self._complain_of_pose(error)

    def take_fixed(self, message: Any) -> None:
        """Take the frames of a tf2_msgs/TFMessage of /tf_static."""
        for item in transforms_from_message(message):
            try:
                self.accumulator.placer.add_frame(item)
            except DataError as error:
                self._complain_of('tf_static', f'transform of /tf_static dropped: {error}', error)

    def find_mount(self, frame: str) -> Mount:
        """Return how the lidar of a frame is mounted, as far as is known now."""
        self.accumulator.placer.set_frames(self.accumulator.frames, frame)
        return self.accumulator.placer.mount

    @property
    def tf_problem(self) -> str:
        """Why /tf gives no poses, '' where it does."""
        return self._moving.explain()

    def _take_pose(self, pose: StampedPose, late: bool) -> None:
        now = self._health.last_pose = time.monotonic()
        if self.judge_pose is not None and not self.judge_pose(pose):
            return
        accepted = self.accumulator.add_pose(
            pose.stamp_ns, pose.position, pose.quaternion, frame_id=pose.frame_id,
            child_frame_id=pose.child_frame_id, now=now, tell=lambda: self._tell(pose, late),
        )
        if accepted:
            self._follow_parts(now)
        self._follow_restart()

    def _tell(self, pose: StampedPose, late: bool) -> None:
        """Note where the vehicle is, and tell how near it is."""
        self.told_vehicle = pose.position
        move = self.accumulator.follower.likely_move
        if move is not None:
            self.vehicle = move.apply(np.array(pose.position, dtype=np.float64))
            self.way.add(pose.stamp_ns, self.vehicle)
        self.on_pose(pose, move, self.accumulator.entry, late)

    def _follow_parts(self, now: float) -> None:
        """Say what is wrong with the odometry."""
        follower = self.accumulator.follower
        if len(follower.parts) > self._num_parts:
            self._num_parts = len(follower.parts)
            self._told_since = now
            self._complaints.complain('part', follower.parts[-1].describe())
        told = follower.following or now - self._told_since < TOLD
        self._health.odometry = ''
        if follower.watch.frozen:
            self._health.odometry = 'the odometry stands still while the vehicle moves'
        elif follower.parts and told:
            self._health.odometry = follower.parts[-1].describe()
        elif odd := '; '.join(filter(None, (
            self.accumulator.timing.describe(), self.accumulator.pose_gate.describe(),
        ))):
            self._health.odometry = odd
            self._complaints.complain('odd', odd)

    @property
    def move(self) -> RigidMove:
        """From the frame of the odometry as it is now into that of the map."""
        return self.accumulator.follower.move

    def _complain_of_pose(self, error: DataError) -> None:
        self._health.last_pose = time.monotonic()
        self._complain_of('odometry', f'pose rejected, malformed: {error}', error)

    def _complain_of(self, kind: str, text: str, error: DataError) -> None:
        """Count a message that cannot be used, and say so."""
        self._health.malformed[kind] += 1
        self._health.problems[kind] = str(error)
        self._complaints.complain(kind, f'{text} ({self._health.malformed[kind]} so far)')

    def _follow_restart(self) -> None:
        if self.accumulator.entry.num_restarts > self._num_restarts:
            self._num_restarts = self.accumulator.entry.num_restarts
            self.evictor.clear()
            self.take_memory()
            self.on_restart()  # results of the old map have its way
            self._begin_map()

    def explain_nothing(self) -> str:
        """Return why none of the scans that came in is in the map, '' where none came in."""
        counters = self.accumulator.counters()
        if not counters.num_scans and not self._health.malformed['scan']:
            return ''
        causes = self._health.find_causes(self._health.problems)
        cause = explain_standstill(counters, None, causes, self._settings)
        return f': {cause}'

    @property
    def doubt(self) -> str:
        """Why nothing may be told of the map: no room about the vehicle, or a wrong odometry."""
        if doubt := self.accumulator.doubt:
            return doubt
        counters = self.accumulator.counters()
        refused = self.count_refused(counters)
        all_points = refused + counters.num_points_inserted - self._inserted_before
        if refused <= MOST_REFUSED * all_points and self.evictor.nearest > NEAR:
            return ''
        return (
            f'{MAP_FULL} with {self.accumulator.map.max_voxels} voxels and has gaps about '
            'the vehicle: results are held back; raise map.max_voxels'
        )

    def count_refused(self, counters: Counters) -> int:
        """Return the number of points for which the map had no room, since it began."""
        return counters.points_dropped.get('map full', 0) - self._refused_before

    def report_losses(self) -> bool:
        """Log what was lost since the last call; return whether anything was."""
        self.accumulator.expire(time.monotonic())
        if self.accumulator.last_inserted is not None:
            mount = self.accumulator.placer.mount
            if mount.doubt and mount.doubt != self._health.mount_doubt:
                self._complaints.complain('mount', mount.doubt)
            self._health.mount, self._health.mount_doubt = mount.describe(), mount.doubt
        return self._losses.report(self.accumulator.counters())

    def describe(self) -> dict[str, Any]:
        """Return what came in so far, JSON-serialisable, as in the results of a replay."""
        return asdict(self.accumulator.counters()) | {
            'skipped': dict(self._health.malformed), 'first_errors': {},
            'num_voxels_evicted': self.evictor.num_evicted, 'interrupted': self._interrupted,
            'mount': self.accumulator.placer.mount.describe(),
            'mount_doubt': self.accumulator.placer.mount.doubt,
            'parts': [part.record() for part in self.accumulator.follower.parts],
        }

    def remember(self) -> dict[str, Any]:
        """Return what ``resume`` needs beside the map, JSON-serialisable."""
        accumulator, vehicle = self.accumulator, self.told_vehicle
        mount = accumulator.mount
        return {
            'frames': accumulator.frames, 'first_stamp_ns': self.first_stamp,
            'mount': None if mount is None else mount.transform.tolist(),
            'stamp_ns': accumulator.last_inserted,
            'pose_stamp_ns': accumulator.poses.last_stamp or self._pose_before,
            'vehicle': None if vehicle is None else vehicle.tolist(),
            'nearest_evicted': self.evictor.nearest, 'doubt': self.doubt,
            'judged_from': [self._refused_before, self._inserted_before],
            'move': self.move.record(), 'counts': self.describe(),
            'odometry_doubt': accumulator.follower.doubt, 'clock': accumulator.timing.remember(),
        }

    def resume(self, state: Mapping[str, Any], stored: StoredMap) -> None:
        """
        Go on with what another process remembered; poses are new, so there is a gap.

        Parameters
        ----------
        state : mapping
            As from ``remember``.
        stored : StoredMap
            The map.

        Raises
        ------
        DataError
            It does not fit together, or the map has no room for it; then nothing changed.

        """
        counts = state['counts']
        before = from_plain(Counters, {
            item.name: counts[item.name] for item in fields(Counters)
        })
        frames, stamp = from_plain(tuple[str, str], state['frames']), state['stamp_ns']
        vehicle = state['vehicle']
        mount = read_mount(state)
        self.accumulator.map.restore(stored)
        move = RigidMove.from_record(state.get('move'))
        self.accumulator.resume(frames, before, stamp, mount)
        self.first_stamp = state['first_stamp_ns']
        self._pose_before = state['pose_stamp_ns']
        if vehicle is not None:
            self.told_vehicle = np.array(vehicle, dtype=np.float64)
            self.vehicle = move.apply(self.told_vehicle)
        self.accumulator.follower.resume(
            move, self.accumulator.map.centroids(), stamp or 0, self.vehicle,
            [Part.from_record(item) for item in counts.get('parts', [])],
            state.get('odometry_doubt', ''),
        )
        self.accumulator.timing.resume(*state.get('clock', (0.0, 0.0, None)))
        self._num_parts = len(self.accumulator.follower.parts)
        nearest = state['nearest_evicted']
        self.evictor.resume(
            counts['num_voxels_evicted'], math.inf if nearest is None else float(nearest)
        )
        self._refused_before, self._inserted_before = state['judged_from']
        self._health.malformed.update(counts['skipped'])
        self._interrupted = [*counts['interrupted'], stamp]
        self._losses.skip(self.accumulator.counters())

    def disown(self) -> None:
        """Forget a flight that was resumed wrongly, its counts too."""
        self.accumulator.resume(None, None, None)
        self.evictor.resume(0, math.inf)
        self.reset()
        self._health.malformed.clear()
        self._interrupted, self._pose_before = [], None
        self.vehicle = self.told_vehicle = None

    def reset(self) -> None:
        """Forget the map and all that waits; counters go on."""
        self._complaints.forget()
        self.accumulator.reset()
        self.take_memory()
        self.evictor.clear()
        self.first_stamp = None
        self.accumulator.follower.parts.clear()
        self._num_parts = 0
        self._begin_map()

    def _begin_map(self) -> None:
        """Judge the new map by what comes from now on."""
        self.way.clear()
        self.owed = OwedCells()
        counters = self.accumulator.counters()
        self._refused_before = counters.points_dropped.get('map full', 0)
        self._inserted_before = counters.num_points_inserted
