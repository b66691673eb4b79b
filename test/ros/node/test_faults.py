# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What goes wrong on a robot, done to the real node: counted, said, survived, never misplaced."""

import numpy as np
import pytest
from rclpy.node import Node
from rig import BASE, make_cloud, put_stamp, Rig, Robot, VEHICLE, wait_for
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from plc_inspect.core.mapping.pose_buffer import PoseStatus
from plc_inspect.core.mapping.scan_counters import DropReason
from plc_inspect.ros.graph.transport import ADVICE
from plc_inspect.ros.node import complaints


@pytest.fixture(scope='module')
def shared():
    """Return one node for all tests of this module."""
    rig = Rig(**{'input.max_wait': 0.3})
    yield rig
    rig.close()


@pytest.fixture
def rig(shared):
    """Return the node as if it had just started; what it logs is kept."""
    shared.reset()
    return shared


@pytest.fixture
def said(shared, capfd):
    """Return a function that waits for a text in the node's log."""
    text = ['']

    def wait(part):
        def look():
            text[0] += capfd.readouterr().err
            return part in text[0]

        wait_for(look, f'{part!r} in the log')

    return wait


def dropped(counters, reason):
    """Return how many scans were dropped for a reason."""
    return counters.scans_dropped.get(reason.value, 0)


def rejected(counters, status):
    """Return how many poses were rejected for a reason."""
    return counters.poses_rejected.get(status.value, 0)


def check_map(rig, points):
    """Check that the map holds just these points of the lidar's frame."""
    found = rig.node.intake.accumulator.map.centroids()
    expected = points + VEHICLE
    places = {tuple(row) for row in np.floor(expected / 0.1).astype(int)}
    assert len(found) == pytest.approx(len(places), rel=0.01)
    low, high = expected.min(axis=0) - 1e-3, expected.max(axis=0) + 1e-3
    assert (found >= low).all()
    assert (found <= high).all()


@pytest.mark.slow
def test_odometry_stops_and_comes_back(rig, said):
    rig.feed(2)
    before = dropped(rig.counters(), DropReason.WAITED_TOO_LONG)
    size = len(rig.node.intake.accumulator.map)
    for _ in range(3):
        rig.robot.time += 0.1
        rig.robot.send_scan()
    rig.wait_until(lambda c: dropped(c, DropReason.WAITED_TOO_LONG) == before + 3)
    assert len(rig.node.intake.accumulator.map) == size
    said('scans dropped: waited too long for odometry')

    def silent():
        status, _ = rig.status('input')
        return 'no odometry' in status.message and status.level == b'\x02'

    wait_for(silent, 'complaint about odometry')
    rig.check_alive()


def test_gap_in_the_odometry(rig, said):
    rig.feed(2)
    before = rig.counters()
    rig.robot.time += 0.6
    rig.robot.send_scan(stamp=rig.robot.time - 0.3)
    rig.robot.send_pose()
    after = rig.wait_until(lambda c: dropped(c, DropReason.POSE_GAP)
                           == dropped(before, DropReason.POSE_GAP) + 1)
    assert after.num_pose_gaps == before.num_pose_gaps + 1
    said('gap in the odometry')
    rig.check_alive()


def test_odometry_jumps(rig, said):
    rig.feed(2)
    size = len(rig.node.intake.accumulator.map)
    before = rig.counters()
    start = rig.robot.time
    rig.robot.send_scan(stamp=start + 0.1)
    rig.robot.send_pose(start + 0.06)
    rig.robot.send_pose(start + 0.12, position=(500.0, 0.0, 0.0))
    after = rig.wait_until(lambda c: dropped(c, DropReason.POSE_JUMP)
                           == dropped(before, DropReason.POSE_JUMP) + 1)
    assert after.num_pose_jumps == before.num_pose_jumps + 1
    assert len(rig.node.intake.accumulator.map) == size
    said('jump of the odometry')
    rig.check_alive()


@pytest.mark.parametrize(('pose', 'status'), [
    ({'position': (np.nan, 0.0, 0.0)}, PoseStatus.NOT_FINITE),
    ({'position': (0.0, np.inf, 0.0)}, PoseStatus.NOT_FINITE),
    ({'quaternion': (0.0, 0.0, 0.0, np.nan)}, PoseStatus.NOT_FINITE),
    ({'quaternion': (0.0, 0.0, 0.0, 0.0)}, PoseStatus.BAD_QUATERNION),
    ({'quaternion': (0.0, 0.0, 0.0, 2.0)}, PoseStatus.BAD_QUATERNION),
    ({'stamp': 0.5}, PoseStatus.NOT_LATER),
])
def test_bad_poses_are_not_believed(rig, said, pose, status):
    rig.feed(1)
    before = rejected(rig.counters(), status)
    rig.robot.send_pose(**({'stamp': rig.robot.time} | pose))
    rig.wait_until(lambda c: rejected(c, status) == before + 1, 'rejected pose')
    said(f'poses rejected: {status.value}')
    rig.check_alive()


