# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_ground, make_pole, make_tree, make_wire

from plc_inspect.config import Settings
from plc_inspect.core.catenary.cutting import cut_curve
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.standing_poles import find_poles, join_at_poles, StandingPole
from plc_inspect.core.spans.stations import cut_at_poles

SETTINGS = Settings()
HIGH_PART = make_pole(60.0, 0.0, 8.2)[:, 2] > 6.2


def look(*things, height=8.0, offsets=(-0.9, 0.0, 0.9), shift=(0.0, 0.0, 0.0)):
    """
    Look for poles at conductors that hang over 120 m as if nothing held them between.

    All is moved by ``shift``.

    Returns
    -------
    cloud, curves, poles

    """
    wires = [
        make_wire((0.0, y, height + 4.0), (120.0, y, height + 4.0), c=450.0, seed=number)
        for number, y in enumerate(offsets)
    ]
    ground = make_ground((-10.0, -15.0), (130.0, 15.0))
    points = np.vstack([*wires, ground, *things]) + np.array(shift)
    cloud = gather_off_ground(points, extract_high(points, SETTINGS.height), 2.0)
    number = np.full(len(points), -1)
    number[cloud.place] = np.arange(len(cloud.place))
    ends = np.cumsum([0, *map(len, wires)])
    curves = [
        make_curve(cloud.points, np.sort(number[low:high]))
        for low, high in pairwise(ends)
    ]
    wire = np.zeros(len(cloud.points), dtype=bool)
    wire[number[: ends[-1]]] = True
    return cloud, curves, find_poles(cloud, curves, wire)


def test_a_pole_below_a_smooth_catenary_is_found():
    _, curves, poles = look(make_pole(60.0, 0.1, 8.2))
    (pole,) = poles
    np.testing.assert_allclose(pole.position, [60.0, 0.1], atol=0.1)
    assert pole.top == pytest.approx(8.2, abs=0.1)
    assert pole.base == pytest.approx(0.0, abs=0.1)
    assert all(pole.holds(curve) for curve in curves)


@pytest.mark.parametrize('shift', [(-60.0, 0.0, 0.0), (0.0, 0.0, 0.0), (40.3, 200.2, 5.0)])
def test_a_pole_is_found_wherever_it_stands(shift):
    # only one of both conductors is near enough to it
    _, _, poles = look(make_pole(60.0, 0.7, 8.2), offsets=(-0.6, 0.6), shift=shift)
    (pole,) = poles
    np.testing.assert_allclose(pole.position, np.add([60.0, 0.7], shift[:2]), atol=0.1)


@pytest.mark.parametrize('thing', [
    make_tree(60.0, 0.0, 8.5, bottom=0.5, radius=1.0, num=1500),
    make_tree(60.0, 0.3, 8.5, bottom=0.5, radius=1.5, num=150),
    make_pole(60.0, 4.5, 8.2)[:300],
    make_pole(60.0, 0.0, 6.0),
    np.vstack([make_pole(60.0, 0.0, 5.5), [[60.0, 0.0, 8.0]]]),
    np.vstack([make_pole(60.0, 0.0, 4.0), make_pole(60.0, 0.0, 8.2)[HIGH_PART]]),
], ids=['a crown', 'a thin crown', 'a lamp beside the line', 'a post below it',
        'a post and a stray point', 'a post below something else'])
def test_what_holds_no_conductor_is_no_pole(thing):
    assert look(thing)[2] == ()


def test_a_pole_of_few_points_that_stands_free_is_found():
    pole = make_pole(60.0, 0.1, 8.2)
    rising = pole[np.argsort(pole[:, 2])]
    sparse = rising[np.linspace(0, len(pole) - 1, 19).astype(int)]  # 14 of them above 2 m
    assert len(look(sparse)[2]) == 1
    around = [sparse + np.array(step) for step in ((0.6, 0.0, 0.0), (0.0, -0.6, 0.0))]
    assert look(sparse, *around)[2] == ()


