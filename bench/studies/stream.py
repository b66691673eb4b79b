# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measures the stream for thin links, and what monitors cost the node.

One flight is flown four times: twice without a monitor, and between these twice with three, of
which this process is one, so that what else the machine does weighs the same on both.  Sizes are
those of the messages with what DDS, UDP and IP add (``stream/budget.py``).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from node_load import measure, Probe, run

from plc_inspect.ros.graph.domain import set_apart
from plc_inspect.ros.graph.transport import prepare_transport
from plc_inspect.stream.budget import OVERHEAD

BUDGET = 256.0
"""What the stream may use [kbit/s]."""
LIMIT = 5.0
"""What the summary may use on average [kB/s]."""
BESIDE = 2
"""Monitors beside this process."""
GROWTH = 0.10
"""Share by which the node's own figures may change."""
LIMITED = ('processor [cores]', 'memory at most [MB]', 'tick, median [ms]', 'tick, p95 [ms]')
WINDOW = 5.0
"""The rate of the stream is the greatest mean over this [s]."""


class Sizes:
    """Listens to both topics of the stream."""

    def __init__(self) -> None:
        self.messages: dict[str, list[tuple[float, int]]] = {'summary': [], 'thin_corridor': []}

    def watch(self, probe: Probe) -> None:
        """Subscribe."""
        from std_msgs.msg import UInt8MultiArray

        from plc_inspect.ros.graph.qos import SUMMARY, THIN_CORRIDOR

        for name, qos in (('summary', SUMMARY), ('thin_corridor', THIN_CORRIDOR)):
            probe.node.create_subscription(
                UInt8MultiArray, f'/plc_inspect/{name}',
                lambda message, own=self.messages[name]: own.append(
                    (time.monotonic(), len(message.data) + OVERHEAD)
                ), qos,
            )

    def rate(self, *names: str) -> tuple[float, float]:
        """Return the mean and the greatest rate [B/s]."""
        rows = np.array(sorted(row for name in names for row in self.messages[name]))
        total = np.concatenate(([0.0], np.cumsum(rows[:, 1])))
        before = np.searchsorted(rows[:, 0], rows[:, 0] - WINDOW)
        most = (total[1:] - total[before]).max() / WINDOW
        return float(total[-1] / np.ptp(rows[:, 0])), float(most)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; 1 where a limit is not kept."""
    parser = argparse.ArgumentParser(description='Measures the stream for thin links.')
    parser.add_argument('bag', type=Path, help='a flight, such as bench/live/node_flight.py makes')
    parser.add_argument('--seconds', type=float, default=340.0, metavar='S',
                        help='length of the flight (default: %(default)s, ten spans)')
    arguments = parser.parse_args(argv)
    prepare_transport()
    set_apart()
    sizes, figures = Sizes(), {0: [], BESIDE: []}
    for monitors in (0, BESIDE, BESIDE, 0):
        sizes = Sizes() if monitors else sizes
        with tempfile.TemporaryDirectory() as room:
            probe, _ = run(
                arguments.bag, Path(room) / 'out', 10.0, [f'stream.max_kbps:={BUDGET}'],
                seconds=arguments.seconds, monitors=monitors,
                watch=sizes.watch if monitors else None,
            )
        figures[monitors].append(measure(probe))
    print(f'{arguments.bag}: {arguments.seconds:.0f} s, {probe.values["spans"]} conductor-spans')
    mean, _ = sizes.rate('summary')
    good = mean <= LIMIT * 1e3
    print(f'summary: {mean / 1e3:.2f} kB/s on average (limit {LIMIT:g})')
    mean, most = (value * 8e-3 for value in sizes.rate('summary', 'thin_corridor'))
    good &= most <= BUDGET
    print(f'summary and corridor: {mean:.0f} kbit/s on average, {most:.0f} at most over '
          f'{WINDOW:g} s (budget {BUDGET:g})')
    for name in LIMITED:
        alone, beside = (np.mean([item[name] for item in turns]) for turns in figures.values())
        share = beside / alone - 1.0
        good &= share <= GROWTH
        print(f'{name}: {alone:.2f} alone, {beside:.2f} with three monitors '
              f'({share:+.1%}, limit {GROWTH:+.0%})')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
