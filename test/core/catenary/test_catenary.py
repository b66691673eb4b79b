# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.optimize import least_squares
from toys import hang

from plc_inspect.core.catenary.catenary import (
    CatenaryFit,
    draw_triples,
    fit_quadratic,
    NO_DRAWS,
)
from plc_inspect.core.catenary.solver import solve_catenary
from plc_inspect.errors import FitError


def solve(x, z, tolerance=0.1, seed=None):
    """Return a fit and its inliers; by MSAC first where a seed is given."""
    draws = NO_DRAWS if seed is None else draw_triples(64, np.random.default_rng(seed))
    middle, shape, covariance, rmse, inlier, converged = solve_catenary(x, z, tolerance, draws)
    found = CatenaryFit(
        middle=middle, shape=shape, covariance=covariance, rmse=rmse, converged=converged,
    )
    return found, inlier


def fit(x, z, tolerance=0.1, seed=None):
    return solve(x, z, tolerance, seed)[0]


def make(length=200.0, start=20.0, end=20.0, c=600.0, num=201, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0.0, length, num)) if noise else np.linspace(0.0, length, num)
    return x, hang(x, length, start, end, c) + rng.normal(0.0, noise, num)


@pytest.mark.parametrize(('length', 'c'), [(200.0, 600.0), (400.0, 800.0), (40.0, 300.0)])
def test_level_sag_is_that_of_physics(length, c):
    found = fit(*make(length, c=c))
    sag, _ = found.sag(0.0, length)
    assert sag == pytest.approx(c * (np.cosh(length / (2 * c)) - 1), abs=1e-5)
    assert found.c == pytest.approx(c, rel=1e-5)
    assert found.b == pytest.approx(length / 2, abs=1e-3)
    assert found.a == pytest.approx(20.0 - sag - c, abs=c * 1e-5)


@pytest.mark.parametrize(('length', 'c', 'low', 'high'), [
    (200.0, 600.0, 0.01, 0.02), (400.0, 800.0, 0.13, 0.16),
])
def test_the_parabola_of_equal_tension_is_shallower(length, c, low, high):
    sag, _ = fit(*make(length, c=c)).sag(0.0, length)
    assert low < sag - length**2 / (8 * c) < high


@pytest.mark.parametrize(('temperature', 'depth'), [
    (0, 8.69), (20, 9.41), (40, 10.10), (60, 10.75), (80, 11.37), (100, 11.97),
])
def test_sags_of_the_state_change_table(temperature, depth):
    # S 320 m, c = S^2 / 8 D by the parabola; the catenary is 0.8 to 2.2 cm deeper
    c = 320.0**2 / (8 * depth)
    sag, _ = fit(*make(320.0, c=c)).sag(0.0, 320.0)
    assert 0.005 < sag - depth < 0.025


@given(
    st.floats(30, 400), st.floats(-0.25, 0.25), st.floats(2.0, 12.0),
)
@settings(max_examples=60, deadline=None)
def test_sag_is_the_greatest_vertical_distance_from_the_chord(length, slope, ratio):
    c = ratio * length
    x, z = make(length, 20.0, 20.0 + slope * length, c)
    found = fit(x, z)
    dense = np.linspace(0.0, length, 20001)
    true = hang(dense, length, 20.0, 20.0 + slope * length, c)
    chord = 20.0 + slope * dense
    sag, _ = found.sag(0.0, length)
    assert sag == pytest.approx((chord - true).max(), abs=1e-4)
    np.testing.assert_allclose(found.height(dense), true, atol=1e-4)
    np.testing.assert_allclose(found.slope(dense), np.gradient(true, dense), atol=1e-3)
    lowest = found.lowest(0.0, length)
    assert 0.0 <= lowest <= length
    assert float(found.height(np.array([lowest]))[0]) == pytest.approx(true.min(), abs=1e-4)


def test_the_lowest_point_of_a_steep_span_is_its_lower_end():
    found = fit(*make(100.0, 10.0, 40.0, 900.0))
    assert found.b < 0.0
    assert found.lowest(0.0, 100.0) == 0.0


def test_against_least_squares_of_scipy():
    x, z = make(180.0, 18.0, 25.0, 700.0, num=150, noise=0.03, seed=3)
    found, inlier = solve(x, z, tolerance=1.0)
    oracle = least_squares(
        lambda p: p[0] + 100 * p[2] * np.cosh((x - p[1]) / (100 * p[2])) - z,
        (z.min() - 700.0, 70.0, 7.0), x_scale=(100.0, 10.0, 1.0), xtol=1e-14, ftol=1e-14,
    )
    a, b, c = oracle.x[0], oracle.x[1], 100 * oracle.x[2]
    np.testing.assert_allclose(
        found.height(x), a + c * np.cosh((x - b) / c), atol=2e-5
    )
    assert found.converged
    assert found.rmse == pytest.approx(np.sqrt(np.mean((z - found.height(x)) ** 2)), rel=1e-6)
    assert inlier.all()


def test_the_covariance_is_that_of_the_linearised_problem():
    x, z = make(120.0, c=500.0, num=80, noise=0.02, seed=5)
    found = fit(x, z, tolerance=1.0)
    columns = []
    for number, step in enumerate((1e-4, 1e-6, 1e-7)):
        sides = []
        for sign in (1, -1):
            h, g, k = found.shape + sign * step * (np.arange(3) == number)
            u = k * (x - found.middle) + np.arcsinh(g)
            sides.append(h + (np.cosh(u) - np.sqrt(1 + g * g)) / k)
        columns.append((sides[0] - sides[1]) / (2 * step))
    jacobian = np.column_stack(columns)
    noise = ((z - found.height(x)) ** 2).sum() / (len(x) - 3)
    expected = noise * np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(found.covariance, expected, rtol=0.02)
    sigma = np.sqrt(np.einsum('ij,jk,ik->i', jacobian, expected, jacobian))
    np.testing.assert_allclose(found.height_sigma(x), sigma, rtol=0.02)


