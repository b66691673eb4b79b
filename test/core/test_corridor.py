# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree
from toys import hang, make_curve, make_wire, turn

from plc_inspect.config import CorridorSettings
from plc_inspect.core.catenary.curve import span_table
from plc_inspect.core.catenary.curve_row import ORIGIN_X, ORIGIN_Y
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.corridor import extract_corridor
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.errors import ConfigError


def make_curves(yaw=0.0, shift=(0.0, 0.0, 0.0)):
    """Make three spans: two side by side, one steep and deep beyond them."""
    wires = [
        make_wire((0.0, 0.0, 15.0), (90.0, 0.0, 15.0), noise=0.0),
        make_wire((0.0, 4.0, 15.0), (90.0, 4.0, 15.0), noise=0.0),
        make_wire((90.0, 0.0, 15.0), (200.0, 40.0, 50.0), c=200.0, noise=0.0),
    ]
    return [make_curve(turn(wire, yaw, shift)) for wire in wires]


def sample(curves, step=0.01):
    places, owner = [], []
    for number, curve in enumerate(curves):
        x = np.arange(curve.low, curve.high + step, step)
        places.append(curve.position(np.minimum(x, curve.high)))
        owner.append(np.full(len(x), number))
    return np.vstack(places), np.concatenate(owner)


def tabulate(curves):
    low = np.array([curve.low for curve in curves])
    return span_table(curves, low, np.array([curve.high for curve in curves]))


def extract(points, curves, height=None, wire=None, **changes):
    points = np.asarray(points, float).reshape(-1, 3)
    height = points[:, 2].astype(np.float32) if height is None else height
    wire = np.zeros(len(points), dtype=bool) if wire is None else wire
    return extract_corridor(
        points, height, wire, make_models(curves), CorridorSettings(**changes)
    )


def make_models(curves):
    """Return a span along the whole of each curve."""
    return [
        SpanModel(span=None, curve=curve, start_x=curve.low, end_x=curve.high) for curve in curves
    ]


@pytest.mark.parametrize(('yaw', 'shift'), [
    (0.0, (0.0, 0.0, 0.0)), (np.pi / 2, (0.0, 0.0, 0.0)), (2.0, (5e5, 6.6e6, 100.0)),
])
def test_distances_are_those_to_a_dense_sample_of_the_curves(yaw, shift):
    curves = make_curves(yaw, shift)
    rng = np.random.default_rng(0)
    points = turn(rng.uniform((-30, -30, 0), (230, 70, 60), (20_000, 3)), yaw, shift)
    found, distance, span = find_near(points, tabulate(curves), np.full(3, 12.0))
    places, owner = sample(curves)
    oracle, nearest = cKDTree(places).query(points)
    near = np.flatnonzero(oracle <= 12.0)
    assert len(np.setxor1d(found, near)) <= 2
    np.testing.assert_allclose(distance, oracle[found], atol=2e-3)
    assert (span == owner[nearest[found]]).mean() > 0.999
    assert (np.diff(found) > 0).all()


def test_distances_depend_neither_on_order_nor_on_company():
    rng = np.random.default_rng(4)
    curves = make_curves(0.3)
    table, reach = tabulate(curves), np.full(3, 12.0)
    points = curves[0].position(np.zeros(1))[0] + rng.uniform(-30.0, 30.0, (2_500_000, 3))
    whole = find_near(points, table, reach)
    assert 100_000 < len(whole[0]) < 2_000_000
    for start in range(0, len(points), 100_001):
        part = slice(start, start + 100_001)
        alone = find_near(points[part], table, reach)
        own = slice(*np.searchsorted(whole[0], [part.start, part.stop]))
        np.testing.assert_array_equal(alone[0] + start, whole[0][own])
        np.testing.assert_array_equal(alone[1], whole[1][own])
        np.testing.assert_array_equal(alone[2], whole[2][own])
    order = np.lexsort(points.T)  # lowest last
    found, distance, span = find_near(points[order], table, reach)
    back = np.argsort(order[found])
    np.testing.assert_array_equal(order[found][back], whole[0])
    np.testing.assert_array_equal(distance[back], whole[1])
    np.testing.assert_array_equal(span[back], whole[2])


@pytest.mark.parametrize('away', [(6e3, 5e3), (90e3, 80e3), (-400e3, 9e3)])
def test_distances_do_not_depend_on_spans_far_away(away):
    """In cells wider than usual a slack span would be no parabola."""
    curves = [
        make_curve(make_wire((0.0, y, 9.0), (45.0, y + 3.0, 8.0 - y), c=60.0, noise=0.0))
        for y in (0.0, 1.5, 3.0)
    ]
    table = tabulate(curves)
    points = sample(curves, step=0.05)[0]
    points += np.random.default_rng(7).normal(0.0, 3.0, points.shape)
    points[5] = np.nan
    found, distance, span = find_near(points, table, 6.0)
    both = np.repeat(table, 2, axis=0)  # the numbers of both sites alternate
    both[1::2, ORIGIN_X : ORIGIN_Y + 1] += away
    others = points + np.array([*away, 0.0])
    place, apart, which = find_near(np.vstack([points, others]), both, 6.0)
    np.testing.assert_array_equal(place, np.concatenate([found, found + len(points)]))
    np.testing.assert_allclose(apart, np.tile(distance, 2), atol=2e-3)
    is_same = which == np.concatenate([2 * span, 2 * span + 1])
    assert is_same.mean() > 0.999


