# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Quality of service of every topic; all of it can be overridden by ``qos_overrides``."""

from copy import copy
from typing import TypedDict

from rclpy.event_handler import PublisherEventCallbacks, QoSOfferedIncompatibleQoSInfo
from rclpy.node import Node
from rclpy.qos import (
    qos_policy_name_from_kind,
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

SCANS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=20,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Sensor data; a second of scans may wait while the node is busy."""

ODOMETRY = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=400,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Sensor data; a second at 400 Hz."""

TF_STATIC = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
"""As tf2 publishes it: each publisher's last message reaches whoever comes late."""

RESULTS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
"""Each message replaces the one before; whoever comes late gets the last."""

PROXIMITY = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Whoever comes late waits for the next; the last may be old."""

DIAGNOSTICS = QoSProfile(depth=10)

SUMMARY = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=24,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of the stream: these have all turns, so whoever comes late has everything at once."""

SUMMARY_AHEAD = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=24,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Of who wants each message as it comes, also while one before it is lost."""

THIN_CORRIDOR = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=8,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Of the stream: what a link cannot take in time is dropped, and sent anew later."""

PLAYER = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=50,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Of the player: reliable serves subscribers of both kinds."""

CLOCK = QoSProfile(depth=10)

REQUESTS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Of services: calls that come in while the node is busy wait, so that each is answered."""


class Overridable(TypedDict):
    """Arguments of a publisher or a subscription."""

    qos_profile: QoSProfile
    qos_overriding_options: QoSOverridingOptions


def overridable(profile: QoSProfile) -> Overridable:
    """
    Let parameters override history, depth, reliability and durability of one topic.

    rclpy writes an override into the profile it is given, so each topic gets a copy.
    """
    kinds = (
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    )
    return {
        'qos_profile': copy(profile),
        'qos_overriding_options': QoSOverridingOptions(policy_kinds=kinds),
    }


class Watched(TypedDict):
    """Arguments of a publisher."""

    event_callbacks: PublisherEventCallbacks


def watched(node: Node, topic: str) -> Watched:
    """
    Let a publisher tell of subscribers whose QoS does not fit, and of no other event.

    Each kind of event is one more thing that the executor looks at whenever it wakes, which is
    more than a hundred times a second.
    """

    def tell(info: QoSOfferedIncompatibleQoSInfo) -> None:
        name = qos_policy_name_from_kind(info.last_policy_kind)
        node.get_logger().warning(
            f'{topic}: a subscriber gets nothing, as it asks for another QoS: {name}'
        )

    return {'event_callbacks': PublisherEventCallbacks(
        incompatible_qos=tell, use_default_callbacks=False
    )}
