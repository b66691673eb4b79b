# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Both searches, on scores worked by hand."""

import numpy as np
import pytest

from plc_inspect.core.tuning.objective import Score
from plc_inspect.core.tuning.parameters import INITIAL, SPACE, to_places, to_values
from plc_inspect.core.tuning.search import (
    EVOLUTION_BUDGET,
    GRID_BUDGET,
    Ledger,
    search_evolution,
    search_grid,
)

GOAL = to_values([0.6, 0.3, 0.7, 0.8, 0.2, 0.4, 0.5])
START = to_values([0.1, 0.9, 0.1, 0.2, 0.9, 0.9, 0.1])


class Hill:
    """Scores that fall with the distance from a goal, to nothing beyond ``reach``."""

    def __init__(self, reach=2.0):
        self.reach = reach
        self.asked = []

    def __call__(self, choices):
        self.asked += choices
        for values in choices:
            away = float(np.linalg.norm(to_places(values) - to_places(GOAL)))
            yield Score(value=max(1.0 - away / self.reach, 0.0), seen=away)


def start(hill, budget, values=START):
    ledger = Ledger(hill, budget, values)
    ledger.begin()
    return ledger


def search(method, ledger, tell=lambda line: None):
    if method == 'grid':
        return search_grid(ledger, tell)
    return search_evolution(ledger, np.random.default_rng(0), tell)


METHODS = [('grid', GRID_BUDGET), ('evolution', EVOLUTION_BUDGET)]


@pytest.mark.parametrize(('method', 'budget'), METHODS)
def test_both_climb_from_a_bad_start(method, budget):
    hill = Hill()
    found = search(method, start(hill, budget))
    assert found.score.value > 0.7
    assert found.score.value > found.start.value + 0.3
    assert found.num_evaluations == len(hill.asked) == len(set(hill.asked)) <= budget


@pytest.mark.parametrize(('method', 'budget'), METHODS)
def test_both_find_a_hill_that_the_start_does_not_see(method, budget):
    told = []
    found = search(method, start(Hill(reach=0.8), budget), told.append)
    assert found.start.value == 0.0
    assert found.score.value > 0.5
    assert told[0].startswith('the start finds nothing')


def test_evolution_takes_less_than_half_of_the_grid():
    grid, evolution = (search(method, start(Hill(), budget)) for method, budget in METHODS)
    assert 2 * evolution.num_evaluations <= grid.num_evaluations


def test_the_grid_says_what_moved_and_why():
    told = []
    found = search('grid', start(Hill(), GRID_BUDGET), told.append)
    text = '\n'.join(told)
    for item, was, now in zip(SPACE, START, found.values, strict=True):
        assert was == now or item.name in text
    assert 'coarse: height.num_bins' in told[0]
    assert 'seen' in told[0]
    assert any(line.startswith('fine 2') for line in told)


def test_the_grid_leaves_the_other_stages_as_they_are():
    hill = Hill()
    search('grid', start(hill, 20))
    assert len(hill.asked) == 20
    assert {values[2:] for values in hill.asked} == {START[2:]}


@pytest.mark.parametrize(('method', 'budget'), METHODS)
def test_flat_ground_is_left_where_it_is(method, budget):
    flat = Ledger(lambda choices: [Score(value=0.5) for _ in choices], budget, INITIAL)
    flat.begin()
    found = search(method, flat)
    assert found.values == INITIAL


@pytest.mark.parametrize('method', ['grid', 'evolution'])
def test_the_budget_is_kept_and_the_best_of_it(method):
    hill = Hill()
    found = search(method, start(hill, 30))
    assert found.num_evaluations == len(hill.asked) == 30
    assert found.score.value == max(score.value for score in Hill()(hill.asked))


def test_the_best_survives_an_interrupt_in_the_middle_of_a_batch():
    hill = Hill()

    def evaluate(choices):
        for score in hill(choices):
            if len(ledger._known) == 12:
                raise KeyboardInterrupt
            yield score

    ledger = Ledger(evaluate, GRID_BUDGET, START)
    ledger.begin()
    with pytest.raises(KeyboardInterrupt):
        search('grid', ledger)
    found = ledger.found()
    assert found.num_evaluations == 12
    assert found.score.value > found.start.value


def test_evolution_repeats_with_its_generator_and_leaves_the_global_one():
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    runs = [search('evolution', start(Hill(), 40)) for _ in range(2)]
    assert runs[0] == runs[1]
    np.testing.assert_array_equal(state, np.random.get_state()[1])  # noqa: NPY002
