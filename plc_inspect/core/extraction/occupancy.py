# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Drops points inside bulky objects, mostly vegetation, by the occupancy of the space."""

from numba import njit, prange
import numpy as np

from plc_inspect.core.numerics.arrays import find_true
from plc_inspect.core.numerics.hash_table import enter, find_slot, index_keys, make_table
from plc_inspect.core.numerics.voxels import AXIS_BITS, NUM_PARTS, pack
from plc_inspect.results import Float64, Int64

BULK_CELL = 1.0
"""
Edge of the cells whose occupied neighbours reveal bulky objects [m].
Source: judgement; not measured.
"""
NUM_LAST = 8
"""
Edge of the square of columns whose slots are cached; a power of two.
Source: numerical: time alone depends on it.
"""
INITIAL_COLUMNS = 1 << 11
"""
Initial capacity of a run of points, in columns.
Source: numerical: the room doubles whenever it is full.
"""


def drop_bulk(
    points: Float64, chosen: Int64, origin: Float64, max_occupied: int
) -> Int64:
    """
    Drop the points inside bulky objects, mostly vegetation, before the costly steps.

    A point stays if at most ``max_occupied`` of the 27 cells (BULK_CELL) about it hold points: a
    line fills 3 to 9, a row of conductors up to 14, a crown most of them.  Points of conductors
    inside crowns are assigned later, by the fitted curves.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) int64
        Finite points not below origin.
    origin : (3,) float64
        Coordinates [m].
    max_occupied : int
        As in `LinearitySettings`.

    Returns
    -------
    (L,) int64, in the order of ``chosen``

    """
    if not len(chosen):
        return chosen
    column_of, level, key, filled, table = _fill_columns(
        points, chosen, origin, BULK_CELL
    )
    sparse = _find_sparse(key, filled, table, max_occupied)
    return chosen[find_true(_pick_bits(sparse, column_of, level))]


@njit(cache=True, parallel=True, nogil=True)
def _fill_columns(points, chosen, origin, size):  # type: ignore[no-untyped-def]
    """
    Mark occupied cells as bits of columns of 64 cells.

    Returned are the column of each point and its level in it, the key and bits of each column,
    and the table that finds a column by its key.
    """
    num = len(chosen)
    column_of = np.empty(num, dtype=np.int32)
    level = np.empty(num, dtype=np.uint8)
    keys = [np.empty(0, dtype=np.int64) for _ in range(NUM_PARTS)]
    bits = [np.empty(0, dtype=np.uint64) for _ in range(NUM_PARTS)]
    # fill columns run by run
    for part in prange(NUM_PARTS):
        first, last = part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS
        keys[part], bits[part] = _fill_part(
            points, chosen[first:last], origin, size, column_of[first:last], level[first:last]
        )
    # merge the columns of all runs: number them by key, join their bits
    total = 0
    for part in range(NUM_PARTS):
        total += len(keys[part])
    table = make_table(total)
    key = np.empty(total, dtype=np.int64)
    filled = np.zeros(total, dtype=np.uint64)
    slots = np.empty(total, dtype=np.int32)
    start = np.zeros(NUM_PARTS + 1, dtype=np.int64)
    used = 0
    for part in range(NUM_PARTS):
        start[part + 1] = start[part] + len(keys[part])
        for k in range(len(keys[part])):
            slot = find_slot(keys[part][k], table, key)
            if slot < 0:
                slot = used
                enter(keys[part][k], slot, table)
                key[used] = keys[part][k]
                used += 1
            filled[slot] |= bits[part][k]
            slots[start[part] + k] = slot
    # renumber the columns of the points
    for part in prange(NUM_PARTS):
        for k in range(part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS):
            column_of[k] = slots[start[part] + column_of[k]]
    return column_of, level, key[:used], filled[:used], table


@njit(cache=True, nogil=True)
def _fill_part(points, chosen, origin, size, column_of, level):  # type: ignore[no-untyped-def]
    """Return key and bits of the columns of some points; set column and level of each."""
    key = np.empty(INITIAL_COLUMNS, dtype=np.int64)
    filled = np.zeros(INITIAL_COLUMNS, dtype=np.uint64)
    table = make_table(len(key))
    used = 0
    # points near each other come one after another: cache the last columns
    last_key = np.full(NUM_LAST * NUM_LAST, -1, dtype=np.int64)
    last_slot = np.empty(NUM_LAST * NUM_LAST, dtype=np.int32)
    for k in range(len(chosen)):
        i = chosen[k]
        x = int((points[i, 0] - origin[0]) / size)
        y = int((points[i, 1] - origin[1]) / size)
        high = int((points[i, 2] - origin[2]) / size)
        here = pack(x, y, high >> 6)
        last = (x & (NUM_LAST - 1)) * NUM_LAST + (y & (NUM_LAST - 1))
        if last_key[last] != here:
            slot = find_slot(here, table, key)
            if slot < 0:
                if used == len(key):
                    key = np.concatenate((key, np.empty(used, dtype=np.int64)))
                    filled = np.concatenate((filled, np.zeros(used, dtype=np.uint64)))
                    table = index_keys(key[:used], len(key))
                slot = used
                enter(here, slot, table)
                key[used] = here
                used += 1
            last_key[last], last_slot[last] = here, slot
        slot = last_slot[last]
        column_of[k] = slot
        level[k] = high & 63
        filled[slot] |= np.uint64(1) << np.uint64(high & 63)
    return key[:used], filled[:used]


@njit(cache=True, nogil=True, inline='always')
def _read_block(here, table, key, filled):  # type: ignore[no-untyped-def]
    """Return the bits of the column with a key, 0 where there is none."""
    slot = find_slot(here, table, key)
    return filled[slot] if slot >= 0 else np.uint64(0)


@njit(cache=True, parallel=True, nogil=True)
def _find_sparse(key, filled, table, max_occupied):  # type: ignore[no-untyped-def]
    """Return the bits of cells with at most ``max_occupied`` occupied of the 27 about them."""
    result = np.zeros(len(key), dtype=np.uint64)
    one, top, mask = np.uint64(1), np.uint64(63), (1 << AXIS_BITS) - 1
    for i in prange(len(key)):
        count = np.zeros(64, dtype=np.uint64)
        x, y, block = key[i] >> 2 * AXIS_BITS, (key[i] >> AXIS_BITS) & mask, key[i] & mask
        # add up, level by level, the nine columns: the cell itself, below and above
        for column in range(9):
            u, v = x + column // 3 - 1, y + column % 3 - 1
            if u < 0 or v < 0:
                continue
            here = _read_block(pack(u, v, block), table, key, filled)
            below = here << one
            if block > 0:
                below |= _read_block(pack(u, v, block - 1), table, key, filled) >> top
            above = here >> one
            above |= _read_block(pack(u, v, block + 1), table, key, filled) << top
            for high in range(64):
                shift = np.uint64(high)
                if (filled[i] >> shift) & one:
                    count[high] += ((here >> shift) & one) + ((below >> shift) & one)
                    count[high] += (above >> shift) & one
        # keep the sparse ones
        for high in range(64):
            shift = np.uint64(high)
            if (filled[i] >> shift) & one and count[high] <= max_occupied:
                result[i] |= one << shift
    return result


@njit(cache=True, nogil=True)
def _pick_bits(bits, column_of, level):  # type: ignore[no-untyped-def]
    result = np.empty(len(column_of), dtype=np.bool_)
    for k in range(len(column_of)):
        result[k] = (bits[column_of[k]] >> np.uint64(level[k])) & np.uint64(1)
    return result
