# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One-to-one pairs at the least cost, against all orders tried."""

import itertools

import numpy as np
import pytest

from plc_inspect.core.numerics.assignment import assign, pair_up


def test_each_has_its_own_nearest():
    cost = np.array([[0.1, 2.0, 5.0], [2.0, 0.2, 5.0]])
    assert assign(cost, 3.0) == [(0, 0), (1, 1)]
    assert assign(cost.T, 3.0) == [(0, 0), (1, 1)]


def test_one_gives_way_where_two_want_the_same():
    assert assign(np.array([[1.0, 2.0], [1.5, 4.0]]), 5.0) == [(0, 1), (1, 0)]


def test_many_pairs_come_before_near_ones():
    assert assign(np.array([[0.1, 5.0], [0.2, np.inf]])) == [(0, 1), (1, 0)]


def test_what_costs_too_much_is_no_pair_and_disturbs_none():
    assert assign(np.array([[0.5, 2.4], [2.6, 9.0]]), 2.5) == [(0, 0)]
    assert assign(np.array([[3.0, np.inf]]), 2.5) == []
    assert assign(np.full((4, 3), np.inf)) == []
    assert assign(np.zeros((0, 3))) == []


@pytest.mark.parametrize('seed', range(40))
def test_nothing_pairs_more_or_costs_less(seed):
    rng = np.random.default_rng(seed)
    cost = rng.random(rng.integers(1, 5, 2)) * 2
    pairs = assign(cost, 1.2)
    rows, columns = cost.shape
    assert pairs == sorted(pairs)
    assert len({i for i, _ in pairs}) == len({j for _, j in pairs}) == len(pairs)
    best = max(
        (sum(c <= 1.2 for c in chosen), -sum(c for c in chosen if c <= 1.2))
        for places in itertools.permutations(range(max(rows, columns)), rows)
        for chosen in [[cost[i, j] for i, j in enumerate(places) if j < columns]]
    )
    assert len(pairs) == best[0]
    assert sum(cost[i, j] for i, j in pairs) == pytest.approx(-best[1])


def try_all(pairs, cost, lone):
    """Return the least cost of all ways to pair, with what is left over."""
    things = {thing for pair in pairs for thing in pair}
    best = np.inf
    for num in range(len(pairs) + 1):
        for chosen in itertools.combinations(range(len(pairs)), num):
            used = [thing for k in chosen for thing in pairs[k]]
            if len(set(used)) == len(used):
                left = len(things) - len(used)
                best = min(best, sum(cost[k] for k in chosen) + left * lone / 2)
    return best


def test_pairs_of_one_kind_cost_least_together():
    rng = np.random.default_rng(4)
    for _ in range(40):
        # two sides of four things; lines of a rack, whose ends may take each other's
        every = np.array([(a, 4 + b) for a in range(4) for b in range(4)])
        pairs = every[rng.random(16) < 0.5]
        cost = np.sort(rng.uniform(0.0, 1.0, len(pairs)))
        chosen = pair_up(pairs, cost, 0.8)
        used = pairs[chosen].ravel()
        assert len(np.unique(used)) == len(used)
        assert chosen == sorted(chosen)
        cheap = [k for k in chosen if cost[k] < 0.8]
        left = len(np.unique(pairs)) - 2 * len(cheap)
        within = cost < 0.8
        lone = len(np.unique(pairs)) - len(np.unique(pairs[within]))
        least = try_all(pairs[within].tolist(), cost[within], 0.8) + lone * 0.4
        assert cost[cheap].sum() + left * 0.4 == pytest.approx(least)


def test_the_cheapest_pair_gives_way_where_it_leaves_two_alone():
    pairs = np.array([[1, 2], [0, 2], [1, 3]])
    assert pair_up(pairs, np.array([0.1, 0.2, 0.3]), 0.8) == [1, 2]
    assert pair_up(pairs, np.array([0.1, 0.5, 0.6]), 0.8) == [0]


def test_dear_pairs_are_made_of_what_is_left():
    assert pair_up(np.array([[0, 1], [1, 2], [2, 3]]), np.array([0.1, 0.9, 2.0]), 0.8) == [0, 2]


def test_three_that_may_all_pair_are_taken_cheapest_first():
    pairs = np.array([[0, 1], [1, 2], [2, 0], [2, 3]])
    assert pair_up(pairs, np.array([0.1, 0.2, 0.3, 0.4]), 0.8) == [0, 3]


def test_no_pairs_to_choose_from():
    assert pair_up(np.zeros((0, 2), dtype=np.int64), np.zeros(0), 0.8) == []
