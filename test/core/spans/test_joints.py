# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_route, make_wire, turn

from plc_inspect.core.spans.joints import find_joints


def find(supports, max_reach=40.0, **changes):
    points, curves = make_route(supports, **changes)
    return points, curves, find_joints(curves, max_reach)


def test_two_spans_of_one_conductor_meet_at_their_support():
    _, curves, joints = find([(0, 0), (90, 0), (170, 0)], offsets=(0.0,))
    assert len(joints) == 1
    joint = joints[0]
    assert joint.curves == (0, 1)
    assert joint.sides == (1, -1)
    np.testing.assert_allclose(joint.position, [90.0, 0.0, 15.0], atol=0.1)
    # slopes at the support: half of each length over c
    assert joint.kink == pytest.approx((90 + 80) / 2 / 800, rel=0.1)
    assert joint.miss < 0.05
    for number, x in zip(joint.curves, joint.x, strict=True):
        np.testing.assert_allclose(curves[number].position(x)[0], joint.position, atol=0.1)


@pytest.mark.parametrize('angle', [-50, -20, 12, 30, 55])
def test_each_conductor_meets_its_own_where_the_line_turns(angle):
    bend = 80 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    _, _, joints = find([(0, 0), (90, 0), (90 + bend[0], bend[1])])
    assert sorted(joint.curves for joint in joints) == [(0, 3), (1, 4), (2, 5)]
    for joint in joints:
        assert np.linalg.norm(joint.position[:2] - [90.0, 0.0]) < 4.0
        assert joint.position[2] == pytest.approx(15.0, abs=0.1)


def test_a_conductor_that_is_drawn_upwards_has_a_support_there():
    low = (90.0, 0.0, 15.0)
    wires = [make_wire((0.0, 0.0, 25.0), low), make_wire(low, (170.0, 0.0, 25.0), seed=1)]
    points = np.vstack(wires)
    curves = [make_curve(points, np.arange(len(wires[0]))),
              make_curve(points, np.arange(len(wires[0]), len(points)))]
    (joint,) = find_joints(curves, 40.0)
    assert joint.kink < -0.1
    np.testing.assert_allclose(joint.position, [90.0, 0.0, 15.0], atol=0.1)


@pytest.mark.parametrize(('angle', 'num'), [(0.0, 0), (4.0, 1)])
def test_a_smooth_catenary_meets_itself_where_it_turns_in_plan(angle, num):
    whole = make_wire((0.0, 0.0, 15.0), (170.0, 0.0, 15.0))
    beyond = whole[:, 0] > 90.0
    middle = np.array([90.0, 0.0, 0.0])
    points = np.vstack([
        whole[~beyond], turn(whole[beyond] - middle, np.radians(angle)) + middle
    ])
    curves = [make_curve(points, np.flatnonzero(own)) for own in (
        np.arange(len(points)) < (~beyond).sum(), np.arange(len(points)) >= (~beyond).sum()
    )]
    joints = find_joints(curves, 40.0)
    assert len(joints) == num
    for joint in joints:
        assert abs(joint.kink) < 0.008
        np.testing.assert_allclose(joint.position[:2], [90.0, 0.0], atol=0.5)


def test_each_end_meets_once():
    _, _, joints = find([(0, 0), (90, 0), (170, 0), (260, 10)], offsets=(0.0, 0.4, 0.8, 1.2))
    ends = [end for joint in joints
            for end in zip(joint.curves, joint.sides, strict=True)]
    assert len(ends) == len(set(ends)) == 16
    assert all(joint.curves[1] == joint.curves[0] + 4 for joint in joints)
    assert [joint.cost for joint in joints] == sorted(joint.cost for joint in joints)


def test_a_conductor_that_fades_out_is_extended_to_its_support():
    supports = [(0, 0), (100, 0), (200, 0)]
    _, _, joints = find(supports, offsets=(0.0,), parts=((0.12, 0.88),))
    assert len(joints) == 1
    np.testing.assert_allclose(joints[0].position, [100.0, 0.0, 15.0], atol=0.5)
    assert find(supports, 5.0, offsets=(0.0,), parts=((0.12, 0.88),))[2] == ()


