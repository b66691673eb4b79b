# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One segment of a record: batches of changes become chunks of an MCAP file."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
import errno
from pathlib import Path
import time
from typing import Any

from plc_inspect.core.live.session import Kept
from plc_inspect.core.voxel_buffer.voxel_changes import VoxelChanges
from plc_inspect.flight_record.books import BookWriter
from plc_inspect.flight_record.layout import (
    BOOKS,
    CELLS,
    describe_topic,
    HEADER,
    pack_arrays,
    pack_json,
    PROFILE,
    STATE,
    TOPIC,
    VERSION,
    VOXELS,
    WIRES,
)
from plc_inspect.flight_record.map_pieces import find_changed_cells, pack_voxels
from plc_inspect.flight_record.plain_values import to_plain
from plc_inspect.mcap_file import McapFile
from plc_inspect.results import Int32, Int64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """The changes of a fraction of a second; immutable."""

    generation: int
    """How often the map was cleared before."""
    changes: tuple[VoxelChanges, ...]
    """Changed voxels, as disjoint sets of slots."""
    sweep: tuple[VoxelChanges, ...]
    """Repeated voxels, changed or not, as disjoint sets of slots."""
    cells: tuple[Int64, Int32]
    """All cells of the map, as from ``CellIndex.copy_state``."""
    kept: Kept | None
    """State of the session, None: unchanged."""
    state: Mapping[str, Any]
    """State of the input, JSON-serialisable."""
    begins: bool = False
    """A new segment begins, in which the whole map is repeated."""
    complete: bool = False
    """This segment now holds the whole map."""


class Segment:
    """
    Writes one segment.

    Parameters
    ----------
    path : Path
        Its file, which must not exist.
    header : mapping
        What the node was started with, JSON-serialisable.
    fresh : bool
        All earlier segments are obsolete.

    Raises
    ------
    ConfigError
        The file cannot be created.

    """

    def __init__(self, path: Path, header: Mapping[str, Any], *, fresh: bool) -> None:
        self.path = path
        self._file = McapFile(path, profile=PROFILE)
        self._books = BookWriter()
        self._cells: tuple[Int64, Int32] | None = None
        head = {'version': VERSION, 'fresh': fresh, **header}
        self._write(HEADER, pack_json(to_plain(head)))

    @property
    def size(self) -> int:
        """What was written so far [bytes]."""
        return self._file.size

    def put(self, batch: Batch) -> None:
        """Add a batch to the next chunk."""
        for parts in (batch.sweep, batch.changes):
            if any(len(part.slots) for part in parts):
                self._write(VOXELS, pack_voxels(parts))
        cells = find_changed_cells(self._cells, batch.cells)
        self._cells = batch.cells
        if len(cells['cells']):
            self._write(CELLS, pack_arrays(**cells))
        if batch.kept is not None:
            news, wires = self._books.describe(batch.kept)
            self._write(BOOKS, pack_json(news))
            if wires is not None:
                self._write(WIRES, pack_arrays(**wires))
        self._write(STATE, pack_json(to_plain(batch.state)))

    def flush(self) -> None:
        """
        Write the pending batches and sync them to disk.

        Raises
        ------
        OSError
            It cannot be written now; the next call writes it.

        """
        self._file.flush()
        self._file.sync()
        if not self.path.exists():
            raise FileNotFoundError(errno.ENOENT, 'the record was removed')

    def close(self) -> None:
        """Close the file with its summary; OSError if it cannot be written."""
        self._file.close()

    def remove(self) -> None:
        """Close and remove the file."""
        with suppress(OSError):
            self._file.close()
        self.path.unlink(missing_ok=True)

    def _write(self, topic: str, data: bytes) -> None:
        kind = describe_topic(topic)
        channel = self._file.add_channel(
            TOPIC + topic, kind.name, kind.definition, kind.encoding
        )
        self._file.write(channel, time.time_ns(), data)
