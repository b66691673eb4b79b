# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measures what the flight record holds to: cuts at any byte, kills in flight, and what it costs.

The node is a process of its own that the demo flight is sent to over DDS.  ``cuts`` cuts its
record at random bytes and reads it; of some cuts it makes the results.  ``kills`` ends the node by
SIGKILL again and again while the vehicle waits, and compares the results with those of a flight
without.  ``cost`` flies a recording by turns with and without a record.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from faults import DOMAIN, Event, NODE, open_feeder, ROOT, trace
from faults import read_flight as read_events
from live.live_equals_offline import compare
import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import list_segments
from plc_inspect.flight_record.reader import Flight, read_flight
from plc_inspect.offline.commands.recover import recover
from plc_inspect.offline.records.inspection import describe_span
from plc_inspect.offline.records.results_reader import read_run, read_table
from plc_inspect.offline.records.units import Units
from plc_inspect.results import Span
from plc_inspect.ros.graph.transport import prepare_transport

SCAN_PERIOD = 0.1
"""Of the demo flight [s]."""
START = 300.0
"""Longest wait for the node [s]; kernels may have to be compiled."""
SETTLE = 1.0
"""Time in which DDS finds a node that is ready [s]."""
NEAR = 0.5
"""Distance within which a span lies where one of the whole flight does [m]."""
MOST_LOST, MOST_APART, MOST_START = 1.0, 0.02, 5.0
"""What is to hold: results lost [s], distance of catenaries [m], start to ready [s]."""


@dataclass(eq=False)
class Node:
    """The node as a process."""

    out: Path
    arguments: tuple[str, ...] = ()
    process: Any = None

    @property
    def log(self) -> Path:
        """What it says."""
        return self.out.with_suffix('.log')

    def start(self) -> float:
        """Start it, and return the time until it is ready [s]."""
        before = self.log.read_text().count(': ready\n') if self.log.exists() else 0
        began = time.monotonic()
        names = os.environ | {
            'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_HOME': str(self.out.parent / 'home'),
            'PYTHONPATH': str(ROOT),
        }
        with self.log.open('a') as stream:
            self.process = subprocess.Popen(
                [sys.executable, '-m', NODE, '--ros-args', '-p',
                 f'output.directory:={self.out}', *self.arguments],
                cwd=ROOT, env=names, stdout=stream, stderr=subprocess.STDOUT,
            )
        while self.log.read_text().count(': ready\n') <= before:
            if self.process.poll() is not None or time.monotonic() > began + START:
                raise SystemExit(f'the node does not come up:\n{self.log.read_text()[-2000:]}')
            time.sleep(0.02)
        return time.monotonic() - began

    def end(self, number: int) -> int:
        """End it by a signal, and return its exit code."""
        self.process.send_signal(number)
        return int(self.process.wait(200.0))


@contextmanager
def running(node: Node) -> Iterator[Node]:
    """Start a node and see to it that it is gone in the end."""
    try:
        node.start()
        yield node
    finally:
        node.process.kill()
        node.process.wait()


def fly(node: Node, events: Sequence[Event], rate: float, kills: Sequence[float]) -> list[float]:
    """
    Send a flight, and kill the node at some times of it, while the vehicle waits.

    Returns the time that each start took until the node was ready [s].
    """
    starts, due = [], sorted(kills)
    with open_feeder(two=False) as feeder:
        time.sleep(SETTLE)
        began = time.monotonic()
        for event in events:
            if due and event.time >= due[0]:
                due.pop(0)
                paused = time.monotonic()
                node.end(signal.SIGKILL)
                starts.append(node.start())
                time.sleep(SETTLE)
                began += time.monotonic() - paused
            time.sleep(max(0.0, began + event.time / rate - time.monotonic()))
            feeder.publishers[event.kind].publish(event.message)
        time.sleep(2.0)
    return starts


def digest(flight: Flight) -> str:
    """Return all that a record adds up to in a short form."""
    import hashlib

    total = hashlib.sha256()
    for name in ('keys', 'counts', 'means', 'labels', 'cell_keys', 'cell_state'):
        total.update(np.ascontiguousarray(getattr(flight.map, name)).tobytes())
    total.update(repr(flight.kept.spans.next_line).encode())
    for item in flight.kept.spans.spans:
        total.update(repr((item.key, item.hits, item.span.start.tolist())).encode())
    for hazard in flight.kept.hazards.hazards:
        total.update(repr((hazard.hazard.hazard_id, hazard.hits)).encode())
    return total.hexdigest()


