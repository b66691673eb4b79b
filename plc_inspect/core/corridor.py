# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Extraction of the power line corridor (PLC), paper Eq. 9."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import CorridorSettings
from plc_inspect.core.curve import Curve
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64

MIN_RADIUS = 0.6
"""Least search radius, the initial value of Table 1 [m]."""
MAX_PROBES = 500_000
"""Points that are enough to choose the radii by."""
CELL = 4.0
"""Edge of the plan cells that know the spans near them [m]."""
MAX_CELLS = 4_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CorridorResult:
    """The corridor of C spans among N points."""

    points: Int64
    """(K,) indices of the points of the corridor, ascending."""
    distance: Float32
    """(K,) distance to the nearest span [m]."""
    span: Int32
    """(K,) which span that is."""
    radius: Float64
    """(C,) search radius of each span [m]."""
    complex_case: Bool
    """(C,) True where the first case of Eq. 9 was used."""
    near: Int64
    """(J,) indices of all points within the search reach, ascending; the corridor among them."""
    near_distance: Float32
    """(J,) distance to the nearest span [m]."""
    near_span: Int32
    """(J,) which span that is."""


def extract_corridor(
    points: Float64,
    height: Float32,
    wire: Bool,
    curves: Sequence[Curve],
    start_x: Float64,
    end_x: Float64,
    settings: CorridorSettings,
    least_reach: float = 0.0,
) -> CorridorResult:
    """
    Find the points within the search radius of each span, and their distance to it.

    The radius of a span is the first case of Eq. 9 where something near it stands higher than
    its lowest point: the greatest distance, in the vertical plane or from it, of the points that
    are higher above ground than they are far from the plane and so could fall onto it.  In open
    country it is the height of the lowest point above ground.  Distances are to the curve itself,
    not to its points.  O(N) with a plan grid in place of the paper's Kd-tree.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    height : (N,) float32
        Above local ground [m].
    wire : (N,) bool
        Points of conductors.
    curves, start_x, end_x : sequence of Curve, (C,) float64, (C,) float64
        Curves and the x of their ends [m].
    settings : CorridorSettings
        Settings of this stage.
    least_reach : float
        Search at least this far, whatever the radius, for clearance rules [m].

    Returns
    -------
    CorridorResult

    """
    num = len(curves)
    if num == 0 or len(points) == 0:
        return CorridorResult(
            points=np.zeros(0, dtype=np.int64),
            distance=np.zeros(0, dtype=np.float32),
            span=np.zeros(0, dtype=np.int32),
            radius=np.zeros(num),
            complex_case=np.zeros(num, dtype=bool),
            near=np.zeros(0, dtype=np.int64),
            near_distance=np.zeros(0, dtype=np.float32),
            near_span=np.zeros(0, dtype=np.int32),
        )
    table = span_table(curves, start_x, end_x)
    radius = np.full(num, settings.radius or settings.max_radius)
    complex_case = np.zeros(num, dtype=bool)
    if settings.radius == 0.0:
        probes = np.arange(0, len(points), max(len(points) // MAX_PROBES, 1))
        probes = probes[~wire[probes]]
        found, _, span = find_near(points[probes], table, radius)
        found = probes[found]
        order = np.argsort(span, kind='stable')
        bounds = np.searchsorted(span[order], np.arange(num + 1))
        for number in range(num):
            own = found[order[bounds[number] : bounds[number + 1]]]
            radius[number], complex_case[number] = _radius(
                points[own],
                height[own],
                curves[number],
                start_x[number],
                end_x[number],
                settings,
            )
    found, distance, span = find_near(points, table, np.maximum(radius, least_reach))
    inside = distance <= radius[span]
    return CorridorResult(
        points=found[inside],
        distance=distance[inside],
        span=span[inside],
        radius=radius,
        complex_case=complex_case,
        near=found,
        near_distance=distance,
        near_span=span,
    )


def _radius(
    points: Float64,
    height: Float32,
    curve: Curve,
    start: float,
    end: float,
    settings: CorridorSettings,
) -> tuple[float, bool]:
    """Search radius by Eq. 9 from points near a span, and whether its first case was used."""
    lowest = float(curve.fit.height(curve.fit.lowest(start, end)))
    known = np.isfinite(height)
    ground = float(np.median(points[known, 2] - height[known])) if known.any() else -math.inf
    sag_height = lowest - ground
    open_radius = min(max(sag_height, MIN_RADIUS), settings.max_radius)
    overhead = (points[:, 2] > lowest) & (height > 2.0)
    is_complex = settings.environment == 'complex' or (
        settings.environment == 'auto' and int(overhead.sum()) >= 3
    )
    if not is_complex:
        return open_radius, False
    x, y = curve.local(points)
    across = np.abs(y)
    vertical = np.abs(points[:, 2] - curve.fit.height(x))
    falls = (height > across) & (height > 2.0)
    if not falls.any():
        return open_radius, True
    radius = float(np.maximum(vertical, across)[falls].max())
    return min(max(radius, MIN_RADIUS), settings.max_radius), True


def span_table(curves: Sequence[Curve], start_x: Float64, end_x: Float64) -> Float64:
    """
    Pack curves for the kernels.

    Returns
    -------
    (C, 10) float64
        origin x, y, cosine and sine of the azimuth, middle, height, slope and curvature of the
        catenary, start and end x.

    """
    return np.array(
        [
            [
                curve.origin[0],
                curve.origin[1],
                math.cos(curve.azimuth),
                math.sin(curve.azimuth),
                curve.fit.middle,
                *curve.fit.shape,
                low,
                high,
            ]
            for curve, low, high in zip(curves, start_x, end_x, strict=True)
        ]
    ).reshape(len(curves), 10)


def find_near(
    points: Float64, table: Float64, reach: Float64 | float
) -> tuple[Int64, Float32, Int32]:
    """
    Find the points within reach of any span.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    table : (C, 10) float64
        From span_table.
    reach : (C,) float64 or float
        Search radius of each span, or of all [m].

    Returns
    -------
    found : (K,) int64, ascending
    distance : (K,) float32 [m]
    span : (K,) int32, nearest span

    """
    reach = np.ascontiguousarray(np.broadcast_to(np.asarray(reach, np.float64), len(table)))
    ends = np.concatenate(
        [table[:, :2] + table[:, column, None] * table[:, 2:4] for column in (8, 9)]
    )
    low = ends.min(axis=0) - reach.max()
    extent = ends.max(axis=0) + reach.max() - low
    cell = max(CELL, math.sqrt(float(extent[0] * extent[1]) / MAX_CELLS))
    rows, columns = int(extent[1] / cell) + 1, int(extent[0] / cell) + 1
    start, spans = _spans_by_cell(table, reach, low, cell, rows, columns)
    distance, span = _nearest(points, table, reach, low, cell, rows, columns, start, spans)
    found = np.flatnonzero(span >= 0)
    return found, distance[found], span[found]


@njit(cache=True, nogil=True, inline='always')
def _cosh_sinh(u):  # type: ignore[no-untyped-def]
    """Both by their series up to |u| = 0.8, where the error is below 1e-8; else exact."""
    if abs(u) > 0.8:
        return math.cosh(u), math.sinh(u)
    q = u * u
    cosh = 1.0 + q / 2 * (1.0 + q / 12 * (1.0 + q / 30 * (1.0 + q / 56)))
    sinh = u * (1.0 + q / 6 * (1.0 + q / 20 * (1.0 + q / 42 * (1.0 + q / 72))))
    return cosh, sinh


@njit(cache=True, nogil=True, inline='always')
def distance_to_span(row, along, across, pz, base, root):  # type: ignore[no-untyped-def]
    """Distance of a point, given along and across a span of span_table, to its curve."""
    x = min(max(along, row[8]), row[9])
    for _ in range(2):
        cosh, slope = _cosh_sinh(row[7] * (x - row[4]) + base)
        dz = row[5] + (cosh - root) / row[7] - pz
        # Newton on (x - along)^2 + (z - pz)^2, with the curvature kept positive
        first = (x - along) + dz * slope
        second = 1.0 + slope * slope + max(dz * row[7] * cosh, -0.5)
        x = min(max(x - first / second, row[8]), row[9])
    cosh, _ = _cosh_sinh(row[7] * (x - row[4]) + base)
    dz = row[5] + (cosh - root) / row[7] - pz
    return math.sqrt((x - along) ** 2 + across * across + dz * dz)


@njit(cache=True, nogil=True)
def _spans_by_cell(table, reach, low, cell, rows, columns):  # type: ignore[no-untyped-def]
    count = np.zeros(rows * columns + 1, dtype=np.int64)
    spans = np.empty(0, dtype=np.int32)
    for fill in range(2):
        if fill == 1:
            for k in range(rows * columns):
                count[k + 1] += count[k]
            spans = np.empty(count[rows * columns], dtype=np.int32)
            place = count[:-1].copy()
        for s in range(len(table)):
            row = table[s]
            slack = reach[s] + cell * 0.7072
            x0, y0 = row[0] + row[8] * row[2], row[1] + row[8] * row[3]
            x1, y1 = row[0] + row[9] * row[2], row[1] + row[9] * row[3]
            r0 = max(int((min(y0, y1) - slack - low[1]) / cell), 0)
            r1 = min(int((max(y0, y1) + slack - low[1]) / cell), rows - 1)
            c0 = max(int((min(x0, x1) - slack - low[0]) / cell), 0)
            c1 = min(int((max(x0, x1) + slack - low[0]) / cell), columns - 1)
            for r in range(r0, r1 + 1):
                for c in range(c0, c1 + 1):
                    cx, cy = low[0] + (c + 0.5) * cell, low[1] + (r + 0.5) * cell
                    along = row[2] * (cx - row[0]) + row[3] * (cy - row[1])
                    across = row[2] * (cy - row[1]) - row[3] * (cx - row[0])
                    beyond = along - min(max(along, row[8]), row[9])
                    if across * across + beyond * beyond <= slack * slack:
                        if fill == 0:
                            count[r * columns + c + 1] += 1
                        else:
                            spans[place[r * columns + c]] = s
                            place[r * columns + c] += 1
    return count, spans


@njit(cache=True, parallel=True, nogil=True)
def _nearest(  # type: ignore[no-untyped-def]
    points, table, reach, low, cell, rows, columns, start, spans
):
    num = len(points)
    distance = np.empty(num, dtype=np.float32)
    span = np.full(num, -1, dtype=np.int32)
    base = np.arcsinh(table[:, 6])
    root = np.sqrt(1.0 + table[:, 6] ** 2)
    # a curve is at least this share of its vertical distance away
    steepest = np.zeros(len(table))
    for s in range(len(table)):
        ends = max(
            abs(math.sinh(table[s, 7] * (table[s, 8] - table[s, 4]) + base[s])),
            abs(math.sinh(table[s, 7] * (table[s, 9] - table[s, 4]) + base[s])),
        )
        steepest[s] = 1.0 / math.sqrt(1.0 + ends * ends)
    for i in prange(num):
        fx, fy = (points[i, 0] - low[0]) / cell, (points[i, 1] - low[1]) / cell
        if not (fx >= 0.0 and fy >= 0.0 and fx < columns and fy < rows):
            continue
        where = int(fy) * columns + int(fx)
        nearest = np.inf
        for k in range(start[where], start[where + 1]):
            s = spans[k]
            row = table[s]
            best = min(nearest, reach[s])
            dx, dy = points[i, 0] - row[0], points[i, 1] - row[1]
            across = row[2] * dy - row[3] * dx
            if abs(across) > best:
                continue
            along = row[2] * dx + row[3] * dy
            x = min(max(along, row[8]), row[9])
            cosh, _ = _cosh_sinh(row[7] * (x - row[4]) + base[s])
            dz = (row[5] + (cosh - root[s]) / row[7] - points[i, 2]) * steepest[s]
            beyond = x - along
            if dz * dz + across * across > best * best and beyond == 0.0:
                continue
            d = distance_to_span(row, along, across, points[i, 2], base[s], root[s])
            if d <= best:
                nearest = d
                span[i] = s
                distance[i] = d
    return distance, span
