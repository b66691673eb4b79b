# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_survey``: the pipeline over one cloud, or over a grid of them."""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import Future
import importlib
from pathlib import Path
from threading import Thread
import time
from typing import TYPE_CHECKING, TypeVar

from plc_inspect.errors import DataError
from plc_inspect.offline.commands.allocator import keep_freed_memory
from plc_inspect.offline.commands.command_line import (
    DONE,
    make_parser,
    Progress,
    run_command,
    show_progress,
)
from plc_inspect.offline.commands.grid import (
    add_grid_arguments,
    check_grid_arguments,
    is_grid,
    run_grid,
)
from plc_inspect.offline.readers.plausibility import parse_unit
from plc_inspect.printable import decode_name, make_one_line, make_printable

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.core.hazards.clearance_rules import RuleSet
    from plc_inspect.offline.readers.clouds import Cloud
    from plc_inspect.offline.records.inspection import Inspection

T = TypeVar('T')

NAME = 'plc_survey'
LARGE = 10_000_000
"""Size of a file from which reading takes longer than loading the modules [bytes]."""
LARGEST_UNASKED = 100_000_000
"""Size of a file that always fits in memory [bytes]."""
BASE_BYTES, BYTES_PER_POINT = 400_000_000, 150
"""
Memory of one run, and for each point [bytes].
Source: bench/grid/throughput.py: 1.69 GB for 8 million points.
"""
FILES = 'plc_inspect.offline.export.files'
"""Loads all formats."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def survey(
    path: Path,
    settings: 'Settings',
    crs: str | None = None,
    progress: Progress | None = None,
    rules: 'RuleSet | None' = None,
    reading: 'Future[Cloud] | None' = None,
) -> 'Inspection':
    """
    Run the pipeline over one cloud.

    Parameters
    ----------
    path : Path
        A cloud, see `read_cloud`.
    settings : Settings
        All settings.
    crs : str or None
        Coordinate reference system instead of the file's, such as ``EPSG:2992``.
    progress : callable or None
        Called with the name of the step and its share.
    rules : RuleSet or None
        Clearance rules, by default the plain ones of the settings.
    reading : Future or None
        From ``begin_reading``, where that was called before.

    Returns
    -------
    The run, ready to be written.

    Raises
    ------
    DataError
        The file cannot be read, or has fewer finite points than ``segment.min_points``.
    ConfigError
        The CRS is unknown.

    """
    from plc_inspect.core.pipeline import Pipeline
    from plc_inspect.core.setup.plumb import find_lean, measure_leans
    from plc_inspect.offline.commands.request import hash_input
    from plc_inspect.offline.export.points_file import describe_replaced
    from plc_inspect.offline.records.inspection import Inspection
    from plc_inspect.offline.records.units import Units

    tell = progress or (lambda step, share: None)
    started = time.perf_counter()
    tell('reading', 0.0)
    reading = reading or begin_reading(path, crs)
    checksum = _begin(lambda: hash_input(path))
    if path.is_file() and path.stat().st_size > LARGE:
        _load(settings)
        # the formats, while the pipeline releases the GIL
        Thread(target=importlib.import_module, args=(FILES,), daemon=True).start()
    else:  # nothing else to do meanwhile
        importlib.import_module(FILES)
    cloud = reading.result()
    num_points = len(cloud.points)
    num_finite = num_points - cloud.num_not_finite - cloud.num_withheld
    if num_finite < settings.segment.min_points:
        raise DataError(
            f'{path} has {num_finite} finite points of {num_points}'
            f'{f" ({cloud.num_withheld} are withheld)" if cloud.num_withheld else ""}, fewer than'
            f' segment.min_points = {settings.segment.min_points}'
        )
    seconds = {'read': time.perf_counter() - started}
    started = time.perf_counter()
    result = Pipeline(settings, rules).run(cloud.points, progress=tell)
    lean = find_lean(measure_leans(cloud.points, result)).describe()
    seconds['pipeline'] = time.perf_counter() - started
    horizontal, vertical = cloud.metres_per_unit
    replaced = describe_replaced(path.name, cloud.las.header) if cloud.las is not None else ''
    return Inspection(
        result=result,
        points=cloud.points,
        settings=settings,
        source=decode_name(path.name),
        command=NAME,
        crs=cloud.crs,
        units=Units(horizontal=horizontal, vertical=vertical),
        las=cloud.las,
        rules=rules,
        checksum=checksum.result(),
        counts={
            'num_points': num_points, 'num_not_finite': cloud.num_not_finite,
            'num_withheld': cloud.num_withheld,
            **({'replaced': replaced} if replaced else {}),
            **({'lean': f'{lean}: check that z is up'} if lean else {}),
        },
        seconds=seconds,
    )


def begin_reading(
    path: Path, crs: str | None = None, unit: float | None = None
) -> 'Future[Cloud]':
    """
    Start reading a cloud in a thread of its own.

    Parameters
    ----------
    path : Path
        A cloud, see `read_cloud`.
    crs : str or None
        Coordinate reference system instead of the file's.
    unit : float or None
        Metres in one unit, where there is no such system.

    Returns
    -------
    Future
        Of what ``read_cloud`` returns or raises.

    """
    from plc_inspect.offline.readers.clouds import read_cloud

    return _begin(lambda: read_cloud(path, crs, unit))


def _begin(call: Callable[[], T]) -> 'Future[T]':
    """Call in a thread of its own, a daemon: not waited for if the request is invalid."""
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(call())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future


def check_memory(path: Path) -> None:
    """
    Raise DataError if a large file does not fit in memory in one run.

    Only its header is read; errors in the file are reported when it is read.
    """
    if not path.is_file() or path.stat().st_size < LARGEST_UNASKED:
        return
    from plc_inspect.grid.engine import measure_available
    from plc_inspect.offline.readers.clouds import count_points

    try:
        num_points = count_points(path)
    except (DataError, OSError):  # reported when the file is read
        return
    free, needed = measure_available(), BASE_BYTES + BYTES_PER_POINT * num_points
    if needed > free:
        raise DataError(
            f'{path} holds {num_points:,} points: one run over all of them takes'
            f' {needed / 1e9:.1f} GB of memory, {free / 1e9:.1f} GB are free: survey it in tiles,'
            f' as with --memory {max(0.8 * free / 1e9, 1.0):.1f}'
        )


def _load(settings: 'Settings') -> None:
    """Load the kernels."""
    from plc_inspect.core.live.warm_up import warm_up_pipeline

    warm_up_pipeline(settings)


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parse(argv)
    has_tiles = is_grid(arguments)
    keep_freed_memory(of_any_size=has_tiles)
    if has_tiles:
        return _run_grid(arguments)
    cloud = Path(arguments.clouds[0])
    check_memory(cloud)
    reading = begin_reading(cloud, arguments.crs, parse_unit(arguments.units))
    from plc_inspect.offline.commands.request import deliver, read_request
    from plc_inspect.offline.export.results_folder import check_results
    from plc_inspect.offline.readers.parameter_file import read_settings
    from plc_inspect.offline.terminal.result_table import render_summary

    settings = read_settings(arguments.params, arguments.assignments)
    request, settings = read_request(arguments, settings)
    check_results(arguments.output, arguments.force, [cloud])
    with show_progress(arguments.quiet) as progress:
        inspection = survey(
            cloud, settings, arguments.crs, progress, request.rules, reading
        )
        inspection = deliver(inspection, request, arguments, progress)
    if not arguments.quiet:
        from plc_inspect.offline.export.points_file import describe_steps

        print(make_printable(render_summary(inspection)))
        notes = (
            reading.result().note, inspection.counts.get('replaced', ''),
            describe_steps(inspection),
        )
        for note in filter(None, notes):
            print('\n' + make_one_line(f'note: {note}'))
        print(make_printable(f'\nreport: {arguments.output / "report.html"}'))
    return DONE


def _run_grid(arguments: argparse.Namespace) -> int:
    from plc_inspect.offline.commands.request import read_request
    from plc_inspect.offline.readers.parameter_file import read_settings

    check_grid_arguments(arguments)
    settings = read_settings(arguments.params, arguments.assignments)
    request, settings = read_request(arguments, settings)
    return run_grid(arguments, settings, request.rules, request.baseline)


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser(NAME, 'Finds power lines and their hazards in clouds.')
    parser.add_argument(
        'clouds', nargs='+', metavar='CLOUD',
        help='a LAS, LAZ, COPC, PCD, E57, PLY, XYZ or CSV file; more of them, folders, patterns'
        ' or a tile index are a grid',
    )
    parser.add_argument(
        '--crs', help='coordinate reference system instead of the one in the file, as EPSG:2992'
    )
    parser.add_argument(
        '--units', metavar='UNIT', help='m, ft or us-ft, where no such system is known'
    )
    add_grid_arguments(parser)
    return parser.parse_args(argv)
