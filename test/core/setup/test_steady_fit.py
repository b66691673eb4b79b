# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plc_inspect.core.setup.look_cells import (
    choose_points,
    gather_cells,
    Look,
    REACHES,
    SAMPLES,
)
from plc_inspect.core.setup.steady_fit import (
    compare_looks,
    fit_rows,
    NUM,
    Rows,
    SteadyFit,
    WINDOW_NS,
)

START = 1_700_000_000 * 10**9
SPEED = 6.0
FACES = np.array([
    [0.0, 0.1, 1.0, 0.0], [0.0, 1.0, 0.0, 15.0], [0.0, 1.0, 0.0, -15.0], [1.0, 0.3, 0.0, 40.0],
    [1.0, -0.2, 0.1, 25.0], [1.0, 0.1, 0.0, 60.0],
])
"""Normals of planes, and where they lie along them [m]."""


def find_pose(when):
    """Return the place and the turn of a vehicle that flies along x and sways."""
    angles = np.column_stack((
        0.06 * np.sin(0.9 * when), 0.05 * np.sin(2.3 * when), 0.05 * np.cos(1.9 * when),
    ))
    places = np.column_stack((SPEED * when, 0.2 * np.sin(when), 12.0 + 0.0 * when))
    return places, Rotation.from_euler('ZYX', angles)


def make_look(number, rng, late=0.0, share=0.0, turning=0.0, mount=(0.0, 0.0, 0.0)):
    """Return a scan of the planes as a clock, positions, a heading and a mount that err put it."""
    when = 0.1 * number + rng.uniform(0.0, 0.1, 1200)
    place, turn = find_pose(when)
    normal, far = FACES[:, :3], FACES[:, 3]
    length = np.linalg.norm(normal, axis=1)
    normal, far = normal / length[:, None], far / length
    face = rng.integers(0, len(FACES), len(when))
    free = place + rng.uniform(-20.0, 20.0, (len(when), 3))
    across = (free * normal[face]).sum(axis=1) - far[face]
    world = free - normal[face] * across[:, None] + rng.normal(0.0, 0.02, (len(when), 3))
    seen = Rotation.from_rotvec(mount).apply(turn.inv().apply(world - place))

    def put(times):
        at, how = find_pose(times)
        how = Rotation.from_euler('Z', (turning * times)[:, None]) * how
        at = (1.0 + share) * at
        return at, at + how.apply(seen), how

    lidar, points, how = put(when + late)
    before = put(when + late - 0.02)[1]
    axes = np.swapaxes(how.as_matrix(), 1, 2)
    stamps = START + np.round(when * 1e9).astype(np.int64)
    return Look(points, (points - before) / 0.02, lidar, axes, stamps)


def see(fit, look, stamp_ns):
    if fit.see(look, stamp_ns):
        list(fit.judge())


def fly(seconds=12.0, **errors):
    rng, fit = np.random.default_rng(5), SteadyFit()
    for number in range(int(seconds * 10)):
        see(fit, make_look(number, rng, **errors), START + number * 10**8)
    return fit


@pytest.mark.slow
@pytest.mark.parametrize(('errors', 'which', 'value'), [
    ({'late': 0.05}, 0, -0.05), ({'late': -0.1}, 0, 0.1), ({'share': 0.05}, 1, -0.05 / 1.05),
    ({'share': -0.1}, 1, 0.1 / 0.9), ({'turning': 0.008}, 2, -0.008),
    ({'mount': (0.03, 0.0, 0.0)}, 3, -0.03), ({'mount': (0.0, 0.03, 0.0)}, 4, -0.03),
    ({'mount': (0.0, 0.0, -0.03)}, 5, 0.03),
])
def test_each_error_is_told_and_no_other(errors, which, value):
    steady = fly(**errors).steady
    assert steady is not None
    assert steady.values[which] == pytest.approx(value, rel=0.4 if which == 2 else 0.15)
    assert steady.sure[which]
    least = 0.015, 0.02, 0.005, 0.015, 0.015, 0.015
    # a heading that turned is off by then, as a lidar is that is mounted so
    others = np.delete(np.abs(steady.values) / least, [2, 5] if which == 2 else which)
    assert (others < 1.0).all()


