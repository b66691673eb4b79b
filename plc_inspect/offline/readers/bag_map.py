# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The map of a whole recording."""

from collections.abc import Callable
import dataclasses
from dataclasses import dataclass

import numpy as np

from plc_inspect.config import MOST_VOXELS, Settings
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.mapping.flown_way import FlownWay
from plc_inspect.core.mapping.standstill import explain_standstill
from plc_inspect.core.setup.sharpness import Sharpness, SharpnessBook
from plc_inspect.errors import DataError
from plc_inspect.messages.poses import StampedPose
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.results import Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndedMap:
    """A map that ended in flight and was right, as where what followed did not fit to it."""

    points: Float64
    """(N, 3) centroids, in the frame of the odometry when it began [m]."""
    cause: str
    """Why it ended."""
    sharpness: Sharpness
    way: Float64
    """(K, 4) time [s] and position [m] of the vehicle up to then."""


def accumulate(
    recording: Recording,
    settings: Settings,
    progress: Callable[[float], None] | None = None,
    book: SharpnessBook | None = None,
    way: FlownWay | None = None,
    ended: list[EndedMap] | None = None,
) -> Accumulator:
    """
    Insert all scans of a recording into a map, as the node would have done in flight.

    Scans wait for odometry by the clock of the recording.  Malformed scans are counted in
    ``recording.skipped``, like messages that cannot be read.

    Parameters
    ----------
    recording : Recording
        An open recording.
    settings : Settings
        ``input`` and ``map`` are used; ``map.max_voxels`` does not limit a replay.
    progress : callable or None
        Called with the share read, 0 to 1, after each scan and at the end.
    book : SharpnessBook or None
        Collects the sharpness of the map.
    way : FlownWay or None
        Collects the path of the vehicle.
    ended : list or None
        Takes maps that end before the recording does; ``book`` and ``way`` then begin anew.

    Returns
    -------
    Accumulator
        Finished: no scan is waiting.

    Raises
    ------
    DataError
        The recording is damaged.

    """
    room = dataclasses.replace(settings.map, max_voxels=MOST_VOXELS)
    accumulator = Accumulator(dataclasses.replace(settings, map=room), recorded=True)
    if ended is not None and book is not None and way is not None:
        accumulator.entry.on_end = lambda cause: ended.append(
            _end_map(accumulator, settings, book, way, cause)
        )
    for item in recording.fixed_transforms:
        accumulator.placer.add_frame(item)
    for message in recording:
        content, now = message.content, message.log_stamp_ns * 1e-9
        if isinstance(content, StampedPose):
            taken = accumulator.add_pose(
                content.stamp_ns,
                content.position,
                content.quaternion,
                frame_id=content.frame_id,
                child_frame_id=content.child_frame_id,
                now=now,
            )
            if taken and way is not None:
                place = np.array(content.position, dtype=np.float64)
                way.add(content.stamp_ns, accumulator.follower.move.apply(place))
            continue
        try:
            accumulator.add_scan(
                content.stamp_ns,
                content.xyz,
                content.time,
                frame_id=content.frame_id,
                num_not_finite=content.num_not_finite,
                layout=content.layout,
                now=now,
            )
        except DataError as error:
            recording.skip('scan', 'scans: malformed', error)
        if book is not None:
            book.add(accumulator.entry.meter.take())
        if progress is not None:
            progress(recording.progress)
    accumulator.finish()
    if progress is not None:
        progress(1.0)
    return accumulator


def list_centroids(accumulator: Accumulator, settings: Settings) -> Float64:
    """Return the (N, 3) centroids of the voxels with points enough [m]."""
    known = accumulator.map.counts() >= settings.map.min_points
    return accumulator.map.centroids()[known]


def _end_map(
    accumulator: Accumulator, settings: Settings, book: SharpnessBook, way: FlownWay, cause: str
) -> EndedMap:
    book.add(accumulator.entry.meter.take())
    found = EndedMap(
        points=list_centroids(accumulator, settings), cause=cause, sharpness=book.judge(),
        way=way.places,
    )
    book.clear()
    way.clear()
    return found


def check_used(recording: Recording, accumulator: Accumulator, settings: Settings) -> None:
    """
    Refuse a recording without a point in the map.

    Parameters
    ----------
    recording : Recording
        The recording that was read.
    accumulator : Accumulator
        As from ``accumulate``.
    settings : Settings
        ``input`` is used.

    Raises
    ------
    DataError
        No scan could be used; the message says why.

    """
    counters = accumulator.counters()
    if not counters.num_points_inserted:
        malformed = {'poses': recording.problem} if recording.problem else {}
        cause = explain_standstill(
            counters, None, malformed | recording.malformed, settings.input
        )
        raise DataError(f'{recording.path}: no scan could be used: {cause}')
