# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explains in one sentence, with numbers, why nothing is inserted into the map."""

from collections.abc import Mapping

from plc_inspect.config import InputSettings
from plc_inspect.core.mapping.scan_counters import Counters, DropReason

MOST_LEAD = 0.5
"""
Least difference of the clocks of scans and odometry that is named as the cause [s].
Source: judgement: several times the delay of a driver; not measured.
"""
MOST_LATE = 10.0
"""
Greatest time by which poses may simply come late [s].
Source: judgement: an odometry that works through a queue; not measured.
"""
OTHER_EPOCH = 3.2e7
"""
Difference of the clocks from which one of them does not count from 1970 [s].
Source: derived: a year, as LEAST_DATE_NS of messages/scans.
"""
_NO_POSE = (
    DropReason.WAITED_TOO_LONG.value, DropReason.NO_POSE_BEFORE.value,
    DropReason.NO_POSE_AFTER.value,
)


def explain_standstill(
    now: Counters, before: Counters | None, malformed: Mapping[str, str], settings: InputSettings
) -> str:
    """
    Explain why no point was inserted into the map.

    Parameters
    ----------
    now : Counters
        Counters now.
    before : Counters or None
        Counters when a point was last inserted; None: since the start.
    malformed : mapping
        Messages that could not be used since, 'scan' or 'odometry' to the newest reason; 'poses'
        to why their source gives none.
    settings : InputSettings
        Ranges, and the longest gap between poses.

    Returns
    -------
    str
        The cause that affects most scans.

    """
    dropped = _grown(now.scans_dropped, before.scans_dropped if before else {})
    rejected = _grown(now.poses_rejected, before.poses_rejected if before else {})
    num_scans = now.num_scans - (before.num_scans if before else 0)
    num_poses = now.num_poses - (before.num_poses if before else 0) - sum(rejected.values())
    if not num_scans:
        return (
            f'all scans are malformed: {malformed["scan"]}' if 'scan' in malformed
            else 'no scan came in'
        )
    if not num_poses:
        if rejected:
            return f'all poses are rejected: {max(rejected, key=lambda name: rejected[name])}'
        if 'poses' in malformed:
            return malformed['poses']
        return (
            f'all poses are malformed: {malformed["odometry"]}' if 'odometry' in malformed
            else 'no odometry came in'
        )
    if not dropped:
        if now.num_scans_waiting:
            return _compare_clocks(now) or f'{now.num_scans_waiting} scans wait for odometry'
        return _explain_points(_grown(
            now.points_dropped, before.points_dropped if before else {}
        ), settings)
    reason = max(dropped, key=lambda name: dropped[name])
    if reason in _NO_POSE and (text := _compare_clocks(now)):
        return text
    period = now.pose_period
    if period is not None and period > settings.max_pose_gap:
        return (
            f'odometry comes every {period:.2f} s; over more than {settings.max_pose_gap:g} s '
            '(input.max_pose_gap) nothing is interpolated'
        )
    return f'scans dropped: {reason}'


def _explain_points(dropped: Mapping[str, int], settings: InputSettings) -> str:
    """Explain why no point of the scans that were taken is in the map."""
    if 'map full' in dropped:
        return 'the map is full, and refuses all points (map.max_voxels)'
    if 'too near' in dropped or 'too far' in dropped:
        return (
            f'no point of the scans lies between {settings.min_range:g} and '
            f'{settings.max_range:g} m (input.min_range, input.max_range)'
        )
    if 'not finite' in dropped:
        return 'no point of the scans has finite coordinates and a finite time'
    return 'the scans hold no points'


def _compare_clocks(counters: Counters) -> str:
    lead = counters.stamp_lead
    if lead is None or abs(lead) <= MOST_LEAD:
        return ''
    if abs(lead) > OTHER_EPOCH:
        early = 'scans' if lead < 0 else 'odometry'
        return (
            f'the stamps of {early} count from a start, such as power-on: they are '
            f'{abs(lead):.1f} s behind the others; set both by one clock'
        )
    side = 'ahead of' if lead > 0 else 'behind'
    late = ', or the odometry comes late' if 0 < lead < MOST_LATE else ''
    return f'scan stamps are {abs(lead):.1f} s {side} odometry: set both by one clock{late}'


def _grown(now: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    return {
        name: count - before.get(name, 0) for name, count in now.items()
        if count > before.get(name, 0)
    }
