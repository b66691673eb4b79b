# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Decides whether a restarted node resumes the record that it finds, and if not, why."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
import time
from typing import Any

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.setup.mount import Mount
from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import list_segments, SUFFIX
from plc_inspect.flight_record.reader import find_end, Flight, read_flight
from plc_inspect.results import Float64
from plc_inspect.setting_names import to_mapping

MOST_AWAY = 600.0
"""
Longest interruption of a flight that is resumed [s].
Source: judgement: batteries are changed in less; not measured.
"""
MOST_SPEED = 25.0
"""
Greatest speed of the vehicle during the interruption [m/s].
Source: judgement: above that of multirotors; not measured.
"""
ROOM = 20.0
"""Distance allowed in addition [m].  Source: judgement; not measured."""
ORIGIN = 3.0
"""
Distance from its origin within which odometry counts as restarted [m].
Source: judgement: what a vehicle moves until the node hears of it; not measured.
"""
FAR = 5 * ORIGIN
"""
A vehicle last seen farther than this from the origin is not there by chance [m].
Source: judgement.
"""

WHAT_MATTERS = (
    ('input', 'scan_topic'), ('input', 'odometry_topic'), ('input', 'odometry_type'),
    ('input', 'use_tf'), ('input', 'map_frame'), ('input', 'base_frame'), ('input', 'lidar_xyz'),
    ('input', 'lidar_rpy_deg'), ('map', 'voxel_size'), ('map', 'max_voxels'),
)
"""Settings that must equal those of the map; all others may differ."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """A record found at the start."""

    folder: Path
    flight: Flight | None
    """Its content, if the node may resume it."""
    reason: str = ''
    """Why the node may not resume it."""
    over: bool = False
    """Its flight was saved or received nothing, so nothing is lost."""


def name_record(results: Path) -> Path:
    """Return the path of the record of a results folder, which lies beside it."""
    return results.with_name(results.name + SUFFIX)


def find_newest(home: Path) -> Path | None:
    """Return the newest record in a folder, None if there is none."""
    try:
        times = {
            max(path.stat().st_mtime for path in segments): item
            for item in home.glob('*' + SUFFIX) if (segments := list_segments(item))
        }
    except OSError:
        return None
    return times[max(times)] if times else None


def look_at(folder: Path, settings: Settings) -> Found:
    """
    Examine whether this start of the node resumes the flight of a record.

    Parameters
    ----------
    folder : Path
        A record.
    settings : Settings
        Present settings of the node.

    Returns
    -------
    Found

    """
    if find_end(folder):
        return Found(folder=folder, flight=None, reason='its flight was saved', over=True)
    try:
        flight = read_flight(folder)
    except DataError as error:
        return Found(folder=folder, flight=None, reason=str(error))
    if flight.state.get('closed'):  # what ends the record was cut off by a power cut
        return Found(folder=folder, flight=None, reason='its flight was saved', over=True)
    if not len(flight.map.keys) or not flight.state.get('frames'):
        return Found(folder=folder, flight=None, reason='nothing came in', over=True)
    reason = _find_difference(flight, settings)
    return Found(folder=folder, flight=None if reason else flight, reason=reason)


def _find_difference(flight: Flight, settings: Settings) -> str:
    state, before, now = flight.state, flight.header.get('settings'), to_mapping(settings)
    if not isinstance(before, dict) or not isinstance(state.get('time'), int | float):
        return 'it lacks settings or times'
    away = time.time() - state['time']
    if not -MOST_AWAY <= away <= MOST_AWAY:
        return f'it ended {away:.0f} s ago, a flight goes on within {MOST_AWAY:g} s'
    for section, name in WHAT_MATTERS:
        old, new = before.get(section, {}).get(name), now[section][name]
        if old != new:
            return f'{section}.{name} was {old!r} and is {new!r}'
    return ''


def read_mount(state: Mapping[str, Any]) -> Mount | None:
    """
    Return the mount of the lidar for the scans in the map of a record.

    Parameters
    ----------
    state : mapping
        Of the record.

    Returns
    -------
    Mount or None
        None if the map held no scan.

    Raises
    ------
    DataError
        The stored mount is not a transform.

    """
    rows = state.get('mount')
    if rows is None:
        return None
    transform = np.array(rows, dtype=np.float64)
    if transform.shape != (4, 4) or not np.isfinite(transform).all():
        raise DataError(f'the mount of the record is not a transform: {rows}')
    return Mount(transform, 'the flight record')


def judge_pose(
    state: Mapping[str, Any], frames: tuple[str, str], stamp_ns: int, position: Float64
) -> str:
    """
    Return why odometry cannot continue that of a record, '' if it can.

    Parameters
    ----------
    state : mapping
        Of the record.
    frames : tuple of str
        Frame of the odometry, and of the base.
    stamp_ns : int
        Time of the first pose [ns].
    position : Float64
        (3,) its place [m].

    Returns
    -------
    str

    """
    known = tuple(state['frames'])
    if frames != known:
        return f'the frames are {" and ".join(frames)}, and were {" and ".join(known)}'
    last, place = state.get('pose_stamp_ns'), state.get('vehicle')
    if last is None or place is None:
        return 'the record has no pose'
    seconds = (stamp_ns - last) * 1e-9
    if not 0.0 <= seconds <= MOST_AWAY:
        return f'the odometry is {seconds:.0f} s after the last one in the record'
    apart = math.dist(place, position)
    if not apart <= ROOM + MOST_SPEED * seconds:  # NaN is no place
        return f'the vehicle is {apart:.0f} m from where it was {seconds:.1f} s before'
    near, was = math.hypot(*position), math.hypot(*place)
    if near <= ORIGIN and was >= FAR:
        return f'the odometry began anew at its origin, {was:.0f} m from where the vehicle was'
    return ''
