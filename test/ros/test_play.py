# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The player: what was recorded, in its timing, with /clock."""

import dataclasses
from pathlib import Path
import threading
import time
from types import SimpleNamespace

from nav_msgs.msg import Odometry
import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rig import isolate, take_domain, wait_for
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import get_typestore, Stores
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from plc_inspect.core.setup.transforms import StampedTransform
from plc_inspect.errors import ConfigError
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.ros import play
from plc_inspect.ros.play import main, Player

DEMO = Path(__file__).parents[2] / 'bags' / 'demo'


class Listener:
    """Keeps what arrives, and when."""

    def __init__(self, context, depth=1000):
        self.node = Node('listener', context=context)
        self.received = {'scans': [], 'poses': [], 'clock': []}
        reliable = QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.RELIABLE)
        for name, kind, topic in (
            ('scans', PointCloud2, 'velodyne_points'), ('poses', Odometry, 'odometry'),
            ('clock', Clock, '/clock'),
        ):
            self.node.create_subscription(
                kind, topic,
                lambda message, name=name: self.received[name].append((time.monotonic(), message)),
                reliable,
            )
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def close(self):
        self.executor.shutdown()
        self.thread.join(10.0)
        self.node.destroy_node()


@pytest.fixture
def graph(monkeypatch):
    """Return a listener; the player's default context is on the same graph."""
    isolate()
    domain = take_domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    listener = Listener(context)
    yield listener
    listener.close()
    rclpy.shutdown(context=context)


def to_ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def test_everything_arrives_as_recorded(graph):
    assert main([str(DEMO), '--rate', '20', '--start', '40', '--wait', '20', '--quiet']) == 0
    with AnyReader([DEMO]) as reader:
        first = reader.start_time
        messages = [
            (stamp, connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, stamp, raw in reader.messages() if stamp - first >= 40 * 10**9
        ]
    scans = [message for _, topic, message in messages if topic == '/velodyne_points']
    poses = [message for _, topic, message in messages if topic == '/odometry']
    wait_for(lambda: len(graph.received['poses']) == len(poses), 'poses')
    got = [message for _, message in graph.received['scans']]
    assert len(got) == len(scans) > 50
    for one, other in zip(got, scans, strict=True):
        assert to_ns(one.header.stamp) == to_ns(other.header.stamp)
        assert (one.width, one.point_step) == (other.width, other.point_step)
        assert bytes(one.data) == bytes(other.data)
        assert [f.name for f in one.fields] == [f.name for f in other.fields]
    for (_, one), other in zip(graph.received['poses'], poses, strict=True):
        assert one.pose.pose.position.x == other.pose.pose.position.x
        assert one.header.frame_id == other.header.frame_id
    clock = [to_ns(message.clock) for _, message in graph.received['clock']]
    assert clock == sorted(clock)
    assert clock[0] <= messages[0][0]
    assert messages[-1][0] - clock[-1] < 0.5e9


def test_a_loop_over_nothing_is_refused(graph, monkeypatch, capsys):
    # the topics that are not played may go on for longer
    monkeypatch.setattr(Recording, 'duration', 1000.0)
    ended = threading.Timer(20.0, rclpy.try_shutdown)
    ended.start()
    code = main([str(DEMO), '--loop', '--start', '500', '--wait', '0', '--quiet'])
    ended.cancel()
    assert code == 2
    assert capsys.readouterr().err == 'plc_play: no scan or pose lies beyond --start 500 s\n'


def test_timing_follows_the_rate(graph):
    began = time.monotonic()
    assert main([str(DEMO), '--rate', '4', '--start', '38', '--wait', '20', '--quiet']) == 0
    scans = graph.received['scans']
    wait_for(lambda: len(scans) > 50, 'scans')
    arrival = [at for at, _ in scans]
    stamp = [to_ns(message.header.stamp) * 1e-9 for _, message in scans]
    assert arrival[-1] - arrival[0] == pytest.approx((stamp[-1] - stamp[0]) / 4, abs=0.4)
    assert time.monotonic() - began < 30


def test_the_end_of_ros_ends_a_loop(graph):
    isolate()
    rclpy.init()
    try:
        with Recording(DEMO, 'velodyne_points', 'odometry') as recording:
            player = Player(recording, 'velodyne_points')
            assert player.wait_for_subscribers(20.0)
            threading.Timer(0.5, rclpy.utilities.try_shutdown).start()
            count = player.play(1.0, 0.0)
            assert 0 < count < recording.num_messages
            player.close()
    finally:
        rclpy.utilities.try_shutdown()


def test_ros1_recordings_become_ros2_messages(graph, tmp_path):
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    with AnyReader([DEMO]) as reader:
        messages = [
            (c.topic, c.msgtype, stamp, reader.deserialize(raw, c.msgtype))
            for c, stamp, raw in list(reader.messages())[:40]
        ]
    with Writer1(tmp_path / 'old.bag') as writer:
        connections = {}
        for topic, kind, stamp, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ros1)
            writer.write(connections[topic], stamp, to_ros1(ros1, message, kind))
    assert main([str(tmp_path / 'old.bag'), '--rate', '10', '--wait', '20', '--quiet']) == 0
    expected = [message for topic, _, _, message in messages if topic == '/odometry']
    wait_for(lambda: len(graph.received['poses']) == len(expected), 'poses')
    for (_, one), other in zip(graph.received['poses'], expected, strict=True):
        assert to_ns(one.header.stamp) == to_ns(other.header.stamp)
        assert one.header.frame_id == other.header.frame_id
        assert one.pose.pose.position.y == other.pose.pose.position.y
    scans = [message for topic, _, _, message in messages if topic == '/velodyne_points']
    for (_, one), other in zip(graph.received['scans'], scans, strict=True):
        assert bytes(one.data) == bytes(other.data)


