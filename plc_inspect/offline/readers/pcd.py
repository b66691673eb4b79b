# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads PCD files (Point Cloud Library): ascii, binary and binary_compressed."""

from dataclasses import dataclass
import io
from pathlib import Path

from numba import njit
import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.plausibility import check_precision
from plc_inspect.results import Float64, UInt8

_KINDS = {'F': 'f', 'I': 'i', 'U': 'u'}
_MAX_HEADER = 65536


@dataclass(frozen=True, slots=True)
class _Header:
    names: tuple[str, ...]
    formats: tuple[str, ...]
    """numpy format of one element of each field."""
    counts: tuple[int, ...]
    num_points: int
    encoding: str
    size: int
    """Bytes of the header, where the data begin."""

    @property
    def widths(self) -> list[int]:
        """Bytes of each field in one point."""
        pairs = zip(self.formats, self.counts, strict=True)
        return [np.dtype(kind).itemsize * count for kind, count in pairs]


def read_pcd(path: Path) -> Float64:
    """
    Read the coordinates of a PCD file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    Float64
        (N, 3) points as in the file, including NaN and infinities.

    Raises
    ------
    DataError
        The file is not a PCD file with x, y and z, is truncated or damaged, holds more than its
        header counts, or its coordinates are too coarse.
    OSError
        The file cannot be opened.

    """
    data = path.read_bytes()
    header = _parse_header(path, data)
    missing = [name for name in 'xyz' if name not in header.names]
    if missing:
        raise DataError(f'{path} has no field {missing[0]!r}, only {", ".join(header.names)}')
    if header.encoding == 'ascii':
        return _read_ascii(path, header, data)
    read = _read_binary if header.encoding == 'binary' else _read_compressed
    points = read(path, header, data)
    check_precision(path, points, [header.formats[header.names.index(name)] for name in 'xyz'])
    return points


def count_pcd(path: Path) -> int:
    """Return how many points the header of a PCD file counts."""
    with path.open('rb') as file:
        return _parse_header(path, file.read(_MAX_HEADER)).num_points


def _parse_header(path: Path, data: bytes) -> _Header:
    values: dict[str, list[str]] = {}
    position = 0
    while 'DATA' not in values:
        end = data.find(b'\n', position, _MAX_HEADER)
        if end < 0:
            raise DataError(f'{path} is not a PCD file: its header has no DATA line')
        words = data[position:end].decode('latin-1').split()
        position = end + 1
        if words and not words[0].startswith('#'):
            values[words[0].upper()] = words[1:]
    try:
        names = tuple(values['FIELDS'])
        sizes = [int(size) for size in values['SIZE']]
        counts = tuple(int(count) for count in values.get('COUNT', ['1'] * len(names)))
        kinds = [_KINDS[kind.upper()] for kind in values['TYPE']]
        formats = tuple(f'<{kind}{size}' for kind, size in zip(kinds, sizes, strict=True))
        for name in formats:
            np.dtype(name)
        width, height = int(values['WIDTH'][0]), int(values['HEIGHT'][0])
        num_points = int(values.get('POINTS', [str(width * height)])[0])
        encoding = values['DATA'][0].lower()
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise DataError(f'{path} has a malformed PCD header: {error!r}') from error
    if not len(names) == len(formats) == len(counts) or min(counts, default=0) < 1:
        raise DataError(f'{path}: FIELDS, SIZE, TYPE and COUNT of its header do not agree')
    if num_points < 0 or num_points != width * height:
        raise DataError(f'{path}: {num_points} points are not {width} x {height}')
    if encoding not in ('ascii', 'binary', 'binary_compressed'):
        raise DataError(f'{path}: unknown PCD encoding {encoding!r}')
    return _Header(names, formats, counts, num_points, encoding, position)


