# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The stream of the real node: for who comes late, within its budget, through resets."""

from itertools import pairwise
import math
import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rig import Rig, wait_for
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import UInt8MultiArray

from plc_inspect.core.live.proximity import Level
from plc_inspect.core.setup.looks import Spread
from plc_inspect.monitor.picture.admission import KEPT
from plc_inspect.monitor.picture.causes import name_thing
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.picture.picture import Link
from plc_inspect.monitor.station import Station
from plc_inspect.ros.graph.qos import PROXIMITY, SUMMARY, THIN_CORRIDOR
from plc_inspect.ros.node.diagnostics import describe_segmentation, Health
from plc_inspect.stream.blocks import place_cells, read_cloud
from plc_inspect.stream.budget import OVERHEAD
from plc_inspect.stream.summary import HEALTH, read_summary, TURNS

FULL = 2.0
"""Whoever comes late has everything within this [s]."""


@pytest.fixture(scope='module')
def shared():
    """Return one node for all tests of this module."""
    rig = Rig()
    rig.listen('summary', UInt8MultiArray, '/plc_inspect/summary', SUMMARY)
    rig.listen('proximity', PointCloud2, '/plc_inspect/proximity', PROXIMITY)
    yield rig
    rig.close()


@pytest.fixture
def found(shared):
    """Return the node when it has found the six spans of the sample."""
    shared.reset()
    shared.feed()
    assert shared.call('segment').success
    shared.feed(2)
    assert shared.call('segment').message.startswith('3 lines, 6 spans')
    wait_for(lambda: len(shared.rows('catenaries')) == 6, 'catenaries')
    return shared


def test_a_node_that_prepares_is_not_ready(shared):
    health = Health()
    status = describe_segmentation(None, health, True)
    assert status.level == DiagnosticStatus.WARN
    assert status.message.startswith('NOT READY: preparing for 0 s')
    health.last_scan = 1.0  # it flies, and nobody looks
    assert describe_segmentation(None, health, True).level == DiagnosticStatus.ERROR
    assert shared.node.health.preparing is None
    assert describe_segmentation(None, shared.node.health, True).message == 'no tick yet'


class Late:
    """A monitor that comes late, on the graph of a rig."""

    def __init__(self, rig, *, cloud=True):
        self.rig, self.monitor, self.sizes = rig, Monitor(), []
        self.node = Node('late', context=rig.contexts[1])
        rig.executors[1].add_node(self.node)
        self.began = time.monotonic()
        self.node.create_subscription(
            UInt8MultiArray, '/plc_inspect/summary', self._take_summary, SUMMARY
        )
        if cloud:
            self.node.create_subscription(
                UInt8MultiArray, '/plc_inspect/thin_corridor', self._take_cloud, THIN_CORRIDOR
            )

    def _take_summary(self, message):
        self.monitor.take_summary(message.data.tobytes(), time.monotonic())

    def _take_cloud(self, message):
        self.sizes.append((time.monotonic(), len(message.data) + OVERHEAD))
        self.monitor.take_cloud(message.data.tobytes(), time.monotonic())

    def look(self):
        return self.monitor.look(time.monotonic())

    def wait(self, condition, what):
        """Wait until a condition on the picture holds; return how long it took from the start."""
        wait_for(lambda: condition(self.look()), what)
        return time.monotonic() - self.began

    def close(self):
        self.rig.destroy(self.node)


@pytest.fixture
def late(found):
    """Return a monitor that comes when everything is known."""
    late = Late(found)
    yield late
    late.close()


def test_hazards_that_are_held_back_stay_on_view(found, late):
    for _ in range(4):
        found.feed(2, points=found.robot.look_at_tree())
        assert found.call('segment').success
    late.wait(lambda p: p.complete and p.alarms, 'alarm of a hazard')
    shown, alarms = late.look().hazards, late.look().alarms
    assert not late.look().held_back
    spreads = found.node._session._book._spreads
    spreads.append(Spread(1, np.full(50, 0.2**2), np.zeros(0), np.full(50, 0.02**2)))
    found.feed(2)
    answer = found.call('segment')
    assert '6 spans, hazards held back; map is not sharp' in answer.message
    late.wait(lambda p: p.held, 'word of it')
    late.wait(lambda p: 'sharpness 0.' in p.held_back, 'reason')
    assert '6 spans, hazards held back' in late.look().texts[2]
    status = describe_segmentation(found.node.state, Health(), False)
    assert {'hazards': 'held back'}.items() <= {v.key: v.value for v in status.values}.items()
    assert late.look().hazards == shown
    assert [item.number for item in late.look().alarms] == [item.number for item in alarms]
    assert not [event for event in late.look().events if event.text.startswith('hazard 0 ')]
    spreads.clear()
    found.feed(2)
    assert found.call('segment').success
    late.wait(lambda p: not p.held and p.hazards, 'hazards again')


