# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Square cells of the ground, kept only about points.

The bounds of a line are an area far larger than what was flown: of 30 km aslant to the cells 200
million cells of 1 m, of which 5 million hold points.  Cells are kept in blocks of at most
2**SHIFT on a side, each cut to what it holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from numba import njit, prange
import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.numerics.plan_index import clamp
from plc_inspect.results import Bool, Float32, Float64, Int64

MAX_CELLS = 16_000_000
"""
Greatest number of cells that are all kept, in one block.
Source: numerical: the grid, float32, takes 64 MB.
"""
MOST_CELLS = 80_000_000
"""
Greatest number of cells that are kept; a larger area gets larger cells.
Source: numerical: heights, float32, of 80 km2 in cells of 1 m take 320 MB.
"""
MOST_SQUARES = 4_000_000
"""
Greatest number of FINE squares within the bounds, kept or not; wider bounds get larger cells.
Source: numerical: the table of blocks takes 10 MB; cells of 1 m within a square of 128 km.
"""
SHIFT = 8
"""
A block has at most 2**SHIFT cells on a side.
Source: judgement: a corridor fills blocks of this size well.
"""
WHOLE = 31
"""The same where one block has all cells.  Source: derived: places of cells are below 2**31."""
FINE = 64
"""
Of a block, and about it, squares of this many cells are kept in which points are, or beside them.
Source: derived: gaps of as many cells are filled from the same means wherever the block ends.
"""
FIRST, ROW, COLUMN, ROWS, COLUMNS = range(5)
"""Columns of the table of blocks: place of its first cell, which cell that is, and how many."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundGrid:
    """
    The height of the ground at cell centres, and where it was seen.

    A block is kept row by row, with one row and one column more, its neighbours' first.
    """

    origin: Float64
    """(2,) x, y of the lower corner of the first cell [m]."""
    cell_size: float
    shape: tuple[int, int]
    """Rows (along y) and columns (along x), kept or not."""
    table: Int64
    """(rows, columns, 5) the blocks; ROWS and COLUMNS are 0 where none is kept."""
    shift: int
    """Of the row of a cell to that of its block."""
    height: Float32
    """(K,) ground height at the centres of all cells kept [m]; NaN where none is known."""
    seen: Bool
    """(K,) whether ground was measured in the cell, not interpolated."""

    @property
    def blocks(self) -> tuple[Int64, int, Float64, float, int, int]:
        """The cells as kernels take them: table, shift, origin, cell size, rows, columns."""
        return self.table, self.shift, self.origin, self.cell_size, *self.shape

    def place(self, number: Sequence[int]) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return first row and column of a block, and how many it has of both."""
        _, row, column, rows, columns = self.table[number[0], number[1]].tolist()
        return (row, column), (rows, columns)

    def view(self, values: NDArray[Any], number: Sequence[int]) -> NDArray[Any]:
        """Return the (rows + 1, columns + 1) values of a block, a view."""
        first, _, _, rows, columns = self.table[number[0], number[1]].tolist()
        size = (rows + 1) * (columns + 1)
        return values[first : first + size].reshape(rows + 1, columns + 1)

    def list_around(self, context: int) -> list['Around']:
        """Return each block that is kept with so many cells about it, within the bounds."""
        result = []
        for number in np.argwhere(self.table[:, :, ROWS] > 0).tolist():
            (row, column), (rows, columns) = self.place(number)
            low = max(row - context, 0), max(column - context, 0)
            high = (min(row + rows + context, self.shape[0]),
                    min(column + columns + context, self.shape[1]))
            result.append(Around(
                number=(number[0], number[1]), low=low, high=high,
                corner=(row - low[0], column - low[1]),
            ))
        return result

    def cut(self, values: Float32, around: 'Around') -> Float32:
        """Return the (rows, columns) values [m] in and about a block; NaN where none are kept."""
        (r0, c0), (r1, c1) = around.low, around.high
        result = np.full((r1 - r0, c1 - c0), np.nan, dtype=np.float32)
        for row in range(r0 >> self.shift, ((r1 - 1) >> self.shift) + 1):
            for column in range(c0 >> self.shift, ((c1 - 1) >> self.shift) + 1):
                (r, c), (rows, columns) = self.place((row, column))
                lower, upper = max(r, r0), min(r + rows, r1)
                left, right = max(c, c0), min(c + columns, c1)
                if lower < upper and left < right:
                    own = self.view(values, (row, column))
                    result[lower - r0 : upper - r0, left - c0 : right - c0] = own[
                        lower - r : upper - r, left - c : right - c
                    ]
        return result

    def at(self, positions: Float64, max_gap: float = math.inf) -> Float64:
        """
        Return the height of the ground at plan positions.

        Parameters
        ----------
        positions : (K, 2) float64
            Plan positions [m]; outside the grid, its nearest cell counts.
        max_gap : float
            Greatest distance from a cell in which ground was measured [m].

        Returns
        -------
        (K,) float64
            Height of the ground [m], NaN where unknown.

        """
        height: Float64 = _ground_at(
            self.height, self.seen, self.blocks,
            np.ascontiguousarray(positions, dtype=np.float64), max_gap,
        )
        return height

    def tell_seen(self, places: Float64) -> Bool:
        """Tell where ground was seen below (K, 2+) places [m]; beyond the cells it was not."""
        result: Bool = _tell_seen(
            self.seen, self.blocks, np.ascontiguousarray(places[:, :2], dtype=np.float64)
        )
        return result

    def holds(self, places: Float64) -> bool:
        """Tell whether all (K, 2) places [m] lie within the bounds of the cells."""
        size = self.cell_size * np.array(self.shape[::-1])
        return bool((places >= self.origin).all() and (places <= self.origin + size).all())


