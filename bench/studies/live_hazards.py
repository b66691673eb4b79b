# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies simulated flights tick by tick in memory, and compares hazards told live with the final ones.

The same flights as ``bench/live/hazard_flights.py``, without DDS and processes: each has the same
ticks in every run, and takes less than a minute of one core.  A tick sees the map as it was when
it began, and what it found counts ``--delay`` seconds of flight later, as on a busy machine.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common.tables import render_table
from flights.faulty_flights import EPOCH_NS, Pose, record
from live.hazard_flights import NEAR, VARIANTS

from plc_inspect.config import Settings
from plc_inspect.core.live.map_labels import make_planner
from plc_inspect.core.live.owed_cells import OwedCells
from plc_inspect.core.live.session import LiveState, Session, Tick
from plc_inspect.core.live.window import copy_window, Window, WindowPlanner
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.mapping.eviction import Evictor
from plc_inspect.core.mapping.flown_way import FlownWay
from plc_inspect.results import Hazard
from plc_inspect.setting_names import update
from plc_inspect.sim.surveys.flight import Flight
from plc_inspect.sim.surveys.planted import plant
from plc_inspect.sim.surveys.puck import Puck
from plc_inspect.sim.surveys.trajectory import FlightPlan

COLUMNS = ('seed', 'settings', 'raised live', 'final', 'taken back with a reason',
           'neither', 'late', 'never raised, though near', 'never near')


@dataclass(slots=True)
class Told:
    """What was told of one hazard."""

    nearest: float = np.inf
    """Least distance of the vehicle while it stood [m]."""
    reason: str = ''
    """Why it was taken back last."""


