# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors side by side that clustering took for one."""

import numpy as np
import pytest

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import fit_curve
from plc_inspect.core.catenary.duplicates import is_thick
from plc_inspect.core.catenary.twins import part_twins

NOISE = 0.05


def hang(apart, *, length=40.0, num=400, noise=NOISE, seed=0, constant=300.0):
    """Return points of conductors, each ``apart`` (across, up) from the first [m]."""
    rng = np.random.default_rng(seed)
    parts = []
    for across, up in apart:
        x = rng.uniform(0.0, length, num)
        z = 8.0 + up + constant * (np.cosh((x - length / 2) / constant) - 1.0)
        points = np.column_stack([x, np.full(num, across), z])
        parts.append(points + rng.normal(0.0, noise, (num, 3)))
    return np.concatenate(parts)


def part(points, **settings):
    """Return the curves that one thick curve over all points is parted into."""
    whole = fit_curve(points, np.arange(len(points)), tolerance=0.6)
    parts = part_twins(points, [whole], CatenarySettings(**settings))
    return whole, parts


@pytest.mark.parametrize('apart', [
    [(0.0, 0.0), (0.3, 0.0)], [(0.0, 0.0), (0.0, 0.35)], [(0.0, 0.0), (0.25, -0.2)],
])
def test_two_conductors_get_a_curve_each(apart):
    points = hang(apart)
    whole, parts = part(points)
    assert is_thick(whole)
    assert len(parts) == 2
    own = [set(range(400 * k, 400 * k + 400)) for k in range(2)]
    for curve in parts:
        shares = [len(own[k] & set(curve.points.tolist())) / len(curve.points) for k in range(2)]
        assert max(shares) > 0.97
        assert not is_thick(curve)
        assert curve.length > 38.0


def test_three_conductors_get_a_curve_each():
    points = hang([(0.0, 0.0), (0.3, 0.0), (0.6, 0.0)])
    _, parts = part(points)
    middles = sorted(float(np.median(points[curve.points, 1])) for curve in parts)
    assert middles == pytest.approx([0.0, 0.3, 0.6], abs=0.03)


@pytest.mark.parametrize('points', [
    hang([(0.0, 0.0)], noise=0.16, num=800),  # a hedge
    hang([(0.0, 0.0), (0.15, 0.0)], noise=0.02),  # strips of a survey
    np.concatenate([  # one conductor after the other
        hang([(0.0, 0.0)], length=20.0, constant=1e4),
        np.add(hang([(0.35, 0.0)], length=20.0, constant=1e4), [20.0, 0.0, 0.0]),
    ]),
], ids=['one', 'strips', 'in turn'])
def test_what_is_one_stays_one(points):
    whole, parts = part(points)
    assert len(parts) == 1
    assert parts[0] is whole


def test_what_is_as_long_as_the_span_of_a_bundle_stays_whole():
    points = hang([(0.0, 0.0), (0.4, 0.0)], length=120.0, num=1200, constant=900.0)
    assert len(part(points)[1]) == 1
    assert len(part(points, bundle_length=150.0)[1]) == 2


def test_a_conductor_with_a_curve_of_its_own_gets_no_other_one():
    points = hang([(0.0, 0.0), (0.3, 0.0)])
    whole = fit_curve(points, np.arange(len(points)), tolerance=0.6)
    own = fit_curve(points, np.arange(400), tolerance=0.15)
    curves = part_twins(points, [whole, own], CatenarySettings())
    assert len(curves) == 2
    assert any(curve is own for curve in curves)