def make_scan_lines(x, y=0.7, top=9.0):
    """Make the vertical rows of points that a survey scans a wall in."""
    rows = [np.column_stack([np.full(30, at), np.full(30, y), np.linspace(0.1, top, 30)])
            for at in x]
    points = np.vstack(rows)
    return points + np.random.default_rng(0).normal(0.0, 0.02, points.shape)


@pytest.mark.parametrize('x', [np.arange(57.0, 64.0), np.arange(60.0, 66.0, 1.2)])
def test_scan_lines_of_a_wall_are_no_poles(x):
    assert look(make_scan_lines(x))[2] == ()


def test_a_pole_whose_top_is_out_of_sight_is_one_where_curves_tell_of_it():
    rising = make_pole(60.0, 0.1, 6.5)
    sparse = rising[np.argsort(rising[:, 2])][np.linspace(0, len(rising) - 1, 12).astype(int)]
    cloud, curves, poles = look(sparse)
    assert poles == ()
    wire = np.zeros(len(cloud.points), dtype=bool)
    for curve in curves:
        wire[curve.points] = True
    told = [(curve, curve.local_place(np.array([61.0, 0.0]))[0]) for curve in curves]
    (pole,) = find_poles(cloud, curves, wire, told=told)
    np.testing.assert_allclose(pole.position, [60.0, 0.1], atol=0.1)
    assert all(pole.holds(curve) for curve in curves)
    far = [(curve, curve.local_place(np.array([64.0, 0.0]))[0]) for curve in curves]
    assert find_poles(cloud, curves, wire, told=far) == ()


def test_posts_of_a_portal_and_a_pole_beside_a_wall_are_poles():
    assert len(look(make_scan_lines([59.5, 60.7]))[2]) >= 1
    wall = make_scan_lines(np.arange(55.0, 66.0), y=2.5)
    assert len(look(wall, make_scan_lines([60.0], y=0.0))[2]) == 1


def test_without_curves_nothing_is_looked_for():
    assert look(make_pole(60.0, 0.0, 8.2), offsets=())[2] == ()


def test_smooth_conductors_have_a_support_at_the_pole():
    cloud, curves, poles = look(make_pole(60.0, 0.1, 8.2))
    layout = find_layout(cloud.points, curves, (), SETTINGS.supports, poles)
    assert len(layout.curves) == 6
    (station,) = layout.stations
    np.testing.assert_allclose(station.position, [60.0, 0.0], atol=0.2)
    assert len(layout.joints) == 3
    for number in range(6):
        assert {layout.start_station[number], layout.end_station[number]} == {-1, 0}
    without = find_layout(cloud.points, curves, (), SETTINGS.supports)
    assert len(without.curves) == 3
    assert without.stations == ()


@pytest.mark.parametrize(('top', 'num'), [(9.5, 2), (11.5, 1)])
def test_a_smooth_conductor_passes_what_rises_far_above_it(top, num):
    """A slender tree is as bare a column as a pole; the sag tells that it holds nothing."""
    cloud, curves, poles = look(make_pole(60.0, 0.1, top), offsets=(0.0,))
    assert len(poles) == 1
    assert len(cut_at_poles(cloud.points, curves, poles, 6.0)) == num


@pytest.mark.parametrize(('top', 'num'), [(9.5, 2), (11.5, 1)])
def test_a_smooth_conductor_passes_the_edge_of_a_crown_that_rises_far_above_it(top, num):
    edge, stem = make_pole(60.0, 0.1, 8.2), make_pole(60.0, 2.2, top)[:300]  # it has no arm
    cloud, curves, poles = look(edge, stem, offsets=(0.0,))
    assert len(poles) == 1
    assert poles[0].top < 9.0
    assert len(cut_at_poles(cloud.points, curves, poles, 6.0)) == num


