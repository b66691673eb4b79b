# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The cells into which points are cut on disk, and the tiles of cells that are inspected."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.results import Float64, Int64

BYTES_PER_POINT = 300
"""
Memory of a worker for each point of a tile with its halo [bytes].
Source: judgement: a survey of 8 million points took 200 on bench/grid/throughput.py.
"""
BASE_BYTES = 700_000_000
"""
Memory of a worker without points [bytes].
Source: judgement: a worker with small tiles took 0.5 GB on bench/grid/throughput.py.
"""
MOST_POINTS = 12_000_000
"""Greatest number of points of a tile, whatever the memory.  Source: judgement; bounds a loss."""
USUAL_POINTS = 6_000_000
"""
Number of points of a usual tile, less its halo.
Source: judgement: 60 million lie in 9 tiles on bench/grid/throughput.py.
"""
LEAST_ALLOWED = 100_000
"""
Least number of points of a tile for which memory must suffice.
Source: judgement; below, halos are most of it.
"""
CELLS_IN_TILE = 16
"""
Approximate number of cells in a tile; determines the edge of a cell.
Source: judgement; not measured.
"""
HALO = 500.0
"""Initial halo around a tile [m]. Source: judgement: a span of 400 m and its neighbour."""
WIDEN = 1.5
"""Factor by which a halo that cuts off a span is widened.  Source: judgement; not measured."""
WIDE_SHARE = 0.25
"""
A halo is wide from the first if that adds at most this share of points.
Source: bench/grid/throughput.py: it added a tenth for a line with spans of 230 to 310 m, of which
9 of 17 tiles had been read twice; it pays where one tile in five would be.
"""
LEAST_EDGE, MOST_EDGE = 20.0, 1000.0
"""Least and greatest edge of a cell [m]. Source: judgement; not measured."""
MOST_CELLS = 4_000_000
"""Greatest number of cells over all inputs.  Source: numerical: their counts take 32 MB."""
MOST_REACH = 11300.0
"""
Length and width together, at most, of what is read for a tile with its halos [m].
Source: derived: turned by any angle, half the square of it, it keeps to the cells of 2 m that
core.numerics.plan_index lays; a square of 5600 m and a corridor of 11 km do.
"""


