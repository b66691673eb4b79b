# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Pairs of near points and the sets they make, against scipy."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.core.numerics.near_pairs import find_pairs
from plc_inspect.errors import DataError


def list_pairs(points, reach):
    """Return the pairs in order."""
    pairs = find_pairs(points, reach)
    assert pairs.dtype == np.int32
    return pairs[np.lexsort(pairs.T[::-1])].tolist()


def test_toy_case_by_hand():
    points = np.array([[0.0, 0, 0], [3, 0, 0], [0, 0.9, 0], [0.0, 1.8, 0], [3, 1, 0.1]])
    assert list_pairs(points, 1.0) == [[0, 2], [2, 3]]
    assert list_pairs(points, 1.1) == [[0, 2], [1, 4], [2, 3]]
    assert unite(find_pairs(points, 1.1), 5).tolist() == [0, 1, 0, 0, 1]


@pytest.mark.parametrize('num', [0, 1])
def test_without_two_points_there_is_no_pair(num):
    assert find_pairs(np.ones((num, 3)), 1.0).shape == (0, 2)


def test_points_at_one_place_are_all_pairs():
    assert len(find_pairs(np.ones((50, 3)), 0.1)) == 50 * 49 // 2


@pytest.mark.parametrize(('extent', 'reach'), [
    ((8.0, 8.0, 8.0), 1.0), ((300.0, 2.0, 2.0), 2.5), ((2.0, 2.0, 90.0), 0.9),
    ((0.5, 0.5, 0.5), 3.0), ((40.0, 30.0, 0.0), 1.3),
])
@pytest.mark.parametrize('decimals', [1, 12])
def test_they_are_those_of_scipy(extent, reach, decimals):
    rng = np.random.default_rng(1)
    points = np.round(rng.random((700, 3)) * extent - 3.0, decimals)
    expected = cKDTree(points).query_pairs(reach + 1e-9, output_type='ndarray')
    pairs = find_pairs(points, reach + 1e-9)
    assert sorted(pairs.tolist()) == sorted(expected.tolist())
    graph = coo_matrix((np.ones(len(expected)), expected.T), shape=(700, 700))
    assert (unite(pairs, 700) == connected_components(graph, directed=False)[1]).all()


def test_the_reach_itself_is_near():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 1e-6]])
    assert list_pairs(points, 1.0) == [[0, 1]]


@pytest.mark.parametrize('extent', [2e5, 1e6])
def test_far_strays_take_no_pair_away(extent):
    rng = np.random.default_rng(2)
    points = rng.random((200, 3)) * extent
    points = np.vstack((points, points + 0.4, [[0.0, 0, 0], [extent] * 3]))
    expected = cKDTree(points).query_pairs(1.0, output_type='ndarray')
    assert list_pairs(points, 1.0) == sorted(expected.tolist())
    assert len(expected) >= 200


def test_points_too_far_apart_are_an_error_with_the_numbers():
    points = np.array([[0.0, 0, 0], [1e15, 1e15, 0]])
    with pytest.raises(DataError, match=r'1000000000000000\.0.*within 0\.5 m'):
        find_pairs(points, 0.5)
