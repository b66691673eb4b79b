# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of a flight, separated by breaks of the odometry, and their scans."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.results import Float64, Int64

MOST_POINTS = 30_000
"""
Most points of a batch that are kept.
Source: measured: bench/studies/odometry_faults.py: of 6,000 only crowns filled their cells.
"""

BY_RATE = 'a steady rate'
"""Name of the correction of a steady error, with which the map starts anew.  Source: its name."""


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
    """A part of the flight with one move from odometry to map."""

    begin_ns: int
    """First pose of it [ns]."""
    cause: str
    """What happened."""
    move: RigidMove
    """From the odometry's frame into that of the map."""
    sigma: float
    """Greatest standard deviation of its place [m]."""
    aligned: bool
    """It is aligned with the part before; otherwise the map started anew with it."""
    by: str = ''
    """What aligned it: 'what was seen twice', 'the motion' or BY_RATE."""

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
        if self.by == BY_RATE:
            return f'{self.cause}: the map began anew with that corrected; check the odometry'
        if not self.aligned:
            return (
                f'{self.cause}: what was seen before and after cannot be brought together; fly '
                'over it again for one map'
            )
        x, y, z = self.move.shift.tolist()
        return (
            f'{self.cause}: scans are moved by {x:.2f}, {y:.2f}, {z:.2f} m to where the map is, '
            f'sure to {self.sigma:.2f} m, by {self.by}; results go on'
        )


def gather_points(scans: Sequence[Seen], reach: float) -> Float64:
    """
    Return points of scans that are near enough, thinned evenly.

    Parameters
    ----------
    scans : sequence of Seen
        In one frame.
    reach : float
        Distance from the lidar [m].

    Returns
    -------
    Float64
        (N, 3), MOST_POINTS at most [m].

    """
    parts = [
        scan.points[(scan.apart < reach) & (np.abs(scan.points) < MOST_COORDINATE).all(axis=1)]
        for scan in scans
    ]
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    step = 1 + (len(points) - 1) // MOST_POINTS
    return points[:: step | 1] if len(points) else points
