# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Write the report of a section: the spans that belong to one tile, and their surroundings.

Points come from every tile that the spans reach into, with the numbers of the grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numba import njit
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.grid.tiles.plain_results import POINT_FIELDS, Rectangle
from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.grid.tiles.tile_points import renumber
from plc_inspect.offline.export.coverage_files import make_plan, write_coverage_views
from plc_inspect.offline.export.files import describe_frame, write_json
from plc_inspect.offline.records.coverage_record import describe_coverage, review_coverage
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.units import Units
from plc_inspect.offline.report.report import render_report
from plc_inspect.results import Bool, Float64, Hazard, InspectionResult, Span, Support
from plc_inspect.whole_files import replace_file

REPORT = 'report.html'
COVERAGE = 'coverage.json'
VIEWS = (COVERAGE, 'coverage.geojson', 'refly.geojson', 'refly.plan')
"""Files beside a report, of which the last three need a coordinate reference system."""
REACH = 40.0
"""
A report shows points within this distance of the outer conductors, in plan [m].
Source: derived: the corridor, and the strips of ground beside it whose coverage is told.
"""
CELL = 20.0
"""Cells in which strips are looked up [m].  Source: numerical: time alone depends on it."""

Numbers = tuple[tuple[int, int, int, int], ...]
"""Line and span in a tile, then in the grid."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """The spans that belong to one tile, and what its report needs."""

    source: str
    spans: tuple[Span, ...]
    """Those that belong to it, numbered over the grid."""
    others: tuple[Span, ...]
    """Those of other tiles that the flight over its gaps could come near."""
    supports: tuple[Support, ...]
    """Supports at their ends."""
    hazards: tuple[Hazard, ...]
    vegetation: tuple[tuple[int, int, float | None], ...]
    """Line, span, and distance of the span to vegetation [m]."""
    settings: Settings
    rules: RuleSet | None
    crs: str
    units: Units


def find_strips(spans: Sequence[Span]) -> list[tuple[Float64, Float64, Float64]]:
    """
    Return a rectangle in plan about the conductors of each span, REACH wider on all sides.

    Returns
    -------
    list of tuple
        A corner, the axes (2, 2) along and across, and length and width [m].

    """
    groups: dict[int, list[Span]] = {}
    for span in spans:
        groups.setdefault(span.span_id, []).append(span)
    strips = []
    for own in groups.values():
        along = (own[0].end - own[0].start)[:2] / max(own[0].length, 1e-9)
        axes = np.array([along, [-along[1], along[0]]])
        ends = np.array([end[:2] for span in own for end in (span.start, span.end)]) @ axes.T
        low, high = ends.min(axis=0) - REACH, ends.max(axis=0) + REACH
        strips.append((low, axes, high - low))
    return strips


def is_near(strips: Sequence[tuple[Float64, Float64, Float64]], points: Float64) -> Bool:
    """Tell which points (N, 3) lie in one of the strips."""
    rows = np.array([[*low, *axes.ravel(), *size] for low, axes, size in strips]).reshape(-1, 8)
    x0, y0, x1, y1 = bound(strips)
    columns, lines = int((x1 - x0) / CELL) + 1, int((y1 - y0) / CELL) + 1
    # of each square cell, the strips that may reach into it
    centers = np.stack(np.meshgrid(
        x0 + (np.arange(columns) + 0.5) * CELL, y0 + (np.arange(lines) + 0.5) * CELL,
    ), axis=-1).reshape(-1, 2)
    held = [
        np.flatnonzero((np.abs(centers @ axes.T - low - size / 2) <= size / 2 + CELL).all(axis=1))
        for low, axes, size in strips
    ]
    cell, strip = np.concatenate(held), np.repeat(np.arange(len(held)), [len(own) for own in held])
    start = np.searchsorted(np.sort(cell), np.arange(columns * lines + 1))
    order = np.argsort(cell, kind='stable')
    near: Bool = _is_near(rows, points, x0, y0, columns, lines, CELL, start, strip[order])
    return near


@njit(cache=True, nogil=True)
def _is_near(  # type: ignore[no-untyped-def]
    rows, points, x0, y0, columns, lines, edge, start, strips
):
    result = np.zeros(len(points), dtype=np.bool_)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        right, up = (x - x0) / edge, (y - y0) / edge
        if not (0.0 <= right < columns and 0.0 <= up < lines):
            continue
        cell = int(up) * columns + int(right)
        for k in range(start[cell], start[cell + 1]):
            row = rows[strips[k]]
            along = x * row[2] + y * row[3] - row[0]
            across = x * row[4] + y * row[5] - row[1]
            if 0.0 <= along <= row[6] and 0.0 <= across <= row[7]:
                result[i] = True
                break
    return result


def bound(strips: Sequence[tuple[Float64, Float64, Float64]]) -> Rectangle:
    """Return least x and y, greatest x and y of strips [m]."""
    corners = np.array([
        (low + size * share) @ axes
        for low, axes, size in strips for share in ((0, 0), (0, 1), (1, 0), (1, 1))
    ])
    (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return x0, y0, x1, y1


def write_section_report(
    folder: str, section: Section, tiles: Sequence[tuple[TileJob, Numbers]]
) -> dict[str, Any]:
    """
    Write the report of one section.

    Parameters
    ----------
    folder : str
        Receives the report and the coverage of the section.
    section : Section
        What is reported.
    tiles : sequence of tuple
        The inspected tiles that hold points near it, with the numbers of their spans.

    Returns
    -------
    dict
        Number of sections, number seen well enough to rule out a hazard, length of the gaps [m].

    """
    strips = find_strips(section.spans)
    parts = [_read_near(job, numbers, strips) for job, numbers in tiles]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    points = arrays.pop('points')
    corridor = np.flatnonzero(np.isfinite(arrays['clearance']))
    result = InspectionResult(
        spans=section.spans, supports=section.supports, hazards=section.hazards, stages=(),
        corridor=corridor, corridor_line_id=arrays['line_id'][corridor],
        corridor_span_id=arrays['span_id'][corridor], **arrays,
    )
    inspection = Inspection(
        result=result, points=points, settings=section.settings, source=section.source,
        command='plc_survey', crs=section.crs, units=section.units, rules=section.rules,
    )
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    remove_report(place)
    sight = review_coverage(inspection, section.others)
    record = describe_coverage(sight, section.units)
    write_json(place / COVERAGE, describe_frame(inspection) | record)
    write_coverage_views(place, inspection, sight)
    if (plan := make_plan(inspection, sight)) is not None:
        write_json(place / VIEWS[-1], plan)
    page = render_report(inspection, sight, clearances={
        (line, span): distance for line, span, distance in section.vegetation
    })
    with replace_file(place / REPORT) as aside:
        aside.write_text(page, encoding='utf-8')
    seen = sight.coverage.sections
    return {
        'num_points': len(points), 'num_sections': len(seen),
        'num_enough': sum(item.is_enough for item in seen),
        'gap_length': float(sum(gap.length for gap in sight.coverage.gaps)),
    }


def remove_report(folder: Path) -> None:
    """Remove the report of a tile, and what lies beside it."""
    for name in (REPORT, *VIEWS):
        (folder / name).unlink(missing_ok=True)


def _read_near(
    job: TileJob, numbers: Numbers, strips: Sequence[tuple[Float64, Float64, Float64]]
) -> dict[str, np.ndarray]:
    """Return the points of a tile that lie in strips, and what they are."""
    points = job.read(0.0).points
    rows = np.flatnonzero(is_near(strips, points))
    with np.load(f'{job.place}.labels.npz') as known:
        labels: dict[str, np.ndarray] = {
            name: known[name][rows] for name in (*POINT_FIELDS, 'ground_height')
        }
        residual = np.full(len(points), np.nan, dtype=np.float32)
        residual[known['wire']] = known['residual']
    labels['ground_height'] = labels['ground_height'].astype(np.float32)
    labels['line_id'], labels['span_id'] = renumber(
        labels['line_id'], labels['span_id'], numbers
    )
    labels |= {'points': points[rows], 'residual': residual[rows]}
    return labels

