# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from plc_inspect.core.numerics.plan_index import build_plan_index


def make_points(num=400, seed=0):
    return np.random.default_rng(seed).uniform((-20, -10, 0), (30, 25, 9), (num, 3))


def measure_plan_distance(points, segment):
    start, end = np.array(segment[:2]), np.array(segment[2:])
    run = end - start
    length = max(float(run @ run), 1e-300)
    t = np.clip((points[:, :2] - start) @ run / length, 0.0, 1.0)
    return np.linalg.norm(points[:, :2] - start - t[:, None] * run, axis=1)


def test_toy_case_by_hand():
    points = np.array([[0.0, 0, 5], [2.5, 0, 5], [2.6, 0, 5], [0.1, 3.0, 5]])
    index = build_plan_index(points, np.arange(4), 2.0)
    assert index.shape == (2, 2)
    assert index.origin.tolist() == [0, 0]
    assert index.start.tolist() == [0, 1, 3, 4, 4]
    assert index.order.tolist() == [0, 1, 2, 3]


def test_each_point_is_in_its_cell_once():
    points = make_points()
    index = build_plan_index(points, np.arange(400), 3.0)
    assert sorted(index.order.tolist()) == list(range(400))
    cell = np.floor((points[:, :2] - index.origin) / index.cell_size).astype(int)
    where = cell[:, 1] * index.shape[1] + cell[:, 0]
    for number in range(index.shape[0] * index.shape[1]):
        own = index.order[index.start[number]:index.start[number + 1]]
        assert own.tolist() == np.flatnonzero(where == number).tolist()


@given(
    st.tuples(*[st.floats(-40, 50)] * 4), st.floats(0.0, 12.0), st.floats(0.3, 6.0),
    st.booleans(),
)
@settings(max_examples=150, deadline=None)
def test_a_strip_holds_all_points_near_its_segment_once(segment, reach, cell, level):
    if level:
        segment = (*segment[:3], segment[1])
    points = make_points()
    index = build_plan_index(points, np.arange(400), cell)
    found = index.strip(segment[:2], segment[2:], reach)
    assert len(np.unique(found)) == len(found)
    distance = measure_plan_distance(points, segment)
    inside = np.flatnonzero(distance <= reach - 1e-9)
    assert np.isin(inside, found).all()
    # and none from far away: its cell touches the strip
    assert (distance[found] <= reach + 2 * cell).all()


def test_only_chosen_points_are_found():
    points = make_points()
    points[7] = np.nan
    chosen = np.array([3, 50, 399])
    index = build_plan_index(points, chosen, 2.0)
    assert sorted(index.order.tolist()) == chosen.tolist()


def test_a_wide_area_gets_larger_cells():
    points = np.array([[0.0, 0, 0], [1e6, 1e6, 0]])
    index = build_plan_index(points, np.arange(2), 1.0)
    assert index.shape[0] * index.shape[1] <= 1.01 * 16_000_000
    assert index.cell_size == pytest.approx(250.0)
    assert index.strip((1e6, 1e6), (1e6, 1e6), 1.0).tolist() == [1]


@pytest.mark.parametrize('num', [0, 1])
def test_few_points(num):
    index = build_plan_index(np.ones((num, 3)), np.arange(num), 2.0)
    assert index.order.shape == (num,)
    assert len(index.strip((0.0, 0.0), (2.0, 2.0), 1.0)) == num


def test_duplicates_and_input():
    points = np.ones((50, 3))
    before = points.copy()
    index = build_plan_index(points, np.arange(50), 2.0)
    assert index.order.tolist() == list(range(50))
    np.testing.assert_array_equal(points, before)


def test_utm_sized_coordinates():
    points = make_points()
    shift = np.array([5e5, 6.6e6, 0.0])
    near = build_plan_index(points, np.arange(400), 3.0)
    far = build_plan_index(points + shift, np.arange(400), 3.0)
    assert near.shape == far.shape
    np.testing.assert_array_equal(near.order, far.order)
