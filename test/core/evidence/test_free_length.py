# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Free metres of a curve: clean, cluttered, empty, and beside other wires."""

import numpy as np
import pytest
from toys import make_curve, make_index, make_sight, make_tree, make_wire, turn

from plc_inspect.core.evidence.free_length import measure_free_length


def make(length=60.0, **changes):
    return make_wire((0.0, 0.0, 12.0), (length, 0.0, 12.0), **{'c': 700.0, **changes})


def measure(wire, others=(), ignored=0, seen=True):
    """Return the free length of a wire among others, the last of which do not count."""
    points = np.vstack([wire, *others])
    curve = make_curve(points, np.arange(len(wire)), 0.2)
    ignore = np.arange(len(points)) >= len(points) - ignored
    sight = make_sight(points, seen)
    return curve, measure_free_length(points, make_index(points), curve, ignore, sight)


@pytest.mark.parametrize('per_metre', [8.0, 60.0])
def test_each_metre_of_a_wire_in_the_air_is_free(per_metre):
    curve, free = measure(make(per_metre=per_metre))
    assert free.close == pytest.approx(curve.length, rel=0.15)
    assert free.wide == pytest.approx(curve.length, rel=0.15)


def test_a_metre_with_few_points_says_less():
    curve, free = measure(make(per_metre=2.0))
    assert 0.3 * curve.length < free.close <= free.wide < 0.9 * curve.length


def test_a_line_in_a_sheet_is_cluttered_all_along():
    sheet = make(per_metre=200.0)
    sheet[:, 1] = np.random.default_rng(0).uniform(-2.0, 2.0, len(sheet))
    curve, free = measure(make(), [sheet])
    assert free.close < -0.8 * curve.length
    assert free.wide < -0.8 * curve.length


@pytest.mark.parametrize(('share', 'free_share'), [(0.04, 1.0), (0.25, -1.0)])
def test_a_fifth_of_the_points_about_a_dense_curve_holds_it(share, free_share):
    rng = np.random.default_rng(0)
    wire = make(per_metre=150.0)
    rods = wire[rng.random(len(wire)) < share / (1.0 - share)]
    azimuth, radius = rng.uniform(0.0, np.pi, len(rods)), rng.uniform(0.4, 0.9, len(rods))
    rods = rods + np.stack([0.0 * radius, radius * np.cos(azimuth), radius * np.sin(azimuth)], 1)
    curve, free = measure(wire, [rods])
    assert free.wide == pytest.approx(free_share * curve.length, rel=0.2)


def test_a_stray_point_in_the_ring_of_a_sparse_wire_holds_nothing():
    wire = make(per_metre=5.0)
    stray = wire[::20] + np.array([0.0, 0.5, 0.5])
    curve, free = measure(wire, [stray])
    assert free.wide > 0.8 * curve.length


def test_a_crown_counts_along_its_own_length_alone():
    crown = make_tree(30.0, 0.0, 13.5, 9.5, radius=5.0, num=6000)
    curve, free = measure(make(), [crown])
    assert free.wide == pytest.approx(curve.length - 20.0, abs=6.0)


def test_metres_without_points_say_nothing():
    curve, free = measure(make(parts=((0.0, 0.3), (0.7, 1.0))))
    assert free.wide == pytest.approx(0.6 * curve.length, abs=4.0)


def test_other_wires_do_not_count_once_they_are_known():
    beside = [make() + np.array([0.0, side, 0.0]) for side in (-0.5, 0.5)]
    curve, free = measure(make(), beside)
    assert free.wide < 0.0
    curve, free = measure(make(), beside, ignored=sum(map(len, beside)))
    assert free.wide == pytest.approx(curve.length, rel=0.1)


def test_one_line_beside_that_nobody_knows_is_told_from_other_clutter():
    rng = np.random.default_rng(0)
    cables = make(per_metre=40.0)
    cables = cables + rng.normal(0.0, 0.08, cables.shape) * [0.0, 1.0, 1.0] - [0.0, 0.2, 0.7]
    curve, free = measure(make(), [cables])
    assert free.cluttered > 0.7 * curve.length
    assert free.company > 0.9 * free.cluttered


def test_the_edge_of_a_sheet_is_cluttered_all_along():
    sheet = make(per_metre=100.0)
    sheet[:, 1] = np.random.default_rng(0).uniform(0.0, 2.0, len(sheet))
    curve, free = measure(make(), [sheet])
    assert free.wide < -0.8 * curve.length
    assert free.company < 0.1 * free.cluttered


def test_no_points_are_no_evidence():
    wire = make()
    curve = make_curve(wire)
    far = wire + np.array([0.0, 50.0, 0.0])
    ignore = np.zeros(len(far), dtype=bool)
    free = measure_free_length(far, make_index(far), curve, ignore, make_sight(far))
    assert (free.close, free.wide, free.open) == (0.0, 0.0, 0.0)


def test_where_nothing_was_seen_below_no_metre_is_open():
    curve, free = measure(make(), seen=False)
    assert free.wide == pytest.approx(curve.length, rel=0.15)
    assert free.open == free.close == 0.0
    # scan lines on a flat roof lie farther apart than the ring is wide, and hide the ground
    lines = [make(c=1e5) + np.array([0.0, side, 0.0]) for side in (-1.2, 1.2)]
    _, free = measure(make(c=1e5), lines, seen=False)
    assert free.open <= 0.0 < free.wide


@pytest.mark.parametrize(('side', 'alone'), [(1.2, 0.0), (2.8, 0.0), (3.2, 1.0)])
def test_a_row_beside_a_curve_within_3_m_leaves_no_metre_alone(side, alone):
    wire, row = make(c=1e5), make(c=1e5) + np.array([0.0, side, 0.0])
    for seen in (False, True):
        curve, free = measure(wire, [row], seen=seen)
        own = 0.0 if seen else alone * curve.length
        assert free.alone == pytest.approx(own, rel=0.1, abs=1.0)
        assert free.wide == pytest.approx(curve.length, rel=0.1)
    _, free = measure(wire, [row], ignored=len(row), seen=False)
    assert free.alone == pytest.approx(alone * curve.length, rel=0.1, abs=1.0)


def test_a_crown_below_an_unseen_ground_makes_it_open():
    crown = make_tree(30.0, 0.0, 6.0, 1.0, radius=8.0, num=4000)
    _curve, free = measure(make(), [crown], seen=False)
    assert 10.0 < free.open < 20.0 < free.wide


def test_clutter_counts_whatever_lies_below():
    sheet = make(per_metre=200.0)
    sheet[:, 1] = np.random.default_rng(0).uniform(-2.0, 2.0, len(sheet))
    curve, free = measure(make(), [sheet], seen=False)
    assert free.open < -0.8 * curve.length


def test_a_rigid_motion_changes_nothing():
    wire, crown = make(), make_tree(30.0, 0.0, 13.5, 9.5, radius=5.0)
    _, one = measure(wire, [crown])
    shift = (5e5, 6e6, 100.0)
    _, other = measure(turn(wire, 0.7, shift), [turn(crown, 0.7, shift)])
    assert other.wide == pytest.approx(one.wide, abs=1.5)
    assert other.close == pytest.approx(one.close, abs=1.5)
