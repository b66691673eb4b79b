# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Rigid moves with a rotation about the vertical: the offset between two parts of a flight."""

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.results import Float64


def _zeros() -> Float64:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class RigidMove:
    """p -> R(yaw) (p - centre) + centre + shift; roll and pitch are known from gravity."""

    shift: Float64 = field(default_factory=_zeros)
    """(3,) [m]."""
    yaw: float = 0.0
    """Counter-clockwise about the vertical through the centre [rad]."""
    centre: Float64 = field(default_factory=_zeros)
    """(3,) [m]."""

    @property
    def trivial(self) -> bool:
        """Whether it leaves everything where it is."""
        return self.yaw == 0.0 and not self.shift.any()

    @property
    def rotation(self) -> Float64:
        """(3, 3) R(yaw)."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def record(self) -> dict[str, Any]:
        """Return it JSON-serialisable."""
        return {
            'shift': self.shift.tolist(), 'yaw': self.yaw, 'centre': self.centre.tolist(),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any] | None) -> 'RigidMove':
        """Return the move in ``record``, the identity for None; DataError if it is malformed."""
        if record is None:
            return cls()
        shift, centre = (np.array(record[name], dtype=np.float64) for name in ('shift', 'centre'))
        if shift.shape != (3,) or centre.shape != (3,):
            raise DataError(f'a move has 3 coordinates, got {shift.size} and {centre.size}')
        return cls(shift, float(record['yaw']), centre)

    def apply(self, points: Float64) -> Float64:
        """Return moved points (N, 3) or (3,) [m]; the same array where nothing moves."""
        if self.trivial:
            return points
        if self.yaw == 0.0:
            return points + self.shift
        result: Float64 = (points - self.centre) @ self.rotation.T + (self.centre + self.shift)
        return result

    def about(self, centre: Float64) -> 'RigidMove':
        """Return the same move about another centre (3,) [m]."""
        return RigidMove(self.apply(centre) - centre, self.yaw, np.array(centre))

    def inverse(self) -> 'RigidMove':
        """Return the move back."""
        return RigidMove(-self.shift, -self.yaw, self.centre + self.shift)

    def after(self, first: 'RigidMove') -> 'RigidMove':
        """Return the composition: ``first``, then this move."""
        at = first.centre
        return RigidMove(self.apply(first.apply(at)) - at, self.yaw + first.yaw, at)


def find_heading(quaternion: Float64) -> float:
    """Return the heading of a quaternion x y z w: the plan direction of its x axis [rad]."""
    x, y, z, w = (float(value) for value in quaternion)
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
