# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How near the vehicle is told to be to conductors, against the truth of simulated flights.

Each flight passes a scene at a side, a height and a speed of its own; a tick is due each second
and its result is there a while later, as in the node.  Printed for each flight: errors of the
distance where it is below RANGE, entries into the critical sphere of conductors that had been
seen for a second, those that were missed, and critical messages without any conductor there.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
import sys

from common.tables import render_table
import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.config import Settings
from plc_inspect.core.live.map_labels import make_planner
from plc_inspect.core.live.motion import Motion
from plc_inspect.core.live.proximity import Level, measure_proximity
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.surroundings import Surroundings
from plc_inspect.core.live.window import copy_window
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.results import catenary_heights
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.flight import Flight, simulate_flight
from plc_inspect.sim.surveys.puck import Puck, Scan
from plc_inspect.sim.surveys.trajectory import FlightPlan, rotate, Trajectory

SCENES = ('demo', 'high_voltage', 'low_voltage', 'medium_voltage', 'bundles', 'double_circuit',
          'angle', 'valley', 'crossing', 'street')
PERIOD, DELAY = 1.0, 0.4
"""Between two ticks, and from the copy of the map to the result [s]."""
EVERY = 5
"""Poses from one message to the next: 20 Hz."""
RANGE = 30.0
"""Distances up to this are compared [m]."""
SEEN_FOR, SEEN_NEAR = 1.0, 3.0
"""A place of a conductor was seen: a return so long ago [s], so near along it [m]."""
MARGIN = 0.3
"""Of the critical distance, to either side, that neither counts as missed nor as false [m]."""
MOST_ERROR = 0.3
"""95 of 100 distances are to be nearer to the truth [m]."""


@dataclass
class Watcher:
    """Takes a flight as the node does, and keeps what it would have told."""

    scene: Scene
    settings: Settings
    accumulator: Accumulator = field(init=False)
    session: Session = field(default_factory=Session)
    motion: Motion = field(default_factory=Motion)
    around: Surroundings = field(default_factory=Surroundings)
    coming: list[tuple[float, Surroundings]] = field(default_factory=list)
    told: list[tuple[float, np.ndarray, float, Level]] = field(default_factory=list)
    seen: list[tuple[float, int, float]] = field(default_factory=list)
    """Time, conductor and distance along it of returns, one a metre and scan."""
    due: float = 0.0

    def __post_init__(self) -> None:
        self.accumulator = Accumulator(self.settings)
        self._planner = make_planner(self.settings)
        samples = [item.sample(0.25) for item in self.scene.conductors]
        self._tree = cKDTree(np.vstack(samples))
        self._owner = np.repeat(np.arange(len(samples)), [len(item) for item in samples])
        self._along = np.concatenate([
            np.linspace(0.0, item.length, len(own))
            for item, own in zip(self.scene.conductors, samples, strict=True)
        ])

    def write_scan(self, scan: Scan) -> None:
        points = scan.points.ravel()
        xyz = np.column_stack([points[name] for name in 'xyz']).astype(np.float32)
        self.accumulator.add_scan(
            round(scan.stamp * 1e9), xyz, points['time'].astype(np.float64), frame_id='velodyne'
        )
        apart, place = self._tree.query(scan.exact, distance_upper_bound=0.3)
        place = place[np.isfinite(apart)]
        for owner, along in {(int(self._owner[k]), round(float(self._along[k]))) for k in place}:
            self.seen.append((scan.stamp, owner, along))

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        time, position = odometry.start + index / 200.0, odometry.position[index]
        stamp = round(time * 1e9)
        self.accumulator.add_pose(
            stamp, position, _to_quaternion(odometry.rpy[index]), frame_id='odom',
            child_frame_id='base_link',
        )
        self.motion.add(stamp, position)
        while self.coming and self.coming[0][0] <= time:
            self.around = self.coming.pop(0)[1]
        if time >= self.due:
            self.due = time + PERIOD
            self._tick(time, position)
        if index % (EVERY * 2) == 0:
            seen = self.around.is_seen(
                self.accumulator.map.cells, position, self.settings.proximity.warning,
                self.settings.height.beta,
            )
            found = measure_proximity(
                self.around, seen, position, self.motion.velocity, self.settings.proximity
            )[0]
            self.told.append((time, position.copy(), found.distance, found.level))

    def _tick(self, time: float, position: np.ndarray) -> None:
        voxels = self.accumulator.map
        spans = [item.span for item in self.session.state.spans]
        plan = self._planner.plan(voxels, spans, position)
        if plan is None:
            return
        window = next(item for item in copy_window(voxels, plan) if item is not None)
        done = self.session.tick(window, self.settings, position)
        voxels.label(window.slots, window.points, done.labels)
        self.coming.append((time + DELAY, done.state.around))


