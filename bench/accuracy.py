# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Accuracy of the default settings on simulated maps, simulated flights and real clouds.

Every figure stands beside the floor it must keep.  Without restriction all scenes are run as maps
at three densities and as flights, with the real clouds where they are, and ``docs/accuracy.md`` is
written.  ``--quick`` runs small maps and the small real clouds.  The exit code is 0 if all floors
are kept, 1 if one is missed, 2 for bad usage.
"""

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
import sys
import time

from common.surveys import make_flight, make_map, open_cache, Survey
from common.tables import (
    at_least,
    at_most,
    Check,
    CHECK_COLUMNS,
    format_figure,
    render_table,
    replace_section,
)
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.offline.commands.flight_run import replay
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.results import InspectionResult
from plc_inspect.sim.evaluation.estimate import from_result
from plc_inspect.sim.evaluation.evaluate import evaluate
from plc_inspect.sim.evaluation.matching import match_spans, measure_sag_error
from plc_inspect.sim.evaluation.reference import read_truth
from plc_inspect.sim.evaluation.scores import Errors, Scores, WireScores
from plc_inspect.sim.scenes.catalogue import SCENES

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / 'shared/data/real'
WITHOUT_LINE = ('no_line', 'town')
WITH_TREES_IN_CONTACT = ('contact',)
DENSITIES = (5.0, 20.0, 60.0)
QUICK_SCENES = ('low_voltage', 'angle', 'town')
LEAST_SPANS = 200
"""Coverage of the intervals is judged from this number of spans."""

REAL_WIRES = ('ahn_12BZ1_21', 'ahn_12BZ1_21_pasted_trees', 'oakland_part3_an', 'oakland_part2_ai')
REAL_EMPTY = (
    'oakland_part2_ad', 'oakland_part3_aj', 'forest_mixedconifer_no_wires',
    'forest_bcts_1_no_wires', 'autzen_parking_no_wires',
)
IN_US_FEET = {'earthwire_us_feet': 'EPSG:2225'}
"""Clouds that do not say themselves that their coordinates are in feet, and such a system."""
REAL_UNLABELLED = ('earthwire_us_feet', 'autzen_wires_north')
REAL_BAGS = ('vlp16_indoor', 'vlp16_indoor_organized')
SLOW = ('autzen_parking_no_wires', 'forest_bcts_1_no_wires', 'autzen_wires_north')


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One cloud through the pipeline, and its scores."""

    kind: str
    """'map', 'flight' or 'real'."""
    name: str
    density: float
    """Pulses per square metre of a map, NaN for others."""
    num_points: int
    result: InspectionResult
    scores: Scores | None
    """None where nothing is known of the cloud."""
    pulls: tuple[float, ...]
    """Sag error of each span that was matched, in its own standard deviations."""
    seconds: float

    @property
    def title(self) -> str:
        """Name with density and seed, as tables give it."""
        return self.name if math.isnan(self.density) else f'{self.name}, {self.density:g}/m2'

    @property
    def has_line(self) -> bool:
        """Whether there is a line to be found."""
        return self.name.split(' ')[0] not in (*WITHOUT_LINE, *REAL_EMPTY, *REAL_BAGS)


def run_survey(
    survey: Survey, kind: str, density: float = math.nan, seed: int = 0,
    settings: Settings | None = None,
) -> Run:
    """Run the pipeline over a simulated survey and score it."""
    started = time.perf_counter()
    result = Pipeline(settings).run(survey.points)
    seconds = time.perf_counter() - started
    found = from_result(result, survey.points)
    pulls = tuple(
        measure_sag_error(survey.truth.spans[match.truth], found.spans[match.found])
        / max(result.spans[match.found].sigma['sag'], 1e-9)
        for match in match_spans(survey.truth, found).matches
    )
    return Run(
        kind=kind, name=survey.name + (f' seed {seed}' if seed else ''), density=density,
        num_points=len(survey.points), result=result, scores=evaluate(found, survey.truth),
        pulls=pulls, seconds=seconds,
    )


