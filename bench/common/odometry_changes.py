# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What can be wrong with times, poses and scans of a flight, beside `flight_faults`."""

from array import array
from collections.abc import Callable
import copy
from typing import Any

from common.flight_faults import Event, shift_stamp, view_rows
import numpy as np

HALF = 10.0
"""When most faults begin [s]."""


def move_poses(change: Callable[[float], tuple[float, float, float] | None]) -> Callable[..., Any]:
    """Return a fault that adds to positions, by the time of the flight."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.kind == 'odometry' and (move := change(event.time)) is not None:
                place = event.message.pose.pose.position
                place.x, place.y, place.z = (
                    place.x + move[0], place.y + move[1], place.z + move[2]
                )
        return events

    return run


def step(*move: float) -> Callable[..., Any]:
    """Return a fault that shifts the odometry from half on."""
    return move_poses(lambda time: (move[0], move[1], move[2]) if time > HALF else None)


def turn_back(events: list[Event], middle: float) -> list[Event]:
    """Fly up to a time [s], and the same mirrored in time."""
    half = [event for event in events if event.time < middle]
    begin = half[0].message.header.stamp
    zero = begin.sec * 10**9 + begin.nanosec - round(half[0].time * 1e9)
    back = []
    for event in half:
        message = copy.deepcopy(event.message)
        stamp = message.header.stamp
        own = stamp.sec * 10**9 + stamp.nanosec - zero
        stamp.sec, stamp.nanosec = divmod(zero + round(2e9 * middle) - own, 10**9)
        if event.kind == 'scan':
            (place,) = (item for item in message.fields if item.name == 'time')
            rows = view_rows(message)
            rows[:, place.offset + 3] ^= 0x80  # the sign of a little-endian float32
            message.data = array('B', rows.tobytes())
        back.append(Event(2.0 * middle - event.time, event.kind, message))
    return sorted(half + back, key=lambda event: event.time)


def drift_back(events: list[Event], *, rate: float = 0.0) -> list[Event]:
    """Fly the first half, and the same mirrored in time; the odometry rises by a rate [m/s]."""
    flight = turn_back(events, events[-1].time / 2.0)
    return move_poses(lambda time: (0.0, 0.0, rate * time))(flight)


def freeze(events: list[Event]) -> list[Event]:
    """Repeat one pose for 5 s."""
    last = None
    for event in events:
        if event.kind == 'odometry':
            if HALF - 3.0 < event.time < HALF + 2.0:
                event.message.pose = copy.deepcopy(last)
            else:
                last = event.message.pose
    return events


def rename_frame(kind: str, name: str) -> Callable[..., Any]:
    """Return a fault that changes the frame of messages from half on."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.kind == kind and event.time > HALF:
                event.message.header.frame_id = name
        return events

    return run


def drop(kind: str, seconds: float) -> Callable[..., Any]:
    """Return a fault that leaves out messages for some time from half on."""
    return lambda events: [
        event for event in events
        if event.kind != kind or not HALF < event.time < HALF + seconds
    ]


def delay(kind: str, seconds: float) -> Callable[..., Any]:
    """Return a fault that sends messages of a kind later."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            event.time += seconds * (event.kind == kind)
        return sorted(events, key=lambda event: event.time)

    return run


def exchange(kind: str) -> Callable[..., Any]:
    """Return a fault that sends every second message of a kind before the one in front of it."""

    def run(events: list[Event]) -> list[Event]:
        chosen = [event for event in events if event.kind == kind]
        for first, second in zip(chosen[::2], chosen[1::2], strict=False):
            first.time, second.time = second.time, first.time
        return sorted(events, key=lambda event: event.time)

    return run


def every(number: int, kind: str, change: Callable[[Any], None]) -> Callable[..., Any]:
    """Return a fault that changes one in so many messages of a kind."""

    def run(events: list[Event]) -> list[Event]:
        for event in [item for item in events if item.kind == kind][number // 2 :: number]:
            change(event.message)
        return events

    return run


def shift_all(seconds: float) -> Callable[..., Any]:
    """Return a fault that shifts all stamps from half on."""

    def run(events: list[Event]) -> list[Event]:
        for event in events:
            if event.time > HALF:
                shift_stamp(event.message, seconds)
        return events

    return run


def spoil_stamp(message: Any) -> None:
    """Give more than a second of nanoseconds."""
    message.header.stamp.nanosec = 4_000_000_000


def cut(message: Any) -> None:
    """Lose half of the data."""
    message.data = message.data[: len(message.data) // 2]


def blank(message: Any) -> None:
    """Let no point be finite."""
    message.data = array('B', b'\xff' * len(message.data))


def empty(message: Any) -> None:
    """Let there be no point."""
    message.width = message.row_step = 0
    message.data = array('B')


def forget_times(message: Any) -> None:
    """Leave out the times of points."""
    message.fields = [item for item in message.fields if item.name not in ('time', 't')]


def negate_turn(message: Any) -> None:
    """Write the same orientation with the other sign."""
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = -turn.x, -turn.y, -turn.z, -turn.w


def break_position(events: list[Event]) -> list[Event]:
    """Let positions be no numbers for a second."""
    return move_poses(lambda time: (float('nan'),) * 3 if HALF < time < HALF + 1 else None)(events)


def swell(events: list[Event]) -> list[Event]:
    """Let one scan have two million points."""
    event = next(item for item in events if item.kind == 'scan' and item.time > HALF)
    message, rows = event.message, view_rows(event.message)
    rows = rows[np.arange(2_000_000) % len(rows)]
    message.height, message.width = 1, len(rows)
    message.row_step, message.data = len(rows) * message.point_step, array('B', rows.tobytes())
    return events


def second_odometry(events: list[Event]) -> list[Event]:
    """Let another odometry, 1 m beside, be on the topic."""
    more = []
    for event in events:
        if event.kind == 'odometry':
            more.append(Event(event.time + 0.005, 'odometry', copy.deepcopy(event.message)))
            shift_stamp(more[-1].message, 0.005)
            more[-1].message.pose.pose.position.y += 1.0
    return sorted(events + more, key=lambda event: event.time)


def garble(events: list[Event]) -> list[Event]:
    """Send three hundred damaged messages between the others."""
    from rclpy.serialization import serialize_message

    rng = np.random.default_rng(3)
    more = []
    for time in np.arange(5.0, 20.0, 0.05):
        event = events[int(rng.integers(len(events)))]
        raw = bytearray(serialize_message(event.message))
        for place in rng.integers(4, min(len(raw), 200), 20):
            raw[place] = int(rng.integers(256))
        more.append(Event(float(time), event.kind, bytes(raw[: int(rng.integers(8, len(raw)))])))
    return sorted(events + more, key=lambda event: event.time)
