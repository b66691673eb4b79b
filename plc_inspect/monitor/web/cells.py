# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The corridor in the format of the page: points as whole numbers, coloured by clearance."""

from dataclasses import dataclass
import struct

import numpy as np
from numpy.typing import NDArray

from plc_inspect.monitor.picture.cloud_store import CellArrays, CloudStore
from plc_inspect.results import Float32, PointClass, UInt8
from plc_inspect.stream.blocks import BlockKey

NEAR, FAR = 2.0, 15.0
"""Clearances at the two ends of the colour ramp [m]."""
RAMP = ('#c1121f', '#e69f00', '#cdb877', '#8fa3b5', '#74889b')
"""
From near to far.
Source: red, orange and blue-grey differ in lightness and in blue, which colour-blind eyes see.
"""
GROUND, STRUCTURE = (128, 116, 104), (150, 155, 165)
UNIT, STEPS = 0.01, 50
"""Resolution of coordinates [m], of wide cells so many steps of their edge."""
FARTHEST = 32_000
"""Greatest distance of a point from the middle of its block, in units."""
_HEAD = struct.Struct('<' + 'iidddfIIII')
_PLACE = np.dtype(np.int16).newbyteorder('<')
_RAMP = np.array([[int(item[k:k + 2], 16) for k in (1, 3, 5)] for item in RAMP], np.float64)


def color_cells(kind: UInt8, clearance: Float32) -> UInt8:
    """
    Return the colours of cells: red near a conductor, grey far from it.

    Parameters
    ----------
    kind : UInt8
        (M,) PointClass.
    clearance : Float32
        (M,) [m], NaN unknown.

    Returns
    -------
    UInt8
        (M, 3) red, green, blue.

    """
    share = np.clip((np.nan_to_num(clearance, nan=FAR) - NEAR) / (FAR - NEAR), 0.0, 1.0)
    place = share * (len(_RAMP) - 1)
    colors = np.column_stack([
        np.interp(place, np.arange(len(_RAMP)), _RAMP[:, channel]) for channel in range(3)
    ])
    near = np.nan_to_num(clearance, nan=FAR) < FAR / 2
    colors[(kind == PointClass.GROUND) & ~near] = GROUND
    colors[kind == PointClass.TOWER] = STRUCTURE
    return np.asarray(np.rint(colors), dtype=np.uint8).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class BlockPoints:
    """
    The points of one block of the corridor, for browsers.

    Points are in a fixed random order, so that any first part is a thinned copy of the block.
    """

    home: BlockKey
    """Number of the block."""
    middle: tuple[float, float, float]
    """Origin of the places [m]."""
    edge: float
    """Edge of a cell [m]."""
    places: NDArray[np.int16]
    """(M, 3) in the unit of the edge (`find_unit`), from the middle."""
    colors: UInt8
    """(M, 3) red, green, blue."""

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.places)

    @property
    def bytes_each(self) -> int:
        """Bytes of one point."""
        return self.places.itemsize * 3 + 3

    def pack(self, version: int, first: int, count: int) -> bytes:
        """
        Pack a range of the points as one message.

        Parameters
        ----------
        version : int
            Version of the block; the messages of one version together hold the block.
        first, count : int
            Which points.

        Returns
        -------
        bytes
            Number (2 int32), middle (3 float64) [m], edge of a cell (float32) [m], version, number
            of points in all, of the first one here, and of those here (uint32 each), then places
            (int16) and colours (uint8).

        """
        own = slice(first, first + count)
        return b''.join((
            _HEAD.pack(*self.home, *self.middle, self.edge, version, self.count, first, count),
            self.places[own].tobytes(), self.colors[own].tobytes(),
        ))


def find_unit(edge: float) -> float:
    """Return the resolution of the places in a block with cells of this edge [m]."""
    return max(UNIT, edge / STEPS)


def lay_out_block(home: BlockKey, cells: CellArrays) -> BlockPoints:
    """
    Return a block of the corridor for browsers.

    Parameters
    ----------
    home : BlockKey
        Number of the block.
    cells : CellArrays
        Its cells; those of wires are left out, as the catenaries stand for them.

    Returns
    -------
    BlockPoints

    """
    points, kind, clearance, size = cells
    shown = np.flatnonzero(kind != PointClass.WIRE)
    shown = np.random.default_rng(0).permutation(shown)
    points = points[shown].astype(np.float64)
    x, y, z = np.round(points.mean(axis=0), 2).tolist() if len(points) else (0.0, 0.0, 0.0)
    edge = float(size[shown].min()) if len(shown) else 1.0
    places = np.clip(np.rint((points - (x, y, z)) / find_unit(edge)), -FARTHEST, FARTHEST)
    return BlockPoints(
        home=home, middle=(x, y, z), edge=edge, places=places.astype(_PLACE),
        colors=color_cells(kind[shown], clearance[shown]),
    )


def take_changed(cloud: CloudStore) -> list[BlockPoints]:
    """Return the blocks that changed since the last call."""
    return [lay_out_block(home, cloud.assemble(home)) for home in cloud.take_changed()]
