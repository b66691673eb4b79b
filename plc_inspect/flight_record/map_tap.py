# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Takes what changes in the map, a little at a time, so that its owner is never kept waiting."""

from plc_inspect.core.voxel_buffer.voxel_changes import VoxelChanges
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap

STEPS = 5
"""Steps in which all of the map is looked at."""
MOST_CHANGES = 20_000
"""Voxels that are taken in one step at most: half a millisecond."""
MOST_SWEPT = 30_000
"""Voxels that are told of once more in one round, while a new segment begins."""


class MapTap:
    """
    Takes what changes in a map; for the thread that owns the map.

    Parameters
    ----------
    voxels : VoxelMap
        The map.

    """

    def __init__(self, voxels: VoxelMap) -> None:
        self._voxels = voxels
        self._swept: int | None = None
        self._sweep_stop = 0
        self._begin_round()

    def _begin_round(self) -> None:
        self.changes: list[VoxelChanges] = []
        """What was taken in this round."""
        self.swept: list[VoxelChanges] = []
        """What was told of once more in this round."""
        self.whole = self._voxels.sequence
        """Insertion up to which this round will have taken everything."""
        self._at, self._step = 0, 0
        self._stop = self._voxels.num_slots
        self._generation = self._voxels.generation

    @property
    def sweeping(self) -> bool:
        """Whether all of the map is being told of once more."""
        return self._swept is not None

    @property
    def over(self) -> bool:
        """Whether this round has looked at all of the map."""
        return self._step == STEPS and self._at >= self._stop

    def sweep(self) -> None:
        """Tell of all of the map once more from now on."""
        self._swept, self._sweep_stop = 0, self._voxels.num_slots

    def step(self) -> bool:
        """
        Take a little.

        Returns
        -------
        bool
            Whether the round is over: what it took is to be fetched by ``finish``.

        """
        self._follow()
        if self._step == 0 and self._swept is not None:  # before what changes afterwards
            part, self._swept = self._voxels.take_changes(
                self._swept, MOST_SWEPT, stop=self._sweep_stop, everything=True
            )
            self.swept.append(part)
        self._step = min(self._step + 1, STEPS)
        stop = -(-self._stop * self._step // STEPS)
        part, self._at = self._voxels.take_changes(self._at, MOST_CHANGES, stop=stop)
        self.changes.append(part)
        return self.over

    def _follow(self) -> None:
        """Forget what was taken of a map that is forgotten."""
        if self._generation != self._voxels.generation:
            self._swept = None
            self._begin_round()

    def finish(self) -> tuple[tuple[VoxelChanges, ...], tuple[VoxelChanges, ...], bool]:
        """
        Return what the round took so far, and begin another one.

        Returns
        -------
        tuple of VoxelChanges
            What changed.
        tuple of VoxelChanges
            What was told of once more.
        bool
            Whether with it all of the map was told of once more.

        """
        self._follow()
        result = tuple(self.changes), tuple(self.swept)
        complete = self._swept is not None and self._swept >= self._sweep_stop
        if complete:
            self._swept = None
        self._begin_round()
        return *result, complete
