# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How sharp a map is: a made-up flight over a plane and along a wire, put together wrongly."""

import numpy as np
import pytest

from plc_inspect.core.live.session import REMEMBERED
from plc_inspect.core.setup.looks import (
    LookWindow,
    measure_spread,
    MOST_WAITING,
    SCALES,
    SharpnessMeter,
    Spread,
)
from plc_inspect.core.setup.sharpness import LEAST_PLANES, SharpnessBook
from plc_inspect.core.setup.transforms import make_transform

SPEED, RATE = 7.0, 10


def fly(rpy=(0.0, 0.0, 0.0), *, seconds=11.0, noise=0.02, speed=SPEED, wires=True):
    """Return how sharp the map is where the lidar's mount is not as it is said."""
    rng = np.random.default_rng(3)
    turn = make_transform((0.0, 0.0, 0.0), rpy)[:3, :3]
    meter, book = SharpnessMeter(), SharpnessBook()
    for number in range(int(seconds * RATE)):
        place = np.array([speed * number / RATE, 0.0, 10.0])
        x, y = rng.uniform(-20.0, 20.0, (2, 900))
        relief = np.sin((x + place[0]) / 6.0) * np.cos(y / 6.0)
        ground = np.column_stack((x, y, relief - 8.0))
        wire = np.column_stack((
            rng.uniform(-20.0, 20.0, 150), np.full(150, 12.5), np.full(150, 1.5),
        ))
        seen = np.concatenate((ground, wire)) if wires else ground
        seen += rng.normal(0.0, noise, seen.shape)
        stamps = np.full(len(seen), round(number / RATE * 1e9), dtype=np.int64)
        meter.add(seen @ turn.T + place, stamps, np.linalg.norm(seen, axis=1))
        book.add(meter.take())
    return book.judge()


def test_right_mount_is_sharp():
    found = fly()
    assert found.known
    assert not found.poor
    assert found.noise == pytest.approx(0.02, rel=0.5)
    assert found.distance < 0.01


@pytest.mark.parametrize('axis', [1, 2])
def test_sharpness_falls_with_the_error(axis):
    figures = [fly(np.eye(3)[axis] * angle) for angle in (0.0, 2.0, 5.0, 10.0, 30.0)]
    assert all(item.poor for item in figures[1:])
    assert np.all(np.diff([item.figure for item in figures]) < 0.0)
    assert 'map is not sharp: check mount, frames, time' in figures[1].describe()


def test_lines_are_not_looked_for_where_none_can_be_right():
    near, far = (fly((0.0, 0.0, angle)) for angle in (0.6, 2.0))
    assert near.poor
    assert not near.hopeless
    assert 0.0 < far.figure < 0.25
    assert far.hopeless
    assert 'nothing is looked for' in far.describe()


@pytest.mark.parametrize(('num', 'apart', 'expected'), [
    (8, 0.03, 0.01), (800, 0.03, 0.03), (8, 0.2, 0.2), (800, 0.005, 0.01),
])
def test_lines_count_as_far_as_they_surely_lie_apart(num, apart, expected):
    lines = (apart * np.linspace(0.0, 2.0, num)) ** 2
    book = SharpnessBook()
    book.restore([Spread(1, np.full(200, 0.01**2), lines, np.zeros(200))])
    assert book.judge().distance == pytest.approx(expected, rel=0.1)


def test_noisy_and_rough_is_not_blurred():
    assert not fly(noise=0.05).poor


def test_where_nothing_moves_a_wrong_mount_does_not_show():
    assert not fly((0.0, 30.0, 0.0), speed=0.0).poor


@pytest.mark.parametrize('seconds', [0.0, 0.2, 0.9])
def test_short_flights_tell_nothing(seconds):
    found = fly(seconds=seconds)
    assert not found.known
    assert not found.poor
    assert 'unknown' in found.describe()


def test_windows_that_are_kept_are_those_of_all_scales():
    rate = sum(1e9 / scale.window_ns for scale in SCALES)
    assert pytest.approx(10.0 * rate) == MOST_WAITING
    assert pytest.approx(60.0 * rate) == REMEMBERED


def test_meter_is_bounded_and_forgets():
    meter = SharpnessMeter()
    for number in range(300):
        meter.add(np.ones((5, 3)), np.full(5, number * 100_000_000), np.ones(5))
    assert len(meter.take()) == MOST_WAITING
    meter.clear()
    assert meter.take() == []


def test_one_point_and_points_alone_give_no_cells():
    for count in (1, 40):
        points = np.arange(3.0 * count).reshape(-1, 3) * 10.0
        found = measure_spread(LookWindow(1, points, np.arange(count) * 100_000_000))
        assert len(found.planes) == len(found.lines) == 0


def test_input_is_unchanged():
    points = np.random.default_rng(0).uniform(0.0, 8.0, (500, 3))
    stamps = np.arange(500) * 10_000_000
    before = points.copy(), stamps.copy()
    measure_spread(LookWindow(1, points, stamps))
    np.testing.assert_array_equal(points, before[0])
    np.testing.assert_array_equal(stamps, before[1])


def test_too_few_planes_are_not_believed():
    assert LEAST_PLANES > 1
    book = SharpnessBook()
    points = np.random.default_rng(0).uniform(0.0, 3.9, (900, 3)) * (1.0, 1.0, 0.001)
    book.add([LookWindow(1, points, np.arange(900) * 5_000_000)])
    assert not book.judge().known


def test_arcs_of_a_scan_on_the_ground_tell_nothing():
    """A right flight showed lines of the short scale 0.29 m apart, before it knew near planes."""
    nothing = np.zeros(0)
    arcs = Spread(0, nothing, np.full(10, 0.29**2), nothing)
    near = Spread(1, np.full(8, 0.012**2), nothing, np.zeros(8))
    book = SharpnessBook()
    book.restore([arcs, near, Spread(2, np.full(363, 0.036**2), nothing, np.zeros(363))])
    assert book.judge().known
    assert not book.judge().poor
    book.restore([arcs, near, Spread(2, np.full(363, 0.06**2), nothing, np.zeros(363))])
    assert book.judge().hopeless
