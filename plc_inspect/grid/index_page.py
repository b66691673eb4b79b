# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The index page of a grid: totals, hazards from the worst on, a map, all tiles."""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
import math
from typing import Any

from plc_inspect import __version__
from plc_inspect.colors import LOOKS, severity_color
from plc_inspect.grid.cells.layout import CellGrid
from plc_inspect.grid.cells.sources import Source
from plc_inspect.grid.grid_summary import GridSummary
from plc_inspect.grid.tiles.section_report import REPORT
from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.offline.records.changes import describe_changes
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.figures import rank
from plc_inspect.results import Severity
from plc_inspect.templates import open_templates

MOST_HAZARDS = 1000
"""Hazards that are listed; the tables hold all."""
MOST_CHANGES = 50
"""Changes that are listed; changes.json holds all."""
WORST = tuple(sorted(Severity, reverse=True))
"""Severities from the worst on."""
WIDTH, HEIGHT = 1100, 700
"""Greatest size of the map [px]."""
POINTS = 'points.laz'
"""File linked for a tile without spans; the other tiles have a report."""


def render_index(
    summary: GridSummary, title: str, sources: Sequence[Source], hazards: Sequence[Record],
    jobs: Sequence[TileJob], answers: dict[str, dict[str, Any]],
    reports: dict[str, dict[str, Any]],
) -> str:
    """
    Return the index page of a grid.

    Parameters
    ----------
    summary : GridSummary
        What the grid came to.
    title : str
        Of the page.
    sources : sequence of Source
        The inputs.
    hazards : sequence of dict
        As ``hazards.json`` holds them, in their order.
    jobs : sequence of TileJob
        All tiles.
    answers : dict
        Of the tiles that were inspected.
    reports : dict
        Of the tiles that have a report.

    Returns
    -------
    str
        HTML that needs no other file; it opens the reports of the tiles.

    """
    joined, unit = summary.joined, summary.units.name
    names = {job.tile.number: job.tile.name for job in jobs}
    kinds = Counter((item['severity'], item['kind']) for item in hazards)
    number = Counter(item['severity'] for item in hazards)
    own = Counter(joined.span_tiles)
    per_tile: dict[int, Counter[Severity]] = {}
    for tile, item in zip(joined.hazard_tiles, joined.hazards, strict=True):
        per_tile.setdefault(tile, Counter())[item.severity] += 1
    worst = [job for job, _ in sorted(
        ((job, per_tile.get(job.tile.number, Counter())) for job in jobs),
        key=lambda pair: ([-pair[1][severity] for severity in WORST], pair[0].tile.name),
    )]
    totals = [
        ('of line', f'{summary.kilometres:.2f} km', ''),
        ('spans', f'{len(joined.spans):,}',
         f'{len({span.line_id for span in joined.spans})} conductors'),
        ('supports', f'{len(joined.supports):,}', ''),
        *((f'{name} hazards', number[name], ', '.join(
            f'{kind}: {count}' for (own, kind), count in sorted(kinds.items()) if own == name
        )) for name in ('critical', 'warning', 'notice')),
        ('coverage', _render_share(summary.sight['of_conductors']),
         f'of the length of conductors; {_render_sight(summary.sight)} spans seen well enough to'
         ' rule out a hazard'),
    ]
    return open_templates('grid/templates').get_template('index.html.j2').render(
        title=title, version=__version__, inputs=len(sources), points=summary.num_points,
        looks=LOOKS, crs=_name_crs(sources[0], unit), style=read_style(), unit=unit, totals=totals,
        failures=summary.failures, changes=_describe_changes(summary),
        hazards=list_worst(hazards, [names[tile] for tile in joined.hazard_tiles], reports),
        num_more=max(len(hazards) - MOST_HAZARDS, 0),
        tiles=[
            {
                'name': job.tile.name, 'page': _choose_page(job.tile.name, reports),
                'points': job.tile.num_points, 'seen': _render_sight(reports.get(job.tile.name)),
                'spans': own[job.tile.number],
                'hazards': _count(per_tile.get(job.tile.number, Counter())),
                'halo': f'{answer["halo"]:.0f}', 'seconds': f'{answer["seconds"]:.1f}',
                'memory': f'{answer["peak_memory"] / 1e9:.2f}',
            }
            for job, answer in ((job, answers.get(job.tile.name)) for job in worst)
            if answer is not None
        ],
        map=_draw_map(summary, jobs),
    )


