# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Search for the best settings: grids from coarse to fine (paper), or evolution (CMA-ES)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import itertools
import warnings

import cma
import numpy as np
from scipy.stats import qmc

from plc_inspect.core.tuning.objective import NOTHING, Score
from plc_inspect.core.tuning.parameters import SPACE, STAGES, to_places, to_values, Values

Evaluate = Callable[[Sequence[Values]], Iterable[Score]]
"""Returns the scores of several choices of values, in order; may compute in parallel."""
Tell = Callable[[str], None]
"""Called with one line of text for each step that moved a parameter."""

COARSE = 5
"""
Values of each parameter in the coarse grid, from bound to bound.
Source: judgement; not measured.
"""
NUM_FINE = 2
"""
Number of finer grids about the best values, each with half the step of the one before.
Source: judgement; not measured.
"""
GRID_BUDGET = 200
"""
Greatest number of evaluations of a grid search.
Source: judgement; searches on bench/tuning.py take up to 180 (docs/tuning.md).
"""
EVOLUTION_BUDGET = 56
"""
Greatest number of evaluations of an evolution.
Source: judgement; bench/tuning.py recovers all spoiled settings in it (docs/tuning.md).
"""
POPULATION = 8
"""Choices per generation.  Source: judgement; not measured."""
SIGMA = 0.25
"""
Initial standard deviation of the evolution, as a share of the range of each parameter.
Source: documentation of `cma`: a quarter of the search domain's width.
"""
LEAST_GAIN = 1e-4
"""Least gain of score that counts.  Source: judgement; not measured."""
NUM_SCOUTS = 32
"""Choices tried if the start finds nothing.  Source: judgement; not measured."""
SCOUTS_AT_ONCE = 4
"""Choices of them that are tried together.  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Result of a search."""

    values: Values
    score: Score
    start: Score
    """Score of the initial values."""
    num_evaluations: int


class Spent(Exception):
    """The budget is spent."""


class Ledger:
    """All evaluations of one search; none is repeated, and the best is kept."""

    def __init__(self, evaluate: Evaluate, budget: int, start: Values) -> None:
        """Begin with the function that evaluates, the budget and the initial values."""
        self._evaluate = evaluate
        self._known: dict[Values, Score] = {}
        self.budget = budget
        self.values = start
        self.start = self.score = NOTHING

    @property
    def num_evaluations(self) -> int:
        """Evaluations so far."""
        return len(self._known)

    def begin(self) -> None:
        """Evaluate the initial values."""
        self.start = self.score = self.rate([self.values])[0]

    def rate(self, choices: Sequence[Values]) -> list[Score]:
        """
        Return the scores of several choices, and keep the best.

        Raises
        ------
        Spent
            The budget does not suffice; the evaluations that it allows are made and kept.

        """
        new = [item for item in dict.fromkeys(choices) if item not in self._known]
        paid = new[: max(self.budget - len(self._known), 0)]
        if paid:
            for values, score in zip(paid, self._evaluate(paid), strict=True):
                self._known[values] = score
                if score.value > self.score.value + LEAST_GAIN:
                    self.values, self.score = values, score
        if len(paid) < len(new):
            raise Spent
        return [self._known[item] for item in choices]

    def found(self) -> Found:
        """Return the best so far."""
        return Found(values=self.values, score=self.score, start=self.start,
                     num_evaluations=self.num_evaluations)


def search_grid(ledger: Ledger, tell: Tell) -> Found:
    """
    Search by grids from coarse to fine, over the parameters of each stage together.

    Stages are searched in their order, so that the grid of a later one reuses the results of those
    before it.  The coarse grid extends from bound to bound; each finer one lies about the best
    values so far, with half the step.

    Parameters
    ----------
    ledger : Ledger
        Holds the start and the budget.
    tell : callable
        Called with a line for each grid that moved a parameter.

    Returns
    -------
    Found

    """
    names = [item.name for item in SPACE]
    blocks = [[names.index(name) for name in stage] for stage in STAGES]
    step = 1.0 / (COARSE - 1)
    try:
        _scout(ledger, tell)
        _sweep(ledger, blocks, _spread, 'coarse', tell)
        for level in range(NUM_FINE):
            step /= 2.0
            _sweep(ledger, blocks, lambda at, step=step: _about(at, step),  # type: ignore[misc]
                   f'fine {level + 1}', tell)
    except Spent:
        tell(f'the search ends after {ledger.budget} evaluations')
    return ledger.found()


