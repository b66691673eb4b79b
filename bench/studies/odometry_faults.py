# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies there and back with odometry that steps, drifts or stands still, and prints what is found.

Each flight is simulated once, and put into a map as it is and with each fault.  ``doubled`` is how
far what was seen on the way back lies from where the same was put on the way there, at the place
of the vehicle; ``--bare`` does without the correction of the odometry.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
import pickle
import sys
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from plc_inspect.config import Settings
from plc_inspect.core.alignment.pose_watch import PoseWatch
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.setup.sharpness import SharpnessBook
from plc_inspect.results import Severity
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.surveys.flight import Flight, PLANS, simulate_flight
from plc_inspect.sim.surveys.puck import Scan
from plc_inspect.sim.surveys.trajectory import fly, RATE, rotate, Trajectory

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'bench'))

SCENES = ('low_voltage', 'medium_voltage', 'contact', 'street', 'rack')
SEEDS = (41, 42)
"""None of them was used in development, which had 1 to 3."""
LENGTH, SPEED = 52.0, 6.0
"""Of a flight [s], [m/s]: 150 m there and back."""
NEAR = 0.5
"""Distance within which a span lies where one of the flight without fault does [m]."""
BACK = 3.0
"""Places of the vehicle this near to each other in plan are the same [m]."""

SAME = 5.0
"""A critical hazard is false where the flight without fault has none this near [m]."""

Change = Callable[[float, np.ndarray], np.ndarray | None]


@dataclass(eq=False)
class Recorder:
    """Takes a simulated flight."""

    events: list[tuple[Any, ...]] = field(default_factory=list)

    def write_scan(self, scan: Scan) -> None:
        """Take a scan."""
        rows = scan.points.ravel()
        xyz = np.column_stack([rows[axis] for axis in 'xyz']).astype(np.float32)
        self.events.append((scan.stamp, xyz, rows['time'].astype(np.float64)))

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        """Take a pose."""
        turn = Rotation.from_matrix(rotate(odometry.rpy[index][None])[0]).as_quat()
        self.events.append((odometry.start + index / RATE, odometry.position[index], turn, True))


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A flight, and where the vehicle truly was."""

    events: list[tuple[Any, ...]]
    truth: Trajectory


def record(name: str, seed: int, cache: Path | None) -> Recorded:
    """Simulate a flight there and back, or read it from the cache."""
    path = cache / f'back_{name}_{seed}.pickle' if cache else None
    if path is not None and path.exists():
        return Recorded(*pickle.loads(path.read_bytes()))
    scene = make_scene(name, seed)
    plan = replace(PLANS[name], speed=SPEED, margin=0.0)
    whole = fly(scene, plan, np.random.default_rng(seed)).duration * SPEED
    plan = replace(
        plan, shuttle=True, turning=1.0, duration=LENGTH,
        margin=min(8.0, (LENGTH / 2.0 * SPEED - whole) / 2.0),
    )
    sink = Recorder()
    simulate_flight(scene, sink, np.random.default_rng(seed), Flight(plan=plan))
    truth = fly(scene, plan, np.random.default_rng(seed))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(pickle.dumps((sink.events, truth)))
    return Recorded(sink.events, truth)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What came of a flight."""

    spans: Sequence[Any]
    hazards: Sequence[Any]
    doubled: float
    poor: bool
    restarts: int
    told: list[str]
    true: np.ndarray
    """(N, 3) true places of the vehicle [m]."""
    off: np.ndarray
    """(N, 3) by which the map is off there [m]."""

    def shift(self, points: np.ndarray) -> np.ndarray:
        """Return by how much the map is off where the vehicle was first near points (K, 3)."""
        nearest = cKDTree(self.true[:: 20, :2]).query(points[:, :2])[1] * 20
        result: np.ndarray = self.off[nearest]
        return result


def put_together(flight: Recorded, change: Change, bare: bool = False) -> Found:
    """Put a flight into a map, and look for lines."""
    accumulator, book = Accumulator(Settings(), recorded=True), SharpnessBook()
    if bare:
        accumulator.follower.take = lambda scan: iter([scan])  # type: ignore[method-assign]
        PoseWatch.see = lambda *rest: None  # type: ignore[method-assign, assignment]
    track: list[np.ndarray] = []
    at: list[float] = []
    waiting: list[np.ndarray] = []
    for event in flight.events:
        stamp = 1_000_000_000_000 + round(event[0] * 1e9)
        if len(event) == 4:
            place = change(event[0], event[1])
            if place is not None:
                accumulator.add_pose(stamp, place, event[2], frame_id='odom', now=event[0])
                if not accumulator.follower.watch.frozen:
                    waiting.append(place)
                    at.append(event[0])
                if not accumulator.follower.waits:
                    track += [accumulator.follower.move.apply(item) for item in waiting]
                    waiting.clear()
        else:
            accumulator.add_scan(stamp, event[1], event[2], frame_id='lidar', now=event[0])
            book.add(accumulator.meter.take())
    accumulator.finish()
    track += [accumulator.follower.move.apply(item) for item in waiting]
    points = accumulator.map.centroids()
    result = Pipeline(Settings()).run(points)
    poor = book.judge().poor or bool(accumulator.doubt)
    times = np.array(at)
    true = flight.truth.interpolate(times)[0]
    off = np.array(track) - true
    parts = accumulator.follower.parts
    begin = max([(part.begin_ns - 10**12) * 1e-9 for part in parts if not part.aligned] or [0.0])
    first = times > begin if begin else times < LENGTH / 2.0
    return Found(
        spans=result.spans, hazards=() if poor else result.hazards, poor=poor,
        doubled=measure_doubling(times[times > begin], true[times > begin], off[times > begin]),
        restarts=accumulator.entry.num_restarts, told=[part.describe() for part in parts],
        true=true[first], off=off[first],
    )


