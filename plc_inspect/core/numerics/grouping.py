# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Groups of points that touch each other."""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.disjoint_sets import find_root, unite
from plc_inspect.core.numerics.hash_table import enter, find_slot, make_table
from plc_inspect.core.numerics.near_pairs import find_pairs
from plc_inspect.results import Float64, Int64

CELLS_PER_REACH = 4
"""
Cells to the reach of a link, by which points are thinned before they are grouped.
Source: judgement; not measured.
"""


def group_points(points: Float64, reach: float) -> Int64:
    """Return the connected group of each point, by links up to ``reach`` [m]; O(N log N)."""
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    cell = np.floor(points / (reach / CELLS_PER_REACH)).astype(np.int64)
    x, y, z = (cell - cell.min(axis=0)).T
    number = (x * (y.max() + 1) + y) * (z.max() + 1) + z
    _, first, inverse = np.unique(number, return_index=True, return_inverse=True)
    result: Int64 = unite(find_pairs(points[first], reach), len(first))[inverse]
    return result


def group_cells(points: Float64, edges: Float64, *, across: bool = False) -> Int64:
    """
    Return the group of each point, by cells that touch at a face, an edge or a corner; O(N).

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    edges : (3,) float64
        Of the cells [m].
    across : bool
        Cells with different places along the first axis do not touch.

    Returns
    -------
    (N,) int64
        From 0, in order of the first points.

    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    cell = np.floor(points / edges).astype(np.int64)
    result: Int64 = _group_cells(cell - cell.min(axis=0) + 1, across)
    return result


@njit(cache=True, nogil=True)
def _group_cells(cell, across):  # type: ignore[no-untyped-def]
    """Unite each new cell with those about it that are there already."""
    num = len(cell)
    rows, layers = cell[:, 1].max() + 2, cell[:, 2].max() + 2
    table, keys = make_table(num), np.empty(num, dtype=np.int64)
    parent, slots = np.empty(num, dtype=np.int64), np.empty(num, dtype=np.int64)
    used, width = 0, 0 if across else 1
    for i in range(num):
        key = (cell[i, 0] * rows + cell[i, 1]) * layers + cell[i, 2]
        slot = find_slot(key, table, keys)
        if slot < 0:
            slot = used
            keys[slot], parent[slot] = key, slot
            enter(key, slot, table)
            used += 1
            for x in range(-width, width + 1):
                for y in range(-1, 2):
                    for z in range(-1, 2):
                        other = find_slot(key + (x * rows + y) * layers + z, table, keys)
                        if other >= 0:
                            a, b = find_root(parent, slot), find_root(parent, other)
                            parent[max(a, b)] = min(a, b)
        slots[i] = slot
    number, groups = np.full(used, -1, dtype=np.int64), 0
    for i in range(num):
        root = find_root(parent, slots[i])
        if number[root] < 0:
            number[root] = groups
            groups += 1
        slots[i] = number[root]
    return slots
