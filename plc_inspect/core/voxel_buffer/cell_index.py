# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Plan cells of the map: the voxels of each cell, and how many of them are new.

Each cell is the head of a linked list of its voxels, so that a part of the map is read without the
rest.  Cells are never removed; an empty one takes 40 bytes.
"""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.hash_table import (
    find_slot,
    hash_key,
    index_keys,
    make_entry,
    make_table,
    probe,
    UInt32,
)
from plc_inspect.core.voxel_buffer.cell_lists import collect_slots, drop_slots
from plc_inspect.core.voxel_buffer.voxel_arrays import VoxelArrays
from plc_inspect.core.voxel_buffer.voxel_keys import KEY_BITS, KEY_HALF_RANGE
from plc_inspect.results import Bool, Float64, Int32, Int64, UInt8

CELL_SIZE = 10.0
"""Edge of a plan cell, rounded to whole voxels [m].  Source: judgement; not measured."""
INITIAL_CELLS = 1 << 12
"""
Initial capacity, in cells.
Source: numerical: the room doubles whenever it is full.
"""
HALF_ROWS = 1 << 31
"""
Offset of the row of a cell, which may be negative, in its key.
Source: derived: half the range of 32 bits.
"""
_MASK = (1 << KEY_BITS) - 1
"""Mask of one index in a voxel's key.  Source: derived: KEY_BITS bits."""


