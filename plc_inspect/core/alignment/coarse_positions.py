# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Positions that went through single precision far from the origin, and come in steps."""

import numpy as np

from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.results import Float64

COARSE = 0.05
"""Steps from which nothing is told of the map [m].  Source: derived: the noise of a point."""
LEAST_VALUES = 4
"""
Values of a coordinate that single precision holds exactly, one after the other, and none else.
Source: derived: one in 2^29 of all values is so; round ones that are made by hand are few.
"""


class CoarsePositions:
    """Tells positions of single precision; owned by one thread."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Expect nothing of the next position."""
        self._values: Float64 = np.full(3, np.nan)
        self._counts = np.zeros(3, dtype=np.int64)
        self.doubt = ''
        """Why nothing may be told of the map, '' if nothing."""

    def see(self, position: Float64) -> None:
        """Look at a position (3,) [m]."""
        if np.abs(position).max() >= MOST_COORDINATE:
            return
        single = position.astype(np.float32)
        exact = single == position
        changed = position != self._values
        self._counts[changed] += 1
        self._counts[~exact] = 0
        self._values = position
        steps = np.spacing(np.abs(single))
        wrong = (self._counts >= LEAST_VALUES) & (steps >= COARSE)
        self.doubt = '' if not wrong.any() else (
            f'positions of the odometry come in steps of {float(steps[wrong].max()):.2g} m: UTM '
            'in single precision? Results are held back; send double precision, or a local frame'
        )
