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

"""The ground surface of a cloud, and the heights of its points above it."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import HeightSettings
from plc_inspect.core.ground import estimate_ground, measure_gap
from plc_inspect.results import Bool, Float32, Float64

MAX_CELLS = 16_000_000
"""Bound of the ground grid; a wider area gets larger cells."""


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
    ground_gap: Float32
    origin: Float64
    cell_size: float


def measure_surface(
    points: Float64, settings: HeightSettings, airborne: Bool | None = None
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

    Returns
    -------
    Surface

    """
    low, high, num_finite = bounds(points)
    if num_finite == 0:
        return Surface(
            height=np.full(len(points), np.nan, dtype=np.float32),
            extremes=np.array([np.inf, -np.inf], dtype=np.float32),
            num_finite=0,
            ground=np.full((1, 1), np.nan, dtype=np.float32),
            ground_gap=np.full((1, 1), np.inf, dtype=np.float32),
            origin=np.zeros(2),
            cell_size=settings.cell_size,
        )
    low[:2] = np.floor(low[:2] / settings.cell_size) * settings.cell_size
    extent = high[:2] - low[:2]
    cell = max(settings.cell_size, math.sqrt(float(extent[0] * extent[1]) / MAX_CELLS))
    per_cell = 1.0 / cell  # multiplied by as in the kernel, or a place could lie beyond the grid
    shape = (int(extent[1] * per_cell) + 1, int(extent[0] * per_cell) + 1)
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
        ground_gap=measure_gap(seen, cell),
        origin=low[:2],
        cell_size=cell,
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


@njit(cache=True, parallel=True, nogil=True)
def _lowest_points(points, low, per_cell, rows, columns):  # type: ignore[no-untyped-def]
    num_parts = 2
    grids = np.full((num_parts, rows, columns), np.inf, dtype=np.float32)
    num = len(points)
    x0, y0, z0 = low[0], low[1], low[2]
    for part in prange(num_parts):
        grid = grids[part]
        for i in range(part * num // num_parts, (part + 1) * num // num_parts):
            x, y, z = points[i, 0] - x0, points[i, 1] - y0, points[i, 2] - z0
            if not _are_finite(x, y, z):
                continue
            row, column = int(y * per_cell), int(x * per_cell)
            if z < grid[row, column]:
                grid[row, column] = z
    lowest = np.empty((rows, columns), dtype=np.float32)
    for row in prange(rows):
        for column in range(columns):
            value = min(grids[0, row, column], grids[1, row, column])
            lowest[row, column] = value + low[2] if np.isfinite(value) else np.nan
    return lowest


@njit(cache=True, parallel=True, nogil=True)
def _heights(points, ground, low, cell, height):  # type: ignore[no-untyped-def]
    """Put in the height of each point above the ground; return the least and the greatest."""
    num_parts = 8
    num = len(points)
    extremes = np.empty((num_parts, 2), dtype=np.float32)
    rows, columns = ground.shape
    per_cell = 1.0 / cell
    x0, y0 = low[0], low[1]
    for part in prange(num_parts):
        least, most = np.float32(np.inf), np.float32(-np.inf)
        for i in range(part * num // num_parts, (part + 1) * num // num_parts):
            x, y = (points[i, 0] - x0) * per_cell - 0.5, (points[i, 1] - y0) * per_cell - 0.5
            if not _are_finite(x, y, points[i, 2]):
                height[i] = np.nan
                continue
            x, y = max(x, 0.0), max(y, 0.0)
            c0, r0 = int(x), int(y)
            c1, r1 = min(c0 + 1, columns - 1), min(r0 + 1, rows - 1)
            fc, fr = min(x - c0, 1.0), min(y - r0, 1.0)
            below = (ground[r0, c0] * (1 - fc) + ground[r0, c1] * fc) * (1 - fr) + (
                ground[r1, c0] * (1 - fc) + ground[r1, c1] * fc
            ) * fr
            value = np.float32(points[i, 2] - below)
            height[i] = value
            if value < least:
                least = value
            if value > most:
                most = value
        extremes[part, 0], extremes[part, 1] = least, most
    result = np.empty(2, dtype=np.float32)
    result[0] = extremes[:, 0].min()
    result[1] = extremes[:, 1].max()
    return result