class CellIndex:
    """
    Lists of voxels by plan cell, kept by the map that owns the voxels.

    Parameters
    ----------
    voxel_size : float
        Edge of a voxel [m].

    """

    def __init__(self, voxel_size: float) -> None:
        self._voxels_per_cell = max(1, round(CELL_SIZE / voxel_size))
        self._cell_size = self._voxels_per_cell * voxel_size
        self._voxel_size = voxel_size
        self.clear()

    def clear(self) -> None:
        """Forget all cells."""
        self._num = 0
        self._origin = np.zeros(3, dtype=np.int64)
        self._table: UInt32 = make_table(INITIAL_CELLS)
        self._keys: Int64 = np.zeros(INITIAL_CELLS, dtype=np.int64)
        self._head: Int32 = np.full(INITIAL_CELLS, -1, dtype=np.int32)
        self._state: Int32 = np.zeros((INITIAL_CELLS, 5), dtype=np.int32)

    def __len__(self) -> int:
        """Return the number of cells."""
        return self._num

    @property
    def cell_size(self) -> float:
        """Edge of a cell [m]."""
        return self._cell_size

    @property
    def count(self) -> Int32:
        """(C,) voxels in each cell, a view."""
        return self._state[: self._num, 0]

    @property
    def num_new(self) -> Int32:
        """(C,) voxels created in each cell since ``settle``, a view."""
        return self._state[: self._num, 1]

    @property
    def touched(self) -> Int32:
        """(C,) insertion that last created a voxel in each cell, a view."""
        return self._state[: self._num, 2]

    @property
    def low(self) -> Float64:
        """(C,) bottom of the lowest voxel that each cell ever held [m]."""
        return (self._state[: self._num, 3] + self._origin[2]) * self._voxel_size

    @property
    def high(self) -> Float64:
        """(C,) top of the highest voxel that each cell ever held [m]."""
        return (self._state[: self._num, 4] + self._origin[2] + 1) * self._voxel_size

    @property
    def index(self) -> Int64:
        """(C, 2) column and row of each cell."""
        return self.index_of(slice(self._num))

    def index_of(self, cells: Int32 | slice) -> Int64:
        """Return the (K, 2) columns and rows of some cells."""
        keys = self._keys[cells]
        return np.column_stack((keys >> 32, (keys & 0xFFFFFFFF) - HALF_ROWS))

    @property
    def centers(self) -> Float64:
        """(C, 2) centre of each cell in plan [m]."""
        return np.multiply(self.index + 0.5, self._cell_size, dtype=np.float64)

    def locate(self, xy: Float64) -> Int64:
        """Return the (N, 2) columns and rows of the cells of (N, 2+) points [m]."""
        return np.floor(xy[:, :2] / self._cell_size).astype(np.int64)

    def find(self, index: Int64) -> Int32:
        """Return the cell at each of (N, 2) columns and rows, -1 where there is none."""
        keys = (index[:, 0] << 32) + index[:, 1] + HALF_ROWS
        return _find_cells(keys, self._table, self._keys)

    def find_all(self, place: Float64, reach: float) -> Int32:
        """
        Return all cells near a place, -1 for each where there is none.

        Parameters
        ----------
        place : (2+,) float64
            Where, finite [m].
        reach : float
            Greatest distance in plan from there to a cell [m].

        Returns
        -------
        (K,) int32

        """
        size = self._cell_size
        return _find_all(float(place[0]), float(place[1]), reach, size, self._table, self._keys)

    def settle(self, cells: Int64) -> None:
        """Count no voxel of these cells as new from now on."""
        self._state[cells, 1] = 0

    def renew(self, cells: Int32) -> None:
        """Count all voxels of these cells as new; -1 is none."""
        cells = cells[cells >= 0]
        self._state[cells, 1] = self._state[cells, 0]

    def find_near(self, xy: Float64, reach: float) -> Int32:
        """Return the cells whose centres are within reach of a (2+,) position [m]."""
        near: Int32 = np.flatnonzero(
            np.linalg.norm(self.centers - xy[:2], axis=1) <= reach
        ).astype(np.int32)
        return near

    def link(
        self, slots: Int32, voxels: VoxelArrays, origin: Int64, sequence: int
    ) -> None:
        """
        Add voxels to the lists of their cells.

        Parameters
        ----------
        slots : Int32
            (N,) slots of the voxels just created.
        voxels : VoxelArrays
            Of the map; ``following`` is changed in place.
        origin : Int64
            (3,) voxel index of the origin of the keys.
        sequence : int
            Number of the insertion.

        """
        self._origin = origin
        start = 0
        while True:
            self._num, start = _link_slots(
                slots, start, voxels.keys, origin, self._voxels_per_cell, sequence,
                voxels.following, self._num, self._table, self._keys, self._head, self._state,
            )
            if start == len(slots):
                return
            self._grow()

    def copy_state(self) -> tuple[Int64, Int32]:
        """Return copies of the (C,) keys and (C, 5) states of all cells, for ``restore``."""
        return self._keys[: self._num].copy(), self._state[: self._num].copy()

    def restore(
        self, keys: Int64, state: Int32, voxels: VoxelArrays, slots: Int32, origin: Int64
    ) -> None:
        """
        Replace all cells and their lists.

        Parameters
        ----------
        keys, state : Int64, Int32
            As from ``copy_state``; their counts may differ from ``slots``.
        voxels : VoxelArrays
            Of the map; ``following`` is changed in place.
        slots : Int32
            (M,) all slots in use, in the order in which their voxels were created.
        origin : Int64
            (3,) voxel index of the origin of the keys.

        """
        self.clear()
        while len(self._keys) < len(keys):
            self._grow()
        self._num = len(keys)
        self._keys[: len(keys)] = keys
        self._table = index_keys(keys, len(self._keys))
        self._state[: len(keys), 3:] = state[:, 3:]
        self.link(slots, voxels, origin, int(state[:, 2].max(initial=0)))
        known = self._state[: len(keys)]
        known[:, 1] = np.clip(state[:, 1] + known[:, 0] - state[:, 0], 0, known[:, 0])
        known[:, 2] = state[:, 2]

    def _grow(self) -> None:
        num = len(self._keys)
        self._keys = np.concatenate((self._keys, np.zeros(num, dtype=np.int64)))
        self._head = np.concatenate((self._head, np.full(num, -1, dtype=np.int32)))
        self._state = np.concatenate((self._state, np.zeros((num, 5), dtype=np.int32)))
        self._table = index_keys(self._keys[: self._num], 2 * num)

    def collect(
        self, cells: Int64, wanted: UInt8, voxels: VoxelArrays, out: Int32
    ) -> int:
        """
        List the voxels of some cells.

        Parameters
        ----------
        cells : Int64
            (K,) cells.
        wanted : UInt8
            (256,) for each label 0 to leave out, 1 to take, 1 + k to take k SAMPLE of them, or
            up to twice as many, where there are more.
        voxels : VoxelArrays
            Of the map.
        out : Int32
            Receives the slots; as long as the counts of the cells together.

        Returns
        -------
        int
            Number of slots written.

        """
        return int(
            collect_slots(
                cells, wanted, self._head, self._state, voxels.following, voxels.labels, out
            )
        )

    def drop(self, cell: int, kept: Bool, voxels: VoxelArrays, out: Int32) -> int:
        """
        Remove voxels of one cell from the map.

        Parameters
        ----------
        cell : int
            The cell.
        kept : Bool
            (256,) whether voxels of each label are kept.
        voxels : VoxelArrays
            Of the map, changed in place.
        out : Int32
            Receives the freed slots.

        Returns
        -------
        int
            Number of slots freed.

        """
        return int(
            drop_slots(
                cell, kept, self._head, self._state, voxels.following, voxels.table, voxels.keys,
                voxels.counts, voxels.labels, voxels.changed, out,
            )
        )


