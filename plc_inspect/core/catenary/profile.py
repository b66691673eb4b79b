# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What lies on a curve and close about it, metre by metre."""

from dataclasses import dataclass
from functools import cached_property
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import (
    COS,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    ROUNDING,
    see_above,
    see_beside,
    SIN,
    TOLERANCE,
)
from plc_inspect.core.clustering.segment_fit import SHELL_RATIO, SHELL_SHARE
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.sorting import argsort_spread
from plc_inspect.results import Bool, Float32, Float64, Int64

CROWD_LENGTH = 4.0
"""Length of the parts of a curve that are crowded or not [m].  Source: judgement; not measured."""
STEP = 1.0
"""Length of a bin [m].  Source: judgement; not measured."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile:
    """What lies on a curve and close about it, metre by metre."""

    low: float
    """x of the first bin's lower edge [m]."""
    step: float
    """Length of a bin [m]."""
    core: Int64
    """(B,) points on the curve in each bin."""
    shell: Int64
    """(B,) points close about the curve, but not on it."""
    chosen: Int64
    """Indices of the points on the curve, ascending."""

    @cached_property
    def coverage(self) -> float:
        """Share of the bins that hold points of the curve."""
        return float((self.core > 0).mean()) if len(self.core) else 0.0

    @cached_property
    def crowding(self) -> float:
        """Share of the curve, in parts of CROWD_LENGTH, that has points close about it."""
        parts = max(round(CROWD_LENGTH / self.step), 1)
        starts = np.arange(0, len(self.core), parts)
        core = np.add.reduceat(self.core, starts)
        shell = np.add.reduceat(self.shell, starts)
        filled = (core > 0) | (shell > 0)
        if not filled.any():
            return 1.0
        return float((shell > SHELL_SHARE * core + 1.0)[filled].mean())


def profile_curve(
    points: Float64,
    index: PlanIndex,
    curve: Curve,
    low: float,
    high: float,
    *,
    step: float = STEP,
    ignore: Bool | None = None,
) -> Profile:
    """
    Count the points on a curve and close about it between two x.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curve : Curve
        Used also beyond its own ends.
    low, high : float
        X of the ends [m].
    step : float
        Length of a bin [m].
    ignore : (N,) bool
        Points that do not count as close about the curve, such as other wires.

    Returns
    -------
    Profile

    """
    if ignore is None:
        ignore = np.zeros(0, dtype=bool)
    core, shell, chosen, _ = profile_row(
        points, index.grid, curve.row, low, high, step, ignore
    )
    return Profile(low=low, step=step, core=core, shell=shell, chosen=chosen)  # nosec B604


def measure_distances(points: Float64, curve: Curve, chosen: Int64) -> Float32:
    """
    Return the distances of points near a curve to it.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curve : Curve
        Used also beyond its own ends.
    chosen : (K,) int64
        Indices of the points.

    Returns
    -------
    (K,) float32 [m]

    """
    result: Float32 = distances_to(points, curve.row, chosen)
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def distances_to(points, row, chosen):  # type: ignore[no-untyped-def]
    """Distances of some of the points to a row's curve near to them [m]."""
    result = np.empty(len(chosen), dtype=np.float32)
    opened = open_row(row)
    for k in range(len(chosen)):
        i = chosen[k]
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        rise, slope = see_above(opened, x, points[i, 2])
        result[k] = math.sqrt(y * y + rise * rise / (1.0 + slope * slope))
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def profile_row(points, grid, row, low, high, step, ignore):  # type: ignore[no-untyped-def]
    """
    Count the points on the curve, and those close about it, in each bin.

    Further returned are those on it, ascending, and their distances to it.
    """
    nobody, none = np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.bool_)
    return profile_own(points, grid, row, low, high, step, ignore, nobody, none)


@njit(cache=True, nogil=True, error_model='numpy')
def profile_own(  # type: ignore[no-untyped-def]
    points, grid, row, low, high, step, ignore, owner, barred
):
    """
    Do what `profile_row` does, but for the points of some others.

    ``owner`` is the number of the curve that each point is on, -1 for none; points whose owner is
    ``barred`` do not count.
    """
    tolerance = row[TOLERANCE]
    most = tolerance * SHELL_RATIO
    start, order, corner, cell, num_rows, num_columns = grid
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, most,
    )
    num = max(math.ceil((high - low) / step), 1)
    core = np.zeros(num, dtype=np.int64)
    shell = np.zeros(num, dtype=np.int64)
    chosen = np.empty(len(near), dtype=np.int64)
    distance = np.empty(len(near), dtype=np.float32)
    inner, outer, by_step = tolerance * tolerance, most * most, 1.0 / step
    opened = open_row(row)
    found = 0
    ordered = True
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if abs(y) > most or (len(owner) and owner[i] >= 0 and barred[owner[i]]):
            continue
        place = math.floor((x - low + ROUNDING) * by_step)
        if place < 0 or place >= num:
            continue
        rise, slope = see_above(opened, x, points[i, 2])
        r2 = y * y + rise * rise / (1.0 + slope * slope)  # distance to the curve, squared
        if r2 <= inner:
            core[place] += 1
            ordered = ordered and (found == 0 or i > chosen[found - 1])
            chosen[found], distance[found] = i, math.sqrt(r2)
            found += 1
        elif r2 <= outer and not (len(ignore) and ignore[i]):
            shell[place] += 1
    chosen, distance = chosen[:found].copy(), distance[:found].copy()
    if not ordered:  # the strip comes cell by cell
        ascending = argsort_spread(chosen)
        chosen, distance = chosen[ascending], distance[ascending]
    return core, shell, chosen, distance
