# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Collects the changes of the map in small steps, so that its owner never waits."""

from plc_inspect.core.voxel_buffer.voxel_changes import VoxelChanges
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap

STEPS = 5
"""Steps of a round over the whole map."""
MOST_CHANGES = 20_000
"""Most voxels collected in one step: half a millisecond."""
MOST_SWEPT = 30_000
"""Most voxels repeated in one round while a new segment begins."""


class MapTap:
    """
    Collects the changes of a map; for the thread that owns the map.

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
        """Changes collected in this round."""
        self.swept: list[VoxelChanges] = []
        """Voxels repeated in this round."""
        self.whole = self._voxels.sequence
        """Insertion up to which this round is complete."""
        self._at, self._step = 0, 0
        self._stop = self._voxels.num_slots
        self._generation = self._voxels.generation

    @property
    def sweeping(self) -> bool:
        """Whether the whole map is being repeated."""
        return self._swept is not None

    @property
    def over(self) -> bool:
        """Whether this round has covered the map."""
        return self._step == STEPS and self._at >= self._stop

    def sweep(self) -> None:
        """Repeat the whole map from now on."""
        self._swept, self._sweep_stop = 0, self._voxels.num_slots

    def step(self) -> bool:
        """
        Collect the changes of one step.

        Returns
        -------
        bool
            Whether the round is over; fetch its changes by ``finish``.

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
        """Discard changes of a map that was cleared."""
        if self._generation != self._voxels.generation:
            self._swept = None
            self._begin_round()

    def finish(self) -> tuple[tuple[VoxelChanges, ...], tuple[VoxelChanges, ...], bool]:
        """
        Return the changes of the round, and begin another one.

        Returns
        -------
        tuple of VoxelChanges
            What changed.
        tuple of VoxelChanges
            Repeated voxels.
        bool
            Whether the repetition of the whole map is now complete.

        """
        self._follow()
        result = tuple(self.changes), tuple(self.swept)
        complete = self._swept is not None and self._swept >= self._sweep_stop
        if complete:
            self._swept = None
        self._begin_round()
        return *result, complete
