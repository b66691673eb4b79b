# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimates the ground below a cloud from the lowest point of each grid cell."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.core.ground.ground_fill import fill_all, fill_near, keep
from plc_inspect.core.ground.low_returns import drop_pits, drop_strays
from plc_inspect.results import Bool, Float32

AREAL_REACH = 7
"""
Cells from the middle to the edge of the square about a cell in which others must show ground.
Source: judgement; not measured.
"""
AREAL_SHARE = 0.2
"""Least share of ground cells in that square.  Source: judgement; not measured."""
SURE_SHARE, LEAST_RAISED = 0.55, 4.0
"""
Share of the square below which cells are no ground where they lie this far above sure ground [m],
or where there is none.
Source: derived: four wires side by side, aslant to the grid, fill 0.53 of the square; one return
a cell fills 0.63, and scan lines 1.5 m apart 0.67; of cells two by two in a square twice as wide,
one return in four cells as much, five wires 0.47; the least height of conductors.
"""
AREAL_LEAST = 0.5
"""
Share of that square that is taken to be available at least, at the edge of the grid.
Source: judgement; not measured.
"""
SEEN_BAND = 0.3
"""
Greatest height above the envelope of a lowest point that is ground [m].
Source: judgement; not measured.
"""
SEEN_SLOPE = 0.5
"""
Part of a cell's edge over which the steepest slope is added to SEEN_BAND.
Source: judgement; not measured.
"""
NUM_SWEEPS = 2
"""
Passes over the grid, forth and back, that compute the envelope.
Source: judgement; not measured.
"""

STEPS_MORE = 3
"""
Cells beyond those in which a slope rises half the way from the lowest to the highest cell.
Source: numerical: one for the part of a cell, the others for rounding.
"""


def estimate_ground(
    lowest: Float32, cell: float, max_slope: float
) -> tuple[Float32, Bool]:
    """
    Estimate the ground from the lowest point of each cell.

    Parameters
    ----------
    lowest : (rows, columns) float32
        Lowest point of each cell [m], NaN in empty ones.
    cell : float
        Edge of a cell [m].
    max_slope : float
        Steepest terrain, rise over run.

    Returns
    -------
    ground : (rows, columns) float32
        Height at the cell centres [m], filled in between; NaN where no ground is known at all.
    seen : (rows, columns) bool
        Cells in which ground was measured.

    """
    found = find_surface(lowest, cell, max_slope)
    seen = found.seen & is_low(
        found.surface, fill_near(keep(found.surface, found.dense)),
        fill_all(keep(found.surface, found.sure)),
    )
    return fill_near(keep(found.surface, seen)), seen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LowSurface:
    """The lowest points of cells, and which of them may be ground."""

    surface: Float32
    """(rows, columns) without stray ones [m], NaN where there is none."""
    seen: Bool
    """(rows, columns) it lies low, with others about it."""
    dense: Bool
    """(rows, columns) and so many of them that it is no row of wires."""
    sure: Bool
    """(rows, columns) the same, or as many, taken two by two, in a square twice as wide."""


def find_surface(lowest: Float32, cell: float, max_slope: float) -> LowSurface:
    """Find what may be ground among the lowest points of cells; see `estimate_ground`."""
    surface = drop_strays(drop_pits(lowest, cell), cell, max_slope)
    low = _find_seen(surface, cell, max_slope)
    dense = low & _is_areal(low, SURE_SHARE, 1.0)
    sure = dense | low & _join_pairs(low)
    return LowSurface(
        surface=surface, seen=sure | low & _is_areal(low, AREAL_SHARE), dense=dense, sure=sure
    )


def _join_pairs(low: Bool) -> Bool:
    """Tell the cells in squares filled as a surface fills them, two by two."""
    rows, columns = low.shape
    pairs = np.zeros((rows + rows % 2, columns + columns % 2), dtype=bool)
    pairs[:rows, :columns] = low
    pairs = pairs[::2, ::2] | pairs[1::2, ::2] | pairs[::2, 1::2] | pairs[1::2, 1::2]
    filled = _is_areal(pairs, SURE_SHARE, 1.0).repeat(2, axis=0).repeat(2, axis=1)
    result: Bool = filled[:rows, :columns]
    return result


def is_low(surface: Float32, dense: Float32, sure: Float32) -> Bool:
    """
    Tell what lies little above sure ground; a row of wires with none below it does not.

    All are (rows, columns) float32 [m]: the lowest points, and dense and sure ground, filled.
    Where ground is dense near, what is sparse shows none: it may be rows of wires in a gap of it.
    Elsewhere sure ground counts, however far away, as over a river.
    """
    result: Bool = surface - np.where(np.isnan(dense), sure, dense) < LEAST_RAISED
    return result


