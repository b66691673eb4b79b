# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A grid against one run over the merged cloud: how equal they are, wherever the cloud is cut.

Lines of several kinds, simulated and laid one after the other in all directions, are cut three
times at random places, and inspected tile by tile; so are clouds given as files, as
``--cloud ahn.laz``.  Printed are spans, supports and hazards that both found, the greatest
distance of the curves, and the share of points with the same class, line and span.  Two runs are
compared with: that of ``plc_survey`` over the merged cloud, and a grid of a single tile.  Both are
given what they need for cells as small as those of tiles, and for all points.
"""

import argparse
from collections.abc import Sequence
from contextlib import redirect_stderr
import io
import os
from pathlib import Path
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common.surveys import make_map, open_cache
from common.tables import render_table
import laspy
import numpy as np

from plc_inspect import __version__
from plc_inspect.config import Settings
from plc_inspect.core.numerics import plan_index
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.grid.cells import layout
from plc_inspect.grid.cells.sources import read_sources
from plc_inspect.grid.engine import OwnProcess
from plc_inspect.grid.ledger import Ledger
from plc_inspect.grid.run import GridOptions, GridRun, renumber
from plc_inspect.grid.survey_grid import inspect_sources
from plc_inspect.offline.export.files import measure_peak_memory
from plc_inspect.offline.readers.clouds import read_cloud
from plc_inspect.results import Span

SCENES = ('high_voltage', 'medium_voltage', 'low_voltage', 'angle', 'double_circuit', 'crossing')
GAP = 60.0
"""Between the boxes of two sections [m]."""
MOST_CURVE = 1e-3
"""Distance of two curves that are one [m]."""
LEAST_SAME = 0.9999
"""Share of points with the same class, and with the same line and span."""
MOST_CELLS = 400_000_000
"""
Cells of grids over the whole in one run; a survey takes coarser ones beyond 16 million.

