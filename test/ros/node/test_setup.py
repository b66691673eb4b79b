# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Poses of other types, tf, several vehicles, and maps that are not sharp."""

import time
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rig import isolate, put_stamp, Rig, take_domain, VEHICLE, wait_for
from sensor_msgs.msg import PointCloud2

from plc_inspect.config import InputSettings, Settings
from plc_inspect.core.live import session as session_module
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.setup.looks import Spread
from plc_inspect.core.setup.transforms import make_transform, to_quaternion
from plc_inspect.errors import ConfigError
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.ros.graph.qos import PLAYER
from plc_inspect.ros.node.diagnostics import Health
from plc_inspect.ros.node.inspect_node import InspectNode
from plc_inspect.ros.node.intake import Intake
from plc_inspect.ros.node.subscriptions import import_tf, Subscriptions

TF = 'tf2_msgs/msg/TFMessage'


@pytest.fixture(scope='module')
def shared():
    """Return one rig for the tests that leave it as it was."""
    rig = Rig()
    yield rig
    rig.close()


class Poser:
    """Publishes the robot's poses as another type."""

    def __init__(self, rig, kind):
        self._rig, self._kind = rig, kind
        rig.robot.node.destroy_publisher(rig.robot.odometry)
        self._publisher = rig.robot.odometry = rig.robot.node.create_publisher(
            kind, 'odometry', PLAYER
        )
        rig.robot.send_pose = self.send

    def send(self, stamp=None):
        """Send one pose."""
        message = self._kind()
        message.header.frame_id = 'map'
        put_stamp(message, self._rig.robot.time if stamp is None else stamp)
        pose = message.pose.pose if self._kind is PoseWithCovarianceStamped else message.pose
        pose.position.x, pose.position.y, pose.position.z = VEHICLE.tolist()
        self._publisher.publish(message)


@pytest.mark.parametrize('kind', [PoseStamped, PoseWithCovarianceStamped])
def test_poses_of_another_type_are_found(kind):
    rig = Rig(ready=False)
    try:
        Poser(rig, kind)
        wait_for(rig.robot.odometry.get_subscription_count, 'subscription of the other type')

        def fly():
            rig.robot.step()
            return rig.inserted() >= 3

        wait_for(fly, 'inserted scans')
        assert rig.node.intake.accumulator.frame_id == 'map'
    finally:
        rig.close()


def test_type_that_is_set_is_the_only_one():
    rig = Rig(ready=False, **{'input.odometry_type': 'Odometry'})
    try:
        Poser(rig, PoseStamped)
        text = wait_for(
            lambda: next((
                item.message for array in rig.received['diagnostics'] for item in array.status
                if 'PoseStamped' in item.message
            ), None), 'error', 5.0,
        )
        assert 'no scan and no odometry' in text
        assert '/odometry is geometry_msgs/msg/PoseStamped, not nav_msgs/msg/Odometry' in text
    finally:
        rig.close()


def test_topics_of_the_right_type_are_named():
    rig = Rig(ready=False)
    try:
        rig.robot.node.destroy_publisher(rig.robot.scans)
        rig.robot.scans = rig.robot.node.create_publisher(PointCloud2, '/ouster/points', PLAYER)

        def look():
            status, _ = rig.status('input')
            assert status.level == DiagnosticStatus.ERROR
            return 'nobody publishes /velodyne_points; there is /ouster/points' in status.message

        wait_for(look, 'topic that is there', 5.0)
    finally:
        rig.close()


@pytest.mark.parametrize('topic', ['scan', 'timer', 'stream', 'odometry'])
def test_callbacks_are_not_named_by_topics(topic):
    names, topics = [], []

    class Listening:
        def create_subscription(self, kind, topic, callback, *profile, **options):
            topics.append(topic)

    def guard(name, callback):
        names.append(name)
        return callback

    settings = InputSettings(odometry_topic=topic, odometry_type='Odometry', use_tf=False)
    intake = Intake(Settings(input=settings), Health(), print)
    Subscriptions(Listening(), settings, intake, guard, print)
    assert names == ['scan', 'odometry']
    assert topics == ['velodyne_points', topic]


@pytest.mark.skipif(import_tf() is not None, reason='tf2_msgs is there')
def test_poses_of_tf_need_its_messages():
    with pytest.raises(ConfigError, match='tf2_msgs cannot be imported'):
        Rig(**{'input.odometry_type': 'tf'})


