# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells of the map that ticks looked at in vain, so that they are looked at again."""

import numpy as np

from plc_inspect.core.live.window import Window
from plc_inspect.core.voxel_buffer.cell_index import CellIndex


class OwedCells:
    """
    Keeps the cells of ticks that failed, or whose hazards were held back; for one thread.

    A window settles its fresh cells, so nothing would be raised in them until something new is
    seen there.
    """

    def __init__(self) -> None:
        self._looking: set[tuple[int, int]] = set()
        self._owed: set[tuple[int, int]] = set()

    def begin(self, window: Window) -> None:
        """Note the fresh cells of the window that a tick looks at now."""
        self._looking = {(column, row) for column, row in window.fresh.tolist()}

    def end(self, cells: CellIndex, *, in_vain: bool) -> None:
        """Note how the tick ended; the first that succeeds makes what is owed new again."""
        if in_vain:
            self._owed |= self._looking
        else:
            owed = sorted(self._owed - self._looking)
            cells.renew(cells.find(np.array(owed, dtype=np.int64).reshape(-1, 2)))
            self._owed.clear()
        self._looking.clear()