@dataclass(frozen=True, slots=True, kw_only=True)
class Around:
    """A block and the cells about it."""

    number: tuple[int, int]
    """Row and column of the block in the table."""
    low: tuple[int, int]
    """First row and column."""
    high: tuple[int, int]
    """Those behind the last."""
    corner: tuple[int, int]
    """The block's first row and column, from there."""

    def put(self, view: NDArray[Any], values: NDArray[Any]) -> None:
        """
        Set a block from the values in and about it.

        Its one row and column more are the neighbour's first, or its own last again.
        """
        own = values[self.corner[0] :, self.corner[1] :][: view.shape[0], : view.shape[1]]
        view[: own.shape[0], : own.shape[1]] = own
        view[own.shape[0] :] = view[own.shape[0] - 1]
        view[:, own.shape[1] :] = view[:, own.shape[1] - 1 : own.shape[1]]


def make_grid(
    height: Float32, seen: Bool, origin: Float64, cell_size: float
) -> GroundGrid:
    """
    Return a grid of which all cells are kept.

    Parameters
    ----------
    height : (rows, columns) float32
        At cell centres [m].
    seen : (rows, columns) bool
        Whether ground was measured there.
    origin : (2,) float64
        Lower corner of the first cell [m].
    cell_size : float
        [m]

    Returns
    -------
    GroundGrid

    """
    rows, columns = height.shape
    return GroundGrid(
        origin=origin, cell_size=cell_size, shape=(rows, columns), shift=WHOLE,
        table=np.array([[[0, 0, 0, rows, columns]]]),
        height=np.pad(height, ((0, 1), (0, 1)), mode='edge').ravel(),
        seen=np.pad(seen, ((0, 1), (0, 1))).ravel(),
    )


def make_unknown(cell_size: float = 1.0) -> GroundGrid:
    """Return a grid of one cell [m] of which nothing is known."""
    height = np.full((1, 1), np.nan, dtype=np.float32)
    return make_grid(height, np.zeros((1, 1), dtype=bool), np.zeros(2), cell_size)


