# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Estimates the ground below a cloud from the lowest point of each grid cell."""

from dataclasses import dataclass

from numba import njit, prange
import numpy as np

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
Share below which cells are no ground where they lie this far above the ground about them [m], or
where no whole square of the grid has as much.
Source: derived: four wires side by side, aslant to the grid, fill 0.53 of the square; one return
a square metre fills 0.63, and scan lines 1.5 m apart 0.67; the least height of conductors.
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
    seen = found.seen & found.is_any
    if found.sure.any() and (seen & ~found.sure).any():
        seen &= found.sure | ~is_raised(found.surface, fill(keep(found.surface, found.sure)))
    return fill(keep(found.surface, seen)), seen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LowSurface:
    """The lowest points of cells, and which of them may be ground."""

    surface: Float32
    """(rows, columns) without stray ones [m], NaN where there is none."""
    seen: Bool
    """(rows, columns) it lies low, with others about it."""
    sure: Bool
    """(rows, columns) and so many of them that it is no row of wires, if any are."""
    is_any: bool
    """Some square within the grid is filled as a surface fills it; else nothing is ground."""


def find_surface(lowest: Float32, cell: float, max_slope: float) -> LowSurface:
    """Find what may be ground among the lowest points of cells; see `estimate_ground`."""
    surface = _drop_stray_lows(lowest, cell, max_slope)
    low = _find_seen(surface, cell, max_slope)
    return LowSurface(
        surface=surface,
        seen=_is_areal(low, AREAL_SHARE) & low,
        sure=_is_areal(low, SURE_SHARE) & low,
        is_any=bool((_is_areal(low, SURE_SHARE, 1.0) & low).any()),
    )


def keep(surface: Float32, chosen: Bool) -> Float32:
    """Return a surface without the cells that are not chosen."""
    return np.where(chosen, surface, np.float32(np.nan))


def is_raised(surface: Float32, sure: Float32) -> Bool:
    """Tell what lies far above sure ground: if it is thin, a row of wires with none seen below."""
    result: Bool = ~(surface - sure < LEAST_RAISED)
    return result


def fill(values: Float32, levels: int = -1, base: Float32 | None = None) -> Float32:
    """
    Fill NaN cells from a pyramid of means; a grid of NaN stays one.

    Parameters
    ----------
    values : (rows, columns) float32
        [m]
    levels : int
        Of the pyramid, each of cells twice as large; -1 all.
    base : (rows, columns) float32 or None
        Values of that level's cells, filled, where the grid is a part of one [m].

    Returns
    -------
    (rows, columns) float32

    """
    if levels == 0 and base is not None:
        return np.where(np.isnan(values), base, values)
    if base is None and (max(values.shape) == 1 or not np.isnan(values).any()):
        return values
    result: Float32 = _fill_from(values, fill(_shrink(values), levels - 1, base))
    return result


def shrink(values: Float32, levels: int) -> Float32:
    """Return the means of known values in cells that are twice as large, so many times."""
    for _ in range(levels):
        values = _shrink(values)
    return values


@njit(cache=True, parallel=True, nogil=True)
def _is_areal(seen, share, available_least=AREAL_LEAST):  # type: ignore[no-untyped-def]
    """
    Tell the cells that have seen cells on all sides from those in thin lines.

    The lowest points of wires with nothing seen below them are not ground.
    """
    rows, columns = seen.shape
    # count seen cells along each row, by a moving window
    along = np.empty((rows, columns), dtype=np.int32)
    for row in prange(rows):
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
    for row in prange(rows):
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


