# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Contacts: where something thin touches a curve from below or from one side.

The main cables of suspension bridges have hangers below them, and pipes rest on brackets, or
between beams of a rack: they are touched at regular short intervals.
"""

from collections.abc import Sequence

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import (
    COS,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
    TOLERANCE,
)
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64

CONTACT_ROOM, CONTACT_DEPTH = 0.5, 1.0
"""
Points so far beside a curve at most, and so far below the points on it, touch it [m].
Source: judgement: rods and brackets are in the vertical plane of what they hold, to 0.3 m.
"""
THIN_ROOM, THIN_DEPTH, THIN_SPREAD = 1.0, 3.0, 0.2
"""
Points so far along and beside a contact, and so far below the curve, spread along it by no more
than this (standard deviation) where it is a rod or a beam across [m].
Source: derived: a beam of 0.3 m and noise of 0.1 m spread by 0.13 m; the top of a slender tree,
0.7 m in radius 3 m below its tip, by 0.27 m.
"""
CONTACT_CELL = 0.5
"""Length of the cells in which contacts are looked for [m].  Source: numerical."""
LONGEST_CONTACT = 3
"""
Cells that one contact takes, at most.
Source: derived: a cross-beam of half a metre, wherever it lies in them; crowns are longer.
"""
BELOW, LEFT, RIGHT = 0, 1, 2
"""Sides of a curve, of which something may hold it.  Source: numerical."""
NUM_LAYERS, LAYER, SOLID_SHARE = 5, 0.1, 0.5
"""
Contacts are looked for in the first of so many layers, each so much deeper [m], that holds points
along at most this share of the curve.
Source: derived: the lower half of a pipe of a metre, seen along most of it.
"""
LEAST_EVEN = 3
"""Even intervals between contacts, at least.  Source: derived: two more that agree with one."""
SHORTEST_BAY = 2.0
"""
Brackets and hangers are no nearer to each other [m].
Source: judgement: what is touched more often is another line, seen once in each scan line.
"""
LEAST_CONTACT, LEAST_EXTENT = 3, 0.5
"""
Points of a contact, and their extent in height or across [m], at least.
Source: derived: a line below has neither, a rod all of CONTACT_DEPTH, a beam both sides.
"""
REGULAR = 0.15
"""
Intervals are even that differ from their median by at most this share of it.
Source: judgement: hangers and brackets stand evenly.
"""


def find_held(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], wire: Bool, longest: float,
    least: Sequence[int],
) -> Bool:
    """
    Tell which curves touch something below or beside them at regular short intervals.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        Pipes, cables, or conductors.
    wire : (N,) bool
        Points of conductors.
    longest : float
        Greatest interval [m].
    least : sequence of int
        Even intervals of each curve, at least.

    Returns
    -------
    (C,) bool
        Curves with contacts at even intervals.

    """
    def is_held(number: int) -> bool:
        contacts = _list_contacts(points, index.grid, curves[number].row, wire)
        return any(is_regular(np.diff(own), longest, least[number]) for own in contacts)

    return np.array(call_each(is_held, len(curves)), dtype=bool)


def is_regular(interval: Float64, longest: float, least: int = LEAST_EVEN) -> bool:
    """Tell whether things stand at intervals [m], ``least`` of them even and none of them long."""
    if len(interval) < least:
        return False
    middle = float(np.median(interval))
    bays = np.round(interval / middle)
    regular = np.abs(interval - bays * middle) <= REGULAR * middle
    even, odd = int((regular & (bays == 1)).sum()), int((~regular).sum())
    # where one was not seen two bays are one; the more are even the more else may touch
    short = SHORTEST_BAY <= middle <= longest
    return short and even >= least and 2 * odd <= even - 2


@njit(cache=True, nogil=True, error_model='numpy')
def _list_contacts(points, grid, row, wire):  # type: ignore[no-untyped-def]
    """List x along a row's curve where something thin touches it from each of its sides [m]."""
    low, high = row[LOW], row[HIGH]
    places = _place_about(points, grid, row, wire)
    num = int((high - low) / CONTACT_CELL) + 1
    return (
        _list_on_side(places, row, num, BELOW), _list_on_side(places, row, num, LEFT),
        _list_on_side(places, row, num, RIGHT),
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _place_about(points, grid, row, wire):  # type: ignore[no-untyped-def]
    """Return (K, 3) places along, beside and above a row's curve of what may touch it [m]."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    solid = row[TOLERANCE] + NUM_LAYERS * LAYER
    aside, below = solid + CONTACT_DEPTH, solid + THIN_DEPTH
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, aside,
    )
    result, opened, count = np.empty((len(near), 3)), open_row(row), 0
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if wire[i] or abs(y) >= aside or x < low - THIN_ROOM or x > high + THIN_ROOM:
            continue
        rise, _ = see_above(opened, x, points[i, 2])
        if -below < rise < THIN_ROOM:
            result[count, 0], result[count, 1], result[count, 2] = x, y, rise
            count += 1
    return result[:count]


@njit(cache=True, nogil=True, error_model='numpy')
def _list_on_side(places, row, num, side):  # type: ignore[no-untyped-def]
    """List x along a row's curve, in ``num`` cells, where it is touched from one side [m]."""
    low, high = row[LOW], row[HIGH]
    touched, top = np.zeros(num, dtype=np.bool_), 0.0
    for layer in range(NUM_LAYERS):
        # beyond what is solid: a pipe is touched nowhere else
        top = row[TOLERANCE] + layer * LAYER
        touched[:] = False
        for k in range(len(places)):
            x = places[k, 0]
            across, away = _see_from(places[k], side)
            away -= top
            if low <= x <= high and abs(across) < CONTACT_ROOM and 0.0 < away < CONTACT_DEPTH:
                touched[int((x - low) / CONTACT_CELL)] = True
        if touched.mean() <= SOLID_SHARE:
            break

    # cells in a row are one contact
    found = np.empty(num)
    count, first = 0, -1
    for place in range(num + 1):
        if place < num and touched[place]:
            first = place if first < 0 else first
        elif first >= 0:
            if place - first <= LONGEST_CONTACT:
                found[count] = low + 0.5 * (first + place) * CONTACT_CELL
                count += 1
            first = -1
    return _keep_thin(places, top, side, found[:count])


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def _see_from(place, side):  # type: ignore[no-untyped-def]
    """Return how far a place is across a side of a curve, and away from the curve that way [m]."""
    if side == BELOW:
        return place[1], -place[2]
    return place[2], place[1] if side == LEFT else -place[1]


@njit(cache=True, nogil=True, error_model='numpy')
def _keep_thin(places, top, side, found):  # type: ignore[no-untyped-def]
    """
    Return the contacts whose places, and those beyond them, lie close together along a curve.

    ``top`` is how far away from the curve they begin [m].
    """
    sums, touching = np.zeros((len(found), 3)), np.zeros(len(found))
    least, most = np.full((len(found), 2), np.inf), np.full((len(found), 2), -np.inf)
    # aside, no more was gathered
    depth = THIN_DEPTH if side == BELOW else CONTACT_DEPTH
    for n in range(len(places)):
        x = places[n, 0]
        across, away = _see_from(places[n], side)
        away -= top
        if abs(across) >= THIN_ROOM or not 0.0 < away < depth:
            continue
        after = np.searchsorted(found, x)
        for k in range(max(after - 1, 0), min(after + 1, len(found))):
            d = x - found[k]
            if abs(d) < THIN_ROOM:
                sums[k, 0] += 1.0
                sums[k, 1] += d
                sums[k, 2] += d * d
                touching[k] += abs(across) < CONTACT_ROOM and away < CONTACT_DEPTH
                least[k, 0], most[k, 0] = min(least[k, 0], away), max(most[k, 0], away)
                least[k, 1], most[k, 1] = min(least[k, 1], across), max(most[k, 1], across)
    kept, place = np.zeros(len(found), dtype=np.bool_), found.copy()
    for k in range(len(found)):
        num = max(sums[k, 0], 1.0)
        mean = sums[k, 1] / num
        place[k] += mean  # cells tell it to half a metre
        extent = max(most[k, 0] - least[k, 0], most[k, 1] - least[k, 1])
        kept[k] = (
            sums[k, 2] / num - mean * mean <= THIN_SPREAD * THIN_SPREAD
            and touching[k] >= LEAST_CONTACT and extent >= LEAST_EXTENT
        )
    return place[kept]
