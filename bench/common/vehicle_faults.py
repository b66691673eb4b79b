# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of vehicles that are put together wrongly, or restart what they are made of in flight."""

from array import array
from collections.abc import Callable
import copy
from typing import Any

from common.flight_faults import add_to, each, Event, shift_stamp, UTM, view_rows
from common.odometry_changes import HALF
import numpy as np
from scipy.spatial.transform import Rotation

Change = Callable[[list[Event]], list[Event]]


def shift_more(kind: str, rate: float) -> Change:
    """Return a fault that shifts stamps by more and more, as of a clock that runs fast [s/s]."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.kind == kind:
                shift_stamp(event.message, rate * event.time)
        return events

    return run


def jitter(seconds: float) -> Change:
    """Return a fault that stamps scans when they come, early or late by so much [s]."""

    def run(events: list[Event]) -> list[Event]:
        rng = np.random.default_rng(5)
        for event in events:
            if event.kind == 'scan':
                shift_stamp(event.message, float(rng.uniform(-seconds, seconds)))
        return events

    return run


def turn_poses(change: Callable[[float, np.ndarray, np.ndarray], tuple[Any, Any]]) -> Change:
    """Return a fault that changes time, position and quaternion x y z w of poses."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.kind != 'odometry':
                continue
            pose = event.message.pose.pose
            place = np.array([getattr(pose.position, axis) for axis in 'xyz'])
            turn = np.array([getattr(pose.orientation, axis) for axis in 'xyzw'])
            place, turn = change(event.time, place, turn)
            for axis, value in zip('xyz', place, strict=True):
                setattr(pose.position, axis, float(value))
            for axis, value in zip('xyzw', turn, strict=True):
                setattr(pose.orientation, axis, float(value))
        return events

    return run


