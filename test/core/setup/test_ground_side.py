# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""On which side of the vehicle the ground lies: plains, slopes, crowns and racks of wires."""

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.live.window import Window
from plc_inspect.core.setup.ground_side import measure_sides
from plc_inspect.core.setup.plumb import PlumbBook
from plc_inspect.core.setup.sharpness import Sharpness

LENGTH, HEIGHT = 60.0, 15.0
DOWN = np.array([1.0, -1.0, -1.0])


def make_way(num_places=31):
    """Return places along x, two metres apart."""
    x = np.linspace(0.0, LENGTH, 31)[:num_places]
    return np.column_stack([x, np.zeros_like(x), np.full_like(x, HEIGHT)])


def fill(half_width, height, slope=0.0, y=0.0, seed=0, density=6.0):
    """Return points on a strip along x that rises across it."""
    rng = np.random.default_rng(seed)
    number = int(density * 2.0 * half_width * (LENGTH + 40.0))
    points = rng.uniform((-20.0, -half_width, 0.0), (LENGTH + 20.0, half_width, 0.1), (number, 3))
    return points + np.column_stack([
        np.zeros(number), np.full(number, y), height + slope * points[:, 1],
    ])


@pytest.mark.parametrize('slope', [0.0, 0.5, 1.0])
def test_the_ground_lies_below(slope):
    points, way = fill(40.0, 0.0, slope), make_way()
    right, turned = measure_sides(points, way), measure_sides(points * DOWN, way * DOWN)
    assert right.known
    assert not right.overhead
    assert turned.overhead
    assert turned.above == pytest.approx(right.below, abs=0.05)


def test_crowns_above_do_not_matter():
    sides = measure_sides(np.concatenate([fill(40.0, 0.0), fill(3.0, 18.0)]), make_way())
    assert sides.above > 0.05
    assert not sides.overhead


def test_racks_of_wires_alone_tell_nothing():
    wires = np.concatenate([
        fill(0.02, 18.0, y=side + 0.6 * k, density=500.0)
        for side in (-6.0, 3.0) for k in range(4)
    ])
    assert not measure_sides(wires, make_way()).known


@pytest.mark.parametrize('way', [
    make_way(4), np.zeros((0, 3)), make_way() + np.array([0.0, 500.0, 0.0]),
], ids=['not flown', 'no way', 'elsewhere'])
def test_without_a_way_nothing_is_known(way):
    assert not measure_sides(fill(40.0, 0.0), way).known


@pytest.mark.parametrize('number', [0, 900])
def test_few_points_tell_nothing(number):
    x, y = (part.ravel() for part in np.mgrid[0.0:60.0:1.0, -7.0:8.0:1.0])
    points = np.column_stack([x, y, np.full(len(x), 2.0 + HEIGHT)])[:number] + 0.5
    assert not measure_sides(points, make_way()).known


def test_long_ways_are_looked_at_in_places():
    way = np.repeat(make_way(), 20, axis=0) + np.linspace(0.0, 0.5, 620)[:, None]
    assert measure_sides(fill(40.0, 0.0), way).below > 0.5


def test_what_is_known_stays_known_and_what_is_wrong_is_looked_at_again():
    book, way, sharp = PlumbBook(), make_way(), Sharpness(num_cells=100, blur=0.4)
    book.look(fill(40.0, 30.0), way)
    judged = book.judge(sharp)
    assert judged.poor
    assert judged.hopeless
    assert 'the ground lies above' in judged.describe()
    book.look(fill(40.0, 0.0), None)
    book.look(fill(1.0, 0.0), way)
    assert book.judge(sharp).poor
    book.look(fill(40.0, 0.0), way)
    assert not book.judge(sharp).poor
    book.look(fill(40.0, 30.0), way)
    assert not book.judge(sharp).poor


def test_nothing_is_looked_for_in_a_map_on_its_head():
    points, session = make_sample(), Session()
    session.way = np.column_stack([np.arange(10.0, 110.0, 2.0), np.full((50, 2), (4.0, 8.0))])
    assert not session.measure(points, ()).hopeless
    session = Session()
    session.way = np.column_stack([np.arange(10.0, 110.0, 2.0), np.full((50, 2), (-4.0, -8.0))])
    window = Window(
        slots=np.arange(len(points)), points=points * DOWN,
        fresh=np.zeros((0, 2), dtype=np.int64), cell_size=2.0, spans=frozenset(), sequence=1,
    )
    tick = session.tick(window, Settings(), None)
    assert tick.state.sharpness.hopeless
    assert not tick.state.spans
    assert not len(tick.labels)
    after = Session()
    after.restore(session.remember())
    assert after.state.sharpness == session.state.sharpness
