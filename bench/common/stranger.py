# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A stranger who knows all names: tries every topic, service and parameter, and prints what it got.

Run as a process of its own, with the transport that its environment chooses:
``python bench/common/stranger.py SECONDS``.  One line of JSON: what it found, and how often it
tried.  With ``--look`` it only listens and looks, as a member may.
"""

import array
from collections import Counter
from collections.abc import Iterator
import itertools
import json
import math
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import UInt8MultiArray
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription
from visualization_msgs.msg import MarkerArray

from plc_inspect.ros.graph.tf_messages import import_tf
from plc_inspect.setting_names import describe

NODE = '/plc_inspect'
OUTPUTS = {
    'lines': PointCloud2, 'corridor': PointCloud2, 'catenaries': PointCloud2,
    'hazards': PointCloud2, 'markers': MarkerArray, 'proximity': PointCloud2,
    'proximity_markers': MarkerArray, 'summary': UInt8MultiArray,
    'thin_corridor': UInt8MultiArray,
}
INPUTS = {'/velodyne_points': PointCloud2, '/odometry': Odometry, '/clock': Clock}
TF = import_tf()
if TF is not None:  # in no wheel
    INPUTS |= {'/tf': TF, '/tf_static': TF}
SERVICES = {
    'segment': Trigger, 'save': Trigger, 'reset': Trigger,
    'describe_parameters': DescribeParameters, 'get_parameter_types': GetParameterTypes,
    'get_parameters': GetParameters, 'get_type_description': GetTypeDescription,
    'list_parameters': ListParameters, 'set_parameters': SetParameters,
    'set_parameters_atomically': SetParametersAtomically,
}
EASY = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT)
KEPT = QoSProfile(
    depth=10, reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
PAUSE, CALM = 0.05, 0.2
"""Between two messages of one topic, and between two calls of one service [s]."""


def main() -> int:
    """Try everything for some seconds."""
    seconds, looks = float(sys.argv[1]), '--look' in sys.argv
    rclpy.init()
    node = Node('stranger')
    heard: Counter[str] = Counter()
    tried: Counter[str] = Counter()

    def listen(kind: type, topic: str) -> None:
        for qos in (EASY, KEPT):
            node.create_subscription(kind, topic, lambda _: heard.update([topic]), qos)
            tried['topics listened to'] += 1

    for name, kind in OUTPUTS.items():
        listen(kind, f'{NODE}/{name}')
    for topic, kind in (*INPUTS.items(), ('/diagnostics', DiagnosticArray)):
        listen(kind, topic)
    forge = [
        node.create_publisher(UInt8MultiArray, f'{NODE}/{name}', KEPT)
        for name in ('summary', 'thin_corridor')
    ]
    inject = {topic: node.create_publisher(kind, topic, EASY) for topic, kind in INPUTS.items()}
    clients = {
        name: node.create_client(kind, f'{NODE}/{name}') for name, kind in SERVICES.items()
    }
    calls: dict[str, list[Any]] = {name: [] for name in SERVICES}
    parameters, due, pause, end = list_changes(), 0.0, 0.0, time.monotonic() + seconds
    ready: set[str] = set()
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
        ready.update(name for name, client in clients.items() if client.service_is_ready())
        if looks or time.monotonic() < pause:
            continue
        pause = time.monotonic() + PAUSE
        for publisher in forge:
            publisher.publish(UInt8MultiArray(data=array.array('B', b'PLCS' + bytes(14))))
            tried['messages sent'] += 1
        for topic, publisher in inject.items():
            publisher.publish(INPUTS[topic]())
            tried['messages sent'] += 1
        if time.monotonic() < due:
            continue
        due = time.monotonic() + CALM
        for name, client in clients.items():
            # Also where nobody seems to be there: whoever filters may hide the service alone.
            calls[name].append(client.call_async(make_request(name, parameters)))
            tried['services called'] += 1
    answers = {
        name for name, made in calls.items() if any(call.done() for call in made)
    }
    inputs = {name: publisher.get_subscription_count() for name, publisher in inject.items()}
    # What it hears of its own publications is no news.
    heard_of_others = {
        topic: count for topic, count in heard.items()
        if topic not in (*INPUTS, f'{NODE}/summary', f'{NODE}/thin_corridor')
    }
    print(json.dumps({
        'nodes': sorted(set(node.get_node_names()) - {'stranger'}),
        'messages': sum(heard_of_others.values()),
        'services': sorted(ready), 'answers': sorted(answers),
        # Of its own subscriptions the one that is easy hears what it sends.
        'listeners': sum(max(0, count - 1) for count in inputs.values()),
        'tried': tried,
    }), flush=True)
    rclpy.shutdown()
    return 0


def list_changes() -> Iterator[Parameter]:
    """Yield each parameter of the node with another value than it has, again and again."""
    changes = []
    for name, default, meta in describe():
        if isinstance(default, bool):
            value: Any = not default
        elif isinstance(default, int | float):
            value = meta['high'] if default == meta['low'] else meta['low']
            value = type(default)(value if math.isfinite(value) else default + 1)
        elif isinstance(default, str):
            value = next((item for item in meta['choices'] if item != default), '/tmp')
        else:
            value = [item + 1 for item in default]
        changes.append(Parameter(name, value=value))
    return itertools.cycle(changes)


def make_request(name: str, parameters: Iterator[Parameter]) -> Any:
    """Return a request to a service; all parameters are asked for, and set one after the other."""
    request = SERVICES[name].Request()
    if name.startswith('set_parameters'):
        request.parameters = [next(parameters).to_parameter_msg()]
    elif name in ('describe_parameters', 'get_parameter_types', 'get_parameters'):
        request.names = [name for name, _, _ in describe()]
    return request


if __name__ == '__main__':
    sys.exit(main())
