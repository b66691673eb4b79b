# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The results folder of a grid: tables, GeoPackage, points of each tile, the page on top."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
import math
from operator import itemgetter
from pathlib import Path
import shutil
from typing import Any

import numpy as np
import pyogrio

from plc_inspect import __version__
from plc_inspect.core.hazards.clearance_rules import describe_rules, plain_rules
from plc_inspect.errors import DataError
from plc_inspect.grid.cells.sources import Refusal, Source
from plc_inspect.grid.engine import Task
from plc_inspect.grid.grid_summary import GridSummary
from plc_inspect.grid.index_page import render_index
from plc_inspect.grid.joining import join_tiles, JoinedGrid
from plc_inspect.grid.ledger import make_key
from plc_inspect.grid.ledger_table import write_ledger_table
from plc_inspect.grid.run import CutGrid, GridRun
from plc_inspect.grid.sections import plan_reports
from plc_inspect.grid.stage import Stage
from plc_inspect.grid.tiles.plain_results import read_found
from plc_inspect.grid.tiles.tile_job import TileJob
from plc_inspect.grid.tiles.tile_points import PointsFormat, write_tile_points
from plc_inspect.offline.export.files import measure_peak_memory, write_json, write_records
from plc_inspect.offline.export.geo import FILE_DATE, make_layers, write_layer
from plc_inspect.offline.records.changes import describe_changes, find_changes, read_survey
from plc_inspect.offline.records.georeference import find_horizontal
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.offline.records.limits import make_limits
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.results import InspectionResult
from plc_inspect.setting_names import to_mapping
from plc_inspect.whole_files import replace_file

TILE_FOLDER = 'tiles'
LOCAL_CRS = 'LOCAL_CS["local, {name}",LOCAL_DATUM["none",0],UNIT["{name}",{metres!r}],' \
    'AXIS["east",EAST],AXIS["north",NORTH]]'
"""WKT for coordinates whose reference system is unknown."""
PLAIN_SCALE = 1e-3
"""
Resolution of points from files that state none [units of the file].
Source: judgement: a tenth of the noise of a lidar.
"""


def write_grid(
    run: GridRun, sources: Sequence[Source], refusals: Sequence[Refusal], cut: CutGrid,
    jobs: Sequence[TileJob], answers: dict[str, dict[str, Any]], notes: Sequence[str] = (),
) -> GridSummary:
    """
    Join the inspected tiles and write the results folder.

    Parameters
    ----------
    run : GridRun
        The run.
    sources, refusals : sequence
        The inputs, also those without points, and those that could not be used.
    cut : CutGrid
        Their points.
    jobs : sequence of TileJob
        All tiles.
    answers : dict
        Answers of the inspected tiles, by name.
    notes : sequence of str
        On the inputs.

    Returns
    -------
    GridSummary

    """
    sources = [source for source in sources if source.num_points]
    done = [job for job in jobs if job.tile.name in answers]
    joined = join_tiles([read_found(job.place, job.tile.number) for job in done])
    units = Units(horizontal=sources[0].units[0], vertical=sources[0].units[1])
    written, reports = run.run_together(
        _plan_points(run, sources, done, joined),
        plan_reports(run, run.folder / TILE_FOLDER, done, joined, sources[0].crs, units),
    )
    failures = (
        *(('input', item.path, item.error) for item in refusals), *run.ledger.list_failures(),
    )
    summary = GridSummary(
        joined=joined, num_points=cut.num_points, num_tiles=len(jobs),
        kilometres=measure_kilometres(joined), units=units, failures=failures,
        num_defects=run.num_defects,
        sight=_sum_sight(reports, joined),
        notes=tuple(notes),
        num_withheld=cut.num_withheld,
    )
    inspection = _make_inspection(run, sources, joined, units)
    names = {job.tile.number: job.tile.name for job in jobs}
    tables = write_records(run.folder, inspection, joined.vegetation)
    _write_geopackage(run.folder / 'grid.gpkg', inspection, tables, [
        [names[tile] for tile in joined.span_tiles], [names[tile] for tile in joined.hazard_tiles],
    ])
    summary = _compare(run, summary)
    write_json(run.folder / 'run.json', _describe(run, sources, cut, summary, written))
    missing = write_ledger_table(run.ledger, run.folder, run.settings)
    summary = replace(summary, missing=missing)
    page = render_index(
        summary, run.folder.name, sources, tables['hazards'], jobs, answers, reports
    )
    with replace_file(run.folder / 'index.html') as aside:  # the last: a grid with it is whole
        aside.write_text(page, encoding='utf-8')
    return summary


def _compare(run: GridRun, summary: GridSummary) -> GridSummary:
    """Compare the tables and points that were written with an earlier survey."""
    path = run.folder / 'changes.json'
    path.unlink(missing_ok=True)
    if run.baseline is None:
        return summary
    try:
        hazards = run.settings.hazards
        after = replace(
            read_survey(run.folder, is_running=True), limits=make_limits(hazards, run.rules)
        )
        changes = find_changes(run.baseline, after, hazards.sag_deviation)
    except DataError as error:
        failure = ('baseline', run.baseline.name, str(error))
        return replace(summary, failures=(*summary.failures, failure))
    write_json(path, describe_changes(changes, summary.units))
    return replace(summary, changes=changes)


def _sum_sight(reports: dict[str, dict[str, Any]], joined: JoinedGrid) -> dict[str, float]:
    length = np.array([span.length for span in joined.spans])
    seen = float(length @ np.array([span.coverage for span in joined.spans]))
    return {
        name: sum(answer[name] for answer in reports.values())
        for name in ('num_sections', 'num_enough', 'gap_length')
    } | {'of_conductors': seen / float(length.sum()) if len(length) else math.nan}