def run_real(path: Path, is_labelled: bool, settings: Settings | None = None) -> Run:
    """Run the pipeline over a real cloud or recording, and score it by the file's classes."""
    if path.is_dir():
        inspection = replay(path, settings or Settings())
        points, result = inspection.points, inspection.result
        seconds = inspection.seconds['pipeline']
    else:
        points = read_cloud(path, IN_US_FEET.get(path.stem)).points
        started = time.perf_counter()
        result = Pipeline(settings).run(points)
        seconds = time.perf_counter() - started
    scores = evaluate(from_result(result, points), read_truth(path)) if is_labelled else None
    return Run(
        kind='real', name=path.stem, density=math.nan, num_points=len(points), result=result,
        scores=scores, pulls=(), seconds=seconds,
    )


def check_maps(runs: Iterable[Run]) -> list[Check]:
    """Return the checks of simulated maps."""
    runs = [run for run in runs if run.kind == 'map']
    lines = [run for run in runs if run.has_line]
    dense = [run for run in lines if run.density >= 20]
    free = [run for run in dense if run.name.split(' ')[0] not in WITH_TREES_IN_CONTACT]
    forest = [run for run in dense if run.name.split(' ')[0] in WITH_TREES_IN_CONTACT]
    data = 'maps of 20/m2 and more'
    return [
        *_check_worst(data, 'wire F1', free, _f1, 0.98, least=True),
        *_check_worst('the same, trees in contact', 'wire F1', forest, _f1, 0.95, least=True),
        *_check_worst(data, 'conductor-spans found', dense, lambda run: run.scores.spans.recall,
                      0.98, '%', least=True),
        *_check_worst(data, 'false conductor-spans', dense, lambda run: run.scores.spans.false, 0),
        *_check_worst('maps', 'vertical RMSE, median', lines,
                      lambda run: run.scores.vertical_rmse.median, 0.04, 'm'),
        *_check_worst('maps', 'sag error, median', lines, lambda run: run.scores.sag.median,
                      0.05, 'm'),
        *_check_worst('maps', 'support position, median', lines,
                      lambda run: run.scores.support_position.median, 1.0, 'm'),
        *_check_clearance(lines),
        *_check_worst('maps without a line', 'lines found',
                      [run for run in runs if not run.has_line],
                      lambda run: run.result.num_lines, 0),
        *_check_coverage(lines),
    ]


def check_flights(runs: Iterable[Run]) -> list[Check]:
    """Return the checks of simulated flights."""
    runs = [run for run in runs if run.kind == 'flight']
    lines = [run for run in runs if run.has_line]
    return [
        *_check_worst('flights', 'conductor-spans found', lines,
                      lambda run: run.scores.spans.recall, 0.95, '%', least=True),
        *_check_worst('flights', 'false conductor-spans', lines,
                      lambda run: run.scores.spans.false, 1),
        *_check_worst('flights', 'vertical RMSE, median', lines,
                      lambda run: run.scores.vertical_rmse.median, 0.08, 'm'),
        *_check_worst('flights without a line', 'lines found',
                      [run for run in runs if not run.has_line],
                      lambda run: run.result.num_lines, 0),
    ]


def check_real(runs: Iterable[Run]) -> list[Check]:
    """Return the checks of real clouds."""
    by_name = {run.name: run for run in runs if run.kind == 'real'}
    checks = []
    if (run := by_name.get('ahn_12BZ1_21')) is not None:
        whole, num_spans = count_whole_lines(run.result)
        checks += [
            at_least(run.name, 'wire F1', _f1(run), 0.98),
            at_least(run.name, f'lines through all {num_spans} spans', whole, 6, remark=
                     f'{run.result.num_lines} lines found; six phases, two earth wires'),
        ]
    for name in ('oakland_part3_an', 'oakland_part2_ai'):
        if (run := by_name.get(name)) is not None:
            checks += [
                at_least(name, 'wire precision', run.scores.wire.precision, 0.85),
                at_least(name, 'wire recall', run.scores.wire.recall, 0.85),
            ]
    if (run := by_name.get('earthwire_us_feet')) is not None:
        worst = max((span.rmse for span in run.result.spans), default=math.nan)
        checks.append(at_most(run.name, 'fit residual of the worst span', worst, 0.03, 'm',
                              f'{len(run.result.spans)} spans'))
    empty = [by_name[name] for name in (*REAL_EMPTY, *REAL_BAGS) if name in by_name]
    return [
        *checks,
        *_check_worst('real clouds without wires', 'lines found', empty,
                      lambda run: run.result.num_lines, 0),
    ]


