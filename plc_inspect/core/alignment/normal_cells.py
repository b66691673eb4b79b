# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The reference map that checks poses: cells with the normal distribution of the first points seen.

Source: Biber and Strasser 2003, The normal distributions transform.  A cell collects points for a
few seconds and is then closed, so later points are compared with the first ones, and a slow drift
does not shift its own reference.
"""

from numba import njit
import numpy as np

from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.numerics.hash_table import enter, find_slot, index_keys, make_table, UInt32
from plc_inspect.core.numerics.voxels import add_moments
from plc_inspect.results import Float64, Int32, Int64

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
NOISE = 0.05
"""
Standard deviation of a point, in addition to that of its cell [m].
Source: derived: 0.03 m of range, and 0.05 degrees of attitude at 40 m.
"""
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
MOST_CELLS = 1_000_000
"""Most cells; beyond, the farther half is dropped.  Source: numerical: 112 MB."""
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
_BITS = 21
"""Bits of a key per axis.  Source: numerical: three in 64."""
_HALF = 1 << (_BITS - 1)
"""Cells on each side of the first point.  Source: numerical: half of what _BITS hold."""
_NONE = 1e300
"""Squared distance where there is no cell.  Source: numerical."""


class NormalCells:
    """Cells of the first points seen, in the map frame; not thread-safe."""

    def __init__(self) -> None:
        self.clear()

    def __len__(self) -> int:
        """Return the number of cells."""
        return self._num

    def clear(self) -> None:
        """Remove all cells."""
        self._origin: Float64 | None = None
        self._num = self._newest = 0
        self._make_room(1 << 12)

    def _make_room(self, capacity: int) -> None:
        self._keys: Int64 = np.zeros(capacity, dtype=np.int64)
        self._sums: Float64 = np.zeros((capacity, 9))
        self._counts: Int32 = np.zeros((capacity, 2), dtype=np.int32)
        self._times: Int64 = np.zeros((capacity, 2), dtype=np.int64)
        self._table: UInt32 = make_table(capacity)

    def add(self, points: Float64, stamp_ns: int) -> None:
        """
        Add a batch of points.

        Parameters
        ----------
        points : Float64
            (N, 3) map frame [m].
        stamp_ns : int
            Of the batch [ns].

        """
        if not len(points):
            return
        self._follow_time(stamp_ns)
        if self._origin is None:
            self._origin = np.floor(points[0])
        if self._num >= MOST_CELLS:
            self._forget_far(points[0] - self._origin)
        if self._num + len(points) > len(self._keys):
            self._grow(self._num + len(points))
        self._num = _add(
            np.ascontiguousarray(points - self._origin), stamp_ns, self._keys, self._sums,
            self._counts, self._times, self._table, self._num,
        )

    def _follow_time(self, stamp_ns: int) -> None:
        """Close all cells where time went back, as they are from before."""
        if stamp_ns < self._newest - OPEN_NS:
            times = self._times[: self._num]
            np.minimum(times[:, 0], stamp_ns - OPEN_NS - 1, out=times[:, 0])
        self._newest = stamp_ns

    def _grow(self, least: int) -> None:
        old = self._keys, self._sums, self._counts, self._times
        self._copy(old, np.arange(self._num), max(2 * len(self._keys), least))

    def _forget_far(self, place: Float64) -> None:
        centers = _unpack(self._keys[: self._num]) * CELL
        apart = ((centers[:, :2] - place[:2]) ** 2).sum(axis=1)
        kept = np.sort(np.argsort(apart, kind='stable')[: MOST_CELLS // 2])
        old = self._keys, self._sums, self._counts, self._times
        self._copy(old, kept, len(self._keys))

    def _copy(self, old: tuple[Int64, Float64, Int32, Int64], kept: Int64, room: int) -> None:
        self._make_room(room)
        num = self._num = len(kept)
        self._keys[:num], self._sums[:num] = old[0][kept], old[1][kept]
        self._counts[:num], self._times[:num] = old[2][kept], old[3][kept]
        self._table = index_keys(self._keys[:num], room)

    def compare(
        self, points: Float64, move: RigidMove, stamp_ns: int, reach: int, noise: float = NOISE
    ) -> tuple[Float64, Float64, int, int, float]:
        """
        Compare moved points with the cells.

        Parameters
        ----------
        points : Float64
            (N, 3) frame of the odometry [m].
        move : RigidMove
            Moves them into the map frame.
        stamp_ns : int
            Time of the points [ns]; open cells do not count.
        reach : int
            Number of neighbouring cells searched on each side.
        noise : float
            Standard deviation of a point beside that of its cell [m].

        Returns
        -------
        matrix : Float64
            (4, 4) normal matrix of a small shift along x, y and z [1/m2] and turn [1/rad2].
        slope : Float64
            (4,) right-hand side.
        matched, fitting : int
            Number of points with a cell, and of those that fit it.
        age : float
            Mean age of the cells of the fitting points [s].

        """
        origin, keys, sums, counts, times, table = self.tables(stamp_ns)
        matrix, slope, matched, fitting, age = compare_cells(
            move.apply(points) - origin, move.centre + move.shift - origin, keys, sums, counts,
            times, table, stamp_ns, reach, noise * noise,
        )
        return matrix, slope, int(matched), int(fitting), age * 1e-9 / max(fitting, 1)

    def tables(self, stamp_ns: int) -> tuple[Float64, Int64, Float64, Int32, Int64, UInt32]:
        """Return the origin (3,) [m], and what kernels compare points of a time [ns] with."""
        self._follow_time(stamp_ns)
        origin = np.zeros(3) if self._origin is None else self._origin
        return origin, self._keys, self._sums, self._counts, self._times, self._table


@njit(cache=True, nogil=True, inline='always')
def _pack(i, j, k):  # type: ignore[no-untyped-def]
    return ((i + _HALF) << (2 * _BITS)) | ((j + _HALF) << _BITS) | (k + _HALF)


def _unpack(keys: Int64) -> Float64:
    mask = (1 << _BITS) - 1
    parts = [(keys >> shift) & mask for shift in (2 * _BITS, _BITS, 0)]
    result: Float64 = np.column_stack(parts).astype(np.float64) - _HALF + 0.5
    return result


@njit(cache=True, nogil=True)
def _add(points, stamp, keys, sums, counts, times, table, num):  # type: ignore[no-untyped-def]
    """Add points to open cells, and return the number of cells."""
    for n in range(len(points)):
        i = np.int64(np.floor(points[n, 0] / CELL))
        j = np.int64(np.floor(points[n, 1] / CELL))
        k = np.int64(np.floor(points[n, 2] / CELL))
        if max(abs(i), abs(j), abs(k)) >= _HALF - 2:
            continue
        # the cell of the point, a new one where there is none
        key = _pack(i, j, k)
        slot = find_slot(key, table, keys)
        if slot < 0:
            slot = np.int64(num)
            keys[slot] = key
            times[slot, 0] = stamp
            times[slot, 1] = -1
            enter(key, slot, table)
            num += 1
        if stamp - times[slot, 0] > OPEN_NS:
            continue
        # looks are scans that saw it
        if times[slot, 1] != stamp:
            times[slot, 1] = stamp
            counts[slot, 1] += 1
        counts[slot, 0] += 1
        # sums and products about the middle of the cell
        x = points[n, 0] - (i + 0.5) * CELL
        y = points[n, 1] - (j + 0.5) * CELL
        z = points[n, 2] - (k + 0.5) * CELL
        add_moments(sums[slot], 0, x, y, z)
    return num


@njit(cache=True, nogil=True)
def compare_cells(points, about, keys, sums, counts, times, table, stamp, reach, floor):  # type: ignore[no-untyped-def]
    """
    Compare points, and the centre of their turn, from the origin on with the cells about them.

    Returned are the normal equations of moving the points onto the cells, how many points have a
    cell, how many fit it, and the sum of the ages of their cells [ns].
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
        if max(abs(ci), abs(cj), abs(ck)) >= _HALF - 2:
            continue
        # the cell that the point fits best
        best, bx, by, bz, first, trust = _NONE, 0.0, 0.0, 0.0, stamp, 1.0
        for i in range(ci - reach, ci + reach + 1):
            for j in range(cj - reach, cj + reach + 1):
                for k in range(ck - reach, ck + reach + 1):
                    slot = find_slot(_pack(i, j, k), table, keys)
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
                        trust = THICK_WEIGHT if thick else 1.0
                        for p in range(3):
                            for q in range(p, 3):
                                best_inverse[p, q] = best_inverse[q, p] = scale * inverse[p, q]
        if best >= _NONE:
            continue
        matched += 1
        if best <= NEAR_ENOUGH:
            fitting += 1
            age += stamp - first
        # what fits badly weighs little (Geman and McClure)
        weight = trust * (ROBUST / (ROBUST + best)) ** 2
        # derivative by the turn about the vertical through the centre
        ux, uy = -(y - about[1]), x - about[0]
        # the square of the inverse over its trace holds across a plane or line, and hardly along
        # it, where the points end with the cell or with what is seen
        scale = weight / (best_inverse[0, 0] + best_inverse[1, 1] + best_inverse[2, 2])
        for p in range(3):
            for q in range(3):
                weighted[p, q] = scale * (
                    best_inverse[p, 0] * best_inverse[0, q]
                    + best_inverse[p, 1] * best_inverse[1, q]
                    + best_inverse[p, 2] * best_inverse[2, q]
                )
            weighted[p, 3] = weighted[p, 0] * ux + weighted[p, 1] * uy
        # normal equations of the shift and the turn
        for q in range(4):
            for p in range(3):
                matrix[p, q] += weighted[p, q]
            matrix[3, q] += ux * weighted[0, q] + uy * weighted[1, q]
        for p in range(3):
            slope[p] -= weighted[p, 0] * bx + weighted[p, 1] * by + weighted[p, 2] * bz
        slope[3] -= weighted[0, 3] * bx + weighted[1, 3] * by + weighted[2, 3] * bz
    return matrix, slope, matched, fitting, age
