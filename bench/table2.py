# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
The paper's Table 2 side by side: plc_inspect and a plain reading of the paper, on the same clouds.

Both clouds have exactly the paper's number of points.  The two programs take turns in one process;
figures are medians.  ``--scale`` makes smaller clouds to try the bench out; ``--write`` puts the
tables into docs/performance.md.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import statistics
import sys

from measure import measure, Measured
import numba
import numpy as np
from paper_baseline import BaselineResult, segment
from surveys import make_map, open_cache, Survey
from tables import at_least, at_most, Check, CHECK_COLUMNS, render_table, replace_section

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.offline.allocator import keep_freed_memory
from plc_inspect.results import InspectionResult, PointClass

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """All runs of both programs over one cloud."""

    case: Case
    survey: Survey
    ours: tuple[Measured[InspectionResult], ...]
    baseline: tuple[Measured[BaselineResult], ...]
    memory: tuple[float, float]
    """Extra memory of both, in a run of its own that is not timed [bytes]."""

    def f1(self) -> tuple[float, float]:
        """Return the F1 of wire points of both, against the labels of the simulator."""
        return (
            score_wire(self.ours[-1].value.classification == PointClass.WIRE, self.survey),
            score_wire(self.baseline[-1].value.wire, self.survey),
        )

    def ratio(self) -> float:
        """Return how many times faster we are."""
        return middle(self.baseline, 'seconds') / middle(self.ours, 'seconds')


def middle(runs: Sequence[Measured], name: str) -> float:
    """Return the median of one figure over runs."""
    return statistics.median(getattr(run, name) for run in runs)


def score_wire(found: np.ndarray, survey: Survey) -> float:
    """Return the F1 of a wire mask (N,)."""
    wire = survey.truth.labels == PointClass.WIRE
    both = int((found & wire).sum())
    return 2 * both / max(int(found.sum()) + int(wire.sum()), 1)


def compare(case: Case, survey: Survey, repeats: int) -> Comparison:
    """Run both programs over a cloud, by turns."""
    pipeline, points = Pipeline(), survey.points
    warm_up = points[:len(points) // 20].copy()
    pipeline.run(warm_up)  # compiles, or loads what is compiled
    segment(warm_up)
    memory = (
        measure(lambda: pipeline.run(points)).extra_bytes,
        measure(lambda: segment(points)).extra_bytes,
    )
    ours, baseline = [], []
    for number in range(repeats):
        ours.append(measure(lambda: pipeline.run(points), memory=False))
        baseline.append(measure(lambda: segment(points), memory=False))
        print(f'{case.title} {number + 1} of {repeats}: {ours[-1].seconds:.2f} s, baseline '
              f'{baseline[-1].seconds:.1f} s', file=sys.stderr, flush=True)
    return Comparison(
        case=case, survey=survey, ours=tuple(ours), baseline=tuple(baseline), memory=memory,
    )


COLUMNS = (
    'cloud', 'program', 'time [s]', 'ms/m2', 'points/s', 'processor [s]', 'extra memory [GB]',
    'wire F1', 'times faster',
)


def render_rows(item: Comparison) -> list[tuple[str, ...]]:
    """Return the rows of one cloud."""
    area, num_points = item.survey.area, len(item.survey.points)
    title = f'{item.case.title}: {num_points:,} points on {area:,.0f} m2'
    rows = []
    for name, runs, memory, score, faster in (
        ('plc_inspect', item.ours, item.memory[0], item.f1()[0], f'{item.ratio():.0f}'),
        ('paper baseline', item.baseline, item.memory[1], item.f1()[1], '1'),
    ):
        seconds = middle(runs, 'seconds')
        rows.append((
            title, name, f'{seconds:.3f}', f'{1e3 * seconds / area:.4f}',
            f'{num_points / seconds:,.0f}', f'{middle(runs, "cpu_seconds"):.2f}',
            f'{memory / 1e9:.2f}', f'{score:.4f}', faster,
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
        ours = {stage.name: statistics.median(
            run.value.stages[k].seconds for run in item.ours
        ) for k, stage in enumerate(item.ours[0].value.stages)}
        theirs = {name: statistics.median(
            run.value.seconds[name] for run in item.baseline
        ) for name in item.baseline[0].value.seconds}
        for name, seconds in ours.items():
            row = table.setdefault(name, [''] * 2 * number)
            row += [f'{seconds:.3f}', f'{theirs[name]:.2f}' if name in theirs else '']
    return render_table(columns, [(name, *row) for name, row in table.items()])


def list_checks(items: Sequence[Comparison]) -> list[Check]:
    """Return the goals, which hold for clouds of full size on two cores."""
    checks = []
    for item in items:
        title, (score, other) = item.case.title, item.f1()
        checks += [
            at_most(title, 'array to result, median', middle(item.ours, 'seconds'),
                    item.case.goal, 's'),
            at_most(title, 'peak extra memory', item.memory[0] / 1e9,
                    MOST_MEMORY / 1e9, 'GB'),
            at_least(title, 'wire F1, floor the baseline', score, other),
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
