# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import math

import numpy as np
import pytest
from toys import hang, make_curve, make_wire, turn

from plc_inspect.core.catenary.catenary import NO_DRAWS
from plc_inspect.core.catenary.curve import fit_curve, pack_curves, unpack_curve
from plc_inspect.core.catenary.curve_row import (
    fit_row,
    height_of,
    HIGH,
    is_curve,
    LOW,
    NUM_POINTS,
    sigma_of,
    slope_of,
    to_local,
    variances_of,
)


def make_points(seed=0):
    wire = make_wire((0.0, 0.0, 20.0), (120.0, 0.0, 26.0), noise=0.03, seed=seed)
    return turn(wire, math.radians(40.0))


def fit(points, chosen=None, tolerance=0.15):
    chosen = np.arange(len(points)) if chosen is None else chosen
    row, own, _, num_plane = fit_row(
        points, chosen, 10_000, tolerance, tolerance, math.nan, NO_DRAWS
    )
    return row, own, num_plane


def test_a_row_says_what_its_curve_says():
    curve = make_curve(make_points())
    row = pack_curves([curve])[0]
    for x in np.linspace(curve.low - 20.0, curve.high + 20.0, 9).tolist():
        assert height_of(row, x) == pytest.approx(curve.fit.height(x), abs=1e-9)
        assert slope_of(row, x) == pytest.approx(curve.fit.slope(x), abs=1e-12)
        sigma = curve.prediction_sigma(np.array([x]))[0]
        assert sigma_of(row, x) == pytest.approx(sigma, rel=1e-9)
        vertical, lateral = variances_of(row, x)
        assert math.sqrt(vertical) == pytest.approx(curve.fit.height_sigma(np.array([x]))[0])
        assert lateral == pytest.approx(curve.lateral_variance(x))
        place = curve.position(x)
        np.testing.assert_allclose(to_local(row, *place[0, :2]), (x, 0.0), atol=1e-9)
        np.testing.assert_allclose(place, curve.position(np.array([x])), atol=1e-9)


def test_curves_come_back_from_their_rows():
    curves = [make_curve(make_points(seed)) for seed in range(3)]
    rows = pack_curves(curves)
    for curve, row in zip(curves, rows, strict=True):
        again = unpack_curve(row, curve.points, curve.stride)
        for name in (item.name for item in dataclasses.fields(curve) if item.name != 'fit'):
            np.testing.assert_allclose(getattr(again, name), getattr(curve, name), rtol=1e-12)
        np.testing.assert_array_equal(again.fit.shape, curve.fit.shape)
        np.testing.assert_array_equal(again.fit.covariance, curve.fit.covariance)
        assert again.fit.converged == curve.fit.converged
    assert pack_curves([]).shape == (0, rows.shape[1])


def test_what_is_no_curve_is_told_from_one():
    points = make_points()
    row, own, num_plane = fit(points)
    assert is_curve(row)
    assert row[NUM_POINTS] == len(own)
    assert num_plane == len(points)
    spread = np.random.default_rng(0).uniform(0.0, 100.0, (40, 3))
    upright = np.column_stack([np.zeros(9), np.zeros(9), np.arange(9.0)])
    for none, chosen in ((points, np.arange(3)), (upright, None), (spread, None)):
        row, own, _ = fit(none, chosen, tolerance=0.01)
        assert not is_curve(row)
        assert len(own) < 4


def test_thinning_keeps_the_number_of_points_and_the_course():
    points = make_points()
    chosen = np.arange(len(points))
    whole, own, one, _ = fit_row(points, chosen, 10_000, 0.15, 0.15, math.nan, NO_DRAWS)
    row, few, stride, _ = fit_row(points, chosen, 200, 0.15, 0.15, math.nan, NO_DRAWS)
    assert one == 1
    assert stride == -(-len(points) // 200)
    assert len(own) == whole[NUM_POINTS] == len(points)
    assert row[NUM_POINTS] == stride * len(few)
    middle = (row[LOW] + row[HIGH]) / 2
    assert height_of(row, middle) == pytest.approx(height_of(whole, middle), abs=0.02)


@pytest.mark.parametrize('seed', range(30))
def test_few_points_that_stand_for_many_are_no_curve(seed):
    points = np.random.default_rng(seed).uniform(0.0, 100.0, (1000, 3))
    row, own, stride, _ = fit_row(
        points, np.arange(1000), 200, 0.01, 0.01, math.nan, NO_DRAWS
    )
    assert stride == 5
    assert is_curve(row) == (len(own) >= 4)
    assert row[NUM_POINTS] in (0, 5 * len(own))


@pytest.mark.parametrize('half', [49.0, 49.9, 50.1, 51.0, 150.0])
def test_shallow_and_deep_curves_are_fitted_alike(half):
    # below 0.5 of a constant of 100 m from the middle the sums come from polynomials
    x = np.linspace(-half, half, 400)
    points = np.column_stack([x, np.zeros(400), hang(x + half, 2 * half, 40.0, 40.0, 100.0)])
    curve = fit_curve(points, np.arange(400), tolerance=0.1)
    assert len(curve.points) == 400
    assert curve.fit.rmse < 1e-6
    assert curve.fit.c == pytest.approx(100.0, rel=1e-6)
