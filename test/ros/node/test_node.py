# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The real node on a real graph: what it publishes, its services, its parameters."""

from array import array
from functools import partial
import itertools
import json
import time
from types import SimpleNamespace

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy
from rig import Rig, VEHICLE, wait_for
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.errors import ConfigError
from plc_inspect.messages.rows import (
    CATENARIES,
    CORRIDOR,
    HAZARDS,
    LINES,
    PROXIMITY,
    read_rows,
)
from plc_inspect.results import PointClass
from plc_inspect.ros.graph.qos import RESULTS
from plc_inspect.ros.node.inspect_node import InspectNode
from plc_inspect.setting_names import describe
from plc_inspect.shared_files import find_shared


@pytest.fixture(scope='module')
def shared(tmp_path_factory):
    """Return one node for all tests of this module."""
    folder = tmp_path_factory.mktemp('results') / 'out'
    rig = Rig(**{'output.directory': str(folder)})
    rig.folder = folder
    yield rig
    rig.close()


@pytest.fixture
def rig(shared):
    """Return the node as if it had just started."""
    shared.reset()
    return shared


@pytest.fixture
def found(rig):
    """Return the node when it has found the six spans of the sample."""
    rig.feed()
    assert rig.call('segment').success
    rig.feed(2)
    assert rig.call('segment').message.startswith('3 lines, 6 spans')
    wait_for(lambda: len(rig.rows('catenaries')) == 6, 'catenaries')
    return rig


def test_tables_say_what_was_found(found):
    catenaries = found.rows('catenaries')
    assert catenaries.dtype == CATENARIES
    assert sorted(set(catenaries['line_id'])) == [0, 1, 2]
    assert len({(row['line_id'], row['span_id']) for row in catenaries}) == 6
    np.testing.assert_allclose(catenaries['length'], 60.0, atol=2.5)
    np.testing.assert_allclose(catenaries['sag'], 1.0, atol=0.1)
    np.testing.assert_allclose(catenaries['z'], 9.0, atol=0.05)
    for row in catenaries:
        x = row['length'] / 2
        z = row['a'] + row['c'] * np.cosh((x - row['b']) / row['c'])
        assert z == pytest.approx(9.0, abs=0.05)
        assert abs(row['start_y'] - row['y']) < 0.1
        assert 0.8 <= row['coverage'] <= 1.0
        assert row['num_points'] > 100
    wait_for(lambda: len(found.rows('lines')) > 1000, 'lines')
    lines = found.rows('lines')
    assert lines.dtype == LINES
    for row in catenaries:
        own = lines[(lines['line_id'] == row['line_id']) & (lines['span_id'] == row['span_id'])]
        assert abs(int(row['num_points']) - len(own)) <= 0.05 * len(own)
        np.testing.assert_allclose(own['y'], row['y'], atol=0.2)
        assert np.nanmax(own['residual']) < 0.5
    corridor = found.rows('corridor')
    assert corridor.dtype == CORRIDOR
    assert {PointClass.WIRE, PointClass.GROUND} <= set(corridor['class'])
    assert (corridor['clearance'] >= 0).all()
    assert set(corridor['line_id']) == {0, 1, 2}
    message = found.received['catenaries'][-1]
    assert message.header.frame_id == 'odom'
    stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
    assert stamp == pytest.approx(1_700_000_000 + found.robot.time - 0.03, abs=1e-3)


def test_proximity_follows_the_poses(found):
    def near(*position, num=6):
        found.robot.time += 6.0  # after so long without a pose it may be anywhere
        for _ in range(num):
            found.robot.time = round(found.robot.time + 0.1, 6)
            found.robot.send_pose(position=position)
        wait_for(lambda: any(map(is_last, found.received['proximity'])), 'proximity')
        message = found.received['proximity'][-1]
        assert message.header.frame_id == 'odom'
        rows = read_rows(message)
        assert rows.dtype == PROXIMITY
        assert rows['thing'].tolist() == list(Thing)
        return rows

    def is_last(message):  # poses that wait together are answered by the newest
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        return stamp == pytest.approx(1_700_000_000 + found.robot.time, abs=1e-3)

    # the outer conductor hangs at y = -1.2, 9.5 m high half way between middle and pole
    conductor, support, obstacle = near(*(np.array([45.0, -6.2, 9.25]) - VEHICLE))
    assert conductor['distance'] == pytest.approx(5.0, abs=0.1)
    assert conductor['level'] == Level.CRITICAL
    assert conductor['direction_y'] == pytest.approx(1.0, abs=0.01)
    assert conductor['line_id'] in (0, 2)
    assert support['distance'] == pytest.approx(np.hypot(15.0, 6.2), abs=0.5)
    assert obstacle['thing'] == Thing.OBSTACLE
    conductor, *_ = near(*(np.array([45.0, -46.2, 9.25]) - VEHICLE), num=27)  # as levels fall late
    assert conductor['distance'] == pytest.approx(45.0, abs=0.1)
    assert conductor['level'] == Level.UNKNOWN  # nothing was seen about there
    wait_for(lambda: any(
        mark.ns == 'proximity' and mark.action == Marker.ADD
        for message in found.received['proximity_markers'] for mark in message.markers
    ), 'marker of what is near')
    found.robot.time = round(found.robot.time + 5.0, 6)


