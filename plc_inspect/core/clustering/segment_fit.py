# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tests of a cluster in the cross-section of a window: whether it is a line segment."""

import math

from numba import njit
import numpy as np

from plc_inspect.core.numerics.arrays import put

SHELL_RATIO = 1.6
"""
Outer radius of the shell about a conductor, in radii of the conductor.
Source: judgement; worse at 0.7 and 1.4 of it on bench/constants.py.
"""
SHELL_SHARE = 0.3
"""
A place is crowded where the shell holds more than this share of the points within it.
Source: judgement; half of the 0.6 of a plane, see `measure_crowding`.
"""
LEAST_POINTS = 4
"""Least number of points of a segment.  Source: judgement; not measured."""
MIN_FILLING = 0.4
"""Least share of its parts in which a segment holds points.  Source: judgement; not measured."""
PARTS = 6.0
"""
Parts of half a window, of a metre at least, that a segment holds points in or not.
Source: derived: a metre in windows of 6 m to both sides; in longer ones less dense wires are seen.
"""
MIN_REACH = 0.5
"""
Least length of a segment, in halves of its window.
Source: judgement; holds down to 0.35, not up to 1.4 of it, on bench/constants.py.
"""
MOST_BESIDE = 12
"""
Pieces of one window that do not crowd each other, at most.
Source: judgement: two circuits of low voltage on one pole with a street light and telecom wires
have as many; plants and crowns have hundreds, and each would be followed.
"""
TRIM_SIGMAS, LEAST_TRIM = 2.5, 0.05
"""
Points beyond this many rms, and this [m], of the first line are left out of the second.
Source: judgement; not measured.
"""
CORE_SIGMAS, LEAST_CORE = 2.5, 0.1
"""
Radius of a conductor in rms of its segment, and at least [m].
Source: judgement; not measured.
"""
CROWD_PART = 3.0
"""
Length of the parts of a segment that are tested for crowding [m].
Source: judgement; not measured.
"""
SHELL_CHANCE = 1.0
"""Points that the shell may hold by chance.  Source: judgement; not measured."""
LEAST_SPREAD = 1e-9
"""
Sum of squared distances along the line that a slope needs [m2].
Source: numerical: avoids a division by 0.
"""


@njit(cache=True, nogil=True)
def _fit_segment(x, y, w, member):  # type: ignore[no-untyped-def]
    """Straight line through the chosen points: means, slopes in y and w, rms, extent."""
    n = 0.0
    sx = sy = sw = sxx = sxy = sxw = 0.0
    low, high = np.inf, -np.inf
    for k in range(len(x)):
        if member[k]:
            n += 1.0
            sx += x[k]
            sy += y[k]
            sw += w[k]
            sxx += x[k] * x[k]
            sxy += x[k] * y[k]
            sxw += x[k] * w[k]
            low, high = min(low, x[k]), max(high, x[k])
    mx, my, mw = sx / n, sy / n, sw / n
    spread = sxx - n * mx * mx
    ky = (sxy - n * mx * my) / spread if spread > LEAST_SPREAD else 0.0
    kw = (sxw - n * mx * mw) / spread if spread > LEAST_SPREAD else 0.0
    error = 0.0
    for k in range(len(x)):
        if member[k]:
            ey = y[k] - my - ky * (x[k] - mx)
            ew = w[k] - mw - kw * (x[k] - mx)
            error += ey * ey + ew * ew
    return mx, my, mw, ky, kw, math.sqrt(error / n), low, high


@njit(cache=True, nogil=True)
def fit_trimmed(x, y, w, member):  # type: ignore[no-untyped-def]
    """Fit, drop from ``member`` what lies far off, and fit again."""
    fit = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for attempt in range(2):
        if member.sum() < LEAST_POINTS:
            return fit
        fit = _fit_segment(x, y, w, member)
        if attempt == 0:
            mx, my, mw, ky, kw, rms, _, _ = fit
            limit = max(TRIM_SIGMAS * rms, LEAST_TRIM)
            for k in range(len(x)):
                if member[k]:
                    ey = y[k] - my - ky * (x[k] - mx)
                    ew = w[k] - mw - kw * (x[k] - mx)
                    if ey * ey + ew * ew > limit * limit:
                        member[k] = False
    return fit


@njit(cache=True, nogil=True)
def measure_filling(x, member, low, high, half):  # type: ignore[no-untyped-def]
    """Share of the parts between low and high that hold members, in a window of half a length."""
    step = max(half / PARTS, 1.0)
    num = max(int((high - low) / step), 1)
    filled = np.zeros(num, dtype=np.bool_)
    for k in range(len(x)):
        if member[k]:
            filled[min(int((x[k] - low) / max(high - low, 1e-9) * num), num - 1)] = True
    return filled.sum() / num