@pytest.mark.parametrize('seed', range(4))
def test_doubt_about_an_extrapolation_lets_no_others_meet(seed):
    faded = make_wire(
        (0.0, 0.0, 15.0), (54.0, 0.0, 15.0), per_metre=2.0, noise=0.1, seed=seed,
        parts=((0.0, 0.6),),
    )
    curve = make_curve(faded, tolerance=0.3)
    along = curve.local(np.array([[54.0, 0.0, 0.0]]))[0]
    x, y, z = curve.position(along)[0]
    above = make_wire((x, y, z + 0.8), (120.0, 0.0, z + 0.8), seed=seed)
    points = np.vstack([faded, above])
    other = make_curve(points, np.arange(len(faded), len(points)))
    assert curve.prediction_sigma(along)[0] > 0.1
    assert find_joints([curve, other], 40.0) == ()


def test_curves_beside_or_above_each_other_do_not_meet():
    for shift in ([0.0, 2.0, 0.0], [0.0, 0.0, 3.0]):
        wires = [
            make_wire((0.0, 0.0, 15.0), (90.0, 0.0, 15.0)),
            make_wire((90.0, 0.0, 15.0), (170.0, 0.0, 15.0), seed=1) + np.array(shift),
        ]
        points = np.vstack(wires)
        curves = [make_curve(points, np.arange(720)), make_curve(points, np.arange(720, 1360))]
        assert find_joints(curves, 40.0) == ()


@pytest.mark.parametrize('length', [6.0, 10.0, 15.0])
def test_wires_of_a_short_fan_do_not_meet_half_way(length):
    sides = (-0.3, -0.1, 0.1, 0.3)
    wires = [
        make_wire((0.0, side / 4, 7.0), (length, side, 7.0), seed=seed)
        for seed, side in enumerate(sides)
    ]
    points, start = np.vstack(wires), np.cumsum([0, *map(len, wires)])
    curves = [make_curve(points, np.arange(*ends)) for ends in pairwise(start.tolist())]
    assert find_joints(curves, 40.0) == ()


def test_parts_of_one_span_do_not_meet():
    wire = make_wire((0.0, 0.0, 15.0), (100.0, 0.0, 15.0))
    first = np.flatnonzero(wire[:, 0] < 50.0)
    curves = [make_curve(wire, first), make_curve(wire, np.setdiff1d(np.arange(800), first))]
    assert find_joints(curves, 40.0) == ()


@pytest.mark.parametrize('degrees', [45, 90, -100])
def test_yaw_and_translation(degrees):
    points, _ = make_route([(0, 0), (90, 0), (160, 40)], offsets=(0.0,))
    moved = turn(points, np.radians(degrees), (5e5, 6.6e6, 20.0))
    curves = [make_curve(moved, np.arange(720)), make_curve(moved, np.arange(720, len(moved)))]
    joints = find_joints(curves, 40.0)
    assert len(joints) == 1
    place = turn(np.array([[90.0, 0.0, 15.0]]), np.radians(degrees), (5e5, 6.6e6, 20.0))
    np.testing.assert_allclose(joints[0].position, place[0], atol=0.1)


def test_the_order_of_curves_changes_only_their_numbers():
    points, curves = make_route([(0, 0), (90, 0), (170, 20)])
    one = find_joints(curves, 40.0)
    other = find_joints(curves[::-1], 40.0)
    assert {joint.curves for joint in one} == {
        tuple(sorted(5 - number for number in joint.curves)) for joint in other
    }
    assert len(points)


def test_few_curves():
    assert find_joints([], 40.0) == ()
    assert find_joints(make_route([(0, 0), (90, 0)], offsets=(0.0,))[1], 40.0) == ()


