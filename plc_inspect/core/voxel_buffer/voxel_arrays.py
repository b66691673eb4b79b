# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The arrays that hold the voxels of the map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.numerics.hash_table import size_table, UInt32
from plc_inspect.core.voxel_buffer.change_flags import LANES
from plc_inspect.core.voxel_buffer.voxel_hash import fill_table
from plc_inspect.results import Float32, Int32, Int64, UInt8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VoxelArrays:
    """Arrays of C slots for voxels, and the hash table of their keys; kernels write to them."""

    keys: Int64
    """(C,) packed keys, see `voxel_keys`."""
    counts: UInt32
    """(C,) number of points, 0 for free slots."""
    means: Float32
    """(C, 3) mean offset of the points from the voxel's centre [m]."""
    following: Int32
    """(C,) next slot of the same plan cell, -1 at the end."""
    labels: UInt8
    """(C,) labels, such as PointClass."""
    free: Int32
    """(C,) stack of free slots; the map knows how many there are."""
    changed: UInt8
    """(C,) changes of each voxel since it was last taken; padded to whole words of LANES."""
    table: UInt32
    """Hash table of the keys."""

    @property
    def capacity(self) -> int:
        """Number of slots."""
        return len(self.keys)

    @property
    def columns(self) -> tuple[NDArray[np.generic], ...]:
        """All arrays by slot."""
        return (
            self.keys, self.counts, self.means, self.following, self.labels, self.free,
            self.changed,
        )

    def grow(self, capacity: int, num_slots: int) -> 'VoxelArrays':
        """
        Return larger arrays with the contents of these.

        Parameters
        ----------
        capacity : int
            Number of slots.
        num_slots : int
            Slots that were ever in use.

        Returns
        -------
        VoxelArrays

        """
        new = allocate_voxels(capacity)
        for source, target in zip(self.columns, new.columns, strict=True):
            target[:num_slots] = source[:num_slots]
        fill_table(new.keys[:num_slots], new.counts[:num_slots], new.table)
        return new


def allocate_voxels(capacity: int) -> VoxelArrays:
    """Return arrays for ``capacity`` voxels, all free."""
    # allocated here, not in a kernel: numpy asks for large pages of memory
    return VoxelArrays(
        keys=np.empty(capacity, dtype=np.int64),
        counts=np.zeros(capacity, dtype=np.uint32),
        means=np.zeros((capacity, 3), dtype=np.float32),
        following=np.zeros(capacity, dtype=np.int32),
        labels=np.zeros(capacity, dtype=np.uint8),
        free=np.zeros(capacity, dtype=np.int32),
        changed=np.zeros(-(-capacity // LANES) * LANES, dtype=np.uint8),
        table=np.zeros(size_table(capacity), dtype=np.uint32),
    )
