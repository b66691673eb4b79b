# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0
"""Large scans between two processes: what the chosen transport is for."""

import os
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rig import isolate, take_domain
from sensor_msgs.msg import PointCloud2

from plc_inspect.ros.graph.qos import SCANS

NUM_SCANS = 40
PATIENCE = 60.0
"""Longest time to find each other and send everything [s]."""
PUBLISHER = f"""
import array, sys, time
import rclpy
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import PointCloud2
rclpy.init()
node = rclpy.create_node('driver')
qos = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)
publisher = node.create_publisher(PointCloud2, 'velodyne_points', qos)
end = time.monotonic() + {PATIENCE / 2}
while not publisher.get_subscription_count():
    if time.monotonic() > end:
        sys.exit('nobody listens')
    time.sleep(0.02)
time.sleep(0.5)
message = PointCloud2()
message.data = array.array('B', bytes(30_000 * 22))
for number in range({NUM_SCANS}):
    message.header.stamp.sec = number
    publisher.publish(message)
    time.sleep(0.05)
time.sleep(1.0)
"""


@pytest.mark.slow
def test_large_scans_sent_best_effort_all_arrive():
    isolate()
    domain = take_domain()
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node('listener', context=context)
    seen = []
    node.create_subscription(
        PointCloud2, 'velodyne_points', lambda message: seen.append(message.header.stamp.sec),
        SCANS,
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    driver = subprocess.Popen(
        [sys.executable, '-c', PUBLISHER], env={**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    )
    try:
        end = time.monotonic() + PATIENCE
        while driver.poll() is None and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
    finally:
        driver.kill()
        driver.wait()
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert driver.returncode == 0
    assert seen == list(range(NUM_SCANS))