def test_who_comes_late_has_everything_soon(found, late):
    assert late.wait(lambda p: p.complete and len(p.spans) == 6, 'spans') < FULL
    assert late.wait(
        lambda p: p.cloud_total and p.cloud_blocks >= p.cloud_total, 'corridor'
    ) < FULL
    picture = late.look()
    rows = {(row['line_id'], row['span_id']): row for row in found.rows('catenaries')}
    assert {item.key for item in picture.spans} == set(rows)
    for item in picture.spans:
        row = rows[item.key]
        for name in ('a', 'b', 'c', 'coverage', 'num_points'):
            assert getattr(item, name) == pytest.approx(row[name], rel=1e-6, abs=5.1e-3), name
        for name in ('sag', 'length', 'rmse'):
            assert getattr(item, name) == pytest.approx(row[name], abs=1.1e-3), name
        np.testing.assert_allclose(item.start, [row[f'start_{a}'] for a in 'xyz'], atol=1e-3)
    assert picture.frame_id == 'odom'
    np.testing.assert_allclose(picture.vehicle, found.node.intake.vehicle, atol=1e-3)
    assert len(picture.supports) == len(found.node.state.supports)
    points, kind, _, _ = late.monitor.cloud.assemble_all()
    corridor = found.rows('corridor')
    own = {tuple(p) for p in np.floor(points / 0.5).astype(int).tolist()}
    xyz = np.column_stack([corridor[axis] for axis in 'xyz'])
    assert {tuple(p) for p in np.floor(xyz / 0.5).astype(int).tolist()} == own
    assert set(kind) <= set(corridor['class'])


def test_the_keep_out_comes_over_the_link(found, late):
    found.feed(2)
    wait_for(lambda: len(found.rows('proximity')) == 3, 'proximity')
    late.wait(lambda p: p.near and math.isfinite(p.near[0].distance), 'a distance')
    wire = found.rows('proximity')[0]

    def agrees(picture):
        near = picture.near[0]
        return (
            (near.thing, near.level, near.line_id, near.span_id)
            == tuple(wire[name] for name in ('thing', 'level', 'line_id', 'span_id'))
            and abs(near.distance - wire['distance']) < 1e-3
            and np.allclose(np.array(picture.vehicle) + near.way,
                            [wire[axis] for axis in 'xyz'], atol=5e-3)
        )

    late.wait(agrees, 'the distance that was published')
    picture = late.look()
    assert math.isfinite(picture.heading)
    critical = {f'keep-out {name_thing(item.thing)}' for item in picture.near
                if item.level == Level.CRITICAL}
    assert {item.key for item in picture.alarms if item.stands} >= critical


def test_it_speaks_every_second_also_when_nothing_is_new(found, late):
    late.wait(lambda p: p.complete, 'picture')
    wait_for(lambda: late.look().ages.data > 2.5, 'time')
    picture = late.look()
    assert picture.link is Link.LIVE
    assert picture.ages.health < 2.2
    assert picture.health['scans'] > 0
    assert picture.health['max_voxels'] == 200_000
    assert picture.texts[2].startswith('3 lines, 6 spans')
    assert picture.counts.lost_summary == picture.counts.lost_cloud == 0


@pytest.mark.slow
def test_what_is_kept_has_all_turns(found):
    assert SUMMARY.depth == KEPT >= 2 * TURNS
    found.reset()
    seen = len(found.received['summary'])
    for _ in range(6):
        found.feed(1)
        found.call('segment')
    wait_for(lambda: len(found.received['summary']) >= seen + TURNS + 1, 'messages')
    messages = [read_summary(m.data.tobytes()) for m in found.received['summary']]
    own = [m for m in messages if m.frame.session == messages[-1].frame.session]
    assert own[0].frame.sequence == 0
    turns = [m.turn for m in own if m.turns]
    assert turns == [k % TURNS for k in range(len(turns))]
    assert all(one.turns or other.turns for one, other in pairwise(own))


