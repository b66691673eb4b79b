# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""An earlier results folder read back, and what changed since."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from pyproj.exceptions import CRSError

from plc_inspect.core.tracking.comparison import Change, compare_surveys, Comparison
from plc_inspect.errors import DataError
from plc_inspect.offline.readers.laz import read_las
from plc_inspect.offline.records.inspection import (
    describe_hazard,
    Inspection,
    measure_clearances,
    Record,
    Units,
)
from plc_inspect.results import Float64, Hazard, HazardKind, Int32, PointClass, Severity, Span

CANOPY_CELL = 1.0
"""Edge of the plan cells whose highest vegetation is compared [m]."""
MIN_CELLS = 5
"""Growth is told from at least this many cells."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """A results folder, in metres."""

    name: str
    crs: str
    frame_id: str
    units: Units
    spans: tuple[Span, ...]
    hazards: tuple[Hazard, ...]
    vegetation: dict[tuple[int, int], float]
    """Distance of each span to the nearest vegetation [m], where there is any."""
    canopy: Float64
    """(N, 3) vegetation [m]."""
    canopy_span: Int32
    """(N,) span_id of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """How much the canopy beside one span rose, where both surveys saw it."""

    span_id: int
    """Of the second survey."""
    median: float
    """[m]."""
    highest: float
    """95th percentile [m]."""
    num_cells: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Changes:
    """Two surveys compared."""

    before: str
    """Name of the first survey."""
    comparison: Comparison
    vegetation: dict[tuple[int, int], Change]
    """Distance to the nearest vegetation of each span, by the ids of the second survey."""
    growth: tuple[Growth, ...]