def test_hazard_has_a_life(found):
    for _ in range(4):
        found.feed(2, points=found.robot.look_at_tree())
        assert found.call('segment').success
    rows = wait_for(lambda: found.rows('hazards') if len(found.rows('hazards')) else None,
                    'hazard')
    assert rows.dtype == HAZARDS
    near = rows[np.abs(rows['x'] - 30.0) < 3.0]
    assert len(near) >= 1
    assert near['clearance'].min() < 1.5
    assert (near['severity'] >= 2).all()
    before = set(near['id'])
    found.feed(2, points=found.robot.look_at_tree(0.05))
    found.call('segment')
    rows = found.rows('hazards')
    assert before <= set(rows['id'])
    texts = [m.text for m in found.received['markers'][-1].markers if m.ns == 'hazard_texts']
    assert len(texts) == len(rows)


def test_who_comes_late_gets_the_last(found):
    late = []
    node = Node('late', context=found.contexts[1])
    found.executors[1].add_node(node)
    node.create_subscription(PointCloud2, '/plc_inspect/catenaries', late.append, RESULTS)
    wait_for(lambda: late, 'kept message')
    assert len(read_rows(late[0])) == 6
    found.destroy(node)


def test_markers_are_stable_and_stale_ones_are_deleted(found):
    def keys(action):
        return {(m.ns, m.id) for m in found.received['markers'][-1].markers if m.action == action}

    shown = wait_for(lambda: keys(Marker.ADD), 'markers')
    assert len({key for key in shown if key[0] == 'catenaries'}) == 6
    assert {key for key in shown if key[0] == 'supports'}
    found.feed(2)
    found.call('segment')
    assert {key for key in keys(Marker.ADD) if key[0] == 'catenaries'} == {
        key for key in shown if key[0] == 'catenaries'
    }
    found.call('reset')
    wait_for(lambda: not keys(Marker.ADD), 'empty markers')
    assert {key for key in keys(Marker.DELETE) if key[0] == 'catenaries'} == {
        key for key in shown if key[0] == 'catenaries'
    }
    wait_for(lambda: len(found.rows('catenaries')) == 0, 'empty table')


def test_nothing_new_means_no_work(found):
    ticks = found.node.health.num_ticks
    answer = found.call('segment')
    assert (answer.success, answer.message) == (True, 'nothing is new since the last tick')
    assert found.node.health.num_ticks == ticks


def test_save_writes_the_folder_of_a_replay(found):
    answer = found.call('save')
    assert answer.success
    assert str(found.folder) in answer.message
    spans = json.loads((found.folder / 'spans.json').read_text())
    assert spans['frame_id'] == 'odom'
    assert len(spans['spans']) == 6
    live = {(row['line_id'], row['span_id']): row for row in found.rows('catenaries')}
    for span in spans['spans']:
        row = live[span['line_id'], span['span_id']]
        assert row['sag'] == pytest.approx(span['sag'], abs=0.02)
    run = json.loads((found.folder / 'run.json').read_text())
    assert run['command'] == 'plc_node'
    assert run['input']['counts']['num_scans_inserted'] > 0
    assert (found.folder / 'report.html').stat().st_size > 1000
    found.feed(1)
    assert found.call('save').success  # replaces its own folder


def test_nothing_to_save(rig):
    answer = rig.call('save')
    assert (answer.success, answer.message) == (False, 'nothing to save: the map is empty')


def test_diagnostics_tell_of_everything(found):
    status, values = found.status('segmentation')
    assert status.level == b'\x00', status.message
    assert values['lines'] == '3'
    assert float(values['callbacks p99 [ms]']) > 0
    assert {'stage height [ms]', 'stage hazards [ms]'} <= set(values)
    status, values = found.status('map')
    assert int(values['voxels']) == len(found.node.intake.accumulator.map)
    assert float(values['resident memory [MB]']) > 50


def test_timer_makes_ticks(rig):
    rig.feed()
    ticks = rig.node.health.num_ticks
    rig.node.set_parameters([Parameter('segment.period', value=0.1)])
    try:
        wait_for(lambda: rig.node.health.num_ticks > ticks, 'tick of the timer')
    finally:
        rig.node.set_parameters([Parameter('segment.period', value=3600.0)])


