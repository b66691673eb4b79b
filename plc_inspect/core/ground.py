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

"""The ground surface under a cloud, from the lowest points of a grid."""

from numba import njit, prange
import numpy as np
from scipy.ndimage import distance_transform_edt

from plc_inspect.results import Bool, Float32, Float64


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
    surface = _drop_stray_lows(lowest, cell, max_slope)
    envelope = _lower_envelope(surface, cell, max_slope)
    seen = np.isfinite(surface) & (surface <= envelope + 0.3 + 0.5 * cell * max_slope)
    seen &= _is_areal(seen)
    return _fill(np.where(seen, surface, np.float32(np.nan))), seen


def measure_gap(seen: Bool, cell: float) -> Float32:
    """Return the distance of each cell to the nearest one that was seen [m]; inf without any."""
    if not seen.any():
        return np.full(seen.shape, np.inf, dtype=np.float32)
    gap: Float32 = (distance_transform_edt(~seen) * cell).astype(np.float32)
    return gap


def _is_areal(seen: Bool) -> Bool:
    """
    Tell cells that have seen cells on all sides of them from those in thin lines.

    A wire-only cloud has lowest points too, but they are no ground.
    """
    reach = 7
    area = _box_sum(seen.astype(np.float32), reach)
    rows, columns = seen.shape
    available = _box_sum(np.ones((rows, columns), dtype=np.float32), reach)
    result: Bool = area >= 0.2 * np.maximum(available, (2 * reach + 1) ** 2 / 2)
    return result


def _box_sum(values: Float32, reach: int) -> Float32:
    """Sum over the (2 reach + 1)^2 cells about each cell."""
    result = values.astype(np.float64)
    for axis in (0, 1):
        total = np.cumsum(result, axis=axis)
        padding = [(0, 0), (0, 0)]
        padding[axis] = (reach + 1, reach)
        total = np.pad(total, padding, mode='edge')
        lead = [slice(None), slice(None)]
        lead[axis] = slice(0, reach + 1)
        total[tuple(lead)] = 0.0
        size = result.shape[axis]
        upper = [slice(None), slice(None)]
        upper[axis] = slice(2 * reach + 1, 2 * reach + 1 + size)
        lower = [slice(None), slice(None)]
        lower[axis] = slice(0, size)
        result = total[tuple(upper)] - total[tuple(lower)]
    return result.astype(np.float32)


def _fill(values: Float32) -> Float32:
    """Fill NaN cells from a pyramid of means; all NaN stays NaN."""
    if not np.isnan(values).any():
        return values
    if max(values.shape) == 1:
        return values
    rows, columns = values.shape
    padded = np.pad(values, ((0, rows % 2), (0, columns % 2)), constant_values=np.nan)
    quads = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2)
    known = np.isfinite(quads)
    count = known.sum(axis=(1, 3))
    total = np.where(known, quads, 0.0).sum(axis=(1, 3), dtype=np.float64)
    coarse = np.full(count.shape, np.nan, dtype=np.float32)
    np.divide(total, count, out=coarse, where=count > 0, casting='unsafe')
    coarse = _fill(coarse)
    row = np.clip((np.arange(rows) - 0.5) / 2, 0, coarse.shape[0] - 1)
    column = np.clip((np.arange(columns) - 0.5) / 2, 0, coarse.shape[1] - 1)
    fine = _bilinear(coarse, row, column)
    return np.where(np.isfinite(values), values, fine)


def _bilinear(grid: Float32, row: Float64, column: Float64) -> Float32:
    """Grid values at fractional rows and columns (outer product of both)."""
    r0 = np.minimum(row.astype(np.int64), max(grid.shape[0] - 2, 0))
    c0 = np.minimum(column.astype(np.int64), max(grid.shape[1] - 2, 0))
    r1 = np.minimum(r0 + 1, grid.shape[0] - 1)
    c1 = np.minimum(c0 + 1, grid.shape[1] - 1)
    fr = (row - r0).astype(np.float32)[:, None]
    fc = (column - c0).astype(np.float32)[None, :]
    upper = grid[np.ix_(r0, c0)] * (1 - fc) + grid[np.ix_(r0, c1)] * fc
    lower = grid[np.ix_(r1, c0)] * (1 - fc) + grid[np.ix_(r1, c1)] * fc
    return (upper * (1 - fr) + lower * fr).astype(np.float32)


@njit(cache=True, parallel=True, nogil=True)
def _drop_stray_lows(lowest, cell, max_slope):  # type: ignore[no-untyped-def]
    """Clear cells that lie far below everything within 8 m: multiple returns, noise."""
    reach = max(2, int(np.ceil(8.0 / cell)))
    rows, columns = lowest.shape
    result = lowest.copy()
    for row in prange(rows):
        for column in range(columns):
            z = lowest[row, column]
            if np.isnan(z):
                continue
            supported = 0
            others = 0
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
                    others += 1
                    if other < z + 1.0 + max_slope * cell * np.sqrt(dr * dr + dc * dc) * 0.5:
                        supported += 1
                        if supported >= 4:
                            break
                if supported >= 4:
                    break
            if supported < 4 and others >= 20:
                result[row, column] = np.nan
    return result


@njit(cache=True, nogil=True)
def _lower_envelope(surface, cell, max_slope):  # type: ignore[no-untyped-def]
    """Greatest surface under the given one that is nowhere steeper than max_slope."""
    rows, columns = surface.shape
    result = np.where(np.isnan(surface), np.float32(np.inf), surface)
    straight = np.float32(max_slope * cell)
    diagonal = np.float32(max_slope * cell * np.sqrt(2.0))
    for _ in range(2):
        for row in range(rows):
            for column in range(columns):
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
        for row in range(rows - 1, -1, -1):
            for column in range(columns - 1, -1, -1):
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