def restart_odometry(events: list[Event]) -> list[Event]:
    """Let the odometry begin anew at the origin, heading along x, from half on."""
    begin: list[Any] = []

    def change(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
        if time <= HALF:
            return place, turn
        if not begin:
            yaw = Rotation.from_quat(turn).as_euler('ZYX')[0]
            begin.append((place, Rotation.from_euler('Z', -yaw)))
        origin, back = begin[0]
        return back.apply(place - origin), (back * Rotation.from_quat(turn)).as_quat()

    return turn_poses(change)(events)


def turn_frame(degrees: float) -> Change:
    """Return a fault that turns the odometry's frame about the vehicle from half on."""
    begin: list[np.ndarray] = []
    more = Rotation.from_euler('Z', degrees, degrees=True)

    def change(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
        if time <= HALF:
            return place, turn
        if not begin:
            begin.append(place)
        return begin[0] + more.apply(place - begin[0]), (more * Rotation.from_quat(turn)).as_quat()

    return turn_poses(change)


def drift_heading(rate: float, begin: float = 0.0) -> Change:
    """Return a fault that turns headings from a time on [degrees/s, s]; positions stay right."""

    def change(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
        more = Rotation.from_euler('Z', rate * max(time - begin, 0.0), degrees=True)
        return place, (more * Rotation.from_quat(turn)).as_quat()

    return turn_poses(change)


def spoil_turn(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
    """Give no orientation for half a second."""
    return place, np.full(4, np.nan) if HALF < time < HALF + 0.5 else turn


def land(events: list[Event]) -> list[Event]:
    """Let the odometry be back at the origin for the last two seconds."""
    end = events[-1].time - 2.0
    return turn_poses(
        lambda time, place, turn: (np.zeros(3) if time > end else place, turn)
    )(events)


def round_to_utm(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
    """Give UTM coordinates that went through a float32: 0.5 m to a step northwards."""
    return (place + UTM).astype(np.float32).astype(np.float64), turn


def tell_ned(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
    """Give positions as north, east, down, and orientations as they were."""
    return place[[1, 0, 2]] * (1.0, 1.0, -1.0), turn


def put_w_first(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
    """Give the quaternion as w x y z."""
    return place, turn[[3, 0, 1, 2]]


def stretch(scale: float) -> Change:
    """Return a fault: positions are longer by a factor, as of one camera."""
    return turn_poses(lambda time, place, turn: (scale * place, turn))


def hold_positions(period: float, lost: float = 0.0) -> Change:
    """Return a fault: positions are new so often [s], and repeated; a share of poses is lost."""

    def run(events: list[Event]) -> list[Event]:
        rng = np.random.default_rng(4)
        kept: dict[str, Any] = {'time': -1.0}

        def change(time: float, place: np.ndarray, turn: np.ndarray) -> tuple[Any, Any]:
            if time - kept['time'] >= period - 1e-3:
                kept.update(time=time, place=place)
            return kept['place'], turn

        return [
            event for event in turn_poses(change)(events)
            if event.kind != 'odometry' or rng.random() >= lost
        ]

    return run


def start_late(name: str) -> Change:
    """Return a fault: a lidar of another frame is started at half, beside the first."""

    def run(events: list[Event]) -> list[Event]:
        more = []
        for event in events:
            if event.kind == 'scan' and event.time > HALF:
                more.append(Event(event.time + 0.03, 'second', copy.deepcopy(event.message)))
                more[-1].message.header.frame_id = name
                shift_stamp(more[-1].message, 0.03)
        return sorted(events + more, key=lambda event: event.time)

    return run


def replace_lidar(name: str) -> Change:
    """Return a fault: no scan until half, then those of a lidar of another frame."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.kind == 'scan':
                event.message.header.frame_id = name
        return [event for event in events if event.kind != 'scan' or event.time > HALF]

    return run


def clear_frame(message: Any) -> None:
    """Give no frame."""
    message.header.frame_id = ''


def clear_covariance(message: Any) -> None:
    """Give a covariance of zero."""
    message.pose.covariance = np.zeros(36)


def rotate_fields(message: Any) -> None:
    """Store z first, then x and y; names and offsets tell it rightly."""
    rows = view_rows(message)
    at = {item.name: item.offset for item in message.fields}
    cells = {axis: rows[:, at[axis] : at[axis] + 4].copy() for axis in 'xyz'}
    for axis, home in zip('zxy', 'xyz', strict=True):
        rows[:, at[home] : at[home] + 4] = cells[axis]
    for item in message.fields:
        if item.name in 'xyz':
            item.offset = at[dict(zip('zxy', 'xyz', strict=True))[item.name]]
    message.fields = sorted(message.fields, key=lambda item: item.offset)
    message.data = array('B', rows.tobytes())


def zero_times(message: Any) -> None:
    """Leave the times of points at 0."""
    add_to(message, 'time', lambda time: 0.0 * time)


def make_dust(share: float) -> Change:
    """Return a fault: a share of the points lies anywhere within 10 m, as dust and insects do."""

    def change(message: Any) -> None:
        stamp = message.header.stamp  # scans of one size would have the same dust, in streaks
        rng = np.random.default_rng((stamp.sec, stamp.nanosec))
        rows = view_rows(message)
        chosen = rng.random(len(rows)) < share
        way = rng.normal(size=(int(chosen.sum()), 3))
        way *= rng.uniform(1.0, 10.0, (len(way), 1)) / np.linalg.norm(way, axis=1, keepdims=True)
        at = {item.name: item.offset for item in message.fields}
        for axis, column in zip('xyz', way.T.astype('<f4'), strict=True):
            rows[chosen, at[axis] : at[axis] + 4] = (
                np.ascontiguousarray(column).view(np.uint8).reshape(-1, 4)
            )
        message.data = array('B', rows.tobytes())

    return each('scan', change)


def play_again(events: list[Event]) -> list[Event]:
    """Play the first half twice, as a player that loops: time goes back."""
    first = [event for event in events if event.time < HALF]
    return first + [
        Event(event.time + HALF, event.kind, copy.deepcopy(event.message)) for event in first
    ]
