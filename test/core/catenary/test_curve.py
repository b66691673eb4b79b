# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest
from toys import hang, make_curve, make_wire, turn

from plc_inspect.core.catenary.catenary import draw_triples
from plc_inspect.core.catenary.curve import find_near, fit_curve
from plc_inspect.core.catenary.curve_row import (
    derive_tolerance,
    fit_row,
    HIGH,
    MAX_TOLERANCE,
    MIN_TOLERANCE,
)
from plc_inspect.errors import FitError


def make_exact(num=50, length=100.0, c=600.0):
    x = np.linspace(0.0, length, num)
    return np.column_stack([x, np.full(num, 7.0), hang(x, length, 20.0, 22.0, c)])


def test_toy_case_without_noise():
    points = make_exact()
    curve = make_curve(points)
    assert curve.azimuth == pytest.approx(0.0, abs=1e-9)
    assert curve.length == pytest.approx(100.0)
    assert curve.lateral_rmse == pytest.approx(0.0, abs=1e-9)
    assert curve.points.tolist() == list(range(50))
    x, y = curve.local(points)
    np.testing.assert_allclose(y, 0.0, atol=1e-9)
    np.testing.assert_allclose(curve.position(x), points, atol=1e-5)
    assert curve.fit.c == pytest.approx(600.0, rel=1e-3)


@pytest.mark.parametrize('degrees', [0, 30, 89.9, 90, 135, 180, -60])
@pytest.mark.parametrize('shift', [(0.0, 0.0, 0.0), (5e5, 6.6e6, 120.0)])
def test_yaw_and_translation_turn_and_move_the_curve(degrees, shift):
    points = turn(make_exact(), np.radians(degrees), shift)
    curve = make_curve(points)
    x, y = curve.local(points)
    np.testing.assert_allclose(y, 0.0, atol=1e-6)
    np.testing.assert_allclose(curve.position(x), points, atol=1e-4)
    assert abs(np.sin(curve.azimuth - np.radians(degrees))) < 1e-6


def test_noise_is_measured_across_and_along_the_height():
    points = make_wire((0.0, 0.0, 20.0), (120.0, 50.0, 24.0), noise=0.03)
    curve = make_curve(points, tolerance=0.2)
    assert curve.lateral_rmse == pytest.approx(0.03, rel=0.15)
    assert curve.fit.rmse == pytest.approx(0.03, rel=0.15)
    offset, angle = curve.lateral_sigma
    assert offset == pytest.approx(0.03 / np.sqrt(len(points)), rel=0.2)
    assert angle == pytest.approx(0.03 / (130.0 / np.sqrt(12) * np.sqrt(len(points))), rel=0.2)


def test_points_beside_the_plane_are_left_out():
    wire = make_wire((0.0, 0.0, 20.0), (100.0, 0.0, 20.0))
    beside = make_wire((30.0, 0.9, 19.0), (50.0, 0.9, 19.0), per_metre=4.0)
    curve = make_curve(np.vstack([wire, beside]))
    assert (curve.points < len(wire)).all()
    assert len(curve.points) > 0.98 * len(wire)


def test_only_chosen_points_count():
    points = np.vstack([np.full((5, 3), np.nan), make_exact()])
    chosen = np.arange(5, 55)
    curve = fit_curve(points, chosen, tolerance=0.1)
    assert curve.points.tolist() == chosen.tolist()
    assert curve.points.dtype == np.int64


def test_the_curve_is_less_sure_beyond_its_ends():
    curve = make_curve(make_wire((0.0, 0.0, 20.0), (100.0, 0.0, 20.0)))
    sigma = curve.prediction_sigma(
        np.array([curve.mean_x, curve.high, curve.high + 20.0, curve.high + 60.0])
    )
    assert (np.diff(sigma) > 0).all()
    assert sigma[0] < 0.005


def test_extrapolation_stays_within_its_sigma():
    miss = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = rng.uniform(0.0, 60.0, 150)
        points = np.column_stack([x, np.zeros(150), hang(x, 120.0, 20.0, 20.0, 600.0)])
        curve = make_curve(points + rng.normal(0.0, 0.03, points.shape), tolerance=0.2)
        side = 1.0 if np.cos(curve.azimuth) > 0 else -1.0
        at = curve.high + 20.0 if side > 0 else curve.low - 20.0
        found = curve.position(at)[0]
        true = hang(found[0], 120.0, 20.0, 20.0, 600.0)
        sigma = float(curve.prediction_sigma(np.array([at]))[0])
        miss.append(np.hypot(found[1], found[2] - true) / sigma)
    assert np.mean(np.array(miss) < 2.5) > 0.9