def to_ros1(ros1, message, kind):
    """Serialise a ROS 2 message for ROS 1, whose header has a sequence number."""
    header = ros1.types['std_msgs/msg/Header'](seq=0, stamp=message.header.stamp,
                                               frame_id=message.header.frame_id)
    fields = {f.name: getattr(message, f.name) for f in dataclasses.fields(message)
              if f.name != '__msgtype__'}
    fields['header'] = header
    return bytes(ros1.serialize_ros1(ros1.types[kind](**fields), kind))


class Transforms:
    """Stands in for tf2_msgs/TFMessage, which is not everywhere."""

    def __init__(self, transforms):
        self.transforms = transforms


def turn(child, height, parent='base_link'):
    """Return a fixed transform upwards [m]."""
    return StampedTransform(
        0, parent, child, np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0, 0.0])
    )


@pytest.fixture
def player(graph, monkeypatch):
    """Return a function that makes a player of a recording with fixed transforms, and them."""
    isolate()
    rclpy.init()
    made = []
    create = Node.create_publisher

    def note(node, kind, topic, *profile, **options):
        if topic != '/tf_static':
            return create(node, kind, topic, *profile, **options)
        assert profile[0].durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
        assert kind is Transforms
        made.append([])
        return SimpleNamespace(publish=made[-1].append)

    def run(kind, *fixed):
        monkeypatch.setattr(play, 'import_tf', lambda: kind)
        monkeypatch.setattr(Node, 'create_publisher', note)
        recording = SimpleNamespace(
            pose_type='nav_msgs/msg/Odometry', pose_name='odometry', fixed_transforms=fixed
        )
        Player(recording, 'velodyne_points').close()
        return made

    yield run
    rclpy.utilities.try_shutdown()


def test_fixed_transforms_are_published_once_and_latched(player):
    ((message,),) = player(
        Transforms, turn('velodyne', 0.4), turn('camera', 0.1), turn('/velodyne', 0.5)
    )
    found = {
        item.child_frame_id: (item.header.frame_id, item.transform.translation.z)
        for item in message.transforms
    }
    assert found == {'/velodyne': ('base_link', 0.5), 'camera': ('base_link', 0.1)}
    assert [item.transform.rotation.z for item in message.transforms] == [1.0, 1.0]
    assert [item.transform.rotation.w for item in message.transforms] == [0.0, 0.0]


def test_without_tf_messages_the_mount_that_lacks_is_named(player, capsys):
    assert player(None, turn('velodyne', 0.5)) == []
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert '/tf_static of the recording is not published' in said
    assert 'install ros-jazzy-tf2-msgs' in said
    assert player(None) == []
    assert capsys.readouterr().err == ''


@pytest.mark.parametrize('kind', ['tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'])
def test_poses_of_tf_are_those_of_tf2(monkeypatch, kind):
    monkeypatch.setattr(play, 'import_tf', lambda: Transforms)
    assert play._find_class(kind) is Transforms
    monkeypatch.setattr(play, 'import_tf', lambda: None)
    with pytest.raises(ConfigError, match='tf2_msgs cannot be imported'):
        play._find_class(kind)


@pytest.mark.parametrize(('arguments', 'text'), [
    (['--rate', '0'], 'not a positive number'),
    (['--start', '1000'], 'beyond the end'),
    (['--scan-topic', 'camera'], 'has no /camera'),
    (None, 'BAG'),
])
def test_bad_usage_is_one_line(capfd, arguments, text):
    try:
        code = main([] if arguments is None else [str(DEMO), *arguments])
    except SystemExit as error:  # of argparse
        code = error.code
    said = capfd.readouterr().err
    assert code == 2
    assert text in said
    assert said.count('\n') == 1
