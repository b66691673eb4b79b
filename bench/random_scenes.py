# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Random scenes with the defaults of the pipeline: what is found of them, and where it fails.

Each seed gives a scene, its survey and its truth (``plc_simulate random``).  A conductor-span
counts if 10 m of it lie in the survey and it was seen over 60 % of them; its labelled share is
that of its points that are called wire.  The ten worst seeds are drawn if a folder is given.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
import math
from multiprocessing import get_context
from pathlib import Path
import sys
import time

from common.scene_pictures import draw
from common.tables import render_table
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.errors import PlcInspectError
from plc_inspect.results import InspectionResult, PointClass
from plc_inspect.sim.evaluation.estimate import from_result
from plc_inspect.sim.evaluation.evaluate import evaluate, MIN_SEEN
from plc_inspect.sim.evaluation.matching import match_spans, measure_sag_error
from plc_inspect.sim.evaluation.reference import parse_truth
from plc_inspect.sim.random_scenes.scenes import KINDS
from plc_inspect.sim.random_scenes.truth import make_random, RandomScene

LABELLED = 0.99
"""A conductor-span is whole if this share of its points is called wire."""
SHORTEST = 10.0
"""A conductor-span of which less lies in the survey does not count [m]."""
INTERVAL = 1.96
"""Half of a 95 % interval [standard deviations]."""
DENSE = 20.0
"""The floors for all conductors hold for maps of this many points per square metre and more."""
NUM_WORST = 10
VALLEY = 'valley'
"""Kind of a scene of which nothing was seen but lines and their towers."""
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one seed gave."""

    seed: int
    text: str
    """What the survey and the scene are."""
    num_points: int
    density: float
    """Points per square metre."""
    f1: float
    """Of wire points, NaN without wires."""
    shares: tuple[float, ...]
    """Labelled share of each conductor-span that counts."""
    clean: tuple[bool, ...]
    """Which of them are clean."""
    required: int
    found: int
    """Of the required spans."""
    false: int
    failure: str
    """Why there is no result, '' where there is one; two spans of one number are such a reason."""
    scaled: tuple[float, ...]
    """Errors of the sags of the found spans [standard deviations]."""
    seconds: float
    """Of the pipeline."""

    @property
    def rank(self) -> tuple[float, int]:
        """Sorts the worst first."""
        if math.isnan(self.f1):
            return 0.0 if self.failure else 1.0 / (1 + self.false), -self.false
        return self.f1, -self.false


def make(seed: int, kind: str) -> RandomScene:
    """Return a scene; of a valley, that of ``any`` of which the lines alone were seen."""
    if kind != VALLEY:
        return make_random(seed, kind)
    made = make_random(seed, 'any')
    seen = np.isin(made.cloud.label, (PointClass.WIRE, PointClass.TOWER))
    return replace(made, cloud=made.cloud.take(seen))


def run(made: RandomScene) -> tuple[InspectionResult, float]:
    """Return what the pipeline finds with its defaults, and how long it takes [s]."""
    started = time.perf_counter()
    result = Pipeline(Settings()).run(made.cloud.points)
    return result, time.perf_counter() - started


def judge(seed: int, made: RandomScene, result: InspectionResult, seconds: float) -> Outcome:
    """Compare a result with the truth of its scene."""
    truth = parse_truth(made.truth, made.cloud.label)
    survey = from_result(result, made.cloud.points)
    scores, matches = evaluate(survey, truth), match_spans(truth, survey)
    called = result.classification == PointClass.WIRE
    conductor = made.cloud.conductor
    counted = list_counted(made)
    return Outcome(
        seed=seed, text=made.text, num_points=len(conductor),
        density=len(conductor) / made.scene.area,
        f1=scores.wire.f1 if made.truth['spans'] else math.nan,
        shares=tuple(float(called[conductor == k].mean()) for k in counted),
        clean=tuple(bool(made.truth['spans'][k]['clean']) for k in counted),
        required=scores.spans.required, found=scores.spans.required_found,
        false=scores.spans.false, failure='',
        scaled=tuple(
            measure_sag_error(truth.spans[m.truth], survey.spans[m.found])
            / max(result.spans[m.found].sigma_sag, 1e-9) for m in matches.matches
        ),
        seconds=seconds,
    )


def list_counted(made: RandomScene) -> list[int]:
    """Return the numbers of the conductor-spans that count."""
    return [
        k for k, row in enumerate(made.truth['spans'])
        if row['seen'] >= MIN_SEEN * row['covered'] and row['covered'] * row['length'] >= SHORTEST
    ]


def give_up(seed: int, made: RandomScene, failure: str) -> Outcome:
    """Return the outcome of a scene of which there is no result: nothing is found."""
    rows, counted = made.truth['spans'], list_counted(made)
    return Outcome(
        seed=seed, text=made.text, num_points=len(made.cloud.points),
        density=len(made.cloud.points) / made.scene.area, f1=0.0 if rows else math.nan,
        shares=(0.0,) * len(counted), clean=tuple(bool(rows[k]['clean']) for k in counted),
        required=sum(row['seen'] >= MIN_SEEN for row in rows), found=0, false=0, scaled=(),
        failure=failure, seconds=math.nan,
    )


def try_seed(seed: int, kind: str) -> Outcome:
    """Make, run and judge one seed."""
    made = make(seed, kind)
    try:
        result, seconds = run(made)
    except PlcInspectError as error:
        return give_up(seed, made, str(error))
    return judge(seed, made, result, seconds)


def run_all(seeds: Sequence[int], kind: str, jobs: int) -> Iterator[Outcome]:
    """Yield the outcomes of seeds in their order."""
    if jobs == 1:
        yield from (try_seed(seed, kind) for seed in seeds)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context('spawn')) as pool:
        yield from pool.map(try_seed, seeds, [kind] * len(seeds))


def describe(item: Outcome) -> tuple[str, ...]:
    """Return the row of one seed."""
    whole = sum(share >= LABELLED for share in item.shares)
    clean = [share >= LABELLED for share, is_clean in zip(item.shares, item.clean, strict=True)
             if is_clean]
    return (
        f'{item.seed}', item.text, f'{item.num_points}', f'{item.density:.0f}',
        '' if math.isnan(item.f1) else f'{item.f1:.4f}', f'{whole}/{len(item.shares)}',
        f'{sum(clean)}/{len(clean)}', f'{item.found}/{item.required}', f'{item.false}',
        item.failure, f'{item.seconds:.1f}',
    )


COLUMNS = ('seed', 'scene', 'points', '/m2', 'wire F1', f'{LABELLED:.0%} labelled', 'clean ones',
           'spans', 'false', 'failure', '[s]')


def sum_up(items: Sequence[Outcome]) -> list[tuple[str, str]]:
    """Return the figures over all seeds, each with its name."""
    shares = np.array([share for item in items for share in item.shares])
    clean = np.array([value for item in items for value in item.clean], dtype=bool)
    rows = []
    for name, part in (('all', shares), ('clean', shares[clean])):
        if len(part):
            rows.append((
                f'conductor-spans, {name}',
                f'{(part >= LABELLED).sum()} of {len(part)} labelled over {LABELLED:.0%}'
                f' ({(part >= LABELLED).mean():.2%}), {(part == 0).sum()} not at all,'
                f' mean share {part.mean():.4f}',
            ))
    for name, chosen in (
        ('', items), (f', {DENSE:.0f} points/m2 and more',
                      [item for item in items if item.density >= DENSE]),
    ):
        required = sum(item.required for item in chosen)
        rows.append((f'spans{name}', (
            f'{sum(item.found for item in chosen)} of {required} found'
            f' ({sum(item.found for item in chosen) / max(required, 1):.2%}),'
            f' {sum(item.false for item in chosen)} false in'
            f' {sum(item.false > 0 for item in chosen)} of {len(chosen)} scenes'
        )))
        f1 = np.array([item.f1 for item in chosen if not math.isnan(item.f1)])
        if len(f1):
            rows.append((f'wire F1{name}', (
                f'mean {f1.mean():.4f}, worst twentieth'
                f' {np.sort(f1)[:math.ceil(len(f1) / 20)].mean():.4f}, quantiles '
                + ', '.join(f'{share:.0%} {np.quantile(f1, share):.4f}' for share in QUANTILES)
            )))
    scaled = np.array([value for item in items for value in item.scaled])
    if len(scaled):
        rows.append(('true sag in its 95 % interval',
                     f'{(scaled <= INTERVAL).mean():.2%} of {len(scaled)}'))
    rows.append(('scenes without a result, as where two spans carry one number',
                 f'{sum(bool(item.failure) for item in items)} of {len(items)}'))
    return rows


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds of 'A:B', B left out, or of 'A,B,C'."""
    if ':' in text:
        first, last = map(int, text.split(':'))
        return tuple(range(first, last))
    return tuple(map(int, text.split(',')))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the seeds and print the figures."""
    parser = argparse.ArgumentParser(description='The pipeline on random scenes.')
    parser.add_argument('--seeds', type=parse_seeds, default='0:40', metavar='A:B')
    parser.add_argument('--kind', choices=(*KINDS, VALLEY), default='any')
    parser.add_argument('--jobs', type=int, default=1, metavar='N')
    parser.add_argument('--pictures', type=Path, metavar='DIR', help='of the ten worst seeds')
    arguments = parser.parse_args(argv)
    items = []
    for item in run_all(arguments.seeds, arguments.kind, arguments.jobs):
        items.append(item)
        print(' | '.join(describe(item)), flush=True)
    print()
    for name, text in sum_up(items):
        print(f'{name}: {text}')
    worst = sorted(items, key=lambda item: item.rank)[:NUM_WORST]
    print(f'\nThe worst:\n\n{render_table(COLUMNS, [describe(item) for item in worst])}')
    if arguments.pictures is not None:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
        for item in worst:
            made = make(item.seed, arguments.kind)
            called = np.zeros(len(made.cloud.points), dtype=np.uint8)
            if not item.failure:
                called = run(made)[0].classification
            title = ', '.join(describe(item)[:6])
            draw(arguments.pictures / f'{arguments.kind}_{item.seed}.png', made, called, title)
    return 0


if __name__ == '__main__':
    sys.exit(main())