Those of the ground decide heights, those of the index in which order fits draw points.
"""
STATIONS = np.linspace(0.0, 1.0, 11)
COLUMNS = ('cloud', 'cut', 'tiles', 'spans', 'curves [mm]', 'supports', 'hazards', 'class [%]',
           'line, span [%]')


class Found:
    """What one run found: spans, supports, hazards, and a row for each point."""

    def __init__(self, spans, supports, hazards, table):
        """Take them; the rows are x, y, z on the grid of the file, class, line, span."""
        self.spans, self.supports, self.hazards = spans, supports, hazards
        self.table = table[np.lexsort(table[:, 2::-1].T)]


def lay_sections(cache: Path, num: int, num_points: int, seed: int) -> np.ndarray:
    """Return the points of some sections of line, each turned anew, in rows [m]."""
    rng = np.random.default_rng(seed)
    parts, corner, top = [], np.zeros(2), 0.0
    per_row = int(np.ceil(np.sqrt(num)))
    for number in range(num):
        points = make_map(
            cache, SCENES[number % len(SCENES)], num_points=num_points,
            seed=number // len(SCENES),
        ).points
        way = rng.uniform(0.0, 2 * np.pi)
        cosine, sine = np.cos(way), np.sin(way)
        points = points.copy()
        points[:, :2] = points[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
        points[:, :2] += corner - points[:, :2].min(axis=0)
        parts.append(points)
        top = max(top, points[:, 1].max() + GAP)
        corner = np.array([points[:, 0].max() + GAP, corner[1]])
        if number % per_row == per_row - 1:
            corner = np.array([0.0, top])
    return np.concatenate(parts)


def write_cloud(path: Path, points: np.ndarray) -> Path:
    """Write points as LAS on a grid of a millimetre."""
    header = laspy.LasHeader(version='1.4', point_format=6)
    header.scales, header.offsets = np.full(3, 1e-3), np.floor(points.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(path)
    return path


def run_merged(path: Path) -> Found:
    """Inspect a cloud in one run."""
    begun, busy = time.perf_counter(), time.process_time()
    cloud = read_cloud(path)
    result = Pipeline().run(cloud.points)
    tell(
        f'{path.stem}: {len(cloud.points):,} points, {result.num_lines} lines, one run'
        f' {time.perf_counter() - begun:.0f} s, {time.process_time() - busy:.0f} s of processor'
        f' time, peak {measure_peak_memory() / 1e9:.1f} GB'
    )
    return Found(result.spans, result.supports, result.hazards, np.column_stack([
        cloud.las.X, cloud.las.Y, cloud.las.Z, result.classification, result.line_id,
        result.span_id,
    ]))


def run_grid(path: Path, options: GridOptions, memory: float) -> tuple[Found, int]:
    """Inspect a cloud as a grid; return what was found and the number of tiles."""
    begun, busy = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as room, Ledger(Path(room), __version__) as ledger:
        run = GridRun(
            folder=Path(room), settings=Settings(), rules=None, options=options,
            engine=OwnProcess(memory), ledger=ledger, tell=lambda *step: None,
        )
        sources, _ = read_sources([path])
        sources = renumber(sources, ledger.number_sources([str(path)]))
        summary, jobs = inspect_sources(run, sources)
        joined = summary.joined
        if run.failures:
            raise SystemExit(f'failed: {run.failures[0]}')
        tables = []
        for file in sorted(Path(room).glob('tiles/*/points.laz')):
            las = laspy.read(file)
            tables.append(np.column_stack([
                las.X, las.Y, las.Z, las.classification, las.line_id, las.span_id,
            ]))
        looks, read, cut = (
            [ledger.find_task('tile', job.tile.name)[1][name] for job in jobs]
            for name in ('looks', 'num_read', 'num_cut')
        )
    tell(
        f'{summary.kilometres:.1f} km of line, {len(jobs)} tiles, {sum(looks)} looks,'
        f' points read {sum(read) / summary.num_points:.2f} times, {sum(cut)} spans cut off,'
        f' {joined.num_unmatched} unmatched, {time.perf_counter() - begun:.0f} s,'
        f' {time.process_time() - busy:.0f} s of processor time, load {os.getloadavg()[0]:.1f}'
    )
    return Found(
        joined.spans, joined.supports, joined.hazards, np.concatenate(tables)
    ), len(jobs)


def compare(own: Found, other: Found) -> tuple[list[str], bool]:
    """Return figures of how equal two runs are, and whether all that counts is."""
    pairs, worst = [], 0.0
    middles = find_middles(other.spans)
    free = np.ones(len(middles), dtype=bool)
    for span, middle in zip(own.spans, find_middles(own.spans), strict=True):
        apart = np.where(free, np.linalg.norm(middles - middle, axis=1), np.inf)
        near = int(np.argmin(apart)) if free.any() else -1
        miss = measure_miss(span, other.spans[near]) if near >= 0 else np.inf
        if miss < 1.0:
            pairs.append((span, other.spans[near]))
            free[near] = False
            worst = max(worst, miss)
        else:
            tell(f"a span at {render_place(middle)} is one run's alone")
        if MOST_CURVE < miss < 1.0:
            tell(f'curves at {render_place(middle)} are {1000 * miss:.1f} mm apart')
    for place in middles[free]:
        tell(f"a span at {render_place(place)} is the other run's alone")
    hazards = count_same(own.hazards, other.hazards)
    supports = count_same(own.supports, other.supports)
    lines = {(a.line_id, b.line_id) for a, b in pairs}
    groups = {(a.span_id, b.span_id) for a, b in pairs}
    one_to_one = all(
        len({first for first, _ in table}) == len({second for _, second in table}) == len(table)
        for table in (lines, groups)
    )
    same_class = float((own.table[:, 3] == other.table[:, 3]).mean())
    new_line = np.full(own.table[:, 4].max() + 2, -1)
    new_span = np.full(own.table[:, 5].max() + 2, -1)
    for (line, other_line), (group, other_group) in zip(
        ((a.line_id, b.line_id) for a, b in pairs), ((a.span_id, b.span_id) for a, b in pairs),
        strict=True,
    ):
        new_line[line], new_span[group] = other_line, other_group
    same_place = (own.table[:, :3] == other.table[:, :3]).all()
    same_line = new_line[own.table[:, 4]] == other.table[:, 4]
    same_line &= new_span[own.table[:, 5]] == other.table[:, 5]
    num = (len(own.spans), len(other.spans))
    good = (
        same_place and one_to_one and len(pairs) == num[0] == num[1] and worst <= MOST_CURVE
        and supports == len(own.supports) == len(other.supports)
        and hazards == len(own.hazards) == len(other.hazards)
        and min(same_class, float(same_line.mean())) >= LEAST_SAME
    )
    return [
        f'{len(pairs)} of {num[0]}, {num[1]}', f'{1000 * worst:.4f}',
        f'{supports} of {len(own.supports)}, {len(other.supports)}',
        f'{hazards} of {len(own.hazards)}, {len(other.hazards)}',
        f'{100 * same_class:.3f}', f'{100 * float(same_line.mean()):.4f}',
    ], bool(good)


def find_middles(spans: Sequence[Span]) -> np.ndarray:
    """Return the (S, 3) middles of the curves [m]."""
    return np.array([
        span.positions(np.array([span.length / 2]))[0] for span in spans
    ]).reshape(-1, 3)


def tell(text: str) -> None:
    """Say what differs, or how far the bench is, beside the table."""
    print(text, file=sys.stderr, flush=True)


def render_place(place: np.ndarray) -> str:
    """Return a place as text [m]."""
    return '(' + ', '.join(f'{value:.2f}' for value in place) + ')'


def measure_miss(span, other) -> float:
    """Return the greatest distance of two curves, at equal shares of their lengths [m]."""
    first = span.positions(STATIONS * span.length)
    second = other.positions(STATIONS * other.length)
    apart = [np.linalg.norm(first - places, axis=1).max() for places in (second, second[::-1])]
    return float(min(apart))


def count_same(own: Sequence, other: Sequence) -> int:
    """Count things of the same kind and place, one to one."""
    free = list(other)
    count = 0
    for item in own:
        for k, candidate in enumerate(free):
            if (
                item.kind == candidate.kind
                and np.linalg.norm(item.position - candidate.position) < MOST_CURVE
                and getattr(item, 'severity', 0) == getattr(candidate, 'severity', 0)
            ):
                del free[k]
                count += 1
                break
        else:
            tell(f'one run alone: {item}')
    for item in free:
        tell(f'the other run alone: {item}')
    return count


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and return 1 where two runs are not equal."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('--cloud', type=Path, nargs='*', default=[], help='LAS or LAZ files')
    parser.add_argument('--sections', type=int, default=8, help='simulated sections; 0: none')
    parser.add_argument('--points', type=int, default=250_000, help='of each section')
    parser.add_argument('--parts', type=int, default=3, help='tiles along an edge, about')
    parser.add_argument('--halo', type=float, default=500.0, help='[m]')
    parser.add_argument(
        '--survey-alone', action='store_true', help='compare with no grid of a single tile'
    )
    parser.add_argument('--cuts', type=int, default=3)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--memory', type=float, default=5.0, help='[GB]')
    parser.add_argument('--cache', type=Path, help='folder for surveys')
    arguments = parser.parse_args(argv)
    plan_index.MAX_CELLS = MOST_CELLS
    layout.MOST_POINTS = sys.maxsize
    rng = np.random.default_rng(arguments.seed)
    rows, good = [], True
    with open_cache(arguments.cache) as cache, tempfile.TemporaryDirectory() as room:
        clouds = list(arguments.cloud)
        if arguments.sections:
            with redirect_stderr(io.StringIO()):
                points = lay_sections(
                    cache, arguments.sections, arguments.points, arguments.seed
                )
            clouds.append(write_cloud(Path(room) / f'{arguments.sections}_sections.las', points))
        for path in clouds:
            merged = run_merged(path)
            extent = float((merged.table[:, :2].max(axis=0) - merged.table[:, :2].min(axis=0)
                            ).max()) * laspy.open(path).header.scales[0]
            others = [('plc_survey', merged)]
            if not arguments.survey_alone:
                one, _ = run_grid(path, GridOptions(
                    halo=arguments.halo, edge=2.0 * extent
                ), 1e12)
                others.append(('one tile', one))
            for number in range(arguments.cuts):
                edge = extent / arguments.parts
                found, num = run_grid(path, GridOptions(
                    halo=arguments.halo, edge=edge / 4, tile_edge=edge,
                    shift=tuple(rng.uniform(0.0, edge / 4, 2)),
                ), arguments.memory * 1e9)
                for name, other in others:
                    figures, is_good = compare(found, other)
                    good &= is_good
                    rows.append((f'{path.stem}, {name}', str(number + 1), str(num), *figures))
                    tell(' | '.join(rows[-1]))
    print(render_table(COLUMNS, rows))
    return 0 if good else 1


if __name__ == '__main__':
    os.environ.setdefault('OMP_WAIT_POLICY', 'passive')
    sys.exit(main())