def list_chunks(segment: Path) -> list[tuple[int, dict[str, Any]]]:
    """Return where each chunk of a segment ends, and the state that it tells of."""
    from mcap.records import Chunk, Message
    from mcap.stream_reader import breakup_chunk, StreamReader

    found = []
    with segment.open('rb') as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                *_, last = (
                    item for item in breakup_chunk(record) if isinstance(item, Message)
                )
                found.append((stream.tell(), json.loads(last.data)))
    return found


def count_ghosts(spans: Sequence[Span], known: cKDTree) -> int:
    """Return how many spans lie beside those that are known."""
    rows = [describe_span(span, Units()) for span in spans]
    return sum(bool((known.query(trace(row))[0] > NEAR).any()) for row in rows)


def measure_cuts(num: int, num_results: int, seconds: float, rng: np.random.Generator) -> bool:
    """Cut a record at random bytes; return whether all held."""
    with tempfile.TemporaryDirectory() as folder:
        node = Node(Path(folder) / 'out')
        with running(node):
            fly(node, read_events(seconds), 1.0, [])
            record = Path(folder) / 'out.record'
            whole = Path(folder) / 'whole'
            shutil.copytree(record, whole)  # as it is in flight
            node.end(signal.SIGINT)
        known = cKDTree(np.concatenate([
            trace(row) for row in read_table(node.out, 'spans')['spans']
        ]))
        (segment,) = list_segments(whole)
        data = segment.read_bytes()
        chunks = list_chunks(segment)
        ends = [end for end, _ in chunks]
        places = np.unique(np.concatenate((
            rng.integers(0, len(data), num), [end + k for end in ends[::20] for k in (-1, 0, 1)]
        )))
        cut = Path(folder) / 'cut'
        cut.mkdir()
        expected: dict[int, str] = {}
        wrong = ghosts = refused = num_made = 0
        lost, made = [], set(rng.choice(places, num_results).tolist())
        for place in places.tolist():
            (cut / segment.name).write_bytes(data[:place])
            number = int(np.searchsorted(ends, place, side='right')) - 1
            following = chunks[min(number + 1, len(chunks) - 1)][1]
            had = chunks[number][1]['whole'] if number >= 0 else 0
            lost.append((following['sequence'] - had) * SCAN_PERIOD)
            try:
                flight = read_flight(cut)
            except DataError as error:
                refused += 1
                wrong += number >= 0
                if number >= 0:
                    print(f'cut at {place}: {error}')
                continue
            if number not in expected:
                (cut / segment.name).write_bytes(data[: ends[number]])
                expected[number] = digest(read_flight(cut))
            wrong += digest(flight) != expected[number]
            if place in made and len(flight.kept.spans.spans):
                num_made += 1
                (cut / segment.name).write_bytes(data[:place])
                inspection = recover(cut).inspection
                ghosts += count_ghosts(inspection.result.spans, known)
    print(f'{len(places)} cuts of a record of {len(data)} bytes, {len(chunks)} chunks, '
          f'{seconds:g} s: {refused} before the first chunk, {wrong} read otherwise than the last '
          f'whole chunk says')
    print(f'results lost: median {np.median(lost):.2f} s, at most {max(lost):.2f} s')
    print(f'results made of {num_made} cuts: {ghosts} spans where none is')
    return not wrong and not ghosts and max(lost) <= MOST_LOST


def find_hazards(folder: Path) -> list[tuple[Any, ...]]:
    """Return kind, severity and place of all hazards [m]."""
    return [
        (row['kind'], row['severity'], np.array(row['position']))
        for row in read_table(folder, 'hazards')['hazards']
    ]


