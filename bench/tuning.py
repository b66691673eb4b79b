# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Tuning without labels: does it recover from spoiled settings, how fast, and what else it breaks.

Parts: ``recovery`` starts from settings of which each of Table 1 is moved by a factor of 1.5 to 2
and compares wire F1 with that of the defaults; ``empty`` tunes clouds without a line; ``matrix``
runs the file tuned on each cloud on all others; ``speed`` takes a map of two million points on two
cores, and compares processes with threads.  ``--write`` puts the tables into docs/tuning.md.  The
exit code is 0 if all floors are kept, 1 if one is missed.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
import math
from pathlib import Path
import resource
import sys
import time

from common.surveys import make_map, open_cache
from common.tables import (
    at_least,
    at_most,
    Check,
    CHECK_COLUMNS,
    format_figure,
    render_table,
    replace_section,
)
import laspy
import numba
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import enter_frame, Pipeline
from plc_inspect.core.tuning.objective import measure_f1, Objective
from plc_inspect.core.tuning.parameters import put_values, SPACE, to_values
from plc_inspect.offline.commands.tuning_run import METHODS, SearchPlan, tune, Tuned
from plc_inspect.offline.commands.workers import NUM_WORKERS, Workers
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.results import Bool, Float64, PointClass
from plc_inspect.setting_names import describe, update

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / 'shared/data/real'
PARTS = ('recovery', 'empty', 'matrix', 'speed')
RECOVERED = ('high_voltage', 'low_voltage', 'ahn_12BZ1_21')
CROSSED = (
    'high_voltage', 'medium_voltage', 'low_voltage', 'bundles', 'contact', 'valley', 'hidden',
    'angle', 'ahn_12BZ1_21', 'oakland_part3_an',
)
EMPTY = (
    'no_line', 'town', 'oakland_part2_ad', 'oakland_part3_aj', 'forest_mixedconifer_no_wires',
    'forest_bcts_1_no_wires',
)
NUM_SPEED = 2_000_000
LEAST_FACTOR, GREATEST_FACTOR = 1.5, 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """One cloud with the labels of its points."""

    name: str
    points: Float64
    wire: Bool
    left_out: Bool

    def rate(self, settings: Settings) -> float:
        """Return F1 of the wire points."""
        points = enter_frame(self.points)[0]
        found = Pipeline(settings).find_lines(points).spans.line_id >= 0
        return measure_f1(found, self.wire, self.left_out)


def load(name: str, arguments: argparse.Namespace, cache: Path) -> Case | None:
    """Return a simulated or real cloud, None where it is not there."""
    path = arguments.real / f'{name}.laz'
    if path.is_file():
        label = np.array(laspy.read(path).classification)
        points = read_cloud(path).points
    elif name in (*EMPTY[2:], 'ahn_12BZ1_21', 'oakland_part3_an'):
        print(f'skipped: there is no {path}', file=sys.stderr)
        return None
    else:
        survey = make_map(cache, name, density=arguments.density)
        points, label = survey.points, survey.truth.labels
    return Case(name=name, points=points, wire=label == PointClass.WIRE, left_out=label == 0)


def spoil(kind: str) -> Settings:
    """
    Return defaults with each of Table 1 moved by a factor of 1.5 to 2.

    ``strict`` and ``loose`` move all the same way by 2; a number is the seed of factors and
    directions drawn at random.  What leaves the range of a setting is put at its end.
    """
    rng = np.random.default_rng(0 if kind in ('strict', 'loose') else int(kind))
    strict = {'height.beta', 'linearity.threshold', 'clustering.min_points', 'height.num_bins'}
    meta = {name: item for name, _, item in describe()}
    changes = {}
    for item in SPACE:
        if kind in ('strict', 'loose'):
            factor = 2.0 if (item.name in strict) == (kind == 'strict') else 0.5
        else:
            factor = rng.uniform(LEAST_FACTOR, GREATEST_FACTOR)
            factor = factor if rng.random() < 0.5 else 1.0 / factor
        low, high = meta[item.name]['low'], meta[item.name]['high']
        value = min(max(item.initial * factor, low), high)
        changes[item.name] = round(value) if item.is_whole else value
    return update(Settings(), changes)


