# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Conductors side by side, seen along the direction in which all their points lie sharpest.

Wires of a rack hang 0.3 to 0.5 m apart, and those that return few points tell little of their
direction; but all of them run alike and sag alike.  Turned by that, each is a dot.
"""

import math

from numba import njit
import numpy as np

from plc_inspect.core.numerics.arrays import count_bits

MOST_TURN, MOST_RISE, MOST_BEND = 0.02, 0.08, 0.013
"""
Greatest errors of the azimuth and slope of a window that are looked for [m/m], and the greatest
curvature of a conductor [1/m].
Source: derived: a curve that runs 0.3 m to the next wire of a rack and back within 8 m; the
curvature of a constant of 77 m, as the least that proves a conductor, `evidence/validation.py`.
"""
STEPS, BEND_STEP, FINER = (0.01, 0.0025), 0.0015, 3
"""
Steps of slope and azimuth, first over all of them and then about the sharpest [m/m], the first
step of the curvature [1/m], and by how much the second is finer.
Source: numerical: 5 to 10 cm at the end of a window of 10 m to both sides, and then a quarter.
"""
CELLS = (0.1, 0.08)
"""
Edges of the cells of the cross-section whose pairs of points tell how sharp these lie [m].
Source: derived: twice the scatter of a conductor's points.
"""
TABLE = 64
"""Rows and columns of the table of cells, which repeats beyond.  Source: numerical."""
DOT = 0.1
"""
Radius of a dot in which its middle is looked for [m].
Source: derived: two standard deviations of a conductor's points, and a third of the least distance
between the wires of a rack.
"""
DOT_RATIO = 1.41
"""
Radius up to which points are of it, by that.
Source: derived: almost three standard deviations, and half the distance to the next wire.
"""
PIECE = 0.5
"""Length of the pieces that a dot is seen in or not [m].  Source: numerical."""
DOT_SHARE, LEAST_POINTS = 0.3, 8
"""
Share of the pieces of a window in which a conductor's dot has points, and its points, at least.
Source: measured: wires of racks with 2 to 5 points a metre (random scenes, any 362019, 368030 and
370039); a pole or a crown beside them has points in few pieces of a dot.
"""
MOST_DOTS = 8
"""
Dots that are looked for, at most.
Source: measured: in windows along racks there are 7 at most (eleven random scenes of 362019 to
371038), along the rows of a wall 10 (clean 374004).
"""
BITS = 62
"""Pieces that are told apart, at most.  Source: numerical: bits of an integer."""


@njit(cache=True, nogil=True, error_model='numpy')
def sharpen(x, y, w, bend):  # type: ignore[no-untyped-def]
    """
    Take out of a window the direction and bend along which its points lie sharpest.

    Parameters
    ----------
    x, y, w : (n,) float64
        Points along a curve from the middle of the window on, aside of it and above it [m].
    bend : float
        Curvature of that curve [1/m].

    Returns
    -------
    y, w : (n,) float64
        Aside and above [m].

    """
    none = np.zeros(1)
    bends = BEND_STEP * np.arange(round(max(MOST_BEND, bend) / BEND_STEP) + 1.0) - bend
    best = (0.0, 0.0, 0.0)
    # slope and bend of all, their azimuth, and slope and bend more finely
    best = _try_all(x, y, w, best, none, _list_steps(MOST_RISE, STEPS[0]), bends, CELLS[0])
    best = _try_all(x, y, w, best, _list_steps(MOST_TURN, STEPS[1]), none, none, CELLS[1])
    bends = _list_steps(BEND_STEP, BEND_STEP / FINER)
    best = _try_all(x, y, w, best, none, _list_steps(STEPS[0], STEPS[1]), bends, CELLS[1])
    turn, rise, more = best
    return y - turn * x, w - rise * x - 0.5 * more * x * x


@njit(cache=True, nogil=True, error_model='numpy')
def _list_steps(most, step):  # type: ignore[no-untyped-def]
    """List multiples of a step from -most to most."""
    num = round(most / step)
    return step * np.arange(-num, num + 1.0)


@njit(cache=True, nogil=True, error_model='numpy')
def _try_all(x, y, w, best, turns, rises, bends, cell):  # type: ignore[no-untyped-def]
    """Return the sharpest of turns, rises and bends that are added to the best ones so far."""
    table = np.empty((TABLE, TABLE), dtype=np.int32)
    found = best
    most = _count_pairs(x, y, w, best[0], best[1], best[2], cell, table)
    for turn in turns:
        for rise in rises:
            for bend in bends:
                tried = (best[0] + turn, best[1] + rise, best[2] + bend)
                pairs = _count_pairs(x, y, w, tried[0], tried[1], tried[2], cell, table)
                if pairs > most:
                    most, found = pairs, tried
    return found


@njit(cache=True, nogil=True, error_model='numpy')
def _count_pairs(x, y, w, turn, rise, bend, cell, table):  # type: ignore[no-untyped-def]
    """Count the pairs of points in one cell of the cross-section."""
    table[:] = 0
    pairs = 0
    for k in range(len(x)):
        i = math.floor((y[k] - turn * x[k]) / cell) & (TABLE - 1)
        j = math.floor((w[k] - rise * x[k] - 0.5 * bend * x[k] * x[k]) / cell) & (TABLE - 1)
        pairs += table[i, j]
        table[i, j] += 1
    return pairs


@njit(cache=True, nogil=True, error_model='numpy')
def find_dots(x, y, w, half):  # type: ignore[no-untyped-def]
    """
    Find the dots of a window: what is seen all along it within a few centimetres.

    Parameters
    ----------
    x, y, w : (n,) float64
        Points along, aside and above [m], as of `sharpen`.
    half : float
        Half the length of the window [m].

    Returns
    -------
    (n,) int64
        The dot of each point, the one in most pieces first; -1 none.

    """
    num, length = len(x), max(PIECE, 2.0 * half / BITS)
    if num == 0:
        return np.empty(0, dtype=np.int64)
    least = max(DOT_SHARE * math.floor(2.0 * half / length), 1.0)
    order = np.argsort(w)
    y, w = y[order], w[order]
    piece = np.empty(num, dtype=np.int64)
    for k in range(num):
        place = math.floor((x[order[k]] + half) / length)
        piece[k] = np.int64(1) << min(max(place, 0), BITS)
    dot = np.full(num, -1, dtype=np.int64)
    seen, count = np.empty(num, dtype=np.int64), np.empty(num, dtype=np.int64)
    for k in range(num):
        seen[k], count[k] = _look_about(y, w, piece, dot, k)
    for found in range(MOST_DOTS):
        middle = 0
        for k in range(1, num):
            if (seen[k], count[k]) > (seen[middle], count[middle]):
                middle = k
        if seen[middle] < least or count[middle] < LEAST_POINTS:
            break
        aside, above = _settle(y, w, dot, y[middle], w[middle])
        seen[middle] = 0  # whatever it settled to
        first, last = _find_rows(w, above, DOT_RATIO * DOT)
        for j in range(first, last):
            if dot[j] < 0 and _is_within(aside - y[j], above - w[j], DOT_RATIO * DOT):
                dot[j], seen[j] = found, 0
        first, last = _find_rows(w, above, (1.0 + DOT_RATIO) * DOT)
        for k in range(first, last):
            if seen[k] > 0:
                seen[k], count[k] = _look_about(y, w, piece, dot, k)
    result = np.empty(num, dtype=np.int64)
    result[order] = dot
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _find_rows(w, above, reach):  # type: ignore[no-untyped-def]
    """Return the first, and beyond the last, of ascending heights within reach of one."""
    return np.searchsorted(w, above - reach), np.searchsorted(w, above + reach, side='right')


@njit(cache=True, nogil=True, error_model='numpy')
def _look_about(y, w, piece, dot, k):  # type: ignore[no-untyped-def]
    """Count the pieces and points about a point that are of no dot."""
    pieces, count = np.int64(0), 0
    first, last = _find_rows(w, w[k], DOT)
    for j in range(first, last):
        if dot[j] < 0 and _is_within(y[k] - y[j], w[k] - w[j], DOT):
            pieces |= piece[j]
            count += 1
    return count_bits(pieces), count


@njit(cache=True, nogil=True, error_model='numpy')
def _settle(y, w, dot, aside, above):  # type: ignore[no-untyped-def]
    """Move a dot to the middle of the points about it that are of no other."""
    for _ in range(3):
        sum_y = sum_w = 0.0
        count = 0
        first, last = _find_rows(w, above, DOT)
        for j in range(first, last):
            if dot[j] < 0 and _is_within(aside - y[j], above - w[j], DOT):
                sum_y += y[j]
                sum_w += w[j]
                count += 1
        if count == 0:
            break
        aside, above = sum_y / count, sum_w / count
    return aside, above


@njit(cache=True, nogil=True, error_model='numpy', inline='always')
def _is_within(y, w, radius):  # type: ignore[no-untyped-def]
    return y * y + w * w <= radius * radius
