# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_route, make_sight, make_tree, make_wire

from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import find_near
from plc_inspect.core.evidence.conductors import ConductorResult
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.adoption import _Meetings, adopt, ADOPTION_MISS, find_borne
from plc_inspect.core.spans.joints import find_joints
from plc_inspect.core.spans.standing_poles import StandingPole

SETTINGS = Settings()
TWIN = 0.4
"""Distance of the sub-conductors of a bundle [m]."""


def take(points, believed, doubtful=(), crowded=(), seen=True):
    """Adopt curves of a cloud in which all is off the ground."""
    ground = np.array([[x, y, 0.0] for x in range(-20, 140, 2) for y in range(-20, 21, 2)])
    everything = np.vstack([points, ground])
    cloud = gather_off_ground(everything, extract_high(everything, SETTINGS.height), -np.inf)
    place = np.argsort(cloud.place)
    curves = [[
        make_curve(cloud.points, np.sort(place[curve.points]), curve.tolerance)
        for curve in group
    ] for group in (believed, doubtful, crowded)]
    wire = np.zeros(len(cloud.points), dtype=bool)
    for curve in curves[0]:
        wire[curve.points] = True
    return adopt(cloud, ConductorResult(
        curves=tuple(curves[0]), doubtful=tuple(curves[1]), crowded=tuple(curves[2]),
        objections={}, wire=wire,
    ), make_sight(everything, seen), SETTINGS)


def add(points, *clouds):
    """Add clouds to points, and return all with a curve of each cloud."""
    ends = np.cumsum([len(points), *map(len, clouds)])
    points = np.vstack([points, *clouds])
    return points, [make_curve(points, np.arange(*own)) for own in pairwise(ends)]


def make_bundle(tip=106.0):
    """Make a bundle of two over a span of 90 m and the first metres of the next one."""
    clouds = [
        make_wire(start, end, 800.0, seed=seed)
        for y, seed in ((-TWIN / 2, 1), (TWIN / 2, 2))
        for start, end in ((((0.0, y, 15.0)), (90.0, y, 15.0)), ((90.0, y, 15.0), (tip, y, 14.4)))
    ]
    whole = np.vstack([clouds[0], clouds[2]])
    points, twins = add(whole, clouds[1], clouds[3])
    return points, make_curve(points, np.arange(len(whole)), 0.3), twins


def list_partners(curves, believed, waiting, reach):
    """Return which of the believed each one that waits continues, by all joints about it."""
    result = []
    for number in waiting:
        near = find_near([curves[number]], 4 * reach, [curves[k] for k in believed]).item
        around = [believed[k] for k in near.tolist()]
        joints = find_joints([*(curves[k] for k in around), curves[number]], reach)
        partners = [
            around[min(joint.curves)] for joint in joints
            if max(joint.curves) == len(around) and joint.miss < ADOPTION_MISS
        ]
        if partners:
            result.append((number, partners[0]))
    return result


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('reach', [15.0, 40.0])
def test_whom_a_curve_continues_is_what_all_joints_tell(seed, reach):
    rng = np.random.default_rng(seed)
    supports = np.column_stack([np.arange(7) * 60.0, rng.uniform(-6.0, 6.0, 7)])
    _, curves = make_route(supports, offsets=(-0.5, 0.0, 0.4), parts=((0.06, 0.94),))
    curves = [curves[k] for k in rng.permutation(len(curves))]
    believed, waiting = [0, 1, 2, 3], list(range(4, len(curves)))
    meetings = _Meetings(curves[:4], curves[4:], reach)
    num = 0
    while True:
        expected = list_partners(curves, believed, waiting, reach)
        found = [(number, partner) for number, _, partner in meetings.find_all()]
        assert found == [(number, curves[k]) for number, k in expected]
        if not expected:
            break
        fresh = expected[-1][0]
        meetings.believe(fresh)
        waiting.remove(fresh)
        believed.append(fresh)
        num += 1
    assert num > 5


def test_a_curve_that_continues_another_is_adopted():
    points, curves = make_route([(0, 0), (90, 0), (114, 0)], offsets=(0.0,))
    believed, doubtful = curves
    points, (alone,) = add(points, make_wire((0.0, 60.0, 15.0), (24.0, 60.0, 15.0), seed=3))
    adopted = take(points, [believed], [doubtful, alone])
    assert [curve.num_points for curve in adopted] == [doubtful.num_points]
    assert take(points, [believed], [alone]) == ()


@pytest.mark.parametrize(('turn', 'seen', 'expected'), [
    (45.0, False, False), (45.0, True, True), (10.0, False, True),
])
def test_rows_of_a_roof_go_on_no_drop_that_ends_at_it(turn, seen, expected):
    drop = make_wire((0.0, 0.0, 10.0), (30.0, 0.0, 8.0), seed=5)
    turn = np.radians(turn)
    way = np.array([np.cos(turn), np.sin(turn), -0.2])
    rows = [
        make_wire(start, start + 8.0 * way, 4000.0, seed=seed)
        for seed, start in enumerate(
            np.array([30.4, 0.0, 8.0]) + 0.8 * k * np.array([-np.sin(turn), np.cos(turn), 0.0])
            for k in range(3)
        )
    ]
    points, (believed, *doubtful) = add(np.empty((0, 3)), drop, *rows)
    assert bool(take(points, [believed], doubtful, seen=seen)) == expected


