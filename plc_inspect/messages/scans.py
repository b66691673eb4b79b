# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
ROS messages to arrays, by attribute only: messages of rclpy and of rosbags serve alike.

Nothing of ROS is imported here.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.messages.rows import DATATYPES
from plc_inspect.results import Bool, Float32, Float64

_KINDS = {code: kind for kind, code in DATATYPES.items()}
"""Codes of sensor_msgs/PointField to numpy."""

_TIME_FIELDS = ('time', 't', 'timestamp', 'offset_time', 'time_stamp')
"""Names that drivers give to the time of a point, the first that is there counts."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanArrays:
    """One scan; points that are not finite are gone from all arrays together."""

    stamp_ns: int
    """Header stamp [ns]."""
    frame_id: str
    xyz: Float32
    """(N, 3) points in ``frame_id`` [m]."""
    time: Float64 | None
    """(N,) time of each point relative to the stamp [s], None if the message has none."""
    ring: NDArray[np.uint16] | None
    """(N,) beam of each point, None if the message has none."""
    num_not_finite: int
    """Points of the message that were not finite."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedPose:
    """One pose of the vehicle; its values are not checked yet."""

    stamp_ns: int
    """Header stamp [ns]."""
    frame_id: str
    """Frame of the position and orientation."""
    child_frame_id: str
    """Frame of the vehicle's base."""
    position: Float64
    """(3,) [m]."""
    quaternion: Float64
    """(4,) x y z w."""


def stamp_from_header(header: Any) -> int:
    """Return the stamp of a std_msgs/Header in nanoseconds."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def pose_from_message(message: Any) -> StampedPose:
    """
    Read a nav_msgs/Odometry.

    Parameters
    ----------
    message : nav_msgs/Odometry
        Of rclpy or rosbags.

    Returns
    -------
    StampedPose
        Stamp, frames and pose.

    """
    position = message.pose.pose.position
    orientation = message.pose.pose.orientation
    return StampedPose(
        stamp_ns=stamp_from_header(message.header),
        frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
        position=np.array([position.x, position.y, position.z], dtype=np.float64),
        quaternion=np.array(
            [orientation.x, orientation.y, orientation.z, orientation.w], dtype=np.float64
        ),
    )


def scan_from_message(message: Any) -> ScanArrays:
    """
    Read a sensor_msgs/PointCloud2 of a lidar.

    The layout is taken from ``fields``, ``point_step``, ``row_step`` and ``is_bigendian``:
    organised or not, padded, either byte order.  x, y and z are float32 or float64.  A time
    field is optional: ``time`` in seconds (float) or nanoseconds (integer), relative to the
    stamp; floats beyond a year are seconds or nanoseconds since the epoch of the stamp.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
        Of rclpy or rosbags.

    Returns
    -------
    ScanArrays
        The points that are finite, with their times and rings.

    Raises
    ------
    DataError
        The message is malformed: a field is missing, of a wrong type or outside the point, or
        the sizes contradict one another.

    """
    stamp_ns = stamp_from_header(message.header)
    cells = _view_cells(message)
    if cells is None:
        return ScanArrays(
            stamp_ns=stamp_ns,
            frame_id=message.header.frame_id,
            xyz=np.empty((0, 3), dtype=np.float32),
            time=np.empty(0),
            ring=None,
            num_not_finite=0,
        )
    columns = _view_columns(message, cells)
    for name in 'xyz':
        if name not in columns:
            raise DataError(f'cloud has no field {name!r}, only {_list_fields(message)}')
        if columns[name].dtype.kind != 'f':
            raise DataError(f'field {name!r} is {columns[name].dtype.name}, not a float')
    xyz = np.empty((len(columns['x']), 3), dtype=np.float32)
    # A value beyond float32 becomes infinite and goes with the other points that are not finite.
    with np.errstate(over='ignore', invalid='ignore'):
        for axis, name in enumerate('xyz'):
            xyz[:, axis] = columns[name]
    finite: Bool = np.logical_and.reduce(np.isfinite(xyz), axis=1)
    time = _read_time(columns, stamp_ns)
    ring = columns.get('ring')
    if ring is not None and ring.dtype.kind == 'f':
        ring = None
    num_not_finite = len(finite) - int(np.count_nonzero(finite))
    if num_not_finite:
        xyz = xyz[finite]
        time = None if time is None else time[finite]
        ring = None if ring is None else ring[finite]
    return ScanArrays(
        stamp_ns=stamp_ns,
        frame_id=message.header.frame_id,
        xyz=xyz,
        time=time,
        ring=None if ring is None else ring.astype(np.uint16),
        num_not_finite=num_not_finite,
    )


def _list_fields(message: Any) -> str:
    return ', '.join(field.name for field in message.fields) or 'none'


def _view_cells(message: Any) -> NDArray[np.uint8] | None:
    """Return the points as (N, point_step) bytes after checking all sizes, None if no points."""
    width, height = int(message.width), int(message.height)
    point_step, row_step = int(message.point_step), int(message.row_step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if width == 0 or height == 0:
        if len(data):
            raise DataError(f'cloud of {width} x {height} points holds {len(data)} bytes')
        return None
    if point_step == 0 or row_step < width * point_step:
        raise DataError(
            f'row_step {row_step} is too small for {width} points of {point_step} bytes'
        )
    if len(data) != row_step * height:
        raise DataError(
            f'cloud of {height} rows of {row_step} bytes holds {len(data)} bytes, '
            f'not {row_step * height}'
        )
    rows = data.reshape(height, row_step)[:, : width * point_step]
    return rows.reshape(height * width, point_step)


def _view_columns(message: Any, cells: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    """Return the fields that matter as views, after checking that they lie in the point."""
    order = '>' if message.is_bigendian else '<'
    wanted = {'x', 'y', 'z', 'ring', *_TIME_FIELDS}
    columns: dict[str, NDArray[Any]] = {}
    for field in message.fields:
        if field.name not in wanted:
            continue
        if field.datatype not in _KINDS or field.count not in (0, 1):
            raise DataError(
                f'field {field.name!r} has datatype {field.datatype} and count {field.count}'
            )
        dtype = np.dtype(order + _KINDS[field.datatype])
        if field.offset + dtype.itemsize > cells.shape[1]:
            raise DataError(
                f'field {field.name!r} ends at byte {field.offset + dtype.itemsize} '
                f'of points of {cells.shape[1]} bytes'
            )
        layout = np.dtype(
            {
                'names': ['value'],
                'formats': [dtype],
                'offsets': [field.offset],
                'itemsize': cells.shape[1],
            }
        )
        columns[field.name] = cells.view(layout)[:, 0]['value']
    return columns


def _read_time(columns: dict[str, NDArray[Any]], stamp_ns: int) -> Float64 | None:
    """Return the times relative to the stamp [s], whatever the driver's convention."""
    name = next((name for name in _TIME_FIELDS if name in columns), None)
    if name is None:
        return None
    column = columns[name]
    if column.dtype.kind != 'f':
        return column.astype(np.float64) * 1e-9
    times = column.astype(np.float64)
    known = times[np.isfinite(times)]
    largest = float(np.abs(known).max()) if len(known) else 0.0
    if largest < 3.2e7:
        return times
    if column.dtype.itemsize == 4:
        raise DataError(f'field {name!r} is float32 and holds {largest:g}, too large for a time')
    if largest > 3.2e16:
        return (times - stamp_ns) * 1e-9
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return (times - seconds) - nanoseconds * 1e-9
