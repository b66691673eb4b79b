# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Units of the input, and the plain records that are in them."""

from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from plc_inspect.results import Float64

Record = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Units:
    """
    Units of the input's coordinates.

    Where the two differ, z coordinates and heights of supports and objects are in the vertical
    unit, and every other length (a, b, c and sag included) is in the horizontal one.
    """

    horizontal: float = 1.0
    """Metres in one unit of x and y."""
    vertical: float = 1.0
    """Metres in one unit of z."""

    @property
    def name(self) -> str:
        """Short name of the horizontal unit, as printed behind numbers."""
        return _name_unit(self.horizontal)

    @property
    def vertical_name(self) -> str:
        """Short name of the vertical unit."""
        return _name_unit(self.vertical)

    def from_metres(self, points: Float64) -> Float64:
        """Return coordinates (..., 3) given in metres in the units of the input, a copy."""
        return points / np.array([self.horizontal, self.horizontal, self.vertical])

    def to_metres(self, points: Float64) -> Float64:
        """Return coordinates (..., 3) given in the units of the input in metres, a copy."""
        return points * np.array([self.horizontal, self.horizontal, self.vertical])


def _name_unit(metres: float) -> str:
    for name, length in {'m': 1.0, 'ft': 0.3048, 'ftUS': 1200.0 / 3937.0}.items():
        if math.isclose(metres, length, rel_tol=1e-9):
            return name
    return f'x {metres:g} m'
