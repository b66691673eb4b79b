# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The global map: hashed voxels that keep the mean of their points, not the points.

A voxel stores its key, number of points, mean offset from its centre, label and the next voxel of
its plan cell: 34 bytes with its entry in the stack of free slots and its changes, and 8 to 16
bytes of hash table.  A mean, not a sum, keeps float32 precise however often the voxel is hit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plc_inspect.config import MapSettings
from plc_inspect.core.voxel_buffer.cell_index import CellIndex
from plc_inspect.core.voxel_buffer.change_flags import LABELLED
from plc_inspect.core.voxel_buffer.voxel_arrays import allocate_voxels
from plc_inspect.core.voxel_buffer.voxel_changes import copy_changes, StoredMap, VoxelChanges
from plc_inspect.core.voxel_buffer.voxel_hash import accumulate_points, fill_table
from plc_inspect.core.voxel_buffer.voxel_keys import (
    find_centroids,
    KEY_HALF_RANGE,
    lie_within,
    locate_voxels,
    order_by_tile,
)
from plc_inspect.errors import DataError
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64, UInt8

INITIAL_CAPACITY = 1 << 16
"""
Initial capacity, in voxels.
Source: numerical: the room doubles whenever it is full.
"""
MOST_INDEX = 2**52
"""
Greatest voxel index of the first point, in absolute value.
Source: numerical: beyond, a double cannot tell the centre of a voxel from its edge.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Insertion:
    """Result of ``VoxelMap.insert``."""

    sequence: int
    """Number of this insertion, from 1."""
    num_points: int
    """Points added to the map."""
    num_new: int
    """Voxels created."""
    num_refused: int
    """Points left out, as they would have needed a voxel beyond ``max_voxels``."""


class VoxelMap:
    """
    A map of voxels with a hard cap; owned by one thread.

    The grid is fixed to multiples of ``voxel_size``, so that voxels do not depend on the first
    point.  Each insertion assigns slots tile by tile, and within a tile in the order of its
    points: voxels near each other are neighbours in memory, and the same insertions give the same
    arrays.

    Parameters
    ----------
    settings : MapSettings
        All of them are used.

    """

    def __init__(self, settings: MapSettings) -> None:
        self._voxel_size = settings.voxel_size
        self._max_voxels = settings.max_voxels
        self._min_points = settings.min_points
        self._sequence = 0
        self.generation = 0
        """Number of times that the map was cleared."""
        self._set_empty(min(INITIAL_CAPACITY, self._max_voxels))

    def _set_empty(self, capacity: int) -> None:
        self._size = 0
        self._num_free = 0
        self._origin: Int64 | None = None
        self.cells = CellIndex(self._voxel_size)
        """Plan cells of the voxels."""
        self._voxels = allocate_voxels(capacity)

    def __len__(self) -> int:
        """Return the number of occupied voxels."""
        return self._size - self._num_free

    @property
    def num_slots(self) -> int:
        """Slots that were ever in use; some of them may be free."""
        return self._size

    @property
    def max_voxels(self) -> int:
        """Hard cap of occupied voxels."""
        return self._max_voxels

    @property
    def sequence(self) -> int:
        """Number of the newest insertion, 0 before the first."""
        return self._sequence

    @property
    def origin(self) -> Int64 | None:
        """(3,) voxel index of the origin of the keys, None while the map is empty."""
        return self._origin

    @property
    def nbytes(self) -> int:
        """Memory of the voxels in use and of the hash table [bytes]."""
        return sum(
            array[: self._size].nbytes for array in self._voxels.columns
        ) + self._voxels.table.nbytes

    def configure(self, settings: MapSettings) -> None:
        """Use another ``min_points``; the other settings are structural."""
        self._min_points = settings.min_points

    def clear(self) -> None:
        """Forget all voxels; the sequence goes on."""
        self.generation += 1
        self._set_empty(self._voxels.capacity)

    def reserve(self, num_voxels: int) -> None:
        """
        Allocate room ahead, so that no insertion pays for growing.

        Parameters
        ----------
        num_voxels : int
            Number of voxels, at most ``max_voxels``.

        """
        wanted = min(num_voxels, self._max_voxels)
        if wanted > self._voxels.capacity:
            self._voxels = self._voxels.grow(wanted, self._size)

    @property
    def memory(self) -> tuple[NDArray[np.generic], ...]:
        """
        All arrays of the map, so that a caller can have them backed by memory ahead.

        The system provides memory when it is first written, which delays some insertions by up to
        20 ms.
        """
        return *self._voxels.columns, self._voxels.table

    def insert(self, points: Float64) -> Insertion:
        """
        Add all points that fit or, on an error, none.

        Beyond ``max_voxels`` the map does not grow and does not raise: points in voxels that
        exist are still added, the others are refused and counted.  Cost O(N).

        Parameters
        ----------
        points : Float64
            (N, 3) finite points in the map frame [m].

        Returns
        -------
        Insertion
            What was added and what was refused.

        Raises
        ------
        DataError
            The shape is wrong, or a point is not finite or too far from the first one (2^20
            voxels along an axis).

        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise DataError(f'points must have shape (N, 3), got {points.shape}')
        if len(points) == 0:
            return Insertion(
                sequence=self._sequence, num_points=0, num_new=0, num_refused=0
            )
        if not np.isfinite(points[0]).all():
            raise DataError(f'point 0 is not finite: {points[0].tolist()}')
        origin = self._origin
        if origin is None:
            if np.abs(points[0]).max() / self._voxel_size > MOST_INDEX:
                raise DataError(f'point 0 lies too far out for the map: {points[0].tolist()}')
            origin = np.floor(points[0] / self._voxel_size).astype(np.int64)
        keys, offsets, bad = locate_voxels(points, origin, self._voxel_size)
        if bad >= 0:
            reach = KEY_HALF_RANGE * self._voxel_size
            raise DataError(
                f'point {bad} {points[bad].tolist()} is not finite or more than {reach:.0f} m '
                f'from the first point {(origin * self._voxel_size).tolist()}'
            )
        return self._accumulate(keys, offsets, origin)

    def _accumulate(self, keys: Int64, offsets: Float32, origin: Int64) -> Insertion:
        self._origin = origin
        self._sequence += 1
        ordered = order_by_tile(keys)
        start, num_created, num_refused = 0, 0, 0
        created: Int32 = np.empty(len(keys), dtype=np.int32)
        while True:
            voxels = self._voxels
            self._size, self._num_free, num_created, start, refused = accumulate_points(
                keys, offsets, ordered, start, self._size,
                voxels.capacity == self._max_voxels,
                voxels.free, self._num_free, created, num_created,
                voxels.table, voxels.keys, voxels.counts, voxels.means, voxels.changed,
            )
            num_refused += refused
            if start == len(ordered):
                break
            capacity = min(2 * voxels.capacity, self._max_voxels)
            self._voxels = voxels.grow(capacity, self._size)
        self.cells.link(created[:num_created], voxels, origin, self._sequence)
        return Insertion(
            sequence=self._sequence,
            num_points=len(keys) - num_refused,
            num_new=num_created,
            num_refused=num_refused,
        )

    def _used(self) -> Int64:
        return np.flatnonzero(self._voxels.counts[: self._size])

    def centroids(self) -> Float64:
        """Return the (M, 3) centroids of all voxels, by slot [m]."""
        return self._centroids(self._used())

    def _centroids(self, slots: Int64) -> Float64:
        if self._origin is None:
            return np.empty((0, 3))
        result: Float64 = find_centroids(
            slots, self._voxels.keys, self._voxels.means, self._origin, self._voxel_size
        )
        return result

    def counts(self) -> Int64:
        """Return the (M,) number of points of all voxels, by slot."""
        return self._voxels.counts[self._used()].astype(np.int64)

    def collect(self, cells: Int64, wanted: UInt8) -> Int32:
        """
        Return the slots of the voxels in some plan cells.

        Costs O(voxels of the cells).

        Parameters
        ----------
        cells : Int64
            (K,) cells of ``cells``.
        wanted : UInt8
            (256,) for each label 0 to leave out, 1 to take, 1 + k to take k SAMPLE of
            ``cell_lists``, or up to twice as many, where a cell holds more.

        Returns
        -------
        Int32
            (M,) slots.

        """
        out: Int32 = np.empty(int(self.cells.count[cells].sum()), dtype=np.int32)
        num = self.cells.collect(cells, wanted, self._voxels, out)
        return out[:num]

    def copy_voxels(self, slots: Int32) -> tuple[Int64, Float64]:
        """
        Return those voxels of some slots that have at least ``min_points`` points.

        Parameters
        ----------
        slots : Int32
            (M,) slots.

        Returns
        -------
        tuple[Int64, Float64]
            (K,) their slots and (K, 3) centroids [m].

        """
        chosen = slots[self._voxels.counts[slots] >= max(self._min_points, 1)].astype(np.int64)
        return chosen, self._centroids(chosen)

    def label(self, slots: Int64, centroids: Float64, labels: UInt8) -> None:
        """
        Label voxels copied before, if they still exist.

        Parameters
        ----------
        slots, centroids : Int64, Float64
            As from ``copy_voxels`` since the last ``clear``.
        labels : UInt8
            (K,) labels, such as PointClass.

        """
        if self._origin is None or not len(slots):
            return
        same = lie_within(centroids, slots, self._voxels.keys, self._origin, self._voxel_size)
        same &= self._voxels.counts[slots] > 0
        same &= self._voxels.labels[slots] != labels
        self._voxels.labels[slots[same]] = labels[same]
        self._voxels.changed[slots[same]] |= LABELLED

    def order_free(self) -> None:
        """
        Reuse the free slots in ascending order from now on.

        Voxels created together then lie together in memory, as in a map that was never full, and
        reading a part of the map reads less memory.
        """
        self._voxels.free[: self._num_free][::-1].sort()

    def drop(self, cell: int, kept: Bool) -> int:
        """
        Remove voxels of one plan cell; their slots are reused.

        Parameters
        ----------
        cell : int
            A cell of ``cells``.
        kept : Bool
            (256,) whether voxels of each label are kept.

        Returns
        -------
        int
            Voxels removed.

        """
        num = self.cells.drop(cell, kept, self._voxels, self._voxels.free[self._num_free :])
        self._num_free += num
        return num

    def take_changes(
        self, start: int, most: int, *, stop: int | None = None, everything: bool = False
    ) -> tuple[VoxelChanges, int]:
        """
        Copy the voxels that changed since they were last taken, and mark them as taken.

        Parameters
        ----------
        start : int
            First slot to examine.
        most : int
            Greatest number of voxels to copy.
        stop : int or None
            Slot to end before; None: all that were ever in use.
        everything : bool
            Copy voxels that did not change too.

        Returns
        -------
        VoxelChanges
        int
            First slot that was not examined.

        """
        stop = self._size if stop is None else min(stop, self._size)
        return copy_changes(self._voxels, (min(start, stop), stop, most), everything)

    def restore(self, stored: StoredMap) -> None:
        """
        Replace this map by a stored one; raise DataError, and change nothing, if it has no room.

        Every voxel gets its slot, key, count, mean and label.  Free slots are reused in ascending
        order, and the lists of the cells are in the order of the slots.
        """
        size = len(stored.keys)
        if size > self._max_voxels:
            raise DataError(f'{size} voxels are stored, map.max_voxels is {self._max_voxels}')
        self._set_empty(max(self._voxels.capacity, size))
        if stored.origin is None:
            return
        empty = stored.fill(self._voxels)
        self._size, self._num_free, self._origin = size, len(empty), stored.origin
        fill_table(self._voxels.keys[:size], self._voxels.counts[:size], self._voxels.table)
        used = self._used().astype(np.int32)
        self.cells.restore(
            stored.cell_keys, stored.cell_state, self._voxels, used, stored.origin
        )
        self._sequence = max(stored.sequence, int(stored.cell_state[:, 2].max(initial=0)))
