# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells of the map that ticks looked at in vain, so that they are looked at again."""

import numpy as np

from plc_inspect.core.voxel_buffer.cell_index import CellIndex
from plc_inspect.results import Float64, Int64

MOST_FAILURES = 3
"""Failed ticks after which a cell is given up.  Source: judgement: it may be what fails them."""
MOST_RENEWED = 30
"""
Owed cells that are looked at again in one tick, at most.
Source: derived: those within the range of a Puck Lite on one side of a line, 100 m by 30 m.
"""


def look_again(cells: CellIndex, places: Float64) -> None:
    """
    Make cells new again in which hazards wait to be seen once more, (W, 2+) places [m].

    A cell that is well known grows by too little to be looked at; where anything came in it is,
    so that a hazard is raised while the vehicle is near.
    """
    found = np.unique(cells.find(cells.locate(places)))
    found = found[found >= 0]
    cells.renew(found[cells.num_new[found] > 0])


class OwedCells:
    """
    Keeps the cells of ticks that failed, or whose hazards were held back; for one thread.

    A window settles its fresh cells, so nothing would be raised in them until something new is
    seen there.
    """

    def __init__(self) -> None:
        self._looking: set[tuple[int, int]] = set()
        self._owed: dict[tuple[int, int], int] = {}
        """How many failed ticks looked at each."""

    def begin(self, places: Int64) -> None:
        """Note the places (C, 2) on the grid of the cells that a tick looks at now."""
        self._owe(failed=False)  # where the one before did not end
        self._looking = {(column, row) for column, row in places.tolist()}

    def end(self, cells: CellIndex, *, failed: bool = False, in_vain: bool = False) -> None:
        """Note how the tick ended; one that succeeds makes some of what is owed new again."""
        if failed or in_vain:
            self._owe(failed)
            return
        for place in self._looking:
            self._owed.pop(place, None)
        self._looking.clear()
        again = list(self._owed)[-MOST_RENEWED:]
        if again:
            cells.renew(cells.find(np.array(again, dtype=np.int64)))
        # the last at first then: some are not worth a look any more, and must not bar the others
        self._owed = {place: self._owed[place] for place in again} | self._owed

    def _owe(self, failed: bool) -> None:
        for place in self._looking:
            self._owed[place] = self._owed.pop(place, 0) + failed
            if self._owed[place] >= MOST_FAILURES:
                del self._owed[place]
        self._looking.clear()