def lay_blocks(
    points: Float64, low: Float64, cell: float, shape: tuple[int, int]
) -> tuple[Int64, int]:
    """
    Lay blocks of cells over points, and over what is beside them.

    Parameters
    ----------
    points : (N, 3) float64
        Within the cells [m]; rows that are not finite are left out.
    low : (2+,) float64
        Lower corner of the first cell [m].
    cell : float
        Edge of a cell [m].
    shape : tuple of int
        Rows and columns of cells.

    Returns
    -------
    table : (rows, columns, 5) int64
        The blocks of a GroundGrid.
    num_kept : int
        Number of cells in all of them.

    """
    rows, columns = (-(-num // FINE) for num in shape)
    held = np.pad(_mark(points, low, 1.0 / (cell * FINE), rows, columns), 1)
    held = held[:-2] | held[1:-1] | held[2:]
    kept = np.argwhere(held[:, :-2] | held[:, 1:-1] | held[:, 2:])
    size = 2**SHIFT // FINE
    table = np.zeros((-(-rows // size), -(-columns // size), 5), dtype=np.int64)
    # the first and the last of the squares kept in each block
    corner, end = np.full((*table.shape[:2], 2), max(shape)), np.zeros((*table.shape[:2], 2))
    number = kept[:, 0] // size, kept[:, 1] // size
    np.minimum.at(corner, number, kept * FINE)
    np.maximum.at(end, number, np.minimum((kept + 1) * FINE, shape))
    is_kept = (end > corner).all(axis=2)
    table[is_kept, ROW:ROWS] = corner[is_kept]
    table[is_kept, ROWS:] = end[is_kept] - corner[is_kept]
    sizes = np.where(is_kept, (table[:, :, ROWS] + 1) * (table[:, :, COLUMNS] + 1), 0)
    last = sizes.ravel().cumsum().reshape(sizes.shape)
    table[:, :, FIRST] = last - sizes
    return table, int(last[-1, -1])


@njit(cache=True, parallel=True, nogil=True)
def _mark(points, low, per_block, rows, columns):  # type: ignore[no-untyped-def]
    """Tell the blocks that hold points."""
    held = np.zeros((rows, columns), dtype=np.bool_)
    x0, y0 = low[0], low[1]
    for i in prange(len(points)):
        x, y = (points[i, 0] - x0) * per_block, (points[i, 1] - y0) * per_block
        if 0.0 * x + 0.0 * y + 0.0 * points[i, 2] == 0.0:  # finite
            held[int(clamp(y, rows - 1.0)), int(clamp(x, columns - 1.0))] = True
    return held


@njit(cache=True, nogil=True, inline='always')
def find_cell(table, shift, row, column):  # type: ignore[no-untyped-def]
    """Return the place of a cell within the grid, -1 if it is not kept."""
    block = table[row >> shift, column >> shift]
    up, right = row - block[ROW], column - block[COLUMN]
    if up < 0 or right < 0 or up >= block[ROWS] or right >= block[COLUMNS]:
        return -1
    return block[FIRST] + up * (block[COLUMNS] + 1) + right


@njit(cache=True, nogil=True)
def _ground_at(ground, seen, blocks, positions, max_gap):  # type: ignore[no-untyped-def]
    table, shift, origin, size, rows, columns = blocks
    result = np.full(len(positions), np.nan)
    for k in range(len(positions)):
        x = (positions[k, 0] - origin[0]) / size - 0.5
        y = (positions[k, 1] - origin[1]) / size - 0.5
        if not (math.isfinite(x) and math.isfinite(y)):
            continue
        x, y = clamp(x, columns - 1.0), clamp(y, rows - 1.0)
        # interpolate between the four cell centres about the position, if ground was seen near it
        if not _is_seen_near(seen, blocks, int(np.rint(y)), int(np.rint(x)), max_gap / size):
            continue
        left, lower = int(x), int(y)
        place = find_cell(table, shift, lower, left)
        if place < 0:
            continue
        wide = table[lower >> shift, left >> shift, COLUMNS] + 1
        x, y = x - left, y - lower
        below = ground[place] * (1.0 - x) + ground[place + 1] * x
        above = ground[place + wide] * (1.0 - x) + ground[place + wide + 1] * x
        result[k] = below * (1.0 - y) + above * y
    return result


@njit(cache=True, nogil=True)
def _is_seen_near(seen, blocks, row, column, reach):  # type: ignore[no-untyped-def]
    """Tell whether ground was measured within ``reach`` cells of a cell."""
    table, shift, _, _, rows, columns = blocks
    if reach == math.inf:
        return True
    num = int(reach)
    for i in range(max(row - num, 0), min(row + num + 1, rows)):
        for j in range(max(column - num, 0), min(column + num + 1, columns)):
            if (i - row) ** 2 + (j - column) ** 2 <= reach * reach:
                place = find_cell(table, shift, i, j)
                if place >= 0 and seen[place]:
                    return True
    return False


@njit(cache=True, nogil=True)
def is_seen(seen, blocks, x, y):  # type: ignore[no-untyped-def]
    """Tell whether ground was seen in the cell of a position [m]."""
    table, shift, origin, size, rows, columns = blocks
    column, row = (x - origin[0]) / size, (y - origin[1]) / size
    if not (0.0 <= column < columns and 0.0 <= row < rows):
        return False
    place = find_cell(table, shift, int(row), int(column))
    return place >= 0 and seen[place]


@njit(cache=True, nogil=True)
def _tell_seen(seen, blocks, places):  # type: ignore[no-untyped-def]
    result = np.zeros(len(places), dtype=np.bool_)
    for k in range(len(places)):
        result[k] = is_seen(seen, blocks, places[k, 0], places[k, 1])
    return result
