# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Flies the node for an hour, with faults at random, and holds what it shows to limits.

The node is a process of its own and shares the cores with busy ones.  It is sent scans of 30,000
points at 10 Hz over DDS, of a flight along a high-voltage line there and back again and again; in
each ``--every`` seconds one fault of ``bench/faults.py`` is done to 20 s of it, which the seed
draws.  Ends with 1 where a scan was lost unseen, memory or the time of ticks grows, or the node
does not end as it should.
"""

import argparse
from collections.abc import Iterator
from contextlib import redirect_stdout
import copy
import io
import math
import os
from pathlib import Path
import signal
import sys
import tempfile
import threading
import time

from common.fault_kinds import FAULTS
from common.flight_faults import Event, shift_stamp
from common.measure import keep_busy
from common.odometry_changes import turn_back
from faults import DOMAIN, Feeder, open_feeder, read_flight, ROOT
from live.node_flight import main as make_flight
from node_load import Probe
import numpy as np
from record import Node, running

from plc_inspect.checks import Check
from plc_inspect.ros.graph.transport import prepare_transport

LEG = 30.0
"""Length of the flight one way [s]: at 8 m/s more than a span."""
RATE = 10.0
"""Scans a second."""
NUM_SLOWEST = 8
"""Ticks that are listed."""
SLICE = 20.0
"""What a fault is done to [s], as the faults of ``bench/faults.py`` expect."""
PARTS = 6
"""Parts of the flight of which the first, after the warm-up, and the last are compared."""
MOST_LOST, MOST_MEMORY, MOST_TICK = 0, 0.02, 0.1
"""What is to hold: scans lost unseen, growth of memory in the second half, and of ticks."""
FAULT_NAMES = (
    '200 calls of ~/segment', 'hazards.rules unknown in flight', 'node stopped for 3 s',
    'two drivers, the second 2 m lower', 'every scan twice', 'odometry steps by 0.5 m',
    'odometry steps by 5 m',
    'odometry stands still for 5 s', 'odometry silent for 5 s', 'odometry 1.5 s late',
    'one pose 1,000 km away', 'poses of 1e300 m for 0.3 s', 'poses of NaN for 1 s',
    'quaternions of the other sign', 'quaternions of NaN for 0.5 s', 'scans out of order',
    'poses out of order', 'one scan in ten not finite',
    'one scan in ten empty', 'scans without times', 'driver away for 3 s',
    'one point in a thousand is dust', 'one point in a hundred is dust',
    'one point in ten is dust', 'heading drifts by 1 degree/s',
    'positions at 10 Hz, told at 50 Hz',
)
"""
Faults after which a flight goes on as before, and each scan of which is counted once: one that is
malformed leaves a gap in the stamps as well.
"""


def read_there_and_back(folder: Path) -> list[Event]:
    """Return a flight there and back, which ends where it begins; it is made where it is not."""
    if not folder.is_dir():
        with redirect_stdout(io.StringIO()):
            code = make_flight(['-o', str(folder), '--duration', f'{LEG:g}', '--drift', '0'])
        if code:
            raise SystemExit(f'{folder}: the flight was not made')
    return turn_back(read_flight(LEG, folder), LEG)


def draw_faults(
    warm_up: float, seconds: float, every: float, seed: int
) -> list[tuple[float, str]]:
    """Return when faults begin [s], and which: all of them once, before one comes again."""
    rng = np.random.default_rng(seed)
    names: list[str] = []
    due = []
    for begin in np.arange(warm_up, seconds - every + 1.0, every):
        names = names or rng.permutation(FAULT_NAMES).tolist()
        due.append((float(begin + rng.uniform(0.0, every - SLICE)), names.pop()))
    return due


def repeat(events: list[Event]) -> Iterator[tuple[Event, float]]:
    """Yield a flight again and again, each message with what its stamp lacks [s]."""
    later = 0.0
    while True:
        for event in events:
            if event.time < 2 * LEG:  # what ends a round begins the next
                yield Event(event.time + later, event.kind, event.message), later
        later += 2 * LEG


def change(part: list[tuple[Event, float]], name: str) -> list[Event]:
    """Return a part of the flight with a fault in it."""
    begin = part[0][0].time
    own = []
    for event, later in part:
        own.append(Event(event.time - begin, event.kind, copy.deepcopy(event.message)))
        shift_stamp(own[-1].message, later)
    return [Event(e.time + begin, e.kind, e.message) for e in FAULTS[name].change(own)]


class Flight:
    """Sends the flight and its faults, and counts scans."""

    def __init__(self, feeder: Feeder, probe: Probe) -> None:
        self.feeder, self.probe = feeder, probe
        self.sent = self.withheld = 0
        self.began = time.monotonic()
        self._due = 0.0

    def fly(self, events: list[Event], faults: list[tuple[float, str]], seconds: float) -> None:
        """Fly for so long."""
        waiting, stream = list(faults), repeat(events)
        for event, later in stream:
            if event.time > seconds:
                return
            if not waiting or event.time < waiting[0][0]:
                self._send(event, later)
                continue
            begin, name = waiting.pop(0)
            part = [(event, later)]
            while part[-1][0].time < begin + SLICE:
                part.append(next(stream))
            self._do(part, name)

    def _do(self, part: list[tuple[Event, float]], name: str) -> None:
        """Send a part of the flight with a fault in it, and say which."""
        begin, note = part[0][0].time, ''
        print(f'{begin:6.0f} s: {name}', flush=True)
        changed, fault = change(part, name), FAULTS[name]
        self.withheld += max(0, count_scans([item for item, _ in part]) - count_scans(changed))
        half = next(n for n, event in enumerate(changed) if event.time > begin + SLICE / 2)
        for event in changed[:half]:
            self._send(event, 0.0)
        before = time.monotonic()
        note = fault.during(self.feeder)
        self.began += time.monotonic() - before
        for event in changed[half:]:
            self._send(event, 0.0)
        if note:
            print(f'          {note}', flush=True)

    def _send(self, event: Event, later: float) -> None:
        """Publish a message at its time, with the stamp of its round of the flight."""
        time.sleep(max(0.0, self.began + event.time - time.monotonic()))
        if time.monotonic() >= self._due:
            self.probe.sample()
            self._due = time.monotonic() + 1.0
        shift_stamp(event.message, later)
        self.feeder.publishers[event.kind].publish(event.message)
        shift_stamp(event.message, -later)
        self.sent += event.kind != 'odometry'


def count_scans(events: list[Event]) -> int:
    """Return how many of the messages are scans."""
    return sum(event.kind != 'odometry' for event in events)


def judge(flight: Flight, probe: Probe, warm_up: float, seconds: float) -> list[Check]:
    """Return what is to hold, and print what it is of."""
    values = {name: int(probe.values[name]) for name in (
        'scans', 'scans inserted', 'scans dropped', 'scans lost', 'messages malformed', 'ticks',
        'ticks postponed', 'ticks failed', 'map restarts',
    )}
    values |= {name: int(count) for name, count in probe.values.items() if 'dropped: ' in name}
    known = values['scans'] + values['scans lost']
    print(f'{flight.sent} scans sent, {flight.withheld} withheld by faults; the node tells: '
          + ', '.join(f'{name} {value}' for name, value in values.items()))
    usage, ticks = np.array(probe.usage), np.array(probe.ticks)
    for series in (usage, ticks):
        series[:, 0] -= flight.began
    second = usage[usage[:, 0] >= seconds / 2.0]
    means = [part[:, 2].mean() / 1e6 for part in np.array_split(second, PARTS)]
    print(f'memory: {usage[0, 2] / 1e6:.0f} MB at first, {second[0, 2] / 1e6:.0f} MB '
          f'half way, {usage[-1, 2] / 1e6:.0f} MB at last, {usage[:, 2].max() / 1e6:.0f} MB at '
          f'most; means of {PARTS} parts of the second half: '
          f'{", ".join(f"{mean:.1f}" for mean in means)} MB')
    part = seconds / PARTS
    p95 = [float(np.percentile(own[:, 1], 95)) if len(own) else math.inf for own in (
        ticks[(ticks[:, 0] >= begin) & (ticks[:, 0] < begin + part)]
        for begin in np.arange(warm_up, seconds - part + 1.0, part)
    )]
    print(f'p95 of ticks in parts of {part:.0f} s after the warm-up: '
          f'{", ".join(f"{value:.0f}" for value in p95)} ms')
    slowest = ticks[np.argsort(-ticks[:, 1])[:NUM_SLOWEST]]
    print('slowest ticks: ' + ', '.join(
        f'{value / 1e3:.1f} s at {at:.0f} s' for at, value in sorted(slowest.tolist())
    ))
    cores = (usage[-1, 1] - usage[0, 1]) / (usage[-1, 0] - usage[0, 0])
    print(f'{cores:.2f} cores; callbacks p99 {probe.values["callbacks p99 [ms]"]} ms')
    return [
        Check(name='scans lost unseen', value=flight.sent + flight.withheld - known,
              limit=MOST_LOST, is_least=False),
        Check(name='growth of memory in the second half', value=max(means) / min(means) - 1.0,
              limit=MOST_MEMORY, is_least=False),
        Check(name='growth of p95 of ticks', value=p95[-1] / p95[0] - 1.0 if p95[0] < math.inf else
              math.inf, limit=MOST_TICK, is_least=False),
        Check(name='ticks failed', value=values['ticks failed'], limit=0, is_least=False),
    ]


def main() -> int:
    """Fly, and print figures against limits; return 0 if all are kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=60.0)
    parser.add_argument('--every', type=float, default=60.0, metavar='S', help='a fault in each')
    parser.add_argument('--busy', type=int, default=1, help='processes that want a core each')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--flight', type=Path, default=ROOT / 'build' / 'soak')
    arguments = parser.parse_args()
    if arguments.minutes < 6.0:
        parser.error(f'--minutes must be 6 at least, got {arguments.minutes:g}: ticks of a '
                     f'{PARTS}th of the flight are compared')
    seconds = 60.0 * arguments.minutes
    warm_up = seconds / (2 * PARTS)
    os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    prepare_transport()
    events = read_there_and_back(arguments.flight)
    faults = draw_faults(warm_up, seconds, arguments.every, arguments.seed)
    points = max(event.message.width * event.message.height for event in events
                 if event.kind == 'scan')
    print(f'{arguments.minutes:g} minutes, {len(faults)} faults of seed {arguments.seed}, '
          f'{points} points a scan, {arguments.busy} busy processes beside', flush=True)
    with tempfile.TemporaryDirectory() as folder:
        node = Node(Path(folder) / 'out')
        with running(node), open_feeder(two=True) as feeder, keep_busy(arguments.busy):
            feeder.process = node.process.pid
            probe = Probe(node.process.pid, RATE)
            flight = Flight(feeder, probe)
            threading.Thread(target=probe.executor.spin, daemon=True).start()
            flight.fly(events, faults, seconds)
            late = time.monotonic() - flight.began - seconds
            time.sleep(4.0)
            print(f'the last message was sent {late:.1f} s late')
            checks = judge(flight, probe, warm_up, seconds)
            probe.close()
            code = node.end(signal.SIGINT)
    checks.append(Check(name='exit code', value=code, limit=0, is_least=False))
    for check in checks:
        print(f'{"kept" if check.kept else "NOT KEPT"}: {check.name} {check.value:.3g}, '
              f'{check.limit:g} at most')
    return int(not all(check.kept for check in checks))


if __name__ == '__main__':
    sys.exit(main())
