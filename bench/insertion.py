# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Times the way of a scan into the map: deskewing with transformation, and hashing.

A vehicle flies at 15 m/s over rough ground, with 100 Hz odometry; every scan holds 30,000 points.
Nine of ten points fall into voxels never seen before, which is the dearest case.  Prints median,
p99 and greatest time of each part, as processor time of the thread, or with ``--wall`` as wall
time, which other programs lengthen.
"""

import argparse
import time

import numpy as np

from plc_inspect.config import InputSettings, MapSettings
from plc_inspect.core.mapping.deskew import deskew
from plc_inspect.core.mapping.pose_buffer import PoseBuffer
from plc_inspect.core.setup.transforms import make_transform
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.ros.background.system_memory import take_memory

SPEED = 15.0
HEIGHT = 22.0


def make_scan(num_points: int, rng: np.random.Generator) -> np.ndarray:
    """Return (N, 3) returns of rough ground and of crowns, in the lidar frame."""
    azimuth = np.linspace(0.0, 2 * np.pi, num_points)
    distance = rng.uniform(5.0, 80.0, num_points)
    ground = rng.normal(0.0, 0.1, num_points) - HEIGHT
    crowns = np.where(rng.random(num_points) < 0.3, rng.uniform(0.0, 12.0, num_points), 0.0)
    return np.column_stack(
        (distance * np.cos(azimuth), distance * np.sin(azimuth), ground + crowns)
    ).astype(np.float32)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description='Times the way of a scan into the map.')
    parser.add_argument('--points', type=int, default=30_000)
    parser.add_argument('--scans', type=int, default=300)
    parser.add_argument('--wall', action='store_true', help='wall time')
    arguments = parser.parse_args()
    clock = time.perf_counter if arguments.wall else time.thread_time
    rng = np.random.default_rng(0)
    poses = PoseBuffer(InputSettings())
    for i in range(120):
        yaw = 0.02 * np.sin(0.1 * i)
        poses.insert(
            10_000_000 * i,
            (SPEED * 0.01 * i, 0.0, 0.0),
            (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)),
        )
    mount = make_transform((0.1, 0.0, -0.2), (0.0, 10.0, 0.0))
    scans = [make_scan(arguments.points, rng) for _ in range(20)]
    stamps = 500_000_000 + np.linspace(0, 99_000_000, arguments.points).astype(np.int64)
    voxels = VoxelMap(MapSettings())
    voxels.reserve(voxels.max_voxels)
    take_memory(voxels.memory)
    times = np.empty((arguments.scans, 3))
    for i in range(-1, arguments.scans):
        started = clock()
        points = deskew(scans[i % 20], stamps, poses, mount).points
        points[:, 0] += SPEED * 0.1 * (i + 1)
        halfway = clock()
        voxels.insert(points)
        ended = clock()
        if i >= 0:  # the first one compiles
            times[i] = halfway - started, ended - halfway, ended - started
    print(f'{arguments.scans} scans of {arguments.points} points, {len(voxels)} voxels, '
          f'{voxels.nbytes / 1e6:.0f} MB')
    for name, column in zip(('deskew', 'hash', 'both'), times.T * 1e3, strict=True):
        middle, high = np.percentile(column, [50, 99])
        print(f'{name:7s} median {middle:.2f} ms, p99 {high:.2f} ms, max {column.max():.2f} ms')


if __name__ == '__main__':
    main()
