# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground surface of a cloud, and the heights of its points above it."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import HeightSettings
from plc_inspect.core.extraction.ground_filter import estimate_ground
from plc_inspect.core.numerics.plan_index import clamp
from plc_inspect.results import Bool, Float32, Float64

MAX_CELLS = 16_000_000
"""
Greatest number of cells of the ground grid; a larger area gets larger cells.
Source: numerical: the grid, float32, takes 64 MB.
"""
MOST_PART_CELLS = 80_000_000
"""
Greatest number of cells of the grid of a part of a cloud, whose cells must be those of the whole.
Source: derived: a tile of 1800 m with halos of 2000 m, turned by any angle; few are as large.
"""
STRETCH = 2048
"""
Points whose heights are computed together.
Source: numerical: what they need stays in the cache; time alone depends on it.
"""
EDGE = 20.0
"""
Margin of the grid about a part of a cloud, unless the whole ends there [m].
Source: derived: more than AREAL_REACH cells, as the edge of the grid influences the ground.
"""
BLOCK_CELLS = 64
"""
The grid of a part begins at a multiple of this many cells of the whole.
Source: derived: a power of two, so that gaps of 64 cells are filled from the same means.
"""
LANES = 16
"""
Extremes that are kept side by side, so that no comparison waits for the one before.
Source: numerical: time alone depends on it.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """The ground below N points and their heights above it, before any threshold."""

    height: Float32
    """(N,) height above local ground [m]; NaN where no ground is known or not finite."""
    extremes: Float32
    """(2,) least and greatest height [m]; inf and -inf where no ground is known anywhere."""
    num_finite: int
    ground: Float32
    """(rows, columns) see HeightResult, as are the others."""
    ground_seen: Bool
    origin: Float64
    cell_size: float


def measure_surface(
    points: Float64,
    settings: HeightSettings,
    airborne: Bool | None = None,
    region: Float64 | None = None,
) -> Surface:
    """
    Estimate the ground, and the heights of all points above it.

    Only ``cell_size`` and ``max_slope_deg`` of the settings are used.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    settings : HeightSettings
        Settings of this stage.
    airborne : (N,) bool or None
        Points that cannot be ground.
    region : (2, 3) float64 or None
        Least and greatest x, y and z of the whole cloud, of which these points are a part [m].
        The cells then lie as those of the whole do, however large it is, and heights are rounded
        alike: a point at a full metre, on which a stage decides, is not above it here and below
        it there.

    Returns
    -------
    Surface

    """
    # without a finite point there is no ground
    low, high, num_finite = bounds(points)
    if num_finite == 0:
        return Surface(
            height=np.full(len(points), np.nan, dtype=np.float32),
            extremes=np.array([np.inf, -np.inf], dtype=np.float32),
            num_finite=0,
            ground=np.full((1, 1), np.nan, dtype=np.float32),
            ground_seen=np.zeros((1, 1), dtype=bool),
            origin=np.zeros(2),
            cell_size=settings.cell_size,
        )
    # lay the cells
    if region is None:
        low[:2] = np.floor(low[:2] / settings.cell_size) * settings.cell_size
    else:
        _lay_out(low, high, region, settings.cell_size)
    extent = high[:2] - low[:2]
    most = MAX_CELLS if region is None else MOST_PART_CELLS
    cell = max(settings.cell_size, math.sqrt(float(extent[0] * extent[1]) / most))
    per_cell = 1.0 / cell  # as the kernel multiplies by it, no point lies beyond the grid
    shape = (int(extent[1] * per_cell) + 1, int(extent[0] * per_cell) + 1)
    # estimate the ground from the lowest points, and measure heights above it
    solid = points if airborne is None else points[~airborne]
    lowest = _lowest_points(solid, low, per_cell, shape[0], shape[1])
    ground, seen = estimate_ground(lowest, cell, math.tan(math.radians(settings.max_slope_deg)))
    height = np.empty(len(points), dtype=np.float32)
    extremes = _heights(points, ground, low, cell, height)
    return Surface(
        height=height,
        extremes=extremes,
        num_finite=num_finite,
        ground=ground,
        ground_seen=seen,
        origin=low[:2],
        cell_size=cell,
    )


def _lay_out(low: Float64, high: Float64, region: Float64, cell: float) -> None:
    """Widen the bounds of a part so that its cells and blocks coincide with those of the whole."""
    first = np.floor(region[0, :2] / cell) * cell
    size = BLOCK_CELLS * cell
    blocks, own = np.floor((low[:2] - EDGE - first) / size), np.floor((low[:2] - first) / size)
    # points that came after the whole was measured may lie before its first cell
    low[:2] = first + np.maximum(blocks, np.minimum(own, 0.0)) * size
    low[2] = region[0, 2]
    high[:2] = np.minimum(
        np.maximum(high[:2] + EDGE, low[:2]), np.maximum(region[1, :2], high[:2])
    )


@njit(cache=True, nogil=True, inline='always')
def _are_finite(x, y, z):  # type: ignore[no-untyped-def]
    return 0.0 * x + 0.0 * y + 0.0 * z == 0.0  # NaN and infinity times 0 are NaN


@njit(cache=True, parallel=True, nogil=True)
def bounds(points):  # type: ignore[no-untyped-def]
    """
    Return the least and greatest finite coordinates and the number of finite points.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].

    Returns
    -------
    low, high : (3,) float64; inf and -inf without finite points
    num_finite : int

    """
    num_parts = 8
    low = np.full((num_parts, 3), np.inf)
    high = np.full((num_parts, 3), -np.inf)
    count = np.zeros(num_parts, dtype=np.int64)
    num = len(points)
    for part in prange(num_parts):
        # local variables stay in registers, which halves the time
        x0 = y0 = z0 = np.inf
        x1 = y1 = z1 = -np.inf
        finite = 0
        for i in range(part * num // num_parts, (part + 1) * num // num_parts):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            if not _are_finite(x, y, z):
                continue
            finite += 1
            x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
            x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
        low[part, 0], low[part, 1], low[part, 2] = x0, y0, z0
        high[part, 0], high[part, 1], high[part, 2] = x1, y1, z1
        count[part] = finite
    for part in range(1, num_parts):
        for k in range(3):
            low[0, k] = min(low[0, k], low[part, k])
            high[0, k] = max(high[0, k], high[part, k])
    return low[0].copy(), high[0].copy(), count.sum()


# The compiler turns loops into vector instructions if they have no branches, few enough arrays to
# check for overlap, and a known stride from point to point, hence ``ravel``.
@njit(cache=True, nogil=True)
def _find_cells(points, low, per_cell, rows, columns, at, z):  # type: ignore[no-untyped-def]
    """Set the cell of each point, and its z above ``low``, NaN if it is not finite."""
    flat, x0, y0, z0 = points.ravel(), low[0], low[1], low[2]
    most_x, most_y, wide = columns - 1.0, rows - 1.0, np.uint32(columns)
    for k in range(len(points)):
        x, y = (flat[3 * k] - x0) * per_cell, (flat[3 * k + 1] - y0) * per_cell
        flaw = 0.0 * x + 0.0 * y + 0.0 * flat[3 * k + 2]  # NaN and infinity times 0 are NaN
        x, y = clamp(x, most_x), clamp(y, most_y)
        at[k] = np.uint32(np.int32(y)) * wide + np.uint32(np.int32(x))
        z[k] = flat[3 * k + 2] - z0 + flaw


@njit(cache=True, parallel=True, nogil=True)
def _lowest_points(points, low, per_cell, rows, columns):  # type: ignore[no-untyped-def]
    num_parts = 2
    grids = np.full((num_parts, rows * columns), np.inf, dtype=np.float32)
    num = len(points)
    for part in prange(num_parts):
        grid = grids[part]
        begin, end = part * num // num_parts, (part + 1) * num // num_parts
        size = min(STRETCH, end - begin)
        at, z = np.empty(size, dtype=np.uint32), np.empty(size)
        for first in range(begin, end, STRETCH):
            own = points[first : min(first + STRETCH, end)]
            _find_cells(own, low, per_cell, rows, columns, at, z)
            for k in range(len(own)):
                if z[k] < grid[at[k]]:
                    grid[at[k]] = z[k]
    lowest = np.empty((rows, columns), dtype=np.float32)
    for row in prange(rows):
        for column in range(columns):
            value = min(grids[0, row * columns + column], grids[1, row * columns + column])
            lowest[row, column] = value + low[2] if np.isfinite(value) else np.nan
    return lowest


@njit(cache=True, parallel=True, nogil=True)
def _heights(points, ground, low, cell, height):  # type: ignore[no-untyped-def]
    """
    Set the height of each point above the ground; return the least and the greatest.

    The ground is bilinear between cell centres.
    """
    num_parts = 8
    num = len(points)
    least = np.full((num_parts, LANES), np.inf, dtype=np.float32)
    most = np.full((num_parts, LANES), -np.inf, dtype=np.float32)
    rows, columns = ground.shape
    # repeat the last row and column, so that all cells have neighbours
    padded = np.empty((rows + 1, columns + 1), dtype=ground.dtype)
    padded[:rows, :columns] = ground
    padded[rows, :columns] = ground[rows - 1]
    padded[:, columns] = padded[:, columns - 1]
    for part in prange(num_parts):
        begin, end = part * num // num_parts, (part + 1) * num // num_parts
        size = min(STRETCH, end - begin)
        at, right, up = np.empty(size, dtype=np.uint32), np.empty(size), np.empty(size)
        z, g00, g01 = np.empty(size), np.empty(size, ground.dtype), np.empty(size, ground.dtype)
        g10, g11 = np.empty(size, ground.dtype), np.empty(size, ground.dtype)
        for first in range(begin, end, STRETCH):
            last = min(first + STRETCH, end)
            own = points[first:last]
            _locate(own, low, cell, rows, columns, at, right, up)
            _pick_corners(own, padded, at, z, g00, g01, g10, g11)
            _interpolate(right, up, z, g00, g01, g10, g11, height[first:last])
            _widen(height[first:last], least[part], most[part])
    result = np.empty(2, dtype=np.float32)
    result[0] = least.min()
    result[1] = most.max()
    return result


@njit(cache=True, nogil=True)
def _locate(points, low, cell, rows, columns, at, right, up):  # type: ignore[no-untyped-def]
    """
    Set the cell centre to the lower left of each point, and the distance of the point from it.

    Distances are in cells, NaN where the point is not finite; cells are those of the padded grid.
    """
    flat, per_cell, wide = points.ravel(), 1.0 / cell, np.uint32(columns + 1)
    x0, y0, most_x, most_y = low[0], low[1], columns - 1.0, rows - 1.0
    for k in range(len(points)):
        x, y = (flat[3 * k] - x0) * per_cell - 0.5, (flat[3 * k + 1] - y0) * per_cell - 0.5
        flaw = 0.0 * x + 0.0 * y + 0.0 * flat[3 * k + 2]  # NaN and infinity times 0 are NaN
        x, y = clamp(x, most_x), clamp(y, most_y)
        column, row = np.int32(x), np.int32(y)
        at[k] = np.uint32(row) * wide + np.uint32(column)
        right[k] = x - column + flaw
        up[k] = y - row


@njit(cache=True, nogil=True)
def _pick_corners(points, padded, at, z, g00, g01, g10, g11):  # type: ignore[no-untyped-def]
    """Set z of each point, and the ground at the four cell centres about it."""
    flat, one, wide = padded.ravel(), np.uint32(1), np.uint32(padded.shape[1])
    for k in range(len(points)):
        here = at[k]
        g00[k], g01[k] = flat[here], flat[here + one]
        g10[k], g11[k] = flat[here + wide], flat[here + wide + one]
        z[k] = points[k, 2]


@njit(cache=True, nogil=True)
def _interpolate(right, up, z, g00, g01, g10, g11, height):  # type: ignore[no-untyped-def]
    for k in range(len(height)):
        x, y = right[k], up[k]
        height[k] = z[k] - (
            (g00[k] * (1 - x) + g01[k] * x) * (1 - y) + (g10[k] * (1 - x) + g11[k] * x) * y
        )


@njit(cache=True, nogil=True)
def _widen(values, least, most):  # type: ignore[no-untyped-def]
    """Update the least and greatest values of each lane; NaN does not count."""
    for first in range(0, len(values) - LANES + 1, LANES):
        for lane in range(LANES):
            value = values[first + lane]
            least[lane] = value if value < least[lane] else least[lane]
            most[lane] = value if value > most[lane] else most[lane]
    for k in range(len(values) // LANES * LANES, len(values)):
        least[0] = values[k] if values[k] < least[0] else least[0]
        most[0] = values[k] if values[k] > most[0] else most[0]
