# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the map keeps of each voxel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.numerics.hash_table import size_table, UInt32
from plc_inspect.core.voxel_buffer.voxel_changes import LANES
from plc_inspect.core.voxel_buffer.voxel_hash import fill_table
from plc_inspect.results import Float32, Int32, Int64, UInt8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VoxelArrays:
    """Room for C voxels by slot, and the table that finds them; kernels write to the arrays."""

    keys: Int64
    """(C,) packed keys, see `voxel_keys`."""
    counts: UInt32
    """(C,) points, 0 where a slot is free."""
    means: Float32
    """(C, 3) mean offset of the points from the voxel's centre [m]."""
    following: Int32
    """(C,) next slot of the same plan cell, -1 at the end."""
    labels: UInt8
    """(C,) labels, such as PointClass."""
    free: Int32
    """(C,) slots that are free, as many as the map says; the last is taken first."""
    changed: UInt8
    """(C,) what changed of each voxel since it was last taken; LANES of them are a word."""
    table: UInt32
    """Hash table of the keys."""

    @property
    def capacity(self) -> int:
        """Voxels that there is room for."""
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
        Return more room with what is in this one.

        Parameters
        ----------
        capacity : int
            Voxels to make room for.
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
    """Return room for some voxels, with none in it."""
    # made here and not in a kernel, as numpy asks for large pages of memory
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
