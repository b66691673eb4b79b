# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The files of a results folder."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
import csv
import dataclasses
import json
import math
from pathlib import Path
import resource
import sys
import time
from typing import Any, TypeVar

import numpy as np

from plc_inspect import __version__
from plc_inspect.core.hazards.clearance_rules import describe_rules, plain_rules
from plc_inspect.offline.export.coverage_files import make_plan, write_coverage_views
from plc_inspect.offline.export.dxf import write_dxf
from plc_inspect.offline.export.file_names import POINTS
from plc_inspect.offline.export.geo import write_geo
from plc_inspect.offline.export.playback import write_playback
from plc_inspect.offline.export.points_file import write_points
from plc_inspect.offline.records.changes import describe_changes
from plc_inspect.offline.records.coverage_record import describe_coverage, review_coverage, Sight
from plc_inspect.offline.records.inspection import (
    describe_coarse_ground,
    describe_hazard,
    describe_span,
    describe_support,
    flatten,
    Inspection,
    measure_clearances,
)
from plc_inspect.offline.records.load_case_record import describe_what_if
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.offline.report.report import render_report
from plc_inspect.printable import make_cell
from plc_inspect.results import Decision, PointClass, SpanKey
from plc_inspect.setting_names import to_mapping

T = TypeVar('T')

SPAN_COLUMNS = (
    'line_id', 'span_id', 'start_x', 'start_y', 'start_z', 'end_x', 'end_y', 'end_z',
    'azimuth', 'length', 'a', 'b', 'c', 'a2', 'a1', 'a0', 'sag', 'lowest_x', 'lowest_y',
    'lowest_z', 'open_start', 'open_end', 'rmse', 'num_points', 'coverage', 'sigma_a',
    'sigma_b', 'sigma_c', 'sigma_sag', 'ground_clearance', 'ground_along',
    'vegetation_clearance', 'evidence',
)
SUPPORT_COLUMNS = (
    'support_id', 'position_x', 'position_y', 'position_z', 'height', 'kind', 'lines',
)
HAZARD_COLUMNS = (
    'hazard_id', 'line_id', 'span_id', 'kind', 'severity', 'position_x', 'position_y',
    'position_z', 'clearance', 'required', 'horizontal', 'vertical', 'sigma', 'along_span',
    'num_points', 'min_x', 'min_y', 'min_z', 'max_x', 'max_y', 'max_z', 'rule', 'edition',
    'source', 'voltage', 'other_line_id', 'support_id', 'from_support', 'height', 'years', 'note',
    'confidence', 'text',
)

LENGTHS = frozenset({
    'length', 'a', 'b', 'c', 'a0', 'sag', 'rmse', 'sigma_a', 'sigma_b', 'sigma_c', 'sigma_sag',
    'ground_clearance', 'ground_along', 'vegetation_clearance', 'evidence', 'clearance',
    'required', 'horizontal', 'vertical', 'sigma', 'along_span', 'from_support',
})
"""Columns in the horizontal unit of the input, besides x and y."""
HEIGHTS = frozenset({'height'})
"""Columns in the vertical unit of the input, besides z."""
OTHER_UNITS = {'azimuth': 'rad', 'a2': '1/{unit}', 'years': 'a'}


def write_files(folder: Path, inspection: Inspection) -> None:
    """Write all files of one run into an empty folder; OSError if one cannot be written."""
    sight = review_coverage(inspection)
    with ThreadPoolExecutor(2) as beside:  # compression and drawing release the GIL
        report = beside.submit(_time, lambda: _write_report(folder, inspection, sight))
        views = beside.submit(_write_views, folder, inspection, sight)
        num_written, of_points = _time(lambda: write_points(folder / POINTS, inspection))
        views.result()
        _, of_report = report.result()
    seconds = dict(inspection.seconds) | {'points_file': of_points, 'report': of_report}
    run = dataclasses.replace(inspection, seconds=seconds)
    write_json(folder / 'run.json', describe_run(run, num_written))


def _time(call: Callable[[], T]) -> tuple[T, float]:
    """Call, and return the result and how long it took [s]."""
    started = time.perf_counter()
    return call(), time.perf_counter() - started


def write_tables(folder: Path, inspection: Inspection) -> None:
    """Write only JSON and CSV of one run; OSError if one cannot be written."""
    write_records(folder, inspection)
    _write_coverage(folder, inspection, review_coverage(inspection))
    write_json(folder / 'run.json', describe_run(inspection, 0))


def write_records(
    folder: Path, inspection: Inspection,
    clearances: Mapping[SpanKey, float | None] | None = None,
) -> dict[str, list[Record]]:
    """
    Write spans, supports and hazards, what-if and changes, and return the former three.

    ``clearances`` are those of `measure_clearances` [m], by default found in the points.
    """
    units, result = inspection.units, inspection.result
    spans = [describe_span(span, units) for span in result.spans]
    supports = [describe_support(support, units) for support in result.supports]
    hazards = [describe_hazard(hazard, units) for hazard in result.hazards]
    if clearances is None:
        clearances = measure_clearances(result, inspection.settings.hazards.min_points)
    for span in spans:
        distance = clearances[span['line_id'], span['span_id']]
        span['vegetation_clearance'] = None if distance is None else distance / units.horizontal
    tables = {'spans': spans, 'supports': supports, 'hazards': hazards}
    for name, records in tables.items():
        write_json(folder / f'{name}.json', describe_frame(inspection) | {name: records})
    _write_table(folder / 'spans.csv', SPAN_COLUMNS, spans, units)
    _write_table(folder / 'hazards.csv', HAZARD_COLUMNS, hazards, units)
    _write_table(folder / 'supports.csv', SUPPORT_COLUMNS, [
        row | {'lines': ' '.join(map(str, row['lines']))} for row in supports
    ], units)
    if inspection.what_if is not None:
        write_json(folder / 'whatif.json', describe_what_if(inspection.what_if, units))
    if inspection.changes is not None:
        write_json(folder / 'changes.json', describe_changes(inspection.changes, units))
    return tables