def test_input_is_unchanged_and_fits_are_repeatable():
    points = make_wire((0.0, 0.0, 20.0), (100.0, 30.0, 20.0))
    before = points.copy()
    fits = [
        fit_row(points, np.arange(len(points)), 2000, 0.1, 0.1, np.nan,
                draw_triples(64, np.random.default_rng(2)))
        for _ in range(2)
    ]
    np.testing.assert_array_equal(points, before)
    np.testing.assert_array_equal(fits[0][0], fits[1][0])
    np.testing.assert_array_equal(fits[0][1], fits[1][1])


@pytest.mark.parametrize('num', [0, 1, 3])
def test_too_few_points_raise(num):
    with pytest.raises(FitError, match=f'got {num}'):
        make_curve(np.arange(3.0 * num).reshape(num, 3))


def test_points_of_one_place_raise():
    with pytest.raises(FitError, match='cannot be fitted to points within'):
        make_curve(np.ones((20, 3)))


def test_the_tolerance_follows_the_noise_within_bounds():
    assert derive_tolerance(0.0) == MIN_TOLERANCE
    assert derive_tolerance(0.06) == pytest.approx(0.18)
    assert derive_tolerance(1.0) == MAX_TOLERANCE


def test_the_row_kept_of_a_fit_is_the_one_made_anew():
    points = make_wire((5e5, 6.6e6, 20.0), (500_100.0, 6_600_030.0, 25.0))
    curve = fit_curve(points, np.arange(len(points)), tolerance=0.1)
    np.testing.assert_array_equal(curve.row, dataclasses.replace(curve).row)
    longer = dataclasses.replace(curve, high=curve.high + 5.0)
    assert longer.row[HIGH] == curve.high + 5.0


def test_one_place_is_as_many():
    curve = make_curve(make_wire((0.0, 0.0, 20.0), (100.0, 30.0, 20.0)))
    place = np.array([33.0, -7.0, 4.0])
    x, y = curve.local(place[None, :])
    assert curve.local_place(place) == pytest.approx((x[0], y[0]), abs=1e-12)


def make_many(seed, num):
    """Curves of 5 to 60 m in all directions within a square of 200 m."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-0.5, 0.5, 12)
    curves = []
    for length, angle, place in zip(
        rng.uniform(5, 60, num), rng.uniform(0, np.pi, num), rng.uniform(0, 200, (num, 2)),
        strict=True,
    ):
        at = length * x
        wire = np.stack([at * np.cos(angle), at * np.sin(angle), at**2 / 800.0 + 9.0], axis=1)
        curves.append(make_curve(wire + np.append(place, 0.0)))
    return curves


def measure_gap(first, second):
    """Return the least distance of two pieces in plan, from places 0.5 m apart [m]."""
    stations = [
        curve.position(np.arange(curve.low, curve.high + 0.5, 0.5))[:, :2]
        for curve in (first, second)
    ]
    return float(np.linalg.norm(stations[0][:, None] - stations[1], axis=2).min())


@pytest.mark.parametrize('margin', [1.0, 3.0, 20.0])
def test_all_that_is_near_is_found_and_nothing_that_is_far(margin):
    curves = make_many(3, 60)
    others = make_many(4, 25)
    num = 0
    for near, wanted in (
        (find_near(curves, margin), curves), (find_near(curves, margin, others), others),
    ):
        assert len(near.start) == 61
        for number, curve in enumerate(curves):
            found = near.of(number).tolist()
            assert found == sorted(set(found))
            for other, piece in enumerate(wanted):
                if piece is curve:
                    assert other not in found
                    continue
                gap = measure_gap(curve, piece) - curve.tolerance - piece.tolerance
                if gap <= margin - 0.5:
                    assert other in found
                    num += 1
                elif gap > np.sqrt(2.0) * (margin + curve.tolerance + piece.tolerance) + 0.5:
                    assert other not in found
    assert num > 20


def test_nearness_is_mutual_and_of_nothing_nothing_is_near():
    near = find_near(make_many(5, 80), 5.0)
    pairs = {(number, other) for number in range(80) for other in near.of(number).tolist()}
    assert len(pairs) > 100
    assert {(other, number) for number, other in pairs} == pairs
    assert find_near([], 5.0).start.tolist() == [0]
    assert find_near(make_many(5, 2), 5.0, []).start.tolist() == [0, 0, 0]
