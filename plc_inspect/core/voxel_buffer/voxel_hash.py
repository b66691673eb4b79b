# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Inserts points into the voxels of the map, by a hash table of their keys."""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.hash_table import (
    enter,
    hash_key,
    make_entry,
    probe,
    slot_of,
    UInt32,
    walk,
)
from plc_inspect.core.voxel_buffer.change_flags import MADE, TOUCHED
from plc_inspect.results import Float32, Int32, Int64, UInt8

BLOCK = 64
"""
Points that are looked up together.
Source: numerical: their reads wait for memory together; time alone depends on it.
"""


@njit(cache=True, nogil=True)
def fill_table(keys: Int64, counts: UInt32, table: UInt32) -> None:
    """
    Enter keys into an empty hash table.

    Parameters
    ----------
    keys : Int64
        (M,) different keys; key m gets slot m.
    counts : UInt32
        (M,) number of points; slots with 0 are free and left out.
    table : UInt32
        As in ``numerics.hash_table``, large enough; changed in place.

    """
    for slot in range(len(keys)):
        if counts[slot] > 0:
            enter(keys[slot], slot, table)


@njit(cache=True, nogil=True, inline='always')
def _count_in(slot, counts):  # type: ignore[no-untyped-def]
    """Count a point of a voxel, and return its share of all."""
    counts[slot] += 1
    return np.float32(1.0) / np.float32(counts[slot])


@njit(cache=True, nogil=True, inline='always')
def _take_in(slot, offset, share, means):  # type: ignore[no-untyped-def]
    """Update the mean of a voxel with a point that has this share of all."""
    row = means[slot]
    row[0] += (offset[0] - row[0]) * share
    row[1] += (offset[1] - row[1]) * share
    row[2] += (offset[2] - row[2]) * share


@njit(cache=True, nogil=True, inline='always')
def _begin(slot, offset, means):  # type: ignore[no-untyped-def]
    """Set the mean of a new voxel to its only point."""
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
    changed: UInt8,
) -> tuple[int, int, int, int, int]:
    """
    Add points to their voxels until all are added or there is no room.

    Parameters
    ----------
    keys, offsets : Int64, Float32
        As from ``locate_voxels``.
    order : Int64
        (N,) points in the order in which to add them.
    start : int
        First position in ``order`` to add.
    size : int
        Slots that were ever in use.
    final : bool
        The map cannot grow: refuse points instead of stopping.
    free : Int32
        Stack of free slots below ``size``.
    num_free : int
        Number of free slots.
    created : Int32
        (N,) slots of the voxels created so far by this insertion, changed in place.
    num_created : int
        Number of created voxels.
    table, slot_keys, counts, means, changed
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
        # read the table for all points of the block, so that they wait for memory together
        for k in range(block):
            entries[k] = table[hashes[k] & mask]
        # find the slot that each key may have, by the hash bits in the table
        for k in range(block):
            places[k] = walk(hashes[k], hashes[k] & mask, table, mask)
            slots[k] = slot_of(table[places[k]], mask)
        for k in range(block):
            known[k] = slot_keys[max(slots[k], 0)]
        # compare the keys, and create voxels that are missing
        for k in range(block):
            i = order[first + k]
            key, place, slot = keys[i], places[k], slots[k]
            if slot < 0 or known[k] != key:
                # the voxel may have been created in this block
                slot, place = probe(key, hashes[k], place, table, slot_keys)
            slots[k] = slot
            if slot >= 0:
                continue
            # choose a slot for the new voxel: a free one, the next one, or none
            if num_free > 0:
                num_free -= 1
                slot = free[num_free]
            elif size < len(slot_keys):
                slot = size
                size += 1
            elif final:
                refused += 1
                continue
            else:  # the caller makes room and continues with the rest
                block, stop = k, first + k
                break
            # store it with its first point; slots[k] stays -1, so that it is not added again
            slot_keys[slot] = key
            counts[slot] = 1
            changed[slot] |= MADE | TOUCHED
            _begin(slot, offsets[i], means)
            table[place] = make_entry(hashes[k], slot, mask)
            created[num_created] = slot
            num_created += 1
        # add the points of voxels that existed before
        for k in range(block):
            if slots[k] >= 0:
                shares[k] = _count_in(slots[k], counts)
        for k in range(block):
            if slots[k] >= 0:
                _take_in(slots[k], offsets[order[first + k]], shares[k], means)
                changed[slots[k]] |= TOUCHED
        first += block
    return size, num_free, num_created, stop, refused
