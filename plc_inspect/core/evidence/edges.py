# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Edges of decks and roofs: rails, main cables and scan lines on walls run along them."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import (
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
    TOLERANCE,
)
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64

EDGE, DECK_ROOMS = 0.3, (1.3, 2.0)
"""
A deck or roof lies from so far to so far beside what runs along its edge, at least [m].
Source: derived: main cables are in the plane of the edge, to the miss of a curve on them; scan
lines are up to 1.5 m apart, and what is farther in was seen below the deck, too.
"""
DECK_STEP, FLAT, OPEN_DEPTH, EDGE_SHARE = 2.0, 0.2, 1.5, 0.7
"""
Parts along a deck [m], how far their tops are off a straight line and how far below it things are
on the other side [m], and the share of the parts where that is so, at least.
Source: judgement: a deck is straight to the noise; vehicles and trees take a third of it at most.
"""
LEAST_WIDTH, STRAY = 0.5, 0.2
"""
Extent of a deck across, beyond EDGE, at least [m], but for this share of its parts at each side.
Source: judgement: scan lines of a zigzag are in pairs 0.2 m apart; a wire beside is
straight, too, and has none.
"""


def find_edges(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], wire: Bool
) -> Float64:
    """
    Find the edges of decks and roofs that curves run along.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        Rails, cables, scan lines, or conductors.
    wire : (N,) bool
        Points of conductors.

    Returns
    -------
    (C,) float64
        Height of each above its edge [m], negative below it, NaN along none.

    """
    def find(number: int) -> float:
        for room in DECK_ROOMS:
            edge = float(_find_edge(points, index.grid, curves[number].row, wire, room))
            if not math.isnan(edge):
                break
        return edge

    return np.array(call_each(find, len(curves)), dtype=np.float64)


@njit(cache=True, nogil=True, error_model='numpy')
def _find_edge(points, grid, row, wire, room):  # type: ignore[no-untyped-def]
    """Return how high a row's curve is above what is flat on one side and open on the other."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, room,
    )
    # the points on each side, part by part
    num, opened = max(int((high - low) / DECK_STEP), 1), open_row(row)
    height, aside = np.empty(len(near)), np.empty(len(near))
    part, count = np.empty(len(near), dtype=np.int64), 0
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if wire[i] or x < low or x >= high or not EDGE <= abs(y) <= room:
            continue
        if abs(see_above(opened, x, points[i, 2])[0]) > row[TOLERANCE]:
            place = min(int((x - low) / (high - low) * num), num - 1)
            height[count], aside[count] = points[i, 2], y
            part[count] = place + num * (y > 0.0)
            count += 1
    middle, top = np.full(2 * num, np.inf), np.full(2 * num, -np.inf)
    for place in range(2 * num):
        own = height[:count][part[:count] == place]
        if len(own):
            middle[place], top[place] = np.median(own), own.max()
    # any straight line through two middles that most lie on, with nothing beside it
    for side in range(2):
        flat, other = np.roll(middle, side * num)[:num], np.roll(top, (1 - side) * num)[:num]
        for first in range(num):
            for last in range(first + max(num // 3, 1), num):
                slope = (flat[last] - flat[first]) / (last - first)
                line = flat[first] + slope * (np.arange(num) - first)
                lies = (np.abs(flat - line) <= FLAT) & (other < line - OPEN_DEPTH)
                if lies.mean() < EDGE_SHARE:
                    continue
                if _measure_width(part[:count] - side * num, aside, height, line) >= LEAST_WIDTH:
                    return height_of(row, 0.5 * (low + high)) - line.mean()
    return np.nan


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_width(part, aside, height, line):  # type: ignore[no-untyped-def]
    """Return the extent across of those points that lie on a line, given part by part [m]."""
    least, most = np.full(len(line), np.inf), np.full(len(line), -np.inf)
    for i in range(len(part)):
        place = part[i]
        if 0 <= place < len(line) and abs(height[i] - line[place]) <= FLAT:
            least[place] = min(least[place], aside[i])
            most[place] = max(most[place], aside[i])
    seen = np.isfinite(least)
    if not seen.any():  # a median may lie between two points
        return 0.0
    # beside a wire there is the arm that carries it
    return np.quantile(most[seen], 1.0 - STRAY) - np.quantile(least[seen], STRAY)
