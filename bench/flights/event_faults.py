# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of clock, mount, odometry and air, done to scans and poses of a flight as they come."""

from collections.abc import Iterator

from flights.faulty_flights import Event, Fault, Pose, Turn
import numpy as np
from scipy.spatial.transform import Rotation


def leave(event: Event) -> Iterator[Event]:
    """Leave all as it is."""
    yield event


def shift_clock(seconds: float, rate: float = 0.0) -> Fault:
    """Let the stamps of scans be ahead [s], by more and more [s/s]."""

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Turn):
            event = event._replace(lead=seconds + rate * event.time)
        yield event

    return run


def stretch(scale: float) -> Fault:
    """Let positions be longer by a factor."""

    def run(event: Event) -> Iterator[Event]:
        yield event._replace(position=scale * event.position) if isinstance(event, Pose) else event

    return run


def turn_heading(rate: float) -> Fault:
    """Let the heading drift against the positions [degrees/s]."""

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Pose):
            more = Rotation.from_euler('Z', rate * event.time, degrees=True)
            turn = (more * Rotation.from_quat(event.quaternion)).as_quat()
            event = event._replace(quaternion=turn)
        yield event

    return run


def mount_otherwise(turn: tuple[float, float, float]) -> Fault:
    """Let the lidar be mounted with a roll, pitch and yaw that nobody tells [degrees]."""
    back = Rotation.from_euler('xyz', turn, degrees=True).as_matrix()  # points times its inverse

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Turn):
            event = event._replace(xyz=(event.xyz @ back).astype(np.float32))
        yield event

    return run


def raise_dust(share: float) -> Fault:
    """Put a share of the points anywhere within 10 m."""

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Turn):
            rng = np.random.default_rng(round(event.time * 1e6))
            chosen = rng.random(len(event.xyz)) < share
            way = rng.normal(size=(int(chosen.sum()), 3))
            way *= rng.uniform(1.0, 10.0, (len(way), 1)) / np.linalg.norm(way, axis=1)[:, None]
            xyz = event.xyz.copy()
            xyz[chosen] = way
            event = event._replace(xyz=xyz)
        yield event

    return run


def hold(period: float) -> Fault:
    """Let positions be new so often [s], and repeated."""
    kept: dict[str, Pose] = {}

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Pose):
            last = kept.get('last')
            if last is None or not 0.0 <= event.time - last.time < period - 1e-3:
                last = kept['last'] = event
            event = event._replace(position=last.position)
        yield event

    return run


def freeze(begin: float, seconds: float) -> Fault:
    """Repeat one pose for a while [s]."""
    kept: dict[str, Pose] = {}

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Pose):
            if begin < event.time < begin + seconds:
                event = kept['last']._replace(time=event.time)
            else:
                kept['last'] = event
        yield event

    return run


def move(begin: float, step: float, rate: float, way: np.ndarray) -> Fault:
    """Let the odometry step [m], and drift from the beginning on [m/s]."""

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Pose):
            by = (step if event.time > begin else 0.0) + rate * event.time
            event = event._replace(position=event.position + by * way)
        yield event

    return run


def turn_world(*angles: float) -> Fault:
    """Return a fault: the odometry is told in a frame that stands otherwise [degrees]."""
    turn = Rotation.from_euler('xyz', angles, degrees=True)

    def run(event: Event) -> Iterator[Event]:
        if isinstance(event, Pose):
            rotation = (turn * Rotation.from_quat(event.quaternion)).as_quat()
            event = event._replace(position=turn.apply(event.position), quaternion=rotation)
        yield event

    return run
