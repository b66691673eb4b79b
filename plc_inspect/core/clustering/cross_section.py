# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The cross-section of a window: the points near its candidates, along, across and up."""

import math

from numba import njit
import numpy as np

from plc_inspect.core.clustering.clusterers import LEAST_NEIGHBORS
from plc_inspect.core.extraction.alignment import AlignmentResult
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.results import Float64, Int32

GRID = 0.5
"""
Edge of the cells of the cross-section that the candidates open [m].
Source: judgement; not measured.
"""
MAX_WINDOW_POINTS = 1200
"""
More points in a window than this are thinned; a wire needs far fewer.
Source: judgement; bounds time.
"""
RIM = 2
"""Cells about that of a candidate that it opens as well.  Source: judgement; not measured."""
ROOM = 1.5
"""
Points are looked for this far beyond the outermost candidates [m].
Source: judgement; not measured.
"""
SAMPLING = 5
"""
The core threshold is this part of the points of the fullest place.
Source: judgement; not measured.
"""
MOST_SKEW, SKEW_STEP, SKEW_BIN = 0.05, 0.0025, 0.05
"""
Greatest error of the direction of a window that is looked for, and steps in which it is [m/m];
width of the bins that tell how sharp points lie [m].
Source: judgement: windows of conductors 0.3 m apart (seed 119002, any) were askew by up to 0.03,
which moves points 6 m from the middle by 0.18 m.
"""
SKEW_SIGMAS = 15.0
"""
Standard deviations of chance by which points must lie sharper along another direction.
Source: measured: seed 119002, any, and the street tiles: the same from 10 to 20; with 5 crowns
are divided into lines, with 30 rows of conductors are not.
"""
TABLE = 256
"""
Rows and columns of the table of places, which repeats beyond.
Source: numerical: a power of two.
"""


@njit(cache=True, nogil=True)
def gather_window(  # type: ignore[no-untyped-def]
    points, start, order, origin, cell, rows, columns, seeds, own, center, azimuth, rise, half
):
    """
    Return the points of one window, with the rise along the line taken out.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    start, order, origin, cell, rows, columns
        PlanIndex of the points.
    seeds : (M, 3) float64
        Positions of all candidates [m].
    own : (S,) int32
        Candidates of the window.
    center : (3,) float64
        Centre of the window [m].
    azimuth, rise, half : float
        Direction [rad], slope along it, and half the length of the window [m].

    Returns
    -------
    chosen : (n,) int32
        Points within a metre across the line of a candidate.
    x, y, w : (n,) float64
        Along, across, and up above the rising axis [m].

    """
    cx, cy, cz = center[0], center[1], center[2]
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    # the cross-section that the seeds occupy, dilated by a metre
    seed_y, seed_w = np.empty(len(own)), np.empty(len(own))
    for k in range(len(own)):
        dx, dy = seeds[own[k], 0] - cx, seeds[own[k], 1] - cy
        seed_y[k] = -sa * dx + ca * dy
        seed_w[k] = seeds[own[k], 2] - cz - rise * (ca * dx + sa * dy)
    low_y, high_y = seed_y.min(), seed_y.max()
    low_w, high_w = seed_w.min(), seed_w.max()
    ny = int((high_y - low_y) / GRID) + 2 * RIM + 3
    nw = int((high_w - low_w) / GRID) + 2 * RIM + 3
    allowed = np.zeros((ny, nw), dtype=np.bool_)
    for k in range(len(own)):
        iy = int((seed_y[k] - low_y) / GRID) + (RIM + 1)
        iw = int((seed_w[k] - low_w) / GRID) + (RIM + 1)
        allowed[iy - RIM : iy + RIM + 1, iw - RIM : iw + RIM + 1] = True
    reach = max(abs(low_y), abs(high_y)) + ROOM
    near = gather_strip(
        start, order, origin, cell, rows, columns,
        cx - half * ca, cy - half * sa, cx + half * ca, cy + half * sa, reach,
    )
    chosen = np.empty(len(near), dtype=np.int32)
    along, across, up = np.empty(len(near)), np.empty(len(near)), np.empty(len(near))
    n = 0
    for i in near:
        dx, dy = points[i, 0] - cx, points[i, 1] - cy
        x = ca * dx + sa * dy
        if abs(x) > half:
            continue
        y = -sa * dx + ca * dy
        w = points[i, 2] - cz - rise * x
        iy = int((y - low_y) / GRID + (RIM + 1))
        iw = int((w - low_w) / GRID + (RIM + 1))
        if 0 <= iy < ny and 0 <= iw < nw and allowed[iy, iw]:
            chosen[n], along[n], across[n], up[n] = i, x, y, w
            n += 1
    return chosen[:n], along[:n], across[:n], up[:n]