@pytest.mark.slow
def test_right_looks_are_surely_nothing():
    for seconds in (5.0, 9.0, 21.0):
        steady = fly(seconds).steady
        assert steady is not None
        assert (np.abs(steady.values) < (0.005, 0.005, 0.001, 0.006, 0.006, 0.006)).all()
        assert not steady.sure.any()


@pytest.mark.slow
def test_standard_deviations_are_what_the_flight_shows():
    rng = np.random.default_rng(6)
    found = []
    for _ in range(8):
        fit = SteadyFit()
        for number in range(181):
            look = make_look(number, rng)
            if number % 5 == 0:  # an attitude that errs for half a second
                tilt = rng.normal(0.0, 0.002, 3)
            points = look.lidar + Rotation.from_rotvec(tilt).apply(look.points - look.lidar)
            see(fit, replace(look, points=points), START + number * 10**8)
        assert not fit.steady.sure.any()
        found.append((fit.steady.values, fit.steady.sigma))
    values, sigma = (np.array(item) for item in zip(*found, strict=True))
    share = np.sqrt((values**2).mean(axis=0)) / sigma.mean(axis=0)
    assert (share > 0.3).all()
    assert (share < 2.5).all()


def test_planes_that_lie_together_with_no_values_tell_nothing():
    rng, fit = np.random.default_rng(7), SteadyFit()
    for number in range(120):
        look = make_look(number, rng)
        points = look.points + rng.normal(0.0, 0.3, 3)
        see(fit, replace(look, points=points), START + number * 10**8)
    assert fit.steady is None


def test_few_planes_that_are_none_tell_nothing():
    """Some move the values far, and without them the values are others."""
    rng, turns = np.random.default_rng(11), np.linspace(-1.0, 1.0, 5)
    for _ in range(40):
        windows = deque()
        for _ in range(10):
            off = rng.normal(0.0, 0.05, (2, 5)).cumsum(axis=1)
            far = np.exp(rng.normal(0.0, 0.5, (2, 1, 1)))
            moves = rng.normal(size=(2, 1, NUM)) * far * turns[:, None]
            moves = moves + rng.normal(0.0, 0.1, (2, 5, NUM))
            windows.append(Rows(
                (off - off.mean(axis=1, keepdims=True)).ravel(), moves.reshape(-1, NUM),
                np.full(10, 400.0), np.repeat([0, 1], 5), np.tile([0, 1, 2, 3, 3], 2),
            ))
        assert not fit_rows(windows, np.zeros(NUM)).sure.any()


def test_too_little_tells_nothing():
    rng = np.random.default_rng(8)
    look = make_look(0, rng)
    few = gather_cells(Look(
        look.points[:4], look.velocity[:4], look.lidar[:4], look.axes[:4], look.stamps[:4]
    ))
    assert len(compare_looks([few] * 3).off) == 0
    empty = compare_looks([gather_cells(make_look(0, rng))])
    assert len(empty.off) == 0  # one look is nothing to compare
    assert fit_rows(deque([empty]), np.zeros(NUM)) is None
    fit = SteadyFit()
    for number in range(39):
        see(fit, make_look(number, rng), START + number * 10**8)
    assert fit.steady is None  # one window
    see(fit, make_look(40, rng), START + 2 * WINDOW_NS)
    assert fit.steady is not None
    fit.clear()
    assert fit.steady is None


def test_points_are_chosen_near_first_and_evenly():
    apart = np.linspace(1.0, 100.0, 20_000)
    chosen = choose_points(apart)
    assert len(chosen) <= SAMPLES
    assert apart[chosen].max() < REACHES[0]
    few = np.concatenate((np.full(10, 5.0), np.full(50, REACHES[1] - 1.0), [99.0]))
    np.testing.assert_array_equal(choose_points(few), np.arange(60))
    assert len(choose_points(np.zeros(0))) == 0


def test_input_is_unchanged():
    rng = np.random.default_rng(9)
    looks = [make_look(number, rng) for number in range(5)]
    before = [item.points.copy() for item in looks]
    compare_looks([gather_cells(look) for look in looks])
    for item, was in zip(looks, before, strict=True):
        np.testing.assert_array_equal(item.points, was)
