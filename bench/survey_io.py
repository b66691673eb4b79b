# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
``plc_survey`` as a whole process against laspy alone, which reads and rewrites the same file.

The file is a LAZ 1.4 with intensities and times, as a survey delivers it.  Both take turns; the
figures are medians of wall times.  Shows where the time of ``plc_survey`` goes.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from common.measure import compile_once
from common.surveys import make_map, open_cache
from common.tables import at_most, CHECK_COLUMNS, render_table, replace_section
import laspy
import numpy as np

from plc_inspect.offline.records.results_reader import read_run

ROOT = Path(__file__).resolve().parents[1]
MOST_RATIO = 2.5
REWRITE = 'import laspy, sys; laspy.read(sys.argv[1]).write(sys.argv[2])'
SURVEY = (
    'import sys; from plc_inspect.offline.commands.survey import main; '
    'sys.exit(main(sys.argv[1:]))'
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Process:
    """One process from start to end."""

    seconds: float
    cpu_seconds: float
    peak_bytes: float


def write_file(path: Path, points: np.ndarray) -> None:
    """Write points as a LAZ file with the attributes that a survey delivers."""
    rng = np.random.default_rng(0)
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales, header.offsets = np.full(3, 1e-3), np.floor(points.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.intensity = rng.gamma(4.0, 1000.0, len(points)).astype(np.uint16)
    las.gps_time = 2.5e8 + np.cumsum(rng.exponential(3e-6, len(points)))
    las.return_number = np.ones(len(points), dtype=np.uint8)
    las.number_of_returns = rng.choice([1, 2], len(points), p=[0.8, 0.2]).astype(np.uint8)
    las.write(path)


def run_process(environment: dict[str, str], code: str, *arguments: str) -> Process:
    """Run a Python process to its end; raises if it fails."""
    started = time.perf_counter()
    child = subprocess.Popen([sys.executable, '-c', code, *arguments], cwd=ROOT, env=environment)
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - started
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, child.args)
    return Process(
        seconds=seconds, cpu_seconds=usage.ru_utime + usage.ru_stime,
        peak_bytes=1024.0 * usage.ru_maxrss,
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description='plc_survey against laspy alone.')
    parser.add_argument('--points', type=int, default=10_000_429)
    parser.add_argument('--repeats', type=int, default=3)
    parser.add_argument('--cache', type=Path, metavar='DIR', help='keep the cloud here')
    parser.add_argument('--write', action='store_true', help='into docs/performance.md')
    arguments = parser.parse_args(argv)
    if arguments.points < 1000 or arguments.repeats < 1:
        parser.error('points must be 1000 or more and repeats 1 or more')
    with open_cache(arguments.cache) as cache, tempfile.TemporaryDirectory() as room:
        cloud = Path(room, 'cloud.laz')
        write_file(cloud, make_map(cache, 'high_voltage', num_points=arguments.points).points)
        page = compare(cloud, Path(room), arguments)
    print(page)
    if arguments.write:
        replace_section(ROOT / 'docs/performance.md', 'survey_io', page)
    return 0


def compare(cloud: Path, room: Path, arguments: argparse.Namespace) -> str:
    """Run both programs by turns and return the tables."""
    copy, results = room / 'copy.laz', room / 'results'
    alone, ours, steps = [], [], []
    environment = compile_once(room)
    run_process(environment, SURVEY, str(cloud), '-o', str(results), '--quiet')  # compiles
    run_process(environment, REWRITE, str(cloud), str(copy))
    for number in range(arguments.repeats):
        alone.append(run_process(environment, REWRITE, str(cloud), str(copy)))
        ours.append(run_process(
            environment, SURVEY, str(cloud), '-o', str(results), '--quiet', '--force'
        ))
        steps.append(read_run(results)['seconds'])
        print(f'{number + 1} of {arguments.repeats}: laspy {alone[-1].seconds:.1f} s, plc_survey '
              f'{ours[-1].seconds:.1f} s', file=sys.stderr, flush=True)
    sizes = [path.stat().st_size / 1e6 for path in (cloud, results / 'points.laz')]
    shutil.rmtree(results)
    rows = [(
        name, f'{_median(runs, "seconds"):.2f}', f'{_median(runs, "cpu_seconds"):.2f}',
        f'{_median(runs, "peak_bytes") / 1e9:.2f}',
    ) for name, runs in (('laspy alone: read and rewrite', alone), ('plc_survey', ours))]
    medians = {name: statistics.median(item[name] for item in steps) for name in steps[0]}
    parts = [(name.replace('_', ' '), f'{seconds:.2f}') for name, seconds in medians.items()]
    # points file and report are written at the same time
    medians['points_file'] = max(medians['points_file'], medians.pop('report'))
    rest = _median(ours, 'seconds') - sum(medians.values())
    ratio = _median(ours, 'seconds') / _median(alone, 'seconds')
    check = at_most('plc_survey, whole process', 'times that of laspy alone', ratio, MOST_RATIO)
    return '\n\n'.join([
        f'{arguments.points:,} points, {sizes[0]:.0f} MB in, {sizes[1]:.0f} MB in points.laz; '
        f'{arguments.repeats} runs each, by turns.',
        render_table(('process', 'time [s]', 'processor [s]', 'peak memory [GB]'), rows),
        render_table(('step of plc_survey', 'time [s]'),
                     [*parts, ('start, imports and the rest', f'{rest:.2f}')]),
        render_table(CHECK_COLUMNS[:5], [check.row()[:5]]),
    ])


def _median(runs: Sequence[Process], name: str) -> float:
    return statistics.median(getattr(run, name) for run in runs)


if __name__ == '__main__':
    sys.exit(main())