@njit(cache=True, nogil=True)
def measure_crowding(  # type: ignore[no-untyped-def]
    x, y, w, mx, my, mw, ky, kw, rms, low, high, apart
):
    """
    Share of the segment's parts that have points close about the axis, not only on it.

    Air surrounds a wire.  A plane that goes on beside the axis, such as a roof, has 0.6 times
    as many points between 1 and 1.6 radii as within one radius; a crown has 1.6 times as many.
    Points that are ``apart``, on other pieces, do not count: wires hang side by side.
    """
    inner = max(CORE_SIGMAS * rms, LEAST_CORE)
    outer = SHELL_RATIO * inner
    num = max(int((high - low) / CROWD_PART), 1)
    core = np.zeros(num)
    shell = np.zeros(num)
    for k in range(len(x)):
        if x[k] < low or x[k] > high:
            continue
        ey = y[k] - my - ky * (x[k] - mx)
        ew = w[k] - mw - kw * (x[k] - mx)
        r2 = ey * ey + ew * ew
        place = min(int((x[k] - low) / (high - low) * num), num - 1)
        if r2 <= inner * inner:
            core[place] += 1.0
        elif r2 <= outer * outer and not apart[k]:
            shell[place] += 1.0
    crowded = 0
    for place in range(num):
        if shell[place] > SHELL_SHARE * core[place] + SHELL_CHANCE:
            crowded += 1
    return crowded / num


@njit(cache=True, nogil=True)
def find_pieces(x, y, w, chosen, label, limit, half):  # type: ignore[no-untyped-def]
    """
    Find the clusters of one attempt that are long, filled and thin.

    Parameters
    ----------
    x, y, w, chosen, label, limit, half
        As of `judge_clusters`.

    Returns
    -------
    rows : (P, 8) float64
        Means of x, y, w, slopes in y and w, rms, least and greatest x of each piece.
    piece : (n,) int64
        Piece of each point, -1 none.
    too_thick : (n,) bool
        Points of clusters that are long and filled, and too thick for one conductor.

    """
    num = label.max() + 1 if len(label) else 0
    start = np.zeros(num + 1, dtype=np.int64)  # the points cluster by cluster
    for k in range(len(label)):
        if label[k] >= 0:
            start[label[k] + 1] += 1
    start = np.cumsum(start)
    place = start[:-1].copy()
    order = np.empty(start[num], dtype=np.int64)
    for k in range(len(label)):
        if label[k] >= 0:
            order[place[label[k]]] = chosen[k]
            place[label[k]] += 1
    rows = np.empty((num, 8))
    piece = np.full(len(x), -1, dtype=np.int64)
    too_thick = np.zeros(len(x), dtype=np.bool_)
    found = 0
    for c in range(num):
        own = order[start[c] : start[c + 1]]
        ox, member = x[own], np.ones(len(own), dtype=np.bool_)
        mx, my, mw, ky, kw, rms, low, high = fit_trimmed(ox, y[own], w[own], member)
        if member.sum() < LEAST_POINTS or high - low < MIN_REACH * half:
            continue
        if measure_filling(ox, member, low, high, half) < MIN_FILLING:
            continue
        if rms > limit:
            too_thick[own[member]] = True
            continue
        rows[found, 0], rows[found, 1], rows[found, 2], rows[found, 3] = mx, my, mw, ky
        rows[found, 4], rows[found, 5], rows[found, 6], rows[found, 7] = kw, rms, low, high
        piece[own[member]] = found
        found += 1
    return rows[:found], piece, too_thick


@njit(cache=True, nogil=True)
def find_apart(num, piece, owner):  # type: ignore[no-untyped-def]
    """
    Tell the points that crowd no piece: of segments, and of pieces where they are few.

    Parameters
    ----------
    num : int
        Pieces.
    piece, owner : (n,) int64
        Piece and segment of each point, -1 none.

    Returns
    -------
    (n,) bool

    """
    apart = owner >= 0
    if num <= MOST_BESIDE:
        apart |= piece >= 0
    return apart


@njit(cache=True, nogil=True)
def judge_clusters(  # type: ignore[no-untyped-def]
    x, y, w, chosen, label, limit, half, max_crowding, owner, too_thick, fits, found
):
    """
    Test the clusters of one attempt and keep the segments among them.

    Parameters
    ----------
    x, y, w : (n,) float64
        Points of the window, along, across and up [m].
    chosen, label : (m,) int64
        Points that were clustered, and their clusters, -1 noise.
    limit : float
        Greatest rms of a segment in this attempt [m].
    half : float
        Half the length of the window [m].
    max_crowding : float
        Greatest share of its parts of 3 m in which a segment may be crowded.
    owner : (n,) int64
        Segment of each point; those of new segments are set.
    too_thick : (n,) bool
        Replaced by the points of clusters that are too thick for one conductor.
    fits : (B, 8) float64
        As the rows of `find_pieces`; new rows are set.
    found : int
        Segments so far.

    Returns
    -------
    int
        Segments now.

    """
    rows, piece, thick = find_pieces(x, y, w, chosen, label, limit, half)
    put(thick, too_thick)
    # pieces have air about them, or each other
    apart = find_apart(len(rows), piece, owner)
    segment = np.full(len(rows) + 1, -1, dtype=np.int64)  # the last one for what is no piece
    for c in range(len(rows)):
        mx, my, mw, ky, kw, rms, low, high = rows[c]
        crowding = measure_crowding(x, y, w, mx, my, mw, ky, kw, rms, low, high, apart)
        if crowding <= max_crowding and found < len(fits):
            put(rows[c], fits[found])
            segment[c] = found
            found += 1
    for k in range(len(x)):
        if segment[piece[k]] >= 0:
            owner[k] = segment[piece[k]]
    return found
