# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ties: curves with something all the way between them, as the chords of a truss."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    height_of,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.catenary.duplicates import PARALLEL
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64

LEAST_COMMON = 8
"""Metres that two curves run side by side before they can be tied.  Source: judgement."""
TIE = 2.5
"""
Greatest distance of two curves that may be tied [m].
Source: judgement; the chords of a tower crane's jib are 1 to 2.5 m apart.
"""
TIE_SHARE = 0.3
"""
Two curves are tied where each part of the way between them holds points in this share of the
metres, at least.
Source: measured: the jib of a crane 0.42 to 0.88; wires beside crowns, with others that were not
found between them, 0.11 at most.
"""
TIE_PARTS = 6
"""Parts of the way from curve to curve, less TIE_MARGIN at both ends.  Source: judgement."""
TIE_WIDTH = 0.15
"""
Distance from the plane through two curves of what ties them [m].
Source: judgement; not measured.
"""
TIE_MARGIN = 0.2
"""
At this share of the way from one curve to the other, and on, points lie between them.
Source: judgement; not measured.
"""


def find_tied(points: Float64, index: PlanIndex, curves: Sequence[Curve], own: Bool) -> Bool:
    """
    Tell which curves are tied to another one along their whole length.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        What may be tied.
    own : (N,) bool
        Points of curves, which tie nothing.

    Returns
    -------
    (C,) bool
        Curves with another one beside them and points all the way between.

    """
    tied = np.zeros(len(curves), dtype=bool)
    if len(curves) < 2:
        return tied
    rows, near = pack_curves(curves), find_near(curves, TIE)
    for number, others in enumerate(call_each(
        lambda k: _find_tied(points, index.grid, rows, k, near.of(k), own), len(curves)
    )):
        tied[others] = True
        tied[number] |= len(others) > 0
    return tied


@njit(cache=True, nogil=True, error_model='numpy')
def _find_tied(points, grid, rows, number, near, own):  # type: ignore[no-untyped-def]
    """Return those of the rows near one, by its number, that come before it and are tied to it."""
    tied = np.zeros(len(near), dtype=np.bool_)
    row = rows[number]
    between = np.empty((0, 3))
    for place in range(len(near)):
        k = near[place]
        if k >= number:
            break
        if abs(math.sin(rows[k, AZIMUTH] - row[AZIMUTH])) > PARALLEL:
            continue
        if len(between) == 0:
            between = _list_beside(points, grid, row, own)
            if len(between) == 0:
                break
        tied[place] = _measure_tie(between, row, rows[k]) >= TIE_SHARE
    return near[tied]


@njit(cache=True, nogil=True, error_model='numpy')
def _list_beside(points, grid, row, own):  # type: ignore[no-untyped-def]
    """Places within TIE of a row's curve, along, across and above it, that are on none [m]."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, TIE,
    )
    result = np.empty((len(near), 3))
    opened, count = open_row(row), 0
    for i in near:
        if own[i]:
            continue
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if x < low or x >= high or abs(y) > TIE:
            continue
        above, _ = see_above(opened, x, points[i, 2])
        if abs(above) <= TIE:
            result[count, 0], result[count, 1], result[count, 2] = x, y, above
            count += 1
    return result[:count]


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_tie(between, row, other):  # type: ignore[no-untyped-def]
    """Share of the metres common to two rows' curves with points in each part between them."""
    low, high = row[LOW], row[HIGH]
    num = max(int(high - low), 1)

    # where the other curve is, metre by metre
    y, up = np.full(num, np.nan), np.empty(num)
    for place in range(num):
        x = low + (place + 0.5) * (high - low) / num
        px, py = row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        at, off = to_local(other, px, py)
        if not other[LOW] <= at <= other[HIGH]:
            continue
        side = -off if math.cos(row[AZIMUTH] - other[AZIMUTH]) > 0.0 else off
        rise = height_of(other, at) - height_of(row, x)
        apart = math.hypot(side, rise)
        if row[TOLERANCE] + other[TOLERANCE] < apart <= TIE:
            y[place], up[place] = side, rise
    common = num - np.isnan(y).sum()
    if common < LEAST_COMMON:
        return 0.0

    # and which parts of the way to it hold points
    filled = np.zeros((num, TIE_PARTS), dtype=np.bool_)
    for k in range(len(between)):
        place = min(int((between[k, 0] - low) / (high - low) * num), num - 1)
        if np.isnan(y[place]):
            continue
        apart = math.hypot(y[place], up[place])
        along = (between[k, 1] * y[place] + between[k, 2] * up[place]) / apart**2
        across = (between[k, 1] * up[place] - between[k, 2] * y[place]) / apart
        if abs(across) <= TIE_WIDTH and TIE_MARGIN < along < 1.0 - TIE_MARGIN:
            part = int((along - TIE_MARGIN) / (1.0 - 2.0 * TIE_MARGIN) * TIE_PARTS)
            filled[place, min(part, TIE_PARTS - 1)] = True
    # the emptiest part tells: what is tied is tied all the way
    least = num
    for part in range(TIE_PARTS):
        least = min(least, filled[:, part].sum())
    return least / common