def test_stated_deviations_are_those_of_many_fits():
    fits = [fit(*make(150.0, c=600.0, num=120, noise=0.04, seed=seed)) for seed in range(200)]
    stated = np.median([item.parameter_sigma() for item in fits], axis=0)
    spread = np.std([(item.a, item.b, item.c) for item in fits], axis=0)
    np.testing.assert_allclose(stated, spread, rtol=0.25)
    errors = [(item.sag(0, 150)[0], item.sag(0, 150)[1]) for item in fits]
    assert np.std([sag for sag, _ in errors]) == pytest.approx(
        np.median([sigma for _, sigma in errors]), rel=0.2
    )


def test_the_true_sag_lies_in_the_stated_interval_of_95_percent():
    rng = np.random.default_rng(11)
    inside = 0
    for number in range(200):
        length, c = rng.uniform(60, 320), rng.uniform(400, 1800)
        rise = rng.uniform(-0.15, 0.15) * length
        noise = rng.uniform(0.01, 0.06)
        x = rng.uniform(0.0, length, int(rng.uniform(40, 400)))
        z = hang(x, length, 20.0, 20.0 + rise, c) + rng.normal(0.0, noise, len(x))
        found = fit(x, z, tolerance=max(0.1, 3 * noise), seed=number)
        sag, sigma = found.sag(0.0, length)
        dense = np.linspace(0, length, 4001)
        chord = 20.0 + rise * dense / length
        true = (chord - hang(dense, length, 20.0, 20.0 + rise, c)).max()
        inside += abs(sag - true) <= 1.96 * sigma
    assert 0.90 <= inside / 200 <= 0.98


def test_msac_withstands_a_third_of_outliers():
    rng = np.random.default_rng(0)
    x, z = make(150.0, c=600.0, num=200, noise=0.02)
    bad = rng.choice(200, 70, replace=False)
    z[bad] += rng.uniform(0.5, 6.0, 70)
    robust, inlier = solve(x, z, seed=1)
    true = hang(x, 150.0, 20.0, 20.0, 600.0)
    assert np.abs(robust.height(x) - true).max() < 0.03
    assert not inlier[bad].any()
    assert inlier.sum() >= 128
    plain = fit(x, z)
    assert np.abs(plain.height(x) - true).max() > 0.1


def test_the_generator_decides_and_the_same_state_gives_the_same_fit():
    x, z = make(150.0, c=600.0, num=200, noise=0.05)
    (first, inlier), (second, again) = solve(x, z, seed=4), solve(x, z, seed=4)
    np.testing.assert_array_equal(first.shape, second.shape)
    np.testing.assert_array_equal(inlier, again)


def test_a_straight_wire_has_no_proven_curvature():
    x = np.linspace(0.0, 60.0, 300)
    z = 10.0 + 0.05 * x + np.random.default_rng(0).normal(0.0, 0.02, 300)
    found = fit(x, z)
    assert found.shape[2] < 4 * np.sqrt(found.covariance[2, 2])
    np.testing.assert_allclose(found.height(x), 10.0 + 0.05 * x, atol=0.02)


def test_moving_a_span_moves_its_fit():
    x, z = make(150.0, c=600.0, num=200, noise=0.03)
    near, far = fit(x, z), fit(x + 5e5, z + 300.0)
    np.testing.assert_allclose(far.height(x + 5e5), near.height(x) + 300.0, atol=1e-5)
    assert far.sag(5e5, 5e5 + 150.0)[0] == pytest.approx(near.sag(0.0, 150.0)[0], abs=1e-5)
    mirrored = fit(150.0 - x, z)
    np.testing.assert_allclose(mirrored.height(150.0 - x), near.height(x), atol=1e-6)


def test_order_input_and_duplicates():
    x, z = make(150.0, c=600.0, num=200, noise=0.03)
    before = x.copy(), z.copy()
    one = fit(x, z, tolerance=1.0)
    np.testing.assert_array_equal(x, before[0])
    np.testing.assert_array_equal(z, before[1])
    order = np.random.default_rng(0).permutation(200)
    np.testing.assert_allclose(fit(x[order], z[order], tolerance=1.0).shape, one.shape, rtol=1e-6)
    twice = fit(np.repeat(x, 2), np.repeat(z, 2), tolerance=1.0)
    np.testing.assert_allclose(twice.shape, one.shape, rtol=1e-6)


def test_quadratic_form_is_that_of_polyfit():
    x, z = make(150.0, c=600.0, num=200, noise=0.03)
    np.testing.assert_allclose(fit_quadratic(x, z), np.polyfit(x, z, 2), rtol=1e-6)
    np.testing.assert_allclose(
        fit_quadratic(np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.0, 3.0])), (2, -3, 1), atol=1e-9
    )
    with pytest.raises(FitError, match='needs 3 points, got 2'):
        fit_quadratic(np.arange(2.0), np.arange(2.0))


@pytest.mark.parametrize('low', [0.0, 299.0, 299.9])
def test_the_quadratic_form_of_a_short_piece_far_along_lies_on_its_points(low):
    x = np.linspace(low, 300.0, 50)
    z = 20.0 + 1e-3 * (x - 150.0) ** 2
    a2, a1, a0 = fit_quadratic(x, z)
    np.testing.assert_allclose(a2 * x**2 + a1 * x + a0, z, atol=1e-6)