# These two keep Python's lock: a return from a kernel without it would wait for a tick.
@njit(cache=True)
def _find_cells(keys, table, cell_keys):  # type: ignore[no-untyped-def]
    result = np.empty(len(keys), dtype=np.int32)
    for i in range(len(keys)):
        result[i] = find_slot(keys[i], table, cell_keys)
    return result


@njit(cache=True)
def _find_all(x, y, reach, size, table, cell_keys):  # type: ignore[no-untyped-def]
    left, right = int(np.floor((x - reach) / size)), int(np.floor((x + reach) / size))
    front, back = int(np.floor((y - reach) / size)), int(np.floor((y + reach) / size))
    result = np.empty((right - left + 1) * (back - front + 1), dtype=np.int32)
    num = 0
    for column in range(left, right + 1):
        aside = x - min(max(x, column * size), (column + 1) * size)
        for row in range(front, back + 1):
            along = y - min(max(y, row * size), (row + 1) * size)
            if aside * aside + along * along <= reach * reach:
                result[num] = find_slot((column << 32) + row + HALF_ROWS, table, cell_keys)
                num += 1
    return result[:num]


@njit(cache=True, nogil=True)
def _link_slots(  # type: ignore[no-untyped-def]
    slots, start, keys, origin, per_cell, sequence, following, num, table, cell_keys, head, state
):
    """
    Add voxels to the lists of their cells, and make cells that are missing.

    Returns the number of cells, and the first slot that was not added for want of room.
    """
    mask = len(table) - 1
    left, front, cell = np.int64(0), np.int64(0), np.int64(-1)
    for i in range(start, len(slots)):
        # indices of the voxel, from its key
        slot = slots[i]
        key = keys[slot]
        x = (key >> (2 * KEY_BITS)) - KEY_HALF_RANGE + origin[0]
        y = ((key >> KEY_BITS) & _MASK) - KEY_HALF_RANGE + origin[1]
        z = np.int32((key & _MASK) - KEY_HALF_RANGE)
        # its cell: that of the voxel before, a known one, or a new one
        if cell < 0 or not (0 <= x - left < per_cell and 0 <= y - front < per_cell):
            column, row_of = x // per_cell, y // per_cell
            left, front = column * per_cell, row_of * per_cell
            cell_key = (column << 32) + row_of + HALF_ROWS
            hashed = hash_key(cell_key)
            cell, place = probe(cell_key, hashed, hashed & mask, table, cell_keys)
            if cell < 0:
                if num == len(cell_keys):
                    return num, i
                cell = num
                num += 1
                cell_keys[cell] = cell_key
                table[place] = make_entry(hashed, cell, mask)
                state[cell, 3] = z
                state[cell, 4] = z
        # put the voxel at the head of the list, and count it
        following[slot] = head[cell]
        head[cell] = slot
        row = state[cell]
        row[0] += 1
        row[1] += 1
        row[2] = sequence
        row[3] = min(row[3], z)
        row[4] = max(row[4], z)
    return num, len(slots)
