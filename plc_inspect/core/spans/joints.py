# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints: where the curves of two neighbouring spans of a conductor meet at a support."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, pack_curves, PART_MISS
from plc_inspect.core.catenary.curve_row import (
    COS,
    height_of,
    HIGH,
    LOW,
    plan_of,
    SIN,
    slope_of,
    slope_variance_of,
    to_local,
    TURN_SIGMA,
)
from plc_inspect.core.catenary.growing import BESIDE_SHARE
from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.assignment import pair_up
from plc_inspect.results import Float64, Int64

MAX_TURN = math.radians(65.0)
"""
Sharpest angle of a line at a support.
Source: judgement; holds from 32.5 to 91 degrees on bench/constants.py.
"""
MAX_MISS = 0.5
"""
Greatest distance of the two curves where they are nearest; insulators fill it [m].
Source: judgement; holds from 0.25 to 1 on bench/constants.py.
"""
MIN_RISE = 0.005
"""
Least kink at a support [-].  What passes a support and lacks more of the kink that it would have
there, on top of its uncertainty, hangs elsewhere.
Source: derived: that of a hinge, `catenary/breaks.py`; holds from 0.004 to 0.016 on
bench/constants.py.
"""
MIN_TURN = 0.012
"""
Least turn in plan, or kink upwards, at a support where no kink tells of one [rad], on top of its
own uncertainty.
Source: derived: the least kink at which a track is cut, `catenary/breaks.py`.
"""
STRETCH_COST = 0.02
"""
A metre of extrapolation weighs as much as this miss [m].
Source: judgement; holds from 0.01 to 0.04 on bench/constants.py.
"""
LONE = 0.5
"""
Two ends that meet nothing cost as much as a pair of this cost.
Source: derived: MAX_MISS, by which a conductor may miss its own.
"""
MAX_OVERLAP = 8.0
"""
How far a curve may run on beyond its support [m].
Source: judgement; holds from 4 to 16 on bench/constants.py.
"""
MOST_BESIDE = 3.0
"""
Two curves that lie farther apart than PART_MISS all along more than this are two conductors [m].
Source: judgement: insulators of a strain tower are shorter.
"""
TOGETHER = 15.0
"""
Conductors that meet this near in plan may hang at one support [m].
Source: judgement: arms of the widest towers.
"""
COARSE_STEP, FINE_STEP = 0.25, 0.02
"""
Steps in which the nearest places of two curves are looked for [m].
Source: numerical: the finer one follows the nearest of the coarse ones.
"""
FACING_ROOM = 3.0
"""
Ends that face each other lie at most this far beside each other's line, beyond its turn [m].
Source: judgement; not measured.
"""
STRETCH_SHARE, STRETCH_ROOM = 0.7, 2.0
"""
A curve is extrapolated by at most this share of its length and this much more [m].
Source: judgement; not measured.
"""
TURN_SIGMAS = 4.0
"""
Standard deviations by which a turn or a kink upwards is more than MIN_TURN, and by which the kink
that something lacks is more than MIN_RISE.
Source: derived: that of the kinks at which a track is cut, `catenary/breaks.py`.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """Two ends of curves that meet at one attachment."""

    curves: tuple[int, int]
    sides: tuple[int, int]
    """+1 where the curve's high end meets, -1 its low end."""
    x: tuple[float, float]
    """Position of the joint along each of the curves [m]."""
    position: Float64
    """(3,) [m]"""
    direction: float
    """Azimuth of the line at the joint, half way between both curves, modulo pi [rad]."""
    kink: float
    """Sum of the two rises towards the joint."""
    miss: float
    """Distance of the curves at the joint [m]."""
    cost: float


def find_joints(curves: Sequence[Curve], max_reach: float) -> tuple[Joint, ...]:
    """
    Pair the ends of curves that meet at a support, each end at most once, all at the least cost.

    Two ends meet where the extrapolated curves come within ``MAX_MISS`` of each other, if the
    conductor is bent there: both rise towards the place taken together, as conductors hanging
    from a support do, or it surely turns in plan, or is drawn upwards, as at a support on a low
    point.

    Parameters
    ----------
    curves : sequence of Curve
        Curves, each within one span.
    max_reach : float
        Longest extrapolation from either end [m].

    Returns
    -------
    tuple of Joint, in order of cost

    """
    rows = pack_curves(curves)
    pairs, values = meet_ends(rows, len(curves), max_reach)
    chosen = []
    for k in choose_pairs(rows, pairs, values):
        first, side, second, other_side = pairs[k].tolist()
        x, other_x, miss, kink, cost = values[k].tolist()
        chosen.append(describe_joint(
            curves, (first, second), (side, other_side), (x, other_x),
            kink=kink, miss=miss, cost=cost,
        ))
    return tuple(chosen)


