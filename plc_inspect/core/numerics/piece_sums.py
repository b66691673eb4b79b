# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Least squares of any piece of tracks side by side: sums over the points before each cell.

A piece of a track is a parabola in z and a line in y; the sums of its points are the difference of
those before its two ends, so that each costs the same, however many points it holds.
"""

from numba import njit
import numpy as np

CELL = 0.5
"""
Breaks lie between cells of this length [m].
Source: judgement; not measured: `settle` and `_crossing` of `breaks` find the place within a cell.
"""
SUMS = 12
"""Sums of a cell, as `_solve` names them.  Source: numerical: what a parabola and a line take."""
BLOCK = 256
"""
Cells whose sums are about the middle of these.
Source: numerical: fourth powers about the middle of a track of 6 km leave nothing of a span's.
"""


@njit(cache=True, nogil=True, error_model='numpy')
def add_up(x, y, z, track):  # type: ignore[no-untyped-def]
    """
    Add up the points of each track before each cell, from the first cell of its block on.

    Those of powers of x are about the middle of the block; the first are the points of the whole
    track before the cell.
    """
    num = int(x.max() / CELL) + 1
    before = np.zeros((track.max() + 1, num + 1, SUMS))
    for k in range(len(x)):
        cell = int(x[k] / CELL)
        middle = (cell // BLOCK + 0.5) * BLOCK * CELL
        _add(before[track[k], cell + 1], x[k] - middle, y[k], z[k])
    for own in before:
        for cell in range(num):
            for m in range(SUMS if cell % BLOCK else 1):
                own[cell + 1, m] += own[cell, m]
    return before


@njit(cache=True, nogil=True, error_model='numpy')
def count_points(before, first, last):  # type: ignore[no-untyped-def]
    """Count the points of all tracks in some cells."""
    return before[:, last, 0].sum() - before[:, first, 0].sum()


@njit(cache=True, nogil=True, error_model='numpy')
def solve_all(before, first, last):  # type: ignore[no-untyped-def]
    """Return the squared error of all tracks in some cells."""
    model, error = np.empty(5), 0.0
    for own in before:
        error += solve(own, first, last, model)
    return error


@njit(cache=True, nogil=True, error_model='numpy')
def solve(before, first, last, model):  # type: ignore[no-untyped-def]
    """
    Least-squares parabola in z and line in y of the points of some cells.

    Sums are of 1, t, t2, t3, t4, z, zt, zt2, zz, y, yt, yy.  Returned is the squared error;
    ``model`` takes the three coefficients of the parabola and the two of the line, in x.
    """
    s0 = before[last, 0] - before[first, 0]
    if s0 <= 0.0:
        model[:] = 0.0
        return 0.0
    # moments about the middle of the piece, from those of the blocks that it lies in
    middle = 0.5 * (first + last) * CELL
    r1 = r2 = r3 = r4 = z0 = q1 = q2 = zz = y0 = p1 = yy = 0.0
    for block in range(first // BLOCK, (last - 1) // BLOCK + 1):
        start = max(first, block * BLOCK)
        left, right = before[start], before[min(last, (block + 1) * BLOCK)]
        less = 1.0 if start > block * BLOCK else 0.0  # its sums begin with the block
        d = (block + 0.5) * BLOCK * CELL - middle
        n, t1, t2 = right[0] - left[0], right[1] - less * left[1], right[2] - less * left[2]
        t3, t4 = right[3] - less * left[3], right[4] - less * left[4]
        r1 += t1 + d * n
        r2 += t2 + d * (2.0 * t1 + d * n)
        r3 += t3 + d * (3.0 * t2 + d * (3.0 * t1 + d * n))
        r4 += t4 + d * (4.0 * t3 + d * (6.0 * t2 + d * (4.0 * t1 + d * n)))
        v0, v1 = right[5] - less * left[5], right[6] - less * left[6]
        z0, q1 = z0 + v0, q1 + v1 + d * v0
        q2 += right[7] - less * left[7] + d * (2.0 * v1 + d * v0)
        zz += right[8] - less * left[8]
        u0 = right[9] - less * left[9]
        y0, p1 = y0 + u0, p1 + right[10] - less * left[10] + d * u0
        yy += right[11] - less * left[11]
    # and about the mean x of its points
    m = r1 / s0
    s2 = r2 - m * m * s0
    s3 = r3 - 3.0 * m * r2 + 2.0 * m**3 * s0
    s4 = r4 - 4.0 * m * r3 + 6.0 * m * m * r2 - 3.0 * m**4 * s0
    z1, z2, y1 = q1 - m * z0, q2 - 2.0 * m * q1 + m * m * z0, p1 - m * y0
    # z = a + b t + c (t2 - s2/s0): orthogonal but for b and c
    zc, s4 = z2 - s2 / s0 * z0, s4 - s2 * s2 / s0
    s2, s4 = s2 + 1e-9 * s0, s4 + 1e-9 * s0
    determinant = s2 * s4 - s3 * s3
    if determinant <= 0.0:
        model[:] = 0.0
        return np.inf
    b = (s4 * z1 - s3 * zc) / determinant
    c = (s2 * zc - s3 * z1) / determinant
    error = max(zz - z0 * z0 / s0 - b * z1 - c * zc, 0.0)
    slope = y1 / s2
    error += max(yy - y0 * y0 / s0 - slope * y1, 0.0)
    a = z0 / s0 - c * s2 / s0
    m += middle
    model[0], model[1], model[2] = a - b * m + c * m * m, b - 2.0 * c * m, c
    model[3], model[4] = y0 / s0 - slope * m, slope
    return error


@njit(cache=True, nogil=True, error_model='numpy')
def _add(s, t, y, z):  # type: ignore[no-untyped-def]
    """Add a point to the sums."""
    t2 = t * t
    s[0] += 1.0
    s[1] += t
    s[2] += t2
    s[3] += t2 * t
    s[4] += t2 * t2
    s[5] += z
    s[6] += z * t
    s[7] += z * t2
    s[8] += z * z
    s[9] += y
    s[10] += y * t
    s[11] += y * y
