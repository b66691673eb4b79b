# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Search for the span that is nearest to each point."""

import math

from numba import njit, prange
import numpy as np

from plc_inspect.core.catenary.curve_row import (
    COS,
    CURVATURE,
    HEIGHT,
    HIGH,
    LOW,
    MIDDLE,
    ORIGIN_X,
    ORIGIN_Y,
    SIN,
    SLOPE,
    to_local,
)
from plc_inspect.core.numerics.arrays import find_true, NUM_PARTS, take_rows
from plc_inspect.core.numerics.plan_index import clamp
from plc_inspect.results import Float32, Float64, Int32, Int64

CELL = 4.0
"""Edge of the plan cells that know the spans near them [m].  Source: judgement; not measured."""
MAX_CELLS = 4_000_000
"""Cells, at most; spans over a wider area are parted.  Source: numerical: a bound of memory."""
MARGIN = 2
"""
Cells about the reach of all spans; what lies beyond is taken to the outermost, empty ones.
Source: numerical: one, and one for rounding.
"""
BLOCK = 131_072
"""Points that are sorted by cell together.  Source: numerical: the size of a block."""
STRETCH = 4096
"""Points whose cells are worked out together.  Source: numerical: the size of a block."""
ENOUGH = np.float32(0.01)
"""
A step that bends off the tangent by less than this was the last one needed [m].
Source: judgement; not measured: a third of the noise of ranges.
"""
HALF, ONE, TWO = np.float32(0.5), np.float32(1.0), np.float32(2.0)
"""Numbers of single precision.  Source: numerical: others would make all of it double."""
NUM_LOCAL = 9
"""
Figures of a span's curve in a cell: cosine and sine of its azimuth; how far along and across it
the middle of the cell lies from the curve's point nearest to it in plan; height above the lowest
within reach, slope and half of the curvature there; and from there to the span's start and end.
Source: numerical: the layout of a row.
"""


def find_near(
    points: Float64, table: Float64, reach: Float64 | float
) -> tuple[Int64, Float32, Int32]:
    """
    Find the points within reach of any span.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    table : (C, ROW) float64
        From span_table.
    reach : (C,) float64 or float
        Search radius of each span, or of all [m].

    Returns
    -------
    found : (K,) int64, ascending
    distance : (K,) float32 [m]
    span : (K,) int32, nearest span

    """
    reach = np.full(len(table), reach, dtype=np.float64)
    low, high = _bounds(table, reach)
    extent = high - low
    cell = max(CELL, math.sqrt(float(extent[0] * extent[1]) / MAX_CELLS))
    if cell > CELL and len(table) > 1:
        return _find_apart(points, table, reach)
    low -= MARGIN * cell
    columns, rows = (int(value / cell) + 1 + 2 * MARGIN for value in extent)
    start, spans = _spans_by_cell(table, reach, low, cell, rows, columns)
    local, bottom, top = _expand(table, reach, low, cell, rows, columns, start, spans)
    limit = np.square(reach).astype(np.float32)
    num = len(points)
    # made here and not in the kernels, as numpy asks for large pages of memory
    rough = np.empty(num, dtype=np.int32), np.empty(num, np.float32), np.empty(num, np.int32)
    first_of = _nearest(
        points, low, cell, rows, columns, start, spans, local, limit, bottom, top, *rough
    )
    total = int(first_of[-1])
    dense = np.empty(total, dtype=np.int64), np.empty(total, np.float32), np.empty(total, np.int32)
    _close_up(num, first_of, *rough, *dense)
    return dense


def _bounds(table: Float64, reach: Float64) -> tuple[Float64, Float64]:
    """Return least and greatest x and y within reach of spans [m]."""
    ends = np.concatenate([
        table[:, ORIGIN_X : ORIGIN_Y + 1] + table[:, end, None] * table[:, COS : SIN + 1]
        for end in (LOW, HIGH)
    ])
    return ends.min(axis=0) - reach.max(), ends.max(axis=0) + reach.max()