def measure_kills(num: int, seconds: float, rng: np.random.Generator) -> bool:
    """Kill a node in flight; return whether its results are those of one that lived."""
    events = read_events(seconds)
    kills = np.sort(rng.uniform(2.0, seconds - 1.0, num))
    with tempfile.TemporaryDirectory() as folder:
        calm, killed = Node(Path(folder) / 'calm'), Node(Path(folder) / 'killed')
        with running(calm):
            fly(calm, events, 1.0, [])
            calm.end(signal.SIGINT)
        with running(killed):
            starts = fly(killed, events, 1.0, kills.tolist())
            code = killed.end(signal.SIGINT)
        resumed = killed.log.read_text().count(' goes on: ')
        refused = [
            line for line in killed.log.read_text().splitlines() if 'does not go on' in line
        ]
        print('\n'.join(refused))
        tables = [read_table(node.out, 'spans')['spans'] for node in (calm, killed)]
        apart, only_calm, only_killed = compare(*tables)
        hazards = [find_hazards(node.out) for node in (calm, killed)]
        rest = list(hazards[1])
        for kind, severity, place in hazards[0]:
            same = [item for item in rest if item[:2] == (kind, severity)
                    and np.linalg.norm(item[2] - place) <= NEAR]
            rest = [item for item in rest if item is not (same or [None])[0]]
        missed = len(hazards[0]) + len(rest) - len(hazards[1])
        scans = [read_run(node.out)['input']['counts']['num_scans_inserted']
                 for node in (calm, killed)]
    print(f'{num} kills in a flight of {seconds:g} s: {resumed} times resumed, exit {code}; '
          f'{scans[0]} scans in without, {scans[1]} with kills')
    print(f'start to ready: median {np.median(starts):.1f} s, at most {max(starts):.1f} s')
    print(f'conductor-spans: {len(apart)} in both, {only_calm} only without, {only_killed} only '
          f'with kills; distance at most {max(apart, default=0.0) * 1e3:.1f} mm')
    print(f'hazards: {len(hazards[0])} without, {len(hazards[1])} with kills, {missed} missed, '
          f'{len(rest)} extra')
    return (
        resumed == num and not only_calm and not only_killed and not missed and not rest
        and max(apart) <= MOST_APART and max(starts) <= MOST_START
    )


def measure_cost(bag: Path, turns: int, seconds: float) -> bool:
    """Fly by turns with and without a record; print processor time and callback times."""
    from node_load import run

    own = 'callback record [ms]: median, p99, greatest'
    rows: dict[str, list[list[float]]] = {'false': [], 'true': []}
    for turn in range(2 * turns):
        setting = ('true', 'false')[turn % 2]
        with tempfile.TemporaryDirectory() as folder:
            probe, _ = run(
                bag, Path(folder) / 'out', 10.0, [f'output.record:={setting}'], seconds=seconds
            )
        usage = np.array(probe.usage)
        cores = (usage[-1, 1] - usage[0, 1]) / (usage[-1, 0] - usage[0, 0])
        times = [
            float(probe.values[f'callback {name} [ms]: median, p99, greatest'].split(', ')[1])
            for name in ('scan', 'odometry', 'step')
        ]
        rows[setting].append([cores, *times, float(probe.values['callbacks p99 [ms]'])])
        print(f'record {setting}: {cores:.3f} cores; p99 of scan {times[0]:.2f} ms, odometry '
              f'{times[1]:.2f} ms, step {times[2]:.2f} ms, all {rows[setting][-1][4]:.2f} ms; '
              f'record {probe.values.get("record [MB]")} MB, '
              f'behind {probe.values.get("record behind [s]")} s; its own callback '
              f'{probe.values[own]} ms', flush=True)
    more = np.median(rows['true'], axis=0) - np.median(rows['false'], axis=0)
    print(f'the record costs {more[0]:.3f} cores; p99 of scan {more[1]:+.2f} ms, odometry '
          f'{more[2]:+.2f} ms, step {more[3]:+.2f} ms, all {more[4]:+.2f} ms')
    return bool(more[0] <= 0.1 and more[4] <= 1.0)


def main() -> int:
    """Measure what is asked for; return 0 if all holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('what', nargs='*', choices=('cuts', 'kills', 'cost', []),
                        help='all but cost, which needs --bag')
    parser.add_argument('--cuts', type=int, default=1000)
    parser.add_argument('--results', type=int, default=40, help='cuts of which results are made')
    parser.add_argument('--kills', type=int, default=20)
    parser.add_argument('--seconds', type=float, default=45.0)
    parser.add_argument('--bag', type=Path, help='of bench/live/node_flight.py')
    parser.add_argument('--turns', type=int, default=3)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    prepare_transport()
    rng = np.random.default_rng(arguments.seed)
    chosen = arguments.what or ['cuts', 'kills', *(['cost'] if arguments.bag else [])]
    good = True
    if 'cuts' in chosen:
        good &= measure_cuts(arguments.cuts, arguments.results, arguments.seconds, rng)
    if 'kills' in chosen:
        good &= measure_kills(arguments.kills, arguments.seconds, rng)
    if 'cost' in chosen:
        good &= measure_cost(arguments.bag, arguments.turns, arguments.seconds)
    return int(not good)


if __name__ == '__main__':
    sys.exit(main())