def recover(cases: Sequence[Case], kinds: Sequence[str]) -> tuple[str, list[Check]]:
    """Return the table of recoveries and its checks."""
    rows, checks = [], []
    for case in cases:
        default = case.rate(Settings())
        for kind in kinds:
            settings = spoil(kind)
            row = [case.name, kind, format_figure(default, 4),
                   format_figure(case.rate(settings), 4)]
            number = {}
            for method in METHODS:
                tuned = run(case, settings, method)
                f1 = case.rate(tuned.settings)
                number[method] = tuned.num_evaluations
                row += [format_figure(f1, 4), f'{tuned.num_evaluations}']
                checks.append(at_least(
                    f'{case.name}, {kind}', f'F1 beyond the defaults, {method}', f1 - default,
                    -0.01,
                ))
            checks.append(at_most(
                f'{case.name}, {kind}', 'evaluations of evolution by those of the grid',
                number['evolution'] / number['grid'], 0.5,
            ))
            rows.append(row)
            print(*row, file=sys.stderr, flush=True)
    table = render_table(
        ('cloud', 'spoiled', 'F1 of defaults', 'spoiled', 'grid', 'evaluations', 'evolution',
         'evaluations'), rows,
    )
    return table, [worst(checks, measure) for measure in dict.fromkeys(
        check.measure for check in checks)]


def worst(checks: Sequence[Check], measure: str) -> Check:
    """Return the check of one measure that comes nearest to its limit."""
    own = [check for check in checks if check.measure == measure]
    return min(own, key=lambda check: (
        check.value - check.limit[0] if math.isfinite(check.limit[0])
        else check.limit[1] - check.value
    ))


def run(case: Case, settings: Settings, method: str = 'evolution') -> Tuned:
    """Tune on one cloud without labels."""
    return tune(case.points, settings, SearchPlan(method=method))


def cross(cases: Sequence[Case]) -> tuple[str, list[Check]]:
    """Return F1 of the settings tuned on each cloud on all clouds, and the checks."""
    default = [case.rate(Settings()) for case in cases]
    rows = [['defaults', *(format_figure(value) for value in default)]]
    checks = []
    for case in cases:
        settings = run(case, Settings()).settings
        f1 = [other.rate(settings) for other in cases]
        rows.append([case.name, *(format_figure(value) for value in f1)])
        gain = [now - was for now, was in zip(f1, default, strict=True)]
        least = int(np.argmin(gain))
        checks.append(at_least(
            case.name, 'F1 beyond the defaults, on any cloud', gain[least], -0.02,
            remark=f'on {cases[least].name}',
        ))
        print(*rows[-1], file=sys.stderr, flush=True)
    table = render_table(('tuned on, run on', *(case.name for case in cases)), rows)
    return table, [worst(checks, 'F1 beyond the defaults, on any cloud')]


def try_empty(cases: Sequence[Case]) -> tuple[str, list[Check]]:
    """Return what tuning of clouds without a line says, and the checks."""
    rows, checks = [], []
    for case in cases:
        number = []
        for method in METHODS:
            tuned = run(case, Settings(), method)
            number.append(f'{tuned.num_evaluations}, {tuned.after.num_spans} spans')
            checks.append(at_most(case.name, 'files made where there is no line',
                                  float(tuned.is_line), 0.0))
        rows.append([case.name, f'{len(case.points)}', *number])
        print(*rows[-1], file=sys.stderr, flush=True)
    table = render_table(('cloud', 'points', 'grid', 'evolution'), rows)
    return table, [worst(checks, 'files made where there is no line')]


