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
from plc_inspect.printable import make_one_line
from plc_inspect.results import Bool, Float64, UInt8

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
WITHHELD = 4
"""Bit of ``classification_flags`` of points to be treated as deleted (LAS 1.4 R15, table 16)."""
_OLD_WITHHELD = 128
"""The same of the byte with flags and class of point formats 0 to 5 (table 8)."""
ITEMS = 34
"""Offset of the list of a point's items in the LASzip record [bytes]."""
_PLACE = 8
"""Length of the place of the table of chunks, before the first chunk [bytes]."""
_ANY_SIZE = 2**32 - 1
"""Marks chunks of different sizes."""


@contextmanager
def open_las(path: Path) -> Iterator[laspy.LasReader]:
    """
    Open a LAS or LAZ file for reading in parts.

    Raises the errors of laspy, lazrs, struct, numpy and the system; DataError if chunks hold more
    points than the header counts; ValueError if a damaged file would make lazrs allocate more
    memory than there is, which ends the process; and RuntimeError if lazrs panics, which no
    handler of errors would catch.
    """
    with (
        panics_as_errors(), path.open('rb') as file,
        laspy.open(file, laz_backend=BACKENDS) as reader,
    ):
        if reader.header.are_points_compressed:
            _check_chunks(file, reader.header)
        yield reader


@contextmanager
def open_checked(path: Path) -> Iterator[laspy.LasReader]:
    """
    Open a LAS or LAZ file whose header agrees with its size; DataError for all that fails.

    Its extended records are read, which may hold the CRS.
    """
    try:
        _check_records(path)
        with open_las(path) as reader:
            _check_count(path, reader.header)  # before there is room made for what it counts
            _check_steps(path, reader.header)
            yield reader
    except DataError:
        raise
    except OSError as error:
        raise DataError(f'{path} cannot be read: {error.strerror or error}') from error
    except Exception as error:  # laspy passes errors of lazrs, struct and numpy on
        text = make_one_line(error) or type(error).__name__
        raise DataError(f'{path} cannot be read, is it truncated? {text}') from error


@contextmanager
def panics_as_errors() -> Iterator[None]:
    """Raise RuntimeError if lazrs panics, which no handler of errors would catch."""
    try:
        yield
    except BaseException as error:
        if type(error).__name__ != 'PanicException':  # it cannot be imported
            raise
        raise RuntimeError(f'the decoder failed: {error}') from error


def find_withheld(points: laspy.PackedPointRecord) -> Bool | None:
    """
    Find the points with the withheld flag, which are to be treated as deleted.

    Parameters
    ----------
    points : laspy.PackedPointRecord
        N points of any format.

    Returns
    -------
    (N,) bool or None
        None if there are no such points.

    """
    array = points.array
    is_modern = 'classification_flags' in (array.dtype.names or ())
    name, bit = (
        ('classification_flags', WITHHELD) if is_modern else ('raw_classification', _OLD_WITHHELD)
    )
    flagged = array[name] & np.uint8(bit)
    return flagged != 0 if flagged.any() else None


def erase_withheld(points: laspy.PackedPointRecord, places: Float64) -> int:
    """Set the places (N, 3) of points with the withheld flag to NaN; return how many these are."""
    withheld = find_withheld(points)
    if withheld is None:
        return 0
    places[withheld] = np.nan
    return int(np.count_nonzero(withheld))


def read_las(path: Path) -> laspy.LasData:
    """Read a whole LAS or LAZ file; errors are those of `open_las`."""
    with open_las(path) as reader:
        return reader.read()


def read_labelled(path: Path) -> tuple[UInt8, Float64]:
    """
    Read the ASPRS classes and the coordinates of a labelled LAS or LAZ file.

    Returns
    -------
    (N,) uint8
        In file order.
    (N, 3) float64
        In the units of the file.

    Raises
    ------
    DataError
        The file is missing or cannot be read.

    """
    if not path.is_file():
        raise DataError(f'{path} does not exist')
    try:
        las = read_las(path)
        return np.array(las.classification, dtype=np.uint8), np.array(las.xyz, dtype=np.float64)
    except Exception as error:  # laspy passes errors of its decoders on
        raise DataError(f'{path} is not a readable LAS file: {error}') from error


def _check_records(path: Path) -> None:
    """Refuse a LAS header with impossible counts of records, which laspy would believe."""
    size = path.stat().st_size
    with path.open('rb') as file:
        head = file.read(375)
    if head[:4] != b'LASF' or len(head) < 227:
        raise DataError(f'{path} is not a LAS file')
    header_size, first_point, num_vlrs = struct.unpack_from('<HII', head, 94)
    records = [('variable length', num_vlrs, header_size, first_point, 54)]
    if head[25] >= 4 and len(head) == 375:
        first_evlr, num_evlrs = struct.unpack_from('<QI', head, 235)
        records.append(('extended', num_evlrs, first_evlr, size, 60))
    for name, count, start, end, smallest in records:
        if count and start + count * smallest > end:
            raise DataError(
                f'{path} is damaged: no room for {count} {name} records between byte {start} '
                f'and {end}'
            )
    if first_point > size:
        raise DataError(f'{path} is truncated: points from byte {first_point}, size {size}')


def _check_count(path: Path, header: laspy.LasHeader) -> None:
    """Refuse an uncompressed file whose size does not match the number of points in its header."""
    if header.are_points_compressed:
        return
    first, size = header.offset_to_point_data, path.stat().st_size
    step, counted = header.point_format.size, header.point_count
    held = max(size - first, 0) // step
    if held < counted:
        raise DataError(
            f'{path} is truncated: its header counts {counted} points, {size} bytes hold {held}'
        )
    if getattr(header, 'number_of_evlrs', 0) and header.start_of_first_evlr >= first:
        held = min(held, (header.start_of_first_evlr - first) // step)
    if held > counted and not header.point_format.has_waveform_packet:
        raise DataError(
            f'{path} holds {held} points and its header counts {counted}:'
            ' which is right? Write the file again'
        )


def _check_steps(path: Path, header: laspy.LasHeader) -> None:
    """Refuse steps and offsets with which all coordinates of an axis are one, or no numbers."""
    steps, offsets = np.array(header.scales), np.array(header.offsets)
    if header.point_count and not (steps.all() and np.isfinite([steps, offsets]).all()):
        raise DataError(
            f'{path} is damaged: by its header coordinates come in steps of'
            f' {steps.tolist()} from {offsets.tolist()}'
        )


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
        if num_chunks * in_chunk < header.point_count or num_chunks > size:
            raise ValueError(f'{num_chunks} chunks for {header.point_count} points')
        # all chunks but the last are full; each begins with a point as it is, and the only one of
        # an empty file with less
        full = 1 if in_chunk == _ANY_SIZE else in_chunk
        packed = table - header.offset_to_point_data - _PLACE
        if (num_chunks - 1) * full >= header.point_count and packed >= header.point_format.size:
            raise DataError(
                f'{file.name} holds more than the {header.point_count} points that its header'
                f' counts: {num_chunks} chunks of {"any size" if full == 1 else f"{full} points"}:'
                ' write it anew'
            )
    file.seek(place)


def _read(file: BinaryIO, kind: str) -> int:
    """Return the number at the position of a file, -1 at its end."""
    data = file.read(struct.calcsize(kind))
    return int(struct.unpack(kind, data)[0]) if len(data) == struct.calcsize(kind) else -1
