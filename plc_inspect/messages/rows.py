# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results as typed rows of a PointCloud2, described in docs/interfaces.md; no ROS is imported."""

from collections.abc import Sequence
import math
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plc_inspect.messages.items import HazardLike, number_kind, ORIGIN, Place, SpanLike

if TYPE_CHECKING:
    from plc_inspect.core.live.proximity import Proximity
    from plc_inspect.core.tracking.tracked_span import TrackedSpan

DATATYPES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}
"""Types of numpy to codes of sensor_msgs/PointField."""

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
    ('evidence', '<f4'),
])
HAZARDS = np.dtype([
    *_XYZ, ('id', '<u4'), *_IDS, ('kind', 'u1'), ('severity', 'u1'), ('clearance', '<f4'),
    ('required', '<f4'), ('horizontal', '<f4'), ('vertical', '<f4'), ('sigma', '<f4'),
    ('along_span', '<f4'), ('num_points', '<u4'), ('confidence', '<f4'),
])
PROXIMITY = np.dtype([
    *_XYZ, ('thing', 'u1'), ('level', 'u1'), ('distance', '<f4'), ('direction_x', '<f4'),
    ('direction_y', '<f4'), ('direction_z', '<f4'), ('closest', '<f4'), ('closest_in', '<f4'),
    ('sigma', '<f4'), *_IDS, ('extended', 'u1'),
])


def make_lines(
    points: NDArray[Any], *, line_id: Any, span_id: Any, residual: Any
) -> NDArray[Any]:
    """
    Return the rows of wire points.

    Parameters
    ----------
    points : (N, 3) float64
        Wire points [m].
    line_id, span_id, residual : (N,)
        As `InspectionResult` has them.

    Returns
    -------
    (N,) LINES

    """
    rows = np.empty(len(points), dtype=LINES)
    _put_points(rows, points)
    rows['line_id'], rows['span_id'], rows['residual'] = line_id, span_id, residual
    return rows


def gather_lines(spans: 'Sequence[TrackedSpan]') -> NDArray[Any]:
    """Return the rows (N,) LINES of the wire points of all spans, one span after the other."""
    counts = np.array([len(item.points) for item in spans], dtype=np.int64)
    keys = np.array([item.key for item in spans], dtype=np.int32).reshape(-1, 2)
    return make_lines(
        np.concatenate([np.empty((0, 3)), *(item.points for item in spans)]),
        line_id=np.repeat(keys[:, 0], counts),
        span_id=np.repeat(keys[:, 1], counts),
        residual=np.concatenate([np.empty(0, np.float32), *(item.residual for item in spans)]),
    )


def make_corridor(
    points: NDArray[Any], *, classification: Any, clearance: Any, line_id: Any, span_id: Any
) -> NDArray[Any]:
    """
    Return the rows of points of the corridor.

    Parameters
    ----------
    points : (N, 3) float
        [m].
    classification, clearance, line_id, span_id : (N,), or one number for all
        PointClass, distance to the nearest conductor [m], that conductor and span.

    Returns
    -------
    (N,) CORRIDOR

    """
    rows = np.empty(len(points), dtype=CORRIDOR)
    _put_points(rows, points)
    rows['class'], rows['clearance'] = classification, clearance
    rows['line_id'], rows['span_id'] = line_id, span_id
    return rows


def make_catenaries(spans: Sequence[SpanLike], origin: Place = ORIGIN) -> NDArray[Any]:
    """
    Return one row for each span.

    Parameters
    ----------
    spans : sequence of SpanLike
        Results, or items of a monitor.
    origin : (3,) float
        Origin of the coordinates of the rows [m].

    Returns
    -------
    (N,) CATENARIES

    """
    rows = np.empty(len(spans), dtype=CATENARIES)
    for row, span in zip(rows, spans, strict=True):
        for name in ('line_id', 'span_id', 'b', 'c', 'length', 'sag', 'rmse', 'sigma_sag',
                     'coverage', 'num_points'):
            row[name] = getattr(span, name)
        row['a'] = span.a - origin[2]
        row['evidence'] = getattr(span, 'evidence', math.nan)  # the thin link has none
        _put_place(row, span.lowest, origin)
        _put_place(row, span.start, origin, 'start_')
        _put_place(row, span.end, origin, 'end_')
    return rows


def make_hazards(hazards: Sequence[HazardLike], origin: Place = ORIGIN) -> NDArray[Any]:
    """
    Return one row for each hazard.

    Parameters
    ----------
    hazards : sequence of HazardLike
        Results, or items of a monitor.
    origin : (3,) float
        Origin of the coordinates of the rows [m].

    Returns
    -------
    (N,) HAZARDS

    """
    rows = np.empty(len(hazards), dtype=HAZARDS)
    for row, hazard in zip(rows, hazards, strict=True):
        row['id'], row['kind'] = hazard.hazard_id, number_kind(hazard.kind)
        for name in ('line_id', 'span_id', 'severity', 'required', 'horizontal', 'vertical',
                     'sigma', 'along_span', 'num_points', 'confidence'):
            row[name] = getattr(hazard, name)
        row['clearance'] = hazard.measured
        _put_place(row, hazard.position, origin)
    return rows


def make_proximity(found: 'Sequence[Proximity]', vehicle: Place) -> NDArray[Any]:
    """
    Return one row for each kind of object near the vehicle.

    Parameters
    ----------
    found : sequence of Proximity
        As from ``measure_proximity``.
    vehicle : (3,) float
        Position of the vehicle in the map frame [m].

    Returns
    -------
    (N,) PROXIMITY

    """
    rows = np.empty(len(found), dtype=PROXIMITY)
    for row, item in zip(rows, found, strict=True):
        for name in ('thing', 'level', 'distance', 'closest', 'closest_in', 'sigma', 'line_id',
                     'span_id', 'extended'):
            row[name] = getattr(item, name)
        _put_place(row, item.position, ORIGIN)
        _put_place(row, (item.position - vehicle) / item.distance, ORIGIN, 'direction_')
    return rows


def list_fields(layout: np.dtype[Any]) -> list[tuple[str, int, int]]:
    """Return name, offset and datatype code of each field, as in PointField."""
    fields: Any = layout.fields or {}
    return [
        (name, offset, DATATYPES[kind.str[1:]]) for name, (kind, offset, *_) in fields.items()
    ]


def read_rows(message: Any) -> NDArray[Any]:
    """
    View the rows of a packed little-endian cloud, as this package publishes.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
        Of rclpy or rosbags.

    Returns
    -------
    (N,) structured
        A view.

    """
    names = {code: kind for kind, code in DATATYPES.items()}
    layout = np.dtype([(field.name, '<' + names[field.datatype]) for field in message.fields])
    return np.frombuffer(message.data, dtype=layout)


def _put_points(rows: NDArray[Any], points: NDArray[Any]) -> None:
    for axis, name in enumerate('xyz'):
        rows[name] = points[:, axis]


def _put_place(row: Any, place: Place, origin: Place, prefix: str = '') -> None:
    for axis, value, shift in zip('xyz', place, origin, strict=True):
        row[prefix + axis] = value - shift