def _read_ascii(path: Path, header: _Header, data: bytes) -> Float64:
    starts = np.concatenate(([0], np.cumsum(header.counts)[:-1]))
    columns = [int(starts[header.names.index(name)]) for name in 'xyz']
    text = data[header.size :]
    if not header.num_points and not text.strip():
        return np.empty((0, 3))
    try:
        points = np.loadtxt(io.BytesIO(text), dtype=np.float64, usecols=columns, ndmin=2)
    except ValueError as error:
        raise DataError(f'{path} is damaged: {error}') from error
    if points.shape != (header.num_points, 3):
        raise DataError(f'{path} holds {len(points)} points, its header says {header.num_points}')
    return points


def _read_binary(path: Path, header: _Header, data: bytes) -> Float64:
    step = sum(header.widths)
    needed = header.num_points * step
    _check_size(path, len(data) - header.size, needed)
    _check_end(path, header, data[header.size + needed :])
    cells = np.frombuffer(data, np.uint8, needed, header.size).reshape(-1, step)
    offsets = np.concatenate(([0], np.cumsum(header.widths)[:-1]))
    points = np.empty((header.num_points, 3))
    for axis, name in enumerate('xyz'):
        field = header.names.index(name)
        dtype = np.dtype(header.formats[field])
        column = cells[:, offsets[field] : offsets[field] + dtype.itemsize]
        with np.errstate(invalid='ignore'):  # signalling NaN are allowed
            points[:, axis] = np.ascontiguousarray(column).view(dtype)[:, 0]
    return points


def _read_compressed(path: Path, header: _Header, data: bytes) -> Float64:
    if header.num_points == 0:
        return np.empty((0, 3))
    _check_size(path, len(data) - header.size, 8)
    packed_size, size = (int(n) for n in np.frombuffer(data, '<u4', 2, header.size))
    needed = header.num_points * sum(header.widths)
    if size != needed:
        raise DataError(f'{path} unpacks to {size} bytes, its header says {needed}')
    _check_size(path, len(data) - header.size - 8, packed_size)
    packed = np.frombuffer(data, np.uint8, packed_size, header.size + 8)
    plain = np.empty(size, dtype=np.uint8)
    if _unpack_lzf(packed, plain) != size:
        raise DataError(f'{path} is damaged: its compressed data are not valid')
    # compressed data are stored field by field, not point by point
    starts = np.concatenate(([0], np.cumsum(header.widths)[:-1])) * header.num_points
    points = np.empty((header.num_points, 3))
    for axis, name in enumerate('xyz'):
        field = header.names.index(name)
        values: NDArray[np.generic] = np.frombuffer(
            plain.data,
            header.formats[field],
            header.num_points * header.counts[field],
            starts[field],
        )
        points[:, axis] = values[:: header.counts[field]]
    return points


def _check_size(path: Path, size: int, needed: int) -> None:
    if size < needed:
        raise DataError(f'{path} is truncated: {size} bytes of data, {needed} are needed')


def _check_end(path: Path, header: _Header, rest: bytes) -> None:
    """Refuse what follows the points, but for the zeros with which PCL filled the last page."""
    if rest.strip(b'\0'):
        raise DataError(
            f'{path} holds {len(rest)} bytes behind the {header.num_points} points that its header'
            f' counts, of {sum(header.widths)} bytes each: which is right? Write the file again'
        )


@njit(cache=True, nogil=True)
def _unpack_lzf(packed: UInt8, plain: UInt8) -> int:
    """Unpack LZF data; return the bytes written, -1 if the data are not valid."""
    read, write = 0, 0
    while read < len(packed):
        control = np.int64(packed[read])
        read += 1
        # a run of plain bytes
        if control < 32:
            length = control + 1
            if read + length > len(packed) or write + length > len(plain):
                return -1
            for _ in range(length):
                plain[write] = packed[read]
                read += 1
                write += 1
            continue
        # a reference to bytes written before: its length, and how far back they are
        length = control >> 5
        if length == 7:
            if read >= len(packed):
                return -1
            length += np.int64(packed[read])
            read += 1
        if read >= len(packed):
            return -1
        source = write - ((control & 31) << 8) - np.int64(packed[read]) - 1
        read += 1
        length += 2
        if source < 0 or write + length > len(plain):
            return -1
        for _ in range(length):
            plain[write] = plain[source]
            source += 1
            write += 1
    return write
