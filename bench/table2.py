# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The paper's Table 2 side by side: plc_inspect and a plain reading of the paper, on the same clouds.

Both clouds have exactly the paper's number of points.  The two programs take turns in one process;
figures are medians.  ``--scale`` makes smaller clouds to try the bench out; ``--write`` puts the
tables into docs/performance.md.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
import os
from pathlib import Path
import statistics
import sys

from common.measure import measure, Measured
from common.paper_baseline import segment
from common.surveys import make_map, open_cache, Survey
from common.tables import at_least, at_most, Check, CHECK_COLUMNS, render_table, replace_section
import numba
import numpy as np

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.offline.commands.allocator import keep_freed_memory
from plc_inspect.results import PointClass

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One row of the paper's table."""

    title: str
    scene: str
    num_points: int
    paper: float
    """The paper's own figure [ms/m2]."""
    deep_net: float
    """PointNet++ in the paper's table [ms/m2]."""
    goal: float
    """Array to result [s]."""
    is_ratio_judged: bool = True
    """False where the baseline has next to nothing to do: one point in seven is high."""


CASES = (
    Case(title='high voltage', scene='high_voltage', num_points=10_000_429, paper=0.25,
         deep_net=0.93, goal=1.0),
    Case(title='low voltage', scene='low_voltage', num_points=928_146, paper=0.21, deep_net=0.87,
         goal=0.2, is_ratio_judged=False),
)
MOST_MEMORY = 2e9
LEAST_RATIO = 50.0


Run = Measured[dict[str, float]]
"""
What one run of a program took, in all and in each stage [s]; what it found is let go, as its
memory serves the next one.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """One of the two programs on one cloud."""

    runs: tuple[Run, ...]
    extra_bytes: float
    """Extra memory, of a run of its own that is not timed."""
    wire_f1: float
    """F1 of wire points in that run, against the labels of the simulator."""

    def seconds(self) -> float:
        """Return the median wall time [s]."""
        return statistics.median(run.seconds for run in self.runs)

    def cpu_seconds(self) -> float:
        """Return the median processor time of all threads [s]."""
        return statistics.median(run.cpu_seconds for run in self.runs)

    def stages(self) -> dict[str, float]:
        """Return the median wall time of each stage [s]."""
        return {name: statistics.median(run.value[name] for run in self.runs)
                for name in self.runs[0].value}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Both programs over one cloud."""

    case: Case
    survey: Survey
    ours: Program
    baseline: Program

    def ratio(self) -> float:
        """Return how many times faster we are."""
        return self.baseline.seconds() / self.ours.seconds()


def score_wire(found: np.ndarray, survey: Survey) -> float:
    """Return the F1 of a wire mask (N,)."""
    wire = survey.truth.labels == PointClass.WIRE
    both = int((found & wire).sum())
    return 2 * both / max(int(found.sum()) + int(wire.sum()), 1)


def run_ours(points: np.ndarray, *, memory: bool) -> tuple[Run, np.ndarray]:
    """Run the default pipeline; return also its wire mask (N,)."""
    measured = measure(lambda: Pipeline().run(points), memory=memory)
    stages = {stage.name: stage.seconds for stage in measured.value.stages}
    return replace(measured, value=stages), measured.value.classification == PointClass.WIRE


def run_baseline(points: np.ndarray, *, memory: bool) -> tuple[Run, np.ndarray]:
    """Run the plain reading of the paper; return also its wire mask (N,)."""
    measured = measure(lambda: segment(points), memory=memory)
    return replace(measured, value=measured.value.seconds), measured.value.wire


