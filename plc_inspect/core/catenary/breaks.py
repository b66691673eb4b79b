# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Breaks: the places where a track passes from one span to the next.

A track may run over many supports.  It is cut into short pieces, each a parabola in z and a line
in y, and neighbours are merged as long as one piece explains both about as well; what is left are
the spans.  A single best cut will not do: in a track of several spans it may lie within a span.

Conductors side by side hang from the same supports.  Of their tracks each has parabolas and lines
of its own, and the breaks are of all: what one shows within its noise, four show beyond it.
"""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.numerics.piece_sums import add_up, CELL, count_points, solve, solve_all
from plc_inspect.results import Float64, Int64

MIN_SIDE = 5.0
"""Least extent of a piece [m].  Source: judgement; not measured."""
MIN_SIDE_POINTS = 6
"""Points of a piece, at least.  Source: derived: its five parameters, and one more."""
MIN_KINK = 0.012
"""
Smallest change of slope that counts as a kink, on top of four times its own deviation.
Source: derived: two spans of 10 m at a catenary constant of 800 m.
"""
PARAMETERS, MERGE_SPREAD = 5.0, 15.0
"""
Neighbours are merged where the squared error grows by at most PARAMETERS for each of M tracks, and
MERGE_SPREAD times the root of M, in variances of the noise.
Source: derived: by the five parameters that are saved it grows by 5 M on average with a deviation
of the root of 10 M, and by 20 in one case of 800 of a single track.
"""
MAX_MISFIT = 0.05
"""
One piece that misses the points by more (rms) is two, whatever its kink [m].
Source: derived: half the least tolerance of a curve, beyond which it loses points.
"""
NUM_SWEEPS = 2
"""
How often the places of all breaks are looked for anew between their neighbours.
Source: judgement; not measured.
"""
REACH = 2.0
"""
Length by which a break moves at most when others were dropped [m].
Source: measured: what is left of two spans and a break that is not sure draws the next break 18 m
from its support into mid-span, where none is sure (random scene, any 371018); with 1 m pieces of
5 m do not find their support, `test_breaks.py`.
"""
ANYWHERE = 1e6
"""Length by which it moves at first [m].  Source: numerical: beyond any track."""
LEAST = 1e-12
"""Variance of the noise, at least [m2].  Source: numerical: a track without noise has 0."""
ALIKE = 1e-12
"""
Parabolas whose curvatures differ by less meet as lines do [1/m].
Source: numerical: rounding of the coefficients.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """A place where a track is two curves rather than one."""

    x: float
    """Position along the track [m]."""
    kink: float
    """Change of slope, negative where the conductor hangs from a support."""
    turn: float
    """Change of plan direction [rad]."""


def find_breaks(
    x: Float64, y: Float64, z: Float64, track: Int64 | None = None
) -> tuple[Break, ...]:
    """
    Find the supports on a track, or on tracks side by side, in order along them.

    A conductor hangs in convex arcs: from one span to the next the slope changes abruptly, or the
    plan direction turns.  A break is believed when its kink or its turn is greater than four
    times its own standard deviation, or when one curve would miss the points of both sides.  A
    kink may go either way: at a support on a low point the conductor is drawn upwards on both
    sides.  O(N + P^2) for a track of P pieces.

    Parameters
    ----------
    x, y, z : (N,) float64
        Along the track, across it and up [m].
    track : (N,) int64, optional
        Which track each point is of, from 0 on; one by default.

    Returns
    -------
    tuple of Break
        With the mean kink and turn of all tracks.

    """
    x, y, z = (np.ascontiguousarray(item, dtype=np.float64) for item in (x, y, z))
    own = np.zeros(len(x), dtype=np.int64) if track is None else track
    found = locate_breaks(x, y, z, own)
    return tuple(Break(x=at, kink=kink, turn=turn) for at, kink, turn in found.tolist())


