# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A Dask cluster of processes on loopback, whose workers may be killed."""

from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
import time

from grid.tasks import DEADLINE


@contextmanager
def start_cluster(folder, num_workers=2):
    """Start a scheduler and workers; yield the scheduler's file and the workers."""
    named = folder / 'scheduler.json'
    tests = str(Path(__file__).parents[1])
    common = {'cwd': folder, 'stderr': subprocess.DEVNULL, 'env': os.environ | {
        'PYTHONPATH': os.pathsep.join([tests, str(Path(tests).parent)]), 'NUMBA_NUM_THREADS': '1',
    }}
    processes = [subprocess.Popen(
        [sys.executable, '-m', 'distributed.cli.dask_scheduler', '--host', '127.0.0.1', '--port',
         '0', '--no-dashboard', '--scheduler-file', str(named)], **common,
    )]
    try:
        deadline = time.monotonic() + DEADLINE
        while not named.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        processes += [subprocess.Popen(
            [sys.executable, '-m', 'distributed.cli.dask_worker', '--scheduler-file', str(named),
             '--nthreads', '1', '--no-nanny', '--no-dashboard', '--host', '127.0.0.1',
             '--memory-limit', '2GB'], **common,
        ) for _ in range(num_workers)]
        yield named, processes[1:]
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(DEADLINE)
