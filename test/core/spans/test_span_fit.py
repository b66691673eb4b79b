# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_curve, make_index, make_route, make_wire

from plc_inspect.config import CatenarySettings, SupportSettings
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.span_fit import (
    collect_points,
    CutCurve,
    fit_spans,
    follow_strays,
    measure_coverage,
    pack_ends,
)


def lay_out(points, curves):
    return find_layout(points, curves, (), SupportSettings())


def fit(points, layout, seed=0):
    return fit_spans(
        points, make_index(points), layout, CatenarySettings(), np.random.default_rng(seed)
    )


def cut(curve, from_low=0.0, from_high=0.0):
    """Cut a curve this far from its ends."""
    return CutCurve(curve=curve, low=curve.low + from_low, high=curve.high - from_high)


@pytest.fixture
def route():
    """Make two spans of 100 m with three conductors each, of c = 800 m."""
    return make_route([(0, 0), (100, 0), (200, 0)])


def test_each_span_has_its_catenary_and_its_sag_within_three_sigma(route):
    points, curves = route
    finals = fit(points, lay_out(points, curves))
    assert len(finals) == 6
    for final in finals:
        catenary = final.curve.fit
        # curves cross at a shallow angle, and the ends are not settled yet
        assert final.high - final.low == pytest.approx(100.0, abs=0.6)
        assert catenary.c == pytest.approx(800.0, rel=0.02)
        sag, sigma = catenary.sag(final.low, final.high)
        assert 0.0 < sigma < 0.02
        expected = 800.0 * (np.cosh((final.high - final.low) / 1600.0) - 1.0)
        assert abs(sag - expected) < 3 * sigma


def test_a_span_is_fitted_to_all_its_points_and_not_only_to_those_of_its_curve(route):
    points, curves = route
    sparse = [make_curve(points, curve.points[::10]) for curve in curves]
    found = fit(points, lay_out(points, sparse))
    assert len(found) == len(curves)
    for number, final in enumerate(found):
        assert len(sparse[number].points) == 80
        assert final.curve.num_points > 780


def test_residuals_that_go_together_widen_sigma(route):
    points, curves = route
    alone, waving = (
        fit(cloud, lay_out(points, curves))[0].curve
        for cloud in (points, points + np.array([0.0, 0.0, 0.03]) * np.sin(points[:, :1]))
    )
    assert waving.fit.sag(-50.0, 50.0)[1] > 2 * alone.fit.sag(-50.0, 50.0)[1]


def test_the_same_generator_gives_the_same_fit_and_input_is_unchanged(route):
    points, curves = route
    layout, before = lay_out(points, curves), points.copy()
    start_x = layout.start_x.copy()
    one, other = fit(points, layout), fit(points, layout)
    np.testing.assert_array_equal(points, before)
    np.testing.assert_array_equal(layout.start_x, start_x)
    np.testing.assert_array_equal(pack_ends(one), pack_ends(other))
    for first, second in zip(one, other, strict=True):
        np.testing.assert_array_equal(first.curve.fit.shape, second.curve.fit.shape)


def test_points_are_collected_between_the_ends_and_a_slack_beyond():
    wire = make_wire((0.0, 0.0, 15.0), (100.0, 0.0, 15.0))
    points = np.vstack([wire, wire + np.array([0.0, 0.5, 0.0])])
    points = points[np.random.default_rng(0).permutation(len(points))]
    curve = make_curve(points, np.flatnonzero(points[:, 1] < 0.25))
    part, index = cut(curve, 20.0, 30.0), make_index(points)
    x, y = curve.local(points)
    distance = np.hypot(y, points[:, 2] - curve.fit.height(x))
    for slack in (0.0, 5.0):
        (chosen, measured), = collect_points(points, index, [part], slack)
        inside = (x >= part.low - slack) & (x <= part.high + slack)
        expected = np.flatnonzero(inside & (distance <= curve.tolerance))
        np.testing.assert_array_equal(chosen, expected)
        np.testing.assert_allclose(measured, distance[chosen], atol=2e-3)


def test_the_coverage_is_the_share_of_metres_that_hold_points():
    points = make_wire((0.0, 0.0, 15.0), (120.0, 0.0, 15.0), parts=((0.0, 1 / 3), (2 / 3, 1.0)))
    curve, index = make_curve(points), make_index(points)
    parts = [cut(curve), cut(curve, 80.0), cut(curve, 40.0, 40.0)]
    np.testing.assert_allclose(
        measure_coverage(points, index, parts), [2 / 3, 1.0, 0.0], atol=0.05
    )


def test_no_curves():
    points = np.zeros((0, 3))
    assert fit(points, lay_out(points, [])) == []
    assert collect_points(points, make_index(points), [], 0.3) == []
    assert measure_coverage(points, make_index(points), []).shape == (0,)
    assert pack_ends([]).shape == (0, 2)


def follow(beyond, per_metre=4.0, side=1, wire=False):
    """Follow a conductor of 40 m, with other points beyond it, at one side."""
    own = make_wire((0.0, 0.0, 20.0), (40.0, 0.0, 20.0), 600.0, noise=0.03, per_metre=per_metre)
    own[:, 0] = own[:, 0] if side > 0 else -own[:, 0]
    beyond = np.array(beyond, dtype=np.float64).reshape(-1, 3)
    beyond[:, 0] *= side
    points = np.vstack([own, beyond])
    curve = make_curve(points, np.arange(len(own)))
    owner = np.where(np.arange(len(points)) < len(own), 0, -1).astype(np.int32)
    if wire:
        owner[len(own):] = 1
    far, chosen, distance = follow_strays(
        points, make_index(points), CutCurve(curve=curve, low=curve.low, high=curve.high),
        1 if abs(curve.position(curve.high)[0, 0]) > 20.0 else -1, owner, 2, per_metre,
    )
    assert len(chosen) == len(distance)
    assert (chosen >= len(own)).all()
    assert (np.diff(chosen) > 0).all()
    return far, len(chosen)


def make_beyond(start=40.0, length=12.0, aside=0.3, per_metre=4.0, seed=5):
    """Make points of the same conductor beyond 40 m, beside its curve."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(start, start + length, int(length * per_metre))
    z = 20.0 + 600.0 * (np.cosh((x - 20.0) / 600.0) - np.cosh(20.0 / 600.0))
    return np.column_stack([x, np.full(len(x), aside), z + rng.normal(0.0, 0.03, len(x))])


@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize('aside', [0.0, -0.3])
def test_a_conductor_that_drifts_off_its_curve_is_followed(side, aside):
    far, num = follow(make_beyond(aside=aside), side=side)
    assert far == pytest.approx(12.0, abs=0.6)
    assert num == 48


@pytest.mark.parametrize('beyond', [
    [],
    make_beyond(aside=0.7),  # another one beside it
    make_beyond(start=44.5),  # not seen in between
    make_beyond(per_metre=0.4),  # much thinner
])
def test_no_conductor_is_followed_where_none_goes_on(beyond):
    assert follow(beyond) == (0.0, 0)


def test_no_conductor_is_followed_into_a_crown_or_another_one():
    rng = np.random.default_rng(6)
    for per_metre in (3.0, 30.0):
        crown = rng.uniform((40.0, -3.0, 17.0), (50.0, 3.0, 23.0), (int(60 * 6 * per_metre), 3))
        far, num = follow(crown)
        assert far < 2.0
        assert num < 5
    assert follow(make_beyond(), wire=True) == (0.0, 0)
