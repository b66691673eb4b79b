# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Make ``bags/demo``: a recorded flight along a medium-voltage line, with its truth.

The driver passes on the side towards the line, 170 degrees wide, up to 48 m, and coordinates are
rounded to 2^-9 m, the sensor's own resolution: that keeps the recording small enough to ship.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
import json
from pathlib import Path
import sys

import numpy as np

from plc_inspect.errors import PlcInspectError
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.surveys.bag import FlightWriter, open_bag
from plc_inspect.sim.surveys.flight import Flight, simulate_flight
from plc_inspect.sim.surveys.output import open_folder
from plc_inspect.sim.surveys.puck import Puck, Scan
from plc_inspect.sim.surveys.trajectory import Trajectory

SEED = 7
MAX_SIZE = 12_000_000


class CompactWriter:
    """Rounds the points of scans so that they compress well."""

    def __init__(self, writer: FlightWriter) -> None:
        self._writer = writer

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        """Write a pose as it is."""
        self._writer.write_odometry(odometry, index)

    def write_scan(self, scan: Scan) -> None:
        """Write a scan with rounded coordinates and intensities."""
        points = scan.points.copy()
        for name in ('x', 'y', 'z'):
            points[name] = np.round(points[name] * 512) / 512
        points['intensity'] = np.round(points['intensity'] / 16) * 16
        self._writer.write_scan(replace(scan, points=points))


def main(argv: Sequence[str] | None = None) -> int:
    """Make the demo; return 0 done, 2 where it cannot be written, 1 where it is too large."""
    parser = argparse.ArgumentParser(description='Make the demo recording and its truth.')
    parser.add_argument(
        '-o', '--output', type=Path, default=Path(__file__).resolve().parent / 'demo',
    )
    arguments = parser.parse_args(argv)
    puck = Puck(max_range=48.0, view_direction_deg=-90.0, view_width_deg=170.0)
    scene = make_scene('demo', SEED)
    try:
        with open_folder(arguments.output, force=True) as folder:
            with open_bag(folder, 'demo') as writer:
                truth = simulate_flight(
                    scene, CompactWriter(writer), np.random.default_rng(SEED),
                    Flight(puck=puck, odometry_rate=50.0),
                )
            (folder / 'truth.json').write_text(json.dumps(truth, indent=1) + '\n')
    except (PlcInspectError, OSError) as error:
        print(f'make_demo: {error}', file=sys.stderr)
        return 2
    size = sum(file.stat().st_size for file in arguments.output.iterdir())
    print(f'{arguments.output}: {truth["num_scans"]} scans, {truth["num_points"]} points, '
          f'{size / 1e6:.1f} MB')
    for span in truth['spans']:
        print(f'  line {span["line_id"]} span {span["span_id"]}: {span["length"]:.1f} m, '
              f'sag {span["sag"]:.2f} m, seen over {span["seen"]:.0%}')
    for hazard in truth['hazards']:
        print(f'  {hazard["kind"]} {hazard["clearance"]:.2f} m from line {hazard["line_id"]} '
              f'span {hazard["span_id"]}')
    return 1 if size > MAX_SIZE else 0


if __name__ == '__main__':
    sys.exit(main())
