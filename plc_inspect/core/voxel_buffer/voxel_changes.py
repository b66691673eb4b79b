# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of the map, copied a few slots at a time, and the stored form of a map."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.core.numerics.hash_table import UInt32
from plc_inspect.core.voxel_buffer.change_flags import LABELLED, LANES, MADE, TOUCHED
from plc_inspect.core.voxel_buffer.voxel_arrays import VoxelArrays
from plc_inspect.results import Float32, Int32, Int64, UInt8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VoxelChanges:
    """Copies of K changed voxels."""

    slots: Int32
    """(K,) ascending."""
    kinds: UInt8
    """(K,) bits of what changed: TOUCHED, MADE, LABELLED."""
    keys: Int64
    """(K,) packed keys."""
    counts: UInt32
    """(K,) number of points, 0 if the voxel was removed."""
    means: Float32
    """(K, 3) mean offset of the points from the voxel's centre [m]."""
    labels: UInt8
    """(K,) labels."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredMap:
    """All that is needed to continue a map: S slots, C cells."""

    keys: Int64
    """(S,) packed keys."""
    counts: UInt32
    """(S,) number of points, 0 for free slots."""
    means: Float32
    """(S, 3) mean offset of the points from the voxel's centre [m]."""
    labels: UInt8
    """(S,) labels."""
    origin: Int64 | None
    """(3,) voxel index of the origin of the keys, None for an empty map."""
    sequence: int
    """Number of the newest insertion."""
    moved: bool
    """Whether slots were reused, so that a voxel may be stored twice."""
    cell_keys: Int64
    """(C,) keys of cells, as from ``CellIndex.copy_state``."""
    cell_state: Int32
    """(C, 5) states of cells, as from ``CellIndex.copy_state``."""

    def fill(self, voxels: VoxelArrays) -> Int64:
        """Write all voxels to large enough arrays, and return the free slots."""
        size = len(self.keys)
        voxels.keys[:size], voxels.counts[:size] = self.keys, self.counts
        voxels.means[:size], voxels.labels[:size] = self.means, self.labels
        if self.moved:
            voxels.counts[find_doubles(self.keys, self.counts)] = 0
        empty = np.flatnonzero(voxels.counts[:size] == 0)
        voxels.labels[empty] = 0
        voxels.free[: len(empty)] = empty[::-1]
        return empty


def copy_changes(
    voxels: VoxelArrays, part: tuple[int, int, int], everything: bool
) -> tuple[VoxelChanges, int]:
    """
    Copy changed voxels and mark them as taken; see ``VoxelMap.take_changes``.

    Parameters
    ----------
    voxels : VoxelArrays
        Of the map; ``changed`` is changed in place.
    part : tuple of int
        First slot to examine, slot to end before, and greatest number of voxels to copy.
    everything : bool
        Copy voxels that did not change too.

    Returns
    -------
    tuple[VoxelChanges, int]
        The changes, and the first slot that was not examined.

    """
    *columns, start = _take_changes(
        voxels.changed, voxels.keys, voxels.counts, voxels.means, voxels.labels, part, everything
    )
    slots, kinds, keys, counts, means, labels = columns
    return VoxelChanges(
        slots=slots, kinds=kinds, keys=keys, counts=counts, means=means, labels=labels
    ), start


@njit(cache=True, nogil=True)
def _take_changes(  # type: ignore[no-untyped-def]
    changed, keys, counts, means, labels, part, everything
):
    """
    Copy the changed voxels of a part of the slots.

    Returns the columns of `VoxelChanges` and the first slot that was not examined.
    """
    start, stop, most = part
    words = changed.view(np.uint64)
    slots = np.empty(most, dtype=np.int32)
    num, slot = 0, start
    while slot < stop and num < most:
        # mostly nothing changed: examine a word of slots together
        if not everything and slot % LANES == 0 and words[slot // LANES] == 0:
            slot += LANES
            continue
        if everything or changed[slot] != 0:
            slots[num] = slot
            num += 1
        slot += 1
    # copy them, and mark them as taken
    slots = slots[:num].copy()
    kinds, own_keys = np.empty(num, dtype=np.uint8), np.empty(num, dtype=np.int64)
    own_counts, own_means = np.empty(num, np.uint32), np.empty((num, 3), np.float32)
    own_labels = np.empty(num, dtype=np.uint8)
    for k in range(num):
        own = slots[k]
        kinds[k] = TOUCHED | MADE | LABELLED if everything else changed[own]
        changed[own] = 0
        own_keys[k], own_counts[k], own_labels[k] = keys[own], counts[own], labels[own]
        for j in range(3):
            own_means[k, j] = means[own, j]
    return slots, kinds, own_keys, own_counts, own_means, own_labels, min(slot, stop)


def find_doubles(keys: Int64, counts: UInt32) -> Int64:
    """
    Find voxels stored twice because they moved to another slot while the map was being stored.

    Parameters
    ----------
    keys, counts : Int64, UInt32
        (S,) by slot.

    Returns
    -------
    Int64
        Slots to leave out: of those with the same key, all but the one with most points.

    """
    used = np.flatnonzero(counts)
    order = used[np.lexsort((counts[used], keys[used]))]
    doubled: Int64 = order[:-1][keys[order[:-1]] == keys[order[1:]]]
    return doubled
