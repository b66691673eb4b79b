# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Levels of the keep-out rise at once and fall late."""

import math

import numpy as np
import pytest

from plc_inspect.core.live.held_levels import HeldLevels, HOLD_NS, MARGIN
from plc_inspect.core.live.proximity import Level, Proximity, Thing
from plc_inspect.node_config import ProximitySettings

SETTINGS = ProximitySettings()
STEP_NS = 50_000_000
HERE = np.zeros(3)


def judge(distance, *, seen=True):
    """Return the level of a distance as it is measured."""
    if distance <= SETTINGS.critical:
        return Level.CRITICAL
    if distance <= SETTINGS.warning:
        return Level.WARNING
    return Level.CLEAR if seen else Level.UNKNOWN


def measure(distance, thing=Thing.CONDUCTOR, *, seen=True):
    """Return what is measured of a thing that lies along x; NaN: nothing is known."""
    return Proximity(
        thing=thing, level=judge(distance, seen=seen), distance=distance,
        position=np.array([distance, 0.0, 0.0]) if math.isfinite(distance) else np.full(3, np.nan),
    )


class Flight:
    """Poses 20 times a second."""

    def __init__(self):
        self.levels, self.stamp_ns = HeldLevels(), 0

    def tell(self, distance, vehicle=HERE, **options):
        self.stamp_ns += STEP_NS
        (found,) = self.levels.hold(
            [measure(distance, **options)], self.stamp_ns, vehicle, SETTINGS
        )
        return found

    def levels_of(self, distances):
        return [self.tell(distance).level for distance in distances]


def count_rises(levels):
    """Return how often an alarm begins."""
    critical = np.array([Level.CLEAR, *levels]) == Level.CRITICAL
    return int((critical[1:] & ~critical[:-1]).sum())


def test_an_alarm_at_its_limit_begins_once():
    rng = np.random.default_rng(3)
    distances = SETTINGS.critical + 0.3 * rng.standard_normal(600)
    assert count_rises([judge(item) for item in distances]) > 100
    assert count_rises(Flight().levels_of(distances)) == 1


@pytest.mark.parametrize('seed', range(4))
def test_no_level_is_ever_lower_or_later_than_measured(seed):
    rng = np.random.default_rng(seed)
    flight = Flight()
    for distance in 15.0 + np.cumsum(rng.normal(0.0, 1.0, 2000)):
        given = math.nan if rng.random() < 0.05 else abs(distance)
        found = flight.tell(given, seen=bool(rng.random() < 0.7))
        raw = measure(given).level
        assert found.level >= raw or raw == Level.CLEAR
        if raw >= Level.WARNING and found.level == raw:
            assert found.distance == given


def test_it_falls_once_it_was_beyond_the_margin_long_enough():
    flight = Flight()
    flight.tell(SETTINGS.critical)
    beyond = SETTINGS.critical + MARGIN + 0.01
    steps = HOLD_NS // STEP_NS
    levels = flight.levels_of([beyond] * (steps - 1))
    assert set(levels) == {Level.CRITICAL}
    assert flight.tell(beyond).level == Level.WARNING
    # within the margin it stands for as long as it takes
    flight.tell(SETTINGS.critical)
    assert set(flight.levels_of([SETTINGS.critical + MARGIN] * 4 * steps)) == {Level.CRITICAL}
    # a warning that has just been critical has its margin too
    flight.levels_of([beyond] * steps)
    assert flight.tell(SETTINGS.warning + MARGIN).level == Level.WARNING
    assert set(flight.levels_of([SETTINGS.warning + 2 * MARGIN] * (steps - 1))) == {Level.WARNING}
    assert flight.tell(SETTINGS.warning + 2 * MARGIN).level == Level.CLEAR


def test_far_off_it_becomes_clear_without_a_warning_between():
    flight = Flight()
    flight.tell(SETTINGS.critical)
    levels = flight.levels_of([60.0] * (HOLD_NS // STEP_NS))
    assert levels[-2:] == [Level.CRITICAL, Level.CLEAR]


def test_what_is_not_found_for_a_tick_is_told_where_it_was():
    flight = Flight()
    flight.tell(5.0)
    gone = flight.tell(math.nan, vehicle=np.array([0.0, 12.0, 0.0]), seen=False)
    assert gone.level == Level.CRITICAL
    assert gone.distance == pytest.approx(13.0)
    assert gone.position.tolist() == [5.0, 0.0, 0.0]
    other = flight.tell(30.0)  # another one, farther off
    assert (other.level, other.distance) == (Level.CRITICAL, 5.0)
    assert math.isnan(other.closest)
    flight.levels_of([math.nan] * (HOLD_NS // STEP_NS))
    assert flight.tell(math.nan, seen=False).level == Level.UNKNOWN


def test_things_are_held_apart_and_time_that_goes_back_forgets():
    levels = HeldLevels()
    both = [measure(5.0), measure(50.0, Thing.SUPPORT)]
    found = levels.hold(both, 1, HERE, SETTINGS)
    assert [item.level for item in found] == [Level.CRITICAL, Level.CLEAR]
    found = levels.hold([measure(50.0), measure(50.0, Thing.SUPPORT)], 2, HERE, SETTINGS)
    assert [item.level for item in found] == [Level.CRITICAL, Level.CLEAR]
    found = levels.hold([measure(50.0)], 1, HERE, SETTINGS)
    assert [item.level for item in found] == [Level.CLEAR]
    assert levels.hold([], 3, HERE, SETTINGS) == ()


def test_where_the_vehicle_is_not_known_the_level_stands_without_a_place():
    flight, nowhere = Flight(), np.full(3, np.nan)
    flight.tell(5.0)
    found = flight.tell(math.nan, nowhere, seen=False)
    assert found.level == Level.CRITICAL
    assert math.isnan(found.distance)
    assert np.isnan(found.position).all()
    for _ in range(HOLD_NS // STEP_NS):
        found = flight.tell(math.nan, nowhere, seen=False)
    assert found.level == Level.UNKNOWN
