# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``results.mcap``: a run on the node's topics, for playback in Foxglove or RViz."""

from pathlib import Path
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from plc_inspect.messages.markers import list_marks
from plc_inspect.messages.rows import make_catenaries, make_corridor, make_hazards, make_lines
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.results import Float64

FILE = 'results.mcap'
NODE = '/plc_inspect'
LOCAL_FRAME = 'plc_local'
"""Frame of the messages if the coordinates are too large for float32."""
LARGEST = 1e4
MOST_POINTS = 1_000_000
"""Most points of the corridor; more are thinned."""


def write_playback(path: Path, inspection: Inspection) -> None:
    """
    Write one message on each of the node's result topics.

    Coordinates are metres in the frame of the odometry.  Where they are too large for float32, as
    in a projected CRS, they are relative to a frame ``plc_local`` that ``/tf_static`` places.

    Parameters
    ----------
    path : Path
        A file that does not exist yet.
    inspection : Inspection
        The run.

    """
    frame = inspection.frame_id or 'map'
    result = inspection.result
    origin = _choose_origin(inspection)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix='.playback.') as room:
        bag = Path(room, 'bag')
        writer = Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            sink = _Sink(writer, LOCAL_FRAME if origin.any() else frame)
            if origin.any():
                sink.place(frame, origin)
            wire = np.flatnonzero(result.line_id >= 0)
            sink.write_rows('lines', make_lines(
                inspection.points[wire] - origin, line_id=result.line_id[wire],
                span_id=result.span_id[wire], residual=result.residual[wire],
            ))
            rank = np.arange(0, len(result.corridor), 1 + len(result.corridor) // MOST_POINTS)
            near = result.corridor[rank]
            sink.write_rows('corridor', make_corridor(
                inspection.points[near] - origin, classification=result.classification[near],
                clearance=result.clearance[near], line_id=result.corridor_line_id[rank],
                span_id=result.corridor_span_id[rank],
            ))
            sink.write_rows('catenaries', make_catenaries(result.spans, origin))
            sink.write_rows('hazards', make_hazards(result.hazards, origin))
            markers = [
                sink.maker.marker(sink.header, mark)
                for mark in list_marks(result.spans, result.supports, result.hazards, origin)
            ]
            kind = 'visualization_msgs/msg/MarkerArray'
            sink.write('markers', kind, sink.maker.make(kind, markers=markers))
        (found,) = bag.glob('*.mcap')
        found.rename(path)


def _choose_origin(inspection: Inspection) -> Float64:
    ends = [end for span in inspection.result.spans for end in (span.start, span.end)]
    if not ends or np.abs(ends).max() < LARGEST:
        return np.zeros(3)
    return np.floor(np.min(ends, axis=0) / 1000.0) * 1000.0 * np.array([1.0, 1.0, 0.0])


class _Sink:
    """Writes messages into an open bag, all at one time and in one frame."""

    def __init__(self, writer: Writer, frame: str) -> None:
        """Take an open bag and the frame of everything that is written."""
        self._writer, self.frame = writer, frame
        self.maker = MessageMaker()
        self.header = self.maker.header(0, frame)  # results belong to no single moment

    def write(self, topic: str, kind: str, message: Any) -> None:
        """Write a message on a topic, those of the node by their short name."""
        name = topic if topic.startswith('/') else f'{NODE}/{topic}'
        connection = self._writer.add_connection(name, kind, typestore=self.maker.store)
        self._writer.write(connection, 0, self.maker.serialize(message, kind))

    def write_rows(self, topic: str, rows: NDArray[Any]) -> None:
        """Write rows as a PointCloud2."""
        self.write(topic, 'sensor_msgs/msg/PointCloud2', self.maker.cloud(self.header, rows))

    def place(self, parent: str, origin: Float64) -> None:
        """Write the transform of the local frame."""
        make = self.maker.make
        transform = make(
            'geometry_msgs/msg/Transform', translation=self.maker.vector('Vector3', origin),
            rotation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
        )
        stamped = make(
            'geometry_msgs/msg/TransformStamped', header=self.maker.header(0, parent),
            child_frame_id=self.frame, transform=transform,
        )
        self.write(
            '/tf_static', 'tf2_msgs/msg/TFMessage',
            make('tf2_msgs/msg/TFMessage', transforms=[stamped]),
        )
