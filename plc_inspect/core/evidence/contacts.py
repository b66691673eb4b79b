# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Contacts: where something thin touches a curve from below or from one side.

The main cables of suspension bridges have hangers below them, and pipes rest on brackets, or
between beams of a rack: they are touched at regular short intervals.  The frames of a rack bear
all that runs along it, each tells of some of them.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import (
    COS,
    CURVATURE,
    HEIGHT,
    height_of,
    HIGH,
    LOW,
    MIDDLE,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
    SLOPE,
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
BELOW, LEFT, RIGHT, RACK = 0, 1, 2, 3
"""Sides of a curve, of which something may hold it, and what it lies on.  Source: numerical."""
RACK_ROOM = 3.0
"""
Frames of a rack are looked for so far beside a curve [m].
Source: derived: its posts, 2.5 m from its middle, and half a metre.
"""
RACK_BEYOND = 15.0
"""
And so far beyond its ends [m].
Source: derived: two bays: three frames are seen from any piece that lies over one.
"""
RACK_HIGH = 2.0
"""
Height between the pipes of one rack, at most [m].
Source: judgement; tiers of random racks are 1.8 m apart.
"""
RACK_TURN = math.cos(math.radians(3.0))
"""Cosine of the turn between the pipes of one rack, at least.  Source: judgement."""
SAME_FRAME = 1.0
"""
What bears two pipes within this, along them, is one frame [m].
Source: derived: half of SHORTEST_BAY.
"""
NUM_LAYERS, LAYER, SOLID_SHARE = 5, 0.1, 0.5
"""
Contacts are looked for in the first of so many layers, each so much deeper [m], that holds points
along at most this share of the curve.
Source: derived: the lower half of a pipe of a metre, seen along most of it.
"""
LEVEL = 1e-9
"""Curvature of a straight line [1/m].  Source: numerical: avoids a division by 0."""
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

    So do those that run along each other over the frames of a rack.

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
        Even intervals of each curve, at least; between frames LEAST_EVEN.

    Returns
    -------
    (C,) bool
        Curves with contacts at even intervals.

    """
    found = call_each(
        lambda k: _list_contacts(
            points, index.grid, curves[k].row, _straighten(curves[k].row), wire
        ), len(curves),
    )
    frames = _share_frames(curves, [frames for *_, frames in found])
    return np.array([
        any(is_regular(np.diff(x), longest, even) for x in (below, left, right))
        or is_regular(np.diff(own), longest)
        for (below, left, right, _), own, even in zip(found, frames, least, strict=True)
    ], dtype=np.bool_)


def _straighten(row: Float64) -> Float64:
    """Return the chord of a row's curve, longer by RACK_BEYOND at both ends."""
    chord, low, high = row.copy(), row[LOW], row[HIGH]
    first, last = height_of(row, low), height_of(row, high)
    chord[MIDDLE], chord[HEIGHT] = 0.5 * (low + high), 0.5 * (first + last)
    chord[SLOPE], chord[CURVATURE] = (last - first) / (high - low), LEVEL
    chord[LOW], chord[HIGH] = low - RACK_BEYOND, high + RACK_BEYOND
    return chord


def _share_frames(curves: Sequence[Curve], frames: Sequence[Float64]) -> list[Float64]:
    """
    Return x along each curve of the frames under it and under what runs along it, ascending [m].

    ``frames`` has those under each alone.
    """
    if not curves:
        return []
    place = np.concatenate([curve.position(x) for curve, x in zip(curves, frames, strict=True)])
    azimuth = np.repeat([curve.azimuth for curve in curves], [len(x) for x in frames])
    result = []
    for curve in curves:
        x, y = curve.local(place)
        shared = np.abs(np.cos(azimuth - curve.azimuth)) >= RACK_TURN
        shared &= np.abs(y) <= RACK_ROOM
        shared &= np.abs(place[:, 2] - curve.fit.height(x)) <= RACK_HIGH
        shared &= (x >= curve.low - RACK_BEYOND) & (x <= curve.high + RACK_BEYOND)
        along = np.sort(x[shared])
        parts = np.split(along, np.flatnonzero(np.diff(along) > SAME_FRAME) + 1)
        own = np.array([part.mean() for part in parts if len(part)])
        bears = bool(((own >= curve.low) & (own <= curve.high)).any())
        result.append(own if bears else own[:0])
    return result


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
def _list_contacts(points, grid, row, chord, wire):  # type: ignore[no-untyped-def]
    """
    List x along a row's curve where something thin touches it from each of its sides [m].

    Last are those along its chord where something thin stands or lies across under that.
    """
    places = _place_about(
        points, grid, row, wire, row[TOLERANCE] + NUM_LAYERS * LAYER + CONTACT_DEPTH
    )
    under = _place_about(points, grid, chord, wire, RACK_ROOM)
    return (
        _list_on_side(places, row, BELOW), _list_on_side(places, row, LEFT),
        _list_on_side(places, row, RIGHT), _list_on_side(under, chord, RACK),
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _place_about(points, grid, row, wire, aside):  # type: ignore[no-untyped-def]
    """Return (K, 3) places along, beside and above a row's curve of what may touch it [m]."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    solid = row[TOLERANCE] + NUM_LAYERS * LAYER
    below = solid + THIN_DEPTH
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
def _list_on_side(places, row, side):  # type: ignore[no-untyped-def]
    """List x along a row's curve where it is touched from one side [m]."""
    low, high = row[LOW], row[HIGH]
    num = int((high - low) / CONTACT_CELL) + 1
    room = RACK_ROOM if side == RACK else CONTACT_ROOM
    touched, top = np.zeros(num, dtype=np.bool_), 0.0
    for layer in range(NUM_LAYERS):
        # beyond what is solid: a pipe is touched nowhere else
        top = row[TOLERANCE] + layer * LAYER
        touched[:] = False
        for k in range(len(places)):
            x = places[k, 0]
            across, away = _see_from(places[k], side)
            away -= top
            if low <= x <= high and abs(across) < room and 0.0 < away < CONTACT_DEPTH:
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
    if side == LEFT:
        return place[2], place[1]
    if side == RIGHT:
        return place[2], -place[1]
    return place[1], -place[2]


@njit(cache=True, nogil=True, error_model='numpy')
def _keep_thin(places, top, side, found):  # type: ignore[no-untyped-def]
    """
    Return the contacts whose places, and those beyond them, lie close together along a curve.

    ``top`` is how far away from the curve they begin [m].
    """
    sums, touching = np.zeros((len(found), 3)), np.zeros(len(found))
    least, most = np.full((len(found), 2), np.inf), np.full((len(found), 2), -np.inf)
    # aside, no more was gathered; below a rack lies the next tier
    depth = THIN_DEPTH if side == BELOW else CONTACT_DEPTH
    room, touch = (RACK_ROOM, RACK_ROOM) if side == RACK else (THIN_ROOM, CONTACT_ROOM)
    for n in range(len(places)):
        x = places[n, 0]
        across, away = _see_from(places[n], side)
        away -= top
        if abs(across) >= room or not 0.0 < away < depth:
            continue
        after = np.searchsorted(found, x)
        for k in range(max(after - 1, 0), min(after + 1, len(found))):
            d = x - found[k]
            if abs(d) < THIN_ROOM:
                sums[k, 0] += 1.0
                sums[k, 1] += d
                sums[k, 2] += d * d
                touching[k] += abs(across) < touch and away < CONTACT_DEPTH
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