def gather_points(
    points: Float64, index: PlanIndex, seeds: Float64, alignment: AlignmentResult, window: int
) -> tuple[Int32, Float64, Float64, Float64]:
    """Return what `gather_window` does for one window of an alignment."""
    start, stop = alignment.seed_start[window : window + 2]
    found: tuple[Int32, Float64, Float64, Float64] = gather_window(
        points, *index.grid, seeds,
        alignment.seeds[start:stop], alignment.center[window], alignment.azimuth[window],
        alignment.slope[window], alignment.half_length,
    )
    return found


@njit(cache=True, nogil=True)
def thin_window(chosen, x, y, w):  # type: ignore[no-untyped-def]
    """Return at most MAX_WINDOW_POINTS of a window's points, every k-th."""
    step = max((len(chosen) + MAX_WINDOW_POINTS - 1) // MAX_WINDOW_POINTS, 1)
    return chosen[::step].copy(), x[::step].copy(), y[::step].copy(), w[::step].copy()


@njit(cache=True, nogil=True)
def count_needed(y, w, eps, min_points):  # type: ignore[no-untyped-def]
    """
    Return the core threshold at the sampling of a window: a fifth of its fullest place.

    Parameters
    ----------
    y, w : (n,) float64
        Points across and up [m], at most MAX_WINDOW_POINTS.
    eps : float
        Edge of a place [m].
    min_points : int
        Threshold of a window that is fully sampled.

    """
    counts = np.zeros((TABLE, TABLE), dtype=np.int16)
    fullest = 0
    for k in range(len(y)):
        i = math.floor(y[k] / eps) & (TABLE - 1)
        j = math.floor(w[k] / eps) & (TABLE - 1)
        counts[i, j] += 1
        fullest = max(fullest, counts[i, j])
    return min(max(fullest // SAMPLING, LEAST_NEIGHBORS), min_points)


@njit(cache=True, nogil=True)
def find_rest(y, w, eps, label, rest):  # type: ignore[no-untyped-def]
    """
    Find the points that lie in no cluster, nor in a place beside one.

    Parameters
    ----------
    y, w : (n,) float64
        Points across and up [m].
    eps : float
        Edge of a place [m].
    label : (n,) int64
        Cluster of each point, -1 none.
    rest : (n,) bool
        Set for those points.

    Returns
    -------
    int
        The core threshold at their own sampling.

    """
    taken = np.zeros((TABLE, TABLE), dtype=np.bool_)
    for k in range(len(y)):
        if label[k] >= 0:
            i, j = math.floor(y[k] / eps), math.floor(w[k] / eps)
            for a in range(i - 1, i + 2):
                for b in range(j - 1, j + 2):
                    taken[a & (TABLE - 1), b & (TABLE - 1)] = True
    for k in range(len(y)):
        i, j = math.floor(y[k] / eps), math.floor(w[k] / eps)
        rest[k] = not taken[i & (TABLE - 1), j & (TABLE - 1)]
    return count_needed(y[rest], w[rest], eps, len(y))


@njit(cache=True, nogil=True)
def find_skew(x, v):  # type: ignore[no-untyped-def]
    """
    Return the slope along which points lie sharpest: few bins across it hold most of them.

    Parameters
    ----------
    x, v : (n,) float64
        Points along the window, and across or up [m].

    Returns
    -------
    float
        Slope [m/m], within MOST_SKEW; 0 where no other is sharper beyond chance.

    """
    num = round(MOST_SKEW / SKEW_STEP)
    counts = np.zeros(TABLE, dtype=np.int64)
    best, most, straight = 0.0, 0.0, 0.0
    for step in range(2 * num + 1):
        # from the middle outwards: of equal ones the least
        slope = ((step + 1) // 2) * (SKEW_STEP if step % 2 else -SKEW_STEP)
        counts[:] = 0
        pairs = 0.0  # of one bin, each counted from both ends
        for k in range(len(x)):
            place = math.floor((v[k] - slope * x[k]) / SKEW_BIN) & (TABLE - 1)
            pairs += 2.0 * counts[place]
            counts[place] += 1
        if step == 0:
            straight = pairs
        if pairs > most:
            best, most = slope, pairs
    chance = math.sqrt(2.0 * max(straight, len(x)))  # of few points no pair may fall together
    return best if most - straight > SKEW_SIGMAS * chance else 0.0
