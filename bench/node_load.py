# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Loads the node with a recording in its own timing, and measures it from outside.

Node and player are processes of their own; this one listens to the results, /diagnostics and
/clock and reads processor time and memory of the node and its process of the ticks from /proc.
``bench/live/node_flight.py`` makes recordings for it.  ``--busy`` flies once for each number of
programs that keep a core busy beside, and prints the figures beside each other.  Where the
recording has a truth.json, the numbers of the lines are followed too: which conductor changed its
number.
"""

import argparse
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import ExitStack
import json
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from common.measure import keep_busy
from common.tables import format_figure, render_table
import numpy as np

from plc_inspect.offline.readers.bags import Recording
from plc_inspect.ros.graph.domain import set_apart
from plc_inspect.ros.graph.transport import prepare_transport, VARIABLE
from plc_inspect.security.member_keys import PROFILE

TICKS = os.sysconf('SC_CLK_TCK')
PAUSE = 60.0
"""What follows later is of another clock: results that are held back bear the node's own [s]."""


class Probe:
    """Listens to the node."""

    def __init__(self, pid: int, scan_rate: float) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import PointCloud2

        from plc_inspect.messages.rows import read_rows
        from plc_inspect.ros.graph.qos import RESULTS

        self.context = rclpy.context.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('probe', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.node.create_subscription(Clock, '/clock', self._on_clock, 10)
        self.node.create_subscription(
            PointCloud2, '/plc_inspect/catenaries', self._on_catenaries, RESULTS
        )
        self._read = read_rows
        self._pid, self._period = pid, 1.0 / scan_rate
        self._offset: float | None = None
        self._newest: float | None = None
        self.values: dict[str, str] = {}
        self.ready = False
        self.latency: list[tuple[float, float]] = []
        self.ticks: list[tuple[float, float]] = []
        self.usage: list[tuple[float, float, float]] = []
        self.rows: list[tuple[float, np.ndarray]] = []
        self._last_tick = ''

    def _on_clock(self, message) -> None:
        self._offset = message.clock.sec + message.clock.nanosec * 1e-9 - time.monotonic()

    def _on_catenaries(self, message) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        if self._offset is None or (self._newest is not None and stamp <= self._newest):
            return
        if self._newest is None or stamp - self._newest > PAUSE:
            self._newest = stamp - self._period / 2
        now = time.monotonic() + self._offset
        scan = stamp
        while scan > self._newest:
            self.latency.append((time.monotonic(), now - scan))
            scan -= self._period
        self._newest = stamp
        self.rows.append((time.monotonic(), self._read(message).copy()))

    def _on_diagnostics(self, message) -> None:
        for status in message.status:
            for item in status.values:
                self.values[item.key] = item.value
        self.ready = self.values.get('busy') == 'False' or self.ready
        if self.values.get('ticks') != self._last_tick and 'last tick [ms]' in self.values:
            self._last_tick = self.values['ticks']
            self.ticks.append((time.monotonic(), float(self.values['last tick [ms]'])))

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.shutdown()

    def sample(self) -> None:
        """Read processor time and memory, of what is shared a share, of the node's processes."""
        cpu, memory = 0.0, 0
        for pid in (self._pid, *list_children(self._pid)):
            fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
            cpu += (int(fields[11]) + int(fields[12])) / TICKS
            memory += read_share(pid)
        self.usage.append((time.monotonic(), cpu, memory))


def read_share(pid: int) -> int:
    """Return the memory of a process, and of what others share its part [bytes]."""
    for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines():
        if line.startswith('Pss:'):
            return int(line.split()[1]) * 1024
    return 0


def list_children(pid: int) -> list[int]:
    """Return the numbers of the processes that a process has begun."""
    return [
        int(number) for path in Path(f'/proc/{pid}/task').glob('*/children')
        for number in path.read_text().split()
    ]


def run(
    bag: Path, out: Path, scan_rate: float, settings: Sequence[str], *,
    seconds: float = math.inf, monitors: int = 0, watch: Callable[[Probe], None] | None = None,
    keys: Path | None = None,
) -> tuple[Probe, str]:
    """
    Fly a recording past the node and return what was seen, and how the node ended.

    At most so many seconds are flown, with so many plc_monitor beside, which on the ground have a
    machine of their own and here get what the others leave; ``watch`` may subscribe to more.
    With the folder of ``plc_keys``, node and player are members of the fleet.
    """
    extra = [item for setting in settings for item in ('-p', setting)]
    with ExitStack() as stack:
        def start(*command: str, **options: Any) -> subprocess.Popen:
            process = subprocess.Popen(command, **options)
            stack.callback(process.kill)
            return process

        node = start(
            sys.executable, '-m', 'plc_inspect.ros.node.onboard', '--ros-args',
            '--log-level', 'warn', '-p', f'output.directory:={out}', *extra,
            env=choose_keys(keys, 'vehicle'),
        )
        probe = Probe(node.pid, scan_rate)
        stack.callback(probe.close)
        if watch is not None:
            watch(probe)
        for _ in range(monitors):
            start('nice', '-n', '19', sys.executable, '-m', 'plc_inspect.monitor.command',
                  '--json', stdout=subprocess.DEVNULL)
        deadline = time.monotonic() + 300.0
        while not probe.ready:
            probe.executor.spin_once(timeout_sec=0.2)
            if node.poll() is not None or time.monotonic() > deadline:
                raise SystemExit('the node does not come up')
        player = start(
            sys.executable, '-m', 'plc_inspect.ros.play', str(bag), '--wait', '10', '--quiet',
            env=choose_keys(keys, 'driver'),
        )
        due, over = 0.0, time.monotonic() + seconds
        while player.poll() is None and node.poll() is None and time.monotonic() < over:
            probe.executor.spin_once(timeout_sec=0.2)
            if time.monotonic() >= due:
                probe.sample()
                due = time.monotonic() + 1.0
        player.kill()
        end = time.monotonic() + 3.0
        while time.monotonic() < end and node.poll() is None:
            probe.executor.spin_once(timeout_sec=0.2)
        began = time.monotonic()
        node.send_signal(signal.SIGINT)
        code = node.wait(180.0)
        return probe, f'exit code {code}, results saved in {time.monotonic() - began:.1f} s'


def choose_keys(keys: Path | None, member: str) -> dict[str, str]:
    """Return the environment of a member of the fleet, that of this process without keys."""
    if keys is None:
        return dict(os.environ)
    folder = keys / member
    return os.environ | {'PLC_KEYS': str(folder), VARIABLE: str(folder / PROFILE)}


def measure(probe: Probe) -> dict[str, float]:
    """Return the node's own figures."""
    usage, ticks = np.array(probe.usage), np.array(probe.ticks)[:, 1]
    return {
        'processor [cores]': (usage[-1, 1] - usage[0, 1]) / (usage[-1, 0] - usage[0, 0]),
        'memory at most [MB]': usage[:, 2].max() / 1e6,
        'tick, median [ms]': float(np.median(ticks)),
        'tick, p95 [ms]': float(np.percentile(ticks, 95)),
        'callbacks p99 [ms]': float(probe.values['callbacks p99 [ms]']),
        'scans': float(probe.values['scans']),
        'scans dropped': float(probe.values['scans dropped']),
        'ticks postponed': float(probe.values['ticks postponed']),
    }


def report(probe: Probe, num_scans: int, end: str) -> None:
    """Print the figures, of the whole run and of its halves."""
    values = probe.values
    print(f'scans: {num_scans} played, {values["scans"]} received, '
          f'{num_scans - int(values["scans"])} lost, {values["scans dropped"]} dropped')
    print(f'callbacks p99: {values["callbacks p99 [ms]"]} ms')
    for key, value in sorted(values.items()):
        if key.startswith('callback '):
            print(f'  {key}: {value}')
    middle = (probe.usage[0][0] + probe.usage[-1][0]) / 2
    for title, series, scale, unit in (
        ('tick', probe.ticks, 1.0, 'ms'), ('scan to published lines', probe.latency, 1.0, 's'),
    ):
        if not series:  # with keys this process does not hear the player's clock
            continue
        both = np.array(series)
        parts = both[:, 1], both[both[:, 0] < middle, 1], both[both[:, 0] >= middle, 1]
        numbers = [
            f'median {np.median(part) * scale:.2f}, p95 {np.percentile(part, 95) * scale:.2f}'
            for part in parts if len(part)
        ]
        print(f'{title} [{unit}]: {numbers[0]} (first half {numbers[1]}; second {numbers[-1]})')
    usage = np.array(probe.usage)
    half = int(np.searchsorted(usage[:, 0], middle))
    cores = np.diff(usage[[0, half, -1], 1]) / np.diff(usage[[0, half, -1], 0])
    total = (usage[-1, 1] - usage[0, 1]) / (usage[-1, 0] - usage[0, 0])
    print(f'processor: {total:.2f} cores (first half {cores[0]:.2f}, second {cores[1]:.2f})')
    second = usage[half:, 2] / 1e6
    print(f'memory: {usage[0, 2] / 1e6:.0f} MB at start, {second[0]:.0f} MB half way, '
          f'{second[-1]:.0f} MB at the end, {usage[:, 2].max() / 1e6:.0f} MB at most; '
          f'second half within {100 * (second.max() / second.min() - 1):.1f} %')
    print(f'map: {values["voxels"]} voxels, {values["voxels evicted"]} evicted, '
          f'{values["points refused"]} points refused; ticks postponed: '
          f'{values["ticks postponed"]}, failed: {values["ticks failed"]}')
    print(f'{values["lines"]} lines, {values["spans"]} spans, {values["hazards"]} hazards, '
          f'{values["lines merged"]} lines merged; {end}')


def follow(probe: Probe, truth: Path) -> None:
    """Print which conductors changed their number, by where they hang in truth."""
    spans = json.loads(truth.read_text(encoding='utf-8'))['spans']
    names: dict[tuple[int, int], dict[int, int]] = defaultdict(lambda: defaultdict(int))
    for _, rows in probe.rows:
        for row in rows:
            key = find_conductor(row, spans)
            if key is not None:
                names[key][int(row['line_id'])] += 1
    lines: dict[int, set[int]] = defaultdict(set)
    for (line, _), numbers in names.items():
        lines[line] |= set(numbers)
    changed = [key for key, numbers in names.items() if len(numbers) > 1]
    print(f'conductor-spans seen: {len(names)} of {len(spans)}; with more than one line number '
          f'over time: {len(changed)}')
    for line in sorted(lines):
        print(f'  conductor {line}: published as line {sorted(lines[line])}')


def find_conductor(row: np.ndarray, spans: Sequence[dict]) -> tuple[int, int] | None:
    """Return line_id and span_id of the true conductor-span at the middle of a found one."""
    middle = [
        (row[f'start_{axis}'] + row[f'end_{axis}']) / 2 for axis in 'xy'
    ]
    height = row['a'] + row['c'] * np.cosh((row['length'] / 2 - row['b']) / row['c'])
    best, found = 1.5, None
    for span in spans:
        start, end = np.array(span['start']), np.array(span['end'])
        unit = (end - start)[:2] / np.linalg.norm((end - start)[:2])
        apart = np.array(middle) - start[:2]
        along = float(apart @ unit)
        if not 0.0 <= along <= span['length']:
            continue
        z = span['a'] + span['c'] * np.cosh((along - span['b']) / span['c'])
        gap = float(np.hypot(apart[1] * unit[0] - apart[0] * unit[1], height - z))
        if gap < best:
            best, found = gap, (span['line_id'], span['span_id'])
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description='Measures the node under load.')
    parser.add_argument('bag', type=Path)
    parser.add_argument('--scan-rate', type=float, default=10.0, metavar='HZ')
    parser.add_argument('-p', '--set', action='append', default=[], metavar='NAME:=VALUE')
    parser.add_argument('--figures', type=Path, metavar='FILE', help='write figures as JSON')
    parser.add_argument('--keys', type=Path, metavar='KEYS',
                        help='fly with keys, from a machine that has the profile of the driver')
    parser.add_argument('--machines', action='store_true',
                        help='let others on the network find the node')
    parser.add_argument('--busy', type=int, nargs='+', default=[0], metavar='N',
                        help='programs that keep a core busy beside; a flight for each number')
    arguments = parser.parse_args(argv)
    prepare_transport()
    if not arguments.machines:
        set_apart()
    with Recording(arguments.bag, 'velodyne_points', 'odometry') as recording:
        num_scans = sum('points' in m.topic for m in recording.raw_messages())
        print(f'{arguments.bag}: {recording.duration:.0f} s, {num_scans} scans')
    figures = {}
    for busy in arguments.busy:
        with tempfile.TemporaryDirectory() as room, keep_busy(busy):
            probe, end = run(
                arguments.bag, Path(room) / 'out', arguments.scan_rate, arguments.set,
                keys=arguments.keys,
            )
        figures[busy] = measure(probe)
        if len(arguments.busy) > 1:
            print(f'\nbeside {busy} busy programs, load {os.getloadavg()[0]:.1f}')
        report(probe, num_scans, end)
        truth = arguments.bag / 'truth.json'
        if truth.exists():
            follow(probe, truth)
    if arguments.figures is not None:
        told = figures if len(figures) > 1 else figures[arguments.busy[0]]
        arguments.figures.write_text(json.dumps(told), encoding='utf-8')
    if len(figures) > 1:
        print(f'\nof {num_scans} scans, beside so many busy programs on {os.cpu_count()} cores:')
        print(render_table(
            ['figure', *map(str, figures)],
            [
                [name, *(format_figure(item[name], 2) for item in figures.values())]
                for name in figures[arguments.busy[0]]
            ],
        ))
    return 0


if __name__ == '__main__':
    sys.exit(main())
