# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measures what the tunnel costs the node and the link: flights by turns, with it and without.

Vehicle and ground are network namespaces, which want root.  On the vehicle ``bench/node_load.py``
measures the node; on the ground a monitor follows it, over plain UDP or through the tunnel, and
what arrives there is counted at its network device.  ``--rate`` makes the link that thin.
"""

import argparse
from collections.abc import Sequence
from contextlib import suppress
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.tables import render_table, replace_section
from networks.fleet import Fleet, Network, Processes, read_lines, ROOT, wait_until

PLAIN, TUNNEL = 'plain UDP', 'tunnel'
MONITOR = 'plc_inspect.monitor.command'
LOAD = ROOT / 'bench/node_load.py'
GROWTH = 0.10
"""Share by which the node's figures may change."""
BUDGET = 256.0
"""What the stream may use [kbit/s], as ``stream.max_kbps``."""
WINDOW = 5.0
"""The rate of the link is the greatest mean over this [s]."""
PATIENCE = 400.0
"""Longest flight, with compiling [s]."""
LATENCY = '400ms'
"""What waits longer before a thin link is dropped."""
DOCUMENT = ROOT / 'docs/security.md'


class Meter:
    """Counts the bytes that come to a machine."""

    def __init__(self, pid: int) -> None:
        self._path = Path(f'/proc/{pid}/net/dev')
        self.samples: list[tuple[float, int]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.wait(0.5):
            with suppress(OSError):
                text = self._path.read_text(encoding='ascii')
                line = next(line for line in text.splitlines() if 'eth0:' in line)
                self.samples.append((time.monotonic(), int(line.split(':')[1].split()[0])))

    def close(self) -> tuple[float, float]:
        """Return the mean rate and the greatest over WINDOW [kbit/s]."""
        self._over.set()
        self._thread.join()
        rows = np.array(self.samples)
        before = np.searchsorted(rows[:, 0], rows[:, 0] - WINDOW)
        full = rows[:, 0] - rows[0, 0] >= WINDOW
        most = (rows[:, 1] - rows[before, 1])[full].max() / WINDOW
        return float(np.ptp(rows[:, 1]) / np.ptp(rows[:, 0])) * 8e-3, float(most) * 8e-3


def fly(bag: Path, kind: str, rate: float) -> dict[str, float]:
    """Fly once and return the figures of node and link."""
    with tempfile.TemporaryDirectory() as room, Network() as network:
        folder = Path(room)
        fleet = Fleet(folder)
        keys = folder / 'keys'
        with Processes(folder, network) as processes:
            network.join('ground')
            if rate:
                thin(network, rate)
            load = [LOAD, bag, '--machines', '--figures', folder / 'figures.json']
            environment = {}
            tunnel = 0
            if kind == TUNNEL:
                tunnel = processes.start_tunnel('vehicle', keys / 'vehicle', fleet.place)[0].pid
                processes.start_tunnel('ground', keys / 'ground', fleet.place)
                load += ['--keys', keys]
                environment = {'FASTRTPS_DEFAULT_PROFILES_FILE': str(keys / 'driver/fastdds.xml')}
            bench = processes.start('vehicle', environment, *load)
            said, told = read_lines(bench.stdout), read_lines(bench.stderr)
            wait_until(lambda: said, 'bench')
            monitor = processes.start(
                'ground', fleet.keys('ground') if kind == TUNNEL else {}, '-m', MONITOR, '--json'
            )
            seen = read_lines(monitor.stdout)
            wait_until(lambda: seen and json.loads(seen[-1])['vehicle'], 'flight', PATIENCE)
            meter, delays = Meter(network.find_pid('ground')), []
            spans = lost = 0
            while bench.poll() is None:
                time.sleep(0.5)
                last = json.loads(seen[-1])
                lost = max(lost, last['counts']['lost_summary'])
                spans = max(spans, len(last['spans']))
                delays.append(last['age']['link'])
            mean, most = meter.close()
            beside = read_processor_time(tunnel) / (meter.samples[-1][0] - meter.samples[0][0])
        if bench.returncode:
            raise SystemExit(f'the bench failed: {"".join(told[-3:])}')
        figures: dict[str, float] = json.loads((folder / 'figures.json').read_text())
    return figures | {
        'link, mean [kbit/s]': mean, f'link, most over {WINDOW:g} s [kbit/s]': most,
        "tunnel's own processor [cores]": beside,
        'silence of the summary, median [s]': float(np.median(delays)),
        'messages of the summary lost': lost, 'spans on the ground': spans,
    }


def read_processor_time(pid: int) -> float:
    """Return what a process has taken [s], 0 for none."""
    if not pid:
        return 0.0
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def thin(network: Network, rate: float) -> None:
    """Let no more than so many kbit/s reach the ground."""
    subprocess.run(
        [*network.join('vehicle'), 'tc', 'qdisc', 'add', 'dev', network.find_port('ground'),
         'root', 'tbf', 'rate', f'{rate:g}kbit', 'burst', '16kb', 'latency', LATENCY], check=True,
    )


def compare(flights: dict[str, list[dict[str, float]]]) -> tuple[str, list[str]]:
    """Return the table of medians, and what is not kept."""
    rows, flaws = [], []
    for name in flights[PLAIN][0]:
        plain, tunnel = (
            float(np.median([flight[name] for flight in flights[kind]]))
            for kind in (PLAIN, TUNNEL)
        )
        change = tunnel / plain - 1.0 if plain else 0.0
        own = plain > 0.0 and any(unit in name for unit in ('[cores]', '[MB]', '[ms]'))
        if own and change > GROWTH:
            flaws.append(f'{name}: {change:+.1%}, more than {GROWTH:+.0%}')
        if 'most over' in name and tunnel > BUDGET:
            flaws.append(f'{name}: {tunnel:.0f}, more than {BUDGET:g}')
        spread = ' to '.join(f'{item:.3g}' for item in sorted(
            flight[name] for flight in flights[TUNNEL])[::max(1, len(flights[TUNNEL]) - 1)])
        told = f'{change:+.1%}' if plain else '-'
        rows.append((name, f'{plain:.4g}', f'{tunnel:.4g}', told, spread))
    return render_table(('figure', PLAIN, TUNNEL, 'change', 'spread of the tunnel'), rows), flaws


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench; 1 where something is not kept."""
    parser = argparse.ArgumentParser(description='Measures what the tunnel costs.')
    parser.add_argument('bag', type=Path, nargs='?', default=ROOT / 'bags/demo')
    parser.add_argument('--turns', type=int, default=3, metavar='N', help='flights of each kind')
    parser.add_argument('--rate', type=float, default=0.0, metavar='KBPS',
                        help='rate of the link; 0: as fast as it goes')
    parser.add_argument('--write', action='store_true', help='put the table into the docs')
    arguments = parser.parse_args(argv)
    flights: dict[str, list[dict[str, float]]] = {PLAIN: [], TUNNEL: []}
    for turn in range(arguments.turns):
        for kind in (PLAIN, TUNNEL):
            flights[kind].append(fly(arguments.bag, kind, arguments.rate))
            print(f'turn {turn}, {kind}, load {os.getloadavg()[0]:.1f}: {flights[kind][-1]}',
                  flush=True)
    table, flaws = compare(flights)
    what = f'thin link of {arguments.rate:g} kbit/s' if arguments.rate else 'link without a limit'
    text = (f'{table}\n\nMedians of {arguments.turns} flights of each kind by turns, {what}, '
            f'load {os.getloadavg()[2]:.0f} on {os.cpu_count()} cores.')
    print(text)
    for flaw in flaws:
        print(f'tunnel cost: {flaw}')
    if arguments.write:
        replace_section(DOCUMENT, 'thin link' if arguments.rate else 'tunnel cost', text)
    return 1 if flaws else 0


if __name__ == '__main__':
    sys.exit(main())