def test_a_smooth_conductor_passes_the_pole_of_a_line_that_crosses_above():
    low = make_wire((0.0, 0.0, 12.0), (120.0, 0.0, 12.0), c=450.0)
    high = make_wire((20.0, -40.0, 15.8), (100.0, 40.0, 15.8), c=450.0, seed=1)
    points = np.vstack([low, high])
    ends = [0, len(low), len(points)]
    curves = [make_curve(points, np.arange(*part)) for part in pairwise(ends)]
    pole = StandingPole(position=np.array([60.0, 0.0]), base=0.0, top=12.4)
    parts = cut_at_poles(points, curves, [pole], 6.0)
    assert sorted(round(part.length, -1) for part in parts) == [60, 60, 120]


@pytest.mark.parametrize(('end', 'num'), [(59.0, 2), (75.0, 1)])
def test_a_conductor_that_runs_on_into_a_crown_is_cut_where_its_neighbour_ends(end, num):
    wire = make_wire((0.0, 0.0, 12.0), (120.0, 0.0, 12.0), c=450.0)
    beside = wire[wire[:, 0] < end] + np.array((0.0, 0.5, 0.0))
    points = np.vstack([wire[wire[:, 0] < 75.0], beside])
    curves = [
        make_curve(points, np.flatnonzero(points[:, 1] < 0.25)),
        make_curve(points, np.flatnonzero(points[:, 1] >= 0.25)),
    ]
    pole = StandingPole(position=np.array([60.0, 0.0]), base=0.0, top=8.2, around=14.0)
    parts = cut_at_poles(points, curves, [pole], 6.0)
    assert len(parts) == len(curves) - 1 + num


def test_ends_that_meet_at_a_pole_are_joined_once():
    cloud, curves, poles = look(make_pole(60.0, 0.1, 8.2), offsets=(0.0,))
    parts = cut_at_poles(cloud.points, curves, poles, 6.0)
    assert [round(part.length) for part in parts] == [60, 60]
    joints = join_at_poles(parts, (), poles, 3.0)
    assert [sorted(joint.curves) for joint in joints] == [[0, 1]]
    assert joints[0].miss < 0.05
    assert join_at_poles(parts, joints, poles, 3.0) == joints


@pytest.mark.parametrize('start', [57.3, 57.7])
def test_a_short_piece_that_passes_a_pole_meets_there_with_one_end(start):
    """Else its span would begin and end at the pole."""
    wires = [
        make_wire((0.0, 0.0, 8.0), (59.0, 0.0, 8.0)),
        make_wire((61.0, 0.8, 8.0), (120.0, 0.8, 8.0)),
        make_wire((start, 0.4, 8.0), (start + 5.0, 0.4, 8.0), c=1e5, noise=0.01),
    ]
    points = np.vstack(wires)
    ends = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(points, np.arange(low, high)) for low, high in pairwise(ends)]
    pole = StandingPole(position=np.array([60.0, 0.4]), base=0.0, top=8.2)
    (joint,) = join_at_poles(curves, (), [pole], 3.0)
    assert 2 in joint.curves
    side = joint.sides[joint.curves.index(2)] * np.cos(curves[2].azimuth)
    assert side == pytest.approx(1.0 if start < 57.5 else -1.0, abs=0.1)


def test_a_pole_near_an_end_cuts_nothing_and_is_where_it_ends():
    cloud, curves, poles = look(make_pole(118.5, 0.0, 11.5))
    assert len(poles) == 1
    assert len(cut_at_poles(cloud.points, curves, poles, 6.0)) == len(curves)


def test_a_part_of_a_few_points_beyond_the_cut_is_dropped():
    cloud, curves, _ = look(offsets=(0.0,))
    (curve,) = curves
    x, _ = curve.local(cloud.points[curve.points])
    few = np.r_[curve.points[x < 0.0], curve.points[x >= 0.0][::25]]
    thin = make_curve(cloud.points, np.sort(few))
    (kept,) = cut_curve(cloud.points, thin, curve.position(0.0)[0])
    assert 55.0 < kept.length < 65.0
    assert len(cut_curve(cloud.points, curve, curve.position(0.0)[0])) == 2
