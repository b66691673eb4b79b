# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's outputs: built by the worker, sent by the executor's thread."""

from dataclasses import dataclass

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from plc_inspect.core.live.session import LiveState
from plc_inspect.messages.markers import list_marks
from plc_inspect.messages.rows import (
    gather_lines,
    make_catenaries,
    make_corridor,
    make_hazards,
)
from plc_inspect.node_config import StreamSettings
from plc_inspect.ros.graph.qos import overridable, RESULTS, watched
from plc_inspect.ros.results.markers import add_deletions, make_marker, MarkerKey
from plc_inspect.ros.results.result_messages import make_cloud
from plc_inspect.ros.results.thin_link import make_news, News, Stream


@dataclass(frozen=True, slots=True, eq=False)
class Bundle:
    """All messages of one state."""

    header: Header
    lines: PointCloud2
    corridor: PointCloud2
    catenaries: PointCloud2
    hazards: PointCloud2
    markers: list[Marker]
    news: News
    """For the stream."""


def make_bundle(
    state: LiveState, frame_id: str, stamp_ns: int, stream: StreamSettings
) -> Bundle:
    """
    Turn a state into messages.

    Parameters
    ----------
    state, frame_id, stamp_ns, stream
        As for ``make_news``.

    Returns
    -------
    Bundle

    """
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    header = Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=frame_id)
    corridor = make_corridor(
        state.corridor.points, classification=state.corridor.classification,
        clearance=state.corridor.clearance, line_id=state.corridor.line_id,
        span_id=state.corridor.span_id,
    )
    spans = [item.span for item in state.confirmed]
    marks = list_marks(spans, state.supports, state.hazards)
    return Bundle(
        header=header,
        lines=make_cloud(header, gather_lines(state.confirmed)),
        corridor=make_cloud(header, corridor),
        catenaries=make_cloud(header, make_catenaries(spans)),
        hazards=make_cloud(header, make_hazards(state.hazards)),
        markers=[make_marker(header, mark) for mark in marks],
        news=make_news(state, frame_id, stamp_ns, stream),
    )


class ResultPublishers:
    """
    The publishers of all results.

    Parameters
    ----------
    node : Node
        Owns the publishers.
    stream : Stream
        Gets what is published too.

    """

    def __init__(self, node: Node, stream: Stream) -> None:
        self._stream = stream
        self._clouds = {
            name: node.create_publisher(
                PointCloud2, f'~/{name}', **overridable(RESULTS), **watched(node, name)
            )
            for name in ('lines', 'corridor', 'catenaries', 'hazards')
        }
        self._markers = node.create_publisher(
            MarkerArray, '~/markers', **overridable(RESULTS), **watched(node, 'markers')
        )
        self._seen: set[MarkerKey] = set()

    def publish(self, bundle: Bundle, *, kept: bool = False) -> None:
        """Send all messages of one state; it may be kept of an earlier run of the node."""
        for name, publisher in self._clouds.items():
            publisher.publish(getattr(bundle, name))
        markers, self._seen = add_deletions(bundle.header, bundle.markers, self._seen)
        self._markers.publish(markers)
        self._stream.publish(bundle.news, kept=kept)
