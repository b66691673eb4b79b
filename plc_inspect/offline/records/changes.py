# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Compares a run with an earlier results folder."""

from dataclasses import dataclass, field, replace
import math
from pathlib import Path

import numpy as np
import pyproj
from pyproj.exceptions import CRSError

from plc_inspect.core.tracking.comparison import (
    Change,
    compare_surveys,
    find_same_place,
)
from plc_inspect.errors import DataError
from plc_inspect.offline.readers.laz import find_withheld
from plc_inspect.offline.records.change_list import Changes, Growth
from plc_inspect.offline.records.inspection import describe_hazard, Inspection, measure_clearances
from plc_inspect.offline.records.limits import (
    describe_limit_changes,
    Limits,
    list_limit_changes,
    make_limits,
    read_limits,
    would_raise,
)
from plc_inspect.offline.records.results_reader import (
    parse_hazard,
    parse_span,
    parse_units,
    read_points,
    read_run,
    read_table,
    understanding,
)
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.results import Float64, Hazard, Int32, Int64, PointClass, Span

CANOPY_CELL = 1.0
"""Edge of the plan cells whose highest vegetation is compared [m]."""
TILES, POINTS, INDEX = 'tiles', 'points.laz', 'index.html'
"""Of a grid; its run writes the last of these when all else is there."""
MIN_CELLS = 5
"""Least number of cells from which growth is reported."""


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
    """Distance of each span to the nearest vegetation [m]; spans without any are absent."""
    canopy: Float64
    """(N, 3) vegetation [m]."""
    canopy_span: Int32
    """(N,) span_id of it."""
    limits: Limits = field(default_factory=Limits)
    """By which the hazards were raised."""


def read_survey(folder: Path, *, is_running: bool = False) -> Survey:
    """
    Read a results folder.

    Parameters
    ----------
    folder : Path
        As `write_results` wrote it, or a run over a grid.
    is_running : bool
        The run over the grid has not come to its end, and has written all that is read but its
        limits, which are left out.

    Returns
    -------
    Survey

    Raises
    ------
    DataError
        The folder or one of its files is missing or malformed, or a grid was left half-way.

    """
    folder = Path(folder)
    is_grid = (folder / TILES).is_dir()
    if is_grid and not is_running and not (folder / INDEX).is_file():
        raise DataError(
            f'{folder} is a grid whose last run has not come to its end, so its files may be of'
            ' two runs: run it again'
        )
    spans, hazards = (read_table(folder, name) for name in ('spans', 'hazards'))
    with understanding(folder / 'spans.json'):
        units = parse_units(spans['metres_per_unit'])
        crs, frame_id = str(spans['crs']), str(spans['frame_id'])
        vegetation = {
            (row['line_id'], row['span_id']): row['vegetation_clearance'] * units.horizontal
            for row in spans['spans'] if row.get('vegetation_clearance') is not None
        }
        found = tuple(parse_span(row, units) for row in spans['spans'])
    with understanding(folder / 'hazards.json'):
        raised = tuple(parse_hazard(row, units) for row in hazards['hazards'])
    limits = Limits()
    if not is_running and (folder / 'run.json').exists():
        run = read_run(folder)
        with understanding(folder / 'run.json'):
            limits = read_limits(run)
    canopy, span = _read_canopy(folder, units)
    return Survey(
        name=folder.name, crs=crs, frame_id=frame_id, units=units, spans=found, hazards=raised,
        vegetation=vegetation, canopy=canopy, canopy_span=span, limits=limits,
    )


def _read_canopy(folder: Path, units: Units) -> tuple[Float64, Int32]:
    """Return vegetation [m] and its spans; for a grid only the highest points of its tiles."""
    tiles = sorted((folder / TILES).glob(f'*/{POINTS}')) if (folder / TILES).is_dir() else []
    parts = []
    for path in tiles or [folder / POINTS]:
        las, points = read_points(path.parent, 'span_id')
        own = np.asarray(las.classification) == PointClass.VEGETATION
        withheld = find_withheld(las.points)
        if withheld is not None:
            own &= ~withheld
        canopy, span = units.to_metres(points[own]), np.asarray(las['span_id'])[own]
        if tiles:
            _, top = _find_tops(canopy)
            canopy, span = canopy[top], span[top]
        parts.append((canopy, span))
    return np.concatenate([own for own, _ in parts]), np.concatenate([own for _, own in parts])


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
        limits=make_limits(inspection.settings.hazards, inspection.rules),
    )


