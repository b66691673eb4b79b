# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How long the node takes from a pose to ~/proximity, over DDS, in flight.

Node and player are processes of their own; this one hears both topics and compares when the two
messages of one stamp came.  Ticks run all the while; a pose counts as "in a tick" where one ran
when it came, as told by /diagnostics.
"""

import argparse
from collections.abc import Sequence
import os
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.tables import render_table
from node_load import Probe, run

from plc_inspect.ros.graph.domain import set_apart
from plc_inspect.ros.graph.transport import prepare_transport

MOST = 20.0
"""99 of 100 answers are to come within [ms]."""
LEAST = 200
"""Answers from which the figures are believed."""


class Ear:
    """Hears poses and answers."""

    def __init__(self) -> None:
        self._came: dict[int, float] = {}
        self.delays: list[tuple[float, float]] = []
        """When the pose came [s], and the answer after that [ms]."""

    def listen(self, probe: Probe) -> None:
        from nav_msgs.msg import Odometry
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import PointCloud2

        probe.node.create_subscription(Odometry, '/odometry', self._on_pose,
                                       qos_profile_sensor_data)
        probe.node.create_subscription(PointCloud2, '/plc_inspect/proximity', self._on_answer,
                                       qos_profile_sensor_data)

    def _on_pose(self, message: Any) -> None:
        self._came[_stamp(message)] = time.monotonic()

    def _on_answer(self, message: Any) -> None:
        came = self._came.pop(_stamp(message), None)
        if came is not None:
            self.delays.append((came, 1e3 * (time.monotonic() - came)))


def _stamp(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def main(argv: Sequence[str] | None = None) -> int:
    """Fly a recording past the node; return 1 where the limit is missed."""
    parser = argparse.ArgumentParser(description='From a pose to ~/proximity.')
    parser.add_argument('bag', type=Path)
    parser.add_argument('--seconds', type=float, default=60.0, metavar='S')
    arguments = parser.parse_args(argv)
    prepare_transport()
    set_apart()
    ear = Ear()
    with tempfile.TemporaryDirectory() as room:
        probe, end = run(arguments.bag, Path(room) / 'out', 10.0, (),
                         seconds=arguments.seconds, watch=ear.listen)
    delays = np.array(ear.delays).reshape(-1, 2)
    ticks = np.array([(done - 1e-3 * took, done) for done, took in probe.ticks]).reshape(-1, 2)
    inside = ((delays[:, :1] >= ticks[:, 0]) & (delays[:, :1] <= ticks[:, 1])).any(axis=1)
    rows = []
    for name, chosen in (('all', delays[:, 1]), ('in a tick', delays[inside, 1])):
        figures = np.quantile(chosen, (0.5, 0.95, 0.99)) if len(chosen) else (np.nan,) * 3
        rows.append((name, f'{len(chosen)}', *(f'{value:.1f}' for value in figures)))
    print(render_table(('poses', 'answers', 'p50 [ms]', 'p95 [ms]', 'p99 [ms]'), rows))
    load = os.getloadavg()[0]
    print(f'{os.cpu_count()} cores, load {load:.1f}; {len(probe.ticks)} ticks; {end}')
    if len(delays) < LEAST:
        print(f'only {len(delays)} answers came', file=sys.stderr)
        return 1
    return int(np.quantile(delays[:, 1], 0.99) > MOST)


if __name__ == '__main__':
    sys.exit(main())
