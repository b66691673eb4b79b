# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Reads a flight record up to its last valid chunk.

A record may end anywhere, as the process or the power failed: all chunks before the first damaged
byte are used.
"""

from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
import struct
from typing import Any, IO

from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import breakup_chunk, StreamReader
import zstandard

from plc_inspect.core.live.session import Kept
from plc_inspect.core.voxel_buffer.voxel_changes import StoredMap
from plc_inspect.errors import DataError
from plc_inspect.flight_record.books import BookReader
from plc_inspect.flight_record.layout import (
    BOOKS,
    CELLS,
    HEADER,
    list_segments,
    STATE,
    TOPIC,
    unpack_arrays,
    unpack_json,
    VERSION,
    VOXELS,
    WIRES,
)
from plc_inspect.flight_record.map_pieces import MapBuilder

MOST_CHUNK = 1 << 30
"""Greatest plausible size of a chunk [bytes]."""
AHEAD = 4
"""Chunks unpacked ahead, in threads of their own."""
BROKEN = (
    McapError, struct.error, zstandard.ZstdError, ValueError, KeyError, EOFError, OverflowError,
    MemoryError,
)
"""Exceptions that MCAP readers raise on damaged bytes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flight:
    """The content of a record."""

    header: Mapping[str, Any]
    """Header of the last start of the node."""
    state: Mapping[str, Any]
    """State of the input at the last chunk."""
    map: StoredMap
    kept: Kept
    num_chunks: int
    notes: tuple[str, ...] = ()
    """Unusable parts of the record, one line each."""


@dataclass(slots=True)
class _Builder:
    """The content of the segments read so far."""

    header: Mapping[str, Any] = field(default_factory=dict)
    state: Mapping[str, Any] = field(default_factory=dict)
    map: MapBuilder = field(default_factory=MapBuilder)
    books: BookReader = field(default_factory=BookReader)
    num_chunks: int = 0

    def put(self, topic: str, data: bytes) -> None:
        """Take a message."""
        if topic == HEADER:
            header = unpack_json(data)
            if header.get('version') != VERSION:
                raise DataError(
                    f'the record is of layout {header.get("version")!r}, this reads {VERSION}'
                )
            if header.get('fresh'):
                self.map, self.books, self.state = MapBuilder(), BookReader(), {}
            self.header = header
        elif topic == STATE:
            self.state = unpack_json(data)
        elif topic == BOOKS:
            news = unpack_json(data)
            if news.get('all'):
                self.books = BookReader()
            self.books.put(news)
        elif topic == WIRES:
            self.books.put_wires(unpack_arrays(data))
        elif topic == VOXELS:
            self.map.put_voxels(unpack_arrays(data))
        elif topic == CELLS:
            self.map.put_cells(unpack_arrays(data))


def read_flight(record: Path) -> Flight:
    """
    Read a record.

    Parameters
    ----------
    record : Path
        Its folder, or one segment.

    Returns
    -------
    Flight

    Raises
    ------
    DataError
        It is not a record, or holds no valid chunk.

    """
    if not record.exists():
        raise DataError(f'{record} does not exist')
    segments = list_segments(record)
    if not segments:
        raise DataError(f'{record} holds no segment of a flight record')
    builder, notes = _Builder(), []
    for path in segments:
        if note := _read_segment(path, builder):
            notes.append(note)
    if not builder.state:
        reason = f': {notes[0]}' if notes else ''
        raise DataError(f'{record} holds no whole chunk of a flight record{reason}')
    state = builder.state
    try:
        stored = builder.map.build(state['num_slots'], state['origin'], state['sequence'])
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f'{record} holds no map: {type(error).__name__}: {error}') from error
    return Flight(
        header=builder.header, state=state, map=stored, kept=builder.books.build(),
        num_chunks=builder.num_chunks, notes=tuple(notes),
    )


def find_end(record: Path) -> str:
    """
    Return where the results of a properly closed record are.

    Returns
    -------
    str
        Path of the results; '' if the record was not closed, or the results were not saved.

    """
    segments = list_segments(record)
    if not segments:
        return ''
    try:
        with segments[-1].open('rb') as stream:
            reader = SeekingReader(stream, validate_crcs=True, record_size_limit=MOST_CHUNK)
            if reader.get_summary() is None:
                return ''
            found = reader.iter_messages(topics=[TOPIC + STATE], reverse=True)
            message = next((item for _, _, item in found), None)
            return '' if message is None else str(unpack_json(message.data).get('closed', ''))
    except (OSError, DataError, *BROKEN):
        return ''


def _read_segment(path: Path, builder: _Builder) -> str:
    """Read a segment up to its last valid chunk; return the error after it, '' none."""
    position = 0
    try:
        with path.open('rb') as stream, ThreadPoolExecutor(2) as pool:
            for chunk, end in _unpack_ahead(stream, pool):
                for topic, data in chunk:
                    builder.put(topic, data)
                builder.num_chunks += 1
                position = end
    except OSError as error:
        return f'{path} cannot be read: {error.strerror}'
    except DataError as error:
        return f'{path}: {error}'
    except BROKEN as error:
        rest = path.stat().st_size - position
        kind = type(error).__name__
        return f'{path}: the last {rest} bytes are cut off or damaged ({kind}), and left out'
    return ''


def _unpack_ahead(
    stream: IO[bytes], pool: ThreadPoolExecutor
) -> Iterator[tuple[list[tuple[str, bytes]], int]]:
    """Yield topics and data of the messages of each chunk, and where in the file it ends."""
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=MOST_CHUNK)
    channels: dict[int, str] = {}
    ahead: deque[tuple[Future[list[McapRecord]], int]] = deque()
    broken: Exception | None = None
    records = reader.records
    while True:
        while broken is None and len(ahead) < AHEAD:
            try:
                record = next(records, None)
            except BROKEN as error:
                broken = error
                break
            if record is None:
                break
            if isinstance(record, Chunk):
                if record.uncompressed_size > MOST_CHUNK:
                    broken = ValueError(f'a chunk of {record.uncompressed_size} bytes')
                    break
                ahead.append((pool.submit(breakup_chunk, record, True), stream.tell()))
        if not ahead:
            if broken is not None:
                raise broken
            return
        job, position = ahead.popleft()
        messages = []
        for item in job.result():
            if isinstance(item, Channel):
                channels[item.id] = item.topic.removeprefix(TOPIC)
            elif isinstance(item, Message):
                messages.append((channels[item.channel_id], item.data))
        yield messages, position
