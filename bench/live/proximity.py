# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How near the vehicle is told to be to conductors, against the truth of simulated flights.

Each flight passes a scene at a side, a height and a speed of its own, or closes in on the
conductors, crosses below them, or runs past a stretch of them that nothing returns from; a tick is
due each second and its result is there a while later, as in the node.  Printed for each flight:
errors of distance and place where the truth is below RANGE, entries into the critical sphere of
conductors that had been seen for a second, those that were missed, critical messages without
any conductor there, and how often an alarm begins: by levels as measured, and as they are told.
"""

import argparse
from collections.abc import Sequence
import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
import sys

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.tables import render_table

from plc_inspect.config import Settings
from plc_inspect.core.live.held_levels import HeldLevels
from plc_inspect.core.live.map_labels import make_planner
from plc_inspect.core.live.motion import Motion
from plc_inspect.core.live.proximity import Level, measure_proximity, Proximity
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
from plc_inspect.sim.surveys.trajectory import fly as fly_path

FLIGHTS = ('demo', 'low_voltage', 'medium_voltage', 'bundles', 'angle', 'crossing', 'street',
           'high_voltage:close', 'double_circuit:under', 'hidden:beyond')
"""Scenes and how they are flown, past unless said otherwise."""
PERIOD, DELAY = 1.0, 0.4
"""Between two ticks, and from the copy of the map to the result [s]."""
EVERY = 5
"""Poses from one message to the next: 20 Hz."""
RANGE = 30.0
"""Distances up to this are compared [m]."""
SEEN_FOR, SEEN_NEAR = 1.0, 3.0
"""
A place of a conductor had been seen: returns over so long [s], so near along it [m], the last of
them before the tick that could have known it.
"""
ON_CONDUCTOR = 0.5
"""What is told of as an obstacle so near to a true conductor is it [m]."""
MARGIN = 0.3
"""Of the critical distance, to either side, that neither counts as missed nor as false [m]."""
MOST_ERROR = 0.3
"""95 of 100 distances of all flights are to be nearer to the truth [m]."""


@dataclass
class Watcher:
    """Takes a flight as the node does, and keeps what it would have told."""

    scene: Scene
    settings: Settings
    accumulator: Accumulator = field(init=False)
    session: Session = field(default_factory=Session)
    motion: Motion = field(default_factory=Motion)
    levels: HeldLevels = field(default_factory=HeldLevels)
    around: Surroundings = field(default_factory=Surroundings)
    coming: list[tuple[float, int, Surroundings]] = field(default_factory=list)
    told: list[tuple[float, int, np.ndarray, tuple[Proximity, ...]]] = field(default_factory=list)
    """Time, place in the path, position by the odometry and what was told there."""
    held: list[tuple[Proximity, ...]] = field(default_factory=list)
    """As told, with levels that fall late."""
    seen: list[tuple[float, int, float]] = field(default_factory=list)
    """Time, conductor and distance along it of returns, one a metre and scan."""
    due: float = 0.0
    known: int = 0
    """Newest insertion that a tick has looked at."""

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
        move = self.accumulator.follower.likely_move
        vehicle = np.full(3, np.nan) if move is None else move.apply(position)
        if move is not None:
            self.motion.add(stamp, vehicle)
        while self.coming and self.coming[0][0] <= time:
            _, self.known, self.around = self.coming.pop(0)
        if time >= self.due:
            self.due = time + PERIOD
            self._tick(time, vehicle)
        if index % (EVERY * 2) == 0:
            around = Surroundings() if move is None else self.around
            seen = around.is_seen(
                self.accumulator.map.cells, vehicle, self.settings.proximity.warning,
                self.settings.height.beta,
            )
            entry = self.accumulator.entry
            fresh = entry.near.find(
                vehicle, self.settings.proximity.critical, entry.map.cells, self.known,
                self.around.may_hold_ground(self.motion.velocity),
            )
            found = measure_proximity(
                around, seen, vehicle, self.motion.velocity, self.settings.proximity, fresh
            )
            self.held.append(self.levels.hold(found, stamp, vehicle, self.settings.proximity))
            if move is not None:  # they are told in the frame of the odometry
                back = move.inverse()
                found = tuple(replace(item, position=back.apply(item.position)) for item in found)
            self.told.append((time, index, position.copy(), found))

    def _tick(self, time: float, position: np.ndarray) -> None:
        voxels = self.accumulator.map
        spans = [item.span for item in self.session.state.spans]
        plan = self._planner.plan(
            voxels, spans, position, ground=self.session.state.around.ground is True
        )
        if plan is None:
            return
        window = next(item for item in copy_window(voxels, plan) if item is not None)
        done = self.session.tick(window, self.settings, position)
        voxels.label(window.slots, window.points, done.labels)
        self.coming.append((time + DELAY, done.state.sequence, done.state.around))


def _to_quaternion(rpy: np.ndarray) -> tuple[float, float, float, float]:
    from scipy.spatial.transform import Rotation

    return tuple(Rotation.from_matrix(rotate(rpy[None])[0]).as_quat())


@dataclass(frozen=True, slots=True)
class Figures:
    """What one flight gave."""

    errors: np.ndarray
    """Of distances [m]."""
    apart: np.ndarray
    """From the place told to the true one, as an angle seen from the vehicle [rad]."""
    silent: int
    """Messages that tell of no conductor yet where one had been seen for a second."""
    entries: int
    missed: int
    false: int
    unknown: float
    """Share of the messages that say unknown."""
    alarms: int
    """Times at which a thing became critical, as measured."""
    alarms_told: int


def judge(watcher: Watcher, path: np.ndarray, truth: dict, critical: float) -> Figures:
    """
    Compare what was told with the truth.

    True distances are from the true path (N, 3) to the true conductors: what the odometry drifts
    by moves the vehicle and what it has just seen alike.  Only which thing was told of is looked
    up in the frame of the odometry.
    """
    curves = []
    for item in watcher.scene.conductors:
        places = item.sample(0.1)
        curves.append((np.linspace(0.0, item.length, len(places)), places))
    seen = np.array(watcher.seen).reshape(-1, 3)
    tree = cKDTree(np.vstack([draw(span) for span in truth['spans']]))
    errors, apart, silent, entries, missed, false = [], [], 0, 0, 0, 0
    inside = [False] * len(curves)
    for time, index, odometry, found in watcher.told:
        position = path[index]
        past = seen[seen[:, 0] <= time]
        nearest, known, place = np.inf, np.inf, position
        is_critical = any(item.level == Level.CRITICAL for item in found)
        for number, (x, places) in enumerate(curves):
            away = np.linalg.norm(places - position, axis=1)
            at = int(np.argmin(away))
            nearest = min(nearest, away[at])
            own = past[(past[:, 1] == number) & (np.abs(past[:, 2] - x[at]) <= SEEN_NEAR), 0]
            if not len(own) or own.max() - own.min() < SEEN_FOR:
                inside[number] = False
                continue
            if away[at] < known:
                known, place = away[at], places[at]
            enters = away[at] < critical - MARGIN
            if enters and not inside[number]:
                entries += 1
                missed += not is_critical
            inside[number] = enters
        told = found[0]
        false += told.level == Level.CRITICAL and nearest > critical + MARGIN
        if known <= RANGE and known == nearest:
            # a conductor that was not found yet may be told of as an obstacle
            held = [item for item in found if item is told or (
                np.isfinite(item.distance) and tree.query(item.position)[0] <= ON_CONDUCTOR
            )]
            held = [item for item in held if np.isfinite(item.distance)]
            if not held:
                silent += 1
                continue
            told = min(held, key=lambda item: item.distance)
            errors.append(abs(told.distance - known))
            way, true = told.position - odometry, place - position
            cosine = way @ true / np.linalg.norm(way) / np.linalg.norm(true)
            apart.append(np.arccos(np.clip(cosine, -1.0, 1.0)))
    unknown = np.mean([found[0].level == Level.UNKNOWN for *_, found in watcher.told])
    return Figures(
        np.array(errors), np.array(apart), silent, entries, missed, false, float(unknown),
        count_alarms([found for *_, found in watcher.told]), count_alarms(watcher.held),
    )


def draw(span: dict) -> np.ndarray:
    """Return (N, 3) places of a true span in the frame of the odometry [m]."""
    x = np.arange(0.0, span['length'], 0.1)
    start, end = np.array(span['start']), np.array(span['end'])
    places = start + (x / span['length'])[:, None] * (end - start)
    places[:, 2] = catenary_heights(span['a'], span['b'], span['c'], x)
    return places


def count_alarms(told: Sequence[tuple[Proximity, ...]]) -> int:
    """Return how often things became critical."""
    levels = np.array([[item.level for item in found] for found in told]) == Level.CRITICAL
    return int((levels & ~np.vstack((np.zeros_like(levels[:1]), levels[:-1]))).sum())


def plan_flight(scene: Scene, how: str, rng: np.random.Generator, duration: float) -> FlightPlan:
    """Return a flight past a scene, or one that comes near."""
    speed = float(rng.uniform(3.0, 10.0))
    if not how:
        return FlightPlan(
            speed=speed, lateral=float(rng.uniform(-15.0, 15.0)),
            height=float(rng.uniform(4.0, 12.0)), duration=duration,
        )
    line = [item for item in scene.conductors if item.span_id == 1]
    ends = np.array([(item.start, item.end) for item in line])
    start, end = ends[:, 0].mean(axis=0), ends[:, 1].mean(axis=0)
    along = (end - start)[:2] / np.linalg.norm((end - start)[:2])
    left = np.array([-along[1], along[0]])
    outer = max(float((item.start[:2] - start[:2]) @ left) for item in line)
    lowest = min(float(item.sample(1.0)[:, 2].min()) for item in line)
    highest = max(float(item.sample(1.0)[:, 2].max()) for item in line)

    def place(share: float, across: float, height: float) -> tuple[float, float, float]:
        xy = start[:2] + share * (end - start)[:2] + across * left
        return float(xy[0]), float(xy[1]), height

    if how == 'close':  # from the side until it is inside, and away again
        ways = [place(0.0, outer + 35.0, highest), place(0.4, outer + 25.0, lowest + 2.0),
                place(0.6, outer + 5.0, lowest + 2.0), place(0.9, outer + 30.0, highest)]
    elif how == 'under':
        ways = [place(0.2, outer + 40.0, lowest - 4.0), place(0.5, outer + 20.0, lowest - 4.0),
                place(0.55, -outer - 20.0, lowest - 4.0), place(0.8, -outer - 40.0, lowest)]
    else:  # along, and on where nothing returns
        ways = [place(-0.2, outer + 12.0, highest + 3.0), place(0.2, outer + 12.0, lowest + 3.0),
                place(0.7, outer + 6.0, lowest + 2.0)]
    return FlightPlan(speed=min(speed, 6.0), waypoints=tuple(ways), duration=duration)


def fly(flight: str, seed: int, settings: Settings, duration: float) -> Figures:
    """Fly past a scene at a side, height and speed that the seed draws."""
    name, _, how = flight.partition(':')
    rng = np.random.default_rng([seed, *flight.encode()])
    scene = make_scene(name, seed)
    plan = plan_flight(scene, how, rng, duration)
    watcher = Watcher(scene, settings)
    path = fly_path(scene, plan, copy.deepcopy(rng)).position  # what is drawn of it first
    truth = simulate_flight(scene, watcher, rng, Flight(plan=plan, puck=Puck()))
    return judge(watcher, path, truth, settings.proximity.critical)


def join(flights: Sequence[Figures]) -> Figures:
    """Return the figures of all flights together."""
    return Figures(
        *(np.concatenate([getattr(item, name) for item in flights])
          for name in ('errors', 'apart')),
        *(sum(getattr(item, name) for item in flights)
          for name in ('silent', 'entries', 'missed', 'false')),
        float(np.mean([item.unknown for item in flights])),
        *(sum(getattr(item, name) for item in flights) for name in ('alarms', 'alarms_told')),
    )


def describe(name: str, found: Figures) -> tuple[str, ...]:
    """Return the row of a flight, or of all."""
    p50, p95 = np.quantile(found.errors, (0.5, 0.95)) if len(found.errors) else (0.0, 0.0)
    turned = np.degrees(np.quantile(found.apart, 0.95)) if len(found.apart) else 0.0
    return (
        name, f'{len(found.errors)}', f'{p50:.2f}', f'{p95:.2f}', f'{turned:.1f}',
        f'{found.silent}', f'{found.entries}', f'{found.missed}', f'{found.false}',
        f'{found.unknown:.0%}', f'{found.alarms}', f'{found.alarms_told}',
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Fly the scenes; return 1 where a figure of all flights together misses its limit."""
    parser = argparse.ArgumentParser(description='Distances to conductors against the truth.')
    parser.add_argument('--flights', nargs='*', default=FLIGHTS, metavar='NAME')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--duration', type=float, default=40.0, metavar='S')
    arguments = parser.parse_args(argv)
    settings, rows, flights = Settings(), [], []
    for name in arguments.flights:
        flights.append(fly(name, arguments.seed, settings, arguments.duration))
        rows.append(describe(name, flights[-1]))
        print(' | '.join(rows[-1]), flush=True)
    together = join(flights)
    print(render_table(
        ('flight', 'distances', 'error p50 [m]', 'p95 [m]', 'direction p95 [deg]', 'none yet',
         'entries', 'missed', 'false', 'unknown', 'alarms measured', 'told'),
        [*rows, describe('all', together)],
    ))
    good = np.quantile(together.errors, 0.95) < MOST_ERROR
    return int(not good or together.missed > 0 or together.false > 0)


if __name__ == '__main__':
    sys.exit(main())