def meet_ends(rows: Float64, num_known: int, max_reach: float) -> tuple[Int64, Float64]:
    """
    Find the ends of curves that may meet at a support.

    Parameters
    ----------
    rows : (C, COLUMNS) float64
        Curves.
    num_known : int
        One of two that meet is among so many first ones, and comes first of both.
    max_reach : float
        Longest extrapolation from either end [m].

    Returns
    -------
    pairs : (P, 4) int64
        Curve and side of one end, curve and side of the other.
    values : (P, 5) float64
        X of both curves, their distance, the kink and the cost.

    """
    pairs = _pair_ends(rows, num_known, max_reach)
    met, values = _meet_all(rows, pairs, max_reach)
    return pairs[met], values[met]


def choose_pairs(rows: Float64, pairs: Int64, values: Float64) -> list[int]:
    """
    Choose the pairs that meet, each end at most once, all at the least cost.

    Parameters
    ----------
    rows : (C, COLUMNS) float64
        Curves.
    pairs, values : (P, 4) int64 and (P, 5) float64
        As of `meet_ends`.

    Returns
    -------
    list of int
        Numbers of the pairs, the cheapest first.

    """
    ends, cost = _number_ends(pairs), values[:, 4]
    stray = _measure_stray(rows, pairs, ends, values, _choose(pairs, ends, cost))
    return sorted(_choose(pairs, ends, cost + stray).tolist(), key=cost.__getitem__)


def _choose(pairs: Int64, ends: Int64, cost: Float64) -> Int64:
    # the cheapest first, then by curves and sides
    order = np.lexsort((*pairs[:, [3, 1, 2, 0]].T, cost))
    chosen: Int64 = order[pair_up(ends[order], cost[order], LONE)]
    return chosen


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_stray(rows, pairs, ends, values, chosen):  # type: ignore[no-untyped-def]
    """
    Return what it costs pairs to meet before or behind where the chosen ones about them do.

    Any two conductors of a rack meet somewhere in its plane; at the pole do those that are one.
    """
    result, others = np.zeros(len(pairs)), np.empty(len(chosen))
    for k in range(len(pairs)):
        one, side, other, other_side = pairs[k]
        wx = other_side * rows[other, COS] - side * rows[one, COS]
        wy = other_side * rows[other, SIN] - side * rows[one, SIN]
        x, y = plan_of(rows[one], values[k, 0])
        num, length = 0, math.hypot(wx, wy)
        for m in chosen:
            if (ends[m] == ends[k]).any() or (ends[m] == ends[k, ::-1]).any():
                continue
            px, py = plan_of(rows[pairs[m, 0]], values[m, 0])
            along = ((px - x) * wx + (py - y) * wy) / length
            if math.hypot(px - x, py - y) <= TOGETHER and abs(along) <= MAX_OVERLAP:
                others[num] = along
                num += 1
        if num:
            result[k] = STRETCH_COST * abs(np.median(others[:num]))
    return result


def _number_ends(pairs: Int64) -> Int64:
    """Return the numbers of the ends of pairs as of `meet_ends`, two of each curve."""
    return np.ascontiguousarray(2 * pairs[:, ::2] + (pairs[:, 1::2] > 0))