def make_transforms(parent, child, xyz, rpy, stamp):
    """Return a message of /tf or /tf_static, of the typestore."""
    maker = MessageMaker()
    matrix = make_transform(xyz, rpy)
    x, y, z, w = (float(value) for value in to_quaternion(matrix[:3, :3]))
    return maker.make(TF, transforms=[maker.make(
        'geometry_msgs/msg/TransformStamped', header=maker.header(stamp, parent),
        child_frame_id=child, transform=maker.make(
            'geometry_msgs/msg/Transform', translation=maker.vector('Vector3', matrix[:3, 3]),
            rotation=maker.make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w),
        ),
    )])


def test_mount_of_tf_begins_the_map_anew(shared):
    shared.reset()
    shared.feed(3)
    intake = shared.node.intake
    before = intake.accumulator.entry.num_restarts
    intake.take_fixed(make_transforms('base_link', 'velodyne', (0, 0, 0.5), (0, 0, 0), 0))
    shared.feed(3)
    assert intake.accumulator.entry.num_restarts == before + 1
    assert 'has changed: xyz 0.000 0.000 0.500 m' in intake.accumulator.entry.cause
    highest = intake.accumulator.map.centroids()[:, 2].max()
    assert highest == pytest.approx(make_sample()[:, 2].max() + 0.5, abs=0.2)
    _, values = shared.status('input')
    assert 'from /tf_static' in values['mount of the lidar']
    intake.take_fixed(make_transforms('base_link', 'velodyne', (0, 0, 0), (0, 0, 0), 0))


def test_poses_of_tf_are_taken(shared):
    intake = shared.node.intake
    intake.accumulator.reset()
    for number in range(3):
        stamp = (5000 + number) * 1_000_000_000
        intake.take_moving(make_transforms('odom', 'base_link', (number, 0, 0), (0, 0, 0), stamp))
    assert intake.tf_problem == ''
    assert intake.accumulator.frame_id == 'odom'
    assert intake.vehicle.tolist() == [2.0, 0.0, 0.0]


def test_vehicles_in_namespaces_are_told_apart():
    isolate()
    context, domain = Context(), take_domain()
    rclpy.init(context=context, domain_id=domain)
    nodes = [InspectNode(context=context, namespace=name) for name in ('uav1', 'uav2')]
    client = Node('client', context=context)
    names = set()
    client.create_subscription(
        DiagnosticArray, '/diagnostics',
        lambda message: names.update((item.name, item.hardware_id) for item in message.status), 10,
    )
    executor = SingleThreadedExecutor(context=context)
    for node in (*nodes, client):
        executor.add_node(node)

    def found():
        executor.spin_once(timeout_sec=0.1)
        return len(names) == 10

    wait_for(found, 'diagnostics of both')
    assert names == {
        (f'{vehicle}/plc_inspect: {part}', f'{vehicle}/plc_inspect')
        for vehicle in ('uav1', 'uav2') for part in (
            'input', 'map', 'segmentation', 'record', 'security',
        )
    }
    executor.shutdown()
    for node in nodes:
        node.close(save=False)
        node.destroy_node()
    client.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def smeared(shared):
    """Return a node that knows the sample, in a map that has become hopeless."""
    shared.reset()
    shared.feed()
    assert shared.call('segment').success
    shared.feed(2)
    assert shared.call('segment').success
    spreads = shared.node._session._book._spreads
    spreads.append(Spread(1, np.full(50, 9.0), np.zeros(0), np.full(50, 0.02**2)))
    yield shared
    spreads.clear()
    shared.reset()


def test_nothing_is_looked_for_in_a_hopeless_map(smeared, monkeypatch, tmp_path):
    known = [item.key for item in smeared.node.state.confirmed]
    labels = smeared.node.intake.accumulator.map._voxels.labels.copy()
    assert len(known) >= 3
    monkeypatch.setattr(session_module, '_run', None)
    smeared.feed(2)
    answer = smeared.call('segment')
    assert not answer.success
    assert 'nothing is looked for in it' in answer.message
    assert smeared.node.state.sharpness.hopeless
    assert smeared.node.state.hazards == ()
    assert [item.key for item in smeared.node.state.confirmed] == known
    now = smeared.node.intake.accumulator.map._voxels.labels
    assert now[:len(labels)].any()
    assert (now[:len(labels)][labels > 0] == labels[labels > 0]).all()
    answer = smeared.call('save')
    assert not answer.success
    assert 'nothing is looked for in it' in answer.message


