# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A stranger who knows all names: tries every topic, service and parameter, and prints what it got.

Run as a process of its own, with the transport that its environment chooses:
``python bench/common/stranger.py SECONDS``.  One line of JSON.
"""

import array
from collections import Counter
import json
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import UInt8MultiArray
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

NODE = '/plc_inspect'
OUTPUTS = {
    'lines': PointCloud2, 'corridor': PointCloud2, 'catenaries': PointCloud2,
    'hazards': PointCloud2, 'markers': MarkerArray, 'summary': UInt8MultiArray,
    'thin_corridor': UInt8MultiArray,
}
INPUTS = {'/velodyne_points': PointCloud2, '/odometry': Odometry}
SERVICES = {
    'segment': Trigger, 'save': Trigger, 'reset': Trigger, 'get_parameters': GetParameters,
    'list_parameters': ListParameters, 'set_parameters': SetParameters,
}
EASY = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT)
KEPT = QoSProfile(
    depth=10, reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)


def main() -> int:
    """Try everything for some seconds."""
    seconds = float(sys.argv[1])
    rclpy.init()
    node = Node('stranger')
    heard: Counter[str] = Counter()

    def listen(kind: type, topic: str) -> None:
        for qos in (EASY, KEPT):
            node.create_subscription(kind, topic, lambda _: heard.update([topic]), qos)

    for name, kind in OUTPUTS.items():
        listen(kind, f'{NODE}/{name}')
    for topic, kind in (*INPUTS.items(), ('/diagnostics', DiagnosticArray)):
        listen(kind, topic)
    forge = node.create_publisher(UInt8MultiArray, f'{NODE}/summary', KEPT)
    inject = {topic: node.create_publisher(kind, topic, EASY) for topic, kind in INPUTS.items()}
    clients = {
        name: node.create_client(kind, f'{NODE}/{name}') for name, kind in SERVICES.items()
    }
    answers: dict[str, bool] = {}
    calls = {}
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
        forge.publish(UInt8MultiArray(data=array.array('B', b'PLCS' + bytes(14))))
        for topic, publisher in inject.items():
            publisher.publish(INPUTS[topic]())
        for name, client in clients.items():
            if name not in calls and client.service_is_ready():
                request = SERVICES[name].Request()
                if name == 'set_parameters':
                    parameter = Parameter('hazards.critical_distance', value=0.0)
                    request.parameters = [parameter.to_parameter_msg()]
                calls[name] = client.call_async(request)
            elif name in calls and calls[name].done():
                answers[name] = True
    inputs = {name: publisher.get_subscription_count() for name, publisher in inject.items()}
    # What it hears of its own publications is no news.
    heard_of_others = {
        topic: count for topic, count in heard.items()
        if topic not in (*INPUTS, f'{NODE}/summary')
    }
    print(json.dumps({
        'nodes': sorted(set(node.get_node_names()) - {'stranger'}),
        'messages': sum(heard_of_others.values()),
        'services': sorted(set(calls)), 'answers': sorted(answers),
        # Its own subscriptions are two for each topic.
        'listeners': sum(max(0, count - 2) for count in inputs.values()),
    }), flush=True)
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