@njit(cache=True, nogil=True, error_model='numpy')
def _pair_ends(rows, num_known, max_reach):  # type: ignore[no-untyped-def]
    """Pair the ends that face each other, in plan; the first is of one of the known curves."""
    num = 2 * len(rows)
    # where each end is, and the way out of its curve
    end = np.empty((num, 4))
    for k in range(num):
        row, side = rows[k // 2], 2.0 * (k % 2) - 1.0
        x = row[HIGH] if side > 0 else row[LOW]
        end[k, 0], end[k, 1] = plan_of(row, x)
        end[k, 2], end[k, 3] = side * row[COS], side * row[SIN]
    pairs, found = np.empty((max(num, 16), 4), dtype=np.int64), 0
    for one in range(2 * num_known):
        for other in range(2 * (one // 2) + 2, num):
            if not (_faces(end[one], end[other], max_reach)
                    and _faces(end[other], end[one], max_reach)):
                continue
            if found == len(pairs):
                longer = np.empty((2 * found, 4), dtype=np.int64)
                put(pairs, longer)
                pairs = longer
            pairs[found] = one // 2, 2 * (one % 2) - 1, other // 2, 2 * (other % 2) - 1
            found += 1
    return pairs[:found]


@njit(cache=True, nogil=True, error_model='numpy')
def _faces(end, other, max_reach):  # type: ignore[no-untyped-def]
    """Tell whether another end lies before one and runs towards it."""
    if end[2] * other[2] + end[3] * other[3] >= -math.cos(MAX_TURN):
        return False
    dx, dy = other[0] - end[0], other[1] - end[1]
    ahead = dx * end[2] + dy * end[3]
    across = abs(dx * end[3] - dy * end[2])
    return (
        math.hypot(dx, dy) < 2 * max_reach and ahead > -2 * MAX_OVERLAP
        and across < FACING_ROOM + abs(ahead) * math.tan(MAX_TURN / 2) + MAX_MISS
    )


def describe_joint(
    curves: Sequence[Curve], numbers: tuple[int, int], sides: tuple[int, int],
    x: tuple[float, float], *, kink: float, miss: float, cost: float,
) -> Joint:
    """
    Return the joint of two ends.

    Parameters
    ----------
    curves : sequence of Curve
        All curves.
    numbers, sides, x, kink, miss, cost
        The two among them, and the others as of ``Joint``.

    Returns
    -------
    Joint

    """
    first, second = (curves[number] for number in numbers)
    axis = [
        sides[1] * turn(second.azimuth) - sides[0] * turn(first.azimuth)
        for turn in (math.cos, math.sin)
    ]
    return Joint(
        curves=numbers,
        sides=sides,
        x=x,
        position=(first.position(x[0])[0] + second.position(x[1])[0]) / 2,
        direction=math.atan2(axis[1], axis[0]),
        kink=kink,
        miss=miss,
        cost=cost,
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _meet_all(rows, pairs, max_reach):  # type: ignore[no-untyped-def]
    """Which pairs of ends meet, and x of both curves, their distance, the kink and the cost."""
    met = np.zeros(len(pairs), dtype=np.bool_)
    values = np.empty((len(pairs), 5))
    for k in range(len(pairs)):
        first, second = rows[pairs[k, 0]], rows[pairs[k, 2]]
        side, other_side = pairs[k, 1], pairs[k, 3]
        x, other_x, miss = _approach(
            first, second, side, other_side,
            min(max_reach, STRETCH_SHARE * (first[HIGH] - first[LOW]) + STRETCH_ROOM),
            min(max_reach, STRETCH_SHARE * (second[HIGH] - second[LOW]) + STRETCH_ROOM),
        )
        if miss > MAX_MISS:
            continue
        # how both curves rise to where they meet, and how far that is from their ends
        rise = side * slope_of(first, x) + other_side * slope_of(second, other_x)
        beyond = (x - (first[HIGH] if side > 0 else first[LOW])) * side
        other_beyond = (other_x - (second[HIGH] if other_side > 0 else second[LOW])) * other_side
        shorter = min(first[HIGH] - first[LOW], second[HIGH] - second[LOW])
        overlap = max(-beyond, 0.0) + max(-other_beyond, 0.0)
        if overlap > BESIDE_SHARE * shorter or (overlap > MOST_BESIDE and miss > PART_MISS):
            continue  # they hang side by side
        stretch = max(beyond, 0.0) + max(other_beyond, 0.0)
        met[k] = rise >= MIN_RISE or _is_bent(first, second, x, other_x, rise)
        values[k, 0], values[k, 1], values[k, 2], values[k, 3] = x, other_x, miss, rise
        values[k, 4] = miss + STRETCH_COST * stretch
    return met, values


@njit(cache=True, nogil=True, error_model='numpy')
def _is_bent(row, other, x, other_x, rise):  # type: ignore[no-untyped-def]
    """Tell whether two curves surely turn in plan, or fall, towards where they meet."""
    sine = row[COS] * other[SIN] - row[SIN] * other[COS]
    turn = abs(math.asin(min(max(sine, -1.0), 1.0)))
    sigma = math.hypot(row[TURN_SIGMA], other[TURN_SIGMA])
    if turn >= MIN_TURN + TURN_SIGMAS * sigma:
        return True
    sigma = math.sqrt(slope_variance_of(row, x) + slope_variance_of(other, other_x))
    return -rise >= MIN_TURN + TURN_SIGMAS * sigma


@njit(cache=True, nogil=True, error_model='numpy')
def _approach(row, other, side, other_side, reach, other_reach):  # type: ignore[no-untyped-def]
    """
    Where two curves, as rows, are nearest about their facing ends.

    Returned are the place along each of them and their distance there [m], inf where neither
    comes near the end of the other.
    """
    end = row[HIGH] if side > 0 else row[LOW]
    other_end = other[HIGH] if other_side > 0 else other[LOW]
    back = min(MAX_OVERLAP, (row[HIGH] - row[LOW]) / 2)
    other_back = min(MAX_OVERLAP, (other[HIGH] - other[LOW]) / 2)
    best_x, best_other_x, best = end, other_end, np.inf
    for fine in range(2):
        # along all of the end in coarse steps, then about the best of them in fine ones
        if fine == 0:
            first, step = end - side * back, COARSE_STEP * side
            num = math.ceil((reach + back) / COARSE_STEP)
        else:
            if best == np.inf:
                break
            first, step = best_x - COARSE_STEP, FINE_STEP
            num = math.ceil(2 * COARSE_STEP / FINE_STEP) + 1
            best = np.inf
        for k in range(num):
            x = first + k * step
            px, py = plan_of(row, x)
            other_x, across = to_local(other, px, py)
            # the distance across alone is never more than that in space
            beyond = (other_x - other_end) * other_side
            if not -other_back < beyond < other_reach or abs(across) >= best:
                continue
            miss = math.hypot(across, height_of(row, x) - height_of(other, other_x))
            if miss < best:
                best_x, best_other_x, best = x, other_x, miss
    return best_x, best_other_x, best
