# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Returns from near the vehicle, until a tick has looked at them."""

import numpy as np
import pytest

from plc_inspect.config import MapSettings
from plc_inspect.core.alignment.parts import Seen
from plc_inspect.core.mapping.map_entry import MapEntry
from plc_inspect.core.mapping.near_returns import KEPT_NS, LEAST_RETURNS, MOST_KEPT

PLACE = np.array([0.0, 0.0, 10.0])
SCAN_NS = 100_000_000
WIRE = np.column_stack((np.linspace(-2.0, 2.0, 41), np.full(41, 6.0), np.full(41, 9.5)))
GROUND = np.column_stack((
    np.tile(np.linspace(-50.0, 50.0, 40), 40), np.repeat(np.linspace(-50.0, 50.0, 40), 40),
    np.zeros(1600),
))


def enter(entry, *clouds, place=PLACE):
    """Put scans in, one after the other."""
    for points in clouds:
        stamp = (entry.map.sequence + 1) * SCAN_NS
        entry.enter(Seen(
            points, np.full(len(points), stamp), np.linalg.norm(points - place, axis=1), stamp,
        ))


def find(entry, place=PLACE, reach=8.0, sequence=0, *, ground=True):
    return entry.near.find(np.array(place), reach, entry.map.cells, sequence, ground)


@pytest.fixture
def entry():
    entry = MapEntry(MapSettings())
    enter(entry, GROUND)
    return entry


def test_a_wire_is_told_of_before_any_tick(entry):
    enter(entry, WIRE, WIRE + 0.05)
    found = find(entry)
    assert np.linalg.norm(found - PLACE, axis=1).min() == pytest.approx(6.02, abs=0.06)
    assert len(find(entry, reach=5.0)) == 0
    assert len(find(entry, place=(np.nan,) * 3)) == 0


def test_what_a_tick_has_looked_at_is_not_fresh(entry):
    enter(entry, WIRE, WIRE)
    assert len(find(entry, sequence=entry.map.sequence)) == 0
    assert len(find(entry, sequence=entry.map.sequence - 1)) == 0  # of one scan alone
    enter(entry, WIRE)
    assert len(find(entry, sequence=entry.map.sequence - 2)) == 2 * len(WIRE)


def test_few_returns_and_those_of_one_scan_are_dust(entry):
    few = WIRE[: LEAST_RETURNS // 2]
    enter(entry, few, WIRE[20 : 20 + LEAST_RETURNS // 2])
    assert len(find(entry)) == 0
    enter(entry, few)
    assert len(find(entry)) == 2 * len(few)


def test_a_wire_beyond_many_returns_of_the_ground_is_told_of(entry):
    rng = np.random.default_rng(0)
    for _ in range(2):
        below = rng.uniform((-5.0, -5.0, -0.1), (5.0, 5.0, 0.1), (4 * MOST_KEPT, 3))
        enter(entry, np.concatenate((below, WIRE)), place=(0.0, 0.0, 5.0))
    assert len(find(entry, place=(0.0, 0.0, 5.0))) == 2 * len(WIRE)


def test_ground_below_a_vehicle_that_takes_off_is_none(entry):
    near = GROUND * [0.1, 0.1, 1.0]
    enter(entry, near, near)
    assert len(find(entry, place=(0.0, 0.0, 0.4))) == 0
    enter(entry, WIRE - [0.0, 0.0, 9.0], WIRE - [0.0, 0.0, 9.0])  # 0.5 m high
    assert len(find(entry, place=(0.0, 0.0, 0.4))) == 0
    enter(entry, WIRE - [0.0, 0.0, 7.0], WIRE - [0.0, 0.0, 7.0])
    assert len(find(entry, place=(0.0, 0.0, 0.4))) == 2 * len(WIRE)


def test_what_lies_far_below_is_left_to_ticks(entry):
    enter(entry, WIRE - [0.0, 0.0, 4.0], WIRE - [0.0, 0.0, 4.0])
    assert len(find(entry)) == 0


def test_where_no_ground_is_in_view_wires_below_are_told_of():
    entry = MapEntry(MapSettings())
    below = WIRE - (0.0, 4.0, 4.0)
    enter(entry, below, below + 0.05)
    assert len(find(entry)) == 0
    assert len(find(entry, ground=False)) == 2 * len(below)
    assert len(find(entry, reach=4.0, ground=False)) == 0


def test_many_returns_of_wires_are_kept_where_no_ground_is_in_view():
    entry = MapEntry(MapSettings())
    rng = np.random.default_rng(0)
    for _ in range(2):
        wires = rng.uniform((-25.0, -4.0, 4.0), (25.0, 4.0, 4.2), (3 * MOST_KEPT, 3))
        enter(entry, wires)
    found = find(entry, ground=False)
    assert len(found) > MOST_KEPT // 2
    assert np.linalg.norm(found - PLACE, axis=1).min() == pytest.approx(5.8, abs=0.1)


def test_returns_are_kept_for_a_while_and_not_beyond_the_map(entry):
    enter(entry, WIRE, WIRE)
    assert len(find(entry)) == 2 * len(WIRE)
    later = (entry.map.sequence + 1) * SCAN_NS + KEPT_NS
    seen = Seen(WIRE, np.full(41, later), np.full(41, 6.0), later)
    entry.near.add(seen, 9, entry.map.cells)
    assert len(find(entry)) == 0
    enter(entry, WIRE, WIRE)
    entry.clear()
    assert len(find(entry)) == 0


def test_the_nearest_of_many_returns_are_kept(entry):
    rng = np.random.default_rng(0)
    wall = rng.uniform((-4.0, 7.0, 9.0), (4.0, 7.1, 12.0), (5000, 3))
    enter(entry, *[np.concatenate((wall, WIRE))] * 4)
    found = find(entry)
    assert len(found) <= MOST_KEPT
    assert np.linalg.norm(found - PLACE, axis=1).min() == pytest.approx(6.02, abs=0.01)
