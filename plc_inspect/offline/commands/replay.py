# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_replay``: the pipeline over a recording, without a ROS graph."""

import argparse
from collections.abc import Sequence
import dataclasses
from dataclasses import asdict
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.command_line import (
    DONE,
    make_parser,
    Progress,
    run_command,
    show_progress,
)
from plc_inspect.offline.commands.flights import are_many, check_flights, run_flights
from plc_inspect.printable import decode_name, make_printable

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.core.hazards.clearance_rules import RuleSet
    from plc_inspect.core.setup.sharpness import Sharpness
    from plc_inspect.offline.records.inspection import Inspection
    from plc_inspect.results import Float64, InspectionResult

NAME = 'plc_replay'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


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
            part.points, part.way, part.sharpness, settings, rules, lambda step, share: None
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


def describe_losses(inspection: 'Inspection') -> str:
    """Return a text about the input missing in the map, or not proven, '' if nothing is."""
    from plc_inspect.core.extraction.dust import describe_air
    from plc_inspect.core.setup.sharpness import ON_TRUST
    from plc_inspect.offline.export.results_folder import BEFORE

    counts = inspection.counts
    parts = [counts['mount_doubt']] if counts.get('mount_doubt') else []
    parts += [part['text'] for part in counts.get('parts', [])]
    if inspection.result.hazards and not counts['sharpness']['known']:
        parts.append(ON_TRUST)
    if dust := describe_air(inspection.result.stages):
        parts.append(dust)
    for title, key in (
        ('scans dropped', 'scans_dropped'),
        ('poses rejected', 'poses_rejected'),
        ('messages skipped', 'skipped'),
    ):
        reasons = ', '.join(f'{number} {reason}' for reason, number in counts[key].items())
        if reasons:
            parts.append(f'{title}: {reasons}')
    if counts['num_map_restarts']:
        num = len(inspection.earlier)
        names = ', '.join(BEFORE.format(number) for number in range(1, num + 1))
        parts.append(
            f'the map was begun anew {counts["num_map_restarts"]} times: what was flown before is '
            + (f'in {names}, in the results folder' if num else 'not in the results')
        )
    if counts['num_scans_lost']:
        parts.append(f'scans missing in the recording: {counts["num_scans_lost"]}')
    return '\n'.join(parts)


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parse(argv)
    from plc_inspect.offline.commands.request import deliver, locate_flight, read_request
    from plc_inspect.offline.commands.result_table import render_summary
    from plc_inspect.offline.export.results_folder import check_results
    from plc_inspect.offline.readers.parameter_file import read_settings
    from plc_inspect.setting_names import update

    settings = read_settings(arguments.params, arguments.assignments)
    topics = {
        'input.scan_topic': arguments.scan_topic,
        'input.odometry_topic': arguments.odometry_topic,
    }
    settings = update(settings, {name: topic for name, topic in topics.items() if topic})
    request, settings = read_request(arguments, settings)
    if are_many(arguments):
        check_flights(arguments)
        return run_flights(arguments, settings, request)
    bag, origin = Path(arguments.bags[0]), locate_flight(arguments.origin)
    check_results(arguments.output, arguments.force, [bag])
    with show_progress(arguments.quiet) as progress:
        inspection = replay(bag, settings, progress, request.rules)
        inspection = dataclasses.replace(inspection, **origin, earlier=tuple(
            dataclasses.replace(part, **origin) for part in inspection.earlier
        ))
        inspection = deliver(inspection, request, arguments, progress)
    if not arguments.quiet:
        parts = [render_summary(inspection), describe_losses(inspection)]
        print(make_printable('\n\n'.join(part for part in parts if part)))
        print(make_printable(f'\nreport: {arguments.output / "report.html"}'))
    if inspection.counts['held_back']:
        raise DataError(f'{bag}: {inspection.counts["held_back"]}')
    return DONE


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser(NAME, 'Finds power lines and their hazards in a recorded flight.')
    parser.add_argument(
        'bags', nargs='+', metavar='BAG',
        help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag file; more of them, folders and patterns'
        ' are flights, each by itself',
    )
    parser.add_argument('--scan-topic', metavar='TOPIC', help='instead of input.scan_topic')
    parser.add_argument(
        '--odometry-topic', metavar='TOPIC', help='instead of input.odometry_topic'
    )
    parser.add_argument(
        '--origin', metavar='LAT,LON,ALT',
        help='WGS 84 place of the origin of the odometry (x east, y north)',
    )
    group = parser.add_argument_group('flights', 'for many recordings; see docs/grid.md')
    engine = group.add_mutually_exclusive_group()
    engine.add_argument(
        '--workers', type=int, metavar='N',
        help='processes that replay flights, a core each (default: as many as pay)',
    )
    engine.add_argument(
        '--scheduler', metavar='ADDRESS', help='Dask scheduler, as tcp://host:8786, or its file'
    )
    group.add_argument('--memory', type=float, metavar='GB', help='memory of each worker')
    return parser.parse_args(argv)
