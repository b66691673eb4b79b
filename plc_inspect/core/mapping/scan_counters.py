# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Counters of scans, points and poses that came in or were dropped, by reason."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, fields
import enum
from typing import Any

from plc_inspect.core.mapping.pose_buffer import PoseBuffer, PoseStatus
from plc_inspect.core.mapping.scan_clock import ScanClock


class DropReason(enum.Enum):
    """Why a scan did not go into the map."""

    NO_POSE_BEFORE = 'no pose before it'
    NO_POSE_AFTER = 'no pose after it when the recording ended'
    POSE_GAP = 'gap in the odometry'
    POSE_JUMP = 'jump of the odometry'
    POSE_FROZEN = 'odometry stands still while the vehicle moves'
    WAITED_TOO_LONG = 'waited too long for odometry'
    QUEUE_FULL = 'too many scans waiting for odometry'
    WRONG_FRAME = 'another frame than the scans before'
    OTHER_LAYOUT = 'x, y, z in another order than before'
    NO_TIMES = 'without times of its points, which scans before had'
    OVERLAP = 'of the same time as another: two drivers on one topic?'
    DISPROVED = 'disproved by scans after it: is its stamp wrong, or a second driver there?'
    SET_BACK = 'earlier than all before: was the clock set back?'
    OTHER_DRIVER = 'of a second driver on the topic'
    OTHER_MOUNT = 'before the mount of the map that goes on was known'
    OUT_OF_MAP = 'points too far away for the map'
    RESET = 'waiting when the buffers were reset'
    BEGUN_ANEW = 'waiting when the odometry, the map or the buffers began anew'


@dataclass(frozen=True, slots=True, kw_only=True)
class Counters:
    """Counts since the start."""

    num_scans: int
    num_scans_inserted: int
    num_scans_waiting: int
    scans_dropped: dict[str, int]
    """DropReason value to count."""
    num_scans_lost: int
    """Scans missing between header stamps, by the median period."""
    num_interruptions: int
    """Pauses between scans that are too long to be lost scans."""
    num_scans_without_time: int
    """Scans that need point times and have none: all their points are placed at the stamp."""
    scan_period: float | None
    """Median time between scans [s], None while unknown."""
    num_points: int
    """Points received, those that are not finite included."""
    num_points_inserted: int
    points_dropped: dict[str, int]
    """'not finite', 'too near', 'too far', 'map full' to count, other than of dropped scans."""
    num_poses: int
    poses_rejected: dict[str, int]
    """PoseStatus value, or 'another frame', to count."""
    num_pose_gaps: int
    num_pose_jumps: int
    num_pose_restarts: int
    num_map_restarts: int
    """Times the map began anew: out of its reach, or with another mount of the lidar."""
    stamp_lead: float | None
    """Median lead of scans over the newest pose on arrival [s], None while unknown."""
    pose_period: float | None
    """Median time between poses [s], None while unknown."""

    def add(self, before: 'Counters') -> 'Counters':
        """Return the sums of both; periods, lead and waiting scans are those of this one."""
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


def gather_counters(
    counts: Counter[str], dropped: Mapping[DropReason, int], poses: PoseBuffer, clock: ScanClock,
    num_waiting: int, num_map_restarts: int,
) -> Counters:
    """Return the counters since the start, from the parts of an accumulator."""
    of_poses = poses.counts
    rejected = {s.value: n for s, n in of_poses.items() if not s.accepted}
    if counts['poses of another frame']:
        rejected['another frame'] = counts['poses of another frame']
    causes = ('not finite', 'too near', 'too far', 'map full')
    return Counters(
        num_scans=counts['scans'],
        num_scans_inserted=counts['scans inserted'],
        num_scans_waiting=num_waiting,
        scans_dropped={reason.value: n for reason, n in dropped.items()},
        num_scans_lost=clock.num_lost,
        num_interruptions=clock.num_interruptions,
        num_scans_without_time=counts['scans without time'],
        scan_period=clock.period,
        num_points=counts['points'],
        num_points_inserted=counts['points inserted'],
        points_dropped={cause: counts[cause] for cause in causes if counts[cause]},
        num_poses=sum(of_poses.values()) + counts['poses of another frame'],
        poses_rejected=rejected,
        num_pose_gaps=poses.num_gaps,
        num_pose_jumps=poses.num_jumps,
        num_pose_restarts=of_poses.get(PoseStatus.RESTARTED, 0),
        num_map_restarts=num_map_restarts,
        stamp_lead=clock.lead,
        pose_period=poses.period,
    )
