# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_replay``: the pipeline over a recording, without a ROS graph."""

import argparse
from collections.abc import Sequence
import dataclasses
from pathlib import Path

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.command_line import (
    DONE,
    make_parser,
    run_command,
    show_progress,
)
from plc_inspect.offline.commands.flight_run import NAME, replay
from plc_inspect.offline.commands.flights import are_many, check_flights, run_flights
from plc_inspect.printable import make_printable


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parse(argv)
    from plc_inspect.offline.commands.request import deliver, locate_flight, read_request
    from plc_inspect.offline.export.results_folder import check_results
    from plc_inspect.offline.readers.parameter_file import read_settings
    from plc_inspect.offline.terminal.losses import describe_losses
    from plc_inspect.offline.terminal.result_table import render_summary
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
