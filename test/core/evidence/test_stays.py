# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import numpy as np
import pytest
from toys import make_curve

from plc_inspect.core.evidence.free_length import UNKNOWN
from plc_inspect.core.evidence.stays import (
    find_chords,
    find_fans,
    find_hung,
    find_stays,
    is_beam,
)

X = np.linspace(0.0, 60.0, 600)


def bar(low, high, first, last, y=0.0):
    """Return the curve of a straight bar between two heights, over some of the beam [m]."""
    x = X[(low <= X) & (high >= X)]
    z = first + (last - first) * (x - low) / (high - low)
    noise = np.random.default_rng(3).normal(0.0, 0.01, (len(x), 3))
    points = np.column_stack([x, np.full(len(x), y), z]) + noise
    return make_curve(points, np.arange(len(points)))


@pytest.mark.parametrize(('length', 'noise', 'expected'), [
    (14.0, 0.07, False),  # the last metres of a wire may look like it
    (14.0, 0.01, True),
    (40.0, 0.07, True),
])
def test_a_beam_is_surely_straight_whatever_is_about_it(length, noise, expected):
    rng = np.random.default_rng(1)
    x = np.linspace(0.0, length, 200)
    points = np.column_stack([x, np.zeros(200), np.full(200, 20.0)])
    points += rng.normal(0.0, noise, points.shape)
    curve = make_curve(points, np.arange(200))
    shape = np.array([*curve.fit.shape[:2], 2e-4])
    curve = replace(curve, fit=replace(curve.fit, shape=shape))
    assert is_beam(curve, replace(UNKNOWN, wide=-0.8 * length), 0.0) == expected


BEAM = bar(0.0, 60.0, 20.0, 20.0)
NO = np.zeros(1, dtype=bool)


@pytest.mark.parametrize('curve', [
    bar(2.0, 40.0, 20.5, 27.0), bar(40.0, 58.0, 27.0, 21.0), bar(5.0, 40.0, 21.5, 27.0, y=0.8),
    bar(20.0, 40.0, 23.4, 27.0),  # its lower half was not seen
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


@pytest.mark.parametrize(('curve', 'expected'), [
    (bar(2.0, 40.0, 20.5, 27.0), True),
    (bar(20.0, 40.0, 23.4, 27.0), False),  # where it goes was not seen
    (bar(2.0, 58.0, 22.0, 22.5), False),
])
def test_what_seems_to_hang_is_a_stay_where_it_comes_down_on_a_beam(curve, expected):
    assert find_hung([curve], [BEAM]).tolist() == [expected]
    assert find_hung([curve], []).tolist() == [False]


@pytest.mark.parametrize(('curve', 'expected'), [
    (bar(2.0, 58.0, 18.0, 18.0), True),
    (bar(10.0, 50.0, 22.0, 22.1, y=1.0), True),
    (bar(2.0, 58.0, 19.5, 19.5), False),  # a wire of a rack is as near
    (bar(2.0, 58.0, 18.0, 18.3), False),  # not parallel
    (bar(2.0, 58.0, 15.0, 15.0), False),  # far below
])
def test_what_keeps_its_distance_from_a_beam_is_a_chord_of_its_frame(curve, expected):
    assert find_chords([curve], [BEAM]).tolist() == [expected]


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


NONE, EACH = np.zeros(3, dtype=bool), np.ones(3, dtype=bool)
FAN = [bar(0.0, 30.0, 20.0, 6.0), bar(0.0, 24.0, 19.0, 6.0), bar(0.0, 18.0, 18.0, 6.0)]


def test_stays_of_a_mast_fan_out():
    one = np.array([True, False, False])
    assert find_fans(FAN, one, EACH).tolist() == [True] * 3


@pytest.mark.parametrize(('share', 'expected'), [(0.2, False), (0.4, True)])
def test_a_piece_that_parts_from_a_long_bar_tells_of_itself_alone(share, expected):
    high = 60.0 * share
    fan = [bar(0.0, 60.0, 20.0, 20.1), bar(0.0, high, 19.9, 19.9 - 0.1 * high)]
    assert find_fans(fan, EACH[:2], EACH[:2]).tolist() == [expected, True]


def test_stays_that_seem_to_cross_where_they_meet_fan_out():
    meeting = [bar(0.0, 13.0, 51.8, 49.0), bar(0.0, 13.0, 51.9, 46.4)]
    assert find_fans(meeting, EACH[:2], EACH[:2]).tolist() == [True] * 2
    crossing = [bar(0.0, 13.0, 51.8, 49.0), bar(0.0, 13.0, 52.4, 46.4)]
    assert not find_fans(crossing, EACH[:2], EACH[:2]).any()


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
    assert not find_fans(FAN, NONE, EACH).any()


def test_a_gutter_below_a_cable_makes_no_fan():
    free = np.array([True, False])
    assert not find_fans([FAN[0], FAN[2]], EACH[:2], free).any()