@njit(cache=True, nogil=True, error_model='numpy')
def locate_breaks(x, y, z, track):  # type: ignore[no-untyped-def]
    """Return (B, 3) the place of each break along x, its mean kink and turn."""
    if len(x) < 2 * MIN_SIDE_POINTS or x.max() - x.min() < 2 * MIN_SIDE:
        return np.empty((0, 3))
    low = x.min()
    before = add_up(x - low, y - y.mean(), z - z.mean(), track)
    bounds = _cut_evenly(before)
    noise = max(_measure_noise(before, bounds), LEAST)
    bounds = _merge(before, bounds, noise)
    settle(before, bounds)
    while len(bounds) > 2:
        for _ in range(NUM_SWEEPS):
            settle(before, bounds, REACH)
        # the least sure break is dropped first, as its pieces then tell more of the next one
        result = np.empty((len(bounds) - 2, 3))
        weakest, least = -1, 1.0
        for k in range(len(result)):
            sure, at, kink, turn = _ask(before, bounds[k], bounds[k + 1], bounds[k + 2])
            result[k, 0], result[k, 1], result[k, 2] = at + low, kink, turn
            if sure < least:
                weakest, least = k, sure
        if weakest < 0:
            return result
        bounds = np.concatenate((bounds[: weakest + 1], bounds[weakest + 2 :]))
    return np.empty((0, 3))


@njit(cache=True, nogil=True, error_model='numpy')
def _ask(before, first, cut, last):  # type: ignore[no-untyped-def]
    """Return how sure a break is, from 1 on it is believed, its place, and mean kink and turn."""
    model, other, union = np.empty(5), np.empty(5), np.empty(5)
    count = error = growth = bend = weight = at = kink = turn = 0.0
    left, right = (cut - first) * CELL, (last - cut) * CELL
    for own in before:
        num_left, num_right = own[cut, 0] - own[first, 0], own[last, 0] - own[cut, 0]
        if min(num_left, num_right) < PARAMETERS:
            continue
        parts = solve(own, first, cut, model) + solve(own, cut, last, other)
        count, error = count + num_left + num_right, error + parts
        growth += max(solve(own, first, last, union) - parts, 0.0)
        # what a catenary differs from a parabola by, at the ends of both pieces
        bend = max(bend, abs(2.0 * union[2]) ** 3 * (left + right) ** 4 / 384.0)
        # the more points a track has, the more it tells of the place
        share = 1.0 / (1.0 / (num_left * left**2) + 1.0 / (num_right * right**2))
        place = _crossing(model, other, cut * CELL)
        weight += share
        at += share * place
        kink += share * (
            (other[1] + 2.0 * other[2] * place) - (model[1] + 2.0 * model[2] * place)
        )
        turn += share * math.atan(other[4] - model[4])
    if weight == 0.0:
        return 0.0, cut * CELL, 0.0, 0.0
    at, kink, turn = at / weight, kink / weight, turn / weight
    scatter = math.sqrt(error / max(count - 2.0 * PARAMETERS * len(before), 1.0))
    kink_limit = MIN_KINK + 4.0 * scatter * math.sqrt(192.0 / weight)
    turn_limit = MIN_KINK + 4.0 * scatter * math.sqrt(12.0 / weight)
    sure = max(
        abs(kink) / kink_limit, abs(turn) / turn_limit,
        math.sqrt(growth / count) / (MAX_MISFIT + 0.5 * bend),
    )
    return sure, at, kink, turn


