# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
What a flight did not see, and how much of that the proposed flight sees.

A scene is flown so that something is hidden: a third of the conductors, a third of all scans, the
ground behind houses, one side.  What is listed is flown again in the simulator along the
waypoints, with nothing hidden but what stands in the way; a valley twice, by the list of each
landing.  Printed: metres listed of each part, the share of them that was seen after each flight,
and how near these came to a true conductor.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
import sys

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.tables import render_table

from plc_inspect.config import MapSettings, Settings
from plc_inspect.core.coverage.coverage import (
    Coverage,
    look_at_section,
    measure_coverage,
    Part,
)
from plc_inspect.core.coverage.refly import plan_refly
from plc_inspect.core.coverage.seen_ground import see_ground, SeenGround
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.offline.export.coverage_files import SPEED
from plc_inspect.results import InspectionResult, PointClass
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.flight import Flight, PLANS, simulate_flight
from plc_inspect.sim.surveys.puck import Puck, Scan
from plc_inspect.sim.surveys.trajectory import FlightPlan, OdometryErrors, Trajectory

SCENES = {
    'conductors': 'hidden', 'scans': 'high_voltage', 'ground': 'street', 'side': 'double_circuit',
    'valley': 'valley',
}
"""
Scene in which something is hidden: a third of conductors, a third of scans, what lies behind
houses, a side that is passed far out, and the same with the ground deep below.
"""
WAYS = {'ground': (25.0, -2.0), 'side': (35.0, -4.0), 'valley': (35.0, -4.0)}
"""How far out on one side, and above the conductors, the first flight is [m]; else as usual."""
FLIGHTS = {'valley': 2}
"""
Flights by the list in which what was listed is to be seen, of other kinds one.

How deep an unseen valley is nothing tells: a flight stays above what was seen beside it, and sees
what lies up to 26 m below.
"""
NOISE = 0.02
"""Standard deviation of points [m]."""
NEAR = 3.0
"""A place of a conductor was seen where a wire point is this near [m]."""
EXACT = OdometryErrors(drift=0.0, attitude_deg=0.0, jitter=0.0)
"""Errors of the way, which is compared with true conductors."""
LEAST_CLOSED, LEAST_APART = 0.95, 15.0
"""Share of what was listed that is to be seen, and distance from conductors to be kept [m]."""


@dataclass
class Cloud:
    """Takes a flight as points where they truly are, and the way."""

    keeps: Callable[[float], bool]
    rng: np.random.Generator
    voxels: VoxelMap = field(default_factory=lambda: VoxelMap(MapSettings(max_voxels=60_000_000)))
    way: list[tuple[float, ...]] = field(default_factory=list)

    def write_scan(self, scan: Scan) -> None:
        if self.keeps(scan.stamp):
            noise = self.rng.normal(0.0, NOISE, scan.exact.shape)
            self.voxels.insert(scan.exact + noise)

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        if index % 20 == 0:
            self.way.append((index / 200.0, *odometry.position[index]))


@dataclass(frozen=True)
class Seen:
    """What a cloud shows."""

    result: InspectionResult
    points: np.ndarray
    ground: SeenGround
    coverage: Coverage


def look(cloud: Cloud) -> Seen:
    """Run the pipeline and measure what was seen."""
    points = cloud.voxels.centroids()
    result = Pipeline(Settings()).run(points)
    ground = see_ground(points, result.classification == PointClass.WIRE)
    return Seen(result, points, ground, measure_coverage(
        result, points, ground, np.array(cloud.way)
    ))


def fly(cloud: Cloud, scene: Scene, plan: FlightPlan, rng: np.random.Generator) -> None:
    """Fly, and put the way into the frame of the scene, both without drift."""
    before = len(cloud.way)
    truth = simulate_flight(scene, cloud, rng, Flight(plan=plan, puck=Puck(), errors=EXACT))
    origin = truth['odometry_origin']
    for number in range(before, len(cloud.way)):
        time, *place = cloud.way[number]
        cloud.way[number] = time, *np.add(place, origin)


