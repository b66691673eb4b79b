# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs the pipeline over one recorded flight."""

import dataclasses
from dataclasses import asdict
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.command_line import Progress
from plc_inspect.printable import decode_name

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.core.hazards.clearance_rules import RuleSet
    from plc_inspect.core.setup.sharpness import Sharpness
    from plc_inspect.offline.records.inspection import Inspection
    from plc_inspect.results import Float64, InspectionResult

NAME = 'plc_replay'
"""Of the command that does it."""


def replay(
    path: Path,
    settings: 'Settings',
    progress: Progress | None = None,
    rules: 'RuleSet | None' = None,
) -> 'Inspection':
    """
    Build the map of a recording and run the pipeline over it.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, an MCAP or sqlite3 file, or a ROS 1 bag.
    settings : Settings
        All settings; the topics are in ``input``.
    progress : callable or None
        Called with the name of the step and its share.
    rules : RuleSet or None
        Clearance rules, by default the plain ones of the settings.

    Returns
    -------
    The run, ready to be written.  Its points are the centroids of the map's voxels, in the
    frame of the odometry.

    Raises
    ------
    DataError
        The recording cannot be read, lacks a topic, no scan of it can be used, or the map is so
        far from sharp that nothing can be found in it, or on its head.

    Notes
    -----
    Where the map is not sharp or upright, hazards are left out and ``counts['held_back']`` says
    so.  Where the map began anew, what was found in the one before is in ``earlier``.

    """
    from plc_inspect.core.alignment.moved_results import move_result
    from plc_inspect.core.mapping.flown_way import FlownWay
    from plc_inspect.core.setup.sharpness import SharpnessBook
    from plc_inspect.offline.commands.request import hash_input
    from plc_inspect.offline.readers.bag_map import (
        accumulate,
        check_used,
        EndedMap,
        list_centroids,
    )
    from plc_inspect.offline.readers.bags import Recording
    from plc_inspect.offline.records.inspection import Inspection

    tell = progress or (lambda step, share: None)
    topics = (settings.input.scan_topic, settings.input.odometry_topic)
    started = time.perf_counter()
    book, way = SharpnessBook(), FlownWay()
    ended: list[EndedMap] = []
    with Recording(path, *topics, settings.input) as recording:
        accumulator = accumulate(
            recording, settings, lambda share: tell('reading', share), book, way, ended
        )
        check_used(recording, accumulator, settings)
        counts = asdict(accumulator.counters())
        counts['skipped'] = dict(recording.skipped)
        counts['first_errors'] = dict(recording.first_errors)
        counts['mount'] = accumulator.placer.mount.describe()
        counts['mount_doubt'] = accumulator.placer.mount.doubt
        counts['parts'] = [part.record() for part in accumulator.follower.parts]
        move = accumulator.follower.move.inverse()
    points, flown = list_centroids(accumulator, settings), way.places
    sharpness = _judge_ground(points, flown, book.judge())
    if accumulator.doubt and not sharpness.useless:
        raise DataError(f'{path}: {accumulator.doubt}')
    if sharpness.hopeless:
        raise DataError(f'{path}: {sharpness.describe()}')
    seconds = {'read': time.perf_counter() - started}
    started = time.perf_counter()
    result, judged = _inspect(points, flown, sharpness, settings, rules, tell)
    known = Inspection(
        result=move_result(result, move),
        points=move.apply(points),
        settings=settings,
        source=decode_name(path.absolute().name),
        command=NAME,
        frame_id=accumulator.frame_id,
        rules=rules,
        checksum=hash_input(path),
        counts=counts | judged,
    )
    flown[:, 1:] = move.apply(flown[:, 1:])
    earlier = []
    for part in ended:
        sharp = _judge_ground(part.points, part.way, part.sharpness)
        if len(part.points) < settings.segment.min_points or sharp.hopeless:
            continue
        result, judged = _inspect(
            part.points, part.way, sharp, settings, rules, lambda step, share: None
        )
        earlier.append(dataclasses.replace(
            known, result=result, points=part.points, way=part.way,
            counts={'ended': part.cause, **judged},
        ))
    seconds['pipeline'] = time.perf_counter() - started
    return dataclasses.replace(known, way=flown, earlier=tuple(earlier), seconds=seconds)


def _judge_ground(points: 'Float64', way: 'Float64', sharpness: 'Sharpness') -> 'Sharpness':
    """Return how good a map is, by where the ground lies, too."""
    from plc_inspect.core.setup.plumb import PlumbBook

    plumb = PlumbBook()
    plumb.look(points, way[:, 1:])
    return plumb.judge(sharpness)


def _inspect(
    points: 'Float64', way: 'Float64', sharpness: 'Sharpness', settings: 'Settings',
    rules: 'RuleSet | None', tell: Progress,
) -> 'tuple[InspectionResult, dict[str, Any]]':
    """Return what is found in a map, without hazards where it is doubtful, and what tells that."""
    from plc_inspect.core.pipeline import Pipeline
    from plc_inspect.core.setup.plumb import measure_leans, PlumbBook

    result = Pipeline(settings, rules, way[:, 1:].copy()).run(points, progress=tell)
    plumb = PlumbBook()
    plumb.add(measure_leans(points, result))
    sharpness = plumb.judge(sharpness)
    if sharpness.poor:
        result = dataclasses.replace(result, hazards=())
    return result, {
        'sharpness': sharpness.record(),
        'held_back': sharpness.describe() if sharpness.poor else '',
        'lean': sharpness.remark,
    }
