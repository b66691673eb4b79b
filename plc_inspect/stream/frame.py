# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The frame of every message of the stream: a head of 18 bytes, and a compressed body.

The head names the run of the node, numbers the message and tells the node's steady time, so that
whoever receives it knows what was lost and how old everything is, without clocks that agree.
"""

from dataclasses import dataclass
import struct
from typing import Any
import zlib

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.printable import make_printable

SUMMARY, CLOUD = b'PLCS', b'PLCC'
VERSION = 4
LARGEST = 1 << 26
"""A body that would unpack to more is refused [bytes]."""
LEVEL = 6
_HEAD = struct.Struct('<4sBBIII')


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One message of the stream."""

    kind: bytes
    """SUMMARY or CLOUD."""
    flags: int
    session: int
    """Random number of this run of the node."""
    sequence: int
    """Number of the message, 0 the first of its kind."""
    uptime: float
    """Steady time of the node when it was sent [s]."""
    body: bytes


def pack_frame(frame: Frame) -> bytes:
    """Return the bytes of a message."""
    head = _HEAD.pack(
        frame.kind, VERSION, frame.flags, frame.session, frame.sequence,
        round(frame.uptime * 1e3) & 0xFFFFFFFF,
    )
    return head + zlib.compress(frame.body, LEVEL)


def unpack_frame(data: bytes, kind: bytes) -> Frame:
    """
    Read the bytes of a message.

    Parameters
    ----------
    data : bytes
        As ``pack_frame`` gave them.
    kind : bytes
        What is expected.

    Returns
    -------
    Frame

    Raises
    ------
    DataError
        Too short, of another kind or version, or damaged.

    """
    if len(data) < _HEAD.size:
        raise DataError(f'message of {len(data)} bytes, its head alone has {_HEAD.size}')
    name, version, flags, session, sequence, uptime = _HEAD.unpack_from(data)
    if name != kind:
        raise DataError(f'message of kind {name!r}, expected {kind!r}')
    if version != VERSION:
        raise DataError(f'stream of version {version}, this program reads version {VERSION}')
    expander = zlib.decompressobj()
    try:
        body = expander.decompress(data[_HEAD.size:], LARGEST)
    except zlib.error as error:
        raise DataError(f'message {sequence} is damaged: {error}') from error
    if not expander.eof:
        raise DataError(f'message {sequence} is cut off or holds more than {LARGEST} bytes')
    return Frame(
        kind=name, flags=flags, session=session, sequence=sequence, uptime=uptime * 1e-3,
        body=body,
    )


def read_number(data: bytes) -> tuple[int, int]:
    """Return session and number of a message, without unpacking it; -1, -1 if it is too short."""
    if len(data) < _HEAD.size:
        return -1, -1
    _, _, _, session, sequence, _ = _HEAD.unpack_from(data)
    return session, sequence


def put_rows(rows: NDArray[Any]) -> bytes:
    """Return the number of rows (uint32) and their bytes, column after column."""
    count, size = len(rows), rows.dtype.itemsize
    planes = np.ascontiguousarray(rows).view(np.uint8).reshape(count, size).T
    return struct.pack('<I', count) + planes.tobytes()


def put_text(text: str) -> bytes:
    """Return the length of a text (uint16) and its bytes."""
    data = text.encode('utf-8')[:0xFFFF]
    return struct.pack('<H', len(data)) + data


class BodyReader:
    """
    Reads a body from its beginning to its end.

    Parameters
    ----------
    body : bytes
        Unpacked.

    """

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def take(self, size: int) -> bytes:
        """
        Return the next bytes.

        Raises
        ------
        DataError
            The body ends before.

        """
        end = self._at + size
        if end > len(self._body):
            raise DataError(f'body of {len(self._body)} bytes ends before byte {end}')
        piece = self._body[self._at:end]
        self._at = end
        return piece

    def take_struct(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return the next values of a layout."""
        return layout.unpack(self.take(layout.size))

    def take_rows(self, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return rows that ``put_rows`` wrote, (N,) of the dtype."""
        (count,) = struct.unpack('<I', self.take(4))
        planes = np.frombuffer(self.take(count * dtype.itemsize), dtype=np.uint8)
        rows = np.ascontiguousarray(planes.reshape(dtype.itemsize, count).T)
        return rows.reshape(-1).view(dtype) if count else np.empty(0, dtype)

    def take_text(self) -> str:
        """Return a text that ``put_text`` wrote, with control characters written out."""
        (size,) = struct.unpack('<H', self.take(2))
        return make_printable(self.take(size).decode('utf-8', 'replace'))

    def finish(self) -> None:
        """
        Check that nothing is left.

        Raises
        ------
        DataError
            The body goes on.

        """
        if self._at != len(self._body):
            raise DataError(f'{len(self._body) - self._at} bytes too many in the body')