def test_odometry_of_another_frame(rig):
    rig.feed(1)
    before = rig.counters().poses_rejected.get('another frame', 0)
    rig.robot.send_pose(rig.robot.time, position=(30.0, 0.0, 0.0), frame_id='map')
    rig.wait_until(lambda c: c.poses_rejected.get('another frame', 0) == before + 1)
    rig.check_alive()


def break_message(kind):
    """Return a scan that contradicts itself."""
    points = np.ones((64, 3), dtype=np.float32) * 5
    message = make_cloud(points, 0.0, fields='xy' if kind == 'missing field' else 'xyz')
    if kind == 'row_step':
        message.row_step -= 1
    elif kind == 'data length':
        message.data = message.data[:-5]
    elif kind == 'too much data':
        message.data = message.data + message.data
    elif kind == 'no fields':
        message.fields = []
    elif kind == 'field outside':
        message.fields[2].offset = message.point_step
    elif kind == 'integer x':
        message.fields[0].datatype = 5
    elif kind == 'point_step':
        message.point_step = 0
    return message


@pytest.mark.parametrize(('kind', 'text'), [
    ('missing field', "no field 'z'"),
    ('no fields', "no field 'x'"),
    ('row_step', 'row_step'),
    ('data length', 'bytes'),
    ('too much data', 'bytes'),
    ('field outside', "field 'z' ends at byte"),
    ('integer x', 'not a float'),
    ('point_step', 'too small'),
])
def test_scans_that_contradict_themselves(rig, said, kind, text):
    before = rig.node.health.malformed['scan']
    for _ in range(3):
        rig.robot.time += 0.1
        message = break_message(kind)
        put_stamp(message, rig.robot.time)
        rig.robot.scans.publish(message)
    wait_for(lambda: rig.node.health.malformed['scan'] == before + 3, 'malformed scans')
    said('scan dropped, malformed')
    said(text)
    assert len(rig.node.intake.accumulator.map) == 0
    rig.check_alive()


def test_complaints_are_throttled(rig, capfd):
    before = rig.node.health.malformed['scan']
    for _ in range(20):
        rig.robot.scans.publish(break_message('data length'))
    wait_for(lambda: rig.node.health.malformed['scan'] == before + 20, 'malformed scans')
    assert capfd.readouterr().err.count('scan dropped, malformed') == 1
    _, values = rig.status('input')
    assert int(values['messages malformed']) >= 20


