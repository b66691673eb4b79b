# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Read the points of a tile and its halo from the cells on disk, in the order of the inputs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.grid.cells.cut import ATTRIBUTES
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
    points, order, marks = [], [], []
    for piece in pieces:
        xyz = read_piece(folder, piece)
        key = _load(folder, piece, 'idx', np.dtype('<u4')).astype(np.int64)
        if len(xyz) != len(key):
            raise DataError(f'{folder / piece.part}: cell {piece.cell} is damaged')
        is_core = piece.cell in own
        if not is_core:
            inside = (xyz[:, 0] >= rectangle[0]) & (xyz[:, 0] < rectangle[2])
            inside &= (xyz[:, 1] >= rectangle[1]) & (xyz[:, 1] < rectangle[3])
            if not inside.all():
                xyz, key = xyz[inside], key[inside]
        points.append(xyz)
        order.append(key + piece.first)
        marks.append(np.full(len(key), is_core))
    if not points:
        return Points(
            points=np.zeros((0, 3)), number=np.zeros(0, dtype=np.int64),
            core=np.zeros(0, dtype=bool),
        )
    number = np.concatenate(order)
    sequence = np.argsort(number, kind='stable')
    return Points(
        points=np.take(np.concatenate(points), sequence, axis=0),  # [sequence] is slow
        number=np.take(number, sequence), core=np.take(np.concatenate(marks), sequence),
    )


def read_piece(folder: Path, piece: Piece) -> Float64:
    """Return the (N, 3) points of a piece [m]."""
    return _load(folder, piece, 'xyz', np.dtype('<f8')).reshape(-1, 3)


def read_attributes(
    folder: Path, pieces: Sequence[Piece]
) -> tuple[Float64, np.ndarray]:
    """Return coordinates (N, 3) [m] and (N,) ATTRIBUTES of the points, in order of the inputs."""
    points, order, attributes = [], [], []
    for piece in pieces:
        points.append(read_piece(folder, piece))
        key = _load(folder, piece, 'idx', np.dtype('<u4')).astype(np.int64)
        order.append(key + piece.first)
        attributes.append(_load(folder, piece, 'att', ATTRIBUTES))
    sequence = np.argsort(np.concatenate(order), kind='stable')
    return (
        np.take(np.concatenate(points), sequence, axis=0),
        np.take(np.concatenate(attributes), sequence),
    )


def _load(folder: Path, piece: Piece, suffix: str, kind: np.dtype) -> np.ndarray:  # type: ignore[type-arg]
    return np.fromfile(folder / piece.part / f'{piece.cell}.{suffix}', dtype=kind)
