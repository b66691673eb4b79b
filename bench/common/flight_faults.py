# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What can be wrong with a flight: changes to its messages, before they are sent."""

from array import array
from collections.abc import Callable
import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

UTM = 500_000.0, 5_800_000.0, 40.0
"""Where ``move_to_utm`` goes [m]."""


@dataclass(eq=False)
class Event:
    """A message, when it is sent [s]."""

    time: float
    kind: str
    message: Any


def each(kind: str, change: Callable[[Any], None], after: float = 0.0) -> Callable[..., Any]:
    """Return a fault that changes every message of a kind from some time on."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.kind == kind and event.time >= after:
                change(event.message)
        return events

    return run


def view_rows(message: Any) -> np.ndarray:
    """Return a copy of the points of a cloud as (N, point_step) bytes."""
    return np.frombuffer(message.data, np.uint8).reshape(-1, message.point_step).copy()


def shift_stamp(message: Any, seconds: float) -> None:
    """Add to a stamp."""
    stamp = message.header.stamp
    total = stamp.sec * 10**9 + stamp.nanosec + round(seconds * 1e9)
    stamp.sec, stamp.nanosec = divmod(total, 10**9)


def add_to(message: Any, name: str, change: Callable[[np.ndarray], np.ndarray],
           kind: str = '<f4') -> None:
    """Change one field of all points, to another type of four bytes if wanted."""
    rows = view_rows(message)
    (place,) = (item for item in message.fields if item.name == name)
    cells = rows[:, place.offset : place.offset + 4]
    values = change(np.ascontiguousarray(cells).view('<f4')[:, 0]).astype(kind)
    rows[:, place.offset : place.offset + 4] = values.view(np.uint8).reshape(-1, 4)
    message.data = array('B', rows.tobytes())


def copy_scans(
    late: float, change: Callable[[Any], None], kind: str = 'scan'
) -> Callable[..., Any]:
    """Return a fault that sends each scan once more, changed, so much later [s]."""
    def run(events: list[Event]) -> list[Event]:
        more = []
        for event in events:
            if event.kind == 'scan':
                more.append(Event(event.time + late, kind, copy.deepcopy(event.message)))
                change(more[-1].message)
        return sorted(events + more, key=lambda event: event.time)

    return run


def lower(message: Any) -> None:
    """Let a scan be of a second lidar, 2 m lower and half a period later."""
    shift_stamp(message, 0.05)
    add_to(message, 'z', lambda z: z + np.float32(2.0))


def swap(message: Any) -> None:
    """Swap the names of x and y."""
    message.fields[0].name, message.fields[1].name = 'y', 'x'


def lengthen_row(message: Any) -> None:
    """Contradict the length of the data."""
    message.row_step += 7


def turn_bytes(message: Any) -> None:
    """Give the other byte order."""
    message.is_bigendian = True


def clear_stamp(message: Any) -> None:
    """Unset the stamp."""
    message.header.stamp.sec = message.header.stamp.nanosec = 0


def count_microseconds(message: Any) -> None:
    """Give times as whole microseconds since the first point, which the stamp is of."""
    (place,) = (item for item in message.fields if item.name == 'time')
    first: list[float] = []

    def change(times: np.ndarray) -> np.ndarray:
        first.append(float(times.min()))
        return np.round((times.astype(np.float64) - first[0]) * 1e6)

    add_to(message, 'time', change, '<u4')
    place.datatype = 6
    shift_stamp(message, first[0])


def crowd_stamps(events: list[Event]) -> list[Event]:
    """Let the stamps of all scans be a microsecond apart from the third second on."""
    for number, event in enumerate(item for item in events if item.kind == 'scan'):
        if event.time > 3.0:
            shift_stamp(event.message, -(number - 30) * (0.1 - 1e-6))
    return events


def thin_odometry(events: list[Event]) -> list[Event]:
    """Keep 3 poses a second."""
    poses = [event for event in events if event.kind == 'odometry']
    return [event for event in events if event.kind == 'scan' or event in poses[::17]]


def move_to_utm(events: list[Event]) -> list[Event]:
    """Begin at the origin, and be in UTM coordinates after two seconds."""
    for event in events:
        if event.kind == 'odometry':
            place = event.message.pose.pose.position
            if event.time < 2.0:
                place.x, place.y, place.z = 0.0, 0.0, 0.0
            else:
                place.x, place.y, place.z = place.x + UTM[0], place.y + UTM[1], place.z + UTM[2]
    return events


def place_scans(events: list[Event]) -> list[Event]:
    """Send the scans as a mapper does: deskewed, in the frame of the odometry."""
    poses = [event.message for event in events if event.kind == 'odometry']
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in poses])
    turn = Slerp((stamps - stamps[0]) * 1e-9, Rotation.from_quat([
        [getattr(m.pose.pose.orientation, axis) for axis in 'xyzw'] for m in poses
    ]))
    places = np.array([[getattr(m.pose.pose.position, axis) for axis in 'xyz'] for m in poses])
    for event in events:
        if event.kind != 'scan':
            continue
        message, rows = event.message, view_rows(event.message)
        layout = {item.name: item.offset for item in message.fields}
        read = {name: np.ascontiguousarray(rows[:, at : at + 4]).view('<f4')[:, 0]
                for name, at in layout.items() if name in ('x', 'y', 'z', 'time')}
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        when = (stamp - stamps[0]) * 1e-9 + read['time'].astype(np.float64)
        when = np.clip(when, 0.0, (stamps[-1] - stamps[0]) * 1e-9)
        xyz = turn(when).apply(np.column_stack([read[axis] for axis in 'xyz']))
        xyz += np.column_stack([
            np.interp(when, (stamps - stamps[0]) * 1e-9, column) for column in places.T
        ])
        for axis, column in zip('xyz', xyz.T.astype('<f4'), strict=True):
            at = layout[axis]
            rows[:, at : at + 4] = np.ascontiguousarray(column).view(np.uint8).reshape(-1, 4)
        message.data = array('B', rows.tobytes())
        message.header.frame_id = poses[0].header.frame_id
    return events