def count_whole_lines(result: InspectionResult) -> tuple[int, int]:
    """Return how many lines run through every span of the route, and how many spans it has."""
    spans = {span.span_id for span in result.spans}
    of_line: dict[int, set[int]] = {}
    for span in result.spans:
        of_line.setdefault(span.line_id, set()).add(span.span_id)
    return sum(known == spans for known in of_line.values()), len(spans)


def _f1(run: Run) -> float:
    return run.scores.wire.f1


def _check_worst(
    data: str, measure: str, runs: Sequence[Run], get: Callable[[Run], float], limit: float,
    unit: str = '', *, least: bool = False,
) -> list[Check]:
    """Return the check of the run with the worst figure; none without runs."""
    if not runs:
        return []
    values = [float(get(run)) for run in runs]
    signed = [-math.inf if math.isnan(v) else v if least else -v for v in values]
    worst = int(np.argmin(signed))
    number = f'worst of {len(runs)}: {runs[worst].title}'
    check = at_least if least else at_most
    return [check(data, measure, values[worst], limit, unit, number)]


def _check_clearance(runs: Sequence[Run]) -> list[Check]:
    if not runs:
        return []
    errors = Errors(values=tuple(v for run in runs for v in run.scores.clearance.values))
    data, remark = 'maps', f'{len(errors.values)} spans'
    return [
        at_most(data, 'distance to vegetation, median error', errors.median, 0.10, 'm', remark),
        at_most(data, 'distance to vegetation, p95 of errors', errors.p95, 0.30, 'm', remark),
    ]


def _check_coverage(runs: Sequence[Run]) -> list[Check]:
    pulls = np.array([pull for run in runs for pull in run.pulls])
    if len(pulls) < LEAST_SPANS:
        return []
    share = float((pulls <= 1.96).mean())
    return [Check(data='maps', measure='true sag inside its 95 % interval', value=share,
                  limit=(0.90, 0.98), unit='%', remark=f'{len(pulls)} spans')]


MAP_COLUMNS = (
    'cloud', 'points', 'wire P', 'wire R', 'wire F1', 'spans', 'false', 'vertical', 'lateral',
    'sag', 'vegetation', 'supports', 'position', 'hazards', 'false', 'time [s]',
)


def render_simulated(runs: Sequence[Run]) -> str:
    """Return the table of simulated surveys."""
    rows = []
    for run in runs:
        scores = run.scores
        wire = scores.wire or WireScores(
            true_positives=0, false_positives=0, false_negatives=0, left_out=0,
        )
        rows.append((
            run.title, f'{run.num_points}',
            *(format_figure(value) for value in (wire.precision, wire.recall, wire.f1)),
            f'{scores.spans.required_found}/{scores.spans.required}', f'{scores.spans.false}',
            *(format_figure(item.median) for item in (
                scores.vertical_rmse, scores.lateral_rmse, scores.sag, scores.clearance)),
            f'{scores.supports.required_found}/{scores.supports.required}'
            + (f' +{scores.supports.false}' if scores.supports.false else ''),
            format_figure(scores.support_position.median, 2),
            f'{scores.hazards.required_found}/{scores.hazards.required}',
            f'{scores.hazards.false}', f'{run.seconds:.1f}',
        ))
    return render_table(MAP_COLUMNS, rows)


def render_real(runs: Sequence[Run]) -> str:
    """Return the table of real clouds."""
    rows = []
    for run in runs:
        wire = run.scores.wire if run.scores is not None else None
        shares = (wire.precision, wire.recall, wire.f1) if wire else (math.nan,) * 3
        residual = max((span.rmse for span in run.result.spans), default=math.nan)
        rows.append((
            run.name, f'{run.num_points}', *(format_figure(value) for value in shares),
            f'{run.result.num_lines}', f'{len(run.result.spans)}', format_figure(residual),
            f'{len(run.result.supports)}', f'{len(run.result.hazards)}', f'{run.seconds:.1f}',
        ))
    return render_table(('cloud', 'points', 'wire P', 'wire R', 'wire F1', 'lines', 'spans',
                         'worst residual', 'supports', 'hazards', 'time [s]'), rows)


