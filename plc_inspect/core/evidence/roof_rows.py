# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Lines that are the rows of a scanner on a roof, and no wires."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, fit_curve, pack_curves
from plc_inspect.core.catenary.curve_row import COS, height_of, HIGH, LOW, plan_of, SIN, to_local
from plc_inspect.core.ground.ground_grid import GroundGrid, is_seen
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
    result: Bool = _are_roof_rows(pack_curves(curves), sight.seen, sight.blocks)
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


@njit(cache=True, nogil=True, error_model='numpy')
def _are_roof_rows(rows, seen, blocks):  # type: ignore[no-untyped-def]
    result, share = np.zeros(len(rows), dtype=np.bool_), np.empty(len(rows))
    for k in range(len(rows)):
        share[k] = _measure_seen(rows[k], seen, blocks)
        if share[k] > AT_EDGE:
            continue
        for m in range(k):
            if share[m] <= AT_EDGE and min(share[k], share[m]) <= HIDDEN and (
                _lie_side_by_side(rows[k], rows[m])
            ):
                result[k] = result[m] = True
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_seen(row, seen, blocks):  # type: ignore[no-untyped-def]
    """Return the share of a row's curve below which the ground was seen."""
    step, num = _step_along(row)
    found = 0
    for k in range(num):
        x, y = plan_of(row, row[LOW] + k * step)
        found += is_seen(seen, blocks, x, y)
    return found / num


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def _step_along(row):  # type: ignore[no-untyped-def]
    """Return the step from place to place along a row's curve [m], and how many there are."""
    length = row[HIGH] - row[LOW]
    num = max(2, math.ceil(length / STEP))
    return length / (num - 1), num


@njit(cache=True, nogil=True, error_model='numpy')
def _lie_side_by_side(one, other):  # type: ignore[no-untyped-def]
    """Tell whether two rows' curves may be rows of one roof."""
    turn = one[COS] * other[SIN] - one[SIN] * other[COS]
    if abs(turn) > math.sin(ALIGNED):
        return False
    if one[HIGH] - one[LOW] > other[HIGH] - other[LOW]:
        one, other = other, one
    middle, _ = to_local(other, *plan_of(one, 0.5 * (one[LOW] + one[HIGH])))
    if not other[LOW] <= middle <= other[HIGH]:  # they overlap by less than half
        return False
    step, num = _step_along(one)
    beside, least, most = 0, np.inf, 0.0
    for k in range(num):
        at = one[LOW] + k * step
        x, y = to_local(other, *plan_of(one, at))
        if not other[LOW] <= x <= other[HIGH]:
            continue
        across = abs(y)
        if abs(height_of(one, at) - height_of(other, x)) > STEEPEST * across + LEAST_APART:
            return False
        beside += 1
        least, most = min(least, across), max(most, across)
    return beside >= OVERLAP * num and most > LEAST_APART and least < BESIDE
