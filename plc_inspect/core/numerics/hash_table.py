# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hash tables of int64 keys, in numba: open addressing with linear probing.

The keys stand by slot, 0, 1, 2 ..., in an array beside the table.  A table of uint32 holds
slot + 1, 0 where free, at a load of at most one half.  Slots need fewer bits than an entry has;
the others hold those of the key's hash, so that most steps of a probe end without a look at the
keys, each of which waits for memory.
"""

from numba import njit
import numpy as np
from numpy.typing import NDArray

LEAST_SIZE = 16
"""Entries of the smallest table.  Source: numerical: a power of two."""

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
    Return 32 bits of a key, all of which all of its bits reach.

    Fibonacci hashing (Knuth, The Art of Computer Programming 3, 6.4) spreads neighbours in space
    evenly.  The upper bits of a key reach none of the lower ones of the product, which choose the
    place, so its top is folded onto them.
    """
    value = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((value >> np.uint64(32)) ^ (value >> np.uint64(52)))


@njit(cache=True, nogil=True, inline='always')
def make_entry(hashed, slot, mask):  # type: ignore[no-untyped-def]
    """Return the entry of a slot, by the hash of its key; ``mask`` is the table's length - 1."""
    return np.uint32((hashed & ~mask) | (slot + 1))


@njit(cache=True, nogil=True, inline='always')
def slot_of(entry, mask):  # type: ignore[no-untyped-def]
    """Return the slot of an entry, -1 where it is free."""
    return np.int64(entry & mask) - 1


@njit(cache=True, nogil=True, inline='always')
def walk(hashed, place, table, mask):  # type: ignore[no-untyped-def]
    """Return the first place from one on that is free or may hold a key, by its hash."""
    while table[place] != 0 and (np.int64(table[place]) ^ hashed) & ~mask != 0:
        place = (place + 1) & mask
    return place


@njit(cache=True, nogil=True, inline='always')
def probe(key, hashed, place, table, keys):  # type: ignore[no-untyped-def]
    """
    Look for a key from a place on.

    Parameters
    ----------
    key, hashed : int
        The key, and its hash.
    place : int
        Where to begin: at the hash, or where ``walk`` led.
    table, keys : (T,) uint32, (M,) int64
        The table, and its keys by slot.

    Returns
    -------
    slot, place : int
        The key's slot and where it stands; -1 and where it may be entered if it is not there.

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
    """Enter a key that is not in the table yet."""
    mask = len(table) - 1
    hashed = hash_key(key)
    place = hashed & mask
    while table[place] != 0:
        place = (place + 1) & mask
    table[place] = make_entry(hashed, slot, mask)


@njit(cache=True, nogil=True)
def index_keys(keys, num):  # type: ignore[no-untyped-def]
    """Return a table of (M,) different keys, with room for ``num``, at least M."""
    table = make_table(num)
    for slot in range(len(keys)):
        enter(keys[slot], slot, table)
    return table


@njit(cache=True, nogil=True)
def forget_key(key, table, keys):  # type: ignore[no-untyped-def]
    """Take a key that is there out of a table; what had to step aside for it moves back."""
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
