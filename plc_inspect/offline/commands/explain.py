# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_explain``: why a point or a span came out as it did."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import TYPE_CHECKING

from plc_inspect.offline.commands.command_line import DONE, Parser, run_command, show_progress
from plc_inspect.printable import make_printable

if TYPE_CHECKING:
    from plc_inspect.config import Settings
    from plc_inspect.offline.records.units import Units
    from plc_inspect.results import Float64, UInt8

NAME = 'plc_explain'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Folder:
    """The points and settings of a results folder."""

    points: 'Float64'
    """(N, 3) in the order of points.laz [m]."""
    classification: 'UInt8'
    """(N,) PointClass."""
    decision: 'UInt8'
    """(N,) Decision, as stored."""
    settings: 'Settings'
    """With the plain clearance rules, because rules do not affect the classes of points."""
    units: 'Units'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def read_folder(folder: Path) -> Folder:
    """
    Read points and settings of a results folder, to run the pipeline again.

    Parameters
    ----------
    folder : Path
        As `write_results` wrote it.

    Returns
    -------
    Folder

    Raises
    ------
    DataError
        The folder or one of its files is missing or malformed.
    ConfigError
        Its settings are unknown.

    """
    import numpy as np

    from plc_inspect.config import Settings
    from plc_inspect.offline.readers.laz import erase_withheld
    from plc_inspect.offline.records.results_reader import (
        parse_units,
        read_points,
        read_run,
        understanding,
    )
    from plc_inspect.setting_names import update

    run = read_run(folder)
    with understanding(folder / 'run.json'):
        units = parse_units(run['input']['metres_per_unit'])
        mapping = {str(name): dict(item) for name, item in run['settings'].items()}
    settings = update(update(Settings(), mapping), {'hazards.rules': 'plain'})
    las, points = read_points(folder, 'decision')
    erase_withheld(las.points, points)
    return Folder(
        points=units.to_metres(points),
        classification=np.asarray(las.classification, dtype=np.uint8),
        decision=np.asarray(las['decision'], dtype=np.uint8),
        settings=settings,
        units=units,
    )


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parse(argv)
    from plc_inspect.errors import ConfigError, DataError

    if not 0.0 < arguments.reach <= 20.0:
        raise ConfigError(f'--reach must lie in (0, 20] m, got {arguments.reach:g}')
    if not all(math.isfinite(value) for place in arguments.at for value in place):
        raise ConfigError('--at must be finite')
    folder = read_folder(arguments.folder)
    if not len(folder.points):
        raise DataError(f'{arguments.folder} holds no points')
    if arguments.point is not None and not 0 <= arguments.point < len(folder.points):
        raise DataError(
            f'there is no point {arguments.point}: {arguments.folder} holds'
            f' {len(folder.points):,}, from 0'
        )
    single = arguments.point is not None or len(arguments.at) == 1
    text = (_tell_point if single else _tell_stretch)(folder, arguments)
    print(make_printable(text))
    return DONE


def _tell_point(folder: Folder, arguments: argparse.Namespace) -> str:
    import numpy as np

    from plc_inspect.core.explain.point import confirm, explain_point, find_nearest
    from plc_inspect.core.pipeline import enter_frame, Pipeline
    from plc_inspect.offline.terminal.explanation_text import render_point
    from plc_inspect.results import Decision, PointClass

    points, settings, units = folder.points, folder.settings, folder.units
    index, lines = arguments.point, []
    if index is None:
        index = find_nearest(points, units.to_metres(np.array(arguments.at))[0])
        away = np.linalg.norm(units.from_metres(points[index]) - np.array(arguments.at[0]))
        lines.append(f'the nearest point is {away:.2f} {units.name} away')
    points, frame, _ = enter_frame(points)
    with show_progress(quiet=False) as progress:
        trace = Pipeline(settings).trace(points, progress, frame.east)
        explanation = explain_point(trace, points, settings, index)
        if not arguments.quick:
            progress('trying', 0.9)
            explanation = confirm(explanation, points, settings)
    x, y, z = units.from_metres(folder.points[index]).tolist()
    kind = PointClass(int(folder.classification[index])).name.lower()
    lines.append(f'point {index} at {x:.2f}, {y:.2f}, {z:.2f}, class {kind}')
    before = int(folder.decision[index])
    if before != explanation.decision:
        num = int((folder.decision != trace.result.decision).sum())
        lines.append(
            f'in the folder it is {Decision(before).name}: coordinates in points.laz are rounded,'
            ' and the path of a flight, about which dust is left out, is not in it;'
            f' {num:,} of {len(points):,} points come out otherwise'
        )
    lines.append(render_point(explanation, settings, not arguments.quick))
    return '\n'.join(lines)


def _tell_stretch(folder: Folder, arguments: argparse.Namespace) -> str:
    import numpy as np

    from plc_inspect.core.explain.span import (
        confirm_stretch,
        explain_stretch,
        follow_span,
        make_course,
    )
    from plc_inspect.core.pipeline import enter_frame, Pipeline
    from plc_inspect.offline.terminal.explanation_text import render_stretch

    points, settings, units = folder.points, folder.settings, folder.units
    points, frame, _ = enter_frame(points)
    course = None
    if arguments.at:
        places = frame.enter(units.to_metres(np.array(arguments.at)))
        course = make_course(places, settings, arguments.reach)
    with show_progress(quiet=False) as progress:
        trace = Pipeline(settings).trace(points, progress, frame.east)
        if course is None:
            line, span = arguments.span
            course = follow_span(trace, line, span, arguments.reach)
        stretch = explain_stretch(trace, points, settings, course)
        trials = None
        if not arguments.quick:
            progress('trying', 0.9)
            trials = confirm_stretch(stretch, points, settings)
    def to_file(places: 'Float64') -> 'Float64':
        return units.from_metres(frame.leave(places))

    x, y, _ = to_file(np.append(course.origin, 0.0))
    name = 'line {}, span {}'.format(*arguments.span) if arguments.span else 'the stretch'
    return (
        f'{name}: {course.length:.1f} m from {x:.2f}, {y:.2f}; what each stage saw within'
        f' {course.reach:g} m of it\n\n' + render_stretch(stretch, trials, settings, to_file)
    )


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog=NAME, description='Tells why a point or span of a results folder came out as it did.'
    )
    parser.add_argument('folder', type=Path, metavar='OUT', help='results folder')
    parser.add_argument(
        '--at', type=float, nargs=3, action='append', default=[], metavar=('X', 'Y', 'Z'),
        help='the point nearest to here; given twice or three times, the stretch through them',
    )
    parser.add_argument(
        '--point', type=int, metavar='INDEX', help='a point of points.laz, counted from 0'
    )
    parser.add_argument(
        '--span', type=int, nargs=2, metavar=('LINE', 'SPAN'), help='a span that was found'
    )
    parser.add_argument(
        '--reach', type=float, default=1.0, metavar='M',
        help='half the width of a stretch [m] (default 1)',
    )
    parser.add_argument(
        '--quick', action='store_true',
        help='do not run the pipeline again to see whether other settings do what is said',
    )
    arguments = parser.parse_args(argv)
    given = [arguments.point is not None, bool(arguments.at), arguments.span is not None]
    if sum(given) != 1:
        parser.error('give one of --at, --point and --span')
    if len(arguments.at) > 3:
        parser.error('--at is given three times at most')
    return arguments
