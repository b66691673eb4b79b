# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Open addressing hash of voxel keys, in numba.

The table holds slot + 1, 0 where free, at a load of at most one half, with linear probing.  Slots
need fewer bits than an entry has; the rest hold bits of the key's hash, so that most steps of a
probe need no look at the keys, which would wait for memory.
"""

from numba import njit
import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.mapping.voxel_keys import hash_key
from plc_inspect.results import Float32, Int32, Int64

ENTRY_BITS = (1 << 32) - 1
"""Bits of a hash that an entry can hold.  Source: derived: entries are uint32."""
BLOCK = 64
"""
Points that are looked up together.
Source: numerical: their reads wait for memory together; time alone depends on it.
"""
LEAST_BITS = 4
"""
A table has at least 2 to this many places.
Source: numerical: a power of two, at least twice the keys.
"""

UInt32 = NDArray[np.uint32]


def build_table(keys: Int64, counts: UInt32, capacity: int) -> UInt32:
    """
    Build the hash table of some keys.

    Parameters
    ----------
    keys : Int64
        (M,) different keys; key m gets slot m.
    counts : UInt32
        (M,) slots with a count of 0 are free and left out.
    capacity : int
        Number of keys that the table must take, at least M.

    Returns
    -------
    UInt32
        Slot + 1 in the bits that places need, and those of the key's hash above, or 0 where free;
        the length is a power of two, at least twice the capacity.

    """
    length = 1 << max(LEAST_BITS, (2 * capacity - 1).bit_length())
    table: UInt32 = np.zeros(length, dtype=np.uint32)
    _fill_table(keys, counts, table)
    return table


@njit(cache=True, nogil=True)
def _fill_table(keys: Int64, counts: UInt32, table: UInt32) -> None:
    mask = len(table) - 1
    for slot in range(len(keys)):
        if counts[slot] == 0:
            continue
        hashed = hash_key(keys[slot])
        place = hashed & mask
        while table[place] != 0:
            place = (place + 1) & mask
        table[place] = _make_entry(hashed, slot, mask)


@njit(cache=True, nogil=True, inline='always')
def _make_entry(hashed, slot, mask):  # type: ignore[no-untyped-def]
    """Return the entry of a slot, by the hash of its key."""
    return np.uint32((hashed & ENTRY_BITS & ~mask) | (slot + 1))


@njit(cache=True, nogil=True, inline='always')
def _slot_of(entry, mask):  # type: ignore[no-untyped-def]
    """Return the slot of an entry, -1 where it is free."""
    return np.int64(entry & mask) - 1


@njit(cache=True, nogil=True, inline='always')
def _walk(hashed, place, table, mask):  # type: ignore[no-untyped-def]
    """Return the first place from ``place`` on that is free or, by its hash, may hold the key."""
    while table[place] != 0 and (np.int64(table[place]) ^ hashed) & ENTRY_BITS & ~mask != 0:
        place = (place + 1) & mask
    return place


@njit(cache=True, nogil=True, inline='always')
def _count_in(slot, counts):  # type: ignore[no-untyped-def]
    """Count one more point of a voxel, and return its share of them."""
    counts[slot] += 1
    return np.float32(1.0) / np.float32(counts[slot])


@njit(cache=True, nogil=True, inline='always')
def _take_in(slot, offset, share, means):  # type: ignore[no-untyped-def]
    """Bring the mean of one voxel up to date with one more point, of this share of all."""
    row = means[slot]
    row[0] += (offset[0] - row[0]) * share
    row[1] += (offset[1] - row[1]) * share
    row[2] += (offset[2] - row[2]) * share


@njit(cache=True, nogil=True, inline='always')
def _begin(slot, offset, means):  # type: ignore[no-untyped-def]
    """Set the mean of a new voxel, its one point."""
    row = means[slot]
    row[0], row[1], row[2] = offset[0], offset[1], offset[2]


@njit(cache=True, nogil=True)
def accumulate_points(
    keys: Int64,
    offsets: Float32,
    order: Int64,
    start: int,
    size: int,
    final: bool,
    free: Int32,
    num_free: int,
    created: Int32,
    num_created: int,
    table: UInt32,
    slot_keys: Int64,
    counts: UInt32,
    means: Float32,
) -> tuple[int, int, int, int, int]:
    """
    Add points to their voxels until all are in or there is no room.

    Parameters
    ----------
    keys, offsets : Int64, Float32
        As from ``locate_voxels``.
    order : Int64
        (N,) points in the order in which to add them.
    start : int
        First place in it to add.
    size : int
        Slots that were ever in use.
    final : bool
        There is no more room to be had: refuse points instead of stopping.
    free : Int32
        Slots below ``size`` that are free, the first ``num_free``; the last is taken first.
    num_free : int
        Free slots.
    created : Int32
        (N,) slots of the voxels made so far by this insertion, changed in place.
    num_created : int
        How many they are.
    table, slot_keys, counts, means
        The map's arrays, changed in place.

    Returns
    -------
    tuple[int, int, int, int, int]
        Slots that were ever in use, free slots, voxels made, first place in the order that was
        not processed, points refused.

    """
    mask = len(table) - 1
    refused, stop = 0, len(order)
    hashes = np.empty(BLOCK, dtype=np.int64)
    entries = np.empty(BLOCK, dtype=np.uint32)
    places = np.empty(BLOCK, dtype=np.int64)
    slots = np.empty(BLOCK, dtype=np.int64)
    known = np.empty(BLOCK, dtype=np.int64)
    shares = np.empty(BLOCK, dtype=np.float32)
    first = start
    while first < stop:
        block = min(BLOCK, stop - first)
        for k in range(block):
            hashes[k] = hash_key(keys[order[first + k]])
        # touch the table for all points of the block, so that they wait for memory together
        for k in range(block):
            entries[k] = table[hashes[k] & mask]
        # the slot that each key may have, by the hash bits in the table
        for k in range(block):
            places[k] = _walk(hashes[k], hashes[k] & mask, table, mask)
            slots[k] = _slot_of(table[places[k]], mask)
        # the keys of those slots, again together
        for k in range(block):
            known[k] = slot_keys[max(slots[k], 0)]
        # compare the keys, and make voxels for those that have none
        for k in range(block):
            i = order[first + k]
            key, place, slot = keys[i], places[k], slots[k]
            if slot < 0 or known[k] != key:
                place = _walk(hashes[k], place, table, mask)  # a point before may have made it
                slot = _slot_of(table[place], mask)
                while slot >= 0 and slot_keys[slot] != key:
                    place = _walk(hashes[k], (place + 1) & mask, table, mask)
                    slot = _slot_of(table[place], mask)
            slots[k] = slot
            if slot >= 0:
                continue
            # a slot for the new voxel: a free one, the next one, or none
            if num_free > 0:
                num_free -= 1
                slot = free[num_free]
            elif size < len(slot_keys):
                slot = size
                size += 1
            elif final:
                refused += 1
                continue
            else:  # the caller makes room and comes again with the rest
                block, stop = k, first + k
                break
            # its first point is in now, so slots[k] stays -1
            slot_keys[slot] = key
            counts[slot] = 1
            _begin(slot, offsets[i], means)
            table[place] = _make_entry(hashes[k], slot, mask)
            created[num_created] = slot
            num_created += 1
        # add the points of voxels that were there before
        for k in range(block):
            if slots[k] >= 0:
                shares[k] = _count_in(slots[k], counts)
        for k in range(block):
            if slots[k] >= 0:
                _take_in(slots[k], offsets[order[first + k]], shares[k], means)
        first += block
    return size, num_free, num_created, stop, refused


@njit(cache=True, nogil=True)
def forget_key(key: np.int64, table: UInt32, slot_keys: Int64) -> None:
    """
    Remove a key that is in the table, and move back those that had to make way for it.

    Parameters
    ----------
    key : int
        Its slot's key is left as it is.
    table, slot_keys : UInt32, Int64
        The table is changed in place.

    """
    mask = len(table) - 1
    hole = hash_key(key) & mask
    while slot_keys[_slot_of(table[hole], mask)] != key:
        hole = (hole + 1) & mask
    place = (hole + 1) & mask
    while table[place] != 0:
        home = hash_key(slot_keys[_slot_of(table[place], mask)]) & mask
        if ((place - home) & mask) >= ((place - hole) & mask):
            table[hole] = table[place]
            hole = place
        place = (place + 1) & mask
    table[hole] = 0