def compare(case: Case, survey: Survey, repeats: int) -> Comparison:
    """Run both programs over a cloud, by turns, after a run of each that measures memory."""
    points = survey.points
    programs = (run_ours, run_baseline)
    runs: tuple[list[Run], list[Run]] = ([], [])
    memory, scores = [0.0, 0.0], [0.0, 0.0]
    for k in (1, 0):  # ours last: its first run that counts would feel memory given back
        programs[k](points[:len(points) // 20].copy(), memory=False)  # loads or compiles kernels
        first, wire = programs[k](points, memory=True)
        memory[k], scores[k] = first.extra_bytes, score_wire(wire, survey)
    for number in range(repeats):
        for program, taken in zip(programs, runs, strict=True):
            taken.append(program(points, memory=False)[0])
        print(f'{case.title} {number + 1} of {repeats}: {runs[0][-1].seconds:.2f} s, baseline '
              f'{runs[1][-1].seconds:.1f} s', file=sys.stderr, flush=True)
    ours, baseline = (
        Program(runs=tuple(taken), extra_bytes=extra_bytes, wire_f1=score)
        for taken, extra_bytes, score in zip(runs, memory, scores, strict=True)
    )
    return Comparison(case=case, survey=survey, ours=ours, baseline=baseline)


COLUMNS = (
    'cloud', 'program', 'time [s]', 'ms/m2', 'points/s', 'processor [s]', 'extra memory [GB]',
    'wire F1', 'times faster',
)


def render_rows(item: Comparison) -> list[tuple[str, ...]]:
    """Return the rows of one cloud."""
    area, num_points = item.survey.area, len(item.survey.points)
    title = f'{item.case.title}: {num_points:,} points on {area:,.0f} m2'
    rows = []
    for name, program, faster in (
        ('plc_inspect', item.ours, f'{item.ratio():.0f}'), ('paper baseline', item.baseline, '1'),
    ):
        seconds = program.seconds()
        rows.append((
            title, name, f'{seconds:.3f}', f'{1e3 * seconds / area:.4f}',
            f'{num_points / seconds:,.0f}', f'{program.cpu_seconds():.2f}',
            f'{program.extra_bytes / 1e9:.2f}', f'{program.wire_f1:.4f}', faster,
        ))
    published = (('the paper, its own cloud', item.case.paper),
                 ('PointNet++, in the paper', item.case.deep_net))
    return rows + [(title, name, '', f'{figure:g}', '', '', '', '', '')
                   for name, figure in published]


def render_stages(items: Sequence[Comparison]) -> str:
    """Return the median time of each stage of both programs."""
    columns = ['stage']
    table: dict[str, list[str]] = {}
    for number, item in enumerate(items):
        columns += [f'{item.case.title} [s]', 'baseline [s]']
        ours, theirs = item.ours.stages(), item.baseline.stages()
        for name, seconds in ours.items():
            row = table.setdefault(name, [''] * 2 * number)
            row += [f'{seconds:.3f}', f'{theirs[name]:.2f}' if name in theirs else '']
    return render_table(columns, [(name, *row) for name, row in table.items()])


def list_checks(items: Sequence[Comparison]) -> list[Check]:
    """Return the goals, which hold for clouds of full size on two cores."""
    checks = []
    for item in items:
        title = item.case.title
        checks += [
            at_most(title, 'array to result, median', item.ours.seconds(),
                    item.case.goal, 's'),
            at_most(title, 'peak extra memory', item.ours.extra_bytes / 1e9,
                    MOST_MEMORY / 1e9, 'GB'),
            at_least(title, 'wire F1, floor the baseline', item.ours.wire_f1,
                     item.baseline.wire_f1),
        ]
        if item.case.is_ratio_judged:
            checks.append(
                at_least(title, 'times faster than the baseline', item.ratio(), LEAST_RATIO)
            )
    return checks


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description="The paper's Table 2 side by side.")
    parser.add_argument('--repeats', type=int, default=5)
    parser.add_argument('--scale', type=float, default=1.0, help='share of the points')
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep simulated clouds here')
    parser.add_argument('--write', action='store_true', help='into docs/performance.md')
    arguments = parser.parse_args(argv)
    if arguments.repeats < 1 or not 0.0 < arguments.scale <= 1.0:
        parser.error('repeats must be 1 or more and the scale in (0, 1]')
    keep_freed_memory()  # as plc_survey does
    items = []
    with open_cache(arguments.cache) as cache:
        for case in CASES:
            survey = make_map(
                cache, case.scene, num_points=max(1, round(arguments.scale * case.num_points)),
            )
            items.append(compare(case, survey, arguments.repeats))
    parts = [
        f'{arguments.repeats} runs each, by turns, in one process; {os.cpu_count()} cores, '
        f'{numba.get_num_threads()} threads.',
        render_table(COLUMNS, [row for item in items for row in render_rows(item)]),
        render_stages(items),
    ]
    if arguments.scale == 1.0:
        parts.append(render_table(CHECK_COLUMNS[:5], (
            check.row()[:5] for check in list_checks(items)
        )))
    page = '\n\n'.join(parts)
    print(page)
    if arguments.write:
        replace_section(ROOT / 'docs/performance.md', 'table2', page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
