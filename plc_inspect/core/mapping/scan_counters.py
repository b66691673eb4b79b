# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Counts of what came in, and of what was dropped, by reason."""

from collections import Counter
from dataclasses import dataclass, fields
import enum
from typing import Any


class DropReason(enum.Enum):
    """Why a scan did not go into the map."""

    NO_POSE_BEFORE = 'no pose before it'
    NO_POSE_AFTER = 'no pose after it when the recording ended'
    POSE_GAP = 'gap in the odometry'
    POSE_JUMP = 'jump of the odometry'
    WAITED_TOO_LONG = 'waited too long for odometry'
    QUEUE_FULL = 'too many scans waiting for odometry'
    WRONG_FRAME = 'another frame than the scans before'
    OTHER_LAYOUT = 'x, y, z in another order than before'
    OVERLAP = 'of the same time as another: two drivers on one topic?'
    OTHER_DRIVER = 'of a second driver on the topic'
    OTHER_MOUNT = 'before the mount of the map that goes on was known'
    OUT_OF_MAP = 'points too far away for the map'
    RESET = 'waiting when the buffers were reset'


@dataclass(frozen=True, slots=True, kw_only=True)
class Counters:
    """Counts since the start."""

    num_scans: int
    num_scans_inserted: int
    num_scans_waiting: int
    scans_dropped: dict[str, int]
    """DropReason value to count."""
    num_scans_lost: int
    """Scans missing between header stamps, judged by the median period."""
    num_interruptions: int
    """Pauses between scans that are too long to be lost scans."""
    num_scans_without_time: int
    """Scans whose points have no times: deskewed between scans, not within."""
    scan_period: float | None
    """Median time between scans [s], None while unknown."""
    num_points: int
    """Points received, those that are not finite included."""
    num_points_inserted: int
    points_dropped: dict[str, int]
    """'not finite', 'too near', 'too far', 'map full' to count, without those of dropped scans."""
    num_poses: int
    poses_rejected: dict[str, int]
    """PoseStatus value, or 'another frame', to count."""
    num_pose_gaps: int
    num_pose_jumps: int
    num_pose_restarts: int
    num_map_restarts: int
    """Times the map began anew: out of its reach, or with another mount of the lidar."""
    stamp_lead: float | None
    """Median time by which scans are ahead of the newest pose on arrival [s], None unknown."""
    pose_period: float | None
    """Median time between poses [s], None while unknown."""

    def add(self, before: 'Counters') -> 'Counters':
        """Return the counts of both; what is no count, and what waits, is of this one."""
        own: dict[str, Any] = {}
        for item in fields(self):
            value, other = getattr(self, item.name), getattr(before, item.name)
            if isinstance(value, dict):
                own[item.name] = dict(Counter(other) + Counter(value))
            elif isinstance(value, int) and item.name != 'num_scans_waiting':
                own[item.name] = value + other
            else:
                own[item.name] = value
        return Counters(**own)
