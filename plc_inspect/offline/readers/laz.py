# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads LAS and LAZ with a decoder that raises errors for truncated and damaged files."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import struct
from typing import BinaryIO

import laspy
import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.results import UInt8

BACKENDS = (laspy.LazBackend.LazrsParallel, laspy.LazBackend.Lazrs)
"""
The backends of lazrs.

laspy would also try LASzip if it is installed: version 0.3.0 of its Python package ends the
process with a segmentation fault on some truncated files.
"""
MOST_IN_CHUNK = 10_000_000
"""Greatest number of points of a chunk; writers use 50,000."""
MOST_RATIO = 1000
"""
Times the size of a file that its points may take at most.
Source: judgement: LAZ packs points of real clouds to a tenth, and equal ones to some hundredth.
"""
ITEMS = 34
"""Offset of the list of a point's items in the LASzip record [bytes]."""
_ANY_SIZE = 2**32 - 1
"""Marks chunks of different sizes."""


@contextmanager
def open_las(path: Path) -> Iterator[laspy.LasReader]:
    """
    Open a LAS or LAZ file for reading in parts.

    Raises the errors of laspy, lazrs, struct, numpy and the system; ValueError if a damaged file
    would make lazrs allocate more memory than there is, which ends the process; and RuntimeError
    if lazrs panics, which no handler of errors would catch.
    """
    with (
        panics_as_errors(), path.open('rb') as file,
        laspy.open(file, laz_backend=BACKENDS) as reader,
    ):
        if reader.header.are_points_compressed:
            _check_chunks(file, reader.header)
        yield reader


@contextmanager
def panics_as_errors() -> Iterator[None]:
    """Raise RuntimeError if lazrs panics, which no handler of errors would catch."""
    try:
        yield
    except BaseException as error:
        if type(error).__name__ != 'PanicException':  # it cannot be imported
            raise
        raise RuntimeError(f'the decoder failed: {error}') from error


def read_las(path: Path) -> laspy.LasData:
    """Read a whole LAS or LAZ file; errors are those of `open_las`."""
    with open_las(path) as reader:
        return reader.read()


def read_classes(path: Path) -> UInt8:
    """
    Read the ASPRS classes of a labelled LAS or LAZ file.

    Returns
    -------
    (N,) uint8
        In file order.

    Raises
    ------
    DataError
        The file is missing or cannot be read.

    """
    if not path.is_file():
        raise DataError(f'{path} does not exist')
    try:
        return np.array(read_las(path).classification, dtype=np.uint8)
    except Exception as error:  # laspy passes errors of its decoders on
        raise DataError(f'{path} is not a readable LAS file: {error}') from error


def _check_chunks(file: BinaryIO, header: laspy.LasHeader) -> None:
    """Refuse impossible sizes and numbers of chunks; leave all else to the decoder."""
    place, size = file.tell(), os.fstat(file.fileno()).st_size
    if header.point_count * header.point_format.size > MOST_RATIO * size:
        raise ValueError(f'{header.point_count} points in {size} bytes')
    in_chunk = _ANY_SIZE
    options = b''.join(vlr.record_data for vlr in header.vlrs.get('LasZipVlr')[:1])
    if len(options) >= 16:
        (in_chunk,) = struct.unpack_from('<I', options, 12)
        if in_chunk != _ANY_SIZE and in_chunk > max(header.point_count, MOST_IN_CHUNK):
            raise ValueError(f'chunks of {in_chunk} points, it has {header.point_count}')
        sizes = np.frombuffer(options[ITEMS:], np.uint8)
        sizes = sizes[: len(sizes) // 6 * 6].view('<u2')[1::3]  # of type, size and version
        if in_chunk == 0 or not sizes.any():
            raise ValueError(f'chunks of {in_chunk} points of {int(sizes.sum())} bytes')
    file.seek(header.offset_to_point_data)
    table = _read(file, '<q')
    if table == -1 and size >= 8:  # a writer that cannot seek puts it into the last bytes
        file.seek(size - 8)
        table = _read(file, '<q')
    if 0 <= table <= size:
        file.seek(table + 4)
        num_chunks = _read(file, '<I')
        too_few = num_chunks * in_chunk < header.point_count
        if too_few or num_chunks > min(header.point_count, size):
            raise ValueError(f'{num_chunks} chunks for {header.point_count} points')
    file.seek(place)


def _read(file: BinaryIO, kind: str) -> int:
    """Return the number at the position of a file, -1 at its end."""
    data = file.read(struct.calcsize(kind))
    return int(struct.unpack(kind, data)[0]) if len(data) == struct.calcsize(kind) else -1
