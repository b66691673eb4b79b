# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``results.mcap``: a run as the node's topics, to be played back in Foxglove or RViz."""

from pathlib import Path
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import get_typestore, Stores

from plc_inspect.colors import line_color, SEVERITY_COLORS
from plc_inspect.offline.records.inspection import describe_span, Inspection, Units
from plc_inspect.offline.records.span_curve import trace_span
from plc_inspect.results import Float64, Hazard, Severity

FILE = 'results.mcap'
NODE = '/plc_inspect'
LOCAL_FRAME = 'plc_local'
"""Frame of the messages where the coordinates are too large for float32."""
LARGEST = 1e4
MOST_POINTS = 1_000_000
"""A corridor of more points is thinned out."""
_XYZ = [('x', '<f4'), ('y', '<f4'), ('z', '<f4')]
_IDS = [('line_id', '<i4'), ('span_id', '<i4')]
LAYOUTS = {
    'lines': np.dtype([*_XYZ, *_IDS, ('residual', '<f4')]),
    'corridor': np.dtype([*_XYZ, ('class', 'u1'), ('clearance', '<f4'), *_IDS]),
    'catenaries': np.dtype([
        *_XYZ, *_IDS,
        *((f'{end}_{axis}', '<f4') for end in ('start', 'end') for axis in 'xyz'),
        *((name, '<f4') for name in ('a', 'b', 'c', 'length', 'sag', 'rmse', 'sigma_sag',
                                     'coverage')),
        ('num_points', '<u4'),
    ]),
    'hazards': np.dtype([
        *_XYZ, ('id', '<u4'), *_IDS, ('kind', 'u1'), ('severity', 'u1'),
        *((name, '<f4') for name in ('clearance', 'required', 'horizontal', 'vertical', 'sigma',
                                     'along_span')),
        ('num_points', '<u4'),
    ]),
}
"""Rows of the clouds; the node's messages have the same."""
_DATATYPES = {'u1': 2, 'i4': 5, 'u4': 6, 'f4': 7}
STORE = get_typestore(Stores.ROS2_JAZZY)