@njit(cache=True, nogil=True, error_model='numpy')
def _cut_evenly(before):  # type: ignore[no-untyped-def]
    """Bounds of the shortest pieces that are long and full enough, in cells."""
    num = before.shape[1] - 1
    least, points = math.ceil(MIN_SIDE / CELL), len(before) * MIN_SIDE_POINTS
    bounds = np.empty(num // least + 2, dtype=np.int64)
    bounds[0] = 0
    count = 1
    for cell in range(1, num + 1):
        last = bounds[count - 1]
        full = count_points(before, last, cell) >= points
        rest = count_points(before, cell, num) >= points and num - cell >= least
        if cell - last >= least and full and rest:
            bounds[count] = cell
            count += 1
    bounds[count] = num
    return bounds[: count + 1].copy()


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_noise(before, bounds):  # type: ignore[no-untyped-def]
    """Variance of the points about the shortest pieces: the median of the pieces."""
    variance = np.empty(len(bounds) - 1)
    for k in range(len(variance)):
        count = count_points(before, bounds[k], bounds[k + 1])
        error = solve_all(before, bounds[k], bounds[k + 1])
        variance[k] = error / max(count - PARAMETERS * len(before), 1.0)
    return np.median(variance)


@njit(cache=True, nogil=True, error_model='numpy')
def _merge(before, bounds, noise):  # type: ignore[no-untyped-def]
    """Merge neighbours, the most alike first, while one piece explains both."""
    num = len(bounds) - 1
    bounds = bounds.copy()
    most = noise * (PARAMETERS * len(before) + MERGE_SPREAD * math.sqrt(len(before)))
    error = np.empty(num)
    for k in range(num):
        error[k] = solve_all(before, bounds[k], bounds[k + 1])
    union = np.empty(max(num - 1, 0))
    for k in range(num - 1):
        union[k] = solve_all(before, bounds[k], bounds[k + 2])
    while num > 1:
        best, least = -1, most
        for k in range(num - 1):
            growth = union[k] - error[k] - error[k + 1]
            if growth < least:
                best, least = k, growth
        if best < 0:
            break
        error[best] = union[best]
        for k in range(best + 1, num - 1):
            error[k] = error[k + 1]
        for k in range(best + 1, num):
            bounds[k] = bounds[k + 1]
        for k in range(best, num - 2):
            union[k] = union[k + 1]
        num -= 1
        for k in range(max(best - 1, 0), min(best + 1, num - 1)):
            union[k] = solve_all(before, bounds[k], bounds[k + 2])
    return bounds[: num + 1].copy()


@njit(cache=True, nogil=True, error_model='numpy')
def settle(before, bounds, reach=ANYWHERE):  # type: ignore[no-untyped-def]
    """Move each inner bound, in place, to where both its pieces fit best, by ``reach`` [m]."""
    least, points = math.ceil(MIN_SIDE / CELL), len(before) * MIN_SIDE_POINTS
    for k in range(1, len(bounds) - 1):
        first, last = bounds[k - 1], bounds[k + 1]
        best, place, tried = np.inf, bounds[k], -1.0
        nearest = max(first + least, math.ceil(bounds[k] - reach / CELL))
        farthest = min(last - least, math.floor(bounds[k] + reach / CELL))
        for cut in range(nearest, farthest + 1):
            num = count_points(before, first, cut)
            if num == tried:
                continue  # an empty cell before it parts the points alike, up to rounding
            tried = num
            if num < points or count_points(before, cut, last) < points:
                continue
            error = solve_all(before, first, cut) + solve_all(before, cut, last)
            if error < best:
                best, place = error, cut
        bounds[k] = place


@njit(cache=True, nogil=True, error_model='numpy')
def _crossing(left, right, near):  # type: ignore[no-untyped-def]
    """Where the two parabolas meet within a cell of ``near``; ``near`` if they do not."""
    d0, d1, d2 = right[0] - left[0], right[1] - left[1], right[2] - left[2]
    if abs(d2) > ALIKE:
        inside = d1 * d1 - 4.0 * d2 * d0
        if inside < 0.0:
            return near
        q = -0.5 * (d1 + math.copysign(math.sqrt(inside), d1))
        meet, other = (q / d2, d0 / q) if q != 0.0 else (0.0, 0.0)
        if abs(other - near) < abs(meet - near):
            meet = other
    else:
        meet = -d0 / d1 if d1 != 0.0 else near
    return meet if abs(meet - near) <= 2.0 * CELL else near