def test_a_reset_clears_the_monitors(found, late):
    late.wait(lambda p: len(p.spans) == 6 and p.cloud_cells, 'picture')
    found.reset()
    late.wait(lambda p: not p.spans and not p.cloud_cells, 'cleared picture')
    assert any('forget everything' in event.text for event in late.look().events)
    found.feed()
    found.call('segment')
    found.feed(2)
    found.call('segment')
    late.wait(lambda p: len(p.spans) == 6 and p.cloud_cells, 'new picture')
    assert not any('went back' in event.text for event in late.look().events)


def test_the_corridor_keeps_to_its_budget(found):
    setting = Parameter('stream.max_kbps', value=16.0)
    assert found.node.set_parameters([setting])[0].successful
    try:
        late = Late(found)
        late.wait(lambda p: p.complete, 'picture')
        end = time.monotonic() + 4.0
        while time.monotonic() < end:
            found.feed(1)
            found.call('segment')
        summary = sum(
            len(m.data) + OVERHEAD for m in found.received['summary']
            if read_summary(m.data.tobytes()).frame.uptime
            > read_summary(found.received['summary'][-1].data.tobytes()).frame.uptime - 4.0
        )
        cloud = sum(size for moment, size in late.sizes if moment > end - 4.0)
        late.close()
        # 4 s at 2 kB/s, what was saved up before, and one message that was begun.
        assert cloud <= max(0.0, 4.0 * 2000.0 - summary) + 2000.0 + 6500.0
    finally:
        found.node.set_parameters([Parameter('stream.max_kbps', value=256.0)])


def test_without_a_budget_there_is_no_corridor(found):
    found.node.set_parameters([Parameter('stream.max_kbps', value=0.0)])
    try:
        late = Late(found)
        late.wait(lambda p: p.complete, 'picture')
        found.feed(2)
        found.call('segment')
        late.wait(lambda p: p.counts.messages > 4, 'messages')
        assert late.look().cloud_total == 0
        late.close()
    finally:
        found.node.set_parameters([Parameter('stream.max_kbps', value=256.0)])


def test_what_is_subscribed_to_anew_comes_anew(found, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(found.domain))
    with Station('/plc_inspect', []) as station:
        def spin(condition):
            end = time.monotonic() + 20.0
            while not condition(station.look()):
                assert time.monotonic() < end, station.look()
                station.spin(0.05)

        spin(lambda p: p.complete and p.cloud_cells and p.cloud_blocks >= p.cloud_total)
        # As if messages had been lost on the way.
        station.monitor._rows.miss()
        station.monitor._wishes.want_summary(0.0)
        station.monitor._wishes.want_cloud(0.0)
        station.monitor.cloud.clear()
        began = time.monotonic()
        spin(lambda p: p.complete and p.cloud_cells and p.cloud_blocks >= p.cloud_total)
        assert time.monotonic() - began < 2 * FULL


def test_cells_lie_where_the_points_are(found, late):
    late.wait(lambda p: p.cloud_cells, 'corridor')
    frames = []
    node = Node('raw', context=found.contexts[1])
    found.executors[1].add_node(node)
    node.create_subscription(UInt8MultiArray, '/plc_inspect/thin_corridor', frames.append,
                             THIN_CORRIDOR)
    wait_for(lambda: len(frames) > 1, 'refresh for the new listener')
    found.destroy(node)
    messages = [read_cloud(m.data.tobytes()) for m in frames]
    assert messages[0].overview
    points = np.concatenate([
        place_cells(key, codes, m.voxel)[0]
        for m in messages if not m.overview for key, codes in m.blocks.items()
    ])
    corridor = found.rows('corridor')
    low = np.array([corridor[axis].min() for axis in 'xyz']) - 0.5
    high = np.array([corridor[axis].max() for axis in 'xyz']) + 0.5
    assert ((points >= low) & (points <= high)).all()


def test_every_number_of_health_is_in_the_diagnostics(found):
    found.status('input')
    report = found.received['diagnostics'][-1].status
    keys = {(status.name.rpartition(' ')[2], item.key)
            for status in report for item in status.values}
    assert set(HEALTH.values()) <= keys
