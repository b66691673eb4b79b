# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the node listens to: scans, poses of whatever type, and tf where it can be read."""

from collections.abc import Callable
import time
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from plc_inspect.config import InputSettings
from plc_inspect.errors import ConfigError
from plc_inspect.messages.poses import (
    AUTO,
    POSE_TYPES,
    STATIC_TOPIC,
    TF,
    TF_TOPIC,
    TF_TYPES,
)
from plc_inspect.messages.scans import SCAN_TYPE
from plc_inspect.ros.graph.qos import ODOMETRY, overridable, SCANS, TF_STATIC
from plc_inspect.ros.graph.tf_messages import import_tf
from plc_inspect.ros.node.intake import Intake

_CLASSES = {
    'Odometry': Odometry, 'PoseStamped': PoseStamped,
    'PoseWithCovarianceStamped': PoseWithCovarianceStamped,
}
NO_TF = (
    'tf2_msgs cannot be imported: /tf and /tf_static are not read '
    '(install ros-jazzy-tf2-msgs, or set input.odometry_topic, input.lidar_xyz and '
    'input.lidar_rpy_deg)'
)
PATIENCE = 3
"""Looks at the graph without a publisher of poses until they are taken from tf."""
MOST_NAMED = 6
"""Topics of a type that are named at most."""
TURN = 0.1
"""
Time for which poses are taken before a scan has its turn, if none waits for them [s]: that of a
scan at 10 Hz.
"""


class Subscriptions:
    """
    Subscribes to scans and poses, and follows what the topics turn out to be.

    Parameters
    ----------
    node : Node
        Owns the subscriptions.
    settings : InputSettings
        Topics, ``odometry_type`` and ``use_tf``.
    intake : Intake
        Gets the messages.
    guard : callable
        Takes the name of a callback and the callback, and returns one that never fails.
    on_lost : callable
        Called with the event when the middleware lost a scan.

    Raises
    ------
    ConfigError
        ``odometry_type`` is 'tf', and tf2_msgs cannot be imported.

    """

    def __init__(
        self, node: Node, settings: InputSettings, intake: Intake,
        guard: Callable[[str, Callable[..., None]], Callable[..., None]],
        on_lost: Callable[[Any], None],
    ) -> None:
        self._node, self._settings, self._intake, self._guard = node, settings, intake, guard
        self._poses: Subscription | None = None
        self._type = ''
        self._num_silent = 0
        self._tf_type = import_tf()
        if settings.odometry_type == TF and self._tf_type is None:
            raise ConfigError(f'input.odometry_type is tf, but {NO_TF}')
        events = SubscriptionEventCallbacks(message_lost=on_lost)
        node.create_subscription(
            PointCloud2, settings.scan_topic, guard('scan', intake.take_scan),
            event_callbacks=events, **overridable(SCANS),
        )
        if settings.use_tf and self._tf_type is not None:
            self._subscribe('tf_static', self._tf_type, STATIC_TOPIC, intake.take_fixed, TF_STATIC)
        self._follow('Odometry' if settings.odometry_type == AUTO else settings.odometry_type)

    def _subscribe(
        self, name: str, kind: Any, topic: str, take: Callable[[Any], None], profile: QoSProfile
    ) -> Subscription:
        # A topic may be named as a timer is, whose callback the guard calls without a message.
        return self._node.create_subscription(
            kind, topic, self._guard(name, take), **overridable(profile)
        )

    def _follow(self, kind: str) -> None:
        """Take poses of another type from now on."""
        if kind == self._type:
            return
        if self._poses is not None:
            self._node.destroy_subscription(self._poses)
            self._node.get_logger().info(
                f'poses come as {kind}' + (' on /tf' if kind == TF else '')
            )
        self._type = kind
        if kind == TF:
            self._poses = self._subscribe(
                'tf', self._tf_type, TF_TOPIC, self._take_all(self._intake.take_moving), ODOMETRY
            )
        else:
            self._poses = self._subscribe(
                'odometry', _CLASSES[kind], self._settings.odometry_topic,
                self._take_all(self._intake.take_odometry), ODOMETRY,
            )

    def _take_all(self, take: Callable[[Any, bool], None]) -> Callable[[Any], None]:
        """
        Return a callback that takes a message with poses, and those that wait behind it.

        The executor hands out one message of each topic in a round.  On a busy machine, where
        rounds take longer than poses are apart, scans would be seconds ahead of the poses that
        they wait for, and be dropped.  After TURN a round ends as soon as no scan that came in
        waits for poses, as more scans may have come meanwhile.
        """
        def run(message: Any) -> None:
            end = time.monotonic() + TURN
            later = self._take_next()
            while later is not None:
                take(message, True)
                message, later = later, None
                if time.monotonic() < end or self._intake.accumulator.waits:
                    later = self._take_next()
            take(message, False)

        return run

    def _take_next(self) -> Any:
        """Return the next message with poses that waits, None if there is none."""
        poses = self._poses
        if poses is None:
            return None
        with poses.handle:
            found = poses.handle.take_message(poses.msg_type, poses.raw)
        return None if found is None else found[0]

    def look(self) -> dict[str, str]:
        """
        Look at who publishes what, and follow the type of the poses where it is 'auto'.

        Returns
        -------
        dict[str, str]
            'scan' and 'odometry' to why none comes in, where the graph tells.

        """
        poses = self._types_on(self._settings.odometry_topic)
        found = [name for name, kind in POSE_TYPES.items() if kind in poses]
        moving = bool(self._types_on(TF_TOPIC) & set(TF_TYPES))
        self._num_silent = 0 if found else self._num_silent + 1
        if self._settings.odometry_type == AUTO:
            if found:
                self._follow(self._type if self._type in found else found[0])
            elif moving and self._tf_type is not None and self._num_silent > PATIENCE:
                self._follow(TF)
        return {
            'scan': self._explain(self._settings.scan_topic, {SCAN_TYPE}),
            'odometry': self._explain_poses(moving),
        }

    def _explain_poses(self, moving: bool) -> str:
        if self._type == TF:
            return self._intake.tf_problem
        wanted = set(POSE_TYPES.values())
        if self._settings.odometry_type != AUTO:
            wanted = {POSE_TYPES[self._settings.odometry_type]}
        text = self._explain(self._settings.odometry_topic, wanted)
        return f'{text}; {NO_TF}' if text and moving and self._tf_type is None else text

    def _types_on(self, topic: str) -> set[str]:
        name = self._node.resolve_topic_name(topic)
        return {item.topic_type for item in self._node.get_publishers_info_by_topic(name)}

    def _explain(self, topic: str, wanted: set[str]) -> str:
        """Say why nothing of some types comes on a topic, '' where somebody publishes it."""
        name, types = self._node.resolve_topic_name(topic), self._types_on(topic)
        if types & wanted:
            return ''
        if types:
            return f'{name} is {", ".join(sorted(types))}, not {" or ".join(sorted(wanted))}'
        there = sorted(
            f'{other} ({", ".join(sorted(set(kinds) & wanted))})'
            for other, kinds in self._node.get_topic_names_and_types()
            if set(kinds) & wanted and self._node.count_publishers(other)
            and not other.startswith(self._node.get_fully_qualified_name())
        )
        text = f'nobody publishes {name}'
        return f'{text}; there is {", ".join(there[:MOST_NAMED])}' if there else text
