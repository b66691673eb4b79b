# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Content of the report's figures: thinned points with colours, and records."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.colors import LINE_COLORS
from plc_inspect.core.numerics.plan_index import build_plan_index, PlanIndex
from plc_inspect.offline.records.inspection import (
    describe_hazard,
    describe_span,
    describe_support,
    Inspection,
)
from plc_inspect.offline.records.units import Record, Units
from plc_inspect.offline.report.drawing import blend
from plc_inspect.results import Float32, Float64, Int32, Int64, PointClass, UInt8

MOST_POINTS = 1_000_000
"""Most points in the figures; more are thinned, those of the corridor last."""
CELL = 5.0
"""Edge of the cells in which the points of a span are found [m]."""
_SHADES = 24
_GROUND, FIRST_TREE, _OTHER, FIRST_STRUCTURE = 1, 1 + _SHADES, 1 + 2 * _SHADES, 2 + 2 * _SHADES
_WIRE = 3 + 2 * _SHADES
PALETTE = (
    '#ffffff',
    *blend('#e3d5b8', '#94784c', _SHADES),
    *blend('#b9d7a0', '#1f5c2c', _SHADES),
    '#a7adb5',
    '#4a5058',
    *LINE_COLORS,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Content of the figures, in the horizontal unit of the input."""

    points: Float64
    """(M, 3) thinned points, the lowest first, x and y relative to ``origin``."""
    color: UInt8
    """(M,) index into PALETTE."""
    index: PlanIndex
    """Of the points, in their unit."""
    origin: Float64
    """(2,) subtracted from x and y."""
    spans: list[Record]
    supports: list[Record]
    hazards: list[Record]
    metre: float
    """One metre in units of the input."""
    unit: str
    ratio: float
    """Vertical units of the input in a horizontal one."""


def make_scene(inspection: Inspection) -> Scene:
    """Return the thinned out points and the records of one run."""
    result = inspection.result
    units = Units(
        horizontal=inspection.units.horizontal, vertical=inspection.units.horizontal
    )
    rows = _thin_out(inspection)
    rows = rows[np.argsort(inspection.points[rows, 2], kind='stable')]
    points = units.from_metres(inspection.points[rows])
    low = points[:, :2].min(axis=0) if len(points) else np.zeros(2)
    origin = np.where(np.abs(low) > 1e4, np.floor(low / 1000.0) * 1000.0, 0.0)
    points[:, :2] -= origin
    kind, height = result.classification[rows], result.ground_height[rows]
    return Scene(
        points=points,
        color=_choose_colors(points[:, 2], height, kind, result.line_id[rows]),
        index=build_plan_index(points, np.arange(len(points)), CELL / units.horizontal),
        origin=origin,
        spans=[_move(describe_span(span, units), origin) for span in result.spans],
        supports=[_move(describe_support(item, units), origin) for item in result.supports],
        hazards=[_move(describe_hazard(hazard, units), origin) for hazard in result.hazards],
        metre=1.0 / units.horizontal,
        unit=units.name,
        ratio=inspection.units.horizontal / inspection.units.vertical,
    )


def _thin_out(inspection: Inspection) -> Int64:
    """Return the rows to show, ascending: about half from the corridor, half from all points."""
    finite = np.isfinite(inspection.points[:, 2])  # a point is NaN in all coordinates or in none
    rows = np.flatnonzero(finite)
    if len(rows) <= MOST_POINTS:
        return rows
    corridor = inspection.result.corridor
    corridor = corridor[finite[corridor]]
    shown = np.zeros(len(finite), dtype=np.bool_)
    shown[corridor[:: 1 + 2 * len(corridor) // MOST_POINTS]] = True
    shown[rows[:: 1 + 2 * len(rows) // MOST_POINTS]] = True
    return np.flatnonzero(shown)


def _choose_colors(z: Float64, height: Float32, kind: UInt8, line_id: Int32) -> UInt8:
    """Return palette indices: ground by z, vegetation by height, wires by line."""
    color = np.full(len(z), _OTHER, np.uint8)
    if not len(z):
        return color
    low, high = np.percentile(z, (1.0, 90.0))
    ground, tree, wire = (
        kind == item for item in (PointClass.GROUND, PointClass.VEGETATION, PointClass.WIRE)
    )
    color[ground] = _GROUND + _shade(z[ground], low, max(high, low + 1e-6))
    color[tree] = FIRST_TREE + _shade(np.nan_to_num(height[tree]), 0.0, 25.0)
    color[kind == PointClass.TOWER] = FIRST_STRUCTURE
    color[wire] = _WIRE + np.maximum(line_id[wire], 0) % len(LINE_COLORS)
    return color


def _shade(values: Float64 | Float32, low: float, high: float) -> UInt8:
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.rint(share * (_SHADES - 1)).astype(np.uint8)


def _move(record: Record, origin: Float64) -> Record:
    """Return a record whose coordinates are relative to the origin of the figures."""
    moved = dict(record)
    for name in ('start', 'end', 'lowest', 'position'):
        if name in moved:
            x, y, z = moved[name]
            moved[name] = [x - origin[0], y - origin[1], z]
    return moved
