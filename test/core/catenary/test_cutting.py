# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors side by side are cut where all of them are bent."""

from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_wire, turn

from plc_inspect.core.catenary import cutting
from plc_inspect.core.catenary.curve import fit_curve
from plc_inspect.core.catenary.cutting import (
    cut_together,
    cut_turned,
    find_doubtful,
    measure_bend,
)

WIDTH, LEAST = 30.0, 5.0
OFFSETS = (-0.9, -0.3, 0.3, 0.9)


def make_rack(ends=(0.0, 22.0, 44.0), offsets=OFFSETS, heights=None, per_metre=3.0, seed=0):
    """Return points of conductors over supports at ``ends``, and a curve over all of each."""
    heights = heights or (9.0,) * len(ends)
    points, curves, num = [], [], 0
    for conductor, offset in enumerate(offsets):
        parts = [
            make_wire((low, offset, heights[k]), (high, offset, heights[k + 1]), 800.0, per_metre,
                      0.04, 1000 * seed + 10 * conductor + k)
            for k, (low, high) in enumerate(pairwise(ends))
        ]
        points += parts
        curves.append(np.arange(num, num + sum(map(len, parts))))
        num = curves[-1][-1] + 1
    points = np.vstack(points)
    return points, [make_curve(points, own, 0.2) for own in curves]


@pytest.mark.parametrize('yaw', [0.0, 1.0, 3.0])
def test_a_rack_over_a_support_is_cut_there(yaw):
    for seed in range(5):
        points, _ = make_rack(seed=seed)
        points = turn(points, yaw, (300.0, -200.0, 0.0))
        chosen = np.array_split(np.arange(len(points)), len(OFFSETS))
        curves = [make_curve(points, own, 0.2) for own in chosen]
        parts = cut_together(points, curves, WIDTH, LEAST)
        assert len(parts) == 2 * len(curves)
        assert [part.length for part in parts] == pytest.approx([22.0] * len(parts), abs=5.0)


@pytest.mark.parametrize('yaw', [0.0, np.pi / 2])
def test_three_spans_are_told_apart(yaw):
    """The bend at one support is measured up to the next, whichever way each curve runs."""
    for seed in range(5):
        points, curves = make_rack(ends=(0.0, 22.0, 50.0, 64.0), per_metre=10.0, seed=seed)
        points = turn(points, yaw)
        curves = [
            fit_curve(points, curve.points, tolerance=0.2, azimuth=yaw + np.pi * (k % 2))
            for k, curve in enumerate(curves)
        ]
        assert len(cut_together(points, curves, WIDTH, LEAST)) == 3 * len(curves)


def test_one_alone_is_cut_where_it_shows_its_support_itself():
    points, curves = make_rack(offsets=(0.0,))
    assert cut_together(points, curves, WIDTH, LEAST) == curves
    points, curves = make_rack(offsets=(0.0,), per_metre=60.0)
    assert len(cut_together(points, curves, WIDTH, LEAST)) == 2


LOW_TOWER = (7.5, 7.5, 12.0)


@pytest.mark.parametrize('num', [1, 2, 3])
@pytest.mark.parametrize('yaw', [0.0, 2.0])
def test_a_support_that_bends_them_by_little_is_found(yaw, num):
    """One as high as a curve over both spans would pass, between spans of 84 and 56 m."""
    for seed in range(5):
        points, curves = make_rack(
            (0.0, 84.0, 140.0), (-1.5, 0.0, 1.5)[:num], LOW_TOWER, per_metre=17.0, seed=seed
        )
        points = turn(points, yaw)
        curves = [make_curve(points, curve.points, 0.2) for curve in curves]
        parts = cut_together(points, curves, WIDTH, LEAST)
        lengths = sorted(part.length for part in parts)
        assert lengths == pytest.approx([56.0] * num + [84.0] * num, abs=5.0)