def list_worst(
    hazards: Sequence[Record], tiles: Sequence[str], reports: dict[str, dict[str, Any]]
) -> list[Record]:
    """Return the rows of the worst hazards, in the order of the reports; each has a tile."""
    pairs = sorted(zip(hazards, tiles, strict=True), key=lambda pair: rank(pair[0]))
    return [
        {
            'severity': item['severity'], 'kind': item['kind'],
            'line_id': item['line_id'], 'span_id': item['span_id'],
            'measured': _number(find_measured(item)[0]), 'required': _number(item['required']),
            'place': ', '.join(_number(value) for value in item['position']),
            'tile': tile, 'text': item['text'], 'page': _choose_page(tile, reports),
            'hazard_id': item['hazard_id'],
        }
        for item, tile in pairs[:MOST_HAZARDS]
    ]


def _describe_changes(summary: GridSummary) -> Record | None:
    """Return the counts of changes since an earlier survey, and the rows of the greatest ones."""
    if summary.changes is None:
        return None
    record = describe_changes(summary.changes, summary.units)
    abnormal = [row for row in record['spans'] if row['sag_is_abnormal']]
    abnormal.sort(key=lambda row: -abs(row['sag_change']))
    growth = sorted(record['growth'], key=lambda row: -row['highest'])
    return record | {
        'abnormal': abnormal[:MOST_CHANGES], 'num_abnormal': len(abnormal),
        'growth': growth[:MOST_CHANGES],
    }


def _name_crs(source: Source, unit: str) -> str:
    if not source.crs:
        return f'no coordinate reference system, lengths in {unit}'
    return source.crs.partition('"')[2].partition('"')[0]


def _number(value: float | None) -> str:
    return '-' if value is None else f'{value:.2f}'


def read_style() -> str:
    """Return the style sheet of the reports."""
    return files('plc_inspect').joinpath('offline/report/templates/report.css').read_text('utf-8')


def _count(numbers: Counter[Severity]) -> str:
    """Return how many hazards of each severity there are, from the worst on."""
    return ', '.join(
        f'{numbers[severity]} {severity.name.lower()}' for severity in WORST if numbers[severity]
    ) or '0'


def _render_share(share: float) -> str:
    return f'{100 * share:.0f} %' if math.isfinite(share) else '-'


def _choose_page(name: str, reports: dict[str, dict[str, Any]]) -> str:
    """Return the file that the link of a tile opens."""
    return REPORT if name in reports else POINTS


def _render_sight(report: Mapping[str, Any] | None) -> str:
    return '-' if report is None else f'{report["num_enough"]} of {report["num_sections"]}'


def _draw_map(summary: GridSummary, jobs: Sequence[TileJob]) -> str:
    """Return tiles, spans and hazards in plan as SVG."""
    if not jobs:
        return ''
    grid: CellGrid = jobs[0].grid
    boxes = [job.tile.rectangle(grid) for job in jobs]
    x0, y0 = min(box[0] for box in boxes), min(box[1] for box in boxes)
    x1, y1 = max(box[2] for box in boxes), max(box[3] for box in boxes)
    scale = WIDTH / max(x1 - x0, y1 - y0)

    def place(x: float, y: float) -> str:
        return f'{(x - x0) * scale:.1f},{(y1 - y) * scale:.1f}'

    parts = []
    for job, box in zip(jobs, boxes, strict=True):
        left, top = place(box[0], box[3]).split(',')
        parts.append(
            f'<rect x="{left}" y="{top}" width="{(box[2] - box[0]) * scale:.1f}" '
            f'height="{(box[3] - box[1]) * scale:.1f}" class="grid" fill="none">'
            f'<title>{escape(job.tile.name)}</title></rect>'
        )
    for span in summary.joined.spans:
        ends = f'{place(*span.start[:2].tolist())} {place(*span.end[:2].tolist())}'
        parts.append(f'<polyline points="{ends}" class="wire" style="--c: #10405f"/>')
    for hazard in sorted(summary.joined.hazards, key=lambda item: item.severity):
        x, y = place(*hazard.position[:2].tolist()).split(',')
        name = hazard.severity.name.lower()
        parts.append(
            f'<circle cx="{x}" cy="{y}" r="4" class="dot" style="--c: {severity_color(name)}">'
            f'<title>{escape(name)} {hazard.kind.name.lower()}, line {hazard.line_id}, '
            f'span {hazard.span_id}</title></circle>'
        )
    width, height = (x1 - x0) * scale, (y1 - y0) * scale
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" style="max-height: {HEIGHT}px"'
    return f'<svg {size}>{"".join(parts)}</svg>'