@dataclass(slots=True)
class Vehicle:
    """A map that grows, and what is told of it."""

    settings: Settings
    accumulator: Accumulator = field(init=False)
    evictor: Evictor = field(init=False)
    planner: WindowPlanner = field(init=False)
    session: Session = field(default_factory=Session)
    way: FlownWay = field(default_factory=FlownWay)
    owed: OwedCells = field(default_factory=OwedCells)
    state: LiveState | None = None
    place: np.ndarray | None = None
    track: list[np.ndarray] = field(default_factory=list)
    told: dict[int, Told] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin with an empty map."""
        self.accumulator = Accumulator(self.settings)
        self.evictor = Evictor(self.accumulator.map)
        self.planner = make_planner(self.settings)

    def look(self) -> tuple[Window, Tick] | None:
        """Run a tick over the map as it is; None where nothing is new."""
        spans = [item.span for item in self.state.spans] if self.state else []
        ground = bool(self.state and self.state.around.ground)
        plan = self.planner.plan(
            self.accumulator.map, spans, self.place, at_once=False, ground=ground,
            waiting=self.state.awaited if self.state else None,
        )
        if plan is None:
            return None
        self.owed.begin(self.accumulator.map.cells.index[plan.fresh])
        window = next(item for item in copy_window(self.accumulator.map, plan) if item is not None)
        self.session.way = self.way.places
        return window, self.session.tick(
            window, self.settings, self.place, None, self.accumulator.entry.meter.take()
        )

    def tell(self, window: Window, tick: Tick) -> None:
        """Take what a tick found."""
        self.state, num = tick.state, len(tick.labels)
        self.accumulator.map.label(window.slots[:num], window.points[:num], tick.labels)
        self.owed.end(self.accumulator.map.cells)
        for hazard in tick.state.hazards:
            item = self.told.setdefault(hazard.hazard_id, Told())
            assert self.place is not None
            away = float(np.linalg.norm(self.place - hazard.position))
            item.nearest, item.reason = min(item.nearest, away), ''
        self.take_back(tick.state)

    def take_back(self, state: LiveState) -> None:
        """Note why hazards were taken back."""
        for hazard, reason in zip(state.news.cleared, state.news.reasons, strict=True):
            if hazard.hazard_id in self.told:
                self.told[hazard.hazard_id].reason = reason


def fly(seed: int, settings: Settings, seconds: float, delay: float) -> tuple[Vehicle, LiveState]:
    """Fly once; return the vehicle and what the whole map tells at the end."""
    flight = record(None, lambda: (plant(seed)[0], Flight(
        plan=FlightPlan(speed=7.0, lateral=6.0, height=4.0, duration=seconds), puck=Puck(rate=10.0)
    )), seed)
    vehicle, pending = Vehicle(settings), None
    due = flight.events[0].time + settings.segment.period
    for event in flight.events:
        stamp = EPOCH_NS + round(event.time * 1e9)
        if isinstance(event, Pose):
            vehicle.accumulator.add_pose(
                stamp, event.position, event.quaternion, frame_id='odom', now=event.time
            )
            if (move := vehicle.accumulator.follower.likely_move) is not None:
                vehicle.place = move.apply(np.array(event.position))
                vehicle.way.add(stamp, vehicle.place)
                vehicle.track.append(vehicle.place)
        else:
            vehicle.accumulator.add_scan(
                stamp, event.xyz, event.times, frame_id='lidar', now=event.time
            )
            vehicle.evictor.step(vehicle.place)
        if pending is not None and event.time >= pending[0]:
            vehicle.tell(*pending[1])
            pending = None
        if pending is None and event.time >= due and vehicle.place is not None:
            due = max(due + settings.segment.period, event.time)
            found = vehicle.look()
            pending = None if found is None else (event.time + delay, found)
    if pending is not None:
        vehicle.tell(*pending[1])
    vehicle.accumulator.finish()
    vehicle.session.way = vehicle.way.places
    state, _, _ = vehicle.session.conclude(
        vehicle.accumulator.map.centroids(), settings, 0, complete=vehicle.evictor.complete,
        looks=vehicle.accumulator.entry.meter.take(),
    )
    vehicle.take_back(state)
    return vehicle, state


def compare(vehicle: Vehicle, final: dict[int, Hazard]) -> tuple[list[int], list[str]]:
    """Return the figures of COLUMNS from the third on, and what is wrong in words."""
    track, told = np.array(vehicle.track), vehicle.told
    near = {
        number for number, hazard in final.items()
        if np.linalg.norm(track - hazard.position, axis=1).min() <= NEAR
    }
    gone = [item for number, item in told.items() if number not in final]
    late = [number for number in near if number in told and told[number].nearest > NEAR]
    missed = [final[number] for number in near if number not in told]
    words = [f'late: raised at {told[number].nearest:.1f} m' for number in late]
    words += [
        f'never raised: {item.severity.name.lower()} {item.kind.name.lower()} '
        f'{item.clearance:.2f} m of {item.required:.2f} at {item.position.round(0).tolist()}'
        for item in missed
    ]
    return [
        len(told), len(final), sum(bool(item.reason) for item in gone),
        sum(not item.reason for item in gone), len(late), len(missed), len(final) - len(near),
    ], words


def main(argv: Sequence[str] | None = None) -> int:
    """Fly, print the table; exit 1 where live and final do not agree."""
    parser = argparse.ArgumentParser(description='Hazards told live against the final ones.')
    parser.add_argument('--flights', type=int, default=20, metavar='N')
    parser.add_argument('--seed', type=int, default=0, help='of flight 0')
    parser.add_argument('--seconds', type=float, default=60.0, help='length of a flight')
    parser.add_argument('--delay', type=float, default=0.3, help='of what a tick found [s]')
    arguments = parser.parse_args(argv)
    rows, wrong = [], 0
    for seed in range(arguments.seed, arguments.seed + arguments.flights):
        changes = dict(item.split(':=') for item in VARIANTS[seed % len(VARIANTS)])
        settings = update(Settings(), {name: float(value) for name, value in changes.items()})
        vehicle, state = fly(seed, settings, arguments.seconds, arguments.delay)
        figures, words = compare(vehicle, {item.hazard_id: item for item in state.hazards})
        wrong += sum(figures[3:6])
        rows.append((str(seed), ', '.join(VARIANTS[seed % len(VARIANTS)]) or 'as they are',
                     *map(str, figures)))
        print(' | '.join(rows[-1]), *words, sep='\n    ', flush=True)
    total = np.array([[int(value) for value in row[2:]] for row in rows]).sum(axis=0)
    print('\n' + render_table(COLUMNS, [*rows, ('all', '', *map(str, total.tolist()))]))
    return int(wrong > 0)


if __name__ == '__main__':
    sys.exit(main())
