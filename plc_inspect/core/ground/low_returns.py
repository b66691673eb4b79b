# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Leaves out returns from below the ground among the lowest points of cells."""

from numba import njit
import numpy as np

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
Depth of a pit at least in cells of a metre, in wider ones as much more; and scatter of the pairs
about their median at most [m].
Source: derived: as labels.GROUND_BAND, and a hollow may be as wide as a cell; judgement: lowest
points of a meadow scatter by 0.05 m, those of a crown by 0.5 m and more.
"""
ALIKE_REACH = 7
"""
Cells to each side within which others are as deep.  Source: derived: as ground_filter.AREAL_REACH.
"""
PIT_ALIKE = 5
"""
Other pits within ALIKE_REACH that are as deep as one to PIT_ROUGH, at most.
Source: measured: bench/studies/pits.py; of returns as deep as they happen to be two are in 200
cells of which one in six has any, of the cells of a lane seven.
"""
PIT_ROUNDS = 2
"""
How often pits are looked for, as one may hide behind another.
Source: measured: bench/studies/pits.py.
"""


@njit(cache=True, nogil=True)
def drop_pits(lowest, cell):  # type: ignore[no-untyped-def]
    """
    Clear cells that lie in narrow pits of something smooth: returns from below the ground.

    Those are as deep as they happen to be, ground in gaps of a crop or of roofs as deep as other
    ground about it, which stays.

    Parameters
    ----------
    lowest : (rows, columns) float32
        Lowest point of each cell [m], NaN in empty ones.
    cell : float
        Edge of a cell [m].

    Returns
    -------
    (rows, columns) float32

    """
    depth, result = np.zeros(lowest.shape, dtype=np.float32), lowest.copy()
    for _ in range(PIT_ROUNDS):
        _find_pits(result, PIT_DEPTH * max(cell, 1.0), depth)
        _clear_pits(depth, result)
    return result


@njit(cache=True, nogil=True)
def _clear_pits(depth, result):  # type: ignore[no-untyped-def]
    """Clear the pits that few others are as deep as."""
    rows, columns = result.shape
    for row in range(rows):
        for column in range(columns):
            own = depth[row, column]
            if own == 0.0 or np.isnan(result[row, column]):
                continue
            alike = -1  # the cell itself
            right = min(column + ALIKE_REACH, columns - 1)
            for r in range(max(row - ALIKE_REACH, 0), min(row + ALIKE_REACH, rows - 1) + 1):
                for c in range(max(column - ALIKE_REACH, 0), right + 1):
                    alike += abs(depth[r, c] - own) <= PIT_ROUGH
            if alike <= PIT_ALIKE:
                result[row, column] = np.nan


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
def _find_pits(lowest, least, depth):  # type: ignore[no-untyped-def]
    """
    Set how deep cells lie in narrow pits of something smooth [m]; those that do not stay.

    Two cells on both sides of one, as far from it each, tell its height on any slope.  What is
    seen through a crown is none, as that is rough.
    """
    rows, columns = lowest.shape
    middle = np.empty((2 * PIT_REACH + 1) ** 2 // 2)
    rough = np.empty_like(middle)
    for row in range(PIT_REACH, rows - PIT_REACH):
        for column in range(PIT_REACH, columns - PIT_REACH):
            z = lowest[row, column]
            beside = lowest[row, column - 1] + lowest[row, column + 1]
            ahead = lowest[row - 1, column] + lowest[row + 1, column]
            if not (z < beside / 2 - least or z < ahead / 2 - least):
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
            if level - z >= least and _sort(rough, num)[num // 2] <= PIT_ROUGH:
                depth[row, column] = level - z


@njit(cache=True, nogil=True)
def drop_strays(lowest, cell, max_slope):  # type: ignore[no-untyped-def]
    """
    Clear cells without company as low within STRAY_REACH: multipath returns and noise.

    One beside the cloud, with nothing about it, would hide the ground as far away as it is deep.

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
    (rows, columns) float32

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
