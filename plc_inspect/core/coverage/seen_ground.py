# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Plan cells in which anything was seen, and its height."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.hash_table import (
    hash_key,
    index_keys,
    make_entry,
    make_table,
    probe,
)
from plc_inspect.results import Bool, Float64, Int64

CELL = 2.5
"""
Edge of a cell in plan [m].
Source: derived: half of STEP of ``coverage``; a tree that could reach a conductor fills several.
"""
LEAST_POINTS = 2
"""
Least number of points of a seen cell.
Source: judgement: a single point may be a stray.
"""
INITIAL_CELLS = 1 << 12
"""
Initial capacity, in cells.
Source: numerical: the room doubles whenever it is full.
"""
_SHIFT = 1 << 31
"""
Factor that packs row and column into one number.
Source: derived: half of the bits of int64.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenGround:
    """The M cells that hold points; parallel, ascending by key."""

    keys: Int64
    """(M,) packed row and column."""
    num_points: Int64
    """(M,) points that are not of conductors."""
    top: Float64
    """(M,) greatest height of all points [m]."""
    cover: Float64
    """(M,) greatest height of points that are not of conductors, -inf without one [m]."""

    def is_seen(self, places: Float64) -> Bool:
        """
        Return at which plan positions the ground, or an object on it, was seen.

        Parameters
        ----------
        places : (N, 2+) float64
            Map frame [m].

        Returns
        -------
        (N,) bool

        """
        at, found = self._find(places)
        seen: Bool = found.copy()
        seen[found] = self.num_points[at[found]] >= LEAST_POINTS
        return seen

    def find_top(self, places: Float64, reach: float) -> Float64:
        """
        Return the greatest height of points near positions.

        Parameters
        ----------
        places : (N, 2+) float64
            Map frame [m].
        reach : float
            Distance in plan, rounded up to whole cells [m].

        Returns
        -------
        (N,) float64
            Height [m], -inf where nothing was seen.

        """
        steps = np.arange(int(np.ceil(reach / CELL)) + 1)
        apart = np.maximum(steps - 1, 0) * CELL
        # of each row of cells, how many to either side may hold a point within reach
        widths = (np.hypot(apart[:, None], apart) <= reach).sum(axis=1) - 1
        top: Float64 = _find_top(self.keys, self.top, _pack(places), widths)
        return top

    def list_seen(self) -> tuple[Float64, Float64]:
        """
        Return the cells that were seen.

        Returns
        -------
        middles : (K, 2) float64
            Their middles, map frame [m].
        heights : (K,) float64
            Greatest height of points that are not of conductors [m].

        """
        seen = self.num_points >= LEAST_POINTS
        return _unpack(self.keys[seen]), self.cover[seen]

    def _find(self, places: Float64) -> tuple[Int64, Bool]:
        """Return the row of each position's cell, and whether that cell exists."""
        if not len(self.keys):
            return np.zeros(len(places), dtype=np.int64), np.zeros(len(places), dtype=np.bool_)
        keys = _pack(places)
        at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        found: Bool = self.keys[at] == keys
        return at, found


def see_ground(points: Float64, is_wire: Bool) -> SeenGround:
    """
    Build the seen cells of a cloud.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m]; rows that are not finite are left out.
    is_wire : (N,) bool
        Points of conductors, which do not show the ground below.

    Returns
    -------
    SeenGround

    """
    keys, num_points, heights = _gather(points, is_wire)
    order = np.argsort(keys)
    top, cover = heights[order].T
    return SeenGround(keys=keys[order], num_points=num_points[order], top=top, cover=cover)


@njit(cache=True, nogil=True)
def _gather(points, is_wire):  # type: ignore[no-untyped-def]
    """Return key of each cell in order of its first point, points, top and cover."""
    keys, num_points, heights = _make_room(INITIAL_CELLS)
    table = make_table(len(keys))
    used = 0
    slot = -1
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if 0.0 * (x + y + z) != 0.0:
            continue
        key = np.int64(np.floor(x / CELL)) * _SHIFT + np.int64(np.floor(y / CELL))
        # most points lie in the cell of the one before
        if slot < 0 or keys[slot] != key:
            hashed = hash_key(key)
            slot, place = probe(key, hashed, hashed & (len(table) - 1), table, keys)
            if slot < 0:
                if used == len(keys):
                    more_keys, more_points, more_heights = _make_room(2 * used)
                    put(keys, more_keys)
                    put(num_points, more_points)
                    put(heights.ravel(), more_heights.ravel())
                    keys, num_points, heights = more_keys, more_points, more_heights
                    table = index_keys(keys[:used], len(keys))
                    _, place = probe(key, hashed, hashed & (len(table) - 1), table, keys)
                slot = used
                used += 1
                table[place] = make_entry(hashed, slot, len(table) - 1)
                keys[slot] = key
        heights[slot, 0] = max(heights[slot, 0], z)
        if not is_wire[i]:
            num_points[slot] += 1
            heights[slot, 1] = max(heights[slot, 1], z)
    return keys[:used], num_points[:used], heights[:used]


@njit(cache=True, nogil=True)
def _find_top(keys, tops, places, widths):  # type: ignore[no-untyped-def]
    """Return the greatest height (N,) of the cells about those of places (N,), -inf for none."""
    result = np.full(len(places), -np.inf)
    for n in range(len(places)):
        for i in range(1 - len(widths), len(widths)):
            first = places[n] + i * _SHIFT - widths[abs(i)]
            k = np.searchsorted(keys, first)
            while k < len(keys) and keys[k] <= first + 2 * widths[abs(i)]:
                result[n] = max(result[n], tops[k])
                k += 1
    return result


@njit(cache=True, nogil=True)
def _make_room(num):  # type: ignore[no-untyped-def]
    return np.empty(num, np.int64), np.zeros(num, np.int64), np.full((num, 2), -np.inf)


def _pack(places: Float64) -> Int64:
    """Return row and column of the cell of each place (N, 2+) in one number."""
    index = np.floor(places[:, :2] / CELL).astype(np.int64)
    keys: Int64 = index[:, 0] * _SHIFT + index[:, 1]
    return keys


def _unpack(keys: Int64) -> Float64:
    """Return the middles (N, 2) of cells [m]."""
    row = (keys + _SHIFT // 2) // _SHIFT
    middles: Float64 = (np.column_stack([row, keys - row * _SHIFT]) + 0.5) * CELL
    return middles
