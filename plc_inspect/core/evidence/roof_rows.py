# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Lines that are the rows of a scanner on a roof, and no wires."""

from collections.abc import Sequence
import math

import numpy as np

from plc_inspect.core.catenary.curve import Curve, fit_curve
from plc_inspect.core.extraction.ground_grid import GroundGrid
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64, Int64

BESIDE = 2.5
"""
Distance across of the next row at most [m].
Source: judgement; sparse scans lay their rows 1.5 m apart.
"""
STEEPEST = 1.0
"""Slope of a roof across its rows at most.  Source: judgement; roofs rise by up to 45 degrees."""
LEAST_APART = 0.1
"""Distance across of the next row at least [m].  Source: judgement; else it is the same row."""
OVERLAP = 0.5
"""Share of the shorter of two rows that both must run beside each other.  Source: judgement."""
ALIGNED = 0.1
"""Angle between two rows at most [rad].  Source: judgement; rows of one strip are parallel."""
HIDDEN = 0.3
"""
Share of the metres of a row over which the ground below was seen, at most.
Source: measured: 0.75 of the curves on roofs of bench/studies/planted_hazards.py (seeds 903, 905,
909) have less; those on wires of real clouds (bench/hazards.py) have 0.96 and more.
"""
AT_EDGE = 0.8
"""The same of one at the edge of a roof, with a hidden one beside it.  Source: as HIDDEN."""
TOLERANCE = 0.3
"""Largest residual of the points of a row about its curve [m].  Source: derived: as wires.TUBE."""
STEP = 0.5
"""Step along a curve at which the ground below is looked at [m].  Source: numerical."""


def are_roof_rows(curves: Sequence[Curve], sight: GroundGrid) -> Bool:
    """
    Tell curves that run side by side over ground that was not seen.

    Parameters
    ----------
    curves : sequence of Curve
        C curves.
    sight : GroundGrid
        Where the ground was seen.

    Returns
    -------
    (C,) bool

    """
    seen = [float(sight.tell_seen(curve.position(_step_along(curve))).mean()) for curve in curves]
    result = np.zeros(len(curves), dtype=bool)
    candidates = [number for number, share in enumerate(seen) if share <= AT_EDGE]
    if not candidates:
        return result
    middle = np.vstack([
        curves[number].position(0.5 * (curves[number].low + curves[number].high))[:, :2]
        for number in candidates
    ])
    half = 0.5 * np.array([curves[number].length for number in candidates])
    for k, one in enumerate(candidates):
        away = np.hypot(*(middle[:k] - middle[k]).T)
        for near in np.flatnonzero(away <= half[:k] + half[k] + BESIDE).tolist():
            other = candidates[near]
            if min(seen[one], seen[other]) <= HIDDEN and _lie_side_by_side(
                curves[one], curves[other]
            ):
                result[[one, other]] = True
    return result


def find_roof_rows(points: Float64, lines: Sequence[Int64], sight: GroundGrid) -> Bool:
    """
    Tell lines of points that `are_roof_rows`.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    lines : sequence of (K,) int64
        The points of each of L lines, ascending.
    sight : GroundGrid
        Where the ground was seen.

    Returns
    -------
    (L,) bool

    """
    result = np.zeros(len(lines), dtype=bool)
    curves, which = [], []
    for number, own in enumerate(lines):
        try:
            curves.append(fit_curve(points, own, tolerance=TOLERANCE))
        except FitError:
            continue
        which.append(number)
    result[which] = are_roof_rows(curves, sight)
    return result


def _step_along(curve: Curve) -> Float64:
    return np.linspace(curve.low, curve.high, max(2, math.ceil(curve.length / STEP)))


def _lie_side_by_side(one: Curve, other: Curve) -> bool:
    """Tell whether two curves may be rows of one roof."""
    if abs(math.sin(one.azimuth - other.azimuth)) > math.sin(ALIGNED):
        return False
    if one.length > other.length:
        one, other = other, one
    place = one.position(_step_along(one))
    x, y = other.local(place)
    along = (x >= other.low) & (x <= other.high)
    if along.mean() < OVERLAP:
        return False
    across = np.abs(y[along])
    above = np.abs(place[along, 2] - other.fit.height(x[along]))
    side = across.max() > LEAST_APART and across.min() < BESIDE
    return bool(side and (above <= STEEPEST * across + LEAST_APART).all())
