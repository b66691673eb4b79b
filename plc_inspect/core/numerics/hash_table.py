# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hash tables of int64 keys, in numba: open addressing, linear probing.

Keys are stored by slot, 0, 1, 2 ..., in an array beside the table.  An entry of the table, uint32,
holds slot + 1, or 0 if it is free; at most half of the entries are in use.  The bits of an entry
that slots do not need hold bits of the key's hash, so that most probes end without reading a key,
which would wait for memory.
"""

from numba import njit
import numpy as np
from numpy.typing import NDArray

LEAST_SIZE = 16
"""Length of the smallest table.  Source: numerical: a power of two."""

UInt32 = NDArray[np.uint32]


@njit(cache=True, nogil=True)
def size_table(num):  # type: ignore[no-untyped-def]
    """Return the length of a table for ``num`` keys: a power of two, at least twice as many."""
    size = LEAST_SIZE
    while size < 2 * num:
        size *= 2
    return size


@njit(cache=True, nogil=True)
def make_table(num):  # type: ignore[no-untyped-def]
    """Return an empty table for ``num`` keys."""
    return np.zeros(size_table(num), dtype=np.uint32)


@njit(cache=True, nogil=True, inline='always')
def hash_key(key):  # type: ignore[no-untyped-def]
    """
    Return the 32-bit hash of a key; each of its bits depends on all bits of the key.

    Fibonacci hashing (Knuth, The Art of Computer Programming 3, 6.4) spreads neighbours in space
    evenly.  The lower bits of the product, which choose the place, do not depend on the upper bits
    of the key, so its upper bits are folded onto them.
    """
    value = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((value >> np.uint64(32)) ^ (value >> np.uint64(52)))


@njit(cache=True, nogil=True, inline='always')
def make_entry(hashed, slot, mask):  # type: ignore[no-untyped-def]
    """Return the entry of a slot and the hash of its key; ``mask`` is the table's length - 1."""
    return np.uint32((hashed & ~mask) | (slot + 1))


@njit(cache=True, nogil=True, inline='always')
def slot_of(entry, mask):  # type: ignore[no-untyped-def]
    """Return the slot of an entry, -1 if it is free."""
    return np.int64(entry & mask) - 1


@njit(cache=True, nogil=True, inline='always')
def walk(hashed, place, table, mask):  # type: ignore[no-untyped-def]
    """Return the first place from ``place`` on that is free or may hold the key of a hash."""
    while table[place] != 0 and (np.int64(table[place]) ^ hashed) & ~mask != 0:
        place = (place + 1) & mask
    return place


@njit(cache=True, nogil=True, inline='always')
def probe(key, hashed, place, table, keys):  # type: ignore[no-untyped-def]
    """
    Search for a key from ``place`` on.

    Parameters
    ----------
    key, hashed : int
        The key, and its hash.
    place : int
        Where to begin: the place of the hash, or one that ``walk`` returned.
    table, keys : (T,) uint32, (M,) int64
        The table and its keys by slot.

    Returns
    -------
    slot, place : int
        The key's slot and place; -1 and the place at which to enter it if it is missing.

    """
    mask = len(table) - 1
    place = walk(hashed, place, table, mask)
    slot = slot_of(table[place], mask)
    while slot >= 0 and keys[slot] != key:
        place = walk(hashed, (place + 1) & mask, table, mask)
        slot = slot_of(table[place], mask)
    return slot, place


@njit(cache=True, nogil=True, inline='always')
def find_slot(key, table, keys):  # type: ignore[no-untyped-def]
    """Return the slot of a key, or -1."""
    hashed = hash_key(key)
    return probe(key, hashed, hashed & (len(table) - 1), table, keys)[0]


@njit(cache=True, nogil=True, inline='always')
def enter(key, slot, table):  # type: ignore[no-untyped-def]
    """Enter a key that is not in the table."""
    mask = len(table) - 1
    hashed = hash_key(key)
    place = hashed & mask
    while table[place] != 0:
        place = (place + 1) & mask
    table[place] = make_entry(hashed, slot, mask)


@njit(cache=True, nogil=True)
def index_keys(keys, num):  # type: ignore[no-untyped-def]
    """Return a table of (M,) different keys with room for ``num`` >= M."""
    table = make_table(num)
    for slot in range(len(keys)):
        enter(keys[slot], slot, table)
    return table


@njit(cache=True, nogil=True)
def forget_key(key, table, keys):  # type: ignore[no-untyped-def]
    """Remove an existing key from a table; move back the entries that it displaced."""
    mask = len(table) - 1
    hole = hash_key(key) & mask
    while keys[slot_of(table[hole], mask)] != key:
        hole = (hole + 1) & mask
    place = (hole + 1) & mask
    while table[place] != 0:
        home = hash_key(keys[slot_of(table[place], mask)]) & mask
        if ((place - home) & mask) >= ((place - hole) & mask):
            table[hole] = table[place]
            hole = place
        place = (place + 1) & mask
    table[hole] = 0
