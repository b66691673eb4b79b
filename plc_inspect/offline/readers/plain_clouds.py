# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Reads files of which only coordinates are used: PCD, E57, PLY and text, in parts."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.offline.readers.e57 import count_e57, find_e57_crs, iterate_e57
from plc_inspect.offline.readers.pcd import count_pcd, read_pcd
from plc_inspect.offline.readers.ply import count_ply, iterate_ply
from plc_inspect.offline.readers.xyz import estimate_xyz, iterate_xyz
from plc_inspect.results import Float64

CHUNK = 1_000_000
"""Points read at a time."""


def _iterate_pcd(path: Path, most: int) -> Iterator[Float64]:
    points = read_pcd(path)
    for begin in range(0, len(points), most):
        yield points[begin : begin + most]


READERS: dict[str, Callable[[Path, int], Iterator[Float64]]] = {
    '.pcd': _iterate_pcd, '.e57': iterate_e57, '.ply': iterate_ply, '.xyz': iterate_xyz,
    '.csv': iterate_xyz,
}
"""Readers by suffix."""
_COUNTERS: dict[str, Callable[[Path], int]] = {
    '.pcd': count_pcd, '.e57': count_e57, '.ply': count_ply, '.xyz': estimate_xyz,
    '.csv': estimate_xyz,
}
"""Functions that count points without reading them, by suffix."""


def is_plain(path: Path | str) -> bool:
    """Tell whether only coordinates are read from a file, by its suffix."""
    return Path(path).suffix.lower() in READERS


def count_plain_points(path: Path) -> int:
    """Return how many points a file holds by its header, about how many if it is text."""
    return _COUNTERS[path.suffix.lower()](path)


def iterate_points(path: Path, most: int = CHUNK) -> Iterator[Float64]:
    """
    Yield the points of a file.

    Parameters
    ----------
    path : Path
        A file with a suffix in READERS.
    most : int
        Greatest number of points yielded at once.

    Yields
    ------
    (N, 3) float64
        As in the file, including NaN and infinities.

    Raises
    ------
    DataError
        The file cannot be read, is truncated or damaged.

    """
    try:
        yield from READERS[path.suffix.lower()](path, most)
    except OSError as error:
        raise DataError(f'{path} cannot be read: {error.strerror or error}') from error


def read_points(path: Path) -> Float64:
    """Read all (N, 3) points of a file, as in `iterate_points`."""
    parts = list(iterate_points(path))
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros((0, 3)), *parts])


def find_named_crs(path: Path) -> str:
    """Return the coordinate reference system in a file, '' if none."""
    return find_e57_crs(path) if path.suffix.lower() == '.e57' else ''
