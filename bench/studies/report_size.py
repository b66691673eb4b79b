# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Size of the report of a simulated survey of twenty spans, and how soon a browser shows it.

The survey goes the whole way: a LAZ file, ``plc_survey``, and its ``report.html`` opened in a
headless Chromium.  The first view is there when the page is laid out and the 3D view is drawn.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import re
import subprocess
import sys
import tempfile

from common.tables import at_least, at_most, Check, CHECK_COLUMNS, render_table, replace_section
import laspy
import numpy as np

from plc_inspect.errors import ConfigError
from plc_inspect.offline.commands.survey import main as survey
from plc_inspect.offline.records.results_reader import read_run
from plc_inspect.offline.report.browser import find_browser, FLAGS
from plc_inspect.sim.scenes import lines, vegetation
from plc_inspect.sim.scenes.scene import Scene, SceneBuilder
from plc_inspect.sim.scenes.terrain import make_terrain
from plc_inspect.sim.surveys.airborne import simulate_map

ROOT = Path(__file__).parents[2]
PAGE = ROOT / 'docs/results.md'
SPAN = 90.0
"""Length of a span [m]."""
TRIALS = 5
MEGABYTE = 1e6


def make_line(num_spans: int, seed: int) -> Scene:
    """Return a medium-voltage line over hills, with a tree too near to every other span."""
    rng = np.random.default_rng(seed)
    length = num_spans * SPAN
    terrain = make_terrain(rng, (-80.0, -120.0, length + 80.0, 120.0), 10.0, 400.0)
    builder = SceneBuilder(name='long', seed=seed, terrain=terrain, rng=rng)
    route = np.column_stack([
        np.arange(num_spans + 1) * SPAN, 25.0 * np.sin(np.arange(num_spans + 1) / 4.0),
    ])
    lines.add_line(builder, lines.MEDIUM_VOLTAGE, route)
    for span_id in range(0, num_spans, 2):
        outer = max((item for item in builder.conductors if item.span_id == span_id),
                    key=lambda item: item.start[1])
        vegetation.plant_beside(builder, outer, rng.uniform(0.3, 0.7), 1, rng.uniform(0.5, 3.0))
    spots = np.column_stack([
        rng.uniform(0.0, length, 30 * num_spans), rng.uniform(-60.0, 60.0, 30 * num_spans),
    ])
    vegetation.scatter_trees(builder, spots, (4.0, 14.0))
    ends = route[[0, -1]] + [[-15.0, 0.0], [15.0, 0.0]]
    return builder.build(np.vstack([ends[:1], route[1:-1], ends[1:]]), 50.0)


def write_laz(path: Path, scene: Scene, density: float, seed: int) -> int:
    """Survey a scene from above into a file; return the number of points."""
    points = simulate_map(scene, density, np.random.default_rng(seed)).points
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales, header.offsets = np.full(3, 1e-3), np.floor(points.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(path)
    return len(points)


def time_first_view(page: Path) -> float:
    """Open a page in a new browser; return the time to its first view by its own clock [s]."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        done = subprocess.run(
            [find_browser(), *FLAGS, f'--user-data-dir={profile}', '--window-size=1200,2400',
             '--timeout=20000', '--dump-dom', page.absolute().as_uri()],
            capture_output=True, timeout=120, check=True, text=True,
        )
    found = re.search(r'data-first-view="(\d+)"', done.stdout)
    return int(found[1]) / 1000.0 if found else float('nan')


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; exit 1 where a floor is missed."""
    parser = argparse.ArgumentParser(description='Size and first view of a report.')
    parser.add_argument('--spans', type=int, default=20)
    parser.add_argument('--density', type=float, default=20.0, help='pulses per square metre')
    parser.add_argument('--keep', type=Path, metavar='OUT', help='keep the results folder here')
    parser.add_argument('--write', action='store_true', help=f'into {PAGE.relative_to(ROOT)}')
    arguments = parser.parse_args(argv)
    try:
        find_browser()
    except ConfigError as error:
        print(f'skipped: the first view, as {error}', file=sys.stderr)
    with tempfile.TemporaryDirectory() as room:
        cloud, out = Path(room, 'long.laz'), arguments.keep or Path(room, 'out')
        num_points = write_laz(cloud, make_line(arguments.spans, 0), arguments.density, 0)
        if survey([str(cloud), '-o', str(out), '--quiet', '--force']):
            return 1
        run = read_run(out)
        page = out / 'report.html'
        checks = [
            at_least('long', 'spans in the report', float(run['num_spans']),
                     3.0 * arguments.spans, remark='of three lines'),
            at_most('long', 'size of report.html', page.stat().st_size / MEGABYTE, 15.0, 'MB',
                    f'{num_points:,} points, {run["num_hazards"]} hazards'),
            *_check_view(page),
        ]
    text = render_table(CHECK_COLUMNS, [check.row() for check in checks])
    print(text)
    if arguments.write:
        replace_section(PAGE, 'report', text)
    return 0 if all(check.passed for check in checks) else 1


def _check_view(page: Path) -> list[Check]:
    try:
        times = sorted(time_first_view(page) for _ in range(TRIALS))
    except ConfigError:
        return []
    return [at_most('long', 'time to first view, median', times[TRIALS // 2], 3.0, 's',
                    f'{TRIALS} starts, greatest {times[-1]:.2f} s')]


if __name__ == '__main__':
    sys.exit(main())
