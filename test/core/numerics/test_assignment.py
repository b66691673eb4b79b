# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One-to-one pairs at the least cost, against all orders tried."""

import itertools

import numpy as np
import pytest

from plc_inspect.core.numerics.assignment import assign


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