def test_a_save_tells_of_hazards_that_are_held_back(smeared, monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    spreads = smeared.node._session._book._spreads
    spreads[-1] = Spread(1, np.full(50, 0.07**2), np.zeros(0), np.full(50, 0.02**2))
    smeared.feed(2)
    answer = smeared.call('save')
    assert answer.success
    assert 'saved to' in answer.message
    assert 'hazards are held back' in answer.message


def test_hazards_are_held_back_while_the_map_is_not_sharp():
    points = make_sample()
    session, settings = Session(), Settings()
    whole = session.conclude(points, settings, 1, complete=True)
    assert whole[0].hazards
    blurred = Spread(1, np.full(50, 0.2**2), np.zeros(0), np.full(50, 0.02**2))
    session._book._spreads.append(blurred)
    state, result, _ = session.conclude(points, settings, 2, complete=True)
    assert state.sharpness.poor
    assert state.hazards == result.hazards == ()
    assert len(state.spans) == len(whole[0].spans)
    session._book.clear()
    assert session.conclude(points, settings, 3, complete=True)[0].hazards


def test_poses_that_wait_are_taken_at_once():
    """On a busy machine one pose a round would leave scans seconds ahead of the poses."""
    isolate()
    context, taken = Context(), []
    rclpy.init(context=context, domain_id=take_domain())
    node, executor = Node('busy', context=context), SingleThreadedExecutor(context=context)
    try:
        intake = SimpleNamespace(
            take_odometry=lambda message, late: taken.append(message),
            take_scan=None, take_fixed=None, take_moving=None,
            accumulator=SimpleNamespace(waits=False),
        )
        Subscriptions(node, InputSettings(), intake, lambda name, take: (
            (lambda message, info: None) if name == 'scan' else (lambda message: take(message))
        ), lambda event: None)
        publisher = node.create_publisher(Odometry, 'odometry', PLAYER)
        wait_for(publisher.get_subscription_count, 'subscription')
        for number in range(30):
            message = Odometry()
            message.header.stamp.sec = number
            publisher.publish(message)
        executor.add_node(node)
        rounds = 0
        while len(taken) < 30 and rounds < 20:
            executor.spin_once(timeout_sec=1.0)
            rounds += 1
        assert [message.header.stamp.sec for message in taken] == list(range(30))
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.parametrize('waits', [False, True])
def test_scans_have_their_turn_while_poses_wait(monkeypatch, waits):
    """
    Hundreds of poses that wait may take seconds, in which scans would be lost.

    Scans that came in before, and wait for these poses, would be dropped otherwise.
    """
    isolate()
    monkeypatch.setattr('plc_inspect.ros.node.subscriptions.TURN', 0.02)
    context, poses, order = Context(), 40, []
    rclpy.init(context=context, domain_id=take_domain())
    node, executor = Node('busy', context=context), SingleThreadedExecutor(context=context)

    def take(message, late):
        order.append((message.header.stamp.sec, late))
        time.sleep(0.005)

    try:
        intake = SimpleNamespace(
            take_odometry=take, take_scan=None, take_fixed=None, take_moving=None,
            accumulator=SimpleNamespace(waits=waits),
        )
        Subscriptions(node, InputSettings(), intake, lambda name, take: (
            (lambda message, info: order.append('scan')) if name == 'scan'
            else (lambda message: take(message))
        ), lambda event: None)
        senders = [node.create_publisher(kind, topic, PLAYER) for kind, topic in (
            (Odometry, 'odometry'), (PointCloud2, 'velodyne_points'))]
        for sender in senders:
            wait_for(sender.get_subscription_count, 'subscription')
        for number in range(poses):
            message = Odometry()
            message.header.stamp.sec = number
            senders[0].publish(message)
        for _ in range(3):
            senders[1].publish(PointCloud2())
        executor.add_node(node)
        wait_for(lambda: executor.spin_once(timeout_sec=0.1) or len(order) == poses + 3, 'rest')
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    taken = [item for item in order if item != 'scan']
    assert [stamp for stamp, _ in taken] == list(range(poses))
    last = len(order) - 1 - [item == 'scan' for item in order][::-1].index(True)
    assert (last < poses - 10) != waits  # the scans did not wait for all of the poses
    late = [late for _, late in taken]
    assert not late[-1]
    assert sum(late) > poses // 2