def time_all(cache: Path) -> tuple[str, list[Check]]:
    """Return wall times on a map of two million points, and the checks."""
    points = make_map(cache, 'high_voltage', num_points=NUM_SPEED).points
    Pipeline().run(points[:200_000])  # compiles, or loads what is compiled
    rows, checks = [], []
    for kind in ('1', 'strict'):
        for method in METHODS:
            started, cores = time.perf_counter(), _measure_cores()
            tuned = tune(points, spoil(kind), SearchPlan(method=method))
            seconds, cores = time.perf_counter() - started, _measure_cores() - cores
            rows.append([
                method, kind, f'{tuned.num_evaluations}', f'{seconds:.1f}', f'{cores:.1f}',
            ])
            checks.append(at_most(f'{method}, {kind}', 'wall time', seconds, 60.0, 's'))
            print(*rows[-1], file=sys.stderr, flush=True)
    table = render_table(
        ('method', 'spoiled', 'evaluations', 'time [s]', 'of all cores [s]'), rows)
    return '\n\n'.join([table, compare_workers(points)]), [worst(checks, 'wall time')]


def _measure_cores() -> float:
    """Return the processor time of this process and of workers that have ended [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def compare_workers(points: Float64) -> str:
    """Return the times of the same evaluations in one process, in threads and in processes."""
    rng = np.random.default_rng(0)
    choices = [
        put_values(Settings(), to_values(0.3 * rng.random(len(SPACE)) + 0.2)) for _ in range(16)
    ]
    seconds = {}
    alone = Objective(points)
    alone.score(choices[0])
    started = time.perf_counter()
    for settings in choices:
        alone.score(settings)
    seconds['one process, kernels on both cores'] = time.perf_counter() - started
    with ThreadPoolExecutor(NUM_WORKERS, initializer=numba.set_num_threads, initargs=(1,)) as pool:
        started = time.perf_counter()
        list(pool.map(alone.score, choices))
        seconds['two threads'] = time.perf_counter() - started
    with Workers(points, 0, num_workers=NUM_WORKERS) as workers:
        list(workers.evaluate(choices[:NUM_WORKERS]))
        started = time.perf_counter()
        list(workers.evaluate(choices))
        seconds['two processes, once they run'] = time.perf_counter() - started
    return render_table((f'{len(choices)} evaluations', 'time [s]'), [
        [name, f'{value:.1f}'] for name, value in seconds.items()
    ])


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of this command."""
    parser = argparse.ArgumentParser(description='Tuning without labels.')
    parser.add_argument('--parts', nargs='+', choices=PARTS, default=PARTS)
    parser.add_argument('--clouds', nargs='+', metavar='NAME', help='instead of those of a part')
    parser.add_argument(
        '--spoiled', nargs='+', default=['strict', 'loose', '1', '2'], metavar='KIND',
        help='strict, loose, or seeds',
    )
    parser.add_argument('--density', type=float, default=20.0, help='of the simulated maps')
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep simulated surveys here')
    parser.add_argument('--real', type=Path, metavar='DIR', default=REAL)
    parser.add_argument('--write', action='store_true', help='into docs')
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench; return 0 if all floors are kept, 1 if one is missed."""
    arguments = build_parser().parse_args(argv)
    checks: list[Check] = []
    with open_cache(arguments.cache) as cache:
        for part in arguments.parts:
            names = arguments.clouds or {
                'recovery': RECOVERED, 'empty': EMPTY, 'matrix': CROSSED}.get(part, ())
            found = [load(name, arguments, cache) for name in names if part != 'speed']
            cases = [case for case in found if case is not None]
            if part == 'recovery':
                table, own = recover(cases, arguments.spoiled)
            elif part == 'empty':
                table, own = try_empty(cases)
            elif part == 'matrix':
                table, own = cross(cases)
            else:
                table, own = time_all(cache)
            checks += own
            page = '\n\n'.join([
                table, render_table(CHECK_COLUMNS, (check.row() for check in own)),
            ])
            print(f'{part}\n\n{page}\n', flush=True)
            if arguments.write:
                replace_section(ROOT / 'docs/tuning.md', part, page)
    missed = [check for check in checks if not check.passed]
    print(f'{len(checks) - len(missed)} of {len(checks)} floors kept')
    return 1 if missed else 0


if __name__ == '__main__':
    sys.exit(main())
