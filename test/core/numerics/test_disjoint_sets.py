# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sets by pairs, and pairs that stay apart; random ones against scipy in test_near_pairs."""

import numpy as np
import pytest

from plc_inspect.core.numerics.disjoint_sets import unite


def test_sets_are_numbered_by_their_first_items():
    assert unite([(4, 1), (3, 0), (3, 5)], 6).tolist() == [0, 1, 2, 0, 1, 0]
    assert unite(np.array([(1, 2), (2, 1), (1, 1)], np.int32), 3).tolist() == [0, 1, 1]


@pytest.mark.parametrize('num', [0, 1, 3])
def test_without_pairs_each_is_a_set(num):
    found = unite([], num)
    assert found.dtype == np.int64
    assert found.tolist() == list(range(num))


def test_what_is_apart_never_shares_a_set():
    assert unite([(0, 1), (1, 2), (2, 3)], 4, [(0, 2)]).tolist() == [0, 0, 1, 1]
    assert unite([(1, 2), (2, 3), (0, 1)], 4, [(3, 0)]).tolist() == [0, 1, 1, 1]


def test_the_earlier_pair_wins():
    assert unite([(0, 1), (1, 2)], 3, [(0, 2)]).tolist() == [0, 0, 1]
    assert unite([(1, 2), (0, 1)], 3, [(0, 2)]).tolist() == [0, 1, 1]


@pytest.mark.parametrize('seed', range(20))
def test_apart_by_brute_force(seed):
    rng = np.random.default_rng(seed)
    pairs, apart = rng.integers(0, 30, (25, 2)), rng.integers(0, 30, (6, 2))
    apart = apart[apart[:, 0] != apart[:, 1]]
    sets = [{item} for item in range(30)]
    for first, second in pairs:
        a, b = (next(own for own in sets if item in own) for item in (first, second))
        if a is not b and not any({c, d} <= a | b for c, d in apart.tolist()):
            a |= b
            sets.remove(b)
    number = {item: min(own) for own in sets for item in own}
    expected = np.unique([number[item] for item in range(30)], return_inverse=True)[1]
    assert unite(pairs, 30, apart).tolist() == expected.tolist()
