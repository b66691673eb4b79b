# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Crossarms: bars between conductors side by side, seen where hardly anything of their pole is.

From above a pole is seen end on: of 30 returns 28 are of its arm.  An arm fills the gap between
two conductors, at their height, over less than half a metre along them, and before and behind it
the gap is empty.  What grows into a line is as long as it is wide.
"""

from collections.abc import Sequence

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    HIGH,
    LOW,
    open_row,
    plan_of,
    see_above,
    see_beside,
    SIN,
)
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.extraction.structures import COLUMN, LEAST_HEIGHT, MAX_BELOW
from plc_inspect.core.numerics.arrays import count_bits
from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.core.numerics.near_pairs import find_pairs
from plc_inspect.core.numerics.plan_index import gather_strip
from plc_inspect.core.spans.standing_poles import StandingPole
from plc_inspect.results import Bool, Float64, Int32

LEAST_GAP, MOST_GAP = 0.3, 3.0
"""
Distance in plan of two conductors next to each other on an arm [m].
Source: judgement: arms of low and medium voltage; strands of a bundle hang nearer.
"""
LEAST_WIDTH = 0.8
"""
Distance of the outermost conductors on an arm, at least [m].
Source: judgement: spacers of bundles are at most 0.6 m wide.
"""
MARGIN = 0.12
"""
Distance from a conductor within which points are its own [m].
Source: derived: three standard deviations of a well seen one.
"""
PARALLEL = 0.1
"""Sine of the greatest turn between two conductors on an arm.  Source: judgement: six degrees."""
STEP = 0.25
"""
Length along a conductor of a slot; an arm is in two of them [m].
Source: judgement: an arm is 0.1 to 0.2 m thick, and askew where a line turns.
"""
CELL = 0.3
"""Width of the cells of a gap that an arm fills [m].  Source: judgement; not measured."""
FILLED = 0.75
"""Share of them that hold points.  Source: judgement; not measured."""
LEAST_POINTS, LEAST_ALL = 3, 8
"""
Points of an arm in a gap, at least, and in all gaps that it bridges, taken two by two.
Source: judgement: three points lie in a gap by chance, in two gaps beside each other hardly.
"""
BESIDE, MOST_BESIDE = 2.0, 0.25
"""
Length of the gap before and behind an arm that is empty [m], and the points there, per point of
the arm, at most.
Source: judgement; measured: of 98 bars in 80 random scenes 90 are of poles, eight of the beams of
towers; 17 in six real clouds are of poles.
"""
FOOT = 0.35
"""
Distance along the line from an arm within which its pole stands [m].
Source: as COLUMN, and half the thickness of an arm.
"""


MIDDLE, LOWEST, TOP, ENDS, NUM_POINTS, BAR = slice(2), 2, 3, slice(4, 8), 8, 9
"""
Columns of a bar: the middle of its points in plan [m], their lowest and highest height [m], where
both conductors pass it in plan [m], and their number; BAR is the length of a row.
Source: numerical: the layout of a row.
"""


def find_crossarms(
    cloud: OffGround, curves: Sequence[Curve], wire: Bool
) -> tuple[StandingPole, ...]:
    """
    Find the poles whose arms fill the gaps between conductors.

    The arguments are those of `standing_poles.find_poles`.

    Returns
    -------
    tuple of StandingPole
        Where something stands below an arm, to whose highest point they rise.

    """
    if len(curves) < 2:
        return ()
    near = find_near(curves, MOST_GAP)
    bars = np.concatenate(_find_bars(
        cloud.points, *cloud.index.grid, pack_curves(curves), near.start, near.item, wire
    ))
    level = np.column_stack((bars[:, MIDDLE], np.zeros(len(bars))))
    group = unite(find_pairs(level, MOST_GAP), len(bars))
    arms = (_stand_below(cloud, wire, bars[group == k]) for k in np.unique(group))
    return tuple(arm for arm in arms if arm is not None)


def _stand_below(cloud: OffGround, wire: Bool, bars: Float64) -> StandingPole | None:
    """Return the pole of some bars (B, BAR), where a point below them tells that it stands."""
    if bars[:, NUM_POINTS].sum() < LEAST_ALL:
        return None
    middle = np.median(bars[:, MIDDLE], axis=0)
    ends = bars[:, ENDS].reshape(-1, 2) - middle
    far = np.hypot(*ends.T)
    width = float(far.max())
    across = ends[far.argmax()] / width
    side = ends @ across
    if np.ptp(side) < LEAST_WIDTH:
        return None
    near: Int32 = cloud.index.strip(middle, middle, width + COLUMN)
    near = near[~wire[near] & (cloud.height.height[near] > LEAST_HEIGHT)]
    apart = cloud.points[near, :2] - middle
    along, beside = apart @ (across[1], -across[0]), apart @ across
    below = (
        (np.abs(along) <= FOOT) & (beside >= side.min() - COLUMN) & (beside <= side.max() + COLUMN)
        & (cloud.points[near, 2] < bars[:, LOWEST].min() - MAX_BELOW)
    )
    if not below.any():
        return None
    position = middle + across * float(np.median(beside[below]))
    return StandingPole(
        position=position,
        base=float(cloud.height.ground.at(np.append(position, 0.0)[None, :])[0]),
        top=float(bars[:, TOP].max()),
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _find_bars(  # type: ignore[no-untyped-def]
    points, start, order, corner, cell, num_rows, num_columns, rows, first, other, wire
):
    """List for each row the bars to those others of higher number that are beside it."""
    found = [np.zeros((0, BAR)) for _ in range(len(rows))]
    for number in range(len(rows)):
        row = rows[number]
        low, high = row[LOW], row[HIGH]
        x0, y0 = plan_of(row, low)
        x1, y1 = plan_of(row, high)
        near = gather_strip(
            start, order, corner, cell, num_rows, num_columns, x0, y0, x1, y1, MOST_GAP
        )
        # what lies beside the curve, at its height
        opened, num = open_row(row), 0
        for i in near:
            if wire[i]:
                continue
            x, y = see_beside(opened, points[i, 0], points[i, 1])
            if x < low or x > high or abs(y) <= MARGIN or abs(y) >= MOST_GAP:
                continue
            rise, _ = see_above(opened, x, points[i, 2])
            if abs(rise) <= 2.0 * MAX_BELOW:
                near[num] = i
                num += 1
        own = near[:num]
        for k in range(first[number], first[number + 1]):
            if other[k] > number and num >= LEAST_POINTS:
                bars = _fill_gap(points, own, row, rows[other[k]])
                found[number] = np.concatenate((found[number], bars))
    return found


@njit(cache=True, nogil=True, error_model='numpy')
def _fill_gap(points, own, row, other):  # type: ignore[no-untyped-def]
    """List the bars (B, BAR) between two curves."""
    turn = row[COS] * other[SIN] - row[SIN] * other[COS]
    if abs(turn) > PARALLEL:
        return np.zeros((0, BAR))
    facing = 1.0 if row[COS] * other[COS] + row[SIN] * other[SIN] > 0.0 else -1.0
    low, high = row[LOW], row[HIGH]
    opened, beside = open_row(row), open_row(other)
    around = int(BESIDE / STEP)
    size = int((high - low) / STEP) + 2 * around + 3
    counts, cells = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64)
    gaps = np.zeros(size)
    place = np.full(len(own), -1, dtype=np.int64)
    for k in range(len(own)):
        px, py, pz = points[own[k], 0], points[own[k], 1], points[own[k], 2]
        x, y = see_beside(opened, px, py)
        far, away = see_beside(beside, px, py)
        away *= -facing
        gap = abs(y) + abs(away)
        if y * away <= 0.0 or abs(away) <= MARGIN or not LEAST_GAP <= gap <= MOST_GAP:
            continue  # not between them
        if far < other[LOW] or far > other[HIGH]:
            continue
        rise, _ = see_above(opened, x, pz)
        lift, _ = see_above(beside, far, pz)
        share = abs(y) / gap
        if abs(rise - lift) > MAX_BELOW or abs((1.0 - share) * rise + share * lift) > MAX_BELOW:
            continue
        room = gap - 2.0 * MARGIN
        place[k] = around + 1 + int((x - low) / STEP)
        counts[place[k]] += 1
        cells[place[k]] |= 1 << int((abs(y) - MARGIN) / min(CELL, room / 2.0))
        gaps[place[k]] = gap
    bars = np.zeros((0, BAR))
    for slot in range(around + 1, size - around - 1):
        num = counts[slot] + counts[slot + 1]
        if num < LEAST_POINTS or counts[slot] == 0 or _is_less(counts, slot):
            continue
        filled = count_bits(cells[slot] | cells[slot + 1])
        room = gaps[slot] - 2.0 * MARGIN
        nearby = counts[slot - around : slot + 2 + around].sum() - num
        if filled < FILLED * room / min(CELL, room / 2.0) or nearby > MOST_BESIDE * num:
            continue
        chosen = own[(place == slot) | (place == slot + 1)]
        px, py = points[chosen, 0].mean(), points[chosen, 1].mean()
        x0, y0 = plan_of(row, see_beside(opened, px, py)[0])
        x1, y1 = plan_of(other, see_beside(beside, px, py)[0])
        low_z, high_z = points[chosen, 2].min(), points[chosen, 2].max()
        bars = np.concatenate((
            bars, np.array([[px, py, low_z, high_z, x0, y0, x1, y1, num]])
        ))
    return bars


@njit(cache=True, nogil=True, inline='always')
def _is_less(counts, slot):  # type: ignore[no-untyped-def]
    """Tell whether two slots hold fewer points than two others that overlap or adjoin them."""
    num = counts[slot] + counts[slot + 1]
    for step in (-2, -1, 1, 2):
        other = counts[slot + step] + counts[slot + step + 1]
        if other > num or (other == num and step < 0 and counts[slot + step] > 0):
            return True
    return False
