# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Nothing is told of a place where the vehicle is not."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from plc_inspect.config import ProximitySettings, Settings
from plc_inspect.core.alignment.follower import Follower
from plc_inspect.core.alignment.parts import Seen
from plc_inspect.core.live.held_levels import HOLD_NS
from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.core.live.surroundings import surround
from plc_inspect.core.mapping.map_entry import MapEntry
from plc_inspect.messages.poses import StampedPose
from plc_inspect.messages.rows import PROXIMITY
from plc_inspect.ros.results.keep_out import KeepOut

STEP_NS = 20_000_000
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
START = 1_700_000_000_000_000_000
TREE = np.array([60.0, 0.0, 10.0])
"""On the way of a vehicle that flies along x at 5 m/s, 10 m high."""


class Flight:
    """A keep-out that is told of poses, without a graph."""

    def __init__(self):
        self.told, self.count = [], 0
        node = MagicMock()
        node.create_publisher.side_effect = self._publish
        self.follower, self.entry = Follower(), MapEntry(Settings().map)
        self.state = SimpleNamespace(
            sharpness=SimpleNamespace(poor=False), around=surround([], TREE[None]), sequence=0,
        )
        self.settings = Settings()
        self.keep_out = KeepOut(node, lambda: (self.state, self.settings), lambda near, yaw: None)

    def _publish(self, kind, topic, *rest, **options):
        publisher = MagicMock()
        if topic == '~/proximity':
            publisher.publish = self.told.append
        return publisher

    def fly(self, *places):
        """Tell of poses 50 times a second, and return what was told of the obstacle last."""
        for place in places:
            self.count += 1
            stamp = START + self.count * STEP_NS
            self.follower.see_pose(stamp, np.array(place), UPRIGHT)
            self.keep_out.tell(StampedPose(
                stamp_ns=stamp, position=np.array(place), quaternion=UPRIGHT,
                frame_id='odom', child_frame_id='base_link',
            ), self.follower.likely_move, self.entry)
        rows = np.frombuffer(bytes(self.told[-1].data), PROXIMITY)
        return rows[rows['thing'] == Thing.OBSTACLE][0]


def along(begin, end):
    """Return places along x at 5 m/s."""
    return [(x, 0.0, 10.0) for x in np.arange(begin, end, 0.1)]


def test_poses_that_stand_still_tell_nothing():
    flight = Flight()
    row = flight.fly(*along(0.0, 50.0))
    assert row['distance'] == pytest.approx(10.1, abs=0.01)
    assert row['level'] == Level.WARNING
    row = flight.fly(*[(49.9, 0.0, 10.0)] * 12)
    assert np.isnan(row['distance'])
    assert row['level'] == Level.WARNING  # as levels fall late
    row = flight.fly(*[(49.9, 0.0, 10.0)] * (HOLD_NS // STEP_NS))
    assert row['level'] == Level.UNKNOWN


def test_a_step_moves_nothing_away():
    flight = Flight()
    flight.fly(*along(0.0, 50.0))
    row = flight.fly(*[(x, y + 30.0, z) for x, y, z in along(50.0, 52.0)])
    assert row['level'] == Level.WARNING
    assert row['distance'] == pytest.approx(8.1, abs=0.2)
    assert row['direction_x'] == pytest.approx(1.0, abs=0.01)
    row = flight.fly(*[(x, y + 30.0, z) for x, y, z in along(52.0, 53.0)])
    assert row['level'] == Level.CRITICAL


def test_a_map_that_begins_anew_holds_no_level_of_another_frame():
    flight = Flight()
    assert flight.fly(*along(0.0, 55.0))['level'] == Level.CRITICAL
    flight.state = None
    assert flight.fly((55.0, 0.0, 10.0))['level'] == Level.UNKNOWN


@pytest.mark.parametrize(('limits', 'level'), [
    ({}, Level.CLEAR), ({'critical': 40.0}, Level.UNKNOWN), ({'warning': 40.0}, Level.UNKNOWN),
])
def test_all_within_both_limits_must_be_seen(limits, level):
    flight = Flight()
    flight.state.around = replace(surround([], np.zeros((0, 3))), ground=True)
    flight.settings = Settings(proximity=ProximitySettings(**limits))
    ground = np.mgrid[-29.5:30:1, -29.5:30:1].reshape(2, -1).T
    points = np.column_stack((ground, np.zeros(len(ground))))
    flight.entry.enter(Seen(
        points, np.full(len(points), START), np.linalg.norm(points, axis=1), START
    ))
    assert flight.fly((0.0, 0.0, 10.0))['level'] == level


@pytest.mark.parametrize('poor', [False, True])
def test_a_wire_is_an_obstacle_before_a_tick_has_looked_at_it(poor):
    """Or where what ticks found does not count, as the map is not sharp."""
    flight = Flight()
    if poor:
        flight.state.sharpness.poor, flight.state.sequence = True, 2
    else:
        flight.state = None
    assert flight.fly(*along(0.0, 2.0))['level'] == Level.UNKNOWN
    wire = np.column_stack((np.full(41, 9.0), np.linspace(-2.0, 2.0, 41), np.full(41, 10.5)))
    ground = np.array([[9.0, 0.0, 0.0]])
    for number in range(2):
        points = np.concatenate((wire, ground))
        flight.entry.enter(Seen(
            points, np.full(42, START), np.linalg.norm(points, axis=1), START + number,
        ))
    row = flight.fly(*along(2.0, 3.0))
    assert row['level'] == Level.CRITICAL
    assert row['distance'] == pytest.approx(6.1, abs=0.05)
