# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One tree is one tree."""

import numpy as np
import pytest

from plc_inspect.core.hazards.trees import segment_trees


def make_cone(x, y, top, slope=1.5, radius=4.0, step=0.25):
    """Make the surface of a crown whose height falls by ``slope`` in a metre."""
    axis = np.arange(-radius, radius + step / 2, step)
    dx, dy = (part.ravel() for part in np.meshgrid(axis, axis))
    away = np.hypot(dx, dy)
    inside = away <= radius
    return np.column_stack([x + dx, y + dy, top - slope * away])[inside]


def test_two_crowns_with_a_deep_dip_are_two_trees_and_the_taller_comes_first():
    first, second = make_cone(0.0, 0.0, 12.0), make_cone(7.0, 0.0, 10.0)
    points = np.vstack([second, first])
    tree = segment_trees(points, points[:, 2])
    assert set(tree.tolist()) == {0, 1}
    assert tree[np.argmax(points[:, 2])] == 0
    assert (tree[: len(second)] == 1).mean() > 0.85
    assert (tree[len(second) :] == 0).mean() > 0.95


def test_a_shallow_dip_does_not_part_a_crown():
    points = np.vstack([make_cone(0.0, 0.0, 12.0, slope=0.3), make_cone(3.0, 0.0, 11.8, 0.3)])
    assert set(segment_trees(points, points[:, 2]).tolist()) == {0}


def test_what_does_not_touch_is_apart():
    points = np.vstack([make_cone(0.0, 0.0, 5.0), make_cone(40.0, 3.0, 5.0)])
    assert set(segment_trees(points, points[:, 2]).tolist()) == {0, 1}


def test_points_under_the_canopy_belong_to_the_tree_above():
    crown = make_cone(0.0, 0.0, 12.0)
    trunk = np.column_stack([np.zeros(20), np.zeros(20), np.linspace(0.0, 8.0, 20)])
    points = np.vstack([crown, trunk])
    assert set(segment_trees(points, points[:, 2]).tolist()) == {0}


def test_no_points_and_one_point():
    assert segment_trees(np.zeros((0, 3)), np.zeros(0)).tolist() == []
    assert segment_trees(np.zeros((0, 3)), np.zeros(0)).dtype == np.int64
    assert segment_trees(np.array([[5.0, -3.0, 2.0]]), np.array([2.0])).tolist() == [0]
    assert segment_trees(np.ones((4, 3)), np.ones(4)).tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize('shift', [(0.0, 0.0), (500_000.0, 5_600_000.0)])
def test_order_of_points_and_place_do_not_matter(shift):
    rng = np.random.default_rng(3)
    points = np.vstack([make_cone(x, y, top) for x, y, top in
                        ((0, 0, 12), (7, 1, 10), (2, 8, 9), (20, 0, 7))])
    height = points[:, 2].copy()
    before = points.copy()
    tree = segment_trees(points, height)
    assert (points == before).all()
    order = rng.permutation(len(points))
    moved = points[order] + np.array([*shift, 0.0])
    assert (segment_trees(moved, height[order]) == tree[order]).all()
