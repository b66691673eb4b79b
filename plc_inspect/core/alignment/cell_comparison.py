# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare points with the reference cells: the normal equations of moving them onto the cells.

Only what is told across planes and lines counts.  Along a row of conductors nothing is, and what
is left of it there, by chance, would let the map slide.
"""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.hash_table import find_slot

CELL = 1.0
"""
Edge of a cell [m].
Source: judgement: conductors of one line are farther apart, poles are thinner.
"""
OPEN_NS = 2_000_000_000
"""
Time during which a cell takes points [ns].
Source: measured: bench/studies/odometry_faults.py: with 3 s drift of 10 cm/s at take-off showed
seconds later, and doubled wires; 1 cm/s of drift makes 0.02 m of it.
"""
LEAST_LOOKS = 3
"""
Least number of batches that saw a cell before it counts: arcs of one scan on the ground look like
wires.
Source: derived: three arcs fill a plane.
"""
LEAST_POINTS = 8
"""Least number of points before a cell counts.  Source: judgement; not measured."""
PASS_NS = 10_000_000_000
"""
Age of cells up to which the other side of what they hold is left out [ns].
Source: as AGAIN of steady_errors: within a pass sides always change in the same order, as a drift
would; on the way back the other side is better than nothing (bench/studies/odometry_faults.py:
maps are doubled by 0.12 m in place of 0.17 m).
"""
NUM_SUMS, VIEWER = 12, 9
"""
Sums kept of a cell: of its points, and of their products; then where the vehicle was when it was
seen first.
Source: derived: three, six and three.
"""
BITS = 21
"""Bits of a key per axis.  Source: numerical: three in 64."""
HALF = 1 << (BITS - 1)
"""Cells on each side of the first point.  Source: numerical: half of what BITS hold."""
THIN = 0.1
"""
Greatest standard deviation of a cell's points across its plane or line [m]; above it the cell is
thick.
Source: measured: bench/studies/odometry_faults.py: ground, walls, poles and conductors give 0.03
to 0.08 m.
"""
THICK_WEIGHT = 0.05
"""
Weight of points in thick cells: the visible part of a crown moves with the vehicle.
Source: measured: bench/studies/odometry_faults.py: with weight 1 good odometry was moved by 0.2 m
in 6 s; so many points together tell the place of a cell to about its thickness.
"""
ROBUST = 9.0
"""
Squared Mahalanobis distance at which a point has a quarter of its weight.
Source: judgement.
"""
NEAR_ENOUGH = 11.3
"""
Greatest squared Mahalanobis distance at which a point fits.
Source: derived: chi squared of three degrees of freedom, 99 %.
"""
SKEW = 0.01
"""
Share of what is told across the planes and lines of cells that errors of their directions make of
nothing along them.
Source: derived: the square of 0.1 rad, of eight points to 0.05 m along half a metre; measured:
bench/accuracy.py: with 0 the flights of valley and high_voltage were moved by metres along wires.
"""
_NONE = 1e300
"""Squared distance where there is no cell.  Source: numerical."""


@njit(cache=True, nogil=True, inline='always')
def pack(i, j, k):  # type: ignore[no-untyped-def]
    """Return the key of a cell."""
    return ((i + HALF) << (2 * BITS)) | ((j + HALF) << BITS) | (k + HALF)


@njit(cache=True, nogil=True)
def compare_cells(  # type: ignore[no-untyped-def]
    points, about, keys, sums, counts, times, table, stamp, reach, floor, within,
):
    """
    Compare points, and the centre of their turn, from the origin on with the cells about them.

    Returned are the normal equations of moving the points onto the cells, how many points have a
    cell, how many fit it, and the sum of the ages of their cells [ns].  The other side of what
    cells hold that are younger than ``within`` [ns] is left out.
    """
    matrix, slope = np.zeros((4, 4)), np.zeros(4)
    inverse = np.zeros((3, 3))
    weighted = np.zeros((3, 4))
    best_inverse = np.zeros((3, 3))
    matched, fitting, age = 0, 0, 0.0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        ci = np.int64(np.floor(x / CELL))
        cj = np.int64(np.floor(y / CELL))
        ck = np.int64(np.floor(z / CELL))
        if max(abs(ci), abs(cj), abs(ck)) >= HALF - 2:
            continue
        # the cell that the point fits best
        best, bx, by, bz, first, trust, seen = _NONE, 0.0, 0.0, 0.0, stamp, 1.0, 0
        for i in range(ci - reach, ci + reach + 1):
            for j in range(cj - reach, cj + reach + 1):
                for k in range(ck - reach, ck + reach + 1):
                    slot = find_slot(pack(i, j, k), table, keys)
                    if slot < 0 or counts[slot, 0] < LEAST_POINTS:
                        continue
                    if counts[slot, 1] < LEAST_LOOKS or stamp - times[slot, 0] <= OPEN_NS:
                        continue
                    # mean and covariance of its points
                    row, share = sums[slot], 1.0 / counts[slot, 0]
                    mx, my, mz = row[0] * share, row[1] * share, row[2] * share
                    a = row[3] * share - mx * mx
                    b = row[4] * share - mx * my
                    c = row[5] * share - mx * mz
                    d = row[6] * share - my * my
                    e = row[7] * share - my * mz
                    f = row[8] * share - mz * mz
                    # 1 over the sum of 1 / eigenvalue is about the least one of what is thin
                    minors = a * d - b * b + a * f - c * c + d * f - e * e
                    volume = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
                    thick = volume > THIN * THIN * minors
                    a, d, f = a + floor, d + floor, f + floor
                    # inverse of the symmetric matrix
                    inverse[0, 0] = d * f - e * e
                    inverse[0, 1] = c * e - b * f
                    inverse[0, 2] = b * e - c * d
                    inverse[1, 1] = a * f - c * c
                    inverse[1, 2] = b * c - a * e
                    inverse[2, 2] = a * d - b * b
                    scale = 1.0 / (a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2])
                    # Mahalanobis distance of the point, squared
                    rx = x - ((i + 0.5) * CELL + mx)
                    ry = y - ((j + 0.5) * CELL + my)
                    rz = z - ((k + 0.5) * CELL + mz)
                    square = scale * (
                        inverse[0, 0] * rx * rx + inverse[1, 1] * ry * ry
                        + inverse[2, 2] * rz * rz + 2.0 * (
                            inverse[0, 1] * rx * ry + inverse[0, 2] * rx * rz
                            + inverse[1, 2] * ry * rz
                        )
                    )
                    if square < best:
                        best, bx, by, bz, first = square, rx, ry, rz, times[slot, 0]
                        seen = slot
                        trust = THICK_WEIGHT if thick else 1.0
                        for p in range(3):
                            for q in range(p, 3):
                                best_inverse[p, q] = best_inverse[q, p] = scale * inverse[p, q]
        if best >= _NONE or (
            stamp - first < within and _is_other_side(sums[seen], best_inverse, x, y, z, about)
        ):
            continue
        matched += 1
        if best <= NEAR_ENOUGH:
            fitting += 1
            age += stamp - first
        # what fits badly weighs little (Geman and McClure)
        weight = trust * (ROBUST / (ROBUST + best)) ** 2
        # derivative by the turn about the vertical through the centre
        ux, uy = -(y - about[1]), x - about[0]
        # the third power of the inverse over the square of its trace holds across a plane or line,
        # and not along it, where the points end with the cell or with what is seen
        scale = 1.0 / (best_inverse[0, 0] + best_inverse[1, 1] + best_inverse[2, 2])
        _multiply(best_inverse, best_inverse, scale, inverse)
        _multiply(inverse, best_inverse, weight * scale, weighted)
        for p in range(3):
            weighted[p, 3] = weighted[p, 0] * ux + weighted[p, 1] * uy
        # normal equations of the shift and the turn
        for q in range(4):
            for p in range(3):
                matrix[p, q] += weighted[p, q]
            matrix[3, q] += ux * weighted[0, q] + uy * weighted[1, q]
        for p in range(3):
            slope[p] -= weighted[p, 0] * bx + weighted[p, 1] * by + weighted[p, 2] * bz
        slope[3] -= weighted[0, 3] * bx + weighted[1, 3] * by + weighted[2, 3] * bz
    _weigh_down(matrix, slope)
    return matrix, slope, matched, fitting, age


@njit(cache=True, nogil=True, inline='always')
def _is_other_side(row, inverse, x, y, z, about):  # type: ignore[no-untyped-def]
    """
    Tell whether a point is of the other side of what a cell holds, seen from where it was.

    A pole or the leg of a tower that the vehicle passes is seen from before and from behind; what
    lies between both sides would be taken for drift.
    """
    here = about[0] - x, about[1] - y, about[2] - z
    then = row[VIEWER] - x, row[VIEWER + 1] - y, row[VIEWER + 2] - z
    dot = 0.0
    for p in range(3):
        for q in range(3):
            dot += here[p] * inverse[p, q] * then[q]
    return dot < 0.0


@njit(cache=True, nogil=True, inline='always')
def _multiply(first, second, scale, result):  # type: ignore[no-untyped-def]
    """Set the first three columns of a result to the product of two matrices, scaled."""
    for p in range(3):
        for q in range(3):
            result[p, q] = scale * (
                first[p, 0] * second[0, q] + first[p, 1] * second[1, q]
                + first[p, 2] * second[2, q]
            )


@njit(cache=True, nogil=True)
def _weigh_down(matrix, slope):  # type: ignore[no-untyped-def]
    """
    Weigh down, in normal equations of shift and turn, the directions of which hardly any is told.

    Each eigenvalue of the shift gets the share that it has of itself and what the cells' errors
    make of the others: along a row of conductors all that is told may be of that.
    """
    false = SKEW * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2])
    if false <= 0.0:
        return
    a, b, c = matrix[0, 0] + false, matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1] + false, matrix[1, 2], matrix[2, 2] + false
    share = np.eye(4)
    inverse = np.empty((3, 3))
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    inverse[0, 1] = inverse[1, 0] = c * e - b * f
    inverse[0, 2] = inverse[2, 0] = b * e - c * d
    inverse[1, 2] = inverse[2, 1] = b * c - a * e
    scale = false / (a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2])
    for p in range(3):
        for q in range(3):
            share[p, q] -= scale * inverse[p, q]
    # both sides of the matrix, one side of the slope
    told, right = matrix.copy(), slope.copy()
    for p in range(4):
        slope[p] = 0.0
        for q in range(4):
            slope[p] += share[p, q] * right[q]
            matrix[p, q] = 0.0
            for k in range(4):
                for m in range(4):
                    matrix[p, q] += share[p, k] * told[k, m] * share[m, q]