@pytest.mark.parametrize('options', [
    {'big_endian': True},
    {'pad': 5},
    {'row_pad': 12, 'height': 4},
    {'times': False},
    {'big_endian': True, 'pad': 3, 'row_pad': 1, 'height': 8},
])
def test_unusual_but_good_layouts(rig, options):
    points = rig.robot.look()
    points = points[: len(points) // 8 * 8]
    rig.feed(1, points=points, **options)
    check_map(rig, points)


def test_organised_scan_with_nan(rig):
    points = rig.robot.look()
    points = points[: len(points) // 16 * 16]
    gone = np.random.default_rng(0).random(len(points)) < 0.6
    holes = points.copy()
    holes[gone] = np.nan
    before = rig.counters().points_dropped.get('not finite', 0)
    rig.feed(1, points=holes, height=16)
    check_map(rig, points[~gone])
    assert rig.counters().points_dropped['not finite'] == before + gone.sum()


def test_scan_of_no_points(rig):
    rig.feed(1, points=np.zeros((0, 3), dtype=np.float32))
    assert len(rig.node.intake.accumulator.map) == 0
    rig.check_alive()


def test_stamp_in_the_past(rig, said):
    rig.feed(2)
    size = len(rig.node.intake.accumulator.map)
    before = dropped(rig.counters(), DropReason.NO_POSE_BEFORE)
    rig.robot.send_scan(stamp=-3600.0)
    rig.wait_until(lambda c: dropped(c, DropReason.NO_POSE_BEFORE) == before + 1)
    assert len(rig.node.intake.accumulator.map) == size
    said('scans dropped: no pose before it')
    rig.check_alive()


def test_stamp_in_the_future(rig, said):
    rig.feed(2)
    before = dropped(rig.counters(), DropReason.WAITED_TOO_LONG)
    rig.robot.send_scan(stamp=rig.robot.time + 3600.0)
    rig.wait_until(lambda c: dropped(c, DropReason.WAITED_TOO_LONG) == before + 1)
    said('waited too long')
    rig.check_alive()


def test_scan_of_an_unexpected_frame(rig, said):
    rig.feed(1)
    before = dropped(rig.counters(), DropReason.WRONG_FRAME)
    rig.robot.step(frame_id='camera')
    rig.wait_until(lambda c: dropped(c, DropReason.WRONG_FRAME) == before + 1)
    said('another frame than the scans before')
    rig.check_alive()


def test_times_of_points_beyond_belief(rig, said):
    rig.feed(1)
    message = make_cloud(np.ones((10, 3), dtype=np.float32) * 5, rig.robot.time)
    before = rig.node.health.malformed['scan']
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(10, -1).copy()
    rows[:, -4:] = np.frombuffer(np.full(10, 77.0, '<f4').tobytes(), np.uint8).reshape(10, 4)
    message.data = type(message.data)('B', rows.tobytes())
    rig.robot.scans.publish(message)
    wait_for(lambda: rig.node.health.malformed['scan'] == before + 1, 'malformed scan')
    said('77 s away from the stamp')
    rig.check_alive()


def test_publisher_dies_and_comes_back(rig):
    rig.feed(2)
    rig.robot.close()
    wait_for(lambda: not rig.node.count_publishers('velodyne_points'), 'end of the publisher')
    clock = rig.robot.time
    rig.robot = Robot(rig.contexts[1])
    rig.robot.time = clock + 30.0
    rig.robot.connect()
    before = rig.counters().num_interruptions
    rig.feed(2)
    assert rig.counters().num_interruptions == before + 1
    rig.check_alive()


def test_lost_scans_are_seen_and_said(rig, said):
    before = rig.counters().num_scans_lost
    rig.feed(8)
    rig.robot.time = round(rig.robot.time + 0.2, 6)
    rig.robot.send_pose(rig.robot.time - 0.1)
    rig.robot.send_pose(rig.robot.time - 0.2 + 1e-3)
    rig.feed(1)
    rig.wait_until(lambda c: c.num_scans_lost == before + 2, 'lost scans')
    said(ADVICE)
    _, values = rig.status('input')
    assert int(values['scans lost']) == before + 2
    assert float(values['scan rate [Hz]']) == pytest.approx(10.0, abs=0.2)
    rig.check_alive()


def test_subscriber_of_another_quality_is_told(rig, said):
    """A best-effort publisher is heard; what cannot connect is logged by the middleware."""
    node = Node('other_driver', context=rig.contexts[1])
    publisher = node.create_publisher(PointCloud2, 'velodyne_points', 1)
    wait_for(publisher.get_subscription_count, 'subscriber')
    node.destroy_node()
    rig.check_alive()


def test_callback_that_fails_is_survived(rig, said, monkeypatch):
    def fail(*arguments, **options):
        raise RuntimeError('made to fail')

    rig.feed(2)
    monkeypatch.setattr('plc_inspect.core.live.session.Pipeline.trace', fail)
    answer = rig.call('segment')
    assert (answer.success, answer.message) == (False, 'made to fail')
    said('made to fail')
    status, values = rig.status('segmentation')
    assert 'made to fail' in values['last error']
    assert status.level == b'\x01'
    monkeypatch.undo()
    rig.feed(2)
    assert rig.call('segment').success
    rig.check_alive()


@pytest.fixture
def sim(capfd):
    """Return a node on simulated time and a function that sets it."""
    rig = Rig(**{'use_sim_time': True, 'input.max_wait': 60.0})
    clock = rig.robot.node.create_publisher(Clock, '/clock', 10)
    wait_for(clock.get_subscription_count, 'subscriber of /clock')

    def set_time(seconds):
        message = Clock()
        message.clock.sec = BASE + int(seconds)
        clock.publish(message)
        wait_for(lambda: rig.node.get_clock().now().nanoseconds == message.clock.sec * 10**9,
                 'time')

    yield rig, set_time
    rig.close()


def test_time_jumps_back(sim, capfd, monkeypatch):
    monkeypatch.setattr(complaints, 'THROTTLE', 1e9)
    rig, set_time = sim
    set_time(100)
    rig.robot.time = 100.0
    rig.feed(2)
    rig.robot.send_scan(stamp=100.5)
    rig.wait_until(lambda c: c.num_scans_waiting == 1, 'waiting scan')
    size = len(rig.node.intake.accumulator.map)
    set_time(50)
    counters = rig.wait_until(lambda c: c.num_scans_waiting == 0, 'reset')
    assert dropped(counters, DropReason.RESET) == 1
    assert rig.node.health.num_clock_jumps == 1
    assert 'time jumped by -50.000 s' in capfd.readouterr().err
    assert len(rig.node.intake.accumulator.map) == size
    rig.robot.time = 50.0
    rig.feed(2)
    assert rejected(rig.counters(), PoseStatus.NOT_LATER) == 0
    set_time(40)
    wait_for(lambda: rig.node.health.num_clock_jumps == 2, 'second jump')
    assert 'time jumped' not in capfd.readouterr().err  # as where two clocks take turns
