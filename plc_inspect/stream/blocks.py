# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The thinned corridor: one cell where there were many points, cells in blocks of 16 x 16 columns.

A block is sent whole and replaces what was known of it, so a block that is lost on the way, or
sent twice, never leaves anything wrong behind.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import Float32, Float64, Int64, UInt8
from plc_inspect.stream.frame import BodyReader, CLOUD, Frame, put_rows, unpack_frame

SIDE = 16
"""Cells along the edge of a block."""
STEP = 0.2
"""Step of the clearance [m]."""
TREMOR = 1
"""A clearance that changes by no more than so many STEPs is as before."""
UNKNOWN = 255
"""Clearance that is not known, or too large to tell."""
COARSENESS = 8
"""A cell of the overview is this many cells wide."""
LEAST_VOXEL = 0.01
"""
Smallest cells that are read [m]; those of the overview are COARSENESS times as wide.
Source: derivation: a tenth of the smallest ``stream.voxel_size``; still smaller ones spread what
lies about the vehicle over millions of blocks.
"""
_HEIGHT = 1 << 31
_HEAD = struct.Struct('<BfI')
_BLOCKS = np.dtype([('x', '<i4'), ('y', '<i4'), ('z', '<i4'), ('count', '<u2')])
MOST_CELLS = 0xFFFF
"""Cells that one block may hold."""

UInt64 = NDArray[np.uint64]
BlockKey = tuple[int, int]
"""Block numbers along x and y."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """
    Cells of a cloud, by block.

    A code holds the column in the block (8 bits), the height in cells plus 2**31 (32 bits), the
    class and the clearance in STEP (8 bits each), from high to low.
    """

    blocks: Int64
    """(B, 2) numbers of the blocks."""
    starts: Int64
    """(B + 1,) where the codes of each block begin."""
    codes: UInt64
    """(M,) ascending within each block."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudMessage:
    """What one message of the thinned corridor says."""

    frame: Frame
    overview: bool
    """Cells are COARSENESS times as wide, and stand in until the block itself is there."""
    voxel: float
    """Edge of a cell; of the overview, of its cells [m]."""
    total: int
    """Blocks that the node has to tell of in all."""
    blocks: dict[BlockKey, UInt64]
    """Codes by block; none where there is nothing any more."""


def thin_points(
    points: Float64, classification: UInt8, clearance: Float32, voxel: float
) -> Cells:
    """
    Put points into cells; a cell has the class and clearance of its point nearest to a conductor.

    Parameters
    ----------
    points : Float64
        (N, 3) map frame [m].
    classification : UInt8
        (N,) PointClass.
    clearance : Float32
        (N,) distance to the nearest conductor [m], NaN unknown.
    voxel : float
        Edge of a cell [m].

    Returns
    -------
    Cells

    """
    if not len(points):
        return Cells(
            blocks=np.empty((0, 2), np.int64), starts=np.zeros(1, np.int64),
            codes=np.empty(0, np.uint64),
        )
    index = np.floor(points / voxel).astype(np.int64)
    base = index[:, :2].min(axis=0) // SIDE
    block = index[:, :2] // SIDE - base
    local = index[:, :2] - (block + base) * SIDE
    low = int(index[:, 2].min())
    width = int(block[:, 1].max()) + 1
    near = _quantise(clearance)
    key = block[:, 0] * width + block[:, 1]
    key = ((key * (SIDE * SIDE) + local[:, 0] * SIDE + local[:, 1]) << 16) + (index[:, 2] - low)
    order = np.argsort((key << 8) + near, kind='stable')
    key = key[order]
    first = order[np.r_[True, key[1:] != key[:-1]]]
    column = (local[first, 0] * SIDE + local[first, 1]).astype(np.uint64)
    height = (index[first, 2] + _HEIGHT).astype(np.uint64)
    kind = classification[first].astype(np.uint64)
    codes = column << np.uint64(48) | height << np.uint64(16) | kind << np.uint64(8)
    codes |= near[first].astype(np.uint64)
    own = block[first]
    edges = np.flatnonzero(np.r_[True, (own[1:] != own[:-1]).any(axis=1), True])
    return Cells(
        blocks=own[edges[:-1]] + base, starts=edges.astype(np.int64), codes=codes
    )


