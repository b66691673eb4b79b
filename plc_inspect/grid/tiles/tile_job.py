# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The input of a task on one tile, and how it reads its points."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

import numpy as np

from plc_inspect.core.cloud_frame import CloudFrame
from plc_inspect.core.extraction.stray_points import StrayGrid
from plc_inspect.core.whole import Whole
from plc_inspect.grid.cells.layout import CellGrid, Tile
from plc_inspect.grid.cells.pieces import Piece, Points, read_piece, read_points
from plc_inspect.grid.cells.room import publish
from plc_inspect.results import Bool, Float64

CELLS, TILES = 'cells', 'tiles'
"""Folders of the cells, and of the results of each tile."""
CATALOGUE = 'catalogue.npz'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrayCells:
    """Cells that hold stray points, which are dropped."""

    grid: StrayGrid
    marked: Bool
    """(rows * columns,) True for such cells."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TileJob:
    """One tile of one grid."""

    folder: str
    """Working folder of all tasks."""
    room: str
    """Where the run writes aside."""
    tile: Tile
    grid: CellGrid
    strays: tuple[StrayCells, ...] = ()

    @property
    def place(self) -> Path:
        """Path prefix of the files of this tile."""
        return Path(self.folder) / TILES / self.tile.name

    def publish(self, suffix: str) -> AbstractContextManager[Path]:
        """Write the file of this tile with a suffix; see `room.publish`."""
        place = Path(f'{self.place}{suffix}')
        place.parent.mkdir(parents=True, exist_ok=True)
        return publish(Path(self.room), place)

    def read(self, halo: float) -> Points:
        """Read the points of the tile and its halo [m]; stray points are NaN."""
        cells = self.tile.cells(self.grid, halo)
        found = read_points(
            Path(self.folder) / CELLS, list_pieces(Path(self.folder), cells),
            self.tile.cells(self.grid), self.tile.rectangle(self.grid, halo),
        )
        self._erase_strays(found.points)
        return found

    def iterate(self) -> Iterator[Float64]:
        """Yield the (N, 3) points of the tile, cell by cell [m]; stray points are NaN."""
        for piece in list_pieces(Path(self.folder), self.tile.cells(self.grid)):
            points = read_piece(Path(self.folder) / CELLS, piece)
            self._erase_strays(points)
            yield points

    def _erase_strays(self, points: Float64) -> None:
        for step in self.strays:
            step.grid.erase(points, step.marked)


def write_catalogue(
    folder: Path, parts: Sequence[str], num_points: Sequence[int], cells: np.ndarray
) -> None:
    """
    Write which cells each part has points in.

    Parameters
    ----------
    folder : Path
        Working folder of all tasks.
    parts : sequence of str
        Their names, in the order of the inputs.
    num_points : sequence of int
        Of each part.
    cells : (K, 3) int64
        Cell, place of its part in ``parts``, and number of points.

    """
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    first = np.cumsum([0, *num_points])[:-1]
    np.savez(
        folder / CATALOGUE, parts=np.array(parts, dtype=np.str_), first=first, cells=cells[order]
    )


def list_pieces(folder: Path, cells: Sequence[int]) -> list[Piece]:
    """Return the pieces of some cells."""
    with np.load(folder / CATALOGUE) as known:
        parts, begins, table = known['parts'], known['first'], known['cells']
    first = np.searchsorted(table[:, 0], cells, side='left')
    last = np.searchsorted(table[:, 0], cells, side='right')
    return [
        Piece(cell=int(cell), part=str(parts[part]), first=int(begins[part]))
        for begin, end in zip(first.tolist(), last.tolist(), strict=True)
        for cell, part, _ in table[begin:end].tolist()
    ]


def render_whole(whole: Whole) -> dict[str, Any]:
    """Return a Whole as JSON."""
    return {
        'origin': whole.frame.origin.tolist(), 'azimuth': whole.frame.azimuth,
        'region': whole.region.tolist(), 'peak': whole.peak, 'anchor': whole.anchor.tolist(),
        'probe_step': whole.probe_step,
        'spacing': None if whole.spacing is None else list(whole.spacing),
    }


def parse_whole(text: str) -> Whole:
    """Return the Whole that `render_whole` rendered."""
    value = json.loads(text)
    spacing = value['spacing']
    return Whole(
        frame=CloudFrame(origin=np.array(value['origin']), azimuth=value['azimuth']),
        probe_step=value['probe_step'], region=np.array(value['region']), peak=value['peak'],
        anchor=np.array(value['anchor']),
        spacing=None if spacing is None else (spacing[0], spacing[1]),
    )
