# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import itertools

import numpy as np
import pytest
from toys import hang, make_curve, make_index, make_wire, turn

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.growing import extend
from plc_inspect.core.catenary.profile import (
    profile_curve,
)

SETTINGS = CatenarySettings()


def make_line(parts=((0.0, 1.0),), per_metre=8.0, length=100.0):
    return make_wire((0.0, 0.0, 20.0), (length, 0.0, 20.0), per_metre=per_metre, parts=parts)


@pytest.mark.parametrize('degrees', [0, 90, 200])
def test_a_curve_grows_to_the_ends_of_its_wire_and_no_farther(degrees):
    wire = turn(make_line(), np.radians(degrees))
    middle = np.flatnonzero(np.abs(np.linalg.norm(wire[:, :2], axis=1) - 50.0) < 25.0)
    grown = extend(wire, make_index(wire), [make_curve(wire, middle)], SETTINGS)[0]
    assert grown.length == pytest.approx(100.0, abs=0.5)
    assert len(grown.points) > 0.98 * len(wire)


def test_a_curve_grows_to_the_ends_of_a_long_span():
    wire = make_line(length=400.0)
    start = np.flatnonzero(wire[:, 0] < 120.0)
    grown = extend(wire, make_index(wire), [make_curve(wire, start)], SETTINGS)[0]
    assert grown.length == pytest.approx(400.0, abs=0.5)


def test_growth_steps_over_short_gaps_and_stops_at_long_ones():
    points = make_line(((0.0, 0.4), (0.45, 0.7), (0.9, 1.0)))
    start = np.flatnonzero(points[:, 0] < 40.0)
    grown = extend(points, make_index(points), [make_curve(points, start)], SETTINGS)[0]
    assert grown.length == pytest.approx(70.0, abs=1.0)
    step = dataclasses.replace(SETTINGS, max_step=25.0)
    grown = extend(points, make_index(points), [make_curve(points, start)], step)[0]
    assert grown.length == pytest.approx(100.0, abs=1.0)


def test_what_is_seen_in_few_places_is_followed_over_longer_gaps():
    parts = ((0.0, 0.5), (0.54, 1.0))  # 12 m of 300 m are not seen
    sparse = make_line(parts, per_metre=0.4, length=300.0)  # an earth wire from the air
    start = make_curve(sparse, np.flatnonzero(sparse[:, 0] < 150.0))
    grown = extend(sparse, make_index(sparse), [start], SETTINGS)[0]
    assert grown.length > 200.0  # the gap, and as far as the rounds of growth reach
    dense = make_line(parts, per_metre=8.0, length=300.0)
    start = make_curve(dense, np.flatnonzero(dense[:, 0] < 150.0))
    grown = extend(dense, make_index(dense), [start], SETTINGS)[0]
    assert grown.length == pytest.approx(150.0, abs=1.0)


def test_growth_takes_nothing_away_and_leaves_the_input_alone():
    points = make_line()
    before = points.copy()
    curve = make_curve(points, np.arange(200, 600))
    grown = extend(points, make_index(points), [curve], SETTINGS)[0]
    np.testing.assert_array_equal(points, before)
    assert np.isin(curve.points, grown.points).mean() > 0.98
    assert len(curve.points) <= 400


def test_nothing_to_collect():
    wire = make_line()
    curve = make_curve(wire)
    none = np.zeros((0, 3))
    found = profile_curve(none, make_index(none), curve, curve.low, curve.high)
    assert found.core.sum() == found.shell.sum() == 0
    assert len(found.chosen) == 0
    assert found.coverage == 0.0
    assert found.crowding == 1.0
    far = np.array([[0.0, 500.0, 20.0]])
    assert extend(far, make_index(far), [curve], SETTINGS)[0] is curve


def hang_rack(supports, apart=0.27, num=5, c=275.0):
    """Return the points of a rack, and the number of the conductor-span of each."""
    wires = []
    for span, (first, last) in enumerate(itertools.pairwise(supports)):
        for number in range(num):
            z = 9.0 - apart * number
            wires.append(make_wire((first, 0.0, z), (last, 0.0, z), c=c, per_metre=25.0,
                                   noise=0.045, seed=10 * span + number))
    owner = np.repeat(np.arange(len(wires)), [len(wire) for wire in wires])
    return np.vstack(wires), owner