def find_changes(before: Survey, after: Survey, sag_deviation: float) -> Changes:
    """
    Compare two surveys.

    Parameters
    ----------
    before, after : Survey
        In one frame: the same CRS, or flights with the same origin.
    sag_deviation : float
        Tolerated change of sag, as a share.

    Returns
    -------
    Changes

    Raises
    ------
    DataError
        The frames differ or the surveys do not overlap.

    """
    check_systems(before, after.name, after.crs)
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
    changes = Changes(before=before.name, comparison=comparison, vegetation=vegetation,
                      growth=_measure_growth(before, after))
    return _set_apart(changes, before, after)


def _set_apart(changes: Changes, before: Survey, after: Survey) -> Changes:
    """Take out of new and cleared hazards what other limits alone may explain."""
    limits = list_limit_changes(before.limits, after.limits)
    if not limits:
        return changes
    comparison = changes.comparison
    still = {j for _, j, _ in find_same_place(before.hazards, comparison.new)}
    new = [
        i not in still and would_raise(item, after.limits, before.limits)
        for i, item in enumerate(comparison.new)
    ]
    still = {i for i, _, _ in find_same_place(comparison.cleared, after.hazards)}
    cleared = [
        i not in still and would_raise(item, before.limits, after.limits)
        for i, item in enumerate(comparison.cleared)
    ]
    return replace(
        changes, limits=limits,
        unjudged_before=_choose(comparison.cleared, cleared, False),
        unjudged=_choose(comparison.new, new, False),
        comparison=replace(
            comparison, new=_choose(comparison.new, new),
            cleared=_choose(comparison.cleared, cleared),
        ),
    )


def _choose(
    hazards: tuple[Hazard, ...], chosen: list[bool], wanted: bool = True
) -> tuple[Hazard, ...]:
    return tuple(item for item, own in zip(hazards, chosen, strict=True) if own == wanted)


def check_systems(before: Survey, name: str, crs: str) -> None:
    """Raise DataError if two surveys have different reference systems."""
    if not is_same_system(before.crs, crs):
        raise DataError(
            f'{before.name} is in {_name_crs(before.crs)} and {name} in {_name_crs(crs)}: surveys'
            ' are compared in one reference system'
        )


def describe_changes(changes: Changes, units: Units) -> Record:
    """Return the content of ``changes.json``; lengths in the unit of the input."""
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
        'limits': [
            {'name': item.name, 'before': item.before, 'after': item.after}
            for item in changes.limits
        ],
        'limits_note': describe_limit_changes(
            changes.limits, len(changes.unjudged_before), len(changes.unjudged)
        ),
        'unjudged_hazards_before': [
            describe_hazard(item, units) for item in changes.unjudged_before
        ],
        'unjudged_hazards': [item.hazard_id for item in changes.unjudged],
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
    """Return the rise of the highest vegetation in plan cells with vegetation in both surveys."""
    if not len(before.canopy) or not len(after.canopy):
        return ()
    cells, tops = zip(*(_find_tops(survey.canopy) for survey in (before, after)), strict=True)
    _, number = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
    number = number.ravel()
    _, i, j = np.intersect1d(
        number[: len(cells[0])], number[len(cells[0]) :], return_indices=True
    )
    first, second = tops[0][i], tops[1][j]
    rise, span = after.canopy[second, 2] - before.canopy[first, 2], after.canopy_span[second]
    result = []
    for span_id in np.unique(span).tolist():
        own = rise[span == span_id]
        if len(own) >= MIN_CELLS:
            result.append(Growth(
                span_id=span_id, median=float(np.median(own)),
                highest=float(np.percentile(own, 95.0)), num_cells=len(own),
            ))
    return tuple(result)


def _find_tops(canopy: Float64) -> tuple[Int64, Int64]:
    """Return the (K, 2) plan cells of a canopy, and the index of the highest point of each."""
    cell = np.floor(canopy[:, :2] / CANOPY_CELL).astype(np.int64)
    order = np.lexsort((canopy[:, 2], cell[:, 0], cell[:, 1]))
    last = np.append((np.diff(cell[order], axis=0) != 0).any(axis=1), True)[: len(order)]
    top = order[last]
    return cell[top], top


def is_same_system(first: str, second: str) -> bool:
    """Tell whether two reference systems, as WKT or '', are one, however they are spelled."""
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
