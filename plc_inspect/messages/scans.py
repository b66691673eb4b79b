# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Convert scans to arrays, by attribute only, so messages of rclpy and rosbags both work.

Nothing of ROS is imported here.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.messages.rows import DATATYPES
from plc_inspect.results import Bool, Float32, Float64

SCAN_TYPE = 'sensor_msgs/msg/PointCloud2'

_KINDS = {code: kind for kind, code in DATATYPES.items()}
"""Codes of sensor_msgs/PointField to numpy."""

_TIME_FIELDS = ('time', 't', 'timestamp', 'offset_time', 'time_stamp')
"""Names that drivers give to the time of a point; the first one found is used."""

_WANTED = {'x', 'y', 'z', 'ring', *_TIME_FIELDS}
"""Fields that are read."""

_UNITS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units in which drivers give times [s]."""
LONGEST_SCAN = 1.5
"""Longest plausible scan [s]; the slowest sensors turn at 1 Hz."""
LEAST_REACH, MOST_REACH = 0.01, 1.0
"""
Between these lies the largest time of a whole scan [s]; integers are in the unit that gives it.
Source: spinning lidars turn at 4 to 25 Hz; most of a scan may be cropped.
"""
MOST_POINTS = 3e7
"""Greatest plausible point rate [1/s]; sensors on the market give up to 25 million."""
LEAST_DATE_NS = 32_000_000_000_000_000
"""
Stamps before this are times since a start, not dates [ns].
Source: a year; no computer runs longer without a pause, and no date of use is of 1970.
"""
LEAST_START_NS = 2_000_000_000
"""
Least stamp near which times of points may be since its start [ns]; below, they are relative to it.
Source: derived: longer than LONGEST_SCAN, so that no time relative to a stamp is so large.
"""
MOST_ROUNDING = 1e-3
"""
Greatest step of numbers that can be times of points [s].
Source: derived: 1 cm at 10 m/s, a third of the noise of the sensor.
"""
EPOCH_REACH = 3600.0
"""Greatest difference of epoch times to the stamp [s]; beyond, they are of another clock."""
FARTHEST = 1e6
"""Greatest plausible coordinate [m]; beyond, the bytes are not floats."""
TINIEST = 1e-20
"""Least plausible coordinate other than 0 [m]; below, the bytes are not floats."""
SAMPLE = 256
"""Points whose coordinates are checked."""
MOST_ODD = 0.05
"""Share of implausible coordinates from which a scan is refused; a few are noise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanArrays:
    """One scan; points that are not finite are removed from all arrays."""

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
    """Number of points of the message that were not finite."""
    layout: str
    """Coordinates in the order of their bytes; drivers do not change it."""


def stamp_from_header(header: Any) -> int:
    """
    Return the stamp of a std_msgs/Header in nanoseconds.

    Raises
    ------
    DataError
        It is not set, before 1970, or its nanoseconds exceed a second.

    """
    seconds, nanoseconds = int(header.stamp.sec), int(header.stamp.nanosec)
    if seconds < 0 or nanoseconds >= 1_000_000_000 or not (seconds or nanoseconds):
        raise DataError(f'stamp of {seconds} s and {nanoseconds} ns is not a valid time')
    return seconds * 1_000_000_000 + nanoseconds


def scan_from_message(message: Any) -> ScanArrays:
    """
    Read a sensor_msgs/PointCloud2 of a lidar.

    The layout is taken from ``fields``, ``point_step``, ``row_step`` and ``is_bigendian``:
    organised or not, padded, either byte order.  x, y and z are float32 or float64.  A time field
    is optional: relative to the stamp, in seconds (float), nanoseconds (integer) or the unit in
    which they last as long as a scan; or since the epoch of the stamp, in any of these.

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
        The message is malformed: a field is missing, duplicated, of a wrong type or outside the
        point; the sizes are inconsistent; or the stamp or the coordinates are impossible.

    """
    stamp_ns = stamp_from_header(message.header)
    cells = _view_cells(message)
    _check_names(message)
    if cells is None:
        return ScanArrays(
            stamp_ns=stamp_ns,
            frame_id=message.header.frame_id,
            xyz=np.empty((0, 3), dtype=np.float32),
            time=np.empty(0),
            ring=None,
            num_not_finite=0,
            layout=_read_layout(message),
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
    _check_reach(xyz)
    finite: Bool = np.logical_and.reduce(np.isfinite(xyz), axis=1)
    with np.errstate(over='ignore', invalid='ignore'):  # times need be no numbers either
        time = _read_time(columns, stamp_ns, finite)
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
        layout=_read_layout(message),
    )