def turn_beyond(points, x, angle):
    """Turn what lies beyond x in plan, about a place on the line [m, rad]."""
    moved = points.copy()
    beyond = points[:, 0] > x
    moved[beyond] = turn(points[beyond] - (x, 0.0, 0.0), angle, (x, 0.0, 0.0))
    return moved


@pytest.mark.parametrize('yaw', [0.0, 2.0])
def test_one_that_turns_by_less_than_a_degree_is_cut_there(yaw):
    for seed in range(5):
        points, _ = make_rack((0.0, 49.0, 86.0), (0.0,), LOW_TOWER, per_metre=19.0, seed=seed)
        points = turn(turn_beyond(points, 49.0, 0.011), yaw)
        curve = make_curve(points, np.arange(len(points)), 0.3)
        lengths = [part.length for part in cut_turned(points, curve)]
        assert sorted(lengths) == pytest.approx([37.0, 49.0], abs=1.5)


@pytest.mark.parametrize(('angle', 'num'), [(0.0027, 1), (0.011, 2)])
def test_what_drift_turns_in_a_long_span_is_no_support(angle, num):
    points, _ = make_rack((0.0, 290.0), (0.0,), LOW_TOWER[:2], per_metre=7.0)
    points = turn_beyond(points, 190.0, angle)
    curve = make_curve(points, np.arange(len(points)), 0.4)
    assert len(cut_turned(points, curve)) == num


@pytest.mark.parametrize('beyond', [-1.0, 0.0])
def test_one_that_turns_at_its_end_is_left_as_it_is(monkeypatch, beyond):
    points, _ = make_rack((0.0, 49.0, 86.0), (0.0,), LOW_TOWER, per_metre=19.0)
    points = turn_beyond(points, 49.0, 0.011)
    curve = make_curve(points, np.arange(len(points)), 0.3)
    end = curve.position(curve.low + beyond)[0, :2]
    monkeypatch.setattr(cutting, '_settle_between', lambda *_: end)
    assert cut_turned(points, curve) == [curve]


@pytest.mark.parametrize('depth', [0.0, 0.3, -0.3])
def test_one_that_wind_swings_is_not_cut(depth):
    for seed in range(5):
        points, _ = make_rack((0.0, 86.0), (0.0,), per_metre=19.0, seed=seed)
        x = points[:, 0] / 86.0
        points[:, 1] += 4.0 * depth * x * (1.0 - x)
        curve = make_curve(points, np.arange(len(points)), 0.4)
        assert cut_turned(points, curve) == [curve]


def test_two_strips_askew_are_no_turn():
    """From the middle on all points lie 8 cm aside."""
    for seed in range(5):
        points, _ = make_rack((0.0, 86.0), (0.0,), per_metre=19.0, seed=seed)
        points[points[:, 0] > 43.0, 1] += 0.08
        curve = make_curve(points, np.arange(len(points)), 0.4)
        assert cut_turned(points, curve) == [curve]


def test_a_turn_that_is_too_little_to_cut_asks_for_a_pole():
    """Four conductors that turn by 0.4 degrees at a low pole; those of one span ask for none."""
    for seed in range(5):
        points, _ = make_rack(
            (0.0, 28.0, 56.0), heights=(9.0, 8.51, 9.0), per_metre=25.0, seed=seed
        )
        straight = points.copy()
        points = turn_beyond(points, 28.0, 0.007)
        both = []
        for own in (points, straight[straight[:, 0] < 28.0]):
            ends = np.flatnonzero(np.diff(own[:, 0]) < -10.0) + 1
            curves = [
                make_curve(own, part, 0.2) for part in np.split(np.arange(len(own)), ends)
            ]
            both.append(find_doubtful(own, curves, WIDTH))
        found, none = both
        assert none == []
        places = [curve.position(x)[0, 0] for curve, x in found]
        assert places == pytest.approx([28.0] * 4, abs=2.0)
    assert find_doubtful(points, [], WIDTH) == []


