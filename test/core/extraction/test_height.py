# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from toys import make_curve, make_ground, make_tree, make_wire, turn

from plc_inspect.config import HeightSettings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.ground.ground_surface import bounds, measure_surface
from plc_inspect.core.spans.ground_revision import revise_ground
from plc_inspect.errors import ConfigError

SETTINGS = HeightSettings()


def make_grid(num=20, z=0.0):
    x, y = np.meshgrid(np.arange(num) + 0.5, np.arange(num) + 0.5)
    return np.column_stack([x.ravel(), y.ravel(), np.full(num * num, z)])


def look(ground):
    """Return height and sight of all cells of a grid that keeps all."""
    return tuple(ground.view(own, (0, 0))[:-1, :-1] for own in (ground.height, ground.seen))


def test_toy_case_by_hand():
    points = np.vstack([make_grid(z=100.0), [[10.2, 10.2, 103.9], [10.2, 10.2, 104.2]]])
    result = extract_high(points, SETTINGS)
    np.testing.assert_allclose(result.height[:400], 0.0, atol=1e-4)
    np.testing.assert_allclose(result.height[400:], [3.9, 4.2], atol=1e-4)
    assert np.flatnonzero(result.high).tolist() == [401]
    # heights from 0 to 4.2 in 100 bins: the peak is the centre of the first, 0.021
    assert result.threshold == pytest.approx(4.0 + 0.021, abs=1e-3)
    assert result.histogram.sum() == 402
    assert result.histogram[0] == 400


def test_histogram_is_that_of_the_heights():
    points = np.vstack([make_ground((0, 0), (40, 40)), make_tree(20.0, 20.0, 12.0)])
    result = extract_high(points, SETTINGS)
    assert len(result.histogram) == SETTINGS.num_bins
    expected, _ = np.histogram(result.height.astype(np.float64), result.edges)
    assert np.abs(result.histogram - expected).max() <= 2  # float32 at bin edges
    assert (result.high == (result.height >= result.threshold)).all()


@pytest.mark.parametrize('z', [[60.0], [150.0], [185.0], [300.0], [60.0, -55.0]])
def test_a_few_points_far_above_or_below_leave_the_threshold(z):
    ground = make_ground((0, 0), (40, 40))
    far = np.column_stack([np.full((len(z), 2), 20.0), z])
    wire = make_wire((5.0, 10.0, 4.6), (35.0, 10.0, 4.6), noise=0.0)
    result = extract_high(np.vstack([ground, wire, far]), SETTINGS)
    assert 3.7 < result.threshold < 4.3
    assert result.high[len(ground) : -len(z)].all()


def test_points_high_above_a_slope_are_found_and_the_slope_is_not():
    def slope(x, y):
        return 0.5 * x

    ground = make_ground((0, 0), (80, 40), height=slope)
    wire = make_wire((0.0, 20.0, 6.0), (80.0, 20.0, 46.0), c=5000.0)
    result = extract_high(np.vstack([ground, wire]), SETTINGS)
    assert result.high[len(ground):].all()
    assert not result.high[:len(ground)].any()
    truth = wire[:, 2] - slope(wire[:, 0], 0.0)
    np.testing.assert_allclose(result.height[len(ground):], truth, atol=0.7)


def test_a_wire_over_a_valley_is_high():
    def valley(x, y):
        return 0.02 * (x - 50.0) ** 2

    ground = make_ground((0, 0), (100, 40), height=valley)
    wire = make_wire((0.0, 20.0, 58.0), (100.0, 20.0, 58.0))
    result = extract_high(np.vstack([ground, wire]), SETTINGS)
    assert result.high[len(ground):].all()
    assert result.height[len(ground):].max() == pytest.approx(56.4, abs=0.7)


def test_low_wires_below_tree_tops_survive():
    ground = make_ground((0, 0), (60, 40))
    trees = [make_tree(x, 25.0, 18.0, seed=int(x)) for x in range(5, 60, 5)]
    wire = make_wire((0.0, 20.0, 6.0), (60.0, 20.0, 6.0), c=5000.0)
    result = extract_high(np.vstack([ground, *trees, wire]), SETTINGS)
    assert result.high[-len(wire):].all()


def test_a_stray_return_below_ground_does_not_pull_the_ground_down():
    ground = make_ground((0, 0), (40, 40))
    stray = np.array([[20.5, 20.5, -12.0]])
    result = extract_high(np.vstack([ground, stray]), SETTINGS)
    assert np.abs(result.height[:-1]).max() < 0.5
    assert result.ground.at(np.array([[20.5, 20.5]]))[0] == pytest.approx(0.0, abs=0.2)


def test_a_cloud_of_wires_alone_has_no_ground():
    wire = make_wire((0.0, 0.0, 20.0), (200.0, 30.0, 25.0), per_metre=3.0)
    result = extract_high(wire, SETTINGS)
    assert result.high.all()
    assert np.isnan(result.height).all()


