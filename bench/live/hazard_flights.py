# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies simulated flights past the node over DDS, and compares the hazards told live with the final.

Each flight is along a scene of ``plc_inspect.sim.surveys.planted``; node and player are processes
of their own in a domain of their own.  Every other flight is beside two programs that keep two
cores busy.  The settings go round: those of the node, ``hazards.warning_distance`` 12 and 30 m,
``corridor.radius`` 0.6 m.  A hazard that was raised live has to be in the results folder or to be
taken back with a reason; each of the results that the vehicle came within 50 m of
has to be raised while it was.  A flight of whose scans too few came into the map is void and
says nothing; what became of the others is told.
"""

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common.tables import render_table, replace_section
from node_load import Probe

from plc_inspect.offline.records.results_reader import read_table
from plc_inspect.ros.graph.domain import set_apart
from plc_inspect.ros.graph.transport import prepare_transport
from plc_inspect.sim.surveys.bag import open_bag
from plc_inspect.sim.surveys.flight import Flight, simulate_flight
from plc_inspect.sim.surveys.planted import plant
from plc_inspect.sim.surveys.puck import Puck
from plc_inspect.sim.surveys.trajectory import FlightPlan

PAGE = Path(__file__).parents[2] / 'docs/hazards.md'
VARIANTS: tuple[tuple[str, ...], ...] = (
    (), ('hazards.warning_distance:=12.0',), ('hazards.warning_distance:=30.0',),
    ('corridor.radius:=0.6',),
)
NEAR = 50.0
"""Within this of a hazard the vehicle has to be when it is raised [m]."""
NUM_BUSY = 2
START, SAVE = 300.0, 240.0
"""The node is up, and has ended with its results written, by then [s]."""
LEAST_TAKEN = 0.5
"""Share of its scans that must come into the map, or a flight is void."""
SETTLE = 4.0
"""Waited after the last scan [s]."""
TOLD = re.compile(r'hazard (\d+) (raised|cleared): (.*)')


@dataclass(slots=True, kw_only=True)
class Told:
    """What was told of one hazard."""

    text: str
    distance: float
    """Of the vehicle when it was first in ``~/hazards`` [m]."""
    nearest: float
    """The least distance of the vehicle while it stood [m]."""
    reason: str = ''
    """Why it was taken back last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """One flight."""

    seed: int
    busy: bool
    settings: tuple[str, ...]
    raised: int
    final: int
    taken_back: int
    """With a reason."""
    faults: tuple[str, ...]
    """Hazards raised that went without a reason, and those of the results not raised in time."""
    only_final: tuple[str, ...]
    """Hazards of the results that were never raised live, though the vehicle came near."""
    far: int
    """Hazards of the results to which it did not come near."""
    lost: int
    """Scans."""
    played: int
    """Scans of the recording."""
    inserted: int
    """Scans that came into the map."""
    dropped: tuple[str, ...]
    """Why scans that came in did not, and how many."""
    ticks: tuple[float, ...]
    """How long each tick took [s]."""
    distances: tuple[float, ...]
    """Of the vehicle when those of the results were raised [m]."""

    @property
    def void(self) -> bool:
        """Whether too few of its scans came into the map."""
        return self.inserted < LEAST_TAKEN * self.played


@dataclass(slots=True)
class Witness:
    """Listens to the hazards and to where the vehicle is."""

    told: dict[int, Told] = field(default_factory=dict)
    vehicle: Any = None
    read: Any = None
    track: list[Any] = field(default_factory=list)
    """Where the vehicle was [m]."""

    def subscribe(self, probe: Probe) -> None:
        """Listen by the node of a probe."""
        from nav_msgs.msg import Odometry
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import PointCloud2

        from plc_inspect.messages.rows import read_rows
        from plc_inspect.ros.graph.qos import RESULTS

        self.read = read_rows
        probe.node.create_subscription(PointCloud2, '/plc_inspect/hazards', self._hear, RESULTS)
        probe.node.create_subscription(Odometry, '/odometry', self._move, qos_profile_sensor_data)

    def _move(self, message: Any) -> None:
        place = message.pose.pose.position
        self.vehicle = np.array([place.x, place.y, place.z])
        self.track.append(self.vehicle)

    def _hear(self, message: Any) -> None:
        if self.vehicle is None:
            return
        for row in self.read(message):
            away = float(np.linalg.norm(
                self.vehicle - [float(row['x']), float(row['y']), float(row['z'])]))
            known = self.told.setdefault(int(row['id']), Told(
                text=f'kind {row["kind"]} {row["clearance"]:.2f} m, confidence'
                     f' {row["confidence"]:.2f}, at {row["x"]:.0f} {row["y"]:.0f}',
                distance=away, nearest=away,
            ))
            known.nearest = min(known.nearest, away)