def test_of_two_the_better_seen_continues():
    points, curves = make_route([(0, 0), (90, 0), (150, 0)], offsets=(0.0,))
    believed, wire = curves
    # a twig beyond the support that the wire hangs from, as if the line went on there
    twig = make_wire((110.0, 0.1, 15.3), (126.0, 0.1, 15.3), per_metre=1.0, seed=4)
    points, (other,) = add(points, twig)
    for doubtful in ([wire, other], [other, wire]):
        assert take(points, [believed], doubtful)[0].num_points == wire.num_points


def test_a_bundle_goes_on_as_a_bundle():
    points, bundle, twins = make_bundle()
    adopted = take(points, [bundle], crowded=twins)
    assert adopted
    for curve in adopted:
        assert curve.tolerance == bundle.tolerance
        assert curve.num_points == pytest.approx(sum(twin.num_points for twin in twins), rel=0.1)


def test_what_goes_on_into_a_crown_is_not_adopted():
    points, bundle, twins = make_bundle()
    crown = make_tree(98.0, 0.0, 16.0, bottom=12.0, radius=3.0, num=6000)
    crown = crown[np.hypot(crown[:, 1], crown[:, 2] - 14.7) > 0.35]
    assert take(np.vstack([points, crown]), [bundle], crowded=twins) == ()


def test_wires_that_crowd_each_other_go_on_side_by_side():
    offsets = (-0.15, 0.0, 0.15)
    points, curves = make_route([(0, 0), (90, 0), (106, 0)], offsets=offsets)
    believed, crowded = curves[:3], curves[3:]
    assert len(take(points, believed, crowded=crowded)) == 3
    assert take(points, [], crowded=crowded) == ()


@pytest.mark.parametrize(('places', 'c', 'kept'), [
    ((5.0, 11.5, 18.0), 1e6, False),  # posts of a pipe
    ((5.0, 11.5), 1e6, True),
    ((5.0, 30.0, 55.0), 1e6, True),  # poles of a line
    ((5.0, 11.5, 18.0), 400.0, True),  # it hangs
    ((5.0, 11.5, 18.0, 24.5, 31.0), 3000.0, False),  # posts of a pipe that drift bends
    ((5.0, 11.5, 18.0, 24.5), 3000.0, True),
])
def test_what_poles_bear_at_short_intervals_is_no_conductor(places, c, kept):
    wire = make_wire((0.0, 0.0, 8.0), (60.0, 0.0, 8.0), c, per_metre=30.0)
    curve = make_curve(wire)
    low, high = float(wire[:, 2].min()), float(wire[:, 2].max())
    poles = [
        StandingPole(position=np.array([x, 0.0]), base=0.0, top=high if c > 1e3 else low + 3.0)
        for x in places
    ]
    assert find_borne((curve,), poles, SETTINGS.catenary) == (() if kept else (curve,))


def make_arm(reach=8.0, at=7.7, drop=1.5, azimuth=0.0, c=1e6):
    """Return a bar along y, and two conductors that pass below its ends, as curves."""
    along = 60.0 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    wires = [
        make_wire(middle - along, middle + along, 4500.0, per_metre=8.0)
        for middle in np.array([[0.0, -at, 16.4 - drop], [0.0, at, 16.4 - drop]])
    ]
    arm = make_wire((0.0, -reach, 16.0), (0.0, reach, 16.0), c, per_metre=30.0)
    return make_curve(arm), *(make_curve(wire) for wire in wires)


@pytest.mark.parametrize(('changed', 'place', 'taken'), [
    ({}, (0.0, 0.0), True),
    ({}, (0.0, 6.0), False),  # a wire that leaves a pole beside the conductors
    ({}, (2.0, 0.0), False),  # one that passes a pole
    ({'reach': 11.0}, (0.0, 0.0), False),  # one that crosses both conductors at their pole
    ({'reach': 13.0, 'at': 12.7}, (0.0, 0.0), False),  # too long
    ({'drop': 6.0}, (0.0, 0.0), False),  # far above the conductors
    ({'drop': -3.0}, (0.0, 0.0), False),  # below them
    ({'azimuth': 1.0}, (0.0, 0.0), False),  # they run along it, rather than across
    ({'c': 100.0}, (0.0, 0.0), False),  # it hangs
])
def test_what_a_pole_bears_in_the_middle_alone_is_its_arm(changed, place, taken):
    arm, *wires = make_arm(**changed)
    pole = StandingPole(position=np.array(place), base=0.0, top=18.0)
    beside = replace(pole, position=np.array([0.0, 90.0]))  # of a line that runs alongside
    for poles in ([pole], [pole, beside]):
        assert find_borne((arm, *wires), poles, SETTINGS.catenary) == ((arm,) if taken else ())
    assert find_borne((arm, wires[0]), [pole], SETTINGS.catenary) == ()


def test_a_piece_across_one_conductor_is_no_arm():
    arm, wire, _ = make_arm(reach=2.2, at=0.0)
    pole = StandingPole(position=np.zeros(2), base=0.0, top=18.0)
    assert find_borne((arm, wire), [pole], SETTINGS.catenary) == ()
