# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The thinned corridor as far as the monitor has received it."""

from collections.abc import Sequence
import math
import threading

import numpy as np

from plc_inspect.results import Float32, Float64, PointClass, UInt8
from plc_inspect.stream.blocks import (
    BlockKey,
    CloudMessage,
    COARSENESS,
    find_home,
    place_cells,
    SIDE,
    UInt64,
)

CellArrays = tuple[Float32, UInt8, Float32, Float32]
"""(M, 3) centres [m], (M,) PointClass, (M,) clearance [m] and (M,) edge of the cell [m]."""


class CloudStore:
    """
    Blocks, and the overview in place of blocks not received yet.

    One thread puts blocks in; others may assemble them and cut them out meanwhile.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._blocks: dict[BlockKey, UInt64] = {}
        self._overview: dict[BlockKey, UInt64] = {}
        self._homes: dict[BlockKey, set[BlockKey]] = {}
        self._changed: set[BlockKey] = set()
        self._fine = 1.0
        self.total = 0
        """Blocks that the node has."""

    def __len__(self) -> int:
        """Return the number of blocks with cells."""
        return sum(1 for codes in self._blocks.values() if len(codes))

    @property
    def num_cells(self) -> int:
        """Number of cells of all blocks, without the overview."""
        return sum(map(len, self._blocks.values()))

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._changed |= set(self._homes) | set(self._overview)
            self._blocks.clear()
            self._overview.clear()
            self._homes.clear()
            self.total = 0

    def put(self, message: CloudMessage) -> None:
        """Store the content of a message."""
        with self._lock:
            self.total = message.total
            if message.overview:
                self._fine = message.voxel / COARSENESS
                self._overview.update(message.blocks)
                self._changed |= set(message.blocks)
                return
            self._fine = message.voxel
            for key, codes in message.blocks.items():
                home = find_home(key)
                self._blocks[key] = codes
                self._homes.setdefault(home, set()).add(key)
                self._changed.add(home)

    def take_changed(self) -> list[BlockKey]:
        """Return the blocks of the overview that changed since the last call."""
        changed, self._changed = sorted(self._changed), set()
        return changed

    def list_homes(self) -> list[BlockKey]:
        """Return all blocks of the overview that are not empty."""
        with self._lock:
            return sorted(set(self._homes) | set(self._overview))

    def assemble(self, home: BlockKey) -> CellArrays:
        """Return all cells within a block of the overview."""
        with self._lock:
            parts = [
                self._place(key, self._blocks[key], 1) for key in sorted(self._homes.get(home, ()))
            ]
            if home in self._overview:
                coarse = self._place(home, self._overview[home], COARSENESS)
                index = np.floor(coarse[0][:, :2] / (SIDE * self._fine)).astype(np.int64)
                known = self._homes.get(home, set())
                missing = np.array(
                    [(x, y) not in known for x, y in index.tolist()], dtype=np.bool_
                )
                points, kind, clearance, size = coarse
                parts.append((points[missing], kind[missing], clearance[missing], size[missing]))
        return _join(parts)

    def assemble_all(self) -> CellArrays:
        """Return all cells."""
        return _join([self.assemble(home) for home in self.list_homes()])

    def assemble_near(self, low: Sequence[float], high: Sequence[float]) -> CellArrays:
        """Return all cells of the blocks that lie in part between two corners in plan [m]."""
        size = SIDE * COARSENESS * self._fine
        return _join([
            self.assemble(home) for home in self.list_homes()
            if all(home[k] * size <= high[k] and (home[k] + 1) * size >= low[k] for k in (0, 1))
        ])

    def cut_out(self, start: Float64, end: Float64, width: float) -> CellArrays:
        """
        Return the cells beside a segment.

        Parameters
        ----------
        start, end : Float64
            (2+,) ends in plan [m].
        width : float
            Largest distance from the segment in plan [m].

        Returns
        -------
        CellArrays

        """
        points, kind, clearance, edge = self.assemble_near(
            (np.minimum(start[:2], end[:2]) - width).tolist(),
            (np.maximum(start[:2], end[:2]) + width).tolist(),
        )
        unit = (end - start)[:2] / max(float(np.linalg.norm((end - start)[:2])), 1e-9)
        apart = points[:, :2] - start[:2]
        along, across = apart @ unit, apart[:, 1] * unit[0] - apart[:, 0] * unit[1]
        length = float(np.linalg.norm((end - start)[:2]))
        chosen = (np.abs(across) <= width) & (along >= 0.0) & (along <= length)
        return points[chosen], kind[chosen], clearance[chosen], edge[chosen]

    def find_ground(self, x: float, y: float, reach: float) -> float:
        """
        Return the height of the ground at a place.

        Parameters
        ----------
        x, y : float
            Place in plan [m].
        reach : float
            Largest distance from it in plan [m].

        Returns
        -------
        float
            Height of the nearest ground cell [m], NaN if there is none.

        """
        size = SIDE * self._fine
        low, high = ([math.floor((value + sign * reach) / size) for value in (x, y)]
                     for sign in (-1.0, 1.0))
        best = reach * reach, math.nan
        for column in range(low[0], high[0] + 1):
            for row in range(low[1], high[1] + 1):
                codes = self._blocks.get((column, row))
                if codes is None or not len(codes):
                    continue
                points, kind, _, _ = self._place((column, row), codes, 1)
                ground = points[kind == PointClass.GROUND].astype(np.float64)
                if len(ground):
                    apart = (ground[:, 0] - x) ** 2 + (ground[:, 1] - y) ** 2
                    nearest = int(apart.argmin())
                    best = min(best, (float(apart[nearest]), float(ground[nearest, 2])))
        return best[1]

    def _place(self, key: BlockKey, codes: UInt64, factor: int) -> CellArrays:
        points, kind, clearance = place_cells(key, codes, self._fine * factor)
        size = np.full(len(points), self._fine * factor, dtype=np.float32)
        return points, kind, clearance, size


def _join(parts: list[CellArrays]) -> CellArrays:
    if not parts:
        return (
            np.empty((0, 3), np.float32), np.empty(0, np.uint8), np.empty(0, np.float32),
            np.empty(0, np.float32),
        )
    points, kind, clearance, size = (np.concatenate(item) for item in zip(*parts, strict=True))
    return points, kind, clearance, size