def _to_quaternion(rpy: np.ndarray) -> tuple[float, float, float, float]:
    from scipy.spatial.transform import Rotation

    return tuple(Rotation.from_matrix(rotate(rpy[None])[0]).as_quat())


@dataclass(frozen=True, slots=True)
class Figures:
    """What one flight gave."""

    errors: np.ndarray
    entries: int
    missed: int
    false: int
    unknown: float
    """Share of the messages that say unknown."""


def judge(watcher: Watcher, truth: dict, critical: float) -> Figures:
    """Compare what was told with the truth."""
    curves = []
    for span in truth['spans']:
        x = np.arange(0.0, span['length'], 0.1)
        start, end = np.array(span['start']), np.array(span['end'])
        places = start + (x / span['length'])[:, None] * (end - start)
        places[:, 2] = catenary_heights(span['a'], span['b'], span['c'], x)
        curves.append((x, places))
    seen = np.array(watcher.seen).reshape(-1, 3)
    errors, entries, missed, false = [], 0, 0, 0
    inside = [False] * len(curves)
    for time, position, distance, level in watcher.told:
        past = seen[seen[:, 0] <= time - SEEN_FOR]
        nearest, known = np.inf, np.inf
        for number, (x, places) in enumerate(curves):
            apart = np.linalg.norm(places - position, axis=1)
            at = int(np.argmin(apart))
            nearest = min(nearest, apart[at])
            own = past[past[:, 1] == number, 2]
            if not len(own) or np.abs(own - x[at]).min() > SEEN_NEAR:
                inside[number] = False
                continue
            known = min(known, apart[at])
            enters = apart[at] < critical - MARGIN
            if enters and not inside[number]:
                entries += 1
                missed += level != Level.CRITICAL
            inside[number] = enters
        if level == Level.CRITICAL and nearest > critical + MARGIN:
            false += 1
        if known <= RANGE and known == nearest:
            errors.append(abs(distance - known))
    unknown = np.mean([level == Level.UNKNOWN for *_, level in watcher.told])
    return Figures(np.array(errors), entries, missed, false, float(unknown))


def fly(name: str, seed: int, settings: Settings, duration: float) -> Figures:
    """Fly past a scene at a side, height and speed that the seed draws."""
    rng = np.random.default_rng([seed, *name.encode()])
    scene = make_scene(name, seed)
    plan = FlightPlan(
        speed=float(rng.uniform(3.0, 10.0)), lateral=float(rng.uniform(-15.0, 15.0)),
        height=float(rng.uniform(4.0, 12.0)), duration=duration,
    )
    watcher = Watcher(scene, settings)
    truth = simulate_flight(scene, watcher, rng, Flight(plan=plan, puck=Puck()))
    return judge(watcher, truth, settings.proximity.critical)


def main(argv: Sequence[str] | None = None) -> int:
    """Fly the scenes; return 1 where a figure misses its limit."""
    parser = argparse.ArgumentParser(description='Distances to conductors against the truth.')
    parser.add_argument('--scenes', nargs='*', default=SCENES, metavar='NAME')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--duration', type=float, default=40.0, metavar='S')
    arguments = parser.parse_args(argv)
    settings, rows, good = Settings(), [], True
    for name in arguments.scenes:
        found = fly(name, arguments.seed, settings, arguments.duration)
        p95 = float(np.quantile(found.errors, 0.95)) if len(found.errors) else 0.0
        good &= p95 < MOST_ERROR and not found.missed and not found.false
        rows.append((name, f'{len(found.errors)}', f'{p95:.2f}', f'{found.entries}',
                     f'{found.missed}', f'{found.false}', f'{found.unknown:.0%}'))
        print(' | '.join(rows[-1]), flush=True)
    print(render_table(
        ('flight', 'messages', 'error p95 [m]', 'entries', 'missed', 'false', 'unknown'), rows
    ))
    return int(not good)


if __name__ == '__main__':
    sys.exit(main())