def test_each_span_has_a_reach_of_its_own():
    curves = make_curves()[:2]
    points = np.array([[45.0, -3.0, 13.7], [45.0, 7.0, 13.7], [45.0, 2.0, 13.7]])
    found, distance, span = find_near(points, tabulate(curves), np.array([2.5, 3.5]))
    assert found.tolist() == [1, 2]
    assert span.tolist()[0] == 1
    np.testing.assert_allclose(distance, [3.0, 2.0], atol=0.05)


def test_beyond_the_ends_the_distance_is_to_the_end():
    curve = make_curves()[0]
    end = curve.position(curve.high)[0]
    points = end + np.array([[3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, -2.0]])
    _, distance, _ = find_near(points, tabulate([curve]), np.array([10.0]))
    np.testing.assert_allclose(distance, [3.0, 5.0, 2.0], atol=0.02)


def test_the_limit_is_inclusive():
    curve = make_curves()[0]
    points = curve.position(curve.mean_x) + np.array([0.0, 2.0, 0.0])
    assert len(extract(points, [curve], radius=2.0 + 1e-6).points) == 1
    assert len(extract(points, [curve], radius=2.0 - 1e-3).points) == 0


def test_open_country_is_searched_down_to_the_ground():
    curve = make_curves()[0]
    rng = np.random.default_rng(0)
    grass = rng.uniform((-20, -40, 0.0), (110, 40, 0.3), (4000, 3))
    found = extract(grass, [curve])
    lowest = hang(45.0, 90.0, 15.0, 15.0, 800.0)
    assert not found.complex_case[0]
    assert found.radius[0] == pytest.approx(lowest, abs=0.5)


def test_where_things_stand_higher_the_radius_takes_in_what_could_fall():
    curve = make_curves()[0]
    rng = np.random.default_rng(0)
    grass = rng.uniform((-20, -40, 0.0), (110, 40, 0.3), (4000, 3))
    trees = rng.uniform((20, 9.0, 0.0), (40, 12.0, 18.0), (2000, 3))
    points = np.vstack([grass, trees])
    found = extract(points, [curve])
    assert found.complex_case[0]
    # Eq. 9: the greatest of the distance from the plane and in it, of points higher than far
    x, y = curve.local(points)
    falls = (points[:, 2] > np.abs(y)) & (points[:, 2] > 2.0)
    far = np.maximum(np.abs(y), np.abs(points[:, 2] - curve.fit.height(x)))[falls].max()
    assert found.radius[0] == pytest.approx(far, abs=1.0)
    assert not extract(points, [curve], environment='open').complex_case[0]
    assert extract(grass, [curve], environment='complex').complex_case[0]


def test_the_radius_keeps_within_its_bounds():
    high = make_curve(make_wire((0.0, 0.0, 90.0), (90.0, 0.0, 90.0), noise=0.0))
    ground = np.random.default_rng(0).uniform((0, -20, 0), (90, 20, 0.1), (3000, 3))
    assert extract(ground, [high]).radius[0] == 20.0
    assert extract(ground, [high], max_radius=30.0).radius[0] == 30.0
    assert extract(ground, [high], radius=7.0).radius.tolist() == [7.0]


def test_wires_are_in_the_corridor_but_do_not_choose_its_radius():
    curve = make_curves()[0]
    wire = curve.position(np.linspace(curve.low, curve.high, 200))
    above = wire + np.array([0.0, 0.0, 9.0])
    ground = np.random.default_rng(0).uniform((0, -20, 0), (90, 20, 0.1), (3000, 3))
    points = np.vstack([wire, above, ground])
    mask = np.arange(len(points)) < 400
    found = extract(points, [curve], wire=mask)
    assert not found.complex_case[0]
    assert np.isin(np.arange(200), found.points).all()
    assert extract(points, [curve]).complex_case[0]


def test_rules_may_search_farther_than_the_radius():
    curve = make_curves()[0]
    points = curve.position(curve.mean_x) + np.array([[0.0, 0.4, 0.0], [0.0, 3.0, 0.0]])
    result = extract_corridor(
        points, points[:, 2].astype(np.float32), np.zeros(2, dtype=bool),
        make_models([curve]), CorridorSettings(radius=0.6), 4.0,
    )
    assert result.points.tolist() == [0]
    assert result.near.tolist() == [0, 1]
    np.testing.assert_allclose(result.near_distance, [0.4, 3.0], atol=0.01)


def test_order_duplicates_and_input():
    curves = make_curves()
    rng = np.random.default_rng(0)
    points = np.repeat(rng.uniform((-30, -30, 0), (230, 70, 60), (2000, 3)), 2, axis=0)
    before = points.copy()
    one = extract(points, curves, radius=9.0)
    np.testing.assert_array_equal(points, before)
    order = rng.permutation(len(points))
    other = extract(points[order], curves, radius=9.0)
    np.testing.assert_array_equal(np.sort(order[other.points]), one.points)
    assert one.points.dtype == np.int64
    assert one.distance.dtype == np.float32
    assert one.points.shape == one.distance.shape == one.span.shape


@pytest.mark.parametrize(('num', 'curves'), [(0, 3), (1, 0), (1, 3), (50, 0)])
def test_few_points_or_no_span(num, curves):
    result = extract(np.full((num, 3), 500.0), make_curves()[:curves])
    assert len(result.points) == len(result.distance) == len(result.span) == 0
    assert result.radius.shape == result.complex_case.shape == (curves,)


def test_points_that_are_not_finite_are_not_found():
    curve = make_curves()[0]
    points = np.vstack([curve.position(curve.mean_x), np.full((2, 3), np.nan)])
    assert extract(points, [curve], radius=3.0).points.tolist() == [0]


@pytest.mark.parametrize('change', [
    {'radius': -1.0}, {'max_radius': 0.1}, {'environment': 'forest'},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        dataclasses.replace(CorridorSettings(), **change)