@njit(cache=True, nogil=True)
def _is_areal(seen, share, available_least=AREAL_LEAST):  # type: ignore[no-untyped-def]
    """
    Tell the cells that have seen cells on all sides from those in thin lines.

    The lowest points of wires with nothing seen below them are not ground.
    """
    rows, columns = seen.shape
    # count seen cells along each row, by a moving window
    along = np.empty((rows, columns), dtype=np.int32)
    for row in range(rows):
        count = 0
        for column in range(-AREAL_REACH, columns):
            if column + AREAL_REACH < columns:
                count += seen[row, column + AREAL_REACH]
            if column > AREAL_REACH:
                count -= seen[row, column - AREAL_REACH - 1]
            if column >= 0:
                along[row, column] = count
    # add the rows of the square up, and compare with the cells that the grid has there
    result = np.empty((rows, columns), dtype=np.bool_)
    least = np.float32((2 * AREAL_REACH + 1) ** 2 * available_least)
    for row in range(rows):
        first, last = max(row - AREAL_REACH, 0), min(row + AREAL_REACH, rows - 1)
        area = np.zeros(columns, dtype=np.int32)
        for other in range(first, last + 1):
            for column in range(columns):
                area[column] += along[other, column]
        for column in range(columns):
            wide = min(column + AREAL_REACH, columns - 1) - max(column - AREAL_REACH, 0) + 1
            available = np.float32(wide * (last - first + 1))
            needed = np.float32(share) * max(available, least)
            result[row, column] = np.float32(area[column]) >= needed
    return result


@njit(cache=True, nogil=True)
def _find_seen(surface, cell, max_slope):  # type: ignore[no-untyped-def]
    """Tell the cells that lie little above the lower envelope of a surface: they show ground."""
    rows, columns = surface.shape
    first, last = _limit_sweeps(surface, cell, max_slope)
    envelope = _lower_envelope(surface, cell, max_slope, first, last)
    band, slope = np.float32(SEEN_BAND), np.float32(SEEN_SLOPE * cell * max_slope)
    seen = np.zeros((rows, columns), dtype=np.bool_)
    for row in range(rows):
        for column in range(first[row], last[row]):
            seen[row, column] = surface[row, column] <= envelope[row, column] + band + slope
    return seen


@njit(cache=True, nogil=True)
def _limit_sweeps(surface, cell, max_slope):  # type: ignore[no-untyped-def]
    """
    Return the first cell of each row that matters to the envelope, and that behind the last.

    A slope that starts at the lowest cell is above the highest one ``steps`` cells away.  No
    longer way leads from one known cell to another, and all of it is near one of the two.
    """
    rows, columns = surface.shape
    begin, end = np.full(rows, columns), np.zeros(rows, dtype=np.int64)
    low, high = np.full(rows, np.inf), np.full(rows, -np.inf)
    for row in range(rows):
        for column in range(columns):
            z = surface[row, column]
            if not np.isnan(z):
                begin[row], end[row] = min(begin[row], column), column + 1
                low[row], high[row] = min(low[row], z), max(high[row], z)
    first, last = np.zeros(rows, dtype=np.int64), np.full(rows, columns)
    steps = (high.max() - low.min()) / (max_slope * cell)
    if not 0.0 <= steps < max(rows, columns):  # -inf where no cell is known
        return first, last
    reach = int(steps / 2) + STEPS_MORE
    for row in range(rows):
        near = slice(max(row - reach, 0), row + reach + 1)
        first[row] = max(begin[near].min() - reach, 0)
        last[row] = min(end[near].max() + reach, columns)
    return first, last


@njit(cache=True, nogil=True)
def _lower_envelope(surface, cell, max_slope, first, last):  # type: ignore[no-untyped-def]
    """
    Return the highest surface below the given one that is nowhere steeper than max_slope.

    Of each row only the cells from ``first`` to ``last`` are computed.
    """
    rows, columns = surface.shape
    result = np.full((rows, columns), np.inf, dtype=np.float32)
    straight = np.float32(max_slope * cell)
    diagonal = np.float32(max_slope * cell * np.sqrt(2.0))
    for row in range(rows):
        for column in range(first[row], last[row]):
            if not np.isnan(surface[row, column]):
                result[row, column] = surface[row, column]
    for _ in range(NUM_SWEEPS):
        # forth: from the neighbours before each cell
        for row in range(rows):
            for column in range(first[row], last[row]):
                value = result[row, column]
                if column > 0:
                    value = min(value, result[row, column - 1] + straight)
                if row > 0:
                    value = min(value, result[row - 1, column] + straight)
                    if column > 0:
                        value = min(value, result[row - 1, column - 1] + diagonal)
                    if column < columns - 1:
                        value = min(value, result[row - 1, column + 1] + diagonal)
                result[row, column] = value
        # back: from the neighbours behind it
        for row in range(rows - 1, -1, -1):
            for column in range(last[row] - 1, first[row] - 1, -1):
                value = result[row, column]
                if column < columns - 1:
                    value = min(value, result[row, column + 1] + straight)
                if row < rows - 1:
                    value = min(value, result[row + 1, column] + straight)
                    if column < columns - 1:
                        value = min(value, result[row + 1, column + 1] + diagonal)
                    if column > 0:
                        value = min(value, result[row + 1, column - 1] + diagonal)
                result[row, column] = value
    return result