class TooDense(DataError):
    """More points lie in a cell with its halo than a tile may hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CellGrid:
    """Square cells in the plan of the map frame."""

    origin: tuple[float, float]
    """Lower corner of the first cell [m]."""
    edge: float
    """[m]"""
    columns: int
    rows: int

    def holds(self, boxes: Sequence[tuple[float, float, float, float]]) -> bool:
        """Tell whether all boxes, least x and y, greatest x and y [m], lie in the cells."""
        (x, y), edge = self.origin, self.edge
        return all(
            x <= box[0] and y <= box[1] and box[2] < x + self.columns * edge
            and box[3] < y + self.rows * edge for box in boxes
        )

    def outline(self, cells: Int64) -> Float64:
        """Return least x and y, greatest x and y (K, 4) of cells (K,), by their numbers [m]."""
        place = np.column_stack([cells % self.columns, cells // self.columns])
        low = np.array(self.origin) + place * self.edge
        return np.column_stack([low, low + self.edge])

    def number(self, x: np.ndarray, y: np.ndarray) -> Int64:
        """Return the cells (N,) of positions x, y (N,) [m]; outside the grid, the nearest cell."""
        column = np.floor((x - self.origin[0]) / self.edge).astype(np.int64)
        row = np.floor((y - self.origin[1]) / self.edge).astype(np.int64)
        column, row = column.clip(0, self.columns - 1), row.clip(0, self.rows - 1)
        result: Int64 = row * self.columns + column
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """A square of cells that is inspected at once."""

    name: str
    number: int
    first: tuple[int, int]
    """Column and row of its first cell."""
    last: tuple[int, int]
    """Column and row of its last cell."""
    num_points: int
    """Points in its cells."""
    num_near: int
    """Upper bound of the points in its cells and halo."""
    halo: float = HALO
    """Initial halo around it [m]."""

    def rectangle(self, grid: CellGrid, halo: float = 0.0) -> tuple[float, float, float, float]:
        """Return least x, least y, greatest x and greatest y [m]."""
        (x, y), edge = grid.origin, grid.edge
        return (
            x + self.first[0] * edge - halo, y + self.first[1] * edge - halo,
            x + (self.last[0] + 1) * edge + halo, y + (self.last[1] + 1) * edge + halo,
        )

    def cells(self, grid: CellGrid, halo: float = 0.0) -> list[int]:
        """Return the numbers of its cells, and those that its halo [m] touches."""
        more = math.ceil(halo / grid.edge)
        columns = range(max(self.first[0] - more, 0), min(self.last[0] + more + 1, grid.columns))
        rows = range(max(self.first[1] - more, 0), min(self.last[1] + more + 1, grid.rows))
        return [row * grid.columns + column for row in rows for column in columns]


def estimate_tile(num_points: int) -> float:
    """Return the memory that a worker needs for a tile with its halo [bytes]."""
    return float(BASE_BYTES + BYTES_PER_POINT * num_points)


def count_allowed(memory: float) -> int:
    """
    Return how many points a tile with its halo may have in the memory of a worker.

    Parameters
    ----------
    memory : float
        [bytes]

    Returns
    -------
    int

    Raises
    ------
    DataError
        They are fewer than LEAST_ALLOWED.

    """
    allowed = int((memory - BASE_BYTES) / BYTES_PER_POINT)
    if allowed < LEAST_ALLOWED:
        raise DataError(
            f'{memory / 1e9:.2f} GB for a worker are too few: allow {BASE_BYTES / 1e9 + 0.3:.1f}'
            ' GB or more (--memory), or fewer workers'
        )
    return min(allowed, MOST_POINTS)


def lay_cells(
    boxes: Sequence[tuple[float, float, float, float]] | Float64,
    num_points: int,
    allowed: int,
    edge: float | None = None,
    shift: tuple[float, float] = (0.0, 0.0),
    most_edge: float = MOST_EDGE,
) -> CellGrid:
    """
    Lay cells over the bounds of all inputs, or over those parts of them that hold points.

    Parameters
    ----------
    boxes : sequence of tuple, or (K, 4) float64
        Least x and y, greatest x and y of each [m].
    num_points : int
        Points of all inputs.
    allowed : int
        Points of a tile with its halo.
    edge : float or None
        Edge of the cells [m], by default from the density of the points.
    shift : tuple of float
        Moves the borders [m].
    most_edge : float
        Of a tile, which is one cell at least [m].

    Returns
    -------
    CellGrid

    """
    table = np.array(boxes)
    low, high = table[:, :2].min(axis=0), table[:, 2:].max(axis=0)
    if edge is None:
        area = float(np.prod(table[:, 2:] - table[:, :2], axis=1).sum())
        edge = math.sqrt(max(area, 1.0) * allowed / CELLS_IN_TILE / 4 / max(num_points, 1))
        edge = float(round(max(min(edge, MOST_EDGE, most_edge), LEAST_EDGE)))
    most = float(np.prod((high - low) / edge + 2))
    if most > MOST_CELLS:
        edge = float(math.ceil(edge * math.sqrt(most / MOST_CELLS)))
    origin = np.floor((low - shift) / edge) * edge + shift
    origin -= np.where(origin > low, edge, 0.0)
    columns, rows = (int(value) + 1 for value in np.floor((high - origin) / edge))
    return CellGrid(
        origin=(float(origin[0]), float(origin[1])), edge=edge, columns=columns, rows=rows
    )


def lay_tiles(
    grid: CellGrid, counts: Int64, halo: float | None, allowed: int,
    most_edge: float = math.inf,
) -> list[Tile]:
    """
    Divide the cells into tiles, each as large as memory allows.

    A square of cells that holds more than ``allowed`` points with its halo is divided in four.

    Parameters
    ----------
    grid : CellGrid
        The cells.
    counts : (rows * columns,) int64
        Points in each.
    halo : float or None
        Looked at around a tile at first [m]; None: HALO, and WIDEN times that where few points
        more are read.
    allowed : int
        Points of a tile with its halo, at most.
    most_edge : float
        Of a tile [m].

    Returns
    -------
    list of Tile
        Those that hold points.

    Raises
    ------
    TooDense
        A single cell with its halo holds too many.

    """
    table = counts.reshape(grid.rows, grid.columns) > 0
    total = np.zeros((grid.rows + 1, grid.columns + 1), dtype=np.int64)
    total[1:, 1:] = counts.reshape(grid.rows, grid.columns).cumsum(axis=0).cumsum(axis=1)
    least = HALO if halo is None else halo
    more = math.ceil(least / grid.edge)
    tiles: list[Tile] = []

    def count(column: int, row: int, width: int, more: int = 0) -> int:
        """Return the points in a square of cells and so many cells more on all sides."""
        c0, r0 = max(column - more, 0), max(row - more, 0)
        c1, r1 = min(column + width + more, grid.columns), min(row + width + more, grid.rows)
        return int(total[r1, c1] - total[r0, c1] - total[r1, c0] + total[r0, c0])

    def reach(column: int, row: int, width: int) -> float:
        """Return length plus width of the cells with points in a tile and its halo [m]."""
        held = table[
            max(row - more, 0) : row + width + more, max(column - more, 0) : column + width + more
        ]
        return sum(
            float(used[-1] - used[0] + 1) * grid.edge
            for used in (np.flatnonzero(held.any(axis=axis)) for axis in (0, 1)) if len(used)
        )

    def divide(column: int, row: int, width: int) -> None:
        if column >= grid.columns or row >= grid.rows:
            return
        own = count(column, row, width)
        if not own:
            return
        near, first_halo = count(column, row, width, more), least
        edge = width * grid.edge
        fits = near <= allowed and edge <= most_edge and reach(column, row, width) <= MOST_REACH
        if fits or width == 1:
            if near > allowed:
                advice = 'a' if allowed >= MOST_POINTS else (
                    'more --memory, fewer --workers or a'
                )
                raise TooDense(
                    f'{near} points lie within {least:g} m of a tile of {edge:g} m, '
                    f'{estimate_tile(near) / 1e9:.1f} GB of memory; '
                    f'{allowed} points are allowed: give {advice} narrower --halo'
                )
            wide = count(column, row, width, math.ceil(WIDEN * least / grid.edge))
            if halo is None and wide <= min((1.0 + WIDE_SHARE) * near, allowed):
                near, first_halo = wide, WIDEN * least
            tiles.append(Tile(
                name=f'x{column:05d}_y{row:05d}', number=len(tiles), first=(column, row),
                last=(min(column + width, grid.columns) - 1, min(row + width, grid.rows) - 1),
                num_points=own, num_near=near, halo=first_halo,
            ))
            return
        half = width // 2
        for r in (row, row + half):
            for c in (column, column + half):
                divide(c, r, half)

    width = 1
    while width < max(grid.columns, grid.rows):
        width *= 2
    divide(0, 0, width)
    return tiles