def measure_doubling(times: np.ndarray, true: np.ndarray, off: np.ndarray) -> float:
    """Return how far the map is off otherwise when the vehicle is back at a place [m]."""
    steps = np.arange(0, len(times), 20)
    worst = 0.0
    for n in steps:
        apart = np.hypot(*(true[:, :2] - true[n, :2]).T)
        first = np.flatnonzero((apart < BACK) & (times < times[n] - 5.0))
        if len(first):
            same = first[apart[first].argmin()]
            worst = max(worst, float(np.linalg.norm(off[n] - off[same])))
    return worst


def make_faults(seed: int) -> dict[str, Change]:
    """Return the faults of one flight: sizes, directions and times are of the seed."""
    rng = np.random.default_rng(seed)

    def draw_way() -> np.ndarray:
        way = rng.normal(size=3) * (1.0, 1.0, 0.5)
        return way / np.linalg.norm(way)

    faults: dict[str, Change] = {'none': lambda t, p: p}
    for size in (0.1, 0.5, 2.0, 10.0):
        when, move = rng.uniform(12.0, LENGTH - 12.0), size * draw_way()
        faults[f'step of {size:g} m'] = (
            lambda t, p, when=when, move=move: p + move if t > when else p
        )
    for speed in (0.01, 0.03, 0.1):
        rate = speed * draw_way()
        faults[f'drift of {100 * speed:g} cm/s'] = lambda t, p, rate=rate: p + rate * t
    when = rng.uniform(12.0, LENGTH - 12.0)
    kept: dict[str, np.ndarray] = {}

    def freeze(t: float, p: np.ndarray) -> np.ndarray:
        if not when < t < when + 5.0:
            kept['last'] = p
        return kept['last']

    faults['frozen for 5 s'] = freeze
    return faults


def trace(spans: Sequence[Any]) -> np.ndarray:
    """Return points along spans, half a metre apart or nearer [m]."""
    parts = [span.positions(np.linspace(0, span.length, 2 + int(span.length * 2)))
             for span in spans]
    return np.concatenate([np.full((1, 3), 1e9), *parts])


def compare(found: Found, clean: Found) -> tuple[str, bool]:
    """Return what was found beside the flight without fault, and whether that is right."""
    known = trace(clean.spans)
    known = cKDTree(known + found.shift(known) - clean.shift(known))
    ghosts = sum(bool(np.median(known.query(trace([s])[1:])[0]) > NEAR) for s in found.spans)
    critical = [[h for h in item.hazards if h.severity == Severity.CRITICAL]
                for item in (found, clean)]
    places = np.array([h.position for h in clean.hazards] or [[1e9] * 3])
    places = places + found.shift(places) - clean.shift(places)
    false = sum(
        float(np.linalg.norm(places - h.position, axis=1).min()) > SAME
        for h in critical[0]
    )
    text = (
        f'{len(found.spans)} spans for {len(clean.spans)}, {ghosts} elsewhere, '
        f'doubled {found.doubled:.2f} m, {len(critical[0])} criticals for {len(critical[1])}, '
        f'{false} false'
        f'{", held back" if found.poor else ""}'
        f'{f", {found.restarts} times anew" if found.restarts else ""}'
    )
    return text, found.doubled < 0.2 and not false


def main() -> int:
    """Fly, and print a row for each fault of each flight."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', help='parts of the names of the faults; all')
    parser.add_argument('--scenes', nargs='+', default=SCENES)
    parser.add_argument('--seeds', nargs='+', type=int, default=SEEDS)
    parser.add_argument('--cache', type=Path, help='where simulated flights are kept')
    parser.add_argument('--bare', action='store_true')
    parser.add_argument('--say', action='store_true', help='print what was said, too')
    arguments = parser.parse_args()
    wrong = 0
    for seed in arguments.seeds:
        for name in arguments.scenes:
            flight = record(name, seed, arguments.cache)
            clean = None
            for fault, change in make_faults(seed).items():
                if fault != 'none' and arguments.names and not any(
                    part in fault for part in arguments.names
                ):
                    continue
                found = put_together(flight, change, arguments.bare)
                clean = clean or found
                text, good = compare(found, clean)
                wrong += not good
                print(f'{name} {seed} | {fault} | {text}', flush=True)
                if arguments.say:
                    print(*[f'    {line}' for line in found.told], sep='\n', flush=True)
                    print('    critical:', *[
                        f'{h.kind.name} {h.clearance:.2f} of {h.required:.2f} at '
                        f'{h.position.round(1).tolist()}' for h in found.hazards
                        if h.severity == Severity.CRITICAL
                    ], sep='\n        ')
    print(f'{wrong} not as they should be')
    return 0


if __name__ == '__main__':
    sys.exit(main())