def read_survey(folder: Path) -> Survey:
    """
    Read a results folder.

    Parameters
    ----------
    folder : Path
        As `write_results` wrote it.

    Returns
    -------
    Survey

    Raises
    ------
    DataError
        The folder or one of its files is missing or malformed.

    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f'{folder}: no such results folder')
    content = {name: _read(folder / f'{name}.json', name) for name in ('spans', 'hazards')}
    head = content['spans']
    try:
        units = Units(**dict(zip(('horizontal', 'vertical'), map(float, head['metres_per_unit']),
                                 strict=True)))
        spans = tuple(_parse_span(row, units) for row in head['spans'])
        hazards = tuple(_parse_hazard(row, units) for row in content['hazards']['hazards'])
        vegetation = {
            (row['line_id'], row['span_id']): row['vegetation_clearance'] * units.horizontal
            for row in head['spans'] if row.get('vegetation_clearance') is not None
        }
        crs, frame = str(head['crs']), str(head['frame_id'])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        text = ' '.join(str(error).split())
        raise DataError(f'{folder} holds results that are not understood: {text}') from error
    canopy, canopy_span = _read_canopy(folder / 'points.laz', units)
    return Survey(name=folder.name, crs=crs, frame_id=frame, units=units, spans=spans,
                  hazards=hazards, vegetation=vegetation, canopy=canopy, canopy_span=canopy_span)


def to_survey(inspection: Inspection) -> Survey:
    """Return a run in memory as a survey."""
    result = inspection.result
    rows = result.corridor[result.classification[result.corridor] == PointClass.VEGETATION]
    clearances = measure_clearances(result, inspection.settings.hazards.min_points)
    return Survey(
        name=inspection.source,
        crs=inspection.crs,
        frame_id=inspection.frame_id,
        units=inspection.units,
        spans=result.spans,
        hazards=result.hazards,
        vegetation={key: value for key, value in clearances.items() if value is not None},
        canopy=inspection.points[rows],
        canopy_span=result.span_id[rows],
    )


def find_changes(before: Survey, after: Survey, sag_deviation: float) -> Changes:
    """
    Compare two surveys.

    Parameters
    ----------
    before, after : Survey
        In one frame: the same CRS, or flights with the same origin.
    sag_deviation : float
        Change of sag that is tolerated, as a share.

    Returns
    -------
    Changes

    Raises
    ------
    DataError
        The frames differ or the surveys do not overlap.

    """
    if not _is_same(before.crs, after.crs):
        raise DataError(
            f'{before.name} is in {_name_crs(before.crs)} and {after.name} in'
            f' {_name_crs(after.crs)}: surveys are compared in one reference system'
        )
    if before.frame_id != after.frame_id:
        raise DataError(
            f'{before.name} is in frame {before.frame_id!r} and {after.name} in'
            f' {after.frame_id!r}'
        )
    comparison = compare_surveys(
        before.spans, after.spans, before.hazards, after.hazards, sag_deviation=sag_deviation
    )
    vegetation = {}
    for item in comparison.spans:
        keys = [(span.line_id, span.span_id) for span in (item.before, item.after)]
        if keys[0] in before.vegetation and keys[1] in after.vegetation:
            vegetation[keys[1]] = Change(
                before=before.vegetation[keys[0]], after=after.vegetation[keys[1]],
                sigma=item.height.sigma,
            )
    return Changes(before=before.name, comparison=comparison, vegetation=vegetation,
                   growth=_measure_growth(before, after))


def describe_changes(changes: Changes, units: Units) -> Record:
    """Return what ``changes.json`` holds; lengths in the unit of the input."""
    scale, comparison = units.horizontal, changes.comparison
    return {
        'before': changes.before,
        'note': 'sag follows the temperature of the conductor, which is not measured: a change of'
                ' sag may be heat, ice, or a fault',
        'spans': [
            {
                'line_id': item.after.line_id, 'span_id': item.after.span_id,
                'line_id_before': item.before.line_id, 'span_id_before': item.before.span_id,
                'common': item.common / scale,
                'height_change': item.height.difference / scale,
                'height_sigma': item.height.sigma / scale,
                **_describe_change('sag', item.sag, scale),
                **_describe_change('ground_clearance', item.ground, scale),
                **_describe_change(
                    'vegetation_clearance',
                    changes.vegetation.get((item.after.line_id, item.after.span_id)), scale,
                ),
                'sag_is_abnormal': item.is_abnormal,
            }
            for item in comparison.spans
        ],
        'lost_spans': [[span.line_id, span.span_id] for span in comparison.lost],
        'added_spans': [[span.line_id, span.span_id] for span in comparison.added],
        'kept_hazards': [
            {'hazard_id_before': first.hazard_id, 'hazard_id': second.hazard_id,
             'kind': second.kind.name.lower(), 'clearance_before': first.clearance / scale,
             'clearance': second.clearance / scale,
             'sigma': math.hypot(first.sigma, second.sigma) / scale}
            for first, second in comparison.kept
        ],
        'new_hazards': [item.hazard_id for item in comparison.new],
        'cleared_hazards': [describe_hazard(item, units) for item in comparison.cleared],
        'hazards_not_seen_again': [describe_hazard(item, units) for item in comparison.unseen],
        'growth': [
            {'span_id': item.span_id, 'median': item.median / scale,
             'highest': item.highest / scale, 'num_cells': item.num_cells}
            for item in changes.growth
        ],
    }


def _describe_change(name: str, change: Change | None, scale: float) -> Record:
    if change is None:
        return {f'{name}_{key}': None for key in ('before', 'after', 'change', 'sigma')}
    return {
        f'{name}_before': change.before / scale,
        f'{name}_after': change.after / scale,
        f'{name}_change': change.difference / scale,
        f'{name}_sigma': change.sigma / scale,
    }


def _measure_growth(before: Survey, after: Survey) -> tuple[Growth, ...]:
    """Rise of the highest vegetation in the plan cells that both surveys saw it in."""
    if not len(before.canopy) or not len(after.canopy):
        return ()
    low = np.minimum(before.canopy.min(axis=0), after.canopy.min(axis=0))[:2]
    first, first_top, _ = _raise(before.canopy, before.canopy_span, low)
    second, second_top, span = _raise(after.canopy, after.canopy_span, low)
    _, i, j = np.intersect1d(first, second, return_indices=True)
    rise, span = second_top[j] - first_top[i], span[j]
    result = []
    for span_id in np.unique(span).tolist():
        own = rise[span == span_id]
        if len(own) >= MIN_CELLS:
            result.append(Growth(
                span_id=span_id, median=float(np.median(own)),
                highest=float(np.percentile(own, 95.0)), num_cells=len(own),
            ))
    return tuple(result)


def _raise(canopy: Float64, span: Int32, low: Float64) -> tuple[Any, Float64, Int32]:
    """Return the number of each plan cell, and height and span of its highest point."""
    cell = np.floor((canopy[:, :2] - low) / CANOPY_CELL).astype(np.int64)
    key = cell[:, 1] * 10_000_000 + cell[:, 0]
    order = np.lexsort((canopy[:, 2], key))
    last = np.append(np.diff(key[order]) != 0, True)
    top = order[last]
    return key[top], canopy[top, 2], span[top]


def _read(path: Path, name: str) -> Record:
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not text'
        raise DataError(f'{path} cannot be read: {reason}') from error
    except ValueError as error:
        raise DataError(f'{path} is no JSON: {error}') from error
    if not isinstance(content, dict) or not isinstance(content.get(name), list):
        raise DataError(f'{path} holds no {name}')
    return content


def _read_canopy(path: Path, units: Units) -> tuple[Float64, Int32]:
    try:
        las = read_las(path)
        own = np.asarray(las.classification) == PointClass.VEGETATION
        scale = np.array([units.horizontal, units.horizontal, units.vertical])
        return np.asarray(las.xyz)[own] * scale, np.asarray(las['span_id'])[own]
    except Exception as error:  # laspy lets errors of lazrs, struct and numpy through
        text = ' '.join(str(error).split()) or type(error).__name__
        raise DataError(f'{path} cannot be read: {text}') from error


def _parse_span(row: Record, units: Units) -> Span:
    scale, number = units.horizontal, _scaler(units.horizontal)
    a2, a1, a0 = row['quadratic']
    return Span(
        line_id=row['line_id'], span_id=row['span_id'], start=_place(row['start'], units),
        end=_place(row['end'], units), azimuth=number(row['azimuth']) / scale,
        length=number(row['length']), a=number(row['a']), b=number(row['b']), c=number(row['c']),
        quadratic=(a2 / scale, a1, a0 * scale), sag=number(row['sag']),
        lowest=_place(row['lowest'], units), open_start=bool(row['open_start']),
        open_end=bool(row['open_end']), rmse=number(row['rmse']),
        num_points=int(row['num_points']), coverage=number(row['coverage']) / scale,
        sigma={name: number(value) for name, value in row['sigma'].items()},
        ground_clearance=number(row.get('ground_clearance')),
        ground_along=number(row.get('ground_along')),
    )


def _parse_hazard(row: Record, units: Units) -> Hazard:
    number = _scaler(units.horizontal)
    return Hazard(
        hazard_id=row['hazard_id'], line_id=row['line_id'], span_id=row['span_id'],
        kind=HazardKind[row['kind'].upper()], severity=Severity[row['severity'].upper()],
        position=_place(row['position'], units), clearance=number(row['clearance']),
        required=number(row['required']), horizontal=number(row['horizontal']),
        vertical=number(row['vertical']), sigma=number(row['sigma']),
        along_span=number(row['along_span']), num_points=row['num_points'],
        extent=np.stack([_place(corner, units) for corner in row['extent']]), rule=row['rule'],
        edition=row['edition'], source=row['source'], voltage=row.get('voltage', 'unknown'),
        support_id=row.get('support_id', -1), from_support=number(row.get('from_support')),
        height=number(row.get('height')) / units.horizontal * units.vertical,
        note=row.get('note', ''),
    )


def _scaler(scale: float) -> Callable[[float | None], float]:
    """Return a function that turns a value of a file into metres, null into NaN."""
    return lambda value: math.nan if value is None else float(value) * scale


def _place(values: Sequence[float], units: Units) -> Float64:
    x, y, z = values
    return np.array([x * units.horizontal, y * units.horizontal, z * units.vertical])


def _is_same(first: str, second: str) -> bool:
    if first == second:
        return True
    if not first or not second:
        return False
    try:
        return bool(pyproj.CRS.from_user_input(first) == pyproj.CRS.from_user_input(second))
    except CRSError:
        return False


def _name_crs(crs: str) -> str:
    if not crs:
        return 'no reference system'
    try:
        return str(pyproj.CRS.from_user_input(crs).name)
    except CRSError:
        return 'an unknown reference system'