def test_changes_of_other_settings_put_no_tick_off(rig):
    rig.feed()
    ticks, number = rig.node.health.num_ticks, itertools.count(1)
    rig.node.set_parameters([Parameter('segment.period', value=0.5)])

    def change():
        limit = Parameter('proximity.warning', value=15.0 + 0.01 * next(number))
        rig.node.set_parameters([limit])
        time.sleep(0.1)
        return rig.node.health.num_ticks > ticks

    try:
        wait_for(change, 'tick of the timer')
    finally:
        rig.node.set_parameters([
            Parameter('segment.period', value=3600.0), Parameter('proximity.warning', value=15.0),
        ])


def test_every_setting_is_a_described_parameter(shared):
    for name, default, meta in describe():
        described = shared.node.describe_parameter(name)
        assert described.description.startswith(meta['description'])
        assert described.read_only == meta['structural']
        value = shared.node.get_parameter(name).value
        if name not in (
            'map.max_voxels', 'segment.period', 'output.directory', 'output.record'
        ):
            assert value == (list(default) if isinstance(default, tuple) else default)
    ranges = shared.node.describe_parameter('height.beta').floating_point_range
    assert (ranges[0].from_value, ranges[0].to_value) == (1.0, 50.0)
    assert shared.node.describe_parameter('height.num_bins').integer_range[0].to_value == 500


@pytest.mark.parametrize(('name', 'value', 'problem'), [
    ('height.beta', 1000.0, 'range'),
    ('height.num_bins', 5, 'range'),
    ('height.beta', 'tall', 'type'),
    ('corridor.environment', 'jungle', 'one of auto'),
    ('map.voxel_size', 0.2, 'read-only'),
    ('input.lidar_xyz', [1.0, 2.0], 'must hold 3'),
    ('hazards.rules', 'nonsense', "unknown rule set 'nonsense'"),
    ('hazards.rules', '/etc/secret.yaml', 'is a path, which is taken at the start only'),
    ('hazards.rules', '../secret', 'is a path'),
    ('output.directory', '/tmp', 'read-only'),
    ('security.require', 'off', 'read-only'),
])
def test_bad_parameters_are_refused(shared, name, value, problem):
    before = shared.node.settings
    result = shared.node.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful
    assert problem in result.reason
    assert shared.node.settings == before


