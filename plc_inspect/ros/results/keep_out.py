# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How near the vehicle is to conductors, supports and all else, at the rate of its poses."""

from collections.abc import Callable
from dataclasses import replace

from builtin_interfaces.msg import Time
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from plc_inspect.config import Settings
from plc_inspect.core.alignment.rigid_move import find_heading, RigidMove
from plc_inspect.core.live.held_levels import HeldLevels
from plc_inspect.core.live.motion import Motion
from plc_inspect.core.live.proximity import measure_proximity
from plc_inspect.core.live.session import LiveState
from plc_inspect.core.live.surroundings import Surroundings
from plc_inspect.core.mapping.map_entry import MapEntry
from plc_inspect.messages.markers import mark_proximity
from plc_inspect.messages.poses import StampedPose
from plc_inspect.messages.rows import make_proximity
from plc_inspect.ros.graph.qos import overridable, PROXIMITY, watched
from plc_inspect.ros.results.markers import add_deletions, make_marker, MarkerKey
from plc_inspect.ros.results.result_messages import make_cloud
from plc_inspect.stream.nearness import Nearness, tell_nearness

LEAST_PERIOD_NS = 18_000_000
"""Poses that come faster are not all answered [ns]: about 50 Hz."""
MARKER_PERIOD_NS = 200_000_000
"""Marks are drawn no more often [ns]."""
NOTHING = Surroundings()
"""What is known before the first tick."""


class KeepOut:
    """
    Publishes ``~/proximity`` and ``~/proximity_markers``.

    Parameters
    ----------
    node : Node
        Owns the publishers.
    look : callable
        Returns what was found last, None before the first tick, and the settings that hold.
    share : callable
        Gets what the thin link is to tell: how near the vehicle is, and its heading [rad].

    """

    def __init__(
        self, node: Node, look: Callable[[], tuple[LiveState | None, Settings]],
        share: Callable[[tuple[Nearness, ...], float], object],
    ) -> None:
        self._look, self._share = look, share
        self._motion = Motion()
        self._levels = HeldLevels()
        self._rows = node.create_publisher(
            PointCloud2, '~/proximity', **overridable(PROXIMITY), **watched(node, 'proximity')
        )
        self._marks = node.create_publisher(
            MarkerArray, '~/proximity_markers', **overridable(PROXIMITY),
            **watched(node, 'proximity_markers'),
        )
        self._told = self._drawn = 0
        self._knows = False
        self._seen: set[MarkerKey] = set()

    def tell(
        self, pose: StampedPose, move: RigidMove | None, entry: MapEntry, late: bool = False
    ) -> None:
        """
        Tell how near the vehicle is at a pose; a map that is not sharp is taken as unseen.

        Levels rise at once and fall late.

        Parameters
        ----------
        pose : StampedPose
            Of the vehicle.
        move : RigidMove or None
            From its frame into that of the map; None where nobody knows the vehicle's place:
            then all is unknown, and only the levels stand for a while.
        entry : MapEntry
            The map, and what came into it last.
        late : bool
            Newer poses wait: only the motion is taken, as telling costs more than all else.

        """
        told = np.array(pose.position, dtype=np.float64)
        vehicle = np.full(3, np.nan) if move is None else move.apply(told)
        state, settings = self._look()
        if state is None and self._knows:  # the map has begun anew, in another frame
            self._motion, self._levels = Motion(), HeldLevels()
        self._knows = state is not None
        if move is not None:
            self._motion.add(pose.stamp_ns, vehicle)
        if late or 0 <= pose.stamp_ns - self._told < LEAST_PERIOD_NS:
            return
        self._told = pose.stamp_ns
        blurred = state is None or state.sharpness.poor
        around = NOTHING if state is None or blurred or move is None else state.around
        limits = settings.proximity
        seen = not blurred and around.is_seen(
            entry.map.cells, vehicle, max(limits.warning, limits.critical), settings.height.beta
        )
        velocity = self._motion.velocity
        fresh = entry.near.find(
            vehicle, limits.critical, entry.map.cells,
            0 if state is None or blurred else state.sequence,  # no tick counts
            (NOTHING if state is None else state.around).may_hold_ground(velocity),
        )
        found = self._levels.hold(
            measure_proximity(around, seen, vehicle, velocity, limits, fresh),
            pose.stamp_ns, vehicle, limits,
        )
        if move is not None:
            back = move.inverse()
            found = tuple(replace(item, position=back.apply(item.position)) for item in found)
        seconds, nanoseconds = divmod(pose.stamp_ns, 1_000_000_000)
        header = Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=pose.frame_id)
        place = told[0], told[1], told[2]
        self._rows.publish(make_cloud(header, make_proximity(found, place)))
        self._share(
            tell_nearness(found, place, settings.proximity.critical),
            find_heading(pose.quaternion),
        )
        if 0 <= pose.stamp_ns - self._drawn < MARKER_PERIOD_NS:
            return
        self._drawn = pose.stamp_ns
        marks = [make_marker(header, mark) for mark in mark_proximity(found, place)]
        message, self._seen = add_deletions(header, marks, self._seen)
        if message.markers:
            self._marks.publish(message)
