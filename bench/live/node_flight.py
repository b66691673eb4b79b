# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Makes the recording of a long flight for the benches of the node.

Five high-voltage conductors over spans of 230 to 310 m with gentle turns, trees to both sides, and
a vehicle that flies along them at 8 m/s: ten minutes are 4.8 km.  The scans are organised as the
driver publishes them by default: 30,000 points each, NaN where nothing returned.
"""

import argparse
from collections.abc import Sequence
import json
import math
from pathlib import Path
import sys

import numpy as np

from plc_inspect.errors import PlcInspectError
from plc_inspect.sim.scenes import lines, vegetation
from plc_inspect.sim.scenes.catalogue import lay_route
from plc_inspect.sim.scenes.scene import measure_offset, Scene, SceneBuilder
from plc_inspect.sim.scenes.terrain import make_terrain
from plc_inspect.sim.surveys.bag import open_bag
from plc_inspect.sim.surveys.flight import Flight, simulate_flight
from plc_inspect.sim.surveys.output import open_folder
from plc_inspect.sim.surveys.puck import Puck
from plc_inspect.sim.surveys.trajectory import FlightPlan, OdometryErrors

SPEED = 8.0
HALF_WIDTH = 45.0
TREES_PER_HECTARE = 80.0


def make_long_scene(length: float, seed: int) -> Scene:
    """Return a scene with a high-voltage line of at least this length [m]."""
    rng = np.random.default_rng(seed)
    spans, turns = [], []
    while sum(spans) < length:
        spans.append(float(rng.uniform(230.0, 310.0)))
        turns.append(float(rng.uniform(3.0, 15.0)) * (1 if len(spans) % 2 else -1))
    route = lay_route(tuple(spans), tuple(turns))
    low, high = route.min(axis=0) - 150.0, route.max(axis=0) + 150.0
    terrain = make_terrain(rng, (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
                           12.0, 400.0)
    builder = SceneBuilder(name='long', seed=seed, terrain=terrain, rng=rng)
    lines.add_line(builder, lines.HIGH_VOLTAGE, route)
    outer = max(
        (item for item in builder.conductors if item.span_id == 0),
        key=lambda item: float(item.start[1]),
    )
    vegetation.plant_beside(builder, outer, 0.5, 1, 1.5)
    places = rng.uniform(low, high, (int(TREES_PER_HECTARE * np.prod(high - low) / 1e4), 2))
    gap = measure_offset(places, route)
    vegetation.scatter_trees(builder, places[(gap > 14.0) & (gap < 60.0)], (5.0, 16.0))
    return builder.build(route, HALF_WIDTH)


def main(argv: Sequence[str] | None = None) -> int:
    """Make the recording; return 0 done, 2 where it cannot be written."""
    parser = argparse.ArgumentParser(description='Makes a long flight for the benches.')
    parser.add_argument('-o', '--output', type=Path, required=True)
    parser.add_argument('--duration', type=float, default=600.0, metavar='S')
    parser.add_argument('--scan-rate', type=float, default=10.0, metavar='HZ')
    parser.add_argument('--dual', action='store_true', help='two returns a beam')
    parser.add_argument('--drift', type=float, default=OdometryErrors().drift)
    parser.add_argument('--seed', type=int, default=3)
    parser.add_argument('--force', action='store_true')
    arguments = parser.parse_args(argv)
    scene = make_long_scene(SPEED * arguments.duration + 10.0, arguments.seed)
    plan = FlightPlan(speed=SPEED, lateral=22.0, height=3.0, duration=arguments.duration)
    puck = Puck(rate=arguments.scan_rate, dual=arguments.dual, organized=True)

    def show(done: int, total: int) -> None:
        if sys.stderr.isatty() or done % max(1, math.ceil(total / 20)) == 0:
            print(f'\r{done} of {total} scans', end='', file=sys.stderr)

    try:
        with open_folder(arguments.output, arguments.force) as folder:
            with open_bag(folder, 'flight') as writer:
                truth = simulate_flight(
                    scene, writer, np.random.default_rng(arguments.seed),
                    Flight(plan=plan, puck=puck, errors=OdometryErrors(drift=arguments.drift)),
                    show,
                )
            (folder / 'truth.json').write_text(json.dumps(truth, indent=1) + '\n')
    except (PlcInspectError, OSError) as error:
        print(f'node_flight: {error}', file=sys.stderr)
        return 2
    print(f'\n{arguments.output}: {truth["duration"]:.0f} s, {truth["num_scans"]} scans, '
          f'{truth["num_points"]} returns, {len(scene.conductors)} spans')
    return 0


if __name__ == '__main__':
    sys.exit(main())
