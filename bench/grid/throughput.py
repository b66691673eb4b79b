# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Time and memory of a grid: beside a single survey, with more workers, and in the plan alone.

A simulated corridor, copies of one laid end to end, is surveyed as a grid with each number of
workers, and its first copies in one run, by turns in processes of their own; printed are times,
points a second, ratios to the single survey for each point, also by processor time, which a busy
machine changes less, the load, and the peak memory of the parent and of tiles.  ``--empty N``
plans a grid of N tiles that hold a few points each. A cloud that no single run can hold is
surveyed as a grid alone, with ``--allowed GB`` as the address space of each process.
"""

import argparse
from collections.abc import Sequence
import json
import os
from pathlib import Path
import resource
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common.surveys import make_map, open_cache
from common.tables import render_table
import laspy
import numpy as np

from plc_inspect.grid.cells.layout import lay_cells, lay_tiles
from plc_inspect.grid.cells.sources import read_sources

GAP = 0.0
SINGLE_COPIES = 10
"""Most copies in the single survey: 10 million points by default."""
COLUMNS = ('run', 'time [s]', 'processor [s]', 'points/s', 'to single', 'by processor', 'load',
           'parent [GB]', 'largest tile [GB]', 'tiles', 'read/points')
RUN = (
    'import json, resource, sys, time; begun = time.perf_counter();'
    'from plc_inspect.offline.commands.survey import main; code = main(sys.argv[1:]);'
    'used = [resource.getrusage(who)'
    ' for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)];'
    'print(json.dumps([code, time.perf_counter() - begun,'
    ' sum(item.ru_utime + item.ru_stime for item in used), used[0].ru_maxrss * 1024]))'
)


def write_corridor(path: Path, cache: Path, num: int, copies: int) -> Path:
    """Write copies of a corridor, end to end, as LAS; a copy at a time."""
    points = make_map(cache, 'high_voltage', num_points=num).points
    pitch = float(np.ptp(points[:, 0])) + GAP
    header = laspy.LasHeader(version='1.4', point_format=6)
    header.scales, header.offsets = np.full(3, 1e-3), np.floor(points.min(axis=0))
    with laspy.open(path, mode='w', header=header) as writer:
        for copy in range(copies):
            record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
            record.x, record.y = points[:, 0] + copy * pitch, points[:, 1]
            record.z = points[:, 2]
            writer.write_points(record)
    return path


def run(*arguments: str, allowed: float = 0.0) -> tuple[float, float, float]:
    """
    Run plc_survey in a process of its own; return times [s] and peak memory [bytes].

    ``allowed`` is the address space of it and of each of its children [bytes], 0 for any.
    """
    limits = (int(allowed),) * 2
    done = subprocess.run(
        [sys.executable, '-c', RUN, *arguments, '--quiet'], capture_output=True, text=True,
        check=False,
        preexec_fn=(lambda: resource.setrlimit(resource.RLIMIT_AS, limits)) if allowed else None,
    )
    if done.returncode:
        raise SystemExit(done.stderr)
    code, seconds, busy, peak = json.loads(done.stdout.splitlines()[-1])
    if code:
        raise SystemExit(f'plc_survey ended with {code}: {done.stderr}')
    return seconds, busy, peak


def measure(
    path: Path, num_points: int, part: tuple[Path, int] | None, workers: Sequence[int],
    options: Sequence[str], allowed: float,
) -> list:
    """Return the rows of a single survey of a part, with its points, if any, and of grids."""
    rows, single, single_busy = [], np.nan, np.nan
    with tempfile.TemporaryDirectory(dir=path.parent) as room:
        if part is not None:
            seconds, busy, peak = run(str(part[0]), '-o', f'{room}/single')
            single, single_busy = seconds / part[1], busy / part[1]
            rows.append((
                f'single, {part[1]:,} points', f'{seconds:.1f}', f'{busy:.1f}',
                f'{part[1] / seconds:,.0f}', '1.00', '1.00', f'{os.getloadavg()[0]:.1f}',
                f'{peak / 1e9:.2f}', '-', '-', '-',
            ))
        for num in workers:
            out = Path(room) / f'grid{num}'
            wish = ('--workers', str(num)) if num else ('--tile', '1e9')  # makes it a grid
            name = f'grid, {num} workers' if num else 'grid, by default'
            seconds, busy, peak = run(str(path), '-o', str(out), *wish, *options, allowed=allowed)
            tiles = read_answers(out)
            rows.append((
                name, f'{seconds:.1f}', f'{busy:.1f}',
                f'{num_points / seconds:,.0f}', f'{seconds / num_points / single:.2f}',
                f'{busy / num_points / single_busy:.2f}', f'{os.getloadavg()[0]:.1f}',
                f'{peak / 1e9:.2f}',
                f'{max(item["peak_memory"] for item in tiles) / 1e9:.2f}', str(len(tiles)),
                f'{sum(item["num_read"] for item in tiles) / num_points:.2f}',
            ))
    return rows


def read_answers(folder: Path) -> list[dict]:
    """Return what the ledger of a grid tells of its tiles."""
    import sqlite3

    with sqlite3.connect(folder / 'ledger.sqlite') as database:
        return [json.loads(row[0]) for row in database.execute(
            "SELECT answer FROM task WHERE stage = 'tile' AND state = 'done'"
        )]


def plan_empty(num: int) -> list[tuple[str, ...]]:
    """Return the row of a plan of many tiles of a few points."""
    with tempfile.TemporaryDirectory() as room:
        side = int(np.ceil(np.sqrt(num)))
        paths = []
        for k in range(num):
            header = laspy.LasHeader(version='1.4', point_format=6)
            header.scales = np.full(3, 1e-3)
            header.offsets = np.array([1000.0 * (k % side), 1000.0 * (k // side), 0.0])
            las = laspy.LasData(header)
            las.x = header.offsets[0] + np.array([1.0, 999.0])
            las.y = header.offsets[1] + np.array([1.0, 999.0])
            las.z = np.zeros(2)
            paths.append(Path(room) / f'{k:06d}.las')
            las.write(paths[-1])
        begun = time.perf_counter()
        sources, _ = read_sources(paths)
        boxes = [(*source.low[:2], *source.high[:2]) for source in sources]
        cells = lay_cells(boxes, 2 * num, 5_000_000)
        counts = np.bincount(cells.number(
            np.array([box[0] for box in boxes]), np.array([box[1] for box in boxes])
        ), minlength=cells.rows * cells.columns)
        tiles = lay_tiles(cells, counts, 500.0, 5_000_000)
        seconds = time.perf_counter() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return [(f'plan of {num} inputs', f'{seconds:.1f}', '-', '-', '-', '-',
             f'{os.getloadavg()[0]:.1f}', f'{peak / 1e9:.2f}', '-', str(len(tiles)), '-')]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('--points', type=int, default=1_000_000, help='of each copy')
    parser.add_argument('--copies', type=int, default=10)
    parser.add_argument('--workers', type=int, nargs='*', default=[0, 1, 2],
                        help='0: as many as pay')
    parser.add_argument('--empty', type=int, default=0, metavar='N', help='plan N tiles as well')
    parser.add_argument('--allowed', type=float, default=0.0, metavar='GB',
                        help='address space of each process; no single survey is made')
    parser.add_argument('--cache', type=Path, help='folder for surveys')
    parser.add_argument('--room', type=Path, help='folder for what is written')
    parser.add_argument('options', nargs='*', help='of plc_survey, for grids, after --')
    arguments = parser.parse_args(argv)
    rows = plan_empty(arguments.empty) if arguments.empty else []
    if arguments.workers:
        with open_cache(arguments.cache) as cache, \
                tempfile.TemporaryDirectory(dir=arguments.room) as room:
            def write(name: str, copies: int) -> tuple[Path, int]:
                path = write_corridor(Path(room) / name, cache, arguments.points, copies)
                return path, arguments.points * copies

            whole = part = write('corridor.las', arguments.copies)
            if arguments.allowed:
                part = None
            elif arguments.copies > SINGLE_COPIES:
                part = write('part.las', SINGLE_COPIES)
            rows += measure(
                *whole, part, arguments.workers, arguments.options, 1e9 * arguments.allowed
            )
    print(render_table(COLUMNS, rows))
    return 0


if __name__ == '__main__':
    sys.exit(main())
