# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Eviction: removes voxels from a map that is nearly full."""

import math

import numpy as np

from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.results import Bool, Decision, Float64, Int64

START = 0.95
"""Share of the map's cap at which eviction begins.  Source: judgement; not measured."""
STOP = 0.85
"""Share of the map's cap at which eviction ends.  Source: judgement; not measured."""
BATCH = 30_000
"""
Voxels evicted in one step, as many as a scan can add.
Source: Velodyne Puck Lite data sheet: 300,000 points/s, at 10 turns/s.
"""

WIRES: Bool = np.zeros(256, dtype=np.bool_)
"""Labels that are evicted last."""
WIRES[[Decision.WIRE, Decision.SUPPORT]] = True
NOTHING: Bool = np.zeros(256, dtype=np.bool_)
"""No labels: every voxel may go."""


class Evictor:
    """
    Removes voxels in steps, the farthest from the vehicle first.

    Voxels that are neither wire nor support are removed first; wires and supports follow only if
    that is not enough.  The registry keeps their spans.

    Parameters
    ----------
    voxels : VoxelMap
        Labelled with Decision.

    """

    def __init__(self, voxels: VoxelMap) -> None:
        self._voxels = voxels
        self.num_evicted = 0
        """Voxels removed since the start."""
        self.clear()

    def clear(self) -> None:
        """Start over, as after the map was cleared."""
        self.complete = True
        """Whether the map holds all that was put into it."""
        self.nearest = math.inf
        """Least distance from the vehicle at which voxels were removed [m]."""
        self._order: Int64 = np.empty(0, dtype=np.int64)
        self._kept: Bool = WIRES
        self._active = False
        self._rest: Int64 = np.empty(0, dtype=np.int64)

    def resume(self, num_evicted: int, nearest: float) -> None:
        """Continue with the counts of an earlier process."""
        self.num_evicted, self.nearest = num_evicted, nearest
        self.complete = num_evicted == 0

    def step(self, vehicle: Float64 | None) -> int:
        """
        Evict about BATCH voxels if the map is nearly full.

        Parameters
        ----------
        vehicle : Float64 or None
            (2+,) position of the vehicle [m]; None: cells are taken in any order.

        Returns
        -------
        int
            Voxels removed.

        """
        voxels = self._voxels
        if not self._active:
            if len(voxels) < START * voxels.max_voxels:
                return 0
            self._begin(vehicle, WIRES)
        target = STOP * voxels.max_voxels
        removed = 0
        while removed < BATCH and len(voxels) > target:
            if not len(self._order):
                if self._kept is NOTHING:
                    break
                self._begin(vehicle, NOTHING)
                continue
            cell, self._order = int(self._order[0]), self._order[1:]
            dropped = voxels.drop(cell, self._kept)
            if dropped and vehicle is not None:
                apart = float(np.linalg.norm(voxels.cells.centers[cell] - vehicle[:2]))
                self.nearest = min(self.nearest, apart)
            removed += dropped
            self._rest[cell] = voxels.cells.count[cell]
        self._active = len(voxels) > target and len(self._order) > 0
        if not self._active:
            voxels.order_free()
        self.num_evicted += removed
        self.complete &= not removed
        return removed

    def _begin(self, vehicle: Float64 | None, kept: Bool) -> None:
        """List the cells with voxels to evict, the farthest first."""
        cells = self._voxels.cells
        rest = np.zeros(len(cells), dtype=np.int64)
        rest[: len(self._rest)] = self._rest
        self._rest, self._kept, self._active = rest, kept, True
        todo = np.flatnonzero(cells.count > (rest if kept is WIRES else 0))
        if vehicle is None:
            self._order = todo
            return
        apart = np.linalg.norm(cells.centers[todo] - vehicle[:2], axis=1)
        self._order = todo[np.argsort(-apart, kind='stable')]
