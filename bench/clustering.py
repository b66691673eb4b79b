# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Clusterers side by side: accuracy and time of each ``clustering.method`` over scenes and clouds.

All other settings are the defaults.  The methods take turns on each cloud, so that all of them
see the same machine.  ``--write`` puts the tables into docs/clustering.md.
"""

import argparse
from collections.abc import Iterator, Sequence
import math
from pathlib import Path
import sys

from accuracy import REAL, REAL_EMPTY, REAL_WIRES, Run, run_real, run_survey
from common.surveys import make_flight, make_map, open_cache
from common.tables import format_figure, render_table, replace_section
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.setting_names import describe, update
from plc_inspect.sim.scenes.catalogue import SCENES

ROOT = Path(__file__).resolve().parents[1]
METHODS: tuple[str, ...] = next(
    about['choices'] for name, _, about in describe() if name == 'clustering.method'
)
PARTS = ('maps', 'flights', 'real')


def choose(method: str) -> Settings:
    """Return the defaults with this clusterer."""
    return update(Settings(), {'clustering.method': method})


def run_all(arguments: argparse.Namespace, cache: Path) -> Iterator[tuple[Run, ...]]:
    """Yield the runs of every method over one cloud after another."""
    warm = make_map(cache, 'low_voltage', density=20.0)
    for method in METHODS:
        run_survey(warm, 'map', settings=choose(method))
    if 'maps' in arguments.parts:
        for name in arguments.scenes:
            for density in arguments.densities:
                survey = make_map(cache, name, density=density)
                yield tuple(
                    run_survey(survey, 'map', density, settings=choose(method))
                    for method in METHODS
                )
    if 'flights' in arguments.parts:
        for name in arguments.scenes:
            survey = make_flight(cache, name)
            yield tuple(
                run_survey(survey, 'flight', settings=choose(method)) for method in METHODS
            )
    if 'real' in arguments.parts and arguments.real.is_dir():
        for name in (*REAL_WIRES, *REAL_EMPTY):
            path = arguments.real / f'{name}.laz'
            yield tuple(run_real(path, name in REAL_WIRES, choose(method)) for method in METHODS)


def cluster_seconds(run: Run) -> float:
    """Return the time of the clustering stage [s]."""
    return next(item.seconds for item in run.result.stages if item.name == 'clustering')


def render_clouds(clouds: Sequence[tuple[Run, ...]]) -> str:
    """Return F1, conductor-spans and time of each method on each cloud."""
    rows = []
    for runs in clouds:
        first = runs[0]
        row = [f'{first.kind} {first.title}', f'{first.num_points}']
        for run in runs:
            wire, spans = run.scores and run.scores.wire, run.scores and run.scores.spans
            row += [
                format_figure(wire.f1 if wire else math.nan),
                f'{spans.required_found}/{spans.required} +{spans.false}'
                if spans and spans.required else f'{len(run.result.spans)} spans',
                format_figure(cluster_seconds(run)),
            ]
        rows.append(row)
    columns = ['cloud', 'points']
    for method in METHODS:
        columns += [f'{method}: wire F1', 'spans +false', 'time [s]']
    return render_table(columns, rows)


def render_summary(clouds: Sequence[tuple[Run, ...]]) -> str:
    """Return one row for each method over all clouds."""
    rows = []
    for number, method in enumerate(METHODS):
        runs = [item[number] for item in clouds]
        lines = [run for run in runs if run.has_line and run.scores and run.scores.wire]
        scored = [run.scores.spans for run in lines if run.scores.spans.required]
        f1 = np.array([run.scores.wire.f1 for run in lines])
        ratio = np.array([
            cluster_seconds(item[number]) / max(cluster_seconds(item[0]), 1e-6)
            for item in clouds
        ])
        rows.append((
            method, f'{len(runs)}', format_figure(float(f1.mean()) if len(f1) else math.nan),
            format_figure(float(f1.min(initial=math.inf)) if len(f1) else math.nan),
            f'{sum(item.required_found for item in scored)} of '
            f'{sum(item.required for item in scored)}',
            f'{sum(item.false for item in scored)}',
            f'{sum(len(run.result.spans) for run in runs if not run.has_line)}',
            f'{sum(map(cluster_seconds, runs)):.1f}', f'{np.median(ratio):.2f}',
            f'{sum(run.seconds for run in runs):.1f}',
        ))
    return render_table((
        'method', 'clouds', 'wire F1, mean', 'least', 'conductor-spans', 'false',
        'spans where there is no line', 'clustering [s]', 'median ratio', 'whole pipeline [s]',
    ), rows)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of this command."""
    parser = argparse.ArgumentParser(description='Clusterers side by side.')
    parser.add_argument('--parts', nargs='+', choices=PARTS, default=PARTS)
    parser.add_argument('--scenes', nargs='+', choices=tuple(SCENES), default=tuple(SCENES))
    parser.add_argument('--densities', nargs='+', type=float, default=(20.0,))
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep simulated surveys here')
    parser.add_argument('--real', type=Path, metavar='DIR', default=REAL)
    parser.add_argument(
        '--write', action='store_true', help='put the tables of a whole run into the docs'
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    arguments = build_parser().parse_args(argv)
    clouds = []
    with open_cache(arguments.cache) as cache:
        for runs in run_all(arguments, cache):
            clouds.append(runs)
            print(render_clouds([runs]).splitlines()[-1], file=sys.stderr, flush=True)
    page = f'{render_summary(clouds)}\n\n{render_clouds(clouds)}'
    print(page)
    if arguments.write and tuple(arguments.parts) == PARTS and arguments.real.is_dir():
        replace_section(ROOT / 'docs/clustering.md', 'clusterers', page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
