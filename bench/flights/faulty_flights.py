# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated flights in memory, put into a map as they are or with faults, and what comes of it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import pickle
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from plc_inspect.config import Settings
from plc_inspect.core.alignment.pose_watch import PoseWatch
from plc_inspect.core.extraction.dust import describe_air
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.mapping.flown_way import FlownWay
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.setup.plumb import measure_leans, PlumbBook
from plc_inspect.core.setup.sharpness import SharpnessBook
from plc_inspect.results import Severity
from plc_inspect.sim.scenes.scene import Label, Scene
from plc_inspect.sim.surveys.airborne import simulate_map
from plc_inspect.sim.surveys.flight import Flight, simulate_flight
from plc_inspect.sim.surveys.puck import Scan
from plc_inspect.sim.surveys.trajectory import fly, RATE, rotate, Trajectory

NEAR = 0.5
"""Distance within which a span lies where one of the flight without fault does [m]."""
BACK = 3.0
"""Places of the vehicle this near to each other in plan are the same [m]."""
SAME, NEARER = 5.0, 0.3
"""
A critical hazard is false where the flight without fault has none this near that is critical, too,
or by no more than the second less close to a conductor [m], and nothing is there in truth.
"""
THERE = 1.0
"""
Something is there in truth that is this near to the place of a hazard, and as near to a conductor
as it says, or by no more than NEARER farther [m].
"""
DENSITY = 100.0
"""Pulses per square metre of the survey that tells what stands in a scene."""
EPOCH_NS = 10**12
"""Stamp at the beginning of a flight [ns]."""


class Pose(NamedTuple):
    """A pose of the odometry."""

    time: float
    position: np.ndarray
    quaternion: np.ndarray


class Turn(NamedTuple):
    """A scan."""

    time: float
    """Of its stamp [s]."""
    xyz: np.ndarray
    times: np.ndarray
    lead: float = 0.0
    """By which its stamp is ahead of its time [s]."""


Event = Pose | Turn
Fault = Callable[[Event], Iterator[Event]]


