# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells that ticks look at again: looked at in vain, or where hazards wait to be seen again."""

import numpy as np

from plc_inspect.core.voxel_buffer.cell_index import CellIndex
from plc_inspect.results import Float64, Int64

NEAR = 50.0
"""
Distance from the vehicle within which growing cells are fresh; others when quiet [m].
Source: judgement; not measured.
"""
MOST_FAILURES = 3
"""Failed ticks after which a cell is given up.  Source: judgement: it may be what fails them."""
MOST_RENEWED = 30
"""
Owed cells that are looked at again in one tick, at most.
Source: derived: those within the range of a Puck Lite on one side of a line, 100 m by 30 m.
"""


def add_waiting(
    cells: CellIndex, fresh: Int64, places: Float64 | None, vehicle: Float64 | None
) -> Int64:
    """
    Return the fresh cells of a tick with those in which hazards wait to be seen once more.

    A cell that is well known grows by too little to be looked at, or by nothing where the vehicle
    has seen all that it can: a hazard is raised while it is near all the same.  What came in in
    such a cell is enough for a tick; without, it is looked at with others.

    Parameters
    ----------
    cells : CellIndex
        Of the map.
    fresh : (F,) int64
        Cells of which enough is new, ascending.
    places : (W, 2+) float64 or None
        Where hazards wait [m]; None: nowhere.
    vehicle : (2+,) float64 or None
        Where the vehicle is [m]; None: everywhere near.

    Returns
    -------
    (G,) int64
        Ascending.

    """
    if places is None or not len(places):
        return fresh
    waiting = np.unique(cells.find(cells.locate(places)))
    waiting = waiting[waiting >= 0]
    if vehicle is not None:
        apart = np.linalg.norm(cells.centers[waiting] - vehicle[:2], axis=1)
        waiting = waiting[apart <= NEAR]
    if not len(fresh) and not cells.num_new[waiting].any():
        return fresh
    return np.union1d(fresh, waiting)


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
