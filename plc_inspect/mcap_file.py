# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Writes an MCAP file that is valid at every moment, even if the writer is killed.

After the last chunk the file has an end of data, a footer without a summary and the magic bytes,
so it is complete.  The next chunk is first written behind them, and its beginning over them last,
so a sequential reader finds a complete file at every moment.  An orderly end adds the summary,
which lets readers seek.
"""

from collections import Counter
import os
from pathlib import Path
from types import TracebackType
import zlib

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
import zstandard

from plc_inspect import __version__
from plc_inspect.errors import ConfigError


class McapFile:
    """
    Writes messages; they are in the file after each ``flush``.

    Parameters
    ----------
    path : Path
        File to write.
    force : bool
        Replace an existing file.
    profile : str
        Profile of the MCAP specification.

    Raises
    ------
    ConfigError
        The file exists, or cannot be written.

    """

    def __init__(self, path: Path, *, force: bool = False, profile: str = 'ros2') -> None:
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | (os.O_TRUNC if force else os.O_EXCL)
        try:
            self._file = os.open(path, flags, 0o644)
        except FileExistsError as error:
            raise ConfigError(f'{path} is there already: --force replaces it') from error
        except OSError as error:
            raise ConfigError(f'{path}: {error.strerror}') from error
        self._compressor = zstandard.ZstdCompressor(level=3)
        self._chunk = RecordBuilder()
        self._indexes: dict[int, MessageIndex] = {}
        self._times: list[int] = []
        self._channels: dict[str, Channel] = {}
        self._schemas: dict[str, Schema] = {}
        self._chunk_indexes: list[ChunkIndex] = []
        self._counts: Counter[int] = Counter()
        self._span: tuple[int, int] | None = None
        head = RecordBuilder()
        Header(profile=profile, library=f'plc_inspect {__version__}').write(head)
        start = MCAP0_MAGIC + head.end()
        self._end = self._tail = 0
        self._packed = b''
        try:
            self._put(start)
        except OSError as error:  # a file left here would be in the way of the next attempt
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise ConfigError(f'{path}: {error.strerror}') from error

    def __enter__(self) -> 'McapFile':
        """Return the file."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file with its summary."""
        self.close()

    @property
    def size(self) -> int:
        """Size written so far [bytes]."""
        return self._end

    @property
    def fileno(self) -> int:
        """File descriptor."""
        return self._file

    def add_channel(
        self, topic: str, kind: str, definition: str,
        encoding: tuple[str, str] = ('ros2msg', 'cdr'),
    ) -> int:
        """
        Add a channel for a topic.

        Parameters
        ----------
        topic : str
            Its name.
        kind : str
            Its type, such as ``std_msgs/msg/String``.
        definition : str
            Definition of the type in ROS 2 syntax, with the types it uses.
        encoding : tuple of str
            Encodings of the definition and of the messages.

        Returns
        -------
        int
            Number of the channel.

        """
        if topic in self._channels:
            return self._channels[topic].id
        schema = self._schemas.get(kind)
        if schema is None:
            schema = Schema(id=len(self._schemas) + 1, name=kind, encoding=encoding[0],
                            data=definition.encode())
            self._schemas[kind] = schema
            schema.write(self._chunk)
        channel = Channel(id=len(self._channels) + 1, topic=topic, message_encoding=encoding[1],
                          metadata={}, schema_id=schema.id)
        self._channels[topic] = channel
        channel.write(self._chunk)
        return channel.id

    def write(self, channel: int, time_ns: int, data: bytes) -> None:
        """Add a serialised message to the open chunk."""
        index = self._indexes.setdefault(channel, MessageIndex(channel_id=channel, records=[]))
        index.records.append((time_ns, self._chunk.count))
        Message(channel_id=channel, log_time=time_ns, publish_time=time_ns, data=data,
                sequence=self._counts[channel]).write(self._chunk)
        self._counts[channel] += 1
        self._times.append(time_ns)

    def flush(self) -> None:
        """
        Write the messages added since the last flush; the file is valid before and after.

        Raises
        ------
        OSError
            It cannot be written now; the next call writes it.

        """
        self._pack()
        if self._packed:
            self._put(self._packed)
            self._packed = b''

    def sync(self) -> None:
        """Sync the file to disk; OSError if that fails."""
        os.fsync(self._file)

    def _pack(self) -> None:
        """Pack the added messages into a chunk, to be written next."""
        if not self._times:
            return
        start = self._end + len(self._packed)
        plain = self._chunk.end()
        first, last = min(self._times), max(self._times)
        packed = self._compressor.compress(plain)
        out = RecordBuilder()
        Chunk(compression='zstd', data=packed, message_start_time=first, message_end_time=last,
              uncompressed_crc=zlib.crc32(plain), uncompressed_size=len(plain)).write(out)
        length = out.count
        offsets = {}
        for number, index in self._indexes.items():
            offsets[number] = start + out.count
            index.write(out)
        self._chunk_indexes.append(ChunkIndex(
            chunk_length=length, chunk_start_offset=start, compression='zstd',
            compressed_size=len(packed), message_start_time=first, message_end_time=last,
            message_index_length=out.count - length, message_index_offsets=offsets,
            uncompressed_size=len(plain),
        ))
        low, high = self._span or (first, last)
        self._span = min(low, first), max(high, last)
        self._indexes, self._times = {}, []
        self._packed += out.end()

    def close(self) -> None:
        """Write the rest and the summary, and sync the file to disk."""
        if self._file < 0:
            return
        try:
            self.flush()
            self._put(b'', self._make_summary())
            self.sync()
        finally:
            os.close(self._file)
            self._file = -1

    def abandon(self) -> None:
        """Close the file as of the last flush that was written, as no more can be."""
        if self._file < 0:
            return
        try:
            os.ftruncate(self._file, self._end + self._tail)
        finally:
            os.close(self._file)
            self._file = -1

    def _put(self, records: bytes, tail: bytes = b'') -> None:
        """
        Write records over the old tail, followed by a new tail.

        The part beyond the old tail is written first, so the old end of data and footer stay in
        place until the last, short write.
        """
        data = records + (tail or _make_tail(0, 0, b''))
        for low, high in ((self._tail, len(data)), (0, min(self._tail, len(data)))):
            view, at = memoryview(data)[low:high], self._end + low
            while view:
                written = os.pwrite(self._file, view, at)
                view, at = view[written:], at + written
        self._end += len(records)
        self._tail = len(data) - len(records)

    def _make_summary(self) -> bytes:
        start = self._end + len(_make_end_of_data())
        out, offsets = RecordBuilder(), RecordBuilder()
        first, last = self._span or (0, 0)
        statistics = Statistics(
            attachment_count=0, channel_count=len(self._channels),
            channel_message_counts=dict(self._counts), chunk_count=len(self._chunk_indexes),
            message_count=sum(self._counts.values()), message_start_time=first,
            message_end_time=last, metadata_count=0, schema_count=len(self._schemas),
        )
        for opcode, group in (
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]), (Opcode.CHUNK_INDEX, self._chunk_indexes),
        ):
            before = out.count
            for record in group:
                record.write(out)
            if group:
                SummaryOffset(group_opcode=opcode, group_start=start + before,
                              group_length=out.count - before).write(offsets)
        summary = out.end()
        return _make_tail(start, start + len(summary), summary + offsets.end())


def _make_end_of_data() -> bytes:
    out = RecordBuilder()
    DataEnd(data_section_crc=0).write(out)
    return bytes(out.end())


def _make_tail(start: int, offsets: int, summary: bytes) -> bytes:
    out = RecordBuilder()
    Footer(summary_start=start, summary_offset_start=offsets, summary_crc=0).write(out)
    return _make_end_of_data() + summary + bytes(out.end()) + bytes(MCAP0_MAGIC)