def measure_closed(scene: Scene, first: Seen, then: Seen) -> dict[Part, tuple[float, float]]:
    """Return metres listed in a first look, and those of them that a second one saw."""
    wires = then.points[then.result.classification == PointClass.WIRE]
    wires = wires if len(wires) else np.full((1, 3), np.inf)
    tree = cKDTree(wires[np.isfinite(wires).all(axis=1)]) if np.isfinite(wires).all() else None
    truth = cKDTree(np.vstack([item.sample(0.5) for item in scene.conductors]))
    found = {part: [0.0, 0.0] for part in Part}
    for item in first.coverage.sections:
        again = look_at_section(
            item.section, [np.empty((0, 3))] * len(item.section.spans), then.ground, None
        )
        for gap in item.gaps:
            if gap.part == Part.CONDUCTOR:
                # where there is no conductor there is nothing to be seen
                places = gap.places[truth.query(gap.places)[0] <= NEAR]
                share = len(places) / len(gap.places)
                found[gap.part][0] += share * gap.length
                if len(places) and tree is not None:
                    seen = tree.query(places)[0] <= NEAR
                    found[gap.part][1] += share * gap.length * float(seen.mean())
                continue
            left = sum(
                max(min(gap.high, other.high) - max(gap.low, other.low), 0.0)
                for other in again.gaps if other.part == gap.part
            )
            found[gap.part][0] += gap.length
            found[gap.part][1] += gap.length - left
    return {part: (listed, closed) for part, (listed, closed) in found.items()}


def hide(kind: str, seed: int) -> tuple[Scene, Scene, FlightPlan, tuple[float, float]]:
    """Return a scene with something hidden and without, how to fly, and shares of lost scans."""
    name = SCENES[kind]
    scene = make_scene(name, seed)
    whole = replace(scene, conductors=tuple(
        replace(item, hidden=None) for item in scene.conductors
    ))
    plan = PLANS[name]
    if kind in WAYS:
        plan = replace(plan, lateral=WAYS[kind][0], height=WAYS[kind][1])
    return scene, whole, plan, (0.33, 0.66) if kind == 'scans' else (2.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class Closed:
    """What a flight by the list saw."""

    parts: dict[Part, tuple[float, float]]
    """Metres listed after the first flight, and those of them that were seen by now."""
    length: float
    """Of its way [m]."""
    apart: float
    """Nearest true conductor [m]."""

    @property
    def listed(self) -> float:
        """Metres listed in all."""
        return sum(item[0] for item in self.parts.values())

    @property
    def share(self) -> float:
        """Share of them that was seen."""
        return sum(item[1] for item in self.parts.values()) / max(self.listed, 1e-9)


def run(kind: str, seed: int) -> tuple[Seen, list[Closed]]:
    """Fly, list, and fly what is listed; return the first look and what each flight closed."""
    rng = np.random.default_rng([seed, *kind.encode()])
    scene, whole, plan, lost = hide(kind, seed)
    length = float(np.linalg.norm(np.diff(scene.route, axis=0), axis=1).sum())
    duration = plan.duration or length / plan.speed
    cloud = Cloud(lambda time: not lost[0] <= time / duration <= lost[1], rng)
    fly(cloud, scene, plan, rng)
    cloud.keeps = lambda time: True
    truth = cKDTree(np.vstack([item.sample(0.5) for item in scene.conductors]))
    seen, closed = [look(cloud)], []
    for _ in range(FLIGHTS.get(kind, 1)):
        refly = plan_refly(seen[-1].coverage, seen[-1].ground, np.array(cloud.way[-1][1:]))
        apart = np.inf
        if len(refly.places):
            waypoints = tuple(tuple(map(float, place)) for place in refly.places)
            before = len(cloud.way)
            fly(cloud, whole, FlightPlan(waypoints=waypoints, speed=SPEED), rng)
            apart = float(truth.query(np.array(cloud.way)[before:, 1:])[0].min())
            seen.append(look(cloud))
        closed.append(Closed(
            parts=measure_closed(whole, seen[0], seen[-1]), length=refly.length, apart=apart,
        ))
    return seen[0], closed


def main(argv: Sequence[str] | None = None) -> int:
    """Fly and fly again; return 1 where a figure misses its limit."""
    parser = argparse.ArgumentParser(description='What a second flight sees of what is listed.')
    parser.add_argument('--kinds', nargs='*', default=tuple(SCENES), choices=tuple(SCENES))
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args(argv)
    rows, good = [], True
    for kind in arguments.kinds:
        first, closed = run(kind, arguments.seed)
        last, apart = closed[-1], min(item.apart for item in closed)
        good &= last.listed > 0.0 and last.share >= LEAST_CLOSED and apart >= LEAST_APART
        rows.append((
            kind, f'{first.coverage.num_poor} of {len(first.coverage.sections)}',
            *(f'{last.parts[part][1]:.0f} of {last.parts[part][0]:.0f}' for part in Part),
            ', '.join(f'{item.share:.1%}' for item in closed),
            ', '.join(f'{item.length:.0f}' for item in closed), f'{apart:.1f}',
        ))
        print(' | '.join(rows[-1]), flush=True)
    print(render_table(
        ('hidden', 'spans listed', *(f'{part.name.lower()} [m]' for part in Part), 'seen then',
         'way [m]', 'nearest conductor [m]'), rows,
    ))
    return int(not good)


if __name__ == '__main__':
    sys.exit(main())