def test_ground_at_is_linear_between_cells():
    def slope(x, y):
        return 0.1 * x - 0.2 * y

    x, y = (value.ravel() for value in np.meshgrid(*[np.arange(0.0, 30.01, 0.25)] * 2))
    result = extract_high(np.column_stack([x, y, slope(x, y)]), SETTINGS)
    places = np.array([[10.0, 10.0], [10.5, 10.0], [11.0, 10.0], [10.0, 12.0]])
    found = result.ground.at(places)
    np.testing.assert_allclose(np.diff(found), [0.05, 0.05, -0.5], atol=1e-3)
    # the lowest point of a cell lies at its corner, at most 0.15 below its middle
    np.testing.assert_allclose(found, slope(*places.T), atol=0.151)


@pytest.mark.parametrize('max_gap', [0.0, 3.0, 7.4, 100.0])
def test_ground_is_unknown_far_from_where_it_was_seen(max_gap):
    points = np.vstack([make_ground((0, 0), (20, 60)), make_ground((50, 0), (60, 60))])
    result = extract_high(points, SETTINGS)
    gap = distance_transform_edt(~look(result.ground)[1]) * result.ground.cell_size
    rows, columns = np.indices(gap.shape)
    cells = np.column_stack([columns.ravel(), rows.ravel()])
    places = result.ground.origin + (cells + 0.5) * result.ground.cell_size
    found = result.ground.at(places, max_gap)
    assert (gap > 14.0).any()
    np.testing.assert_array_equal(np.isfinite(found), gap.ravel() <= max_gap)


def test_ground_is_unknown_at_a_place_that_is_no_number():
    result = extract_high(make_ground((0, 0), (20, 20)), SETTINGS)
    found = result.ground.at(np.array([[np.nan, 3.0], [3.0, np.inf], [3.0, 3.0], [-9.0, 3.0]]))
    assert np.isfinite(found).tolist() == [False, False, True, True]


@pytest.mark.parametrize('num', [0, 1, 3])
def test_few_points(num):
    points = np.arange(3.0 * num).reshape(num, 3)
    result = extract_high(points, SETTINGS)
    assert result.height.shape == result.high.shape == (num,)
    assert result.height.dtype == np.float32
    assert result.high.dtype == np.bool_
    assert result.num_not_finite == 0


def test_rows_that_are_not_finite_are_counted_and_never_high():
    points = np.vstack([make_grid(), [[np.nan, 1, 9], [1, np.inf, 9], [1, 1, -np.inf]]])
    result = extract_high(points, SETTINGS)
    assert result.num_not_finite == 3
    assert not result.high[-3:].any()
    assert np.isnan(result.height[-3:]).all()
    nothing = extract_high(np.full((4, 3), np.nan), SETTINGS)
    assert nothing.num_not_finite == 4
    assert not nothing.high.any()


def test_duplicates_change_nothing_but_the_counts():
    points = np.vstack([make_ground((0, 0), (30, 30)), make_tree(15.0, 15.0, 9.0)])
    once, twice = (extract_high(cloud, SETTINGS) for cloud in (points, np.repeat(points, 2, 0)))
    np.testing.assert_array_equal(np.repeat(once.height, 2), twice.height)
    np.testing.assert_array_equal(np.repeat(once.high, 2), twice.high)
    np.testing.assert_array_equal(2 * once.histogram, twice.histogram)


def test_input_is_unchanged():
    points = make_ground((0, 0), (30, 30))
    before = points.copy()
    extract_high(points, SETTINGS)
    np.testing.assert_array_equal(points, before)


def test_the_order_of_points_does_not_matter():
    points = np.vstack([make_ground((0, 0), (30, 30)), make_tree(15.0, 15.0, 9.0)])
    order = np.random.default_rng(0).permutation(len(points))
    one, other = extract_high(points, SETTINGS), extract_high(points[order], SETTINGS)
    np.testing.assert_array_equal(one.height[order], other.height)
    np.testing.assert_array_equal(one.high[order], other.high)
    assert one.threshold == other.threshold


@pytest.mark.parametrize('shift', [(1000.0, -2000.0, 50.0), (5e5, 6.6e6, 400.0)])
def test_translation_moves_the_ground_along(shift):
    points = np.vstack([make_ground((0, 0), (30, 30)), make_tree(15.0, 15.0, 9.0)])
    one, other = extract_high(points, SETTINGS), extract_high(points + shift, SETTINGS)
    np.testing.assert_allclose(other.height, one.height, atol=2e-3)
    np.testing.assert_allclose(other.ground.origin, one.ground.origin + shift[:2], atol=1e-6)


def test_yaw_hardly_matters():
    points = np.vstack([make_ground((0, 0), (40, 40)), make_wire((0, 20, 9), (40, 20, 9))])
    one, other = extract_high(points, SETTINGS), extract_high(turn(points, 0.7), SETTINGS)
    np.testing.assert_array_equal(one.high, other.high)
    np.testing.assert_allclose(one.height, other.height, atol=0.2)


