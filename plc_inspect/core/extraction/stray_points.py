# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Leaves out isolated points far from all others, before grids are laid over the cloud.

A single point 100 km away would enlarge the cells of the ground grid so much that the ground below
the conductors would come out too low.
"""

from dataclasses import dataclass

from numba import njit, prange
import numpy as np

from plc_inspect.core.ground.ground_surface import bounds
from plc_inspect.core.numerics.grouping import group_cells
from plc_inspect.results import Bool, Float64, Int64

STRAY_GAP = 500.0
"""
Least edge of the cells that are empty all around strays [m].
Source: judgement: longer than the gaps between flight lines; not measured.
"""
MOST_CELLS = 64
"""Greatest number of cells along an axis.  Source: numerical: bounds memory to 1 MB."""
MOST_STRAYS = 100
"""
Greatest number of points of a group of strays.
Source: judgement: a conductor of 12 m has more in any survey; not measured.
"""
STRAY_SHARE = 0.01
"""The same limit as a share of the largest group.  Source: judgement; not measured."""


def leave_out_strays(points: Float64) -> tuple[Float64, int]:
    """
    Set points that are alone and far away to NaN.

    Occupied cells that touch form groups.  Points are strays if their group is small and at least
    STRAY_GAP from all others.  O(N); O(1) for clouds no longer than STRAY_GAP.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].

    Returns
    -------
    (N, 3) float64
        The same array where there are no strays, else a copy.
    int
        Number of strays.

    """
    num_strays = 0
    while True:
        low, high, num_finite = bounds(points)
        grid = lay_stray_grid(low, high) if num_finite else None
        if grid is None:
            return points, num_strays
        stray = grid.find_strays(grid.count(points))
        if not stray.any():
            return points, num_strays
        points = points.copy()
        num_strays += grid.erase(points, stray)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrayGrid:
    """The grid in which isolated points are searched for."""

    low: Float64
    """(3,) lower corner [m]."""
    cell: float
    """Edge of the cells [m]."""
    shape: Int64
    """(3,) numbers of cells."""

    def count(self, points: Float64) -> Int64:
        """Return the number of points in each cell, flat; those of the parts of a cloud add up."""
        counts: Int64 = _count(points, self.low, self.cell, self.shape)
        return counts

    def find_strays(self, counts: Int64) -> Bool:
        """Tell the cells that hold strays, from the number of points in each; both flat."""
        return _find_groups(counts.reshape(self.shape)).ravel()

    def erase(self, points: Float64, stray: Bool) -> int:
        """Set the points in stray cells to NaN, and return their number."""
        return int(_erase(points, self.low, self.cell, self.shape, stray))


def lay_stray_grid(low: Float64, high: Float64) -> StrayGrid | None:
    """Return the grid over the bounds of a cloud [m], None if it is too small for strays."""
    extent = high - low
    if extent.max() <= STRAY_GAP:
        return None
    cell = max(STRAY_GAP, float((extent / MOST_CELLS).max()))
    shape = np.minimum(extent / cell, MOST_CELLS - 1).astype(np.int64) + 1
    return StrayGrid(low=low, cell=cell, shape=shape)


def _find_groups(counts: Int64) -> Bool:
    """Tell the cells that belong to a group of strays."""
    occupied = counts > 0
    group = group_cells(np.argwhere(occupied).astype(np.float64), np.ones(3))
    size = np.bincount(group, weights=counts[occupied])
    small = (size <= MOST_STRAYS) & (size <= STRAY_SHARE * size.max())
    stray: Bool = np.zeros(counts.shape, dtype=np.bool_)
    stray[occupied] = small[group]
    return stray


@njit(cache=True, nogil=True)
def _find_cell(points, k, low, cell, shape):  # type: ignore[no-untyped-def]
    """Return the cell of a point, -1 where it is not finite."""
    if not np.isfinite(points[k, 0] + points[k, 1] + points[k, 2]):
        return np.int64(-1)
    at = np.int64(0)
    for axis in range(3):
        index = np.int64((points[k, axis] - low[axis]) / cell)
        at = at * shape[axis] + min(index, shape[axis] - 1)
    return at


@njit(cache=True, parallel=True, nogil=True)
def _count(points, low, cell, shape):  # type: ignore[no-untyped-def]
    num, num_parts = len(points), 4  # few, as each has all cells
    counts = np.zeros((num_parts, shape[0] * shape[1] * shape[2]), dtype=np.int64)
    for part in prange(num_parts):
        own = counts[part]
        for k in range(part * num // num_parts, (part + 1) * num // num_parts):
            at = _find_cell(points, k, low, cell, shape)
            if at >= 0:
                own[at] += 1
    for part in range(1, num_parts):
        counts[0] += counts[part]
    return counts[0].copy()


@njit(cache=True, nogil=True)
def _erase(points, low, cell, shape, stray):  # type: ignore[no-untyped-def]
    """Set the points in stray cells to NaN, and return their number."""
    count = 0
    for k in range(len(points)):
        at = _find_cell(points, k, low, cell, shape)
        if at >= 0 and stray[at]:
            points[k, :] = np.nan
            count += 1
    return count
