# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tuning of one cloud from start to parameter file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np

import plc_inspect
from plc_inspect.config import Settings
from plc_inspect.core.tuning.objective import choose_part, is_line, Objective, Score
from plc_inspect.core.tuning.parameters import (
    get_value,
    get_values,
    put_values,
    RADIUS,
    settle_radius,
    SPACE,
    Values,
)
from plc_inspect.core.tuning.search import (
    EVOLUTION_BUDGET,
    GRID_BUDGET,
    Ledger,
    search_evolution,
    search_grid,
    Tell,
)
from plc_inspect.errors import DataError
from plc_inspect.interrupts import interruptible
from plc_inspect.offline.commands.command_line import Progress
from plc_inspect.offline.commands.workers import Workers
from plc_inspect.offline.readers.bag_map import accumulate
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.offline.readers.clouds import read_cloud, SUFFIXES
from plc_inspect.offline.readers.parameter_file import render_parameters
from plc_inspect.offline.terminal.result_table import format_number, format_table
from plc_inspect.results import Bool, Float64
from plc_inspect.setting_names import update

MOST_POINTS = 1_000_000
"""Most points searched; of a larger cloud, the part with most candidates of conductors."""
WORTH_CHANGING = 0.05
"""
Least gain in score, without labels, for settings that find a line to be changed: the choice of the
half alone moves the score of a sparse cloud by 0.02.
"""
METHODS = {'grid': GRID_BUDGET, 'evolution': EVOLUTION_BUDGET}


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPlan:
    """Method and budget of a search."""

    method: str = 'evolution'
    """One of METHODS."""
    budget: int | None = None
    """Most evaluations, by default those of the method."""
    seed: int = 0
    """Seed of all random choices."""
    num_workers: int | None = None
    """Processes, by default as many as pay."""

    @property
    def most_evaluations(self) -> int:
        """The budget, by default that of the method."""
        return self.budget or METHODS[self.method]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuned:
    """The result of a search, with scores before and after."""

    settings: Settings
    given: Settings
    before: Score
    """Of the settings given, on the whole cloud."""
    after: Score
    method: str
    seed: int
    num_evaluations: int
    num_points: int
    num_searched: int
    """Points that the search used."""
    with_truth: bool
    interrupted: bool

    @property
    def is_line(self) -> bool:
        """Whether the tuned settings find a line in the cloud."""
        return is_line(self.after)


def read_points(
    path: Path, settings: Settings, crs: str | None, progress: Progress
) -> Float64:
    """
    Read the points of a cloud or the map of a recording.

    Returns
    -------
    (N, 3) float64
        Coordinates [m]; rows may be NaN.

    Raises
    ------
    DataError
        The input cannot be read, or has fewer finite points than ``segment.min_points``.
    ConfigError
        The CRS is unknown.

    """
    progress('reading', 0.0)
    if path.suffix.lower() in SUFFIXES:
        points = read_cloud(path, crs).points
    else:
        topics = (settings.input.scan_topic, settings.input.odometry_topic)
        with Recording(path, *topics, settings.input) as recording:
            voxels = accumulate(
                recording, settings, lambda share: progress('reading', share)
            ).map
        points = voxels.centroids()[voxels.counts() >= settings.map.min_points]
    num_finite = int(np.isfinite(points).all(axis=1).sum())
    if num_finite < settings.segment.min_points:
        raise DataError(
            f'{path} has {num_finite} finite points of {len(points)}, fewer than'
            f' segment.min_points = {settings.segment.min_points}'
        )
    return points


