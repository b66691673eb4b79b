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

"""Search for the span that is nearest to each point."""

from collections.abc import Sequence
import math

from numba import njit, prange
import numpy as np

from plc_inspect.core.curve import Curve
from plc_inspect.results import Float32, Float64, Int32, Int64

CELL = 4.0
"""Edge of the plan cells that know the spans near them [m]."""
MAX_CELLS = 4_000_000
ENOUGH = 0.01
"""A step that bends off the tangent by less than this was the last one needed [m]."""


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
    local, bottom, top = _expand(table, reach, low, cell, rows, columns, start, spans)
    found, distance, span = _nearest(
        points, table, reach, low, cell, rows, columns, start, spans, local, bottom, top
    )
    return found, distance, span


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


@njit(cache=True, nogil=True)
def _expand(table, reach, low, cell, rows, columns, start, spans):  # type: ignore[no-untyped-def]
    """
    Curve of each span of each cell as a parabola about the middle of the cell.

    Within a cell its error is below 1 mm for constants of 100 m and more.  Returned are x,
    height, slope and half of the curvature there, and the square of the least share of a
    vertical distance from the curve that is distance to it; and the heights between which points
    of each cell can be within reach.
    """
    local = np.empty((len(spans), 5))
    bottom = np.full(rows * columns, np.inf)
    top = np.full(rows * columns, -np.inf)
    for r in range(rows):
        for c in range(columns):
            cx, cy = low[0] + (c + 0.5) * cell, low[1] + (r + 0.5) * cell
            where = r * columns + c
            for k in range(start[where], start[where + 1]):
                row = table[spans[k]]
                along = row[2] * (cx - row[0]) + row[3] * (cy - row[1])
                x = min(max(along, row[8]), row[9])
                u = row[7] * (x - row[4]) + math.asinh(row[6])
                cosh, slope = math.cosh(u), math.sinh(u)
                z = row[5] + (cosh - math.sqrt(1.0 + row[6] ** 2)) / row[7]
                half = 0.5 * row[7] * cosh
                local[k, 0], local[k, 1], local[k, 2], local[k, 3] = x, z, slope, half
                # the foot of a point in the cell lies this far from the middle at most
                away = cell * 0.7072 + reach[spans[k]] * min(abs(slope), 1.0)
                slack = away * (abs(slope) + half * away) + reach[spans[k]]
                steepest = abs(slope) + 2.0 * half * (away + reach[spans[k]])
                local[k, 4] = 1.0 / (1.0 + steepest * steepest)
                bottom[where] = min(bottom[where], z - slack)
                top[where] = max(top[where], z + slack)
    return local, bottom, top


@njit(cache=True, parallel=True, nogil=True)
def _nearest(  # type: ignore[no-untyped-def]
    points, table, reach, low, cell, rows, columns, start, spans, local, bottom, top
):
    num = len(points)
    num_parts = 16
    # what each part of the points finds is written from its own place on, then moved together
    found = np.empty(num, dtype=np.int32)
    distance = np.empty(num, dtype=np.float32)
    span = np.empty(num, dtype=np.int32)
    last_of = np.zeros(num_parts + 1, dtype=np.int64)
    limit = reach * reach
    per_cell = 1.0 / cell
    for part in prange(num_parts):
        place = part * num // num_parts
        for i in range(part * num // num_parts, (part + 1) * num // num_parts):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            fx, fy = (px - low[0]) * per_cell, (py - low[1]) * per_cell
            if not (fx >= 0.0 and fy >= 0.0 and fx < columns and fy < rows):
                continue
            where = int(fy) * columns + int(fx)
            if not (pz >= bottom[where] and pz <= top[where]):
                continue
            best = np.inf
            own = -1
            for k in range(start[where], start[where + 1]):
                s = spans[k]
                row = table[s]
                dx, dy = px - row[0], py - row[1]
                across = row[2] * dy - row[3] * dx
                d2 = across * across
                most = min(best, limit[s])
                if d2 > most:
                    continue
                x0, z0, slope, half = local[k, 0], local[k, 1], local[k, 2], local[k, 3]
                u = row[2] * dx + row[3] * dy - x0
                first, last = row[8] - x0, row[9] - x0
                x = min(max(u, first), last)
                dz = pz - (z0 + x * (slope + half * x))
                if x == u and d2 + dz * dz * local[k, 4] > most:
                    continue
                for _ in range(2):  # Newton on the distance, its curvature kept positive
                    tilt = slope + 2.0 * half * x
                    second = 1.0 + tilt * tilt - 2.0 * half * dz
                    step = (u - x + dz * tilt) / max(second, 0.5)
                    x = min(max(x + step, first), last)
                    dz = pz - (z0 + x * (slope + half * x))
                    if half * step * step < ENOUGH:
                        break
                d2 += (u - x) * (u - x) + dz * dz
                if d2 <= most:
                    best = d2
                    own = s
            if own >= 0:
                found[place] = i
                span[place] = own
                distance[place] = math.sqrt(best)
                place += 1
        last_of[part + 1] = place - part * num // num_parts
    for part in range(num_parts):
        last_of[part + 1] += last_of[part]
    total = last_of[num_parts]
    all_found = np.empty(total, dtype=np.int64)
    all_distance = np.empty(total, dtype=np.float32)
    all_span = np.empty(total, dtype=np.int32)
    for part in prange(num_parts):
        place = part * num // num_parts
        for k in range(last_of[part], last_of[part + 1]):
            all_found[k] = found[place]
            all_distance[k] = distance[place]
            all_span[k] = span[place]
            place += 1
    return all_found, all_distance, all_span
