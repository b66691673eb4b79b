# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Input of which nothing can come: the node says within seconds what is wrong, and goes on."""

import threading

import numpy as np
import pytest
from rclpy.node import Node
from rig import make_cloud, put_stamp, Rig, wait_for
from sensor_msgs.msg import PointCloud2

from plc_inspect.core.mapping.scan_counters import DropReason
from plc_inspect.ros.graph.qos import PLAYER
from plc_inspect.ros.node.watch import SourceWatch


@pytest.fixture(scope='module')
def shared(tmp_path_factory):
    """Return one node for all tests of this module."""
    with pytest.MonkeyPatch.context() as patch:
        home = tmp_path_factory.mktemp('home')
        patch.setenv('ROS_HOME', str(home))
        rig = Rig(**{'input.max_wait': 0.3})
        rig.home = home / 'plc_inspect'
        yield rig
        rig.close()


@pytest.fixture
def rig(shared):
    """Return the node as if it had just started."""
    shared.reset()
    return shared


@pytest.fixture
def fly(rig):
    """Return a function that flies until the node is in error about its input, and tells how."""
    stop = threading.Event()
    threads = []

    def begin(send):
        def run():
            while not stop.wait(0.1):
                send()

        threads.append(threading.Thread(target=run, daemon=True))
        threads[0].start()

        def look():
            status, _ = rig.status('input')
            told = status.level == b'\x02' and 'nothing went into the map' in status.message
            return status.message if told else ''

        return wait_for(look, 'error')

    yield begin
    stop.set()
    for thread in threads:
        thread.join(10.0)
    rig.check_alive()


def send_damaged(rig, change):
    """Send poses and a scan that was changed."""
    rig.robot.time = round(rig.robot.time + 0.1, 6)
    rig.robot.send_pose()
    message = make_cloud(rig.robot.look(), rig.robot.time)
    change(message)
    rig.robot.scans.publish(message)


def swap_bytes(message):
    message.is_bigendian = True
    message.fields = message.fields[:3]


def shrink_row(message):
    message.row_step += 7


def unset_stamp(message):
    message.header.stamp.sec = message.header.stamp.nanosec = 0


@pytest.mark.parametrize(('change', 'text'), [
    (shrink_row, 'all scans are malformed: cloud of 1 rows'),
    (swap_bytes, 'all scans are malformed'),
    (unset_stamp, 'all scans are malformed: stamp of 0 s and 0 ns is not a valid time'),
])
def test_all_scans_are_malformed(rig, fly, change, text):
    assert text in fly(lambda: send_damaged(rig, change))


def test_swapped_fields_in_flight(rig, fly):
    rig.feed(2)

    def swap(message):
        message.fields[0].name, message.fields[1].name = 'y', 'x'

    size = len(rig.node.intake.accumulator.map)
    text = fly(lambda: send_damaged(rig, swap))
    assert DropReason.OTHER_LAYOUT.value in text
    assert len(rig.node.intake.accumulator.map) == size


def test_clock_ahead(rig, fly):
    def ahead(message):
        put_stamp(message, rig.robot.time + 18.05)

    text = fly(lambda: send_damaged(rig, ahead))
    assert 'scan stamps are 18.' in text


def test_odometry_too_slow(rig, fly):
    def send():
        for _ in range(3):
            rig.robot.time = round(rig.robot.time + 0.1, 6)
            rig.robot.send_scan(stamp=rig.robot.time)
        rig.robot.time = round(rig.robot.time + 0.04, 6)
        rig.robot.send_pose()

    assert 'odometry comes every 0.34 s' in fly(send)


