# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The path of the vehicle, thinned and bounded."""

import math

import numpy as np

from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.results import Float64

STEP = 2.0
"""Least distance between two positions kept [m].  Source: judgement: less than a stretch."""
MOST_PLACES = 100_000
"""
Greatest number of positions kept; beyond, every other one is dropped.
Source: numerical: 200 km, 3 MB.
"""


class FlownWay:
    """The path of the vehicle in the map frame."""

    def __init__(self) -> None:
        self._places: list[tuple[float, float, float, float]] = []
        self._step = STEP

    def add(self, stamp_ns: int, position: Float64) -> None:
        """
        Add a position; those nearer than the step to the last one, or at no place, are left out.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the pose [ns].
        position : (3,) float64
            Map frame [m].

        """
        x, y, z = position.tolist()
        if not all(abs(part) < MOST_COORDINATE for part in (x, y, z)):
            return
        if self._places and math.dist((x, y, z), self._places[-1][1:]) < self._step:
            return
        self._places.append((stamp_ns * 1e-9, x, y, z))
        if len(self._places) > MOST_PLACES:
            self._places = self._places[::2]
            self._step *= 2.0

    @property
    def places(self) -> Float64:
        """(K, 4) time [s] and position in the map frame [m], in order of arrival."""
        return np.array(self._places, dtype=np.float64).reshape(-1, 4)

    def clear(self) -> None:
        """Forget all."""
        self._places.clear()
        self._step = STEP
