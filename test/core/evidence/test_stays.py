# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import hang, make_curve, make_index, make_wire

from plc_inspect.core.evidence.stays import find_fans, find_held, find_stays

X = np.linspace(0.0, 60.0, 600)


def bar(low, high, first, last, y=0.0):
    """Return the curve of a straight bar between two heights, over some of the beam [m]."""
    x = X[(low <= X) & (high >= X)]
    z = first + (last - first) * (x - low) / (high - low)
    noise = np.random.default_rng(3).normal(0.0, 0.01, (len(x), 3))
    points = np.column_stack([x, np.full(len(x), y), z]) + noise
    return make_curve(points, np.arange(len(points)))


BEAM = bar(0.0, 60.0, 20.0, 20.0)
NO = np.zeros(1, dtype=bool)


@pytest.mark.parametrize('curve', [
    bar(2.0, 40.0, 20.5, 27.0), bar(40.0, 58.0, 27.0, 21.0), bar(5.0, 40.0, 21.5, 27.0, y=0.8),
])
def test_bars_that_come_down_on_a_beam_are_its_stays(curve):
    assert find_stays([curve], NO, [BEAM]).tolist() == [True]


@pytest.mark.parametrize('curve', [
    bar(2.0, 58.0, 22.0, 22.5),  # beside the beam all along, as a second conductor
    bar(2.0, 40.0, 20.5, 27.0, y=3.0),  # in another plane
    bar(2.0, 40.0, 26.0, 32.0),  # high above
    bar(2.0, 40.0, 14.0, 19.5),  # below
])
def test_other_lines_near_a_beam_are_none(curve):
    assert find_stays([curve], NO, [BEAM]).tolist() == [False]


def test_without_beams_or_curves_there_are_no_stays():
    assert find_stays([], NO[:0], [BEAM]).tolist() == []
    assert find_stays([BEAM], NO, []).tolist() == [False]


@pytest.mark.parametrize(('height', 'expected'), [(21.1, True), (22.9, True), (23.5, False)])
def test_what_is_surely_straight_and_close_above_a_beam_is_its_rail(height, expected):
    rail = bar(2.0, 58.0, height, height)
    assert find_stays([rail], ~NO, [BEAM]).tolist() == [expected]
    assert find_stays([rail], NO, [BEAM]).tolist() == [False]


def test_a_cable_that_comes_down_on_a_deck_is_its_main_cable():
    x = X[X < 55.0]
    z = 21.0 + (x - 30.0) ** 2 / 240.0
    noise = np.random.default_rng(3).normal(0.0, 0.01, (len(x), 3))
    cable = make_curve(np.column_stack([x, np.zeros(len(x)), z]) + noise)
    assert find_stays([cable], ~NO, [BEAM]).tolist() == [True]
    high = make_curve(np.column_stack([x, np.zeros(len(x)), z + 4.0]) + noise)
    assert find_stays([high], ~NO, [BEAM]).tolist() == [False]


def test_a_rail_that_goes_on_beyond_the_beam_is_none_of_it():
    rail = bar(2.0, 58.0, 21.0, 21.0)
    assert find_stays([rail], ~NO, [bar(2.0, 40.0, 20.0, 20.0)]).tolist() == [False]


FAN = [bar(0.0, 30.0, 20.0, 6.0), bar(0.0, 24.0, 19.0, 6.0), bar(0.0, 18.0, 18.0, 6.0)]


def test_stays_of_a_mast_fan_out():
    assert find_fans(FAN, np.array([True, False, False]), np.ones(3, bool)).tolist() == [True] * 3


@pytest.mark.parametrize('curves', [
    [bar(0.0, 30.0, 20.0, 20.2), bar(0.0, 30.0, 19.5, 19.7)],  # one above the other
    [bar(0.0, 30.0, 20.0, 6.0), bar(30.0, 60.0, 6.0, 20.0)],  # one after the other
    [bar(0.0, 30.0, 20.0, 6.0), bar(0.0, 30.0, 19.0, 12.0, y=3.0)],  # in another plane
    [FAN[0]],
    [],
])
def test_lines_beside_each_other_are_no_fan(curves):
    every = np.ones(len(curves), dtype=bool)
    assert not find_fans(curves, every, every).any()


def test_a_fan_of_which_none_is_surely_straight_may_be_wires_at_a_pole():
    assert not find_fans(FAN, np.zeros(3, dtype=bool), np.ones(3, dtype=bool)).any()


def test_a_gutter_below_a_cable_makes_no_fan():
    free = np.array([True, False])
    assert not find_fans([FAN[0], FAN[2]], np.ones(2, dtype=bool), free).any()


def touch(places, thick=0.03):
    """Return a cable of 60 m, what stands below it at some x, and which points are the cable's."""
    rng = np.random.default_rng(8)
    cable = make_wire((0.0, 0.0, 20.0), (60.0, 0.0, 20.0), c=120.0, per_metre=20.0)
    things = []
    for x in places:
        top = hang(np.array([x]), 60.0, 20.0, 20.0, 120.0)[0]
        side = rng.uniform(-thick, thick, (200, 2))
        things.append(np.column_stack([
            x + side[:, 0], side[:, 1], rng.uniform(top - 5.0, top, 200)
        ]))
    points = np.vstack([cable, *things])
    return points, np.arange(len(points)) < len(cable)


