# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Catenaries of the simulator against the formulas and against brute force."""

from dataclasses import replace
import math

import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.sim.scenes.conductors import hang, measure_distances, solve_constant


def _hang(start, end, **options):
    given = options.pop('c', None)
    item = hang(np.array(start, float), np.array(end, float), options.pop('sag_ratio', 0.03),
                line_id=0, span_id=0, **options)
    return item if given is None else replace(item, c=given)


def test_level_span_by_hand():
    """D = c (cosh(S / 2c) - 1) with S = 200, c = 600: 8.3565 m, lowest in the middle."""
    item = _hang((0, 0, 20), (0, 200, 20), c=600.0)
    depth = 600.0 * (math.cosh(200.0 / 1200.0) - 1.0)
    assert depth == pytest.approx(8.3527, abs=1e-3)
    assert item.sag == pytest.approx(depth, abs=1e-9)
    assert item.lowest == pytest.approx([0.0, 100.0, 20.0 - depth], abs=1e-9)
    assert item.azimuth == pytest.approx(math.pi / 2)
    assert item.b == pytest.approx(100.0)


@pytest.mark.parametrize('rise', [-40.0, -3.0, 0.0, 12.0, 60.0])
def test_curve_meets_both_ends(rise):
    """The curve goes through its attachments however steep the span."""
    item = _hang((5, -3, 20), (155, 97, 20 + rise), c=450.0)
    assert item.locate(np.array([0.0, item.length])) == pytest.approx(
        np.array([item.start, item.end]), abs=1e-9)
    x = np.linspace(0.0, item.length, 20001)
    chord = 20.0 + rise * x / item.length
    assert item.sag == pytest.approx(float((chord - item.heights(x)).max()), abs=1e-6)
    assert item.lowest[2] == pytest.approx(float(item.heights(x).min()), abs=1e-5)


def test_lowest_point_outside_the_span_is_an_end():
    """A steep span falls all the way: its lowest point is its lower end."""
    item = _hang((0, 0, 0), (50, 0, 40), c=800.0)
    assert item.b < 0.0
    assert item.lowest == pytest.approx(item.start)


@pytest.mark.parametrize(('length', 'sag'), [(40.0, 0.5), (300.0, 10.0), (90.0, 9.0)])
def test_constant_gives_the_sag(length, sag):
    """The constant that was solved for hangs as deep as was asked."""
    c = solve_constant(length, sag)
    assert c * (math.cosh(length / (2 * c)) - 1) == pytest.approx(sag, abs=1e-9)
    assert _hang((0, 0, 0), (length, 0, 0), sag_ratio=sag / length).sag == pytest.approx(sag)


def test_quadratic_form_is_near_the_catenary():
    """The least-squares parabola lies within centimetres of a flat catenary."""
    item = _hang((0, 0, 20), (100, 0, 25), c=700.0)
    x = np.linspace(0.0, 100.0, 50)
    assert np.polyval(item.quadratic, x) == pytest.approx(item.heights(x), abs=0.01)


def test_distances_against_brute_force():
    """Distances agree with those to a very fine polyline; the points stay as they were."""
    item = _hang((0, 0, 20), (80, 30, 26))
    rng = np.random.default_rng(0)
    points = item.locate(rng.uniform(-5, item.length + 5, 300)) + rng.normal(0, 2, (300, 3))
    points[:3] = item.locate(np.array([0.0, 10.0, item.length]))
    before = points.copy()
    fine = item.sample(0.002)
    brute = [np.linalg.norm(fine - point, axis=1).min() for point in points]
    assert measure_distances(points, item) == pytest.approx(brute, abs=2e-3)
    assert measure_distances(points[:3], item) == pytest.approx(np.zeros(3), abs=1e-4)
    np.testing.assert_array_equal(points, before)
    assert measure_distances(np.zeros((0, 3)), item).shape == (0,)


@pytest.mark.parametrize(('end', 'ratio'), [((0, 0, 5), 0.03), ((50, 0, 0), 0.0)])
def test_impossible_spans_raise(end, ratio):
    """No span without length, none without sag."""
    with pytest.raises(DataError, match='no span of'):
        _hang((0, 0, 0), end, sag_ratio=ratio)
