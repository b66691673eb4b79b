# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The side view of a span, in the units of its drawing."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from plc_inspect.monitor.picture.cloud_store import CellArrays
from plc_inspect.monitor.picture.picture import HazardItem, SpanItem
from plc_inspect.results import PointClass

PROFILE_WIDTH = 6.0
"""Cells within this distance of the conductor in plan are in the profile [m]."""
MOST_CELLS = 600
"""Most cells of a class; more are thinned."""
CLASS_COLORS = {
    PointClass.GROUND: '#a1887f', PointClass.VEGETATION: '#4caf50', PointClass.TOWER: '#546e7a',
    PointClass.OTHER: '#9e9e9e',
}
"""In the order in which they are drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Size of the drawing and edges of its plot area; y grows downwards."""

    width: int = 360
    height: int = 200
    left: int = 34
    right: int = 354
    top: int = 6
    bottom: int = 182


@dataclass(frozen=True, slots=True)
class Tick:
    """A tick of an axis."""

    place: float
    value: float
    """[m]."""


@dataclass(frozen=True, slots=True)
class Layer:
    """The cells of one class."""

    color: str
    places: list[tuple[int, int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A hazard."""

    x: float
    y: float
    severity: str
    clearance: float | None
    """[m], None unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """All that is drawn."""

    curve: list[tuple[float, float]]
    layers: list[Layer]
    marks: list[Mark]
    heights: list[Tick]
    lengths: list[Tick]


FRAME = Frame()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scale:
    """Places of metres in the drawing, rounded; heights are exaggerated on long spans."""

    length: float
    low: float
    high: float

    def place_x(self, along: Any, decimals: int = 1) -> Any:
        share = along / max(self.length, 1e-9)
        return np.round(FRAME.left + share * (FRAME.right - FRAME.left), decimals)

    def place_y(self, height: Any, decimals: int = 1) -> Any:
        share = (height - self.low) / (self.high - self.low)
        return np.round(FRAME.bottom - share * (FRAME.bottom - FRAME.top), decimals)


def lay_out_profile(span: SpanItem, hazards: Sequence[HazardItem], cells: CellArrays) -> Profile:
    """
    Lay out the side view of a span: its curve, the cells below it and its hazards.

    Parameters
    ----------
    span : SpanItem
        The span.
    hazards : sequence of HazardItem
        All hazards; those of the span are drawn.
    cells : CellArrays
        Of the thinned corridor beside the span.

    Returns
    -------
    Profile
        Within ``FRAME``.

    """
    curve = span.trace(max(span.length / 60.0, 0.5))
    along = np.linspace(0.0, span.length, len(curve))
    points, kind, _, _ = cells
    heights = np.concatenate((curve[:, 2], points[:, 2]))
    low, high = float(heights.min()) - 1.0, float(heights.max()) + 1.0
    scale = _Scale(length=span.length, low=low, high=high)
    return Profile(
        curve=_pair(scale.place_x(along), scale.place_y(curve[:, 2])),
        layers=_lay_out_cells(span, points, kind, scale),
        marks=[
            _mark(item, span, scale) for item in hazards
            if (item.line_id, item.span_id) == span.key
        ],
        heights=[
            Tick(float(scale.place_y(value)), value) for value in _choose_ticks(low, high, 5)
        ],
        lengths=[
            Tick(float(scale.place_x(value)), value)
            for value in _choose_ticks(0.0, span.length, 6)
        ],
    )


def _lay_out_cells(span: SpanItem, points: Any, kind: Any, scale: _Scale) -> list[Layer]:
    at = _measure_along(span, points)
    layers = []
    for name, color in CLASS_COLORS.items():
        chosen = np.flatnonzero(kind == name)
        chosen = chosen[:: 1 + len(chosen) // MOST_CELLS]
        x, y = scale.place_x(at[chosen], 0), scale.place_y(points[chosen, 2], 0)
        if len(chosen):
            layers.append(Layer(color, _pair(x.astype(int), y.astype(int))))
    return layers


def _measure_along(span: SpanItem, points: Any) -> Any:
    """Return how far along a span points (..., 3) lie [m]."""
    start = np.array(span.start)
    unit = (np.array(span.end) - start)[:2] / max(span.length, 1e-9)
    return (np.asarray(points)[..., :2] - start[:2]) @ unit


def _mark(item: HazardItem, span: SpanItem, scale: _Scale) -> Mark:
    known = math.isfinite(item.along_span)
    along = min(max(item.along_span if known else _measure_along(span, item.position), 0.0),
                span.length)
    return Mark(
        x=float(scale.place_x(along)), y=float(scale.place_y(item.position[2])),
        severity=item.severity_name,
        clearance=item.clearance if math.isfinite(item.clearance) else None,
    )


def _pair(x: Any, y: Any) -> list[tuple[Any, Any]]:
    return list(zip(x.tolist(), y.tolist(), strict=True))


def _choose_ticks(low: float, high: float, count: int) -> list[float]:
    raw = max((high - low) / count, 1e-6)
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * k for k in (1, 2, 5, 10) if unit * k >= raw)
    first = math.ceil(low / step)
    return [k * step for k in range(first, math.floor(high / step) + 1)]
