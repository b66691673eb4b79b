# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Fills the cells of the ground in which nothing was seen from those near them."""

from numba import njit
import numpy as np

from plc_inspect.core.ground.ground_grid import FINE
from plc_inspect.results import Bool, Float32

LEVELS = FINE.bit_length() - 1
"""Of the pyramid, from cells to squares of FINE.  Source: derived: log2 FINE."""
BESIDE = np.array([[1.0, 2.0, 1.0], [2.0, 0.0, 2.0], [1.0, 2.0, 1.0]])
"""Weights of the squares beside one.  Source: numerical: those of linear interpolation."""
WIDER = 2
"""
Ground is known in squares of FINE less than WIDER from those in which it was seen.
Source: judgement: what is seen farther away says little of a slope's height, and a part of a cloud
must tell as the whole does.
"""


def keep(surface: Float32, chosen: Bool) -> Float32:
    """Return a (rows, columns) surface [m], NaN in the cells that are not chosen."""
    return np.where(chosen, surface, np.float32(np.nan))


def fill_near(values: Float32) -> Float32:
    """Fill NaN of (rows, columns) cells [m] from known ones near, WIDER; the others stay NaN."""
    means = _list_means(values)
    return _fill_up(means, widen(means[-1]))


def fill_all(values: Float32) -> Float32:
    """Fill NaN of (rows, columns) cells [m] from known ones, however far; a grid of NaN stays."""
    means = _list_means(values)
    return _fill_up(means, widen_all(means[-1]))


def widen(base: Float32) -> Float32:
    """
    Fill NaN squares up to WIDER from known ones with the means of those beside them.

    Squares of FINE, (rows, columns) float32 [m], as `shrink` returns them.
    """
    rows, columns = base.shape
    for _ in range(WIDER):
        padded = np.pad(base, 1, constant_values=np.nan)
        total, weight = np.zeros(base.shape), np.zeros(base.shape)
        for row, column in np.ndindex(BESIDE.shape):
            part = padded[row : row + rows, column : column + columns]
            total += BESIDE[row, column] * np.nan_to_num(part)
            weight += BESIDE[row, column] * np.isfinite(part)
        mean = np.divide(total, weight, out=np.full(base.shape, np.nan), where=weight > 0.0)
        base = np.where(np.isnan(base), mean.astype(np.float32), base)
    return base


def widen_all(base: Float32) -> Float32:
    """Fill NaN squares as `widen`, and those that it leaves from a pyramid of means."""
    return _fill_all(widen(base))


def _fill_all(base: Float32) -> Float32:
    if max(base.shape) == 1 or not np.isnan(base).any():
        return base
    result: Float32 = _fill_from(base, _fill_all(_shrink(base)))
    return result


def fill(values: Float32, base: Float32) -> Float32:
    """
    Fill NaN cells from a pyramid of means.

    Parameters
    ----------
    values : (rows, columns) float32
        [m]
    base : (rows, columns) float32
        Means of squares of FINE, widened; NaN where cells shall stay so [m].

    Returns
    -------
    (rows, columns) float32

    """
    return _fill_up(_list_means(values), base)


def shrink(values: Float32) -> Float32:
    """Return means of known cells, (rows, columns) float32 [m], in squares of FINE."""
    return _list_means(values)[-1]


def _list_means(values: Float32) -> list[Float32]:
    """Return cells and the means of the known ones of 2 x 2, 4 x 4, up to squares of FINE."""
    means = [values]
    for _ in range(LEVELS):
        means.append(_shrink(means[-1]))
    return means


def _fill_up(means: list[Float32], base: Float32) -> Float32:
    """Fill NaN of the first of these grids from those of larger cells, and at last the base."""
    result = np.where(np.isnan(means[-1]), base, means[-1])
    for finer in means[-2::-1]:
        result = _fill_from(finer, result)
    return result


@njit(cache=True, nogil=True)
def _shrink(values):  # type: ignore[no-untyped-def]
    """Return the mean of the known cells of each 2 x 2, NaN where none is known."""
    rows, columns = values.shape
    result = np.empty(((rows + 1) // 2, (columns + 1) // 2), dtype=np.float32)
    for row in range(result.shape[0]):
        for column in range(result.shape[1]):
            total, count = 0.0, 0
            for r in range(2 * row, min(2 * row + 2, rows)):
                for c in range(2 * column, min(2 * column + 2, columns)):
                    if np.isfinite(values[r, c]):
                        total += values[r, c]
                        count += 1
            result[row, column] = total / count if count else np.nan
    return result


@njit(cache=True, nogil=True)
def _fill_from(values, coarse):  # type: ignore[no-untyped-def]
    """Fill cells that are not finite, bilinearly, from a grid of twice the cell size."""
    rows, columns = values.shape
    last_row, last_column = coarse.shape[0] - 1, coarse.shape[1] - 1
    result = np.empty((rows, columns), dtype=np.float32)
    near, far = np.float32(0.75), np.float32(0.25)
    for row in range(rows):
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
