# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimates the ground below a cloud from the lowest point of each grid cell."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.core.ground.ground_fill import fill_all, fill_near, keep
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
STRAY_REACH = 8.0
"""
Distance within which a lowest point is compared with others [m].
Source: judgement; not measured.
"""
LEAST_STRAY_REACH = 2
"""Least value of STRAY_REACH in cells.  Source: judgement; not measured."""
STRAY_DEPTH = 1.0
"""Least depth of a stray low point below others [m].  Source: judgement; not measured."""
STRAY_SLOPE = 0.5
"""
Growth of STRAY_DEPTH with distance, as a share of the steepest slope.
Source: judgement; not measured.
"""
LEAST_COMPANY = 4
"""
Least number of cells nearly as low that show a low point to be no stray.
Source: judgement; not measured.
"""
PIT_REACH = 2
"""Cells to each side that show whether one lies in a pit.  Source: judgement: 2 m."""
PIT_PAIRS = 6
"""Pairs of cells on both sides of one that tell of a pit.  Source: judgement: half of them."""
PIT_DEPTH, PIT_ROUGH = 0.5, 0.15
"""
Depth of a pit at least, and scatter of the pairs about their median at most [m].
Source: derived: as labels.GROUND_BAND; judgement: lowest points of a meadow scatter by 0.05 m,
those of a crown by 0.5 m and more.
"""
PIT_COMPANY, PIT_ROUNDS = 3, 4
"""
Cells about a pit that are as low, or half as low as it is deep, at most; and how often pits are
looked for, as one may hide behind another.
Source: derived: a lane of one cell between two roofs has four.
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
    surface = _drop_stray_lows(_drop_pits(lowest), cell, max_slope)
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
def _drop_pits(lowest):  # type: ignore[no-untyped-def]
    """
    Clear cells that lie in narrow pits of something smooth: returns from below the ground.

    Two cells on both sides of one, as far from it each, tell its height on any slope.  What is
    seen through a crown stays, as that is rough, and so does what more cells show.
    """
    before, result = lowest, lowest.copy()
    for _ in range(PIT_ROUNDS):
        if not _clear_pits(before, result):
            break
        before = result.copy()
    return result


@njit(cache=True, nogil=True)
def _sort(values, num):  # type: ignore[no-untyped-def]
    """Sort the first few values, in place; so few are sorted fastest one by one."""
    for k in range(1, num):
        value, place = values[k], k
        while place > 0 and values[place - 1] > value:
            values[place] = values[place - 1]
            place -= 1
        values[place] = value
    return values


@njit(cache=True, nogil=True)
def _clear_pits(lowest, result):  # type: ignore[no-untyped-def]
    """Clear the pits of one round; tell whether there were any."""
    rows, columns = lowest.shape
    middle, found = np.empty((2 * PIT_REACH + 1) ** 2 // 2), False
    rough = np.empty_like(middle)
    for row in range(PIT_REACH, rows - PIT_REACH):
        for column in range(PIT_REACH, columns - PIT_REACH):
            z = lowest[row, column]
            beside = lowest[row, column - 1] + lowest[row, column + 1]
            ahead = lowest[row - 1, column] + lowest[row + 1, column]
            if not (z < beside / 2 - PIT_DEPTH or z < ahead / 2 - PIT_DEPTH):
                continue
            num = 0
            for dr in range(PIT_REACH + 1):
                for dc in range(-PIT_REACH, PIT_REACH + 1):
                    pair = (lowest[row + dr, column + dc] + lowest[row - dr, column - dc]) / 2
                    if (dr > 0 or dc > 0) and not np.isnan(pair):
                        middle[num] = pair
                        num += 1
            if num < PIT_PAIRS:
                continue
            level = _sort(middle, num)[num // 2]
            for k in range(num):
                rough[k] = abs(middle[k] - level)
            if level - z < PIT_DEPTH or _sort(rough, num)[num // 2] > PIT_ROUGH:
                continue
            company = -1  # the cell itself
            for r in range(row - PIT_REACH, row + PIT_REACH + 1):
                for c in range(column - PIT_REACH, column + PIT_REACH + 1):
                    company += lowest[r, c] < (z + level) / 2
            if company <= PIT_COMPANY:
                result[row, column] = np.nan
                found = True
    return found


@njit(cache=True, nogil=True)
def _drop_stray_lows(lowest, cell, max_slope):  # type: ignore[no-untyped-def]
    """
    Clear cells without company as low within STRAY_REACH: multipath returns and noise.

    One beside the cloud, with nothing about it, would hide the ground as far away as it is deep.
    """
    reach = max(LEAST_STRAY_REACH, int(np.ceil(STRAY_REACH / cell)))
    rows, columns = lowest.shape
    result = lowest.copy()
    for row in range(rows):
        for column in range(columns):
            z = lowest[row, column]
            if np.isnan(z):
                continue
            # count the cells that are about as low
            supported = 0
            for dr in range(-reach, reach + 1):
                r = row + dr
                if r < 0 or r >= rows:
                    continue
                for dc in range(-reach, reach + 1):
                    c = column + dc
                    if c < 0 or c >= columns or (dr == 0 and dc == 0):
                        continue
                    other = lowest[r, c]
                    if np.isnan(other):
                        continue
                    away = np.sqrt(dr * dr + dc * dc)
                    if other < z + STRAY_DEPTH + max_slope * cell * away * STRAY_SLOPE:
                        supported += 1
                        if supported >= LEAST_COMPANY:
                            break
                if supported >= LEAST_COMPANY:
                    break
            if supported < LEAST_COMPANY:
                result[row, column] = np.nan
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
