# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The real node on a ROS graph of its own, and a robot that feeds it, for tests."""

from array import array
import contextlib
import os
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.messages.rows import read_rows
from plc_inspect.ros.graph.domain import take_domain
from plc_inspect.ros.graph.qos import PLAYER, PROXIMITY, RESULTS
from plc_inspect.ros.graph.transport import prepare_transport
from plc_inspect.ros.node.inspect_node import InspectNode

DEADLINE = 30.0
"""Longest wait of a test for anything [s]."""
LOST_AFTER = 3.0
"""A scan that is not in the map by then was lost on the way [s]."""
FIRST_DEADLINE = 600.0
"""The same where kernels may have to be compiled first [s]."""
BASE = 1_700_000_000
"""Time of the first scan [s]."""
VEHICLE = np.array([60.0, 9.0, 14.0])
"""Where the robot hovers in the sample's frame [m]."""
_CODES = {'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64, 'u2': PointField.UINT16,
          'i4': PointField.INT32}


def isolate():
    """Keep everything on this machine; before the first context."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    prepare_transport()


def wait_for(condition, what='condition', deadline=DEADLINE):
    """Wait until a condition holds and return what it gave; fail at the deadline."""
    end = time.monotonic() + deadline
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f'no {what} within {deadline:g} s')


def make_cloud(
    points, stamp, frame_id='velodyne', *, times=True, big_endian=False, pad=0, height=1,
    row_pad=0, fields='xyz',
):
    """Return a PointCloud2 in the driver's manner, or in one of its many variations."""
    order = '>' if big_endian else '<'
    layout = [(name, order + 'f4') for name in fields] + [('ring', order + 'u2')]
    if times:
        layout.append(('time', order + 'f4'))
    offsets = np.cumsum([0, *(np.dtype(kind).itemsize for _, kind in layout)]) + pad
    dtype = np.dtype({
        'names': [name for name, _ in layout], 'formats': [kind for _, kind in layout],
        'offsets': offsets[:-1].tolist(), 'itemsize': int(offsets[-1]) + pad,
    })
    rows = np.zeros(len(points), dtype)
    for axis, name in enumerate('xyz'):
        if name in fields:
            rows[name] = points[:, axis]
    if times:
        rows['time'] = np.linspace(-0.06, 0.0, len(points))
    width = len(points) // height
    lines = np.frombuffer(rows.tobytes(), np.uint8).reshape(height, width * dtype.itemsize)
    lines = np.pad(lines, ((0, 0), (0, row_pad)), constant_values=171)
    message = PointCloud2(
        height=height, width=width, is_bigendian=big_endian, point_step=dtype.itemsize,
        row_step=width * dtype.itemsize + row_pad,
        fields=[
            PointField(name=name, offset=dtype.fields[name][1], count=1,
                       datatype=_CODES[kind[1:]])
            for name, kind in layout
        ],
    )
    message.header.frame_id = frame_id
    put_stamp(message, stamp)
    message.data = array('B', lines.tobytes())
    return message


def put_stamp(message, stamp):
    """Set a header stamp to a number of seconds after BASE."""
    nanoseconds = round(stamp * 1e9)
    message.header.stamp.sec = BASE + nanoseconds // 1_000_000_000
    message.header.stamp.nanosec = nanoseconds % 1_000_000_000


class Robot:
    """Driver and odometry of a robot that hovers beside a made-up line of six spans."""

    def __init__(self, context):
        self.node = Node('robot', context=context)
        self.scans = self.node.create_publisher(PointCloud2, 'velodyne_points', PLAYER)
        self.odometry = self.node.create_publisher(Odometry, 'odometry', PLAYER)
        self.time = 1.0
        self._points = make_sample() - VEHICLE
        self._rng = np.random.default_rng(0)

    def connect(self):
        """Wait until the node listens."""
        wait_for(lambda: self.scans.get_subscription_count()
                 and self.odometry.get_subscription_count(), 'subscriber')

    def send_pose(self, stamp=None, position=(0.0, 0.0, 0.0), quaternion=(0.0, 0.0, 0.0, 1.0),
                  frame_id='odom'):
        """Send one pose; the position is added to where the robot hovers."""
        message = Odometry(child_frame_id='base_link')
        message.header.frame_id = frame_id
        put_stamp(message, self.time if stamp is None else stamp)
        pose = message.pose.pose
        pose.position.x, pose.position.y, pose.position.z = (VEHICLE + position).tolist()
        (pose.orientation.x, pose.orientation.y, pose.orientation.z,
         pose.orientation.w) = map(float, quaternion)
        self.odometry.publish(message)

    def look(self, share=0.5):
        """Return what a scan sees: a part of the sample, in the lidar's frame."""
        chosen = self._rng.random(len(self._points)) < share
        return self._points[chosen].astype(np.float32)

    def look_at_tree(self, moved=0.0):
        """Return what a scan sees where a tree stands right below a conductor."""
        tree = np.random.default_rng(1).normal(moved, 0.5, (800, 3))
        tree += np.array([-30.0, -6.4, -5.6])
        return np.concatenate((self.look(), tree.astype(np.float32)))

    def send_scan(self, points=None, stamp=None, **options):
        """Send one scan."""
        points = self.look() if points is None else points
        self.scans.publish(
            make_cloud(points, self.time if stamp is None else stamp, **options)
        )

    def step(self, points=None, **options):
        """Let 0.1 s pass: poses at 50 Hz and a scan of that time."""
        for number in range(5):
            self.send_pose(self.time + 0.02 * number)
        self.time = round(self.time + 0.1, 6)
        self.send_scan(points, stamp=self.time - 0.03, **options)
        self.send_pose(self.time - 0.01)

    def close(self):
        """Leave the graph."""
        self.node.destroy_node()


