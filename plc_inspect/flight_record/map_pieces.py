# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The map in a record: packed changes of voxels and cells, and the map rebuilt from them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.config import MOST_VOXELS
from plc_inspect.core.voxel_buffer.change_flags import LABELLED, MADE
from plc_inspect.core.voxel_buffer.voxel_changes import StoredMap, VoxelChanges
from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import join_bytes, pack_arrays, split_bytes
from plc_inspect.results import Float32, Int32, Int64

LEAST_ROOM = 1 << 23
"""
Slots allocated at first; the system commits memory only where it is written.
Source: numerical: the default of map.max_voxels; the arrays double when full.
"""


def pack_voxels(parts: Sequence[VoxelChanges]) -> bytes:
    """
    Pack changed voxels.

    Parameters
    ----------
    parts : sequence of VoxelChanges
        Disjoint sets of slots.

    Returns
    -------
    bytes
        All fields of new voxels; slot and changed fields of the others.

    """
    slots = np.concatenate([part.slots for part in parts])
    kinds = np.concatenate([part.kinds for part in parts])
    made = (kinds & MADE) != 0
    grown = ~made & (kinds != LABELLED)
    labelled = ~made & ((kinds & LABELLED) != 0)
    keys = np.concatenate([part.keys for part in parts])[made]
    counts = np.concatenate([part.counts for part in parts])
    means = np.concatenate([part.means for part in parts])
    labels = np.concatenate([part.labels for part in parts])
    return pack_arrays(
        made=_pack_slots(slots[made]), keys=split_bytes(np.diff(keys, prepend=np.int64(0))),
        made_counts=split_bytes(counts[made]), made_means=split_bytes(means[made]),
        made_labels=labels[made],
        grown=_pack_slots(slots[grown]), grown_counts=split_bytes(counts[grown]),
        grown_means=split_bytes(means[grown]),
        labelled=_pack_slots(slots[labelled]), labels=labels[labelled],
    )


def _pack_slots(slots: Int32) -> NDArray[np.uint8]:
    return split_bytes(np.diff(slots, prepend=np.int32(0)))


def _unpack_slots(packed: NDArray[np.uint8]) -> Int64:
    slots = np.cumsum(join_bytes(packed, np.int32), dtype=np.int64)
    if len(slots) and not 0 <= slots.min() <= slots.max() < MOST_VOXELS:
        raise DataError(f'slots from {slots.min()} to {slots.max()} are not slots of a map')
    return slots


def find_changed_cells(
    before: tuple[Int64, Int32] | None, now: tuple[Int64, Int32]
) -> dict[str, NDArray[Any]]:
    """
    Return the cells that changed.

    Parameters
    ----------
    before, now : tuple of arrays
        As from ``CellIndex.copy_state``; None for an empty map.

    Returns
    -------
    dict
        ``cells``, their numbers, with their ``keys`` and ``state``.

    """
    keys, state = now
    known = 0 if before is None else len(before[0])
    changed = np.ones(len(keys), dtype=np.bool_)
    if before is not None:
        changed[:known] = (state[:known] != before[1]).any(axis=1)
    cells = np.flatnonzero(changed)
    return {'cells': cells.astype(np.int32), 'keys': keys[cells], 'state': state[cells]}


class MapBuilder:
    """Rebuilds a map from packed changes."""

    def __init__(self) -> None:
        self._room = LEAST_ROOM
        self._columns: dict[str, NDArray[Any]] = {
            'keys': np.zeros(self._room, dtype=np.int64),
            'counts': np.zeros(self._room, dtype=np.uint32),
            'means': np.zeros((self._room, 3), dtype=np.float32),
            'labels': np.zeros(self._room, dtype=np.uint8),
        }
        self._moved = False
        self._cell_keys: Int64 = np.empty(0, dtype=np.int64)
        self._cell_state: Int32 = np.empty((0, 5), dtype=np.int32)

    def put_voxels(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Apply the output of ``pack_voxels``; DataError if it is inconsistent."""
        try:
            made, grown = _unpack_slots(arrays['made']), _unpack_slots(arrays['grown'])
            labelled = _unpack_slots(arrays['labelled'])
            self._make_room(max((int(slots[-1]) for slots in (made, grown, labelled)
                                 if len(slots)), default=0))
            own = self._columns
            keys = np.cumsum(join_bytes(arrays['keys'], np.int64))
            self._moved |= bool((own['counts'][made] * (own['keys'][made] != keys)).any())
            own['keys'][made] = keys
            own['counts'][made] = join_bytes(arrays['made_counts'], np.uint32)
            own['means'][made] = _join_means(arrays['made_means'])
            own['labels'][made] = arrays['made_labels']
            own['counts'][grown] = join_bytes(arrays['grown_counts'], np.uint32)
            self._moved |= not own['counts'][grown].all()
            own['means'][grown] = _join_means(arrays['grown_means'])
            own['labels'][labelled] = arrays['labels']
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise DataError(f'these are not voxels: {type(error).__name__}: {error}') from error

    def put_cells(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Apply the output of ``find_changed_cells``; DataError if it is inconsistent."""
        try:
            cells = arrays['cells']
            size = max(len(self._cell_keys), int(cells.max(initial=-1)) + 1)
            if size > len(self._cell_keys) + len(cells):
                raise ValueError(f'{size} cells, of which some are missing')
            more = size - len(self._cell_keys)
            self._cell_keys = np.concatenate((self._cell_keys, np.zeros(more, np.int64)))
            self._cell_state = np.concatenate((self._cell_state, np.zeros((more, 5), np.int32)))
            self._cell_keys[cells] = arrays['keys']
            self._cell_state[cells] = arrays['state']
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise DataError(f'these are not cells: {type(error).__name__}: {error}') from error

    def _make_room(self, last: int) -> None:
        if last < self._room:
            return
        while self._room <= last:
            self._room *= 2
        for name, column in self._columns.items():
            new = np.zeros((self._room, *column.shape[1:]), dtype=column.dtype)
            new[: len(column)] = column
            self._columns[name] = new

    def build(self, num_slots: int, origin: Sequence[int] | None, sequence: int) -> StoredMap:
        """
        Return the map.

        Parameters
        ----------
        num_slots : int
            Slots ever in use; those never packed are free.
        origin : sequence of int or None
            (3,) of the keys.
        sequence : int
            Newest insertion.

        Returns
        -------
        StoredMap

        """
        if not 0 <= num_slots < MOST_VOXELS:
            raise DataError(f'{num_slots} slots are not a map')
        self._make_room(num_slots)
        own = {name: column[:num_slots] for name, column in self._columns.items()}
        return StoredMap(
            **own, origin=None if origin is None else np.array(origin, dtype=np.int64),
            sequence=sequence, moved=self._moved, cell_keys=self._cell_keys,
            cell_state=self._cell_state,
        )


def _join_means(packed: NDArray[np.uint8]) -> Float32:
    return join_bytes(packed, np.float32).reshape(-1, 3)