@pytest.mark.slow
def test_two_drivers_on_one_topic(rig):
    """The second lidar hangs 2 m lower; nothing of it gets into the map."""
    node = Node('other_driver', context=rig.contexts[1])
    publisher = node.create_publisher(PointCloud2, 'velodyne_points', PLAYER)
    wait_for(publisher.get_subscription_count, 'subscriber')
    rig.feed(8)
    points = rig.robot.look() - np.float32([0, 0, 2])
    stop = threading.Event()

    def run():
        while not stop.wait(0.1):
            rig.robot.step()
            publisher.publish(make_cloud(points, rig.robot.time))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        def told():
            status, _ = rig.status('input')
            return status.message if status.level == b'\x02' else ''

        text = wait_for(told, 'error')
        while '2 publishers' not in text:
            text = wait_for(told, 'error')
        assert DropReason.OTHER_DRIVER.value in text
        wait_for(lambda: '/other_driver, /robot' in told(), 'names of both')
    finally:
        stop.set()
        thread.join(10.0)
        node.destroy_node()
    lowest = rig.node.intake.accumulator.map.centroids()[:, 2].min()
    assert lowest > -1.0
    rig.check_alive()


def test_origin_first_then_utm(rig):
    before = set(rig.home.glob('*'))  # there is no folder before the first flight is saved
    rig.feed(4)
    assert rig.call('segment').success
    rig.feed(2)
    assert rig.call('segment').success
    assert len(rig.node.state.confirmed) == 6
    utm = np.array([500_000.0, 5_800_000.0, 40.0])
    send_pose = rig.robot.send_pose
    rig.robot.send_pose = lambda stamp=None, position=(0, 0, 0), **options: send_pose(
        stamp, utm + position, **options)
    num_restarts = rig.counters().num_map_restarts
    try:
        while rig.counters().num_map_restarts == num_restarts:
            taken = rig.counters().num_scans
            rig.robot.step()
            counters = rig.wait_until(lambda c, taken=taken: c.num_scans > taken, 'scan')
        assert DropReason.OUT_OF_MAP.value not in counters.scans_dropped  # they wait, 1 s at most
        rig.feed(4)
        rig.call('segment')
        rig.feed(2)
        assert rig.call('segment').message.startswith('3 lines, 6 spans')
        assert all(item.span.start[0] > 499_000 for item in rig.node.state.confirmed)
        (folder,) = set(rig.home.iterdir()) - before  # what was found before
        assert (folder / 'spans.json').exists()
    finally:
        rig.robot.send_pose = send_pose
    rig.check_alive()


def test_full_map_holds_results_back(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    rig = Rig(**{'map.max_voxels': 6000, 'output.directory': str(tmp_path / 'out')})
    try:
        rig.feed(8)
        answer = rig.call('segment')
        assert not answer.success
        assert 'the map is full with 6000 voxels' in answer.message
        assert not rig.call('save').success
        status, _ = rig.status('map')
        assert status.level == b'\x02'
        assert 'results are held back; raise map.max_voxels' in status.message
        assert rig.node.state is None
        rig.reset()
        rig.feed(1, points=rig.robot.look(0.05))
        assert rig.node.intake.doubt == ''
        rig.feed(8)
        assert not rig.node.close()
        assert 'nothing saved: the map is full' in capfd.readouterr().err
    finally:
        rig.close()


@pytest.mark.parametrize('first', [1, 500])
def test_scans_of_one_publisher_are_taken(first):
    """The first has sent for long, or has just begun; another one joins, and stays at the end."""
    publishers = [2]
    watch = SourceWatch(lambda: publishers[0])

    def accepts(number, now):
        return watch.accepts({'publication_sequence_number': number}, now)

    assert accepts(first, 0.0)
    taken = []
    for k in range(1, 100):
        if k % 10:  # one in ten is lost
            assert accepts(first + k, 0.1 * k)
        taken.append(accepts(200 + k, 0.1 * k + 0.05))
    assert not any(taken)
    assert accepts(301, 12.0)  # the first was silent for two seconds
    publishers[0] = 1
    assert accepts(1, 12.1)  # started anew
    assert watch.accepts({}, 12.2)