@njit(cache=True, parallel=True, nogil=True)
def _shrink(values):  # type: ignore[no-untyped-def]
    """Return the mean of the known cells of each 2 x 2, NaN where none is known."""
    rows, columns = values.shape
    result = np.empty(((rows + 1) // 2, (columns + 1) // 2), dtype=np.float32)
    for row in prange(result.shape[0]):
        for column in range(result.shape[1]):
            total, count = 0.0, 0
            for r in range(2 * row, min(2 * row + 2, rows)):
                for c in range(2 * column, min(2 * column + 2, columns)):
                    if np.isfinite(values[r, c]):
                        total += values[r, c]
                        count += 1
            result[row, column] = total / count if count else np.nan
    return result


@njit(cache=True, parallel=True, nogil=True)
def _fill_from(values, coarse):  # type: ignore[no-untyped-def]
    """Fill cells that are not finite, bilinearly, from a grid of twice the cell size."""
    rows, columns = values.shape
    last_row, last_column = coarse.shape[0] - 1, coarse.shape[1] - 1
    result = np.empty((rows, columns), dtype=np.float32)
    near, far = np.float32(0.75), np.float32(0.25)
    for row in prange(rows):
        y = min(max((row - 0.5) / 2, 0.0), float(last_row))
        r0 = min(int(y), max(last_row - 1, 0))
        up = np.float32(y - r0)
        low, high = coarse[r0], coarse[min(r0 + 1, last_row)]
        own, filled = values[row], result[row]
        # two columns between each pair of coarse cells, in loops that become vector instructions
        for k in range(last_column):
            filled[2 * k + 1] = _choose(
                own[2 * k + 1], low[k], low[k + 1], high[k], high[k + 1], near, far, up
            )
        for k in range(last_column):
            filled[2 * k + 2] = _choose(
                own[2 * k + 2], low[k], low[k + 1], high[k], high[k + 1], far, near, up
            )
        # those at the edges
        for column in range(columns):
            if 0 < column <= 2 * last_column:
                continue
            x = min(max((column - 0.5) / 2, 0.0), float(last_column))
            c0 = min(int(x), max(last_column - 1, 0))
            c1 = min(c0 + 1, last_column)
            right = np.float32(x - c0)
            filled[column] = _choose(
                own[column], low[c0], low[c1], high[c0], high[c1],
                np.float32(1.0) - right, right, up,
            )
    return result


@njit(cache=True, nogil=True, inline='always')
def _choose(value, z00, z01, z10, z11, left, right, up):  # type: ignore[no-untyped-def]
    """Return a value, or the mean of four others by their weights where it is not finite."""
    mean = (z00 * left + z01 * right) * (np.float32(1.0) - up) + (z10 * left + z11 * right) * up
    return value if np.isfinite(value) else mean


@njit(cache=True, parallel=True, nogil=True)
def _drop_stray_lows(lowest, cell, max_slope):  # type: ignore[no-untyped-def]
    """
    Clear cells without company as low within STRAY_REACH: multipath returns and noise.

    One beside the cloud, with nothing about it, would hide the ground as far away as it is deep.
    """
    reach = max(LEAST_STRAY_REACH, int(np.ceil(STRAY_REACH / cell)))
    rows, columns = lowest.shape
    result = lowest.copy()
    for row in prange(rows):
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


@njit(cache=True, parallel=True, nogil=True)
def _find_seen(surface, cell, max_slope):  # type: ignore[no-untyped-def]
    """Tell the cells that lie little above the lower envelope of a surface: they show ground."""
    rows, columns = surface.shape
    first, last = _limit_sweeps(surface, cell, max_slope)
    envelope = _lower_envelope(surface, cell, max_slope, first, last)
    band, slope = np.float32(SEEN_BAND), np.float32(SEEN_SLOPE * cell * max_slope)
    seen = np.zeros((rows, columns), dtype=np.bool_)
    for row in prange(rows):
        for column in range(first[row], last[row]):
            seen[row, column] = surface[row, column] <= envelope[row, column] + band + slope
    return seen


@njit(cache=True, parallel=True, nogil=True)
def _limit_sweeps(surface, cell, max_slope):  # type: ignore[no-untyped-def]
    """
    Return the first cell of each row that matters to the envelope, and that behind the last.

    A slope that starts at the lowest cell is above the highest one ``steps`` cells away.  No
    longer way leads from one known cell to another, and all of it is near one of the two.
    """
    rows, columns = surface.shape
    begin, end = np.full(rows, columns), np.zeros(rows, dtype=np.int64)
    low, high = np.full(rows, np.inf), np.full(rows, -np.inf)
    for row in prange(rows):
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
    for row in prange(rows):
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
