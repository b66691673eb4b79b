# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Conductors of the simulated scenes: exact catenaries between two attachment points.

z(x) = a + c cosh((x - b) / c), x the horizontal distance from ``start`` towards ``end``.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.errors import DataError
from plc_inspect.results import catenary_heights

Float64 = NDArray[np.float64]

SHORTEST = 0.1
"""Least length of a span in plan [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conductor:
    """One conductor between two supports: the truth of one span of one line."""

    line_id: int
    span_id: int
    start: Float64
    """(3,) first attachment [m]."""
    end: Float64
    """(3,) second attachment [m]."""
    c: float
    """Catenary constant H/w [m]."""
    radius: float = 0.01
    """Radius of the wire [m]."""
    bundle_id: int = -1
    """Conductors of one span with the same id form a bundle; -1 for a single conductor."""
    hidden: tuple[float, float] | None = None
    """Stretch hidden from all beams, as shares of the length."""

    @property
    def length(self) -> float:
        """Horizontal distance from start to end [m]."""
        return float(np.hypot(*(self.end - self.start)[:2]))

    @property
    def azimuth(self) -> float:
        """Direction from start to end, counter-clockwise from x [rad]."""
        dx, dy = (self.end - self.start)[:2]
        return math.atan2(dy, dx)

    @property
    def a(self) -> float:
        """Vertical offset of the catenary [m]."""
        return float(self.start[2]) - self.c * math.cosh(self.b / self.c)

    @property
    def b(self) -> float:
        """Vertex of the curve: its x [m]."""
        length, c = self.length, self.c
        rise = float(self.end[2] - self.start[2])
        return length / 2 - c * math.asinh(rise / (2 * c * math.sinh(length / (2 * c))))

    def heights(self, x: Float64) -> Float64:
        """Return z (N,) [m] at the horizontal distances x (N,) from start [m]."""
        return catenary_heights(self.a, self.b, self.c, np.asarray(x))

    def locate(self, x: Float64) -> Float64:
        """Return the points (N, 3) [m] at the horizontal distances x (N,) from start [m]."""
        x = np.asarray(x, dtype=np.float64)
        share = x / self.length
        points = self.start + share[:, None] * (self.end - self.start)
        points[:, 2] = self.heights(x)
        return points

    def sample(self, step: float) -> Float64:
        """Return points (N, 3) on the curve from end to end, at most ``step`` apart [m]."""
        num = max(2, math.ceil(self.length / step) + 1)
        return self.locate(np.linspace(0.0, self.length, num))

    @property
    def sag(self) -> float:
        """Greatest vertical distance from chord to curve [m]."""
        slope = float(self.end[2] - self.start[2]) / self.length
        x = self.b + self.c * math.asinh(slope)
        chord = float(self.start[2]) + slope * x
        return chord - (self.a + self.c * math.cosh((x - self.b) / self.c))

    @property
    def lowest(self) -> Float64:
        """(3,) lowest point of the curve between start and end [m]."""
        return self.locate(np.array([min(max(self.b, 0.0), self.length)]))[0]

    @property
    def quadratic(self) -> tuple[float, float, float]:
        """Coefficients a2, a1, a0 of the least-squares parabola over the same x."""
        x = np.linspace(0.0, self.length, 201)
        a2, a1, a0 = np.polyfit(x, self.heights(x), 2)
        return float(a2), float(a1), float(a0)


def hang(
    start: Float64, end: Float64, sag_ratio: float, *, line_id: int, span_id: int,
    radius: float = 0.01, bundle_id: int = -1,
) -> Conductor:
    """
    Hang a conductor between two attachments.

    Parameters
    ----------
    start, end : ndarray
        (3,) float64 attachments in the scene frame [m].
    sag_ratio : float
        Sag of a level span of this length, as a share of the length.
    line_id, span_id, radius, bundle_id
        As in `Conductor`.

    Returns
    -------
    Conductor

    Raises
    ------
    DataError
        The span is shorter than SHORTEST in plan, or the sag ratio is not positive.

    """
    length = float(np.hypot(*(end - start)[:2]))
    if length < SHORTEST or sag_ratio <= 0:
        raise DataError(f'no span of {length:g} m with a sag ratio of {sag_ratio:g}')
    return Conductor(
        line_id=line_id, span_id=span_id, start=np.array(start, dtype=np.float64),
        end=np.array(end, dtype=np.float64), c=solve_constant(length, sag_ratio * length),
        radius=radius, bundle_id=bundle_id,
    )


def solve_constant(length: float, sag: float) -> float:
    """Return c of a level span from its length and sag, by bisection [m]."""
    low, high = length / 50, length**2 / sag
    for _ in range(200):
        c = 0.5 * (low + high)
        if c * (math.cosh(length / (2 * c)) - 1) > sag:
            low = c
        else:
            high = c
    return 0.5 * (low + high)


def measure_distances(
    points: Float64, conductor: Conductor, step: float = 0.25,
    stretch: tuple[float, float] | None = None,
) -> Float64:
    """
    Return the distances in space of points from a conductor.

    The curve is replaced by chords of ``step``: the error is step^2 / (8 c), well below 0.1 mm.

    Parameters
    ----------
    points : ndarray
        (N, 3) float64 in the scene frame [m].
    conductor : Conductor
        The curve.
    step : float
        Length of the chords [m].
    stretch : tuple of float, optional
        First and last x of the part of the conductor that counts [m].

    Returns
    -------
    ndarray
        (N,) float64 [m].

    """
    low, high = stretch or (0.0, conductor.length)
    num = max(2, math.ceil((high - low) / step) + 1)
    curve = conductor.locate(np.linspace(low, high, num))
    if not len(points):
        return np.zeros(0)
    _, nearest = cKDTree(curve).query(points)
    best = np.full(len(points), np.inf)
    for shift in (-1, 0):
        first = np.clip(nearest + shift, 0, len(curve) - 2)
        base, edge = curve[first], curve[first + 1] - curve[first]
        t = np.einsum('ij,ij->i', points - base, edge) / np.einsum('ij,ij->i', edge, edge)
        foot = base + np.clip(t, 0.0, 1.0)[:, None] * edge
        best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
    return best