def test_rules_of_a_file_are_read_at_the_start_only(shared, tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_bytes(find_shared('rules/sweden.yaml').read_bytes())
    node = InspectNode(
        context=shared.contexts[1], namespace='/other', parameter_overrides=[
            Parameter('hazards.rules', value=str(path)), Parameter('hazards.voltage', value=20.0),
            Parameter('map.max_voxels', value=20_000),
        ],
    )
    try:
        rules = node._live_parameters.rules
        path.write_text('name: another')
        for name, value, good in (
            ('hazards.critical_distance', 2.5, True), ('hazards.rules', 'nonsense', False),
            ('hazards.voltage', 70.0, True),
        ):
            answer = node.set_parameters([Parameter(name, value=value)])[0]
            assert answer.successful == good, answer.reason
        assert node._live_parameters.rules.name == rules.name == 'sweden'
        assert node._live_parameters.rules != rules
    finally:
        node.close(save=False)
        node.destroy_node()


def test_changes_of_parameters_are_logged_with_their_old_value(shared, monkeypatch):
    before, told = shared.node.settings.hazards.critical_distance, []
    log = shared.node.get_logger()
    monkeypatch.setattr(type(log), 'warning', lambda self, text, **_: told.append(text))
    for value in (3.5, 3.5, before):
        parameter = Parameter('hazards.critical_distance', value=value)
        assert shared.node.set_parameters([parameter])[0].successful
    assert [text for text in told if 'critical_distance' in text] == [
        'parameter hazards.critical_distance was 2.0, is 3.5',
        'parameter hazards.critical_distance was 3.5, is 2.0',
    ]


def test_it_says_who_may_come_in(shared):
    status, values = shared.status('security')
    assert status.level == b'\x01'
    assert status.message.startswith('graph is open to the network: UDP ')
    assert values['DDS Security'] == 'False'
    assert values['certificates end in [d]'] == 'none'


def test_parameters_change_as_a_whole(shared):
    before = shared.node.settings
    bad = shared.node.set_parameters_atomically([
        Parameter('height.beta', value=6.0), Parameter('hazards.min_points', value=-1),
    ])
    assert not bad.successful
    assert shared.node.settings == before
    good = shared.node.set_parameters_atomically([
        Parameter('height.beta', value=6), Parameter('input.lidar_xyz', value=[1, 0, 0]),
    ])
    assert good.successful, good.reason
    assert shared.node.settings.height.beta == 6.0
    assert shared.node.settings.input.lidar_xyz == (1.0, 0.0, 0.0)
    assert shared.node.get_parameter('height.beta').type_.value == ParameterType.PARAMETER_DOUBLE
    back = shared.node.set_parameters_atomically([
        Parameter('height.beta', value=before.height.beta),
        Parameter('input.lidar_xyz', value=list(before.input.lidar_xyz)),
    ])
    assert back.successful
    assert shared.node.settings == before


def test_mount_can_be_set_in_flight(shared):
    mount = array('d', [0.0, 30.0, 0.0])  # as a service brings it
    try:
        answer = shared.node.set_parameters([Parameter('input.lidar_rpy_deg', value=mount)])[0]
        assert answer.successful, answer.reason
        assert shared.node.settings.input.lidar_rpy_deg == (0.0, 30.0, 0.0)
    finally:
        shared.node.set_parameters([Parameter('input.lidar_rpy_deg', value=[0.0, 0.0, 0.0])])
    assert shared.node.settings.input.lidar_rpy_deg == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(('overrides', 'message'), [
    ({'height.beta': 1000.0}, r'height.beta must lie in \[1, 50\], got 1000'),
    ({'height.beta': 1000}, r'height.beta must lie in \[1, 50\]'),
    ({'height.beta': 'tall'}, r"height.beta must be like 4.0, got 'tall'"),
    ({'height.num_bins': 10.5}, r'height.num_bins must be like 100, got 10.5'),
    ({'height.betta': 3.0}, r'unknown parameter height.betta'),
    ({'corridor.environment': 'jungle'}, 'must be one of auto'),
    ({'hazards.rules': 'nonsense'}, "unknown rule set 'nonsense'"),
])
def test_bad_parameters_at_the_start(shared, overrides, message):
    with pytest.raises(ConfigError, match=message):
        InspectNode(
            context=shared.contexts[1], namespace='/other',
            parameter_overrides=[Parameter(k, value=v) for k, v in overrides.items()],
        )


def test_unknown_parameter_in_flight(shared):
    with pytest.raises(ParameterNotDeclaredException):
        shared.node.set_parameters([Parameter('height.betta', value=3.0)])


def test_integers_remappings_and_qos_overrides_at_the_start(shared):
    node = InspectNode(
        context=shared.contexts[1],
        namespace='/drone',
        cli_args=['--ros-args', '-r', 'velodyne_points:=/front/points'],
        parameter_overrides=[
            Parameter('height.beta', value=5),
            Parameter('input.lidar_xyz', value=[0, 0, 1]),
            Parameter('map.max_voxels', value=20_000),
            Parameter('qos_overrides./front/points.subscription.reliability', value='reliable'),
            Parameter('qos_overrides./drone/plc_inspect/lines.publisher.durability',
                      value='volatile'),
        ],
    )
    try:
        assert node.settings.height.beta == 5.0
        assert node.settings.input.lidar_xyz == (0.0, 0.0, 1.0)
        info = shared.client.get_subscriptions_info_by_topic
        found = wait_for(lambda: info('/front/points'), 'subscription')
        assert found[0].qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
        assert wait_for(lambda: info('/drone/odometry'), 'subscription')
        publishers = wait_for(
            lambda: shared.client.get_publishers_info_by_topic('/drone/plc_inspect/lines'), 'lines'
        )
        assert publishers[0].qos_profile.durability == QoSDurabilityPolicy.VOLATILE
        others = shared.client.get_publishers_info_by_topic('/drone/plc_inspect/corridor')
        assert others[0].qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
        drivers = [shared.client.create_publisher(PointCloud2, '/front/points', 1)
                   for _ in range(2)]
        source = node.intake.accepts.__self__
        wait_for(lambda: source.num_publishers == 2, 'both drivers are counted')
        for driver in drivers:
            shared.in_turn(partial(shared.client.destroy_publisher, driver))
        heard = []
        node.get_logger = lambda: SimpleNamespace(warning=heard.append, info=str)
        shared.client.create_subscription(
            PointCloud2, '/drone/plc_inspect/lines', heard.append, RESULTS
        )
        executor = SingleThreadedExecutor(context=shared.contexts[1])
        executor.add_node(node)

        def hear():
            executor.spin_once(timeout_sec=0.1)
            return heard

        assert 'lines: a subscriber gets nothing' in wait_for(hear, 'a warning')[0]
        assert 'DURABILITY' in heard[0]
        executor.remove_node(node)
    finally:
        node.close(save=False)
        node.destroy_node()