def tune(
    points: Float64,
    settings: Settings,
    plan: SearchPlan | None = None,
    *,
    truth: tuple[Bool, Bool] | None = None,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Tuned:
    """
    Search the settings of Table 1 for one cloud.

    An interrupt ends the search; the best so far is returned.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    settings : Settings
        The start, and all that is not tuned.
    plan : SearchPlan or None
        How to search, by default as a SearchPlan does.
    truth : tuple of two (N,) bool or None
        Wire points, and those left out; the score is F1 then.
    progress : callable or None
        Called with the name of the step and its share.
    tell : callable or None
        Called with a line for each step that moved a parameter, and why.

    Returns
    -------
    Tuned

    """
    told = progress or (lambda step, share: None)
    say = tell or (lambda line: None)
    plan = plan or SearchPlan()
    budget = plan.most_evaluations
    whole = Objective(points, seed=plan.seed, truth=truth, base=settings, room=1)
    told('looking', 0.0)
    before = whole.score(settings)
    searched, own = points, truth
    part = choose_part(whole.points, whole.evidence, MOST_POINTS)
    if part is not None:
        searched = points[part]
        own = None if truth is None else (truth[0][part], truth[1][part])
        say(f'the search sees {len(searched):,} of {len(points):,} points, where most looks like'
            ' conductors')
    interrupted = False
    with Workers(searched, plan.seed, own, plan.num_workers, settings) as workers:
        done = 0

        def evaluate(choices: Sequence[Values]) -> Iterator[Score]:
            nonlocal done
            for score, _ in workers.evaluate([put_values(settings, item) for item in choices]):
                done += 1
                told(f'{plan.method} {done}', min(done / budget, 1.0))
                yield score

        ledger = Ledger(evaluate, budget, get_values(settings))
        try:
            with interruptible():
                ledger.begin()
                if plan.method == 'grid':
                    search_grid(ledger, say)
                else:
                    search_evolution(ledger, np.random.default_rng(plan.seed), say)
        except KeyboardInterrupt:
            interrupted = True
            say('interrupted: the best so far is kept')
        found = ledger.found()
    after, best = before, settings
    if found.values != get_values(settings) or not is_line(before):
        better = put_values(settings, found.values)
        score = whole.score(better)
        margin = WORTH_CHANGING if truth is None and is_line(before) else 0.0
        if score.value > before.value + margin:
            after, best = score, better
        elif score.value > before.value:
            say(f'the settings given are kept: {score.value - before.value:.4f} of score is less'
                f' than {WORTH_CHANGING:g}')
    if is_line(after):
        best = update(best, {RADIUS: settle_radius(best.corridor.radius, whole.lowest(best))})
    return Tuned(
        settings=best, given=settings, before=before, after=after, method=plan.method,
        seed=plan.seed, num_evaluations=found.num_evaluations, num_points=len(points),
        num_searched=len(searched), with_truth=truth is not None, interrupted=interrupted,
    )


def render_file(tuned: Tuned, source: str, checksum: str) -> str:
    """
    Return the parameter file: all of Table 1 and the other settings given.

    Parameters
    ----------
    tuned : Tuned
        The search.
    source : str
        Name of the input.
    checksum : str
        SHA-256 of the input.

    """
    default = Settings()
    names = [item.name for item in SPACE] + [RADIUS]
    what = 'F1 of the wire points' if tuned.with_truth else 'internal, without labels'
    head = [
        f'Made by plc_tune {plc_inspect.__version__} from {source}, {tuned.num_points} points,',
        f'SHA-256 {checksum}.',
        f'Method {tuned.method}, seed {tuned.seed}, {tuned.num_evaluations} evaluations on'
        f' {tuned.num_searched} points' + (', interrupted.' if tuned.interrupted else '.'),
        f'Score ({what}): {tuned.before.value:.4f} before, {tuned.after.value:.4f} after.',
        f'Spans: {tuned.before.num_spans} before, {tuned.after.num_spans} after.',
    ]
    return render_parameters(tuned.settings, default, names, head)


def render_tuned(tuned: Tuned, source: str) -> str:
    """Return the settings before and after, and the scores, as text."""
    names = [item.name for item in SPACE] + [RADIUS]
    table = format_table(('setting', 'before', 'after'), [
        [name, *(f'{get_value(settings, name):g}' for settings in (tuned.given, tuned.settings))]
        for name in names
    ])
    shares = [
        [name, *(format_number(getattr(score, name), 4) for score in (tuned.before, tuned.after))]
        for name in ('value', 'seen', 'fit', 'separation', 'stability', 'f1')
        if math.isfinite(getattr(tuned.after, name))
        and (name in ('value', 'f1') or not tuned.with_truth)
    ]
    spans = ['spans', str(tuned.before.num_spans), str(tuned.after.num_spans)]
    return (
        f'{source}: {tuned.num_points:,} points, {tuned.method},'
        f' {tuned.num_evaluations} evaluations\n\n{table}\n\n'
        + format_table(('score', 'before', 'after'), [*shares, spans])
    )
