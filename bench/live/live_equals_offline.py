# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compares the live node with a replay of the same recording.

Node and player run as two processes over DDS at rate 1; then ``plc_replay`` reads the same bag.
Printed: conductor-spans of both, and how far their catenaries are apart.  The exit code is 1
unless the spans are the same and none is 2 cm or more away.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import subprocess
import sys
import tempfile

import numpy as np

from plc_inspect.offline.commands.replay import main as replay
from plc_inspect.offline.records.results_reader import read_run, read_table
from plc_inspect.results import catenary_heights

ROOT = Path(__file__).parents[2]
LIMIT = 0.02
"""Greatest distance of two catenaries [m]."""


def sample(span: dict) -> np.ndarray:
    """Return (41, 3) points along a catenary, its ends included [m]."""
    share = np.linspace(0.0, 1.0, 41)[:, None]
    start, end = np.array(span['start']), np.array(span['end'])
    points = start + share * (end - start)
    x = share[:, 0] * span['length']
    points[:, 2] = catenary_heights(span['a'], span['b'], span['c'], x)
    return points


def compare(live: Sequence[dict], offline: Sequence[dict]) -> tuple[list[float], int, int]:
    """Return the greatest distance of each pair [m], and the spans without a partner of both."""
    rest = list(range(len(offline)))
    apart = []
    for span in live:
        own = sample(span)
        gaps = []
        for number in rest:
            other = sample(offline[number])
            both = np.linalg.norm(own - other, axis=1), np.linalg.norm(own - other[::-1], axis=1)
            gaps.append(min(float(gap.max()) for gap in both))
        if gaps and min(gaps) < 1.0:
            apart.append(min(gaps))
            del rest[int(np.argmin(gaps))]
    return apart, len(live) - len(apart), len(rest)


def main(argv: Sequence[str] | None = None) -> int:
    """Run both and compare; return 0 if they agree."""
    parser = argparse.ArgumentParser(description='Compares the live node with a replay.')
    parser.add_argument('bag', type=Path, nargs='?', default=ROOT / 'bags' / 'demo')
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as room:
        live, offline = Path(room, 'live'), Path(room, 'offline')
        subprocess.run(
            [sys.executable, '-m', 'plc_inspect.ros.demo', str(arguments.bag), str(live)],
            cwd=ROOT, check=True, stdout=subprocess.DEVNULL,
        )
        if replay([str(arguments.bag), '-o', str(offline), '--quiet']):
            return 1
        apart, only_live, only_offline = compare(
            *(read_table(folder, 'spans')['spans'] for folder in (live, offline))
        )
        counts = read_run(live)['input']['counts']
    print(f'{arguments.bag}: {counts["num_scans_inserted"]} scans live, '
          f'{counts["num_scans_lost"]} lost')
    print(f'conductor-spans: {len(apart)} in both, {only_live} only live, '
          f'{only_offline} only offline')
    greatest = max(apart, default=0.0)
    print(f'distance of catenaries: greatest {greatest * 1e3:.2f} mm, limit {LIMIT * 1e3:.0f} mm')
    return int(bool(only_live or only_offline or greatest >= LIMIT or not apart))


if __name__ == '__main__':
    sys.exit(main())
