# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Walls: a scan line on a facade has the wall below it, in its own vertical plane.

Those of a lidar that passes bend as conductors do, side by side, and windows let air between
them.  But pillars reach down from each; below conductors only a pole does.
"""

from collections.abc import Sequence

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import (
    COS,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
    TOLERANCE,
)
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64

WIDTH, CELL, NUM_DOWN, MOST_EMPTY = 0.5, 0.25, 16, 4
"""
Width and height of the cells below a curve [m], how many of them make a column of the wall, and
how many of these may be empty.
Source: judgement: 4 m, more than most racks are high; scan lines on facades are 0.2 m apart, and
wires of a rack either fewer or farther.
"""
SHEET, ABOUT, LEAST_WITHIN = 0.3, 0.9, 0.6
"""
Points so far beside the plane of a curve at most are in its wall [m], and they are this share at
least of those that are so far beside it [m].
Source: derived: bays and the miss of a curve; of a hedge, a crown or a tower a third is within.
"""
LEAST_WALL = 0.25
"""
Share of a curve below which there is a wall, at least.
Source: measured: bench/frames.py: 0.44 on the facade of oakland_part3_aj; 0.12 at most below 800
conductors of nine real clouds, at their poles, but for one of 7 m in oakland_part3_ao: 0.93.
"""


class Walls:
    """Tells which curves lie on a wall, each of which is measured once."""

    def __init__(self, points: Float64, index: PlanIndex) -> None:
        """Take (N, 3) points [m] and their index."""
        self._points, self._index = points, index
        self._known: dict[Curve, bool] = {}

    def find(self, curves: Sequence[Curve]) -> Bool:
        """Tell of C curves, scan lines or conductors, which lie on a wall, (C,)."""
        fresh = [curve for curve in curves if curve not in self._known]
        shares = call_each(
            lambda k: _measure_wall(self._points, self._index.grid, fresh[k].row), len(fresh)
        )
        self._known.update(
            (curve, share >= LEAST_WALL) for curve, share in zip(fresh, shares, strict=True)
        )
        return np.array([self._known[curve] for curve in curves], dtype=np.bool_)


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_wall(points, grid, row):  # type: ignore[no-untyped-def]
    """Return the share of a row's curve below which columns of cells are filled in its plane."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, ABOUT,
    )
    num, opened = max(int((high - low) / WIDTH), 1), open_row(row)
    within, about = np.zeros((num, NUM_DOWN)), np.zeros(num)
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if x < low or x >= high or abs(y) > ABOUT:
            continue
        down = -see_above(opened, x, points[i, 2])[0]
        if row[TOLERANCE] <= down < NUM_DOWN * CELL:
            place = min(int((x - low) / (high - low) * num), num - 1)
            about[place] += 1.0
            if abs(y) <= SHEET:
                within[place, int(down / CELL)] += 1.0
    count = 0
    for place in range(num):
        filled, total = 0, 0.0
        for level in range(NUM_DOWN):
            filled += within[place, level] > 0.0
            total += within[place, level]
        count += filled >= NUM_DOWN - MOST_EMPTY and total >= LEAST_WITHIN * about[place]
    return count / num