@pytest.mark.parametrize(('places', 'thick', 'held'), [
    ((5.0, 12.0, 19.0, 26.0), 0.03, True),
    ((5.0, 12.1, 18.8, 33.0, 40.0, 47.1), 0.03, True),  # one was not seen
    ((5.0, 12.0, 19.1, 33.0, 40.0, 54.2), 0.03, True),  # two were not seen
    ((5.0, 12.0, 26.0, 33.0, 47.0), 0.03, False),  # two bays alone
    ((5.0, 15.0, 25.0, 35.0, 45.0), 0.03, False),  # posts of an insulated cable
    ((5.0, 12.0, 19.0), 0.03, False),  # too few to be sure
    ((5.0, 8.0, 15.0, 26.0, 29.0), 0.03, False),  # treetops
    ((5.0, 12.0, 19.0, 26.0), 1.5, False),  # crowns
    ((), 0.03, False),
])
def test_what_is_touched_at_regular_intervals_is_no_conductor(places, thick, held):
    points, wire = touch(places, thick)
    curve = make_curve(points, np.flatnonzero(wire))
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [held]


@pytest.mark.parametrize(('spacing', 'held'), [(6.5, True), (11.0, False)])
def test_posts_are_told_from_the_pipe_that_they_bear(spacing, held):
    rng = np.random.default_rng(8)
    around = rng.uniform(0.0, 2.0 * np.pi, 6000)
    pipe = np.column_stack([
        rng.uniform(0.0, 40.0, 6000), 0.25 * np.cos(around), 5.0 + 0.25 * np.sin(around)
    ])
    posts = [
        np.column_stack([rng.uniform(x - 0.1, x + 0.1, 200), rng.uniform(-0.1, 0.1, 200),
                         rng.uniform(0.0, 5.0, 200)])
        for x in np.arange(2.0, 40.0, spacing)
    ]
    points = np.vstack([pipe, *posts])
    top = np.flatnonzero((pipe[:, 2] > 5.15) & (np.abs(pipe[:, 1]) < 0.15))
    curve = make_curve(points, top)
    wire = np.zeros(len(points), dtype=bool)
    wire[top] = True
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [held]


@pytest.mark.parametrize(('side', 'spacing', 'held'), [
    (1.0, 6.5, True), (-1.0, 6.5, True), (1.0, 11.0, False),
])
def test_beams_beside_a_pipe_hold_it_as_brackets_below_do(side, spacing, held):
    rng = np.random.default_rng(8)
    pipe = rng.normal((0.0, 0.0, 5.0), (0.0, 0.1, 0.1), (1500, 3))
    pipe[:, 0] = rng.uniform(0.0, 40.0, 1500)
    beams = [
        np.column_stack([rng.uniform(x - 0.1, x + 0.1, 80), side * rng.uniform(0.2, 1.6, 80),
                         rng.uniform(4.9, 5.1, 80)])
        for x in np.arange(2.0, 40.0, spacing)
    ]
    points = np.vstack([pipe, *beams])
    wire = np.arange(len(points)) < len(pipe)
    curve = make_curve(points, np.flatnonzero(wire))
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [held]


def test_wires_beside_that_are_seen_in_scan_lines_hold_nothing():
    points, wire = touch(())
    cable = points[wire]
    seen = cable[np.abs(cable[:, 0] / 3.0 % 1.0 - 0.5) < 0.02]
    points = np.vstack([points, seen + np.array((0.0, 0.6, 0.0)),
                        seen + np.array((0.0, 1.0, 0.0))])
    curve = make_curve(points, np.arange(len(cable)))
    wire = np.arange(len(points)) < len(cable)
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [False]


def test_another_line_below_that_is_seen_in_scan_lines_holds_nothing():
    points, wire = touch(())
    cable = points[wire]
    below = cable[(np.round(cable[:, 0] / 3.0 - 0.5) - (cable[:, 0] / 3.0 - 0.5)).__abs__() < 0.05]
    points = np.vstack([points, below - [0.0, 0.0, 0.5]])
    curve = make_curve(points, np.arange(len(cable)))
    wire = np.arange(len(points)) < len(cable)
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [False]


def test_a_line_above_a_row_of_trees_at_even_distances_is_kept():
    points, wire = touch(())
    rng = np.random.default_rng(4)
    trees = []
    for x in range(6, 55, 6):
        top = hang(np.array([float(x)]), 60.0, 20.0, 20.0, 120.0)[0] - 0.3
        down = 6.0 * rng.uniform(0.0, 1.0, 900) ** 0.5
        around, out = rng.uniform(0.0, 2.0 * np.pi, 900), 0.25 * down * rng.uniform(0.5, 1.0, 900)
        trees.append(np.column_stack([
            x + out * np.cos(around), out * np.sin(around), top - down
        ]))
    points = np.vstack([points, *trees])
    wire = np.arange(len(points)) < wire.sum()
    curve = make_curve(points, np.flatnonzero(wire))
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [False]


def test_without_curves_nothing_is_held():
    points, wire = touch((5.0, 12.0))
    assert find_held(points, make_index(points), [], wire, 8.0, []).tolist() == []
