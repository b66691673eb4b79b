# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of a flight, between which the odometry is not one piece, and the scans of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.results import Float64, Int64


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Points of a scan."""

    points: Float64
    """(N, 3) [m]."""
    stamps: Int64
    """(N,) [ns]."""
    apart: Float64
    """(N,) distance from the lidar [m]."""
    stamp_ns: int
    """Of the scan [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A part of the flight in which the odometry is off by another move than before."""

    begin_ns: int
    """First pose of it [ns]."""
    cause: str
    """What happened."""
    move: RigidMove
    """From the odometry's frame into that of the map."""
    sigma: float
    """Greatest standard deviation of its place [m]."""
    aligned: bool
    """It lies where the part before does; otherwise the map began anew with it."""
    by: str = ''
    """What aligned it: 'what was seen twice' or 'the motion'."""

    def record(self) -> dict[str, Any]:
        """Return it JSON-serialisable."""
        return {
            'begin_ns': self.begin_ns, 'cause': self.cause, 'move': self.move.record(),
            'sigma': round(self.sigma, 4), 'aligned': self.aligned, 'by': self.by,
            'text': self.describe(),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> 'Part':
        """Return that of ``record``."""
        return cls(
            begin_ns=int(record['begin_ns']), cause=str(record['cause']),
            move=RigidMove.from_record(record['move']), sigma=float(record['sigma']),
            aligned=bool(record['aligned']), by=str(record['by']),
        )

    def describe(self) -> str:
        """Return it in one line."""
        if not self.aligned:
            return f'{self.cause}: what was seen before and after cannot be brought together'
        x, y, z = self.move.shift.tolist()
        return (
            f'{self.cause}: scans are moved by {x:.2f}, {y:.2f}, {z:.2f} m to where the map is, '
            f'sure to {self.sigma:.2f} m, by {self.by}'
        )
