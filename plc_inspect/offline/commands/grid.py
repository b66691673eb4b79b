# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The grid of ``plc_survey``: many inputs, or one that is divided."""

import argparse
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
import glob
import math
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from plc_inspect.offline.commands.command_line import BAD_INPUT, DEFECT, DONE, show_progress
from plc_inspect.offline.readers.plausibility import parse_unit
from plc_inspect.printable import make_one_line, make_printable

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.core.hazards.clearance_rules import RuleSet
    from plc_inspect.grid.engine import Engine
    from plc_inspect.grid.grid_summary import GridSummary
    from plc_inspect.offline.records.changes import Survey

GIGABYTE = 1e9
LEAST, MOST = {'workers': 1, 'memory': 0.1, 'tile': 1.0, 'halo': 1.0}, 1e9
"""Range of the options of a grid, in their units."""
NAMED = ('input', 'cut')
"""Stages whose errors name the file."""
MOST_LISTED = 20
"""Most hazards printed."""


def add_grid_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a grid to those of a command."""
    group = parser.add_argument_group(
        'grid', 'for many inputs, or one that is divided into tiles; see docs/grid.md'
    )
    engine = group.add_mutually_exclusive_group()
    engine.add_argument(
        '--workers', type=int, metavar='N',
        help='processes that inspect tiles, a core each (default: as many as pay)',
    )
    engine.add_argument(
        '--scheduler', metavar='ADDRESS', help='Dask scheduler, as tcp://host:8786, or its file'
    )
    group.add_argument(
        '--memory', type=float, metavar='GB', help='memory of each worker (default: what is free)'
    )
    group.add_argument(
        '--tile', type=float, metavar='M', help='greatest edge of a tile (default: by memory)'
    )
    group.add_argument(
        '--halo', type=float, metavar='M',
        help='looked at around a tile at first (default 500, or 750 where few points are more)',
    )


def is_grid(arguments: argparse.Namespace) -> bool:
    """Return whether a grid is requested."""
    options = (
        arguments.workers, arguments.scheduler, arguments.memory, arguments.tile, arguments.halo,
    )
    if len(arguments.clouds) > 1 or any(option is not None for option in options):
        return True
    from plc_inspect.grid.cells.inputs import INDEX_SUFFIXES

    path = Path(arguments.clouds[0])
    if path.is_dir() or path.suffix.lower() in INDEX_SUFFIXES:
        return True
    return not path.exists() and glob.has_magic(str(path))


def check_grid_arguments(arguments: argparse.Namespace) -> None:
    """Raise ConfigError if options conflict, DataError if OUT cannot be used."""
    from plc_inspect.errors import ConfigError
    from plc_inspect.grid.grid_folder import check_grid_folder

    for name in ('cases', 'pdf'):
        if getattr(arguments, name):
            option = '--case' if name == 'cases' else f'--{name}'
            raise ConfigError(f'{option} is for a single cloud, not for a grid')
    check_numbers(arguments, LEAST)
    check_grid_folder(arguments.output)


def check_numbers(arguments: argparse.Namespace, names: Iterable[str]) -> None:
    """Raise ConfigError if one of the options of a grid that are named is out of its range."""
    from plc_inspect.errors import ConfigError

    for name in names:
        value, least = getattr(arguments, name), LEAST[name]
        if value is not None and not least <= value <= MOST:
            raise ConfigError(
                f'--{name} must be {least:g} or more, at most {MOST:g}, got {value:g}'
            )


def choose_memory(arguments: argparse.Namespace, has_tiles: bool = True) -> float | None:
    """
    Return the memory of each worker [bytes], None for that of the engine.

    Raises
    ------
    DataError
        It is too small: what the arguments say, and with tiles what is free.

    """
    from plc_inspect.grid.cells.layout import count_allowed
    from plc_inspect.grid.engine import measure_available

    if arguments.memory is not None:
        count_allowed(arguments.memory * GIGABYTE)
        return float(arguments.memory * GIGABYTE)
    if has_tiles and arguments.scheduler is None:
        count_allowed(measure_available() / (arguments.workers or 1))
    return None


def choose_workers(
    arguments: argparse.Namespace, num_tasks: int, memory: float
) -> int | None:
    """Return the local workers that are asked for, None for none; default: `count_workers`."""
    from plc_inspect.grid.engine import count_workers

    if arguments.scheduler is not None:
        return None
    if arguments.workers is not None:
        return int(arguments.workers)
    return count_workers(num_tasks, memory)


def run_grid(
    arguments: argparse.Namespace, settings: 'Settings', rules: 'RuleSet | None',
    baseline: 'Survey | None' = None,
) -> int:
    """
    Inspect a grid as the arguments of a command ask for.

    Returns
    -------
    int
        0 done, 2 if an input could not be read, 1 if a tile failed by a defect.

    Raises
    ------
    PlcInspectError
        See `survey_grid`.

    """
    from plc_inspect.grid.cells.layout import estimate_tile, MOST_POINTS, USUAL_POINTS
    from plc_inspect.grid.engine import open_engine
    from plc_inspect.grid.run import GridOptions
    from plc_inspect.grid.survey_grid import GridInputs, survey_grid

    inputs = GridInputs(
        items=tuple(arguments.clouds), folder=arguments.output.absolute(), crs=arguments.crs,
        force=arguments.force, geo=arguments.geo, unit=parse_unit(arguments.units),
        baseline=baseline,
    )
    options = GridOptions(halo=arguments.halo, tile_edge=arguments.tile or math.inf)
    memory = choose_memory(arguments)  # before workers are started

    @contextmanager
    def start(num_points: int) -> Iterator['Engine']:
        num_tiles = num_points // USUAL_POINTS
        num = choose_workers(arguments, num_tiles, memory or estimate_tile(MOST_POINTS))
        with open_engine(num, arguments.scheduler, memory) as engine:
            tell_dashboard(engine, arguments.quiet)
            yield engine

    with show_progress(arguments.quiet, time_left=True) as progress:

        def tell(step: str, done: int, total: int, failed: int) -> None:
            label = f'{step} {done}/{total}' + (f', {failed} failed' if failed else '')
            progress(label, done / max(total, 1))

        summary = survey_grid(inputs, settings, rules, options, start, tell)
    if not arguments.quiet:
        if summary.notes:
            more = len(summary.notes) - 1
            others = f' (and {more} more, see run.json)' if more else ''
            print(make_one_line(f'note: {summary.notes[0]}{others}') + '\n')
        if summary.missing:
            print(f'note: {summary.missing}\n')
        print(make_printable(render_grid(summary)))
        if summary.changes is not None:
            from plc_inspect.offline.commands.compare import render_changes

            print('\n' + make_printable(render_changes(summary.changes, summary.units)))
        print(make_printable(f'\nreport: {arguments.output / "index.html"}'))
    for stage, name, error in summary.failures:
        what = '' if stage in NAMED else f'{stage} {name}: '
        print(make_one_line(f'plc_survey: {what}{error}'), file=sys.stderr)
    if summary.failures:
        print(
            f'plc_survey: {len(summary.failures)} failed: the results lack what they would add',
            file=sys.stderr,
        )
        return DEFECT if summary.num_defects else BAD_INPUT
    return DONE


def tell_dashboard(engine: 'Engine', quiet: bool) -> None:
    """Print the address of the dashboard of an engine, if it has one."""
    if engine.address and not quiet:
        print(f'dashboard: {engine.address}', file=sys.stderr)


def render_grid(summary: 'GridSummary') -> str:
    """Return totals and the worst hazards of a grid as text; lengths in units of the input."""
    from plc_inspect.offline.records.inspection import describe_hazard
    from plc_inspect.offline.report.figures import rank
    from plc_inspect.offline.terminal.result_table import (
        describe_withheld,
        format_number,
        format_table,
    )

    joined, scale, unit = summary.joined, summary.units.horizontal, summary.units.name
    lines = len({span.line_id for span in joined.spans})
    parts = [
        f'{summary.num_points:,} points{describe_withheld(summary.num_withheld)} in'
        f' {summary.num_tiles} tiles,'
        f' {summary.kilometres:.2f} km of line, {lines} lines, {len(joined.spans)} spans,'
        f' {len(joined.supports)} supports, {len(joined.hazards)} hazards'
    ]
    if not joined.spans:
        return parts[0] + '\nno power line was found'
    worst = sorted(
        joined.hazards, key=lambda item: rank(describe_hazard(item, summary.units))
    )[:MOST_LISTED]
    if worst:
        parts.append(format_table(
            ('hazard', 'severity', 'kind', 'line', 'span', f'measured [{unit}]',
             f'required [{unit}]'),
            [
                [
                    str(item.hazard_id), item.severity.name.lower(), item.kind.name.lower(),
                    str(item.line_id), str(item.span_id),
                    format_number(item.measured / scale, 2),
                    format_number(item.required / scale, 2),
                ]
                for item in worst
            ],
        ))
    return '\n\n'.join(parts)
