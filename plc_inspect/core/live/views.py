# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How much one tick saw of a place: where ticks are far between, one counts as several.

What must be found repeatedly before it is told is asked to show itself from several places of the
way.  Ticks are as good a measure where they follow each other closely; on a busy machine the
vehicle has passed a place before there were enough.
"""

import numpy as np

from plc_inspect.core.live.owed_cells import NEAR
from plc_inspect.results import Float64, Int64

VIEW = 10.0
"""
Way flown near a place that shows it anew [m].
Source: judgement; a second at 10 m/s, as ticks are meant to follow each other.
"""


class ViewCounter:
    """Counts the views of places from tick to tick; owned by one thread."""

    def __init__(self) -> None:
        self._flown = 0.0
        self._way: Float64 = np.zeros((0, 2))
        self._step: Float64 = np.zeros(0)

    def advance(self, way: Float64 | None) -> None:
        """
        Begin a tick.

        Parameters
        ----------
        way : (W, 2+) float64 or None
            Where the vehicle has been since the start [m], None unknown.

        """
        if way is None or len(way) < 2:
            self._way, self._step = np.zeros((0, 2)), np.zeros(0)
            return
        step = np.hypot(*np.diff(way[:, :2], axis=0).T)
        flown = np.cumsum(step)
        new = flown > self._flown
        self._way, self._step = way[1:, :2][new], step[new]
        self._flown = float(flown[-1])

    def count(self, places: Float64) -> Int64:
        """
        Return for how many views of (N, 2+) places [m] the tick counts, (N,) int64, at least 1.

        These are the VIEW of way since the tick before from which the places were near.
        """
        apart = np.linalg.norm(places[:, None, :2] - self._way, axis=2)
        flown = (apart <= NEAR) @ self._step
        result: Int64 = np.maximum(flown / VIEW, 1.0).astype(np.int64)
        return result