def _find_apart(
    points: Float64, table: Float64, reach: Float64
) -> tuple[Int64, Float32, Int32]:
    """Find what `find_near` does, in either half of the spans: in larger cells it is not exact."""
    place = table[:, ORIGIN_X : ORIGIN_Y + 1]
    order = np.argsort(place[:, np.ptp(place, axis=0).argmax()], kind='stable')
    best = np.full(len(points), np.inf, dtype=np.float32)
    owner = np.full(len(points), -1, dtype=np.int32)
    for own in np.array_split(order, 2):
        low, high = _bounds(table[own], reach[own])
        inside = (points[:, :2] >= low) & (points[:, :2] <= high)
        chosen = find_true(inside[:, 0] & inside[:, 1])
        found, distance, number = find_near(take_rows(points, chosen), table[own], reach[own])
        at, span = chosen[found], own[number].astype(np.int32)
        nearer = (distance < best[at]) | ((distance == best[at]) & (span > owner[at]))
        best[at[nearer]], owner[at[nearer]] = distance[nearer], span[nearer]
    found = find_true(owner >= 0)
    return found, best[found], owner[found]


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
            x0, y0 = row[ORIGIN_X] + row[LOW] * row[COS], row[ORIGIN_Y] + row[LOW] * row[SIN]
            x1, y1 = row[ORIGIN_X] + row[HIGH] * row[COS], row[ORIGIN_Y] + row[HIGH] * row[SIN]
            r0 = max(int((min(y0, y1) - slack - low[1]) / cell), 0)
            r1 = min(int((max(y0, y1) + slack - low[1]) / cell), rows - 1)
            c0 = max(int((min(x0, x1) - slack - low[0]) / cell), 0)
            c1 = min(int((max(x0, x1) + slack - low[0]) / cell), columns - 1)
            for r in range(r0, r1 + 1):
                for c in range(c0, c1 + 1):
                    cx, cy = low[0] + (c + 0.5) * cell, low[1] + (r + 0.5) * cell
                    along, across = to_local(row, cx, cy)
                    beyond = along - min(max(along, row[LOW]), row[HIGH])
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

    Within a cell its error is below 1 mm for constants of 100 m and more.  Returned are its
    NUM_LOCAL figures, and the heights between which points of each cell can be within reach.
    """
    height = np.empty(len(spans))
    local = np.empty((len(spans), NUM_LOCAL), dtype=np.float32)
    bottom = np.full(rows * columns, np.inf)
    top = np.full(rows * columns, -np.inf)
    for r in range(rows):
        for c in range(columns):
            cx, cy = low[0] + (c + 0.5) * cell, low[1] + (r + 0.5) * cell
            where = r * columns + c
            for k in range(start[where], start[where + 1]):
                row = table[spans[k]]
                along, across = to_local(row, cx, cy)
                x = min(max(along, row[LOW]), row[HIGH])
                u = row[CURVATURE] * (x - row[MIDDLE]) + math.asinh(row[SLOPE])
                cosh, slope = math.cosh(u), math.sinh(u)
                root = math.sqrt(1.0 + row[SLOPE] ** 2)
                z = height[k] = row[HEIGHT] + (cosh - root) / row[CURVATURE]
                half = 0.5 * row[CURVATURE] * cosh
                local[k, 0], local[k, 1] = row[COS], row[SIN]
                local[k, 2], local[k, 3] = along - x, across
                local[k, 5], local[k, 6] = slope, half
                local[k, 7], local[k, 8] = row[LOW] - x, row[HIGH] - x
                # the foot of a point in the cell lies this far from the middle at most
                away = cell * 0.7072 + reach[spans[k]] * min(abs(slope), 1.0)
                slack = away * (abs(slope) + half * away) + reach[spans[k]]
                bottom[where] = min(bottom[where], z - slack)
                top[where] = max(top[where], z + slack)
            for k in range(start[where], start[where + 1]):
                local[k, 4] = height[k] - bottom[where]
    return local, bottom, top


@njit(cache=True, parallel=True, nogil=True, error_model='numpy')
def _nearest(  # type: ignore[no-untyped-def]
    points, low, cell, rows, columns, start, spans, local, limit, bottom, top,
    found, distance, span,
):
    """
    Write what each part of the points finds from the part's own place on.

    Returned is the number of points found before each part, and in all.
    """
    num = len(points)
    last_of = np.zeros(NUM_PARTS + 1, dtype=np.int64)
    for part in prange(NUM_PARTS):
        begin, end = part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS
        if begin == end:
            continue
        size = min(BLOCK, end - begin)
        group_of = np.zeros(rows * columns, dtype=np.int32)
        chosen, where = np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int32)
        place = begin
        for first in range(begin, end, BLOCK):
            num_near = _choose(
                points, first, min(first + BLOCK, end), low, cell, rows, columns, bottom, top,
                chosen, where,
            )
            square, own = _search(
                points, chosen[:num_near], where[:num_near], group_of, low, cell, columns, bottom,
                start, spans, local, limit,
            )
            for n in range(num_near):  # without a branch that would be hard to predict
                found[place] = chosen[n]
                span[place] = own[n]
                distance[place] = math.sqrt(square[n])
                place += own[n] >= 0
        last_of[part + 1] = place - begin
    for part in range(NUM_PARTS):
        last_of[part + 1] += last_of[part]
    return last_of


@njit(cache=True, parallel=True, nogil=True)
def _close_up(  # type: ignore[no-untyped-def]
    num, first_of, found, distance, span, all_found, all_distance, all_span
):
    """Move what the parts found together."""
    for part in prange(NUM_PARTS):
        place = part * num // NUM_PARTS
        for k in range(first_of[part], first_of[part + 1]):
            all_found[k] = found[place]
            all_distance[k] = distance[place]
            all_span[k] = span[place]
            place += 1


@njit(cache=True, nogil=True)
def _choose(  # type: ignore[no-untyped-def]
    points, first, last, low, cell, rows, columns, bottom, top, chosen, where
):
    """List the points of a block that spans may be near to, and their cells; return how many."""
    own, is_near = np.empty(STRETCH, dtype=np.uint32), np.empty(STRETCH, dtype=np.uint8)
    num = 0
    for begin in range(first, last, STRETCH):
        end = min(begin + STRETCH, last)
        _find_cells(points[begin:end], low, cell, rows, columns, bottom, top, own, is_near)
        for k in range(end - begin):  # without a branch that would be hard to predict
            chosen[num], where[num] = begin + k, own[k]
            num += is_near[k]
    return num


@njit(cache=True, nogil=True)
def _find_cells(  # type: ignore[no-untyped-def]
    points, low, cell, rows, columns, bottom, top, own, is_near
):
    """
    Put in the cell of each point, and whether spans may be near to it.

    Free of branches, and with a fixed step from point to point, so that the compiler turns it
    into vector instructions.
    """
    flat, per_cell = points.ravel(), 1.0 / cell
    x0, y0, wide = low[0], low[1], np.uint32(columns)
    most_x, most_y = columns - 1.0, rows - 1.0
    for k in range(len(points)):
        x, y, z = (flat[3 * k] - x0) * per_cell, (flat[3 * k + 1] - y0) * per_cell, flat[3 * k + 2]
        x, y = clamp(x, most_x), clamp(y, most_y)
        cell_of = np.uint32(np.int32(y)) * wide + np.uint32(np.int32(x))
        own[k] = cell_of
        is_near[k] = (z >= bottom[cell_of]) & (z <= top[cell_of])


@njit(cache=True, nogil=True, error_model='numpy')
def _search(  # type: ignore[no-untyped-def]
    points, chosen, where, group_of, low, cell, columns, bottom, start, spans, local, limit
):
    """
    Squared distance to the nearest span, and which that is, -1 none, of each chosen point.

    Points of one cell are taken together: its spans are looked at one by one, in loops over
    points without branches, which the compiler turns into vector instructions.  ``group_of``
    holds a zero for each cell, before and after.
    """
    num = len(chosen)
    group = np.empty(num, dtype=np.int32)
    cells = np.empty(num, dtype=np.int32)
    begin = np.zeros(num + 2, dtype=np.int32)
    num_groups = 0
    for n in range(num):
        number = group_of[where[n]]
        if number == 0:
            cells[num_groups] = where[n]
            num_groups += 1
            number = num_groups
            group_of[where[n]] = number
        group[n] = number
        begin[number + 1] += 1
    for number in range(1, num_groups + 1):
        begin[number + 1] += begin[number]
        group_of[cells[number - 1]] = 0
    place = np.empty(num, dtype=np.int32)
    x, y = np.empty(num, dtype=np.float32), np.empty(num, dtype=np.float32)
    z, best = np.empty(num, dtype=np.float32), np.full(num, np.inf, dtype=np.float32)
    owner = np.full(num, -1, dtype=np.int32)
    origin = np.empty((num_groups + 1, 3))  # middle of a cell, and the lowest within reach
    for number in range(1, num_groups + 1):
        own = cells[number - 1]
        origin[number, 0] = low[0] + (own % columns + 0.5) * cell
        origin[number, 1] = low[1] + (own // columns + 0.5) * cell
        origin[number, 2] = bottom[own]
    for n in range(num):
        k, i, number = begin[group[n]], chosen[n], group[n]
        begin[number] += 1
        place[n] = k
        x[k], y[k] = points[i, 0] - origin[number, 0], points[i, 1] - origin[number, 1]
        z[k] = points[i, 2] - origin[number, 2]
    first = 0
    for number in range(1, num_groups + 1):
        last = begin[number]
        own = cells[number - 1]
        for k in range(start[own], start[own + 1]):
            _measure(
                x[first:last], y[first:last], z[first:last], local[k], limit[spans[k]],
                spans[k], best[first:last], owner[first:last],
            )
        first = last
    return best[place], owner[place]


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def _descend(x, u, z, slope, half, low, high):  # type: ignore[no-untyped-def]
    """Step of Newton on the distance, its curvature kept positive; where it leads, and itself."""
    dz = z - x * (slope + half * x)
    tilt = slope + TWO * half * x
    second = ONE + tilt * tilt - TWO * half * dz
    second = second if second > HALF else HALF
    step = (u - x + dz * tilt) / second
    x = x + step
    x = x if x > low else low
    x = x if x < high else high
    return x, step


@njit(cache=True, nogil=True, error_model='numpy')
def _measure(px, py, pz, local, limit, number, best, owner):  # type: ignore[no-untyped-def]
    """
    Put a span in for the points that it is nearest to so far.

    Positions are from a place in their cell, where float32 is exact to 0.01 mm; a float64 among
    these numbers would make them all float64, of which the processor does half as many at once.
    """
    ca, sa, u0, across0 = local[0], local[1], local[2], local[3]
    z0, slope, half, low, high = local[4], local[5], local[6], local[7], local[8]
    for k in range(len(px)):
        across = ca * py[k] - sa * px[k] + across0
        u = ca * px[k] + sa * py[k] + u0
        z = pz[k] - z0
        x = u if u > low else low
        x = x if x < high else high
        x, step = _descend(x, u, z, slope, half, low, high)
        again, _ = _descend(x, u, z, slope, half, low, high)
        x = again if half * step * step >= ENOUGH else x
        dz = z - x * (slope + half * x)
        square = across * across + ((u - x) * (u - x) + dz * dz)
        before, mine = best[k], owner[k]
        nearer = (square <= before) & (square <= limit)
        best[k] = square if nearer else before
        owner[k] = number if nearer else mine
