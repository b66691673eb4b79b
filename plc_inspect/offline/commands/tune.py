# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``plc_tune``: searches the settings of the paper's Table 1."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from plc_inspect.offline.commands.command_line import (
    DONE,
    INTERRUPTED,
    Parser,
    run_command,
    show_progress,
)

NAME = 'plc_tune'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(NAME, lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parse(argv)
    from plc_inspect.errors import ConfigError
    from plc_inspect.offline.commands.request import hash_input
    from plc_inspect.offline.commands.sensitivity import measure_sensitivity, render_sensitivity
    from plc_inspect.offline.commands.tuning_run import (
        read_points,
        render_file,
        render_tuned,
        SearchPlan,
        tune,
    )
    from plc_inspect.offline.readers.parameter_file import read_settings
    from plc_inspect.offline.readers.wire_truth import read_wire_truth
    from plc_inspect.whole_files import check_file, replace_file

    settings = read_settings(arguments.params, arguments.assignments)
    if arguments.output is None and not arguments.sensitivity:
        raise ConfigError('-o PARAMS.yaml is needed, unless --sensitivity is asked for')
    if arguments.budget is not None and arguments.budget < 1:
        raise ConfigError(f'--budget must be 1 or more, got {arguments.budget}')
    if arguments.seed < 0:
        raise ConfigError(f'--seed must be 0 or more, got {arguments.seed}')
    if arguments.output is not None:
        check_file(arguments.output, arguments.force)
    source, interrupted, parts = arguments.input.absolute().name, False, []
    with show_progress(arguments.quiet, time_left=True) as progress:
        points = read_points(arguments.input, settings, arguments.crs, progress)
        truth = None if arguments.truth is None else read_wire_truth(arguments.truth, points)
        if arguments.output is not None:
            plan = SearchPlan(
                method=arguments.method, budget=arguments.budget, seed=arguments.seed
            )
            tuned = tune(
                points, settings, plan, truth=truth, progress=progress,
                tell=(lambda line: None) if arguments.quiet else _tell,
            )
            if not tuned.is_line:
                print(f'{source}: no power line was found, neither with the settings given nor'
                      f' with any of {tuned.num_evaluations} others; nothing is written')
                return INTERRUPTED if tuned.interrupted else DONE
            text = render_file(tuned, source, hash_input(arguments.input))
            with replace_file(
                arguments.output, lambda: check_file(arguments.output, arguments.force)
            ) as aside:
                aside.write_text(text, encoding='utf-8')
            parts += [render_tuned(tuned, source), f'written: {arguments.output}']
            settings, interrupted = tuned.settings, tuned.interrupted
        if arguments.sensitivity and not interrupted:
            rows = measure_sensitivity(points, settings, arguments.seed, truth, progress)
            parts.append(render_sensitivity(rows))
    if not arguments.quiet or arguments.sensitivity:
        print('\n\n'.join(parts))
    return INTERRUPTED if interrupted else DONE


def _tell(line: str) -> None:
    """Print one line, above the bar where there is one."""
    from tqdm import tqdm

    tqdm.write(line)


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog=NAME, description='Searches the settings of Table 1 that suit one cloud or flight.'
    )
    parser.add_argument(
        'input', type=Path, metavar='CLOUD_OR_BAG',
        help='a cloud as of plc_survey, a rosbag2 folder, or a .mcap, .db3 or ROS 1 .bag file',
    )
    parser.add_argument(
        '-o', '--output', type=Path, metavar='PARAMS.yaml', help='parameter file to write'
    )
    parser.add_argument(
        '--method', choices=('grid', 'evolution'), default='evolution',
        help='grid: coarse to fine, as in the paper; evolution: CMA-ES (default)',
    )
    parser.add_argument(
        '--truth', type=Path, metavar='FILE',
        help='a labelled LAS or LAZ file of the same points, or truth.json: search for F1',
    )
    parser.add_argument('--params', type=Path, metavar='FILE', help='settings to start from')
    parser.add_argument(
        '--set', action='append', default=[], metavar='SECTION.NAME=VALUE', dest='assignments',
        help='one setting to start from; may be repeated, wins over --params',
    )
    parser.add_argument('--budget', type=int, metavar='N', help='most evaluations')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of all random choices')
    parser.add_argument(
        '--sensitivity', action='store_true',
        help='print what +-20 %% of each setting changes; without -o of those given',
    )
    parser.add_argument(
        '--crs', help='coordinate reference system instead of the one in the file, as EPSG:2992'
    )
    parser.add_argument('--force', action='store_true', help='replace PARAMS.yaml')
    parser.add_argument('--quiet', action='store_true', help='print errors only')
    return parser.parse_args(argv)