@pytest.mark.parametrize('as_others', [False, True])
def test_a_rack_does_not_grow_over_its_supports_into_the_wires_beside(as_others):
    supports = (0.0, 31.0, 51.0, 92.0, 116.0)
    points, owner = hang_rack(supports)
    curves = [
        make_curve(points, np.flatnonzero(owner == k), tolerance=0.18) for k in range(20)
    ]
    index = make_index(points)
    wanted, others = (curves[10:15], curves[:10] + curves[15:]) if as_others else (curves, ())
    found = extend(points, index, wanted, SETTINGS, others)
    for number, grown in enumerate(found, start=10 if as_others else 0):
        first, last = supports[number // 5 : number // 5 + 2]
        ends = [grown.position(x)[0, 0] for x in (grown.low, grown.high)]
        assert min(ends) > first - 1.5
        assert max(ends) < last + 1.5
        assert (owner[grown.points] == number).mean() > 0.9


@pytest.mark.parametrize('seed', [1, 2])
def test_wires_that_are_known_to_be_apart_keep_their_points(seed):
    rng = np.random.default_rng(seed)
    points, owner = hang_rack((0.0, 30.0), apart=0.3, num=3)
    points += rng.normal(0.0, 0.07, points.shape)
    index = make_index(points)
    # the third is seen twice, in halves that are one
    half = points[:, 0] < 15.0
    chosen = [owner == 0, owner == 1, (owner == 2) & half, (owner == 2) & ~half]
    curves = [make_curve(points, np.flatnonzero(own), tolerance=0.25) for own in chosen]
    found = extend(points, index, curves, SETTINGS, apart=True)
    for grown, number in zip(found, (0, 1, 2, 2), strict=True):
        assert (owner[grown.points] == number).mean() > 0.9
        assert grown.length > 27.0
    # else each takes what lies near it
    middle = extend(points, index, curves, SETTINGS)[1]
    assert (owner[middle.points] == 1).mean() < 0.75


@pytest.mark.parametrize('seed', [1, 2])
def test_a_wire_does_not_grow_over_its_support_onto_another_of_the_next_span(seed):
    """Beyond the pole a rack rises, so that the next wire comes to where it would be."""
    own = make_wire((0.0, 0.0, 10.7), (22.0, 0.0, 10.0), c=340.0, per_metre=30.0, noise=0.045,
                    seed=seed)
    rising = [
        make_wire((22.0, 0.0, 10.0 - 0.5 * k), (29.6, 0.0, 10.7 - 0.5 * k), c=340.0,
                  per_metre=30.0, noise=0.045, seed=seed + 10 * k) for k in range(5)
    ]
    points = np.vstack([own, *rising])
    curve = make_curve(points, np.arange(len(own)), tolerance=0.18)
    (grown,) = extend(points, make_index(points), [curve], SETTINGS)
    assert grown.position(grown.high)[0, 0] < 23.5
    assert grown.length > 20.0


def test_halves_of_one_conductor_grow_into_each_other():
    points = make_line(per_metre=20.0)
    halves = [
        make_curve(points, np.flatnonzero((points[:, 0] > low) & (points[:, 0] < high)))
        for low, high in ((2.0, 45.0), (50.0, 98.0))
    ]
    for grown in extend(points, make_index(points), halves, SETTINGS):
        assert grown.length > 95.0


def test_an_end_that_follows_what_crosses_is_walked_back():
    wire = make_line(per_metre=20.0, length=60.0)
    x = np.linspace(60.0, 64.0, 80)  # leaves the curve by 1 in 20
    stray = np.column_stack([x, 0.05 * (x - 60.0) + 0.02, hang(x, 60.0, 20.0, 20.0, 800.0)])
    points = np.vstack([wire, stray])
    curve = make_curve(points, tolerance=0.2)
    (grown,) = extend(points, make_index(points), [curve], SETTINGS)
    assert curve.length > 63.0
    assert 59.0 < grown.length < 62.5


@pytest.mark.parametrize('seed', range(3))
def test_an_end_of_a_bundle_is_not_walked_back_for_a_strand_below(seed):
    def strand(y, z, number):
        return make_wire(
            (0.0, y, z), (90.0, y, z), c=900.0, per_metre=3.0, seed=10 * seed + number,
        )

    upper = np.vstack([strand(-0.2, 20.0, 0), strand(0.2, 20.0, 1)])
    points = np.vstack([upper, strand(0.0, 19.66, 2)])
    curve = make_curve(points, np.arange(len(upper)), 0.4)
    (grown,) = extend(points, make_index(points), [curve], SETTINGS)
    assert grown.length == pytest.approx(90.0, abs=0.5)
    assert len(grown.points) > 0.99 * len(points)