def _check_names(message: Any) -> None:
    names = [field.name for field in message.fields if field.name in _WANTED]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f'field {name!r} is there twice')


def _read_layout(message: Any) -> str:
    """Return the names of the coordinates in the order in which they lie in a point."""
    places = {field.offset: field.name for field in message.fields if field.name in tuple('xyz')}
    return ''.join(name for _, name in sorted(places.items()))


def _check_reach(xyz: Float32) -> None:
    """Refuse coordinates that are not floats of this byte order, judged by a sample."""
    some = np.abs(xyz[:: 1 + len(xyz) // SAMPLE])
    tiny, far = (some > 0.0) & (some < TINIEST), (some > FARTHEST) & (some < np.inf)
    odd = int(np.count_nonzero(tiny | far))
    if odd > MOST_ODD * some.size:
        raise DataError(
            f'{odd / some.size:.0%} of the coordinates are beyond {FARTHEST:g} m or below '
            f'{TINIEST:g} m: is the byte order (is_bigendian) wrong, or the type of a field?'
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
    """Return the needed fields as views, after checking that they lie in the point."""
    order = '>' if message.is_bigendian else '<'
    columns: dict[str, NDArray[Any]] = {}
    for field in message.fields:
        if field.name not in _WANTED:
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


def _read_time(
    columns: dict[str, NDArray[Any]], stamp_ns: int, finite: Bool
) -> Float64 | None:
    """Return the times relative to the stamp [s], judged by those of finite points."""
    name = next((name for name in _TIME_FIELDS if name in columns), None)
    if name is None:
        return None
    column = columns[name]
    times = column.astype(np.float64)
    known = times[finite & np.isfinite(times)]
    if not len(known):
        return times
    low, high = float(known.min()), float(known.max())
    largest = max(abs(low), abs(high))
    usual = 1.0 if column.dtype.kind == 'f' else 1e-9
    for unit in _UNITS:
        if not _are_since_epoch(low, high, stamp_ns, unit, usual):
            continue
        rounding = np.spacing(column.dtype.type(largest)) if usual == 1.0 else 1.0
        if rounding * unit > MOST_ROUNDING:
            raise DataError(
                f'field {name!r} is {column.dtype.name} and holds {largest:g}, too large for a '
                'time'
            )
        start = stamp_ns / (unit * 1e9)
        return (times - np.floor(start)) * unit - (start - np.floor(start)) * unit
    if usual != 1.0:
        every = float(np.abs(times).max())  # drivers tell the times of points without return too
        if LEAST_REACH <= every * 1e-9 <= LONGEST_SCAN:
            return times * 1e-9
    return times * _choose_unit(known, high - low, usual == 1.0)


def _are_since_epoch(
    low: float, high: float, stamp_ns: int, unit: float, usual: float
) -> bool:
    """Tell whether times in a unit [s] are since the epoch of the stamp, not relative to it."""
    apart = abs(max(abs(low), abs(high)) * unit - stamp_ns * 1e-9)
    if stamp_ns >= LEAST_DATE_NS:
        return apart <= EPOCH_REACH
    if stamp_ns < LEAST_START_NS or apart > LONGEST_SCAN or low <= 0.5 * high:
        return False
    span = (high - low) * unit
    return span <= LONGEST_SCAN and (high * usual > LONGEST_SCAN or span >= LEAST_REACH)


def _choose_unit(times: Float64, span: float, floating: bool) -> float:
    """Return the unit of (N,) times of finite points relative to the stamp [s]."""
    largest = float(np.abs(times).max())

    def fits(unit: float) -> bool:
        return largest * unit <= LONGEST_SCAN and len(times) <= MOST_POINTS * span * unit

    if floating:
        unit = next((unit for unit in _UNITS if largest * unit <= LONGEST_SCAN), 1.0)
        # a span that could be of a scan in the unit above is of times since another start
        return unit if fits(unit) and span * unit > 1e-3 * LONGEST_SCAN else 1.0
    if LEAST_REACH <= largest * 1e-9 <= LONGEST_SCAN:
        return 1e-9
    for unit in _UNITS:
        if LEAST_REACH <= largest * unit <= MOST_REACH:
            return unit
    if span < 0.5 * largest or fits(1e-9):
        return 1e-9
    return next((unit for unit in _UNITS if fits(unit)), 1e-9)