def run_all(arguments: argparse.Namespace, cache: Path) -> list[Run]:
    """Run what was asked for, a line to stderr for each cloud."""
    runs: list[Run] = []

    def keep(run: Run) -> None:
        runs.append(run)
        print(f'{run.kind} {run.title}: {run.num_points} points, {run.result.num_lines} lines, '
              f'{run.seconds:.1f} s', file=sys.stderr, flush=True)

    if 'maps' in arguments.parts:
        for seed in arguments.seeds:
            for name in arguments.scenes:
                for density in arguments.densities:
                    survey = make_map(cache, name, density=density, seed=seed)
                    keep(run_survey(survey, 'map', density, seed))
    if 'flights' in arguments.parts:
        for name in arguments.scenes:
            keep(run_survey(make_flight(cache, name), 'flight'))
    if 'real' in arguments.parts and not arguments.real.is_dir():
        print(f'skipped: the real clouds, as there is no {arguments.real}', file=sys.stderr)
    elif 'real' in arguments.parts:
        for name in (*REAL_WIRES, *REAL_UNLABELLED, *REAL_EMPTY):
            if not (arguments.quick and name in SLOW):
                path = arguments.real / f'{name}.laz'
                keep(run_real(path, name in REAL_WIRES))
        for name in REAL_BAGS:
            keep(run_real(arguments.real / name, False))
    return runs


def render_page(runs: Sequence[Run], checks: Sequence[Check]) -> str:
    """Return all tables as Markdown."""
    parts = ['## Floors', render_table(CHECK_COLUMNS, (check.row() for check in checks))]
    for title, kind in (('Simulated maps', 'map'), ('Simulated flights', 'flight')):
        if chosen := [run for run in runs if run.kind == kind]:
            parts += [f'## {title}', render_simulated(chosen)]
    if chosen := [run for run in runs if run.kind == 'real']:
        parts += ['## Real clouds', render_real(chosen)]
    return '\n\n'.join(parts)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of this command."""
    parser = argparse.ArgumentParser(description='Accuracy on simulated and real surveys.')
    parser.add_argument('--quick', action='store_true', help='small maps and real clouds only')
    parser.add_argument('--parts', nargs='+', choices=('maps', 'flights', 'real'))
    parser.add_argument('--scenes', nargs='+', choices=tuple(SCENES))
    parser.add_argument('--densities', nargs='+', type=float, metavar='D')
    parser.add_argument('--seeds', nargs='+', type=int, default=[0])
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep simulated surveys here')
    parser.add_argument('--real', type=Path, metavar='DIR', default=REAL)
    parser.add_argument(
        '--output', type=Path, metavar='FILE',
        help='write the tables into this page; docs/accuracy.md where all is run',
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench; return 0 if all floors are kept, 1 if one is missed."""
    arguments = build_parser().parse_args(argv)
    is_whole = not (arguments.quick or arguments.parts or arguments.scenes or arguments.densities)
    arguments.parts = arguments.parts or (
        ('maps', 'real') if arguments.quick else ('maps', 'flights', 'real'))
    arguments.scenes = arguments.scenes or (QUICK_SCENES if arguments.quick else tuple(SCENES))
    arguments.densities = arguments.densities or ((20.0,) if arguments.quick else DENSITIES)
    with open_cache(arguments.cache) as cache:
        runs = run_all(arguments, cache)
    checks = [*check_maps(runs), *check_flights(runs), *check_real(runs)]
    page = render_page(runs, checks)
    print(page)
    output = arguments.output or (ROOT / 'docs/accuracy.md' if is_whole else None)
    if output is not None:
        replace_section(output, 'accuracy', page)
    missed = [check for check in checks if not check.passed]
    print(f'\n{len(checks) - len(missed)} of {len(checks)} floors kept')
    return 1 if missed else 0


if __name__ == '__main__':
    sys.exit(main())
