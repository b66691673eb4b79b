# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Cables that carry something else than current: stays, and those with hangers on them.

Stays are straight thin bars above a beam that they hold, as on tower cranes and stayed bridges, or
fan out from a mast; from the main cables of suspension bridges hangers go straight down.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, find_far_apart, pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    height_of,
    HIGH,
    LOW,
    ORIGIN_X,
    ORIGIN_Y,
    SIN,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64

ASIDE = 1.5
"""
Distance of a stay from the beam, in plan [m].
Source: derived: half the width of a tower crane's jib, up to 2.5 m, and the miss of a curve on it.
"""
ABOVE_SHARE = 0.8
"""Share of a stay that is above the beam.  Source: judgement: the mast's head is off its end."""
NEAREST = 3.0
"""Height above the beam at the lower end, at most [m].  Source: derived: the depth of a jib."""
RISE = 0.06
"""
Least rise of a stay over the beam for each metre of it.
Source: derived: conductors of one line part by less: half their spacing at a support, 1 m in 20 m;
the stays of twelve random cranes rise by 0.1 to 0.5.
"""
NUM_STATIONS = 25
"""Places along a stay.  Source: numerical."""
HANGER = 4
"""
Metres below a cable that a hanger fills, at least.
Source: judgement: jumpers and the insulators of a line hang less far down.
"""
HANGER_CELL = 0.5
"""
Edge of the cells about a cable in which hangers are looked for [m].
Source: derived: a rod, and the noise of its points, are in two cells across and along.
"""
HANGER_SHARE = 0.8
"""
Share of the points of four by four cells that the inner four hold where a hanger is.
Source: derived: of a rod it is nearly 1; of a treetop, a cone of half its height across, half.
"""
MIN_HANGERS = 3
"""
Cables with as many hangers, nearer to each other than any two supports, carry a deck.
Source: judgement: two may be a lamp and a pole.
"""


def find_stays(curves: Sequence[Curve], beams: Sequence[Curve]) -> Bool:
    """
    Tell which curves are stays: of a beam, or beside others in a fan of surely straight ones.

    Parameters
    ----------
    curves : sequence of Curve
        Straight, as far as is known.
    beams : sequence of Curve
        Straight, and part of something solid.

    Returns
    -------
    (C,) bool
        Curves that run above a beam, in its vertical plane, and come down on it at one end.

    """
    result: Bool = _find_stays(pack_curves(curves), pack_curves(beams))
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _find_stays(rows, beams):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in range(len(beams)):
            if _holds(rows[k], beams[m]):
                result[k] = True
                break
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _holds(row, beam):  # type: ignore[no-untyped-def]
    """Tell whether a row's curve is a stay of a beam."""
    above = 0
    first = last = math.nan
    for station in range(NUM_STATIONS):
        x = row[LOW] + (row[HIGH] - row[LOW]) * station / (NUM_STATIONS - 1)
        at, aside = to_local(
            beam, row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        )
        if abs(aside) > ASIDE or at < beam[LOW] - ASIDE or at > beam[HIGH] + ASIDE:
            continue
        rise = height_of(row, x) - height_of(beam, at)
        above += rise > 0.0
        if math.isnan(first):
            first = rise
        last = rise
    if above < ABOVE_SHARE * NUM_STATIONS:
        return False
    return min(first, last) <= NEAREST and abs(last - first) >= RISE * (row[HIGH] - row[LOW])


def find_fans(curves: Sequence[Curve], sure: Bool) -> Bool:
    """
    Tell which curves fan out from a mast as stays do.

    Parameters
    ----------
    curves : sequence of Curve
        Straight, as far as is known.
    sure : (C,) bool
        Which of them surely are.

    Returns
    -------
    (C,) bool
        Curves that run in one vertical plane with another one, at least one of both surely
        straight, and part from it by more than conductors of one line do.

    """
    result: Bool = _find_fans(pack_curves(curves), sure, find_far_apart(curves, NEAREST))
    return result


def find_hung(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], wire: Bool, apart: float
) -> Bool:
    """
    Tell which curves are cables with hangers.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        Cables, or conductors.
    wire : (N,) bool
        Points of conductors.
    apart : float
        Two supports are never nearer to each other [m].

    Returns
    -------
    (C,) bool
        Curves from which MIN_HANGERS thin columns go down, each nearer than ``apart`` to the next.

    """
    places = call_each(
        lambda k: _find_hangers(points, index.grid, curves[k].row, wire), len(curves)
    )
    more = MIN_HANGERS - 1
    return np.array([
        bool((found[more:] - found[:-more] < apart * more).any()) for found in places
    ], dtype=bool)


@njit(cache=True, nogil=True, error_model='numpy')
def _find_fans(rows, sure, far):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in range(k):
            if (sure[k] or sure[m]) and not far[k, m]:
                shorter, longer = k, m
                if rows[k, HIGH] - rows[k, LOW] > rows[m, HIGH] - rows[m, LOW]:
                    shorter, longer = m, k
                if _parts(rows[shorter], rows[longer]):
                    result[k] = result[m] = True
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _parts(row, other):  # type: ignore[no-untyped-def]
    """Tell whether two curves meet at one end, in a vertical plane, and part from there on."""
    first = last = math.nan
    common = 0
    for station in range(NUM_STATIONS):
        x = row[LOW] + (row[HIGH] - row[LOW]) * station / (NUM_STATIONS - 1)
        at, aside = to_local(
            other, row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        )
        if abs(aside) > ASIDE or at < other[LOW] - ASIDE or at > other[HIGH] + ASIDE:
            continue
        last = height_of(row, x) - height_of(other, at)
        if common == 0:
            first = last
        elif last * first < 0.0:  # they cross
            return False
        common += 1
    if common < ABOVE_SHARE * NUM_STATIONS:
        return False
    least = min(abs(first), abs(last))
    return least <= NEAREST and abs(last - first) >= RISE * (row[HIGH] - row[LOW])


@njit(cache=True, nogil=True, error_model='numpy')
def _find_hangers(points, grid, row, wire):  # type: ignore[no-untyped-def]
    """List x along a row's curve where a thin column goes straight down from it [m]."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    reach = 2 * HANGER_CELL
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, reach,
    )

    # for each cell along, and of four across: metres below the curve that hold points, as bits
    num = int((high - low) / HANGER_CELL) + 1
    levels = np.zeros((num + 1, 4), dtype=np.int64)
    counts = np.zeros((num + 1, 4), dtype=np.int64)
    for i in near:
        if wire[i]:
            continue
        x, y = to_local(row, points[i, 0], points[i, 1])
        below = height_of(row, x) - points[i, 2] - row[TOLERANCE]
        if x < low or x > high or abs(y) >= reach or not 0.0 <= below < HANGER:
            continue
        place, side = int((x - low) / HANGER_CELL), int((y + reach) / HANGER_CELL)
        levels[place, side] |= 1 << int(below)
        counts[place, side] += 1

    # the inner two of four cells across, and each two along
    found = np.empty(num)
    count = 0
    full = (1 << HANGER) - 1
    place = 0
    while place < num:
        both = (
            levels[place, 1] | levels[place + 1, 1] | levels[place, 2] | levels[place + 1, 2]
        )
        own = counts[place : place + 2, 1:3].sum()
        about = counts[max(place - 1, 0) : place + 3].sum()
        if both == full and own >= HANGER_SHARE * about:
            found[count] = low + (place + 1) * HANGER_CELL
            count += 1
            place += 2
        else:
            place += 1
    return found[:count]