@pytest.mark.parametrize('amplitude', [0.05, -0.05])
def test_what_drift_bends_is_no_support(amplitude):
    """One wave along the span, whose halves are drawn in different ways."""
    for seed in range(5):
        points, curves = make_rack((0.0, 140.0), (-1.5, 0.0, 1.5), (9.0, 9.0), 17.0, seed)
        points[:, 2] += amplitude * np.sin(2.0 * np.pi * points[:, 0] / 140.0)
        curves = [make_curve(points, curve.points, 0.2) for curve in curves]
        assert cut_together(points, curves, WIDTH, LEAST) == curves


def test_what_strips_shift_by_turns_is_no_support():
    """Scan lines of strips 6 cm askew, each seen for 3 m: all conductors are shifted alike."""
    for seed in range(5):
        points, curves = make_rack((0.0, 48.0), (-0.8, 0.0, 0.8), (9.0, 9.0), 15.0, seed)
        shift = np.random.default_rng(seed).choice([-0.06, 0.0, 0.06], 17)
        points[:, 2] += shift[(points[:, 0] / 3.0).astype(int)]
        curves = [make_curve(points, curve.points, 0.2) for curve in curves]
        assert cut_together(points, curves, WIDTH, LEAST) == curves


def test_what_bends_one_of_several_is_no_support():
    """Leaves on one conductor draw its points aside."""
    points, curves = make_rack(ends=(0.0, 80.0), per_metre=10.0)
    x = points[curves[0].points, 0]
    points[curves[0].points, 2] += 0.25 * np.exp(-((x - 30.0) / 3.0) ** 2)
    assert cut_together(points, curves, WIDTH, LEAST) == curves


def test_conductors_of_one_span_are_left_as_they_are():
    for seed in range(10):
        points, curves = make_rack(ends=(0.0, 44.0), seed=seed)
        assert cut_together(points, curves, WIDTH, LEAST) == curves


def test_a_conductor_beside_them_that_hangs_elsewhere_is_not_cut():
    points, curves = make_rack(per_metre=30.0)
    beside = make_wire((0.0, 2.5, 9.0), (44.0, 2.5, 9.0), 800.0, 30.0, 0.04, 99)
    both = np.vstack([points, beside])
    other = make_curve(both, np.arange(len(points), len(both)), 0.2)
    parts = cut_together(both, [*curves, other], WIDTH, LEAST)
    assert len(parts) == 2 * len(curves) + 1
    assert parts[-1] is other


def test_what_lies_farther_off_or_crosses_is_asked_for_itself():
    points, curves = make_rack()
    for moved in (turn(points, 0.0, (0.0, WIDTH + 3.0, 0.0)), turn(points, 1.0)):
        own = [make_curve(moved, curve.points, 0.2) for curve in curves[:1]]
        assert cut_together(moved, own, WIDTH, LEAST) == own


def test_the_order_of_curves_is_kept_and_no_curve_is_an_empty_list():
    points, curves = make_rack()
    parts = cut_together(points, curves[::-1], WIDTH, LEAST)
    across = [float(part.position(part.mean_x)[0, 1]) for part in parts]
    assert across == pytest.approx(np.repeat(OFFSETS[::-1], 2), abs=0.1)
    assert cut_together(points, [], WIDTH, LEAST) == []


def test_a_bend_is_measured_with_its_uncertainty():
    for k, kink in enumerate((0.0, 0.02, 0.08)):
        x = np.linspace(0.0, 60.0, 600)
        z = 9.0 + x * x / 1600.0 - kink * np.maximum(x - 30.0, 0.0)
        points = np.column_stack([x, np.zeros(600), z])
        points += np.random.default_rng(k).normal(0.0, 0.02, points.shape)
        curve = make_curve(points, tolerance=1.0)
        bend, sigma = measure_bend(points, curve, curve.local_place(np.array([30.0, 0.0]))[0])
        assert bend == pytest.approx(kink, abs=4.0 * sigma)
        assert 0.0 < sigma < 0.005
