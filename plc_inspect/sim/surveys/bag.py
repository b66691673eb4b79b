# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings of simulated flights, as by ``ros2 bag record``."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.sim.surveys.puck import Scan
from plc_inspect.sim.surveys.trajectory import RATE, rotate, Trajectory

Float64 = NDArray[np.float64]

EPOCH = 1_767_225_600
"""Time 0 of trajectories on the clock of the recording [s]."""
SCAN_TOPIC = '/velodyne_points'
ODOMETRY_TOPIC = '/odometry'


class FlightSink(Protocol):
    """Receives the scans and odometry of a flight."""

    def write_scan(self, scan: Scan) -> None:
        """Receive a scan."""

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        """Receive the pose of one node of the odometry's trajectory."""


class FlightWriter:
    """Writes scans and odometry into an open bag."""

    def __init__(self, writer: Writer) -> None:
        """Add both topics to the bag."""
        self._writer = writer
        self._maker = MessageMaker()
        self._scans = self._connect(SCAN_TOPIC, 'sensor_msgs/msg/PointCloud2')
        self._odometry = self._connect(ODOMETRY_TOPIC, 'nav_msgs/msg/Odometry')

    def write_scan(self, scan: Scan) -> None:
        """Write a scan at its stamp."""
        stamp = _to_nanoseconds(scan.stamp)
        self._write(self._scans, stamp, self._maker.cloud(
            self._maker.header(stamp, 'velodyne'), scan.points, is_dense=len(scan.points) == 1
        ))

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        """Write the pose of one node of the odometry's trajectory."""
        position, rpy = odometry.position[index], odometry.rpy[index]
        after = min(index + 1, len(odometry.position) - 1)
        before = max(after - 2, 0)
        span = max(after - before, 1) / RATE
        rotation = rotate(rpy[None])[0]
        speed = rotation.T @ (odometry.position[after] - odometry.position[before]) / span
        rates = (odometry.rpy[after] - odometry.rpy[before]) / span
        qx, qy, qz, qw = _to_quaternion(rpy)
        make, vector = self._maker.make, self._maker.vector
        stamp = _to_nanoseconds(odometry.start + index / RATE)
        self._write(self._odometry, stamp, make(
            'nav_msgs/msg/Odometry', header=self._maker.header(stamp, 'odom'),
            child_frame_id='base_link',
            pose=make(
                'geometry_msgs/msg/PoseWithCovariance',
                pose=make(
                    'geometry_msgs/msg/Pose',
                    position=vector('Point', position),
                    orientation=make('geometry_msgs/msg/Quaternion', x=qx, y=qy, z=qz, w=qw),
                ),
                covariance=np.diag([0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6]).ravel(),
            ),
            twist=make(
                'geometry_msgs/msg/TwistWithCovariance',
                twist=make(
                    'geometry_msgs/msg/Twist', linear=vector('Vector3', speed),
                    angular=vector('Vector3', rates),
                ),
                covariance=np.zeros(36),
            ),
        ))

    def _connect(self, topic: str, kind: str) -> Any:
        return self._writer.add_connection(topic, kind, typestore=self._maker.store)

    def _write(self, connection: Any, stamp: int, message: Any) -> None:
        self._writer.write(
            connection, stamp, self._maker.serialize(message, connection.msgtype)
        )


@contextmanager
def open_bag(folder: Path, name: str) -> Iterator[FlightWriter]:
    """
    Yield a writer of a rosbag2 recording: ``name``.mcap and metadata.yaml in ``folder``.

    The MCAP chunks are compressed with zstd.
    """
    aside = folder / name
    writer = Writer(aside, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        yield FlightWriter(writer)
    for file in aside.iterdir():
        file.rename(folder / file.name)
    aside.rmdir()


def _to_nanoseconds(time: float) -> int:
    return EPOCH * 1_000_000_000 + round(time * 1e9)


def _to_quaternion(rpy: Float64) -> tuple[float, float, float, float]:
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy / 2), np.sin(rpy / 2)
    return (
        float(sr * cp * cy - cr * sp * sy), float(cr * sp * cy + sr * cp * sy),
        float(cr * cp * sy - sr * sp * cy), float(cr * cp * cy + sr * sp * sy),
    )