class Rig:
    """The node in a thread, a robot that feeds it, and a client that listens."""

    def __init__(self, *, ready=True, ticks=None, **parameters):
        isolate()
        self.domain = take_domain()
        self.contexts = [Context(), Context()]
        for context in self.contexts:
            rclpy.init(context=context, domain_id=self.domain)
        defaults = {
            'map.max_voxels': 200_000, 'segment.period': 3600.0, 'output.record': False,
        }
        overrides = [
            Parameter(name, value=value) for name, value in (defaults | parameters).items()
        ]
        self.node = InspectNode(
            ticks, context=self.contexts[0], parameter_overrides=overrides
        )
        self.log = []
        self.robot = Robot(self.contexts[1])
        self.client = Node('client', context=self.contexts[1])
        self.received, self.services = {}, {}
        for name in ('lines', 'corridor', 'catenaries', 'hazards'):
            self.listen(name, PointCloud2, f'/plc_inspect/{name}', RESULTS)
        self.listen('proximity', PointCloud2, '/plc_inspect/proximity', PROXIMITY)
        self.listen('proximity_markers', MarkerArray, '/plc_inspect/proximity_markers', PROXIMITY)
        self.listen('markers', MarkerArray, '/plc_inspect/markers', RESULTS)
        self.listen('diagnostics', DiagnosticArray, '/diagnostics', 10)
        self.executors = [
            SingleThreadedExecutor(context=context) for context in self.contexts
        ]
        self.executors[0].add_node(self.node)
        self.executors[1].add_node(self.client)
        self.threads = [
            threading.Thread(target=self._spin, args=(executor,), daemon=True)
            for executor in self.executors
        ]
        for thread in self.threads:
            thread.start()
        self.robot.connect()
        # The first job makes the kernels ready, which takes long where they must be compiled.
        if ready:
            self.call('segment', deadline=FIRST_DEADLINE)

    @staticmethod
    def _spin(executor):
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    def in_turn(self, action):
        """Run something between callbacks of the client, as it ends what its thread waits for."""
        wait_for(self.executors[1].create_task(action).done, 'turn of the client')

    def destroy(self, node):
        """Take another node of the client's thread out of the graph."""
        self.executors[1].remove_node(node)
        self.in_turn(node.destroy_node)

    def listen(self, name, kind, topic, qos):
        """Keep all messages of a topic."""
        self.received[name] = []
        self.client.create_subscription(kind, topic, self.received[name].append, qos)

    def call(self, service, deadline=DEADLINE):
        """Call a service and return its response."""
        # A client is kept: an answer may be lost on one that the server has only just met.
        if service not in self.services:
            self.services[service] = self.client.create_client(Trigger, f'/plc_inspect/{service}')
        client = self.services[service]
        assert client.wait_for_service(deadline)
        future = client.call_async(Trigger.Request())
        wait_for(future.done, f'answer of {service}', deadline)
        return future.result()

    def counters(self):
        """Return what came in so far; the node's thread may be counting just now."""
        for _ in range(20):
            try:
                return self.node.intake.accumulator.counters()
            except RuntimeError:  # a dictionary grew while it was copied
                continue
        raise AssertionError('counters are never at rest')

    def wait_until(self, condition, what='count'):
        """Wait until a condition on the counters holds, and return them."""
        wait_for(lambda: condition(self.counters()), what)
        return self.counters()

    def inserted(self):
        """Return the number of scans that went into the map."""
        return self.counters().num_scans_inserted

    def feed(self, num_scans=4, **options):
        """Send good scans until so many are in the map; a busy machine may lose some."""
        goal = self.inserted() + num_scans
        end = time.monotonic() + DEADLINE
        for _ in range(num_scans):
            self.robot.step(**options)
        while time.monotonic() < end:
            with contextlib.suppress(AssertionError):
                wait_for(lambda: self.inserted() >= goal, 'inserted scans', LOST_AFTER)
                return
            self.robot.step(**options)
        raise AssertionError(f'no inserted scans within {DEADLINE:g} s')

    def rows(self, name):
        """Return the rows of the newest message of a table."""
        return read_rows(wait_for(lambda: self.received[name], name)[-1])

    def status(self, name):
        """Return the next diagnostic status of a name, as message and values."""
        seen = len(self.received['diagnostics'])
        wait_for(lambda: len(self.received['diagnostics']) > seen + 1, 'diagnostics')
        for status in self.received['diagnostics'][-1].status:
            if status.name == f'plc_inspect: {name}':
                return status, {item.key: item.value for item in status.values}
        raise AssertionError(name)

    def reset(self):
        """Bring the node back to how it started, counters apart."""
        assert self.call('reset').success
        self.robot.time = round(self.robot.time + 100.0, 6)

    def check_alive(self):
        """Feed the node from nothing and see that it finds the line."""
        self.reset()
        self.feed()
        for _ in range(2):
            assert self.call('segment').success
            self.feed(2)
        assert self.call('segment').success
        assert len(self.node.state.confirmed) >= 3
        points = self.node.intake.accumulator.map.centroids()
        low, high = make_sample().min(axis=0) - 0.3, make_sample().max(axis=0) + 0.3
        assert (points >= low).all()
        assert (points <= high).all()

    def close(self):
        """End everything, in order."""
        for executor in self.executors:
            executor.shutdown()
        for thread in self.threads:
            thread.join(10.0)
            assert not thread.is_alive()
        self.node.close(save=False)
        self.node.destroy_node()
        self.robot.close()
        self.client.destroy_node()
        for context in self.contexts:
            rclpy.shutdown(context=context)