@dataclass(eq=False)
class Recorder:
    """Takes a simulated flight."""

    events: list[Event] = field(default_factory=list)

    def write_scan(self, scan: Scan) -> None:
        """Take a scan."""
        rows = scan.points.ravel()
        xyz = np.column_stack([rows[axis] for axis in 'xyz']).astype(np.float32)
        self.events.append(Turn(scan.stamp, xyz, rows['time'].astype(np.float64)))

    def write_odometry(self, odometry: Trajectory, index: int) -> None:
        """Take a pose."""
        turn = Rotation.from_matrix(rotate(odometry.rpy[index][None])[0]).as_quat()
        self.events.append(Pose(odometry.start + index / RATE, odometry.position[index], turn))


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A flight, and where the vehicle truly was."""

    events: list[Event]
    truth: Trajectory


def record(path: Path | None, make: Callable[[], tuple[Scene, Flight]], seed: int) -> Recorded:
    """Simulate a flight, or read it from a file; it is written there."""
    if path is not None and path.exists():
        return Recorded(*pickle.loads(path.read_bytes()))
    scene, flight = make()
    assert flight.plan is not None
    sink = Recorder()
    simulate_flight(scene, sink, np.random.default_rng(seed), flight)
    truth = fly(scene, flight.plan, np.random.default_rng(seed))
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
    """Parts of the flight."""
    said: dict[str, float]
    """What was said by the kinds of KINDS, and when first [s]."""
    offset: float
    """By which scans are shifted at the end [s]."""
    true: np.ndarray
    """(N, 3) true places of the vehicle [m]."""
    off: np.ndarray
    """(N, 3) by which the map is off there [m]."""

    def shift(self, points: np.ndarray) -> np.ndarray:
        """Return by how much the map is off where the vehicle was first near points (K, 3)."""
        nearest = cKDTree(self.true[:: 20, :2]).query(points[:, :2])[1] * 20
        result: np.ndarray = self.off[nearest]
        return result


KINDS = {
    'clock': 'scans fit best', 'scale': 'positions of the odometry are about',
    'heading': 'the heading of the odometry', 'mount': 'with the lidar turned by',
    'aside': 'm/s aside', 'drift': 'odometry drifts:',
    'step': 'odometry stepped', 'stood': 'stood still', 'unsharp': 'map is not sharp',
    'repeated': 'are interpolated', 'coarse': 'single precision', 'otherwise': 'otherwise than',
    'lost': 'does not fit', 'dust': 'dusty air', 'plumb': 'is tilted',
    'overhead': 'the ground lies above',
}
"""What may be said, and words by which it is told."""


def put_together(flight: Recorded, fault: Fault, *, bare: bool = False) -> Found:
    """Put a flight into a map, and look for lines; ``bare`` does not correct the odometry."""
    accumulator, book = Accumulator(Settings(), recorded=True), SharpnessBook()
    if bare:
        accumulator.follower.take = lambda scan: iter([scan])  # type: ignore[method-assign]
        PoseWatch.see = lambda *rest: None  # type: ignore[method-assign, assignment]
    track: list[np.ndarray] = []
    at: list[float] = []
    waiting: list[np.ndarray] = []
    last: np.ndarray | None = None
    said: dict[str, float] = {}
    way = FlownWay()
    for event in (changed for given in flight.events for changed in fault(given)):
        stamp = EPOCH_NS + round(event.time * 1e9)
        if isinstance(event, Pose):
            accumulator.add_pose(
                stamp, event.position, event.quaternion, frame_id='odom', now=event.time
            )
            if last is None or not np.array_equal(event.position, last):
                waiting.append(event.position)
                at.append(event.time)
            last = event.position  # where it is told again the vehicle may be elsewhere
            if not accumulator.follower.waits:
                track += [accumulator.follower.move.apply(item) for item in waiting]
                waiting.clear()
                way.add(stamp, accumulator.follower.move.apply(event.position))
            continue
        accumulator.add_scan(
            stamp + round(event.lead * 1e9), event.xyz, event.times, frame_id='lidar',
            now=event.time,
        )
        book.add(accumulator.entry.meter.take())
        texts = [
            accumulator.timing.describe(), accumulator.pose_gate.describe(), accumulator.doubt,
            book.judge().describe() if int(event.time * 10) % 10 == 0 else '',
            *[part.describe() for part in accumulator.follower.parts],
        ]
        for kind, words in KINDS.items():
            if kind not in said and any(words in text for text in texts):
                said[kind] = event.time
    accumulator.finish()
    track += [accumulator.follower.move.apply(item) for item in waiting]
    points = accumulator.map.centroids()
    plumb = PlumbBook()
    plumb.look(points, way.places[:, 1:])
    sharpness = plumb.judge(book.judge())
    spans: Sequence[Any] = ()
    hazards: Sequence[Any] = ()
    if sharpness.useless:
        said['overhead'] = event.time
    if not sharpness.hopeless:
        result = Pipeline(Settings(), way=way.places[:, 1:]).run(points)
        spans, hazards = result.spans, result.hazards
        plumb.add(measure_leans(points, result))
        sharpness = plumb.judge(book.judge())
        if sharpness.doubt or sharpness.remark:
            said['plumb'] = event.time
        if describe_air(result.stages):
            said['dust'] = event.time
    poor = sharpness.poor or bool(accumulator.doubt)
    times = np.array(at)
    true = flight.truth.interpolate(times)[0]
    off = np.array(track) - true
    parts = accumulator.follower.parts
    begin = max([(part.begin_ns - EPOCH_NS) * 1e-9 for part in parts if not part.aligned] or [0])
    first = times >= begin if begin else times < flight.truth.duration / 2.0
    mapped = times >= begin
    return Found(
        spans=spans, hazards=() if poor else hazards, poor=poor,
        doubled=measure_doubling(times[mapped], true[mapped], off[mapped]),
        restarts=accumulator.entry.num_restarts, told=[part.describe() for part in parts],
        said=said, offset=accumulator.timing.offset, true=true[first], off=off[first],
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


def trace(spans: Sequence[Any]) -> np.ndarray:
    """Return points along spans, half a metre apart or nearer [m]."""
    parts = [span.positions(np.linspace(0, span.length, 2 + int(span.length * 2)))
             for span in spans]
    return np.concatenate([np.full((1, 3), 1e9), *parts])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """What is in a scene, in the world."""

    conductors: np.ndarray
    """(N, 3) points along all conductors [m]."""
    things: np.ndarray
    """(M, 3) points on what is no part of a line, ground included [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """What was found beside the flight without fault."""

    spans: int
    known: int
    """Spans without the fault."""
    ghosts: int
    """Spans that lie elsewhere."""
    covered: float
    """Share of the length found."""
    criticals: int
    false: int
    """Critical hazards where there is none without the fault, nor in truth."""


def compare(found: Found, clean: Found, truth: Truth) -> Difference:
    """
    Compare a flight with the same without fault.

    Spans are ghosts where no conductor hangs in truth.
    """
    hung = cKDTree(truth.conductors + found.shift(truth.conductors))
    known = trace(clean.spans)[1:]
    known = known + found.shift(known) - clean.shift(known)
    own = cKDTree(trace(found.spans))
    places = np.array([h.position for h in clean.hazards]).reshape(-1, 3)
    places = places + found.shift(places) - clean.shift(places)
    critical = [h for h in found.hazards if h.severity == Severity.CRITICAL]
    fresh = [h for h in critical if not any(
        h.kind == other.kind and np.linalg.norm(place - h.position) < SAME
        and (other.severity == h.severity or other.clearance < h.clearance + NEARER)
        for place, other in zip(places, clean.hazards, strict=True)
    )]
    if fresh:  # millions of points, that most flights do not need
        things = cKDTree(truth.things + found.shift(truth.things))
        fresh = [h for h in fresh if not is_there(h, things, hung)]
    return Difference(
        spans=len(found.spans), known=len(clean.spans),
        ghosts=sum(bool(np.median(hung.query(trace([s])[1:])[0]) > NEAR) for s in found.spans),
        covered=float((own.query(known)[0] < NEAR).mean()) if len(known) else 1.0,
        criticals=len(critical),
        false=len(fresh),
    )


def is_there(hazard: Any, things: cKDTree, hung: cKDTree) -> bool:
    """Tell whether something stands at a hazard that is as near to a conductor as it says."""
    near = things.data[things.query_ball_point(hazard.position, THERE)]
    return bool(len(near)) and hung.query(near)[0].min() <= hazard.clearance + NEARER


def tell_truth(scene: Scene) -> Truth:
    """Return the truth of a scene."""
    cloud = simulate_map(scene, DENSITY, np.random.default_rng(scene.seed))
    return Truth(
        conductors=np.concatenate([
            np.full((1, 3), 1e9), *[item.sample(0.5) for item in scene.conductors]
        ]),
        things=cloud.exact[~np.isin(cloud.label, (Label.WIRE, Label.TOWER))],
    )
