# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Index of points by plan cell, for searches along segments in plan."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.results import Float64, Int32, Int64

MAX_CELLS = 16_000_000
"""
Greatest number of cells; a larger area gets larger cells.
Source: numerical: their starts, int32, take 64 MB.
"""
HALF_DIAGONAL = 0.7072
"""
Half the diagonal of a cell of edge 1, rounded up.
Source: derived: the square root of 1/2.
"""
LEVEL = 1e-9
"""
Least extent in y of a segment that crosses rows [m].
Source: numerical: far below the resolution of coordinates.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanIndex:
    """Indices of K points sorted by plan cell."""

    origin: Float64
    """(2,) lower corner [m]."""
    cell_size: float
    shape: tuple[int, int]
    """Rows (along y) and columns (along x)."""
    start: Int32
    """(rows * columns + 1,) first entry of each cell in ``order``."""
    order: Int32
    """(K,) point indices; ascending within a cell."""

    @property
    def grid(self) -> tuple[Int32, Int32, Float64, float, int, int]:
        """The index as kernels take it: start, order, origin, cell size, rows, columns."""
        return self.start, self.order, self.origin, self.cell_size, *self.shape

    def strip(self, first: Float64, last: Float64, reach: float) -> Int32:
        """
        Find the points near a segment in plan, or near a position if both ends are equal.

        Parameters
        ----------
        first, last : (2+,) float64
            Ends of the segment [m].
        reach : float
            Distance from the segment [m].

        Returns
        -------
        (M,) int32
            Points in all cells that touch the strip: those within reach and some beyond, each
            once, in row order of the cells.

        """
        found: Int32 = gather_strip(*self.grid, first[0], first[1], last[0], last[1], reach)
        return found


def build_plan_index(
    points: Float64, chosen: Int64, cell_size: float, anchor: Float64 | None = None
) -> PlanIndex:
    """
    Sort the chosen points into plan cells; O(K + cells).

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) int64
        Ascending indices of finite points.
    cell_size : float
        Edge of a cell [m], enlarged where the area needs more than MAX_CELLS cells.
    anchor : (2,) float64 or None
        A corner of the cells, by default the least coordinates of the points [m].

    Returns
    -------
    PlanIndex

    """
    if not len(chosen):
        return PlanIndex(
            origin=np.zeros(2),
            cell_size=cell_size,
            shape=(1, 1),
            start=np.zeros(2, dtype=np.int32),
            order=np.zeros(0, dtype=np.int32),
        )
    low, high = _plan_bounds(points, chosen)
    if anchor is not None:
        low = anchor + np.floor((low - anchor) / cell_size) * cell_size
    extent = high - low
    cell = max(cell_size, math.sqrt(float(extent[0] * extent[1]) / MAX_CELLS))
    shape = (int(extent[1] / cell) + 1, int(extent[0] / cell) + 1)
    start, order = _sort(points, chosen, low, cell, shape[0], shape[1])
    return PlanIndex(origin=low, cell_size=cell, shape=shape, start=start, order=order)


@njit(cache=True, nogil=True, inline='always')
def clamp(value, most):  # type: ignore[no-untyped-def]
    """Clamp a value to 0 to ``most``, NaN to 0, without branches."""
    value = value if value > 0.0 else 0.0
    return value if value < most else most


@njit(cache=True, parallel=True, nogil=True)
def _plan_bounds(points, chosen):  # type: ignore[no-untyped-def]
    num_parts = 8
    low = np.full((num_parts, 2), np.inf)
    high = np.full((num_parts, 2), -np.inf)
    num = len(chosen)
    for part in prange(num_parts):
        for m in range(part * num // num_parts, (part + 1) * num // num_parts):
            i = chosen[m]
            for k in range(2):
                low[part, k] = min(low[part, k], points[i, k])
                high[part, k] = max(high[part, k], points[i, k])
    for part in range(1, num_parts):
        for k in range(2):
            low[0, k] = min(low[0, k], low[part, k])
            high[0, k] = max(high[0, k], high[part, k])
    return low[0].copy(), high[0].copy()


@njit(cache=True, parallel=True, nogil=True)
def _sort(points, chosen, low, cell, rows, columns):  # type: ignore[no-untyped-def]
    # counting sort by cell
    num = len(chosen)
    where = np.empty(num, dtype=np.int32)
    for k in prange(num):
        i = chosen[k]
        row = int((points[i, 1] - low[1]) / cell)
        column = int((points[i, 0] - low[0]) / cell)
        where[k] = row * columns + column
    start = np.zeros(rows * columns + 1, dtype=np.int32)
    for k in range(num):
        start[where[k] + 1] += 1
    for k in range(rows * columns):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    order = np.empty(num, dtype=np.int32)
    for k in range(num):
        order[place[where[k]]] = chosen[k]
        place[where[k]] += 1
    return start, order


@njit(cache=True, nogil=True)
def gather_strip(  # type: ignore[no-untyped-def]
    start, order, origin, cell, rows, columns, x0, y0, x1, y1, reach
):
    """
    Return the indices in all cells that touch the strip within ``reach`` of a segment in plan.

    A superset of the points in the strip, each once, in row order of the cells.
    """
    # find the rows that the strip touches
    row0 = max(int((min(y0, y1) - reach - origin[1]) / cell), 0)
    row1 = min(int((max(y0, y1) + reach - origin[1]) / cell), rows - 1)
    dx, dy = x1 - x0, y1 - y0
    length = np.sqrt(dx * dx + dy * dy)
    # the centre of a cell that the strip touches lies within slack of the segment
    slack = reach + cell * HALF_DIAGONAL
    total = 0
    for fill in range(2):  # once to count, once to copy
        if fill == 1:
            found = np.empty(total, dtype=np.int32)
            total = 0
        for row in range(row0, row1 + 1):
            cy = origin[1] + (row + 0.5) * cell
            # clip the segment to within slack of this row; t are shares of its length
            if abs(dy) > LEVEL:
                t0 = (cy - slack - y0) / dy
                t1 = (cy + slack - y0) / dy
                if t0 > t1:
                    t0, t1 = t1, t0
                t0, t1 = max(t0, 0.0), min(t1, 1.0)
            else:
                t0, t1 = 0.0, 1.0
            if t0 > t1:  # the row lies beyond an end
                if length > 0.0:
                    t0 = 0.0 if abs(cy - y0) < abs(cy - y1) else 1.0
                    t1 = t0
                else:
                    t0, t1 = 0.0, 0.0
            # find the columns whose centres may lie within slack of that part
            xa, xb = x0 + t0 * dx, x0 + t1 * dx
            left = int((min(xa, xb) - slack - origin[0]) / cell)
            right = int((max(xa, xb) + slack - origin[0]) / cell)
            for column in range(max(left, 0), min(right, columns - 1) + 1):
                # skip cells whose centres do not
                cx = origin[0] + (column + 0.5) * cell
                t = ((cx - x0) * dx + (cy - y0) * dy) / (length * length) if length > 0 else 0.0
                t = min(max(t, 0.0), 1.0)
                ex, ey = cx - x0 - t * dx, cy - y0 - t * dy
                if ex * ex + ey * ey > slack * slack:
                    continue
                here = row * columns + column
                if fill == 0:
                    total += start[here + 1] - start[here]
                else:
                    for k in range(start[here], start[here + 1]):
                        found[total] = order[k]
                        total += 1
    return found