def describe_frame(inspection: Inspection) -> Record:
    """Return the header of each file of records: frame and units."""
    units = inspection.units
    return {
        'frame_id': inspection.frame_id,
        'crs': inspection.crs,
        'metres_per_unit': [units.horizontal, units.vertical],
    }


def _write_coverage(folder: Path, inspection: Inspection, sight: Sight) -> None:
    record = describe_coverage(sight, inspection.units)
    write_json(folder / 'coverage.json', describe_frame(inspection) | record)


def _write_views(folder: Path, inspection: Inspection, sight: Sight) -> None:
    """Write the records and the files for other programs."""
    tables = write_records(folder, inspection)
    _write_coverage(folder, inspection, sight)
    write_geo(folder, inspection, tables)
    write_coverage_views(folder, inspection, sight)
    if (plan := make_plan(inspection, sight)) is not None:
        write_json(folder / 'refly.plan', plan)
    write_dxf(folder / 'catenaries.dxf', inspection, tables)
    write_playback(folder / 'results.mcap', inspection)


def _write_report(folder: Path, inspection: Inspection, sight: Sight) -> None:
    (folder / 'report.html').write_text(render_report(inspection, sight), encoding='utf-8')


def describe_run(inspection: Inspection, num_written: int) -> Record:
    """
    Return the content of ``run.json``.

    Parameters
    ----------
    inspection : Inspection
        The run.
    num_written : int
        Points in ``points.laz``.

    Returns
    -------
    A JSON-serialisable mapping; times in seconds, memory in bytes.

    """
    result = inspection.result
    return {
        'version': __version__,
        'command': inspection.command,
        'input': {
            'source': inspection.source,
            'frame_id': inspection.frame_id,
            'crs': inspection.crs,
            'metres_per_unit': [inspection.units.horizontal, inspection.units.vertical],
            'sha256': inspection.checksum,
            'counts': dict(inspection.counts),
        },
        'num_points': result.num_points,
        'num_points_written': num_written,
        'num_lines': result.num_lines,
        'num_spans': len(result.spans),
        'num_supports': len(result.supports),
        'num_hazards': len(result.hazards),
        'num_corridor_points': len(result.corridor),
        'held_back': inspection.counts.get('held_back', ''),
        'not_covered': inspection.rules.gaps if inspection.rules is not None else '',
        'rules': describe_rules(inspection.rules or plain_rules(inspection.settings.hazards)),
        'coarse_ground': describe_coarse_ground(inspection),
        'classes': {
            item.name.lower(): int(np.count_nonzero(result.classification == item))
            for item in PointClass
        },
        'decisions': {
            item.name.lower(): int(np.count_nonzero(result.decision == item))
            for item in Decision
        },
        'stages': [dataclasses.asdict(stage) for stage in result.stages],
        'settings': to_mapping(inspection.settings),
        'seconds': dict(inspection.seconds),
        'peak_memory': measure_peak_memory(),
    }


def measure_peak_memory() -> int:
    """Return the largest resident memory of this process so far [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == 'darwin' else peak * 1024


def render_json(value: Any, indent: str = '') -> str:
    """
    Return a value as JSON: one key per line, lists of scalars on one line.

    Floats are written by ``repr``, so reading them back gives the same bits; NaN and infinity
    become null.  Arrays of numpy are lists.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    deeper = indent + '  '
    if isinstance(value, dict) and value:
        items = (f'{json.dumps(str(k))}: {render_json(v, deeper)}' for k, v in value.items())
        return '{\n' + ',\n'.join(deeper + item for item in items) + f'\n{indent}}}'
    if isinstance(value, list | tuple) and any(isinstance(v, dict | list | tuple) for v in value):
        items = (render_json(v, deeper) for v in value)
        return '[\n' + ',\n'.join(deeper + item for item in items) + f'\n{indent}]'
    if isinstance(value, list | tuple):
        return '[' + ', '.join(render_json(v) for v in value) + ']'
    if isinstance(value, float) and not math.isfinite(value):
        return 'null'
    return json.dumps(value, ensure_ascii=False)


def write_json(path: Path, value: Record) -> None:
    """Write a mapping as `render_json` renders it."""
    path.write_text(render_json(value) + '\n', encoding='utf-8')


def name_column(column: str, units: Units) -> str:
    """Return the heading of a column of a table: its name, and its unit in brackets."""
    unit = ''
    if column in LENGTHS or column[-2:] in ('_x', '_y'):
        unit = units.name
    elif column in HEIGHTS or column.endswith('_z'):
        unit = units.vertical_name
    elif column in OTHER_UNITS:
        unit = OTHER_UNITS[column].format(unit=units.name)
    return f'{column} [{unit}]' if unit else column


def _write_table(
    path: Path, columns: Sequence[str], records: Sequence[Record], units: Units
) -> None:
    with path.open('w', encoding='utf-8', newline='') as stream:
        writer = csv.DictWriter(stream, columns, lineterminator='\n')
        writer.writerow({column: name_column(column, units) for column in columns})
        for record in records:
            writer.writerow({key: _cell(value) for key, value in flatten(record).items()})


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return make_cell(value)
    return float(f'{value:.12g}') if isinstance(value, float) else value
