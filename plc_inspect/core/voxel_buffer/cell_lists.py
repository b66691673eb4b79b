# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Kernels that read, sample and shorten the lists of voxels of plan cells."""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.hash_table import forget_key
from plc_inspect.core.voxel_buffer.change_flags import LABELLED, TOUCHED

SAMPLE = 50
"""
Unit of the number of voxels taken from a cell for a label that is sampled.
Source: judgement; not measured.
"""
LANES = 16
"""
Lists that are read side by side.
Source: numerical: their reads wait for memory together; time alone depends on it.
"""


@njit(cache=True, nogil=True)
def collect_slots(  # type: ignore[no-untyped-def]
    cells, wanted, head, state, following, labels, out
):
    """Write the slots of the wanted voxels of some cells, and return their number."""
    start, slots, label_of = _follow_lists(cells, head, state, following, labels)
    num = 0
    count = np.zeros(256, dtype=np.int64)
    one_in = np.ones(256, dtype=np.int64)
    for k in range(len(cells)):
        # count the labels of the cell, and take one of so many of those that are sampled
        own = range(start[k], start[k + 1])
        count[:] = 0
        for i in own:
            count[label_of[i]] += 1
        for label in range(256):
            if wanted[label] > 1:
                one_in[label] = max(count[label] // (SAMPLE * (wanted[label] - 1)), 1)
        for i in own:
            label = label_of[i]
            if wanted[label] == 1 or (
                wanted[label] > 1 and (_mix(slots[i]) >> 20) % one_in[label] == 0
            ):
                out[num] = slots[i]
                num += 1
    return num


@njit(cache=True, nogil=True, inline='always')
def _mix(slot):  # type: ignore[no-untyped-def]
    """Return a pseudo-random number for a slot (the last step of MurmurHash3)."""
    value = np.uint64(slot)
    value ^= value >> np.uint64(33)
    value *= np.uint64(0xFF51AFD7ED558CCD)
    value ^= value >> np.uint64(33)
    value *= np.uint64(0xC4CEB9FE1A85EC53)
    value ^= value >> np.uint64(33)
    return np.int64(value)


@njit(cache=True, nogil=True)
def _follow_lists(cells, head, state, following, labels):  # type: ignore[no-untyped-def]
    """
    Return slots and labels of the voxels of some cells, and the first index of each cell.

    The lists are read side by side, so that their steps wait for memory together.
    """
    start = np.zeros(len(cells) + 1, dtype=np.int64)
    for k in range(len(cells)):
        start[k + 1] = start[k] + state[cells[k], 0]
    slots = np.empty(start[-1], dtype=np.int32)
    label_of = np.empty(start[-1], dtype=np.uint8)
    at = np.empty(LANES, dtype=np.int64)
    place = np.empty(LANES, dtype=np.int64)
    num, begun = 0, 0
    while True:
        # fill free lanes with the next lists
        while num < LANES and begun < len(cells):
            at[num], place[num] = head[cells[begun]], start[begun]
            begun += 1
            num += at[num] >= 0
        if num == 0:
            break
        # one step along each list
        lane = 0
        while lane < num:
            slot = at[lane]
            slots[place[lane]], label_of[place[lane]] = slot, labels[slot]
            place[lane] += 1
            at[lane] = following[slot]
            if at[lane] >= 0:
                lane += 1
            else:  # the list ends: the last one takes its lane
                num -= 1
                at[lane], place[lane] = at[num], place[num]
    return start, slots, label_of


@njit(cache=True, nogil=True)
def drop_slots(  # type: ignore[no-untyped-def]
    cell, kept, head, state, following, table, keys, counts, labels, changed, out
):
    """Free the slots of the voxels of a cell that are not kept, and return their number."""
    num = 0
    slot = head[cell]
    last = np.int32(-1)
    while slot >= 0:
        # link the voxels that are kept, and clear the others
        after = following[slot]
        if kept[labels[slot]]:
            if last < 0:
                head[cell] = slot
            else:
                following[last] = slot
            last = slot
        else:
            forget_key(keys[slot], table, keys)
            counts[slot] = 0
            labels[slot] = 0
            changed[slot] |= TOUCHED | LABELLED
            out[num] = slot
            num += 1
        slot = after
    if last < 0:
        head[cell] = -1
    else:
        following[last] = -1
    state[cell, 0] -= num
    return num