def test_bounds_leave_out_what_is_not_finite():
    points = np.random.default_rng(0).normal(size=(1000, 3))
    points[::7, 1] = np.nan
    low, high, num = bounds(points)
    finite = points[np.isfinite(points).all(axis=1)]
    np.testing.assert_array_equal(low, finite.min(axis=0))
    np.testing.assert_array_equal(high, finite.max(axis=0))
    assert num == len(finite)


@pytest.mark.parametrize('change', [
    {'num_bins': 9}, {'num_bins': 10.5}, {'beta': 0.5}, {'beta': float('nan')},
    {'cell_size': 0.0}, {'max_slope_deg': 90.0}, {'beta': '4'},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        HeightSettings(**change)


def test_beta_decides_what_is_high():
    points = np.vstack([make_grid(), [[10.2, 10.2, 6.0], [10.2, 10.2, 9.0]]])
    high = extract_high(points, HeightSettings(beta=7.0)).high
    assert np.flatnonzero(high).tolist() == [401]


def test_ground_that_was_not_seen_does_not_rise_to_the_wire_above_it():
    ground = make_ground((0, 0), (120, 80))
    hole = (np.abs(ground[:, 0] - 60) < 35) & (np.abs(ground[:, 1] - 40) < 28)
    wires = [make_wire((0.0, y, 12.0), (120.0, y, 12.0), c=900.0) for y in (36, 38, 40, 42, 44)]
    curves = [make_curve(wire) for wire in wires]
    points = np.vstack([*wires, ground[~hole]])
    own = slice(0, sum(map(len, wires)))
    result = extract_high(points, SETTINGS)
    assert not result.high[own].all()  # what is to be mended
    mended = revise_ground(points, result, curves, SETTINGS)
    assert mended.high[own].all()
    np.testing.assert_allclose(mended.ground.at(points[own, :2]), 0.0, atol=0.2)
    assert revise_ground(points, mended, curves, SETTINGS) is mended


def test_ground_that_is_near_a_conductor_stays():
    ground = make_ground((0, 0), (120, 60))
    wire = make_wire((0.0, 30.0, 4.0), (120.0, 30.0, 4.0), c=600.0)
    points = np.vstack([ground, wire])
    result = extract_high(points, SETTINGS)
    mended = revise_ground(points, result, [make_curve(wire)], SETTINGS)
    assert mended is not result
    np.testing.assert_allclose(look(mended.ground)[0], 0.0, atol=0.15)


def test_heights_in_a_part_are_those_in_the_whole_to_the_bit():
    """Stages decide at full metres, where another rounding is another decision."""
    points = make_ground((0, 0), (600, 60), height=lambda x, y: 0.171 * x + 0.03 * y)
    points = np.vstack([points, points + np.array([0.0, 0.0, 17.3])])
    region = np.array([points.min(axis=0), points.max(axis=0)])
    own = (points[:, 0] > 200.0) & (points[:, 0] < 500.0)
    inner = (points[own, 0] > 300.0) & (points[own, 0] < 400.0)
    whole = measure_surface(points, SETTINGS).height[own][inner]
    part = measure_surface(points[own], SETTINGS, region=region).height[inner]
    assert len(part) > 1000
    np.testing.assert_array_equal(part, whole)


@pytest.mark.parametrize('axis', [0, 1])
def test_ground_that_came_after_the_whole_was_measured_lies_at_its_height(axis):
    """It may lie before the first cell of the whole."""
    points = make_ground((0, 0), (600, 600), height=lambda x, y: 0.2 * (x, y)[axis])
    late = points[points[:, axis] < 200.0]
    region = np.array([[300.0, 300.0, 60.0], [600.0, 600.0, 120.0]])
    surface = measure_surface(late, SETTINGS, region=region)
    assert np.abs(surface.height).max() < 1.0


def test_what_lies_along_a_conductor_is_high_where_no_ground_was_seen():
    """Over a valley that was not seen, the ground filled in between its sides is too high."""
    sides = make_ground((0, 0), (120, 90), height=lambda x, y: 0.0 * x + 12.0)
    sides = sides[np.abs(sides[:, 1] - 45.0) > 30.0]
    wires = [make_wire((0.0, y, 12.0), (120.0, y, 12.0), c=900.0) for y in range(40, 51)]
    points = np.vstack([*wires, sides])
    own = slice(0, sum(map(len, wires)))
    before = extract_high(points, SETTINGS)
    assert not before.high[own].any()
    after = revise_ground(points, before, [make_curve(wire) for wire in wires], SETTINGS)
    assert after.high[own].all()
    assert not after.high[own.stop :].any()


def test_how_deep_a_stray_point_lies_does_not_move_the_threshold():
    rng = np.random.default_rng(3)
    ground = np.column_stack([rng.uniform(0.0, 60.0, (20_000, 2)), rng.normal(0.0, 0.1, 20_000)])
    thresholds = []
    for depth in (14.1, 14.3, 14.5, 30.0):
        strays = [[30.0, 30.0, 25.0], [30.2, 30.2, -depth]]
        result = extract_high(np.vstack([ground, strays]), SETTINGS)
        assert result.height.min() < -10.0
        thresholds.append(result.threshold)
    assert len(set(thresholds)) == 1
