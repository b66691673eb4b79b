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

from plc_inspect.core.alignment.cell_comparison import (
    BITS,
    CELL,
    compare_cells,
    HALF,
    NUM_SUMS,
    OPEN_NS,
    pack,
    PASS_NS,
    VIEWER,
)
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.numerics.hash_table import enter, find_slot, index_keys, make_table, UInt32
from plc_inspect.core.numerics.voxels import add_moments
from plc_inspect.results import Float64, Int32, Int64

NOISE = 0.05
"""
Standard deviation of a point, in addition to that of its cell [m].
Source: derived: 0.03 m of range, and 0.05 degrees of attitude at 40 m.
"""
MOST_CELLS = 1_000_000
"""Most cells; beyond, the farther half is dropped.  Source: numerical: 112 MB."""


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
        self._sums: Float64 = np.zeros((capacity, NUM_SUMS))
        self._counts: Int32 = np.zeros((capacity, 2), dtype=np.int32)
        self._times: Int64 = np.zeros((capacity, 2), dtype=np.int64)
        self._table: UInt32 = make_table(capacity)

    def add(self, points: Float64, stamp_ns: int, place: Float64 | None = None) -> None:
        """
        Add a batch of points.

        Parameters
        ----------
        points : Float64
            (N, 3) map frame [m].
        stamp_ns : int
            Of the batch [ns].
        place : Float64 or None
            (3,) of the vehicle, map frame [m]; None where it is not known.

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
        viewer = np.full(3, np.nan) if place is None else place - self._origin
        self._num = _add(
            np.ascontiguousarray(points - self._origin), viewer, stamp_ns, self._keys, self._sums,
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
        self, points: Float64, move: RigidMove, stamp_ns: int, reach: int, noise: float = NOISE,
        within: int = PASS_NS,
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
        within : int
            Age of cells up to which the other side of what they hold is left out [ns].

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
            times, table, stamp_ns, reach, noise * noise, within,
        )
        return matrix, slope, int(matched), int(fitting), age * 1e-9 / max(fitting, 1)

    def tables(self, stamp_ns: int) -> tuple[Float64, Int64, Float64, Int32, Int64, UInt32]:
        """Return the origin (3,) [m], and what kernels compare points of a time [ns] with."""
        self._follow_time(stamp_ns)
        origin = np.zeros(3) if self._origin is None else self._origin
        return origin, self._keys, self._sums, self._counts, self._times, self._table


def _unpack(keys: Int64) -> Float64:
    mask = (1 << BITS) - 1
    parts = [(keys >> shift) & mask for shift in (2 * BITS, BITS, 0)]
    result: Float64 = np.column_stack(parts).astype(np.float64) - HALF + 0.5
    return result


@njit(cache=True, nogil=True)
def _add(points, viewer, stamp, keys, sums, counts, times, table, num):  # type: ignore[no-untyped-def]
    """Add points to open cells, and return the number of cells."""
    for n in range(len(points)):
        i = np.int64(np.floor(points[n, 0] / CELL))
        j = np.int64(np.floor(points[n, 1] / CELL))
        k = np.int64(np.floor(points[n, 2] / CELL))
        if max(abs(i), abs(j), abs(k)) >= HALF - 2:
            continue
        # the cell of the point, a new one where there is none
        key = pack(i, j, k)
        slot = find_slot(key, table, keys)
        if slot < 0:
            slot = np.int64(num)
            keys[slot] = key
            times[slot, 0] = stamp
            times[slot, 1] = -1
            sums[slot, VIEWER:] = viewer
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
