# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Read the points of a tile and its halo from the cells on disk, in the order of the inputs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plc_inspect.core.numerics.arrays import put_rows
from plc_inspect.errors import DataError
from plc_inspect.grid.cells.cut import ATTRIBUTES, WITHHELD_PLACES
from plc_inspect.results import Bool, Float64, Int64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Points:
    """Points of some cells."""

    points: Float64
    """(N, 3) in the order of the inputs [m]."""
    number: Int64
    """(N,) index of each among all points of the grid."""
    core: Bool
    """(N,) those of the tile itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """The points of one cell from one part of an input."""

    cell: int
    part: str
    first: int
    """Index of the first point of the part among all points of the grid."""


def read_points(
    folder: Path, pieces: Sequence[Piece], core: Sequence[int],
    rectangle: tuple[float, float, float, float],
) -> Points:
    """
    Read the points of a tile and its halo.

    Parameters
    ----------
    folder : Path
        Of the cells.
    pieces : sequence of Piece
        All that may hold points within the rectangle.
    core : sequence of int
        Cells of the tile.
    rectangle : tuple of float
        Least x and y, greatest x and y of the tile with its halo [m].

    Returns
    -------
    Points

    Raises
    ------
    DataError
        A cell on disk is damaged.

    """
    own = set(core)
    chosen: list[Bool | None] = []
    for piece in pieces:
        inside = None
        if piece.cell not in own:
            x, y = read_piece(folder, piece)[:, :2].T
            inside = (x >= rectangle[0]) & (x < rectangle[2])
            inside &= (y >= rectangle[1]) & (y < rectangle[3])
        chosen.append(inside)
    number, places = _rank(folder, pieces, chosen)
    points, is_core = np.empty((len(number), 3)), np.empty(len(number), dtype=bool)
    for piece, inside, place in zip(pieces, chosen, places, strict=True):
        xyz = read_piece(folder, piece)
        xyz = xyz if inside is None else xyz[inside]
        if len(xyz) != len(place):
            raise _damaged(folder, piece)
        put_rows(points, place, xyz)
        is_core[place] = inside is None
    return Points(points=points, number=number, core=is_core)


def _rank(
    folder: Path, pieces: Sequence[Piece], chosen: Sequence[Bool | None]
) -> tuple[Int64, list[Int64]]:
    """Return the numbers of all points, ascending, and the places in them of each piece's."""
    parts = []
    for piece, inside in zip(pieces, chosen, strict=True):
        key = _load(folder, piece, 'idx', np.dtype('<u4')).astype(np.int64) + piece.first
        if inside is not None:
            if len(inside) != len(key):
                raise _damaged(folder, piece)
            key = key[inside]
        parts.append(key)
    number = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
    sequence = np.argsort(number, kind='stable')
    rank = np.empty_like(sequence)
    rank[sequence] = np.arange(len(rank))
    ends = np.cumsum([len(key) for key in parts], dtype=np.int64)
    return np.take(number, sequence), np.split(rank, ends)[:-1]


def _damaged(folder: Path, piece: Piece) -> DataError:
    return DataError(f'{folder / piece.part}: cell {piece.cell} is damaged')


def read_piece(folder: Path, piece: Piece) -> Float64:
    """Return the (N, 3) points of a piece [m]; withheld ones are NaN."""
    flat = _load(folder, piece, 'xyz', np.dtype('<f8'))
    if len(flat) % 3:
        raise _damaged(folder, piece)
    return flat.reshape(-1, 3)


def read_attributes(
    folder: Path, pieces: Sequence[Piece]
) -> tuple[Float64, np.ndarray]:
    """
    Return coordinates (N, 3) [m] and (N,) ATTRIBUTES of the points, in order of the inputs.

    Withheld points are where they are, unlike in `read_points`.
    """
    number, places = _rank(folder, pieces, [None] * len(pieces))
    points, attributes = np.empty((len(number), 3)), np.empty(len(number), dtype=ATTRIBUTES)
    for piece, place in zip(pieces, places, strict=True):
        xyz, own = read_piece(folder, piece), _load(folder, piece, 'att', ATTRIBUTES)
        if not len(place) == len(xyz) == len(own):
            raise _damaged(folder, piece)
        if (folder / piece.part / f'{piece.cell}.wit').is_file():
            withheld = _load(folder, piece, 'wit', WITHHELD_PLACES)
            if withheld['row'].max(initial=0) >= len(xyz):
                raise _damaged(folder, piece)
            xyz[withheld['row']] = withheld['place']
        put_rows(points, place, xyz)
        put_rows(_as_bytes(attributes), place, _as_bytes(own))
    return points, attributes


def _as_bytes(attributes: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Return (N,) ATTRIBUTES as (N, bytes) uint8, a view."""
    return attributes.view(np.uint8).reshape(len(attributes), ATTRIBUTES.itemsize)


def _load(folder: Path, piece: Piece, suffix: str, kind: np.dtype) -> np.ndarray:  # type: ignore[type-arg]
    return np.fromfile(folder / piece.part / f'{piece.cell}.{suffix}', dtype=kind)