def search_evolution(ledger: Ledger, rng: np.random.Generator, tell: Tell) -> Found:
    """
    Search by evolution of the covariance matrix (CMA-ES, Hansen 2016).

    Each parameter runs from 0 to 1 between its bounds, on its own scale.

    Parameters
    ----------
    ledger : Ledger
        Holds the start and the budget.
    rng : numpy.random.Generator
        Draws every generation.
    tell : callable
        Called with a line for each generation that found better values.

    Returns
    -------
    Found

    """
    try:
        _scout(ledger, tell)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # the options are intended
            strategy = cma.CMAEvolutionStrategy(
                to_places(ledger.values), SIGMA,
                {
                    'bounds': [0.0, 1.0], 'popsize': POPULATION, 'verbose': -9, 'verb_log': 0,
                    'randn': lambda *shape: rng.standard_normal(shape), 'seed': np.nan,
                },
            )
        generation = 0
        while not strategy.stop():
            generation += 1
            before, values = ledger.score, ledger.values
            places = strategy.ask()
            scores = ledger.rate([to_values(place) for place in places])
            strategy.tell(places, [-score.value for score in scores])
            _report(ledger, f'generation {generation}', values, before, tell)
    except Spent:
        tell(f'the search ends after {ledger.budget} evaluations')
    return ledger.found()


def _scout(ledger: Ledger, tell: Tell) -> None:
    """Try choices spread evenly between all bounds if the start finds nothing."""
    values, before = ledger.values, ledger.score
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # the number is no power of two
        places = qmc.Sobol(len(SPACE), scramble=False).random(NUM_SCOUTS + 1)[1:]
    for first in range(0, NUM_SCOUTS, SCOUTS_AT_ONCE):
        if ledger.score.value > 0.0:
            break
        ledger.rate([to_values(place) for place in places[first : first + SCOUTS_AT_ONCE]])
    _report(ledger, 'the start finds nothing', values, before, tell)


def _sweep(
    ledger: Ledger,
    blocks: Sequence[Sequence[int]],
    choose: Callable[[float], list[float]],
    title: str,
    tell: Tell,
) -> None:
    """Search the grid of each stage in turn."""
    for block in blocks:
        values, before = ledger.values, ledger.score
        places = to_places(values)
        choices = []
        for combination in itertools.product(*(choose(float(places[k])) for k in block)):
            new = places.copy()
            new[list(block)] = combination
            choices.append(_keep_others(to_values(new), values, block))
        ledger.rate(choices)
        _report(ledger, title, values, before, tell)


def _keep_others(values: Values, old: Values, block: Sequence[int]) -> Values:
    """Return the old values with those of a block replaced; the others are not rounded."""
    return tuple(
        value if k in block else kept
        for k, (value, kept) in enumerate(zip(values, old, strict=True))
    )


def _spread(at: float) -> list[float]:
    return sorted({at, *np.linspace(0.0, 1.0, COARSE).tolist()})


def _about(at: float, step: float) -> list[float]:
    return sorted({min(max(at + k * step, 0.0), 1.0) for k in (-1, 0, 1)})


def _report(ledger: Ledger, title: str, old: Values, before: Score, tell: Tell) -> None:
    """Report which parameters moved, and why."""
    moved = [
        f'{item.name} {was:g} -> {now:g}'
        for item, was, now in zip(SPACE, old, ledger.values, strict=True) if was != now
    ]
    if moved:
        tell(
            f'{title}: {", ".join(moved)}; score {before.value:.4f} ->'
            f' {ledger.score.value:.4f}: {ledger.score.explain(before)}'
        )