def record(seed: int, folder: Path, seconds: float) -> int:
    """Simulate the flight of a seed into a bag; return its number of scans."""
    scene, _ = plant(seed)
    with open_bag(folder, 'flight') as writer:
        truth = simulate_flight(
            scene, writer, np.random.default_rng(seed),
            Flight(plan=FlightPlan(speed=7.0, lateral=6.0, height=4.0, duration=seconds),
                   puck=Puck(rate=10.0)),
        )
    return int(truth['num_scans'])


def fly(seed: int, busy: bool, settings: tuple[str, ...], seconds: float) -> Flown:
    """Record a flight, play it past the node and compare."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        room, out, log = Path(name), Path(name, 'out'), Path(name, 'log')
        played = record(seed, room, seconds)

        def start(*command: str, **options: Any) -> 'subprocess.Popen[bytes]':
            process = subprocess.Popen([sys.executable, *command], **options)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        sink = stack.enter_context(log.open('wb'))
        extra = [item for setting in settings for item in ('-p', setting)]
        node = start(
            '-m', 'plc_inspect.ros.node.onboard', '--ros-args', '--log-level', 'info', '-p',
            f'output.directory:={out}', '-p', 'output.record:=false', *extra,
            stdout=sink, stderr=subprocess.STDOUT,
        )
        probe, witness = Probe(node.pid, 10.0), Witness()
        stack.callback(probe.close)
        witness.subscribe(probe)
        deadline = time.monotonic() + START
        while not probe.ready:
            probe.executor.spin_once(timeout_sec=0.2)
            if node.poll() is not None or time.monotonic() > deadline:
                raise SystemExit(f'the node does not come up:\n{log.read_text()[-2000:]}')
        for _ in range(NUM_BUSY * busy):
            start('-c', 'while True: pass')
        player = start('-m', 'plc_inspect.ros.play', str(room), '--wait', '10', '--quiet')
        while player.poll() is None and node.poll() is None:
            probe.executor.spin_once(timeout_sec=0.2)
        end = time.monotonic() + SETTLE
        while time.monotonic() < end:
            probe.executor.spin_once(timeout_sec=0.2)
        node.send_signal(signal.SIGINT)
        code = node.wait(SAVE)
        sink.flush()
        if code or not out.is_dir():
            raise SystemExit(f'the node ended with {code}:\n{log.read_text()[-2000:]}')
        if failed := [line for line in log.read_text().splitlines() if ': failed in ' in line]:
            raise SystemExit(f'{len(failed)} callbacks of the node failed:\n{failed[0]}')
        final = {row['hazard_id']: row for row in read_table(out, 'hazards')['hazards']}
        flown = compare(seed, busy, settings, final, (probe, witness, log.read_text()))
        return replace(flown, played=played)


def compare(
    seed: int, busy: bool, settings: tuple[str, ...], final: dict[int, Any],
    heard: tuple[Probe, Witness, str],
) -> Flown:
    """Compare what was told live with the results."""
    probe, witness, log = heard
    told = witness.told
    for number, word, text in TOLD.findall(log):
        if int(number) not in told:  # the run at the end tells of them, too
            if int(number) in final:
                continue
            told[int(number)] = Told(text=text, distance=math.inf, nearest=math.inf)
        item = told[int(number)]
        item.reason = text.partition('; ')[2] if word == 'cleared' else ''
    faults, only_final, far = [], [], 0
    for number, item in told.items():
        if number not in final and not item.reason:
            faults.append(f'hazard {number} ({item.text}) is not in the results, without a reason')
        if (number in final and is_near(final[number], witness)
                and not item.nearest <= NEAR):
            faults.append(f'hazard {number} ({item.text}) was raised only at'
                          f' {item.nearest:.0f} m')
    for number, row in final.items():
        if not is_near(row, witness):
            far += 1
        elif number not in told:
            only_final.append(
                f'{row["severity"]} {row["kind"]} {row["clearance"]:.2f} m at'
                f' {[round(value) for value in row["position"]]}, {row["note"] or "no note"}')
    return Flown(
        seed=seed, busy=busy, settings=settings, raised=len(told), final=len(final),
        taken_back=sum(number not in final and bool(item.reason) for number, item in told.items()),
        faults=tuple(faults), only_final=tuple(only_final), far=far,
        lost=int(probe.values.get('scans lost', '0')),
        played=0, inserted=int(probe.values.get('scans inserted', '0')),
        dropped=tuple(f'{count} {name}' for name, count in sorted(probe.values.items())
                      if name.startswith('scans dropped: ')),
        ticks=tuple(1e-3 * milliseconds for _, milliseconds in probe.ticks),
        distances=tuple(item.distance for number, item in told.items() if number in final),
    )


def describe_ticks(flown: Flown) -> str:
    """Return how many ticks a flight had, and how long they took."""
    if not flown.ticks:
        return 'no tick'
    return f'{len(flown.ticks)} of {np.median(flown.ticks):.1f} s, at most {max(flown.ticks):.1f}'


def is_near(row: dict[str, Any], witness: Witness) -> bool:
    """Return whether the vehicle came near a hazard of the results."""
    away = np.linalg.norm(np.array(witness.track) - np.array(row['position']), axis=1)
    return float(away.min()) <= NEAR


def main(argv: Sequence[str] | None = None) -> int:
    """Fly, print the table; exit 1 where live and final do not agree."""
    parser = argparse.ArgumentParser(description='Hazards told live against the final ones.')
    parser.add_argument('--flights', type=int, default=20, metavar='N')
    parser.add_argument('--first', type=int, default=0, metavar='K', help='begin with the Kth')
    parser.add_argument('--seed', type=int, default=0, help='of flight 0')
    parser.add_argument('--seconds', type=float, default=60.0, help='length of a flight')
    parser.add_argument('--write', action='store_true', help='the table into docs/hazards.md')
    arguments = parser.parse_args(argv)
    prepare_transport()
    set_apart()
    flights = []
    for k in range(arguments.first, arguments.first + arguments.flights):
        # Each variant is flown by turns idle and busy.
        variant, busy = VARIANTS[k // 2 % len(VARIANTS)], bool(k % 2)
        flown = fly(arguments.seed + k, busy, variant, arguments.seconds)
        flights.append(flown)
        print(f'seed {flown.seed}{", busy" if busy else ""}: {flown.raised} raised live,'
              f' {flown.final} final, {flown.taken_back} taken back,'
              f' {len(flown.only_final)} only final, {flown.far} never near,'
              f' {flown.inserted} of {flown.played} scans taken, {flown.lost} lost,'
              f' {describe_ticks(flown)}{", void" if flown.void else ""}', flush=True)
        for line in (*flown.faults, *(f'only final: {text}' for text in flown.only_final),
                     *flown.dropped):
            print(f'  {line}', flush=True)
    text = f'{len(flights)} flights of {arguments.seconds:g} s.\n\n' + render_table(
        ('seed', 'settings', 'busy', 'raised live', 'final', 'taken back with a reason',
         'neither, or late', 'never raised, though near', 'never near',
         'farthest when raised [m]', 'scans taken', 'lost', 'ticks'),
        [
            (
                str(item.seed), ', '.join(item.settings) or 'as they are',
                'yes' if item.busy else 'no', str(item.raised), str(item.final),
                str(item.taken_back), str(len(item.faults)), str(len(item.only_final)),
                str(item.far),
                f'{max(item.distances):.0f}' if item.distances else '-',
                f'{item.inserted} of {item.played}{", void" if item.void else ""}',
                str(item.lost), describe_ticks(item),
            ) for item in flights
        ],
    )
    print(f'\n{text}')
    if arguments.write:
        replace_section(PAGE, 'bench live', text)
    return int(any(item.faults or item.only_final or item.void for item in flights))


if __name__ == '__main__':
    sys.exit(main())
