# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results to messages: typed rows in PointCloud2, described in docs/interfaces.md."""

import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from plc_inspect.core.live.session import CorridorPoints
from plc_inspect.core.tracking.span_registry import TrackedSpan
from plc_inspect.results import Hazard

_DATATYPES = {
    'i1': PointField.INT8, 'u1': PointField.UINT8, 'i2': PointField.INT16,
    'u2': PointField.UINT16, 'i4': PointField.INT32, 'u4': PointField.UINT32,
    'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64,
}
_XYZ = [('x', '<f4'), ('y', '<f4'), ('z', '<f4')]
_IDS = [('line_id', '<i4'), ('span_id', '<i4')]

LINES = np.dtype([*_XYZ, *_IDS, ('residual', '<f4')])
CORRIDOR = np.dtype([*_XYZ, ('class', 'u1'), ('clearance', '<f4'), *_IDS])
CATENARIES = np.dtype([
    *_XYZ, *_IDS,
    ('start_x', '<f4'), ('start_y', '<f4'), ('start_z', '<f4'),
    ('end_x', '<f4'), ('end_y', '<f4'), ('end_z', '<f4'),
    ('a', '<f4'), ('b', '<f4'), ('c', '<f4'), ('length', '<f4'), ('sag', '<f4'),
    ('rmse', '<f4'), ('sigma_sag', '<f4'), ('coverage', '<f4'), ('num_points', '<u4'),
])
HAZARDS = np.dtype([
    *_XYZ, ('id', '<u4'), *_IDS, ('kind', 'u1'), ('severity', 'u1'), ('clearance', '<f4'),
    ('required', '<f4'), ('horizontal', '<f4'), ('vertical', '<f4'), ('sigma', '<f4'),
    ('along_span', '<f4'), ('num_points', '<u4'),
])


def make_cloud(header: Header, rows: NDArray[Any]) -> PointCloud2:
    """
    Pack rows into a cloud.

    Parameters
    ----------
    header : Header
        Frame and stamp of the data.
    rows : NDArray
        (N,) of a structured dtype, packed, little-endian.

    Returns
    -------
    PointCloud2
        Unorganised.

    """
    message = PointCloud2(
        header=header,
        height=1,
        width=len(rows),
        fields=[
            PointField(
                name=name, offset=offset, datatype=_DATATYPES[dtype.str[1:]], count=1
            )
            for name in rows.dtype.names or ()
            for dtype, offset in (_field(rows.dtype, name),)
        ],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * len(rows),
        is_dense=True,
    )
    message.data = array.array('B', rows.tobytes())
    return message


def read_rows(message: PointCloud2) -> NDArray[Any]:
    """
    Unpack the rows of a cloud that ``make_cloud`` packed.

    Parameters
    ----------
    message : PointCloud2
        Packed, little-endian.

    Returns
    -------
    NDArray
        (N,) structured, a view.

    """
    names = {code: kind for kind, code in _DATATYPES.items()}
    layout = np.dtype([(field.name, '<' + names[field.datatype]) for field in message.fields])
    return np.frombuffer(message.data, dtype=layout)


def make_lines(header: Header, spans: Sequence[TrackedSpan]) -> PointCloud2:
    """Return the wire points of all spans, ordered by line and span."""
    counts = [len(item.points) for item in spans]
    rows = np.empty(sum(counts), dtype=LINES)
    if len(rows):
        _put_xyz(rows, np.concatenate([item.points for item in spans]))
        rows['line_id'] = np.repeat([item.span.line_id for item in spans], counts)
        rows['span_id'] = np.repeat([item.span.span_id for item in spans], counts)
        rows['residual'] = np.concatenate([item.residual for item in spans])
    return make_cloud(header, rows)


def make_corridor(header: Header, corridor: CorridorPoints) -> PointCloud2:
    """Return the points of the corridor about the vehicle."""
    rows = np.empty(len(corridor.points), dtype=CORRIDOR)
    _put_xyz(rows, corridor.points)
    rows['class'] = corridor.classification
    for name in ('clearance', 'line_id', 'span_id'):
        rows[name] = getattr(corridor, name)
    return make_cloud(header, rows)


def make_catenaries(header: Header, spans: Sequence[TrackedSpan]) -> PointCloud2:
    """Return one row for each span."""
    rows = np.empty(len(spans), dtype=CATENARIES)
    for row, item in zip(rows, spans, strict=True):
        span = item.span
        for name in ('line_id', 'span_id', 'a', 'b', 'c', 'length', 'sag', 'rmse', 'coverage',
                     'num_points'):
            row[name] = getattr(span, name)
        row['sigma_sag'] = span.sigma['sag']
        for prefix, place in (('', span.lowest), ('start_', span.start), ('end_', span.end)):
            for axis, value in zip('xyz', place, strict=True):
                row[prefix + axis] = value
    return make_cloud(header, rows)


def make_hazards(header: Header, hazards: Sequence[Hazard]) -> PointCloud2:
    """Return one row for each hazard."""
    rows = np.empty(len(hazards), dtype=HAZARDS)
    for row, hazard in zip(rows, hazards, strict=True):
        row['id'] = hazard.hazard_id
        for name in HAZARDS.names or ():
            if name not in ('x', 'y', 'z', 'id'):
                row[name] = getattr(hazard, name)
        for axis, value in zip('xyz', hazard.position, strict=True):
            row[axis] = value
    return make_cloud(header, rows)


def _field(layout: np.dtype[Any], name: str) -> tuple[np.dtype[Any], int]:
    """Type and offset of a field."""
    dtype, offset, *_ = layout.fields[name]  # type: ignore[index]
    return dtype, offset


def _put_xyz(rows: NDArray[Any], points: NDArray[np.float64]) -> None:
    for axis, name in enumerate('xyz'):
        rows[name] = points[:, axis]