def measure_kilometres(joined: JoinedGrid) -> float:
    """Return the length of the line: of each span the mean of its conductors [km]."""
    lengths: dict[int, list[float]] = {}
    for span in joined.spans:
        lengths.setdefault(span.span_id, []).append(span.length)
    return sum(float(np.mean(own)) for own in lengths.values()) / 1000.0


def choose_format(sources: Sequence[Source]) -> PointsFormat:
    """
    Return the format of the points of all tiles.

    On each axis the resolution is the finest of the inputs, PLAIN_SCALE for those that state none,
    and the offset is that of the first input with it.  GPS times are as in the first input with
    times.
    """
    stated = [source for source in sources if all(scale > 0 for scale in source.scales)]
    grids = [list(zip(source.scales, source.offsets, strict=True)) for source in stated]
    if len(stated) < len(sources):
        low = np.floor(np.array([source.low for source in sources]).min(axis=0)).tolist()
        offsets = stated[0].offsets if stated else low
        grids.append([(PLAIN_SCALE, offset) for offset in offsets])
    x, y, z = (min(own, key=itemgetter(0)) for own in zip(*grids, strict=True))
    return PointsFormat(
        crs=sources[0].crs, units=sources[0].units, scales=(x[0], y[0], z[0]),
        offsets=(x[1], y[1], z[1]), point_format=max(source.point_format for source in sources),
        time_type=next((own.time_type for own in sources if own.time_type is not None), 0),
    )


def _plan_points(
    run: GridRun, sources: Sequence[Source], jobs: Sequence[TileJob], joined: JoinedGrid
) -> Stage:
    """Return what writes the points of all tiles; folders of other tiles are removed."""
    form = choose_format(sources)
    tasks, keys = [], {}
    for job in jobs:
        name = job.tile.name
        place = run.folder / TILE_FOLDER / name / 'points.laz'
        numbers = [(*own, *new) for own, new in sorted(joined.numbers[job.tile.number].items())]
        inspected = run.ledger.find_task('tile', name)
        tasks.append(Task(
            name=name, size=job.tile.num_points, function=write_tile_points,
            arguments=(job, str(place), form, numbers),
        ))
        keys[name] = make_key(inspected, numbers, asdict(form))
        if not place.is_file():
            run.ledger.forget('points', name)
    folder = run.folder / TILE_FOLDER
    names = {job.tile.name for job in jobs}
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.name not in names:
            shutil.rmtree(path)
    return Stage(name='points', tasks=tasks, keys=keys)


def _make_inspection(
    run: GridRun, sources: Sequence[Source], joined: JoinedGrid, units: Units
) -> Inspection:
    """Return spans, supports and hazards as a run without points."""
    none = {
        'line_id': np.int32, 'span_id': np.int32, 'residual': np.float32,
        'clearance': np.float32, 'classification': np.uint8, 'decision': np.uint8,
        'ground_height': np.float32, 'corridor': np.int64, 'corridor_line_id': np.int32,
        'corridor_span_id': np.int32,
    }
    result = InspectionResult(
        spans=joined.spans, supports=joined.supports, hazards=joined.hazards, stages=(),
        **{name: np.zeros(0, dtype=kind) for name, kind in none.items()},  # type: ignore[arg-type]
    )
    return Inspection(
        result=result, points=np.zeros((0, 3)), settings=run.settings, source=run.folder.name,
        command='plc_survey', crs=sources[0].crs, units=units, rules=run.rules,
    )


def _write_geopackage(
    path: Path, inspection: Inspection, tables: dict[str, list[Record]],
    tiles: Sequence[Sequence[str]],
) -> None:
    """Write spans, supports and hazards, with the tile of each, into one file."""
    system, units = find_horizontal(inspection), inspection.units
    plain = inspection.crs or LOCAL_CRS.format(name=units.name, metres=units.horizontal)
    if system is None and inspection.crs:
        plain = LOCAL_CRS.format(name=units.name, metres=units.horizontal)
    pyogrio.set_gdal_config_options({'OGR_CURRENT_DATE': FILE_DATE})
    layers = make_layers(inspection, tables)
    for name, own in zip(('spans', 'hazards'), tiles, strict=True):
        for row, tile in zip(layers[name][1], own, strict=True):
            row['tile'] = tile
    with replace_file(path) as aside:
        for name, (shapes, rows) in layers.items():
            write_layer(aside, 'GPKG', name, shapes, rows, plain)


def _describe(
    run: GridRun, sources: Sequence[Source], cut: CutGrid, summary: GridSummary,
    written: dict[str, dict[str, Any]],
) -> Record:
    """Return what ``run.json`` holds."""
    joined = summary.joined
    classes: Counter[str] = Counter()
    for answer in written.values():
        classes.update(answer['classes'])
    return {
        'version': __version__,
        'command': 'plc_survey',
        'input': {
            'num_sources': len(sources), 'crs': sources[0].crs,
            'metres_per_unit': list(sources[0].units),
        },
        'num_points': cut.num_points,
        'num_not_on_earth': cut.num_lost,
        'num_withheld': cut.num_withheld,
        'num_tiles': summary.num_tiles,
        'num_lines': len({span.line_id for span in joined.spans}),
        'num_spans': len(joined.spans),
        'num_supports': len(joined.supports),
        'num_hazards': len(joined.hazards),
        'num_unmatched': joined.num_unmatched,
        'kilometres': summary.kilometres,
        'coverage': summary.sight,
        'classes': dict(sorted(classes.items())),
        'failures': [list(item) for item in summary.failures],
        'notes': list(summary.notes),
        'whole': run.ledger.find_fact('whole'),
        'rules': describe_rules(run.rules or plain_rules(run.settings.hazards)),
        'settings': to_mapping(run.settings),
        'peak_memory': measure_peak_memory(),
    }
