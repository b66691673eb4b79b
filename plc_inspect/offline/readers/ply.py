# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads PLY files: x, y and z of their vertices."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from plc_inspect.errors import DataError, say_needed
from plc_inspect.offline.readers.plausibility import check_precision
from plc_inspect.printable import make_one_line
from plc_inspect.results import Float64

_VERTEX = 'vertex'
_END = b'end_header'
_MOST_LINE = 10_000


def iterate_ply(path: Path, most: int) -> Iterator[Float64]:
    """
    Yield the vertices of a PLY file.

    Parameters
    ----------
    path : Path
        The file, ASCII or binary.
    most : int
        Greatest number of points yielded at once; binary files without lists are read in parts.

    Yields
    ------
    (N, 3) float64
        As in the file.

    Raises
    ------
    DataError
        plyfile is missing; the file is not a PLY file with x, y and z; it holds more or less than
        its header says; or its coordinates are too coarse.
    OSError
        The file cannot be opened.

    """
    data = _read(path)
    names = [element.name for element in data.elements]
    if _VERTEX not in names:
        raise DataError(f'{path} has no element {_VERTEX!r}, only {", ".join(names) or "none"}')
    table = data[_VERTEX].data
    fields = table.dtype.names or ()
    missing = [name for name in 'xyz' if name not in fields]
    if missing:
        raise DataError(f'{path} has no property {missing[0]!r}, only {", ".join(fields)}')
    if any(table.dtype[name].kind == 'O' for name in 'xyz'):
        raise DataError(f'{path}: x, y and z of a vertex are lists, expected numbers')
    _check_end(path, data)
    kinds = [table.dtype[name] for name in 'xyz']
    for begin in range(0, len(table), most):
        part = table[begin : begin + most]
        points = np.column_stack([np.asarray(part[name], dtype=np.float64) for name in 'xyz'])
        check_precision(path, points, kinds)
        yield points


def count_ply(path: Path) -> int:
    """Return how many vertices the header of a PLY file counts, 0 if it does not say."""
    with path.open('rb') as file:
        for line in iter(lambda: file.readline(_MOST_LINE), b''):
            words = line.split()
            if words[:2] == [b'element', _VERTEX.encode()] and len(words) == 3:
                return int(words[2]) if words[2].isdigit() and len(words[2]) < 19 else 0
            if words[:1] == [_END]:
                break
    return 0


def _read(path: Path) -> Any:
    try:
        import plyfile
    except ModuleNotFoundError as error:
        raise say_needed(path, error) from error
    try:
        return plyfile.PlyData.read(str(path))
    except plyfile.PlyParseError as error:
        element = getattr(error, 'element', None)
        counted = '' if element is None else f'; its header counts {element.count}'
        raise DataError(
            f'{path} is damaged or truncated: {make_one_line(error)}{counted}'
        ) from error
    except (ValueError, TypeError, KeyError, AttributeError, IndexError, OverflowError) as error:
        text = make_one_line(error) or type(error).__name__
        raise DataError(f'{path} is not a readable PLY file: {text}') from error


def _check_end(path: Path, data: Any) -> None:
    """Refuse a file that is longer than its header says."""
    counted = sum(element.count for element in data.elements)
    if data.text:
        with path.open('rb') as file:
            for line in file:
                if line.strip() == _END:
                    break
            held = sum(1 for line in file if line.strip())
        if held != counted:
            raise DataError(f'{path} holds {held} rows, its header counts {counted}')
        return
    last = data.elements[-1].data
    if not isinstance(last, np.memmap):  # lists: where they end is not known
        return
    size, end = path.stat().st_size, last.offset + last.nbytes
    if size != end:
        raise DataError(
            f'{path} holds {size - end} bytes behind the {counted} elements that its header counts'
        )
