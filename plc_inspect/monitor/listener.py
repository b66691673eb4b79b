# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The monitor's place on the ROS graph: it subscribes to the stream, and publishes nothing."""

from collections.abc import Callable, Mapping
import contextlib
from typing import Any

from plc_inspect.errors import ConfigError
from plc_inspect.ros.graph.ending import was_cut_short
from plc_inspect.ros.graph.transport import explain_start

KIND = 'std_msgs/msg/UInt8MultiArray'
TOPICS = {'summary': 'summary', 'ahead': 'summary', 'cloud': 'thin_corridor'}
"""
Topics by use: the summary in order, and each of its messages as it arrives ('ahead'); both are one
datagram on the link.
"""
MOST_AT_ONCE = 32
"""
Most messages processed before other vehicles and the page have their turn [count].
Source: derivation: the 24 messages of a resend, and some of the corridor.
"""


class Listener:
    """
    Subscriptions to the stream of one node.

    Parameters
    ----------
    node_name : str
        Name of the node with its namespace, such as ``/plc_inspect``.
    take : mapping of str to callable
        Receives the bytes of each message; keys are of TOPICS.
    arguments : list[str]
        ROS arguments, such as remappings, without ``--ros-args``.
    over_tcp : bool
        The graph is reached over TCP, where leaving it may hang.

    Raises
    ------
    ConfigError
        ROS rejects the arguments or the name.

    """

    def __init__(
        self, node_name: str, take: Mapping[str, Callable[[bytes], object]],
        arguments: list[str], *, over_tcp: bool = False,
    ) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self._rclpy = rclpy
        self._over_tcp = over_tcp
        self._context = rclpy.context.Context()
        try:
            rclpy.init(
                args=['--ros-args', *arguments] if arguments else [], context=self._context
            )
            self._node = rclpy.create_node(
                'plc_monitor', context=self._context, start_parameter_services=False,
                enable_rosout=False,
            )
            self._executor = SingleThreadedExecutor(context=self._context)
            self._executor.add_node(self._node)
            self._received = 0
            self._take, self._name = take, node_name.rstrip('/')
            self._subscriptions: dict[str, Any] = {}
            for topic in take:
                self.subscribe(topic)
        except Exception as error:  # rclpy has an exception for each kind of bad argument
            with contextlib.suppress(Exception):
                rclpy.shutdown(context=self._context)
            raise ConfigError(explain_start(error)) from error

    def subscribe(self, topic: str) -> None:
        """Subscribe to a topic, or subscribe anew, upon which the node sends its state again."""
        from std_msgs.msg import UInt8MultiArray

        from plc_inspect.ros.graph.qos import SUMMARY, SUMMARY_AHEAD, THIN_CORRIDOR

        old = self._subscriptions.pop(topic, None)
        if old is not None:
            self._node.destroy_subscription(old)
        take = self._take[topic]

        def receive(message: Any) -> None:
            self._received += 1
            take(message.data.tobytes())

        self._subscriptions[topic] = self._node.create_subscription(
            UInt8MultiArray, f'{self._name}/{TOPICS[topic]}',
            receive,
            {'summary': SUMMARY, 'ahead': SUMMARY_AHEAD, 'cloud': THIN_CORRIDOR}[topic],
        )

    def find_nodes(self) -> list[str]:
        """Return the names of nodes on the graph that publish a stream."""
        tail = '/' + TOPICS['summary']
        return sorted(
            name.removesuffix(tail)
            for name, kinds in self._node.get_topic_names_and_types()
            if name.endswith(tail) and KIND in kinds and self._node.count_publishers(name)
        )

    def spin(self, seconds: float) -> bool:
        """
        Process the messages that wait, or the first of ``seconds``.

        Parameters
        ----------
        seconds : float
            Longest wait for a message [s].

        Returns
        -------
        bool
            False after shutdown of ROS.

        """
        if not self._context.ok():
            return False
        try:
            for _ in range(MOST_AT_ONCE):
                before = self._received
                self._executor.spin_once(timeout_sec=seconds)
                if self._received == before:
                    break
                seconds = 0.0
        except Exception as error:
            if not was_cut_short(error, self._context):
                raise
        return bool(self._context.ok())

    def close(self) -> None:
        """Leave the graph; over TCP it is left to the end of the process."""
        if self._over_tcp:
            return
        self._executor.shutdown()
        self._node.destroy_node()
        self._rclpy.shutdown(context=self._context, uninstall_handlers=False)
