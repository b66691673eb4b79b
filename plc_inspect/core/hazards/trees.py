# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Divides a canopy into trees: peaks that stand out from the crowns around them."""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.disjoint_sets import find_root
from plc_inspect.results import Bool, Float64, Int64

CELL = 0.5
"""
Edge of the plan cells whose highest points make the canopy [m].
Source: judgement; not measured.
"""
REACH = 2
"""
Cells up to this far apart touch, so that sparse points do not split a crown.
Source: judgement; not measured.
"""
LEAST_DEPTH = 1.0
"""Depth of a dip that divides two trees, at least [m].  Source: judgement; not measured."""
DEPTH_RATIO = 0.15
"""
Depth of a dip that divides two trees, at least, as a share of the lower tree's height.
Source: judgement; not measured.
"""


def find_corner(points: Float64, edge: float) -> list[float]:
    """
    Return the corner of cells below (N, D) coordinates [m].

    It lies at multiples of the edge, so that a part of a cloud has the cells of the whole.
    """
    corner: list[float] = (np.floor(points.min(axis=0) / edge) * edge).tolist()
    return corner


def stand_near(points: Float64, chosen: Bool, margin: float) -> Bool:
    """
    Tell the points in the plan cells of chosen points and in the cells around them.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    chosen : (N,) bool
        Some of them.
    margin : float
        Edge of the cells [m].

    Returns
    -------
    (N,) bool

    """
    corner = find_corner(points[:, :2], margin)
    result: Bool = _stand_near(points, chosen, margin, *corner)
    return result


@njit(cache=True, nogil=True)
def _stand_near(points, offends, margin, x0, y0):  # type: ignore[no-untyped-def]
    """Mark the cells of offending points and the eight around each; tell the points in them."""
    columns = int((points[:, 0].max() - x0) / margin) + 3
    rows = int((points[:, 1].max() - y0) / margin) + 3
    wanted = np.zeros((columns, rows), dtype=np.bool_)
    for i in range(len(points)):
        if not offends[i]:
            continue
        column, row = int((points[i, 0] - x0) / margin), int((points[i, 1] - y0) / margin)
        wanted[column : column + 3, row : row + 3] = True
    result = np.empty(len(points), dtype=np.bool_)
    for i in range(len(points)):
        column, row = int((points[i, 0] - x0) / margin), int((points[i, 1] - y0) / margin)
        result[i] = wanted[column + 1, row + 1]
    return result


def segment_trees(points: Float64, height: Float64) -> Int64:
    """
    Divide a canopy into trees.

    The highest points of plan cells make a surface.  From the top down each cell joins the highest
    crown that it touches; two crowns that meet are one tree unless the dip between them is deep
    enough.  O(N log N).

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float64
        Above local ground [m].

    Returns
    -------
    (N,) int64
        Number of the tree of each point, from 0, in order of the trees' heights.

    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    corner = find_corner(points[:, :2], CELL)
    column, row = (
        ((along - least) / CELL).astype(np.int64) + REACH
        for along, least in zip(points.T[:2], corner, strict=True)
    )
    columns = int(column.max()) + 1 + REACH
    keys, cell = np.unique(row * columns + column, return_inverse=True)
    level = np.full(len(keys), -np.inf)
    np.maximum.at(level, cell, height)
    order = np.lexsort((keys, -level))
    root = _climb(keys, level, order, columns, REACH, LEAST_DEPTH, DEPTH_RATIO)
    peaks = order[root[order] == order]
    number = np.empty(len(keys), dtype=np.int64)
    number[peaks] = np.arange(len(peaks))
    result: Int64 = number[root[cell]]
    return result


@njit(cache=True, nogil=True)
def _climb(keys, level, order, columns, reach, depth, ratio):  # type: ignore[no-untyped-def]
    """Return the peak that each cell belongs to, by merging from the top down."""
    num = len(keys)
    parent = np.full(num, -1, dtype=np.int64)
    roots = np.empty((2 * reach + 1) ** 2, dtype=np.int64)
    for cell in order:
        # the peaks that it touches, and the highest cell among those
        found = 0
        best = -1
        for step in range(-reach, reach + 1):
            first = keys[cell] + step * columns - reach
            at = np.searchsorted(keys, first)
            while at < num and keys[at] <= first + 2 * reach:
                if parent[at] >= 0:
                    if best < 0 or level[at] > level[best]:
                        best = at
                    roots[found] = find_root(parent, at)
                    found += 1
                at += 1
        if best < 0:
            parent[cell] = cell
            continue
        # those whose dip here is not deep enough are one with its own
        own = find_root(parent, best)
        for k in range(found):
            other = find_root(parent, roots[k])
            own = find_root(parent, own)
            if other == own:
                continue
            lower = min(level[other], level[own])
            if lower - level[cell] < max(depth, ratio * lower):
                if level[other] > level[own]:
                    parent[own] = other
                    own = other
                else:
                    parent[other] = own
        parent[cell] = own
    for cell in range(num):
        parent[cell] = find_root(parent, cell)
    return parent
