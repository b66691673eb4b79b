# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the node keeps for the thinned corridor: all blocks, and which are to be sent next."""

from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.results import Float64
from plc_inspect.stream.blocks import (
    BlockKey,
    Cells,
    coarsen,
    COARSENESS,
    count_changes,
    find_home,
    merge_codes,
    SIDE,
    UInt64,
)

MAX_CELLS = 2_000_000
"""Beyond, the blocks farthest from the vehicle are forgotten."""
PATIENCE = 10.0
"""A block that changed a little is sent after this [s]."""
MUCH = 0.15
"""A block of whose cells this share changed is sent as soon as there is room."""
MESSAGE_SIZE = 2500
"""
Messages are about this long [bytes].
Source: derivation: two packets of Ethernet, so that where 2 of 100 packets are lost 4 of 100
messages are, and a tenth of a second of 256 kbit/s, for which an alarm may have to wait.
"""
BYTES_PER_CELL = 2.5
BYTES_PER_BLOCK = 8.0


@dataclass(slots=True, eq=False)
class Block:
    """One block, and what was told of it."""

    codes: UInt64
    told: UInt64 | None = None
    """What was sent last, None nothing yet."""
    since: float = math.nan
    """When it first differed from that, steady time [s]."""
    share: float = math.nan
    """Share of its cells that differ, NaN not counted yet."""
    wanted: bool = False
    """Somebody new listens and has not got it."""


class ThinMap:
    """
    All blocks of the corridor along the flight.

    Parameters
    ----------
    voxel : float
        Edge of a cell [m].
    reach : float
        Cells farther from the vehicle than this are no longer told of by what comes in; they are
        kept as they were [m].

    """

    def __init__(self, voxel: float, reach: float) -> None:
        self.voxel = voxel
        self._reach = reach
        self._blocks: dict[BlockKey, Block] = {}
        self._pending: set[BlockKey] = set()
        self._vehicle: tuple[float, float] = (0.0, 0.0)
        self._overview: list[tuple[BlockKey, list[BlockKey]]] = []

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self._blocks)

    def update(self, cells: Cells, vehicle: Float64 | None, now: float) -> None:
        """
        Put in the corridor about the vehicle.

        Parameters
        ----------
        cells : Cells
            All of it.
        vehicle : Float64 or None
            (2+,) where the vehicle is [m], None unknown: then the cells are all there is.
        now : float
            Steady time [s].

        """
        if vehicle is not None:
            self._vehicle = float(vehicle[0]), float(vehicle[1])
        seen = set()
        for (x, y), start, end in zip(
            cells.blocks.tolist(), cells.starts[:-1].tolist(), cells.starts[1:].tolist(),
            strict=True,
        ):
            key = x, y
            seen.add(key)
            self._put(key, cells.codes[start:end], now, whole=self._is_whole(key, vehicle))
        for key in [key for key in self._blocks if key not in seen]:
            if self._is_whole(key, vehicle):
                self._put(key, np.empty(0, np.uint64), now, whole=True)
        self._shrink()

    def refresh(self, now: float) -> None:
        """Send everything anew, in outline first: somebody new listens."""
        for key, block in self._blocks.items():
            block.wanted = True
            block.since = now
            self._pending.add(key)
        homes: dict[BlockKey, list[BlockKey]] = {}
        for key in self._blocks:
            homes.setdefault(find_home(key), []).append(key)
        self._overview = sorted(
            homes.items(), key=lambda item: -self._measure_gap(item[0], SIDE * COARSENESS)
        )

    def forget_listeners(self) -> None:
        """Send nothing more: nobody listens."""
        self._pending.clear()
        self._overview.clear()
        for block in self._blocks.values():
            block.told, block.wanted = None, False

    def take_overview(self) -> dict[BlockKey, UInt64]:
        """Return the next blocks of the overview, nearest first; empty when all is told."""
        chosen: dict[BlockKey, UInt64] = {}
        size = 0.0
        while self._overview and size < MESSAGE_SIZE:
            home, keys = self._overview.pop()
            codes = coarsen(home, [
                (key, self._blocks[key].codes) for key in keys if key in self._blocks
            ])
            chosen[home] = codes
            size += BYTES_PER_BLOCK + BYTES_PER_CELL * len(codes)
        return chosen

    def take(self, now: float) -> dict[BlockKey, UInt64]:
        """
        Return the next blocks to send, those that matter most; they count as sent.

        Parameters
        ----------
        now : float
            Steady time [s].

        Returns
        -------
        dict
            Codes by block; none where a block is no more.

        """
        ranked = sorted(
            ((self._rate(key, now), key) for key in list(self._pending)), reverse=True
        )
        chosen: dict[BlockKey, UInt64] = {}
        size = 0.0
        for rating, key in ranked:
            if rating <= 0.0 or size >= MESSAGE_SIZE:
                break
            block = self._blocks[key]
            chosen[key] = block.codes
            size += BYTES_PER_BLOCK + BYTES_PER_CELL * len(block.codes)
            block.told, block.wanted = block.codes, False
            self._pending.discard(key)
            if not len(block.codes):
                del self._blocks[key]
        return chosen

    def _rate(self, key: BlockKey, now: float) -> float:
        """Return how much a block matters now; 0 or less: not yet."""
        block = self._blocks[key]
        near = 1e-5 * min(self._measure_gap(key, SIDE), 1e4)
        age = now - block.since
        if block.told is None and not block.wanted:
            return 2.0 - near
        if block.wanted:
            return 1.0 + 0.05 * age - near
        if math.isnan(block.share):
            changes = count_changes(block.told, block.codes) if block.told is not None else 1
            block.share = changes / max(len(block.codes), 1)
        if not block.share:
            self._pending.discard(key)
            return -1.0
        ripe = block.share >= MUCH or age >= PATIENCE
        return min(block.share, 0.9) + 0.01 * age - near if ripe else -1.0

    def _put(self, key: BlockKey, codes: UInt64, now: float, *, whole: bool) -> None:
        block = self._blocks.get(key)
        if block is None:
            if not len(codes):
                return
            self._blocks[key] = Block(codes=codes.copy(), since=now)
            self._pending.add(key)
            return
        if not whole:
            codes = merge_codes(block.codes, codes)
        if np.array_equal(block.codes, codes):
            return
        block.codes, block.share = codes.copy(), math.nan  # a view would hold all of a tick's
        if not len(codes) and block.told is None and not block.wanted:
            del self._blocks[key]
            self._pending.discard(key)
        elif key not in self._pending:
            block.since = now
            self._pending.add(key)

    def _is_whole(self, key: BlockKey, vehicle: Float64 | None) -> bool:
        """Whether all of a block lies where what comes in is complete."""
        if vehicle is None:
            return True
        size = SIDE * self.voxel
        far = [
            max(abs(number * size - place), abs((number + 1) * size - place))
            for number, place in zip(key, self._vehicle, strict=True)
        ]
        return math.hypot(*far) < self._reach

    def _measure_gap(self, key: BlockKey, side: int) -> float:
        """Distance from the middle of a block to the vehicle [m]."""
        size = side * self.voxel
        return math.hypot(*(
            (number + 0.5) * size - place
            for number, place in zip(key, self._vehicle, strict=True)
        ))

    def _shrink(self) -> None:
        total = sum(len(block.codes) for block in self._blocks.values())
        if total <= MAX_CELLS:
            return
        for key in sorted(self._blocks, key=lambda item: -self._measure_gap(item, SIDE)):
            total -= len(self._blocks.pop(key).codes)
            self._pending.discard(key)
            if total <= 0.9 * MAX_CELLS:
                return
