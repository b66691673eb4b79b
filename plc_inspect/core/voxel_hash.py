# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Open addressing hash of voxel keys, in numba.

The table holds slot + 1, 0 where free, at a load of at most one half, with linear probing.
"""

from numba import njit
import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.voxel_keys import hash_key
from plc_inspect.results import Float32, Int32, Int64

BLOCK = 64
"""Points that are looked for together: many wait for memory at a time then."""

UInt32 = NDArray[np.uint32]


def build_table(keys: Int64, counts: UInt32, capacity: int) -> Int32:
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
    Int32
        Slot + 1, or 0 where free; the length is a power of two, at least twice the capacity.

    """
    length = 1 << max(4, (2 * capacity - 1).bit_length())
    table: Int32 = np.zeros(length, dtype=np.int32)
    _fill_table(keys, counts, table)
    return table


@njit(cache=True, nogil=True)
def _fill_table(keys: Int64, counts: UInt32, table: Int32) -> None:
    mask = len(table) - 1
    for slot in range(len(keys)):
        if counts[slot] == 0:
            continue
        place = hash_key(keys[slot]) & mask
        while table[place] != 0:
            place = (place + 1) & mask
        table[place] = slot + 1


@njit(cache=True, nogil=True, inline='always')
def _count_in(slot, counts):  # type: ignore[no-untyped-def]
    """Count one more point of a voxel, and return its share of all."""
    counts[slot] += 1
    return np.float32(1.0) / np.float32(counts[slot])


@njit(cache=True, nogil=True, inline='always')
def _take_in(slot, offset, share, moments):  # type: ignore[no-untyped-def]
    """Bring the means of one voxel up to date with one more point, of this share of all."""
    x, y, z = offset[0], offset[1], offset[2]
    row = moments[slot]
    row[0] += (x - row[0]) * share
    row[1] += (y - row[1]) * share
    row[2] += (z - row[2]) * share
    row[3] += (x * x - row[3]) * share
    row[4] += (x * y - row[4]) * share
    row[5] += (x * z - row[5]) * share
    row[6] += (y * y - row[6]) * share
    row[7] += (y * z - row[7]) * share
    row[8] += (z * z - row[8]) * share


@njit(cache=True, nogil=True)
def add_to_known(
    keys: Int64,
    offsets: Float32,
    table: Int32,
    slot_keys: Int64,
    counts: UInt32,
    moments: Float32,
) -> Int64:
    """
    Add those points whose voxels are there, and return the others.

    Parameters
    ----------
    keys, offsets : Int64, Float32
        As from ``locate_voxels``.
    table, slot_keys, counts, moments
        The map's arrays, changed in place.

    Returns
    -------
    Int64
        (M,) points without a voxel, ascending.

    """
    mask = len(table) - 1
    missing = np.empty(len(keys), dtype=np.int64)
    num = 0
    places = np.empty(BLOCK, dtype=np.int64)
    slots = np.empty(BLOCK, dtype=np.int64)
    known = np.empty(BLOCK, dtype=np.int64)
    shares = np.empty(BLOCK, dtype=np.float32)
    for first in range(0, len(keys), BLOCK):
        block = min(BLOCK, len(keys) - first)
        for k in range(block):
            places[k] = hash_key(keys[first + k]) & mask
        for k in range(block):
            slots[k] = table[places[k]] - 1
        for k in range(block):
            known[k] = slot_keys[max(slots[k], 0)]
        for k in range(block):
            i = first + k
            place, slot, key = places[k], slots[k], known[k]
            while slot >= 0 and key != keys[i]:
                place = (place + 1) & mask
                slot = table[place] - 1
                key = slot_keys[max(slot, 0)]
            slots[k] = slot
        for k in range(block):
            if slots[k] >= 0:
                shares[k] = _count_in(slots[k], counts)
        for k in range(block):
            if slots[k] < 0:
                missing[num] = first + k
                num += 1
            else:
                _take_in(slots[k], offsets[first + k], shares[k], moments)
    return missing[:num].copy()


@njit(cache=True, nogil=True)
def accumulate_points(
    keys: Int64,
    offsets: Float32,
    chosen: Int64,
    start: int,
    size: int,
    final: bool,
    free: Int32,
    num_free: int,
    created: Int32,
    num_created: int,
    table: Int32,
    slot_keys: Int64,
    counts: UInt32,
    moments: Float32,
) -> tuple[int, int, int, int, int]:
    """
    Add chosen points to their voxels until all are in or there is no room.

    Parameters
    ----------
    keys, offsets : Int64, Float32
        As from ``locate_voxels``.
    chosen : Int64
        (M,) points to add, in this order.
    start : int
        First of these to add.
    size : int
        Slots that were ever in use.
    final : bool
        There is no more room to be had: refuse points instead of stopping.
    free : Int32
        Slots below ``size`` that are free, the first ``num_free``; the last is taken first.
    num_free : int
        Free slots.
    created : Int32
        (M,) slots of the voxels made so far by this insertion, changed in place.
    num_created : int
        How many they are.
    table, slot_keys, counts, moments
        The map's arrays, changed in place.

    Returns
    -------
    tuple[int, int, int, int, int]
        Slots that were ever in use, free slots, voxels made, first of the chosen that was not
        looked at, points refused.

    """
    mask = len(table) - 1
    refused = 0
    places = np.empty(BLOCK, dtype=np.int64)
    slots = np.empty(BLOCK, dtype=np.int64)
    for k in range(start, len(chosen)):
        ahead = (k - start) % BLOCK
        if ahead == 0:
            block = min(BLOCK, len(chosen) - k)
            for j in range(block):
                places[j] = hash_key(keys[chosen[k + j]]) & mask
            for j in range(block):
                slots[j] = table[places[j]] - 1
        i = chosen[k]
        key, place, slot = keys[i], places[ahead], slots[ahead]
        if slot < 0:  # unless one of this block has come there
            slot = table[place] - 1
        while slot >= 0 and slot_keys[slot] != key:
            place = (place + 1) & mask
            slot = table[place] - 1
        if slot < 0:
            if num_free > 0:
                num_free -= 1
                slot = free[num_free]
            elif size < len(slot_keys):
                slot = size
                size += 1
            elif final:
                refused += 1
                continue
            else:
                return size, num_free, num_created, k, refused
            slot_keys[slot] = key
            moments[slot, :] = np.float32(0.0)
            table[place] = slot + 1
            created[num_created] = slot
            num_created += 1
        _take_in(slot, offsets[i], _count_in(slot, counts), moments)
    return size, num_free, num_created, len(chosen), refused


@njit(cache=True, nogil=True)
def forget_key(key: np.int64, table: Int32, slot_keys: Int64) -> None:
    """
    Take a key that is there out of the table, moving back those that had to step aside for it.

    Parameters
    ----------
    key : int
        Its slot's key is left as it is.
    table, slot_keys : Int32, Int64
        The table is changed in place.

    """
    mask = len(table) - 1
    hole = hash_key(key) & mask
    while slot_keys[table[hole] - 1] != key:
        hole = (hole + 1) & mask
    place = (hole + 1) & mask
    while table[place] != 0:
        home = hash_key(slot_keys[table[place] - 1]) & mask
        if ((place - home) & mask) >= ((place - hole) & mask):
            table[hole] = table[place]
            hole = place
        place = (place + 1) & mask
    table[hole] = 0
