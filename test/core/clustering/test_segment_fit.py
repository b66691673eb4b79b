# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.clustering.segment_fit import (
    fit_trimmed,
    judge_clusters,
    measure_crowding,
    measure_filling,
)

HALF = 10.0


def members(x):
    return np.ones(len(x), dtype=bool)


def make_segment(low=-HALF, high=HALF, num=81, y=0.0, w=0.0):
    """Make the points of a straight conductor in a window."""
    x = np.linspace(low, high, num)
    return np.column_stack([x, np.full(num, y), np.full(num, w)])


def make_sheet(low=-6.0, high=6.0):
    """Make a sheet of a point each 0.1 m along and 0.02 m across, about the axis."""
    x, y = np.meshgrid(np.arange(low, high, 0.1) + 0.05, np.arange(-25, 26) * 0.02)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def crowd(points, low=-6.0, high=6.0):
    """Measure the crowding of the axis of the window."""
    apart = np.zeros(len(points), dtype=bool)
    return measure_crowding(*points.T.copy(), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, low, high, apart)


def judge(*clusters, limit=0.1, max_crowding=0.5, noise=(), room=4):
    """Judge some clusters, and tell the owners and thick points cluster by cluster."""
    points = np.vstack([np.zeros((0, 3)), *clusters, *noise])
    own = [len(cluster) for cluster in clusters]
    label = np.full(len(points), -1)
    label[: sum(own)] = np.repeat(np.arange(len(clusters)), own)
    owner, too_thick = np.full(len(points), -1), np.ones(len(points), dtype=bool)
    fits = np.full((room, 8), np.nan)
    found = judge_clusters(
        *points.T.copy(), np.arange(len(points)), label, limit, HALF, max_crowding,
        owner, too_thick, fits, 0,
    )
    parts = np.cumsum(own)
    return found, np.split(owner, parts), np.split(too_thick, parts), fits


def test_a_line_is_fitted_exactly():
    x = np.arange(5.0)
    fit = fit_trimmed(x, 1.0 + 0.5 * x, 2.0 - 0.25 * x, members(x))
    assert fit == pytest.approx((2.0, 2.0, 1.5, 0.5, -0.25, 0.0, 0.0, 4.0), abs=1e-9)


def test_the_rms_is_of_both_directions():
    x = np.array([0.0, 0.0, 1.0, 1.0])
    side = np.array([-1.0, 1.0, -1.0, 1.0])
    assert fit_trimmed(x, 0.03 * side, 0.04 * side, members(x))[5] == pytest.approx(0.05)


def test_what_lies_far_off_is_dropped_and_does_not_count():
    x = np.arange(21.0)
    y = 0.1 * x
    y[10] += 1.0
    member = members(x)
    fit = fit_trimmed(x, y, np.zeros(21), member)
    assert np.flatnonzero(~member).tolist() == [10]
    assert fit == pytest.approx((10.0, 1.0, 0.0, 0.1, 0.0, 0.0, 0.0, 20.0), abs=1e-9)


@pytest.mark.parametrize('num', [0, 1, 3])
def test_fewer_than_four_points_are_not_fitted(num):
    x = np.arange(1.0, num + 1.0)
    assert fit_trimmed(x, x, x, members(x)) == (0.0,) * 8


def test_the_filling_is_the_share_of_metres_that_hold_members():
    x = np.array([0.2, 0.8, 1.5, 2.5, 4.0])
    assert measure_filling(x, members(x), 0.0, 4.0, 6.0) == 1.0
    assert measure_filling(x, np.array([True, True, True, False, True]), 0.0, 4.0, 6.0) == 0.75
    assert measure_filling(x, ~members(x), 0.0, 4.0, 6.0) == 0.0


def test_parts_are_as_much_longer_as_the_window():
    x = np.arange(36) + 0.5
    some = x % 3 == 0.5  # one metre in three
    assert measure_filling(x, some, 0.0, 36.0, 6.0) == pytest.approx(1 / 3)
    assert measure_filling(x, some, 0.0, 36.0, 18.0) == 1.0
    assert measure_filling(x, some, 0.0, 36.0, 2.0) == pytest.approx(1 / 3)  # a metre at least


def test_a_wire_in_the_air_is_not_crowded_but_a_strip_of_a_sheet_is():
    assert crowd(make_segment(-6.0, 6.0)) == 0.0
    assert crowd(make_sheet()) == 1.0


def test_the_crowding_is_counted_by_parts_of_three_metres():
    assert crowd(np.vstack([make_segment(-6.0, 6.0), make_sheet(-6.0, -3.0)])) == 0.25


def test_each_line_is_a_segment_of_its_own():
    found, owner, too_thick, fits = judge(
        make_segment(y=-3.0), make_segment(y=3.0, w=1.0), noise=[make_segment(y=6.0)]
    )
    assert found == 2
    assert [np.unique(part).tolist() for part in owner] == [[0], [1], [-1]]
    assert not np.concatenate(too_thick).any()
    np.testing.assert_allclose(fits[:2, 1:3], [[-3.0, 0.0], [3.0, 1.0]], atol=1e-9)
    np.testing.assert_allclose(fits[:2, 6:], [[-HALF, HALF]] * 2)


def test_lines_side_by_side_do_not_crowd_each_other_but_other_things_do():
    wire = make_segment() + np.random.default_rng(5).normal(0.0, 0.03, (81, 3)) * (0.0, 1.0, 1.0)
    beside = make_segment(y=0.13)
    assert judge(wire, beside)[0] == 2
    assert judge(wire, noise=[beside])[0] == 0


def test_a_thick_cluster_is_no_segment_and_is_told_to_be_too_thick():
    thick = make_segment()
    thick[::2, 1] += 0.4
    found, owner, too_thick, _ = judge(make_segment(y=3.0), thick)
    assert found == 1
    assert [np.unique(part).tolist() for part in owner[:2]] == [[0], [-1]]
    assert [part.all() for part in too_thick[:2]] == [False, True]
    assert judge(make_segment(y=3.0), thick, limit=0.3)[0] == 2


@pytest.mark.parametrize('cluster', [
    make_segment(0.0, 4.5), np.vstack([make_segment(-HALF, -8.0), make_segment(8.0, HALF)]),
], ids=['too short', 'two ends without a middle'])
def test_what_is_not_seen_along_the_window_is_no_segment(cluster):
    found, owner, too_thick, _ = judge(cluster)
    assert found == 0
    assert (owner[0] == -1).all()
    assert not too_thick[0].any()


def test_a_strip_of_a_sheet_is_no_segment():
    sheet = make_sheet(-HALF, HALF)
    axis = np.abs(sheet[:, 1]) < 0.03
    assert judge(sheet[axis])[0] == 1
    assert judge(sheet[axis], noise=[sheet[~axis]])[0] == 0
    assert judge(sheet[axis], noise=[sheet[~axis]], max_crowding=1.0)[0] == 1


def test_no_clusters_and_no_room():
    assert judge()[0] == 0
    found, owner, _, _ = judge(make_segment(), room=0)
    assert found == 0
    assert (owner[0] == -1).all()