def find_home(key: BlockKey) -> BlockKey:
    """Return the block of the overview that a block lies in."""
    return key[0] // COARSENESS, key[1] // COARSENESS


def coarsen(home: BlockKey, blocks: Sequence[tuple[BlockKey, UInt64]]) -> UInt64:
    """
    Return the cells of the overview that stand for some blocks.

    Parameters
    ----------
    home : BlockKey
        Block of the overview.
    blocks : sequence of tuple
        Numbers and codes of blocks within it.

    Returns
    -------
    UInt64
        (M,) codes in ``home``; the class and clearance are those of the cell that is nearest to a
        conductor.

    """
    counts = [len(codes) for _, codes in blocks]
    if not sum(counts):
        return np.empty(0, np.uint64)
    column, height, kind, near = split_codes(np.concatenate([codes for _, codes in blocks]))
    x, y = (np.repeat([key[axis] for key, _ in blocks], counts) for axis in (0, 1))
    x = (x * SIDE + column // SIDE) // COARSENESS - home[0] * SIDE
    y = (y * SIDE + column % SIDE) // COARSENESS - home[1] * SIDE
    height = height // COARSENESS
    cell = ((x * SIDE + y) << 32) + height + _HEIGHT
    order = np.argsort((cell << 8) + near, kind='stable')
    cell = cell[order]
    first = order[np.r_[True, cell[1:] != cell[:-1]]]
    return join_codes(x[first] * SIDE + y[first], height[first], kind[first], near[first])


def split_codes(codes: UInt64) -> tuple[Int64, Int64, Int64, Int64]:
    """Return column, height in cells, class and clearance in STEP of (M,) codes."""
    values = codes.astype(np.int64)
    return (
        values >> 48, ((values >> 16) & 0xFFFFFFFF) - _HEIGHT, (values >> 8) & 0xFF,
        values & 0xFF,
    )


def join_codes(column: Int64, height: Int64, kind: Int64, near: Int64) -> UInt64:
    """Return (M,) codes of columns, heights in cells, classes and clearances in STEP."""
    return ((column << 48) | ((height + _HEIGHT) << 16) | (kind << 8) | near).astype(np.uint64)


def place_cells(key: BlockKey, codes: UInt64, voxel: float) -> tuple[Float32, UInt8, Float32]:
    """
    Return what the cells of a block are.

    Parameters
    ----------
    key : BlockKey
        Number of the block.
    codes : UInt64
        (M,) its codes.
    voxel : float
        Edge of a cell [m].

    Returns
    -------
    tuple
        (M, 3) centres [m], (M,) PointClass and (M,) clearance [m], NaN unknown.

    """
    column, height, kind, near = split_codes(codes)
    index = np.column_stack((
        key[0] * SIDE + column // SIDE, key[1] * SIDE + column % SIDE, height
    ))
    clearance = np.where(near == UNKNOWN, np.nan, near * STEP).astype(np.float32)
    return ((index + 0.5) * voxel).astype(np.float32), kind.astype(np.uint8), clearance


def pack_blocks(
    blocks: Mapping[BlockKey, UInt64], *, overview: bool, voxel: float, total: int
) -> bytes:
    """
    Return the body of a message.

    Parameters
    ----------
    blocks : mapping
        Codes (M,) by block, at most MOST_CELLS each.
    overview : bool
        They are cells of the overview.
    voxel : float
        Edge of their cells [m].
    total : int
        Blocks that there are to be told of in all.

    Returns
    -------
    bytes

    """
    heads = np.zeros(len(blocks), _BLOCKS)
    pieces: list[tuple[Int64, ...]] = []
    for head, (key, codes) in zip(heads, blocks.items(), strict=True):
        column, height, kind, near = split_codes(codes[:MOST_CELLS])
        head['x'], head['y'] = key
        head['count'] = len(column)
        head['z'] = low = int(height.min()) if len(height) else 0
        pieces.append((np.diff(column, prepend=0), height - low, kind, near))
    columns = [
        np.concatenate([piece[place] for piece in pieces]) if pieces else np.empty(0, np.int64)
        for place in range(4)
    ]
    return b''.join((
        _HEAD.pack(overview, voxel, total), put_rows(heads),
        columns[0].astype(np.uint8).tobytes(), (columns[1] & 0xFF).astype(np.uint8).tobytes(),
        (columns[1] >> 8).astype(np.uint8).tobytes(), columns[2].astype(np.uint8).tobytes(),
        columns[3].astype(np.uint8).tobytes(),
    ))


def read_cloud(data: bytes) -> CloudMessage:
    """
    Read a message of the thinned corridor.

    Parameters
    ----------
    data : bytes
        A frame with a body as from ``pack_blocks``.

    Returns
    -------
    CloudMessage

    Raises
    ------
    DataError
        It is no such message, damaged, or its cells are too small.

    """
    frame = unpack_frame(data, CLOUD)
    reader = BodyReader(frame.body)
    overview, voxel, total = reader.take_struct(_HEAD)
    voxel = round(float(voxel), 6)
    if not LEAST_VOXEL * (COARSENESS if overview else 1) <= voxel < 1e4:
        raise DataError(f'cells of {voxel:g} m')
    heads = reader.take_rows(_BLOCKS)
    counts = heads['count'].astype(np.int64)
    planes = [
        np.frombuffer(reader.take(int(counts.sum())), dtype=np.uint8).astype(np.int64)
        for _ in range(5)
    ]
    reader.finish()
    ends = np.cumsum(counts)
    blocks = {}
    for head, end, count in zip(heads, ends.tolist(), counts.tolist(), strict=True):
        part = slice(end - count, end)
        column = np.cumsum(planes[0][part])
        if count and column[-1] >= SIDE * SIDE:
            raise DataError(f'column {column[-1]} of a block of {SIDE} x {SIDE}')
        height = planes[1][part] + (planes[2][part] << 8) + int(head['z'])
        key = int(head['x']), int(head['y'])
        blocks[key] = join_codes(column, height, planes[3][part], planes[4][part])
    return CloudMessage(
        frame=frame, overview=bool(overview), voxel=voxel,
        total=int(total), blocks=blocks,
    )


def merge_codes(old: UInt64, new: UInt64) -> UInt64:
    """Return the new codes (M,), and those of the old (K,) whose cells are not among them."""
    if not len(old):
        return new
    kept = old[~np.isin(old >> np.uint64(16), new >> np.uint64(16))]
    return np.sort(np.concatenate((kept, new)))


def count_changes(old: UInt64, new: UInt64) -> int:
    """Return how many cells differ in two states (K,), (M,) of a block by more than TREMOR."""
    both, at_old, at_new = np.intersect1d(
        old >> np.uint64(16), new >> np.uint64(16), assume_unique=True, return_indices=True
    )
    before, after = (
        (codes & np.uint64(0xFFFF)).astype(np.int64) for codes in (old[at_old], new[at_new])
    )
    moved = (before >> 8 != after >> 8) | (np.abs((before & 0xFF) - (after & 0xFF)) > TREMOR)
    return len(old) + len(new) - 2 * len(both) + int(np.count_nonzero(moved))


def _quantise(clearance: Float32) -> Any:
    steps = np.rint(np.nan_to_num(clearance, nan=1e9, posinf=1e9) / STEP)
    return np.where(steps < UNKNOWN, np.maximum(steps, 0), UNKNOWN).astype(np.int64)
