# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Detect positions rounded to single precision far from the origin, which move in steps."""

import numpy as np

from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.results import Float64

COARSE = 0.05
"""Step size from which no results are reported [m].  Source: derived: the noise of a point."""
LEAST_VALUES = 4
"""
Successive distinct values of a coordinate that must all be exact in single precision.
Source: derived: one in 2^29 of all values is so; round ones that are made by hand are few.
"""


class CoarsePositions:
    """Detects positions of single precision; not thread-safe."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Reset."""
        self._values: Float64 = np.full(3, np.nan)
        self._counts = np.zeros(3, dtype=np.int64)
        self.doubt = ''
        """Why no results may be reported, '' if they may."""

    def see(self, position: Float64) -> None:
        """Examine a position (3,) [m]."""
        if not np.abs(position).max() < MOST_COORDINATE:  # NaN is no place, too
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
