# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground surface of a cloud, and the heights of its points above it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import HeightSettings
from plc_inspect.core.ground.ground_fill import fill, keep, shrink, widen, widen_all
from plc_inspect.core.ground.ground_filter import estimate_ground, find_surface, is_low
from plc_inspect.core.ground.ground_grid import (
    COLUMNS,
    find_cell,
    FINE,
    GroundGrid,
    lay_blocks,
    make_grid,
    make_unknown,
    MAX_CELLS,
    MOST_CELLS,
    MOST_SQUARES,
    SHIFT,
    WHOLE,
)
from plc_inspect.core.numerics.plan_index import clamp
from plc_inspect.results import Bool, Float32, Float64

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
CONTEXT = 2 * FINE
"""
Cells about a block that are looked at with it; there are FINE more between it and its points.
Source: derived: no stage below the level of FINE cells reaches farther.
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
    ground: GroundGrid


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
            ground=make_unknown(settings.cell_size),
        )
    # estimate the ground from the lowest point of each cell
    grid = _lay_cells(points, low, high, settings.cell_size, region)
    solid = points if airborne is None else points[~airborne]
    _lowest_points(solid, low, grid.blocks, grid.height)
    ground = _estimate(grid, math.tan(math.radians(settings.max_slope_deg)))
    # measure heights above it
    height = np.empty(len(points), dtype=np.float32)
    extremes = _heights(points, ground.height, ground.blocks, height)
    return Surface(height=height, extremes=extremes, num_finite=num_finite, ground=ground)


def _lay_cells(
    points: Float64, low: Float64, high: Float64, cell: float, region: Float64 | None
) -> GroundGrid:
    """Lay cells without heights; move ``low`` to the lower corner of the first."""
    whole = np.array([low, high]) if region is None else region
    first = np.floor(whole[0, :2] / cell) * cell
    extent = np.maximum(whole[1, :2], high[:2]) - first
    most = float(np.prod(extent)) / cell**2
    is_wide = most > MAX_CELLS
    if region is None:
        cell *= max(1.0, math.sqrt(most / FINE**2 / MOST_SQUARES))
        low[:2] = first
    else:
        low[2] = region[0, 2]
        _lay_out(low, high, region, first, cell, is_wide)
    while True:
        per_cell = 1.0 / cell  # as the kernel multiplies by it, no point lies beyond the grid
        extent = high[:2] - low[:2]
        shape = (int(extent[1] * per_cell) + 1, int(extent[0] * per_cell) + 1)
        table, shift = np.array([[[0, 0, 0, *shape]]]), WHOLE
        num_kept = (shape[0] + 1) * (shape[1] + 1)
        if is_wide:
            (table, num_kept), shift = lay_blocks(points, low, cell, shape), SHIFT
        if num_kept <= MOST_CELLS:
            break
        cell *= 1.01 * math.sqrt(num_kept / MOST_CELLS)
    return GroundGrid(
        origin=low[:2], cell_size=cell, shape=shape, table=table, shift=shift,
        height=np.empty(num_kept, dtype=np.float32), seen=np.zeros(num_kept, dtype=bool),
    )


def _lay_out(
    low: Float64, high: Float64, region: Float64, first: Float64, cell: float, is_wide: bool
) -> None:
    """Widen the bounds of a part so that its cells and blocks coincide with those of the whole."""
    edge, num = ((CONTEXT + FINE) * cell, 2**SHIFT) if is_wide else (EDGE, FINE)
    size = num * cell
    blocks, own = np.floor((low[:2] - edge - first) / size), np.floor((low[:2] - first) / size)
    # points that came after the whole was measured may lie before its first cell
    low[:2] = first + np.maximum(blocks, np.minimum(own, 0.0)) * size
    high[:2] = np.minimum(
        np.maximum(high[:2] + edge, low[:2]), np.maximum(region[1, :2], high[:2])
    )


def _estimate(lowest: GroundGrid, max_slope: float) -> GroundGrid:
    """Estimate the ground; of several blocks each with what is about it."""
    if lowest.shift == WHOLE:
        height, seen = estimate_ground(
            lowest.view(lowest.height, (0, 0))[:-1, :-1].copy(), lowest.cell_size, max_slope
        )
        return make_grid(height, seen, lowest.origin, lowest.cell_size)
    surface = np.empty_like(lowest.height)
    seen, dense, sure = (lowest.seen.copy() for _ in range(3))
    for around in lowest.list_around(CONTEXT):
        found = find_surface(lowest.cut(lowest.height, around), lowest.cell_size, max_slope)
        for all_cells, own in (
            (surface, found.surface), (seen, found.seen), (dense, found.dense), (sure, found.sure)
        ):
            around.put(lowest.view(all_cells, around.number), own)
    seen &= is_low(
        surface, _fill_blocks(lowest, keep(surface, dense)),
        _fill_blocks(lowest, keep(surface, sure), widen_all),
    )
    return replace(lowest, height=_fill_blocks(lowest, keep(surface, seen)), seen=seen)


def _fill_blocks(
    grid: GroundGrid, known: Float32, fill_base: Callable[[Float32], Float32] = widen
) -> Float32:
    """Fill cells block by block as all of them would be, from what is known in any block."""
    base = np.full([-(-num // FINE) for num in grid.shape], np.nan, dtype=np.float32)
    for around in grid.list_around(0):
        own = shrink(np.ascontiguousarray(grid.view(known, around.number)[:-1, :-1]))
        row, column = (place // FINE for place in around.low)
        base[row : row + own.shape[0], column : column + own.shape[1]] = own
    base, result = fill_base(base), np.empty_like(known)
    for around in grid.list_around(CONTEXT):
        row, column = (place // FINE for place in around.low)
        about = grid.cut(known, around)
        rows, columns = (-(-num // FINE) for num in about.shape)
        filled = fill(about, base[row : row + rows, column : column + columns])
        around.put(grid.view(result, around.number), filled)
    return result


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
def _find_cells(points, low, blocks, row, column, z):  # type: ignore[no-untyped-def]
    """Set row and column of each point, and its z above ``low``, NaN if it is not finite."""
    _, _, _, cell, rows, columns = blocks
    flat, x0, y0, z0, per_cell = points.ravel(), low[0], low[1], low[2], 1.0 / cell
    most_x, most_y = columns - 1.0, rows - 1.0
    for k in range(len(points)):
        x, y = (flat[3 * k] - x0) * per_cell, (flat[3 * k + 1] - y0) * per_cell
        flaw = 0.0 * x + 0.0 * y + 0.0 * flat[3 * k + 2]  # NaN and infinity times 0 are NaN
        x, y = clamp(x, most_x), clamp(y, most_y)
        row[k], column[k] = np.uint32(np.int32(y)), np.uint32(np.int32(x))
        z[k] = flat[3 * k + 2] - z0 + flaw


@njit(cache=True, nogil=True)
def _address(row, column, table, shift, at, wide):  # type: ignore[no-untyped-def]
    """Set the place of each cell within the grid, and how far the next row is from it."""
    if shift == WHOLE:
        step = np.uint32(table[0, 0, COLUMNS] + 1)
        for k in range(len(row)):
            at[k] = row[k] * step + column[k]
            wide[k] = step
        return
    for k in range(len(row)):
        r, c = np.int64(row[k]), np.int64(column[k])
        # cells beside those of points are kept as well; only a point that is not finite has none
        at[k] = np.uint32(max(find_cell(table, shift, r, c), 0))
        wide[k] = np.uint32(table[r >> shift, c >> shift, COLUMNS] + 1)


@njit(cache=True, parallel=True, nogil=True)
def _lowest_points(points, low, blocks, lowest):  # type: ignore[no-untyped-def]
    """Set the lowest point of each cell that is kept [m], NaN where none is."""
    table, shift, _, _, _, _ = blocks
    num_parts, num_cells = 2, len(lowest)
    grids = np.full((num_parts, num_cells), np.inf, dtype=np.float32)
    num = len(points)
    for part in prange(num_parts):
        grid = grids[part]
        begin, end = part * num // num_parts, (part + 1) * num // num_parts
        size = min(STRETCH, end - begin)
        row, column = np.empty(size, dtype=np.uint32), np.empty(size, dtype=np.uint32)
        at, wide = np.empty(size, dtype=np.uint32), np.empty(size, dtype=np.uint32)
        z = np.empty(size)
        for first in range(begin, end, STRETCH):
            own = points[first : min(first + STRETCH, end)]
            stretch = len(own)
            _find_cells(own, low, blocks, row, column, z)
            _address(row[:stretch], column[:stretch], table, shift, at, wide)
            for k in range(stretch):
                if z[k] < grid[at[k]]:
                    grid[at[k]] = z[k]
    for k in prange(num_cells):
        value = min(grids[0, k], grids[1, k])
        lowest[k] = value + low[2] if np.isfinite(value) else np.nan


@njit(cache=True, parallel=True, nogil=True)
def _heights(points, ground, blocks, height):  # type: ignore[no-untyped-def]
    """
    Set the height of each point above the ground; return the least and the greatest.

    The ground is bilinear between cell centres.
    """
    num_parts = 8
    num = len(points)
    least = np.full((num_parts, LANES), np.inf, dtype=np.float32)
    most = np.full((num_parts, LANES), -np.inf, dtype=np.float32)
    table, shift, _, _, _, _ = blocks
    for part in prange(num_parts):
        begin, end = part * num // num_parts, (part + 1) * num // num_parts
        size = min(STRETCH, end - begin)
        row, column = np.empty(size, dtype=np.uint32), np.empty(size, dtype=np.uint32)
        at, wide = np.empty(size, dtype=np.uint32), np.empty(size, dtype=np.uint32)
        right, up = np.empty(size), np.empty(size)
        z, g00, g01 = np.empty(size), np.empty(size, ground.dtype), np.empty(size, ground.dtype)
        g10, g11 = np.empty(size, ground.dtype), np.empty(size, ground.dtype)
        for first in range(begin, end, STRETCH):
            last = min(first + STRETCH, end)
            own = points[first:last]
            stretch = len(own)
            _locate(own, blocks, row, column, right, up)
            _address(row[:stretch], column[:stretch], table, shift, at, wide)
            _pick_corners(own, ground, at, wide, z, g00, g01, g10, g11)
            _interpolate(right, up, z, g00, g01, g10, g11, height[first:last])
            _widen(height[first:last], least[part], most[part])
    result = np.empty(2, dtype=np.float32)
    result[0] = least.min()
    result[1] = most.max()
    return result


@njit(cache=True, nogil=True)
def _locate(points, blocks, row, column, right, up):  # type: ignore[no-untyped-def]
    """
    Set the cell centre to the lower left of each point, and the distance of the point from it.

    Distances are in cells, NaN where the point is not finite.
    """
    _, _, origin, cell, rows, columns = blocks
    flat, per_cell = points.ravel(), 1.0 / cell
    x0, y0, most_x, most_y = origin[0], origin[1], columns - 1.0, rows - 1.0
    for k in range(len(points)):
        x, y = (flat[3 * k] - x0) * per_cell - 0.5, (flat[3 * k + 1] - y0) * per_cell - 0.5
        flaw = 0.0 * x + 0.0 * y + 0.0 * flat[3 * k + 2]  # NaN and infinity times 0 are NaN
        x, y = clamp(x, most_x), clamp(y, most_y)
        left, lower = np.int32(x), np.int32(y)
        column[k], row[k] = np.uint32(left), np.uint32(lower)
        right[k] = x - left + flaw
        up[k] = y - lower


@njit(cache=True, nogil=True)
def _pick_corners(points, ground, at, wide, z, g00, g01, g10, g11):  # type: ignore[no-untyped-def]
    """Set z of each point, and the ground at the four cell centres about it."""
    one = np.uint32(1)
    for k in range(len(points)):
        here, above = at[k], at[k] + wide[k]
        g00[k], g01[k] = ground[here], ground[here + one]
        g10[k], g11[k] = ground[above], ground[above + one]
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