_LINE_STRIP, _SPHERE, _CYLINDER, _TEXT = 4, 2, 3, 9


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
            sink.write_rows('lines', _make_rows(
                'lines', inspection.points[wire] - origin, line_id=result.line_id[wire],
                span_id=result.span_id[wire], residual=result.residual[wire],
            ))
            rank = np.arange(0, len(result.corridor), 1 + len(result.corridor) // MOST_POINTS)
            near = result.corridor[rank]
            rows = _make_rows(
                'corridor', inspection.points[near] - origin, clearance=result.clearance[near],
                line_id=result.corridor_line_id[rank], span_id=result.corridor_span_id[rank],
            )
            rows['class'] = result.classification[near]
            sink.write_rows('corridor', rows)
            sink.write_rows('catenaries', _make_catenaries(inspection, origin))
            sink.write_rows('hazards', _make_hazards(result.hazards, origin))
            sink.write('markers', 'visualization_msgs/msg/MarkerArray',
                       markers=_make_markers(sink, inspection, origin))
        (found,) = bag.glob('*.mcap')
        found.rename(path)


def _choose_origin(inspection: Inspection) -> Float64:
    ends = [end for span in inspection.result.spans for end in (span.start, span.end)]
    if not ends or np.abs(ends).max() < LARGEST:
        return np.zeros(3)
    return np.floor(np.min(ends, axis=0) / 1000.0) * 1000.0 * np.array([1.0, 1.0, 0.0])


def _make_rows(layout: str, points: Float64, **columns: Any) -> NDArray[Any]:
    rows = np.zeros(len(points), dtype=LAYOUTS[layout])
    for axis, values in zip('xyz', points.T, strict=True):
        rows[axis] = values
    for name, values in columns.items():
        rows[name] = values
    return rows


def _make_catenaries(inspection: Inspection, origin: Float64) -> NDArray[Any]:
    spans = inspection.result.spans
    rows = np.zeros(len(spans), dtype=LAYOUTS['catenaries'])
    for row, span in zip(rows, spans, strict=True):
        for name in ('line_id', 'span_id', 'b', 'c', 'length', 'sag', 'rmse', 'coverage',
                     'num_points'):
            row[name] = getattr(span, name)
        row['a'], row['sigma_sag'] = span.a - origin[2], span.sigma['sag']
        for prefix, place in (('', span.lowest), ('start_', span.start), ('end_', span.end)):
            for axis, value in zip('xyz', place - origin, strict=True):
                row[prefix + axis] = value
    return rows


def _make_hazards(hazards: tuple[Hazard, ...], origin: Float64) -> NDArray[Any]:
    rows = np.zeros(len(hazards), dtype=LAYOUTS['hazards'])
    for row, hazard in zip(rows, hazards, strict=True):
        row['id'] = hazard.hazard_id
        for name in rows.dtype.names or ():
            if name not in ('x', 'y', 'z', 'id'):
                row[name] = getattr(hazard, name)
        for axis, value in zip('xyz', hazard.position - origin, strict=True):
            row[axis] = value
    return rows


class _Sink:
    """Writes messages into an open bag, all at one time and in one frame."""

    def __init__(self, writer: Writer, frame: str) -> None:
        """Take an open bag and the frame of everything that is written."""
        self.writer, self.frame = writer, frame
        self.store = STORE

    def make(self, kind: str, **values: Any) -> Any:
        """Make a message."""
        return self.store.types[kind](**values)

    def head(self, frame: str = '') -> Any:
        """Make a header with time 0: results belong to no single moment."""
        stamp = self.make('builtin_interfaces/msg/Time', sec=0, nanosec=0)
        return self.make('std_msgs/msg/Header', stamp=stamp, frame_id=frame or self.frame)

    def vector(self, kind: str, values: Any) -> Any:
        """Make a Point or a Vector3."""
        x, y, z = (float(value) for value in values)
        return self.make(f'geometry_msgs/msg/{kind}', x=x, y=y, z=z)

    def write(self, topic: str, kind: str, **values: Any) -> None:
        """Write a message on a topic, those of the node by their short name."""
        name = topic if topic.startswith('/') else f'{NODE}/{topic}'
        connection = self.writer.add_connection(name, kind, typestore=self.store)
        data = self.store.serialize_cdr(self.make(kind, **values), kind)
        self.writer.write(connection, 0, data)

    def write_rows(self, topic: str, rows: NDArray[Any]) -> None:
        """Write rows as a PointCloud2."""
        fields = [
            self.make('sensor_msgs/msg/PointField', name=name, count=1,
                      offset=rows.dtype.fields[name][1],
                      datatype=_DATATYPES[rows.dtype.fields[name][0].str[1:]])
            for name in rows.dtype.names or () if rows.dtype.fields is not None
        ]
        self.write(
            topic, 'sensor_msgs/msg/PointCloud2', header=self.head(), height=1, width=len(rows),
            fields=fields, is_bigendian=False, point_step=rows.dtype.itemsize,
            row_step=rows.dtype.itemsize * len(rows),
            data=np.frombuffer(rows.tobytes(), dtype=np.uint8), is_dense=True,
        )

    def place(self, parent: str, origin: Float64) -> None:
        """Say where the local frame is."""
        transform = self.make(
            'geometry_msgs/msg/Transform', translation=self.vector('Vector3', origin),
            rotation=self.make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
        )
        self.write('/tf_static', 'tf2_msgs/msg/TFMessage', transforms=[
            self.make('geometry_msgs/msg/TransformStamped', header=self.head(parent),
                      child_frame_id=self.frame, transform=transform),
        ])

    def mark(
        self, name: str, number: int, kind: int, place: Any, scale: Any, color: str,
        points: Any = (), text: str = '',
    ) -> Any:
        """Make a marker."""
        red, green, blue = (int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
        pose = self.make(
            'geometry_msgs/msg/Pose', position=self.vector('Point', place),
            orientation=self.make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
        )
        stamp = self.make('builtin_interfaces/msg/Time', sec=0, nanosec=0)
        empty = np.zeros(0, dtype=np.uint8)
        return self.make(
            'visualization_msgs/msg/Marker', header=self.head(), ns=name, id=number, type=kind,
            action=0, pose=pose, scale=self.vector('Vector3', scale),
            color=self.make('std_msgs/msg/ColorRGBA', r=red, g=green, b=blue, a=1.0),
            lifetime=self.make('builtin_interfaces/msg/Duration', sec=0, nanosec=0),
            frame_locked=False, points=[self.vector('Point', point) for point in points],
            colors=[], texture_resource='',
            texture=self.make('sensor_msgs/msg/CompressedImage',
                              header=self.make('std_msgs/msg/Header', stamp=stamp, frame_id=''),
                              format='', data=empty),
            uv_coordinates=[], text=text, mesh_resource='',
            mesh_file=self.make('visualization_msgs/msg/MeshFile', filename='', data=empty),
            mesh_use_embedded_materials=False,
        )


def _make_markers(sink: _Sink, inspection: Inspection, origin: Float64) -> list[Any]:
    result, here = inspection.result, (0.0, 0.0, 0.0)
    markers, lift = [], np.array([0.0, 0.0, 1.5])
    for number, span in enumerate(result.spans):
        curve = trace_span(describe_span(span, Units()), 5.0) - origin
        markers.append(sink.mark('catenaries', number, _LINE_STRIP, here, (0.12, 0.0, 0.0),
                                 line_color(span.line_id), curve))
    for support in result.supports:
        foot = support.position - origin + np.array([0.0, 0.0, support.height / 2])
        markers.append(sink.mark('supports', support.support_id, _CYLINDER, foot,
                                 (0.5, 0.5, max(support.height, 0.1)), '#999aa5'))
    for hazard in result.hazards:
        color = SEVERITY_COLORS[Severity(hazard.severity).name.lower()]
        place = hazard.position - origin
        text = f'{hazard.kind.name.lower()} {hazard.clearance:.2f} m (of {hazard.required:.2f} m)'
        markers.append(sink.mark('hazards', hazard.hazard_id, _SPHERE, place, (1.2,) * 3, color))
        markers.append(sink.mark('hazard_texts', hazard.hazard_id, _TEXT, place + lift,
                                 (0.0, 0.0, 1.2), '#ffffff', text=text))
    return markers