def test_wires_of_a_rack_meet_their_own_though_some_run_beyond_the_support():
    # two wires 0.25 m apart; the upper one of the first span was followed 1.5 m too far
    c, apart = 250.0, 0.25
    wires = [
        make_wire((45.0 * span, 0.0, 9.0 - apart * k), (45.0 * span + 45.0, 0.0, 9.0 - apart * k),
                  c=c, per_metre=20.0, seed=2 * span + k)
        for span in range(2) for k in range(2)
    ]
    x = np.linspace(45.0, 46.5, 30)
    rise = 22.5 / c
    wires[0] = np.vstack([
        wires[0], np.column_stack([x, np.zeros(30), 9.0 + rise * (x - 45.0)])
    ])
    points = np.vstack(wires)
    owner = np.repeat(np.arange(4), [len(wire) for wire in wires])
    curves = [make_curve(points, np.flatnonzero(owner == k)) for k in range(4)]
    joints = find_joints(curves, 40.0)
    assert sorted(joint.curves for joint in joints) == [(0, 2), (1, 3)]
    for joint in joints:
        assert joint.position[0] == pytest.approx(45.0, abs=0.3)


def test_wires_of_a_rack_meet_their_own_though_their_curves_run_on():
    heights = (8.0, 8.4, 8.8, 9.2)
    wires = [
        make_wire((start, 0.0, z), (end, 0.0, z), c=420.0, seed=10 * span + number)
        for span, (start, end) in enumerate([(0.0, 38.0), (38.0, 66.0)])
        for number, z in enumerate(heights)
    ]
    places = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(np.vstack(wires), np.arange(*own)) for own in pairwise(places)]
    # through the neighbour's points, until they pass it
    ran = [dataclasses.replace(curve, high=curve.high + 5.0) for curve in curves[:4]]
    joints = find_joints([*ran, *curves[4:]], 40.0)
    assert sorted(joint.curves for joint in joints) == [(k, k + 4) for k in range(4)]
    assert all(abs(joint.position[0] - 38.0) < 0.5 for joint in joints)


def test_wires_of_a_rack_meet_where_the_others_of_it_do():
    wires = [
        make_wire(
            (start, 0.0, first + 0.45 * k), (end, 0.0, second + 0.45 * k), c=350.0, seed=seed + k,
        )
        for start, end, first, second, seed in (
            (0.0, 46.0, 7.0, 10.0, 0), (46.0, 88.0, 10.0, 8.3, 10)
        )
        for k in range(5)
    ]
    places = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(np.vstack(wires), np.arange(*own)) for own in pairwise(places)]
    # the fourth ends early, the third of both spans is followed through it
    ends = {3: -0.9, 2: 3.0}
    curves = [
        dataclasses.replace(curve, high=curve.high + ends.get(number, 0.0))
        if number < 5 else
        dataclasses.replace(curve, low=curve.low - (3.0 if number == 7 else 0.0))
        for number, curve in enumerate(curves)
    ]
    joints = find_joints(curves, 40.0)
    assert sorted(joint.curves for joint in joints) == [(k, k + 5) for k in range(5)]
    assert all(abs(joint.position[0] - 46.0) < 0.3 for joint in joints)


def test_strands_that_hang_side_by_side_for_metres_do_not_meet():
    # of one bundle, each in another strip of a survey: 8 m of both were seen
    first = make_wire((0.0, 0.0, 18.0), (90.0, 0.0, 18.0), c=900.0, parts=((0.0, 0.45),), seed=1)
    second = make_wire(
        (0.0, 0.26, 18.0), (90.0, 0.26, 18.4), c=900.0, parts=((0.36, 0.8),), seed=2,
    )
    # the second strip was turned by a fiftieth
    second[:, 2] += 0.02 * (second[:, 0] - 36.0)
    points = np.vstack([first, second])
    curves = [make_curve(points, own) for own in np.split(np.arange(len(points)), [len(first)])]
    assert find_joints(curves, 40.0) == ()
