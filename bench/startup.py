# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Times the start of ``plc_node``: from the start of its process to its line "ready".

A first start, which is not counted, compiles what is not compiled yet, kernels and, as an
installation does, modules.  Beside it stands a process that only loads the modules of the node.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import signal
import statistics
import subprocess
import sys
import tempfile
import time

from common.measure import compile_once
from common.tables import at_most, CHECK_COLUMNS, render_table, replace_section

ROOT = Path(__file__).resolve().parents[1]
GOAL = 2.0
"""Start of the process to ready [s]."""
NODE = ('-m', 'plc_inspect.ros.node.onboard')
MODULES = ('-c', 'import plc_inspect.ros.node.inspect_node')
PATIENCE = 120.0
"""A node that is told to end may take this long [s]."""


def start_node(environment: dict[str, str]) -> float:
    """Return the time to ready [s] of one node, and end it; raises if it never is."""
    started = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, *NODE], cwd=ROOT, env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as node:
        said = []
        for line in node.stdout or ():
            said.append(line)
            if line.rstrip().endswith('ready'):
                break
        seconds = time.perf_counter() - started
        node.send_signal(signal.SIGINT)
        try:
            node.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            node.kill()
            raise
    if not said or not said[-1].rstrip().endswith('ready'):
        raise RuntimeError(f'plc_node never was ready: {" ".join(said)[-500:]}')
    return seconds


def load_modules(environment: dict[str, str]) -> float:
    """Return the time of a process that loads the node's modules [s]."""
    started = time.perf_counter()
    subprocess.run([sys.executable, *MODULES], cwd=ROOT, env=environment, check=True)
    return time.perf_counter() - started


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description='Times the start of plc_node.')
    parser.add_argument('--repeats', type=int, default=9)
    parser.add_argument('--domain', type=int, default=91, help='DDS domain')
    parser.add_argument('--write', action='store_true', help='into docs/performance.md')
    arguments = parser.parse_args(argv)
    if arguments.repeats < 1:
        parser.error('repeats must be 1 or more')
    with tempfile.TemporaryDirectory() as room:
        environment = compile_once(Path(room)) | {
            'ROS_DOMAIN_ID': str(arguments.domain), 'ROS_LOG_DIR': room,
            'PYTHONUNBUFFERED': '1',
        }
        start_node(environment)
        loads, starts = [], []
        for _ in range(arguments.repeats):
            loads.append(load_modules(environment))
            starts.append(start_node(environment))
    rows = [
        (name, f'{min(times):.2f}', f'{statistics.median(times):.2f}', f'{max(times):.2f}')
        for name, times in (('modules loaded', loads), ('ready', starts))
    ]
    check = at_most('plc_node', 'process to ready, median', statistics.median(starts), GOAL, 's')
    page = '\n\n'.join([
        f'{arguments.repeats} starts, by turns with processes that load the modules alone.',
        render_table(('start of the process to', 'least [s]', 'median [s]', 'greatest [s]'), rows),
        render_table(CHECK_COLUMNS[:5], [check.row()[:5]]),
    ])
    print(page)
    if arguments.write:
        replace_section(ROOT / 'docs/performance.md', 'startup', page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
