# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Where a conductor ends: a curve that grew on into a crown is cut back to where it was last seen.

Beyond its dead end a conductor goes on as a line on which nothing is, until foliage happens to lie
on it.  Metre by metre the likelihood of what was seen is compared, if the conductor were there,
and if not: then the metres of clear air count against it, and points on it count for it the less
the more lie about it.  The curve ends where what lies beyond speaks most against it.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, find_near, fit_curve
from plc_inspect.core.catenary.curve_row import HIGH, LOW, ROUNDING
from plc_inspect.core.evidence.free_length import CLOSE_RING, place_about, ring_about, STEP
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64

LEAST_UNSEEN = 0.3
"""
Chance that a conductor is not seen in one metre of clear air, at least; more where more of its
metres are without points.
Source: chosen on 1900 curves of 100 random scenes (bench/studies/planted_hazards.py): so 9 of 13
that went on by 2 to 12 m are cut, 55 m of 75, and 5 others by 15 points in all.
"""
UNSEEN_BEHIND = 0.5
"""
The same, at least, where more lies about it than usually on it.
Source: judgement: what lies above a conductor hides it as likely as not.
"""
LEAST_CLUTTER = 0.1
"""
Points that lie on a line by chance in one metre of clear air.
Source: judgement: so one point counts as much for a conductor as two empty metres against it.
"""
LEAST_AGAINST = 2.0
"""
Logarithm of the likelihood ratio against a conductor beyond an end, at least, to cut it there.
Source: chosen as LEAST_UNSEEN: two empty metres and no point in the clear.
"""
SIDE = 3.0
"""
Distance within which conductors run side by side, and end at one support [m].
Source: derived: as judge.SIDE.
"""
GOES_ON = 4.0
"""
A curve goes on beyond the end of one beside it by this, at least [m].
Source: judgement; ends at one tower differ by less: at 2.5 one of ahn_12AN2_20 was cut within it.
"""
LEAST_FOR = 3.0
"""
Logarithm of the likelihood ratio for a conductor beyond the end of one beside it, at least, where
half of its metres have other things about them.
Source: chosen on five real clouds and five random scenes: six of seven such stretches that are
crowns or parts of poles have less, of 60 on conductors one has.
"""
AT_POLE = 1.5
"""
Distance in plan from a pole within which a conductor ends at it [m].
Source: judgement; cross-arms of poles reach as far.
"""
MOST_CUT = 0.5
"""Share of its length that is cut from a curve at one end, at most.  Source: judgement."""


def cut_ends(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], wire: Bool, poles: Float64
) -> tuple[Curve, ...]:
    """
    Cut curves back to where their conductors, or those beside them, were last seen.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        Conductors.
    wire : (N,) bool
        Points of conductors; they do not count as what lies about a curve.
    poles : (P, 2) float64
        Where poles stand; what ends at one is not cut there [m].

    Returns
    -------
    tuple of Curve
        Parallel to those given; the same where nothing is cut.

    """
    found = call_each(
        lambda k: _weigh(points, index.grid, curves[k].row, wire), len(curves)
    )
    ends = _compare([
        _find_ends(curve.row, weight) for curve, (weight, _) in zip(curves, found, strict=True)
    ], curves, found)
    result = []
    for curve, (low, high) in zip(curves, ends, strict=True):
        x, y = curve.local(poles)
        if (np.hypot(x - curve.low, y) <= AT_POLE).any():
            low = curve.low
        if (np.hypot(x - curve.high, y) <= AT_POLE).any():
            high = curve.high
        is_same = (low, high) == (curve.low, curve.high)
        result.append(curve if is_same else _cut(points, curve, low, high))
    return tuple(result)


def _compare(
    ends: Sequence[tuple[float, float]], curves: Sequence[Curve],
    found: Sequence[tuple[Float64, Bool]],
) -> list[tuple[float, float]]:
    """
    Return the ends of curves, compared with those of curves beside them: these end at one support.

    They are no nearer than those, and where one of them ended, more must speak for what goes on
    through other things.
    """
    near = find_near(curves, SIDE)
    result = []
    for number, (curve, own) in enumerate(zip(curves, ends, strict=True)):
        beside = [
            np.sort(x) for other in near.of(number).tolist()
            for x, y in [curve.local(curves[other].position(np.array(ends[other])))]
            if np.abs(y).max() <= SIDE and x.min() < own[1] and x.max() > own[0]
        ]
        low = max(min([own[0], *(x[0] for x in beside)]), curve.low)
        high = min(max([own[1], *(x[1] for x in beside)]), curve.high)
        step = curve.length / len(found[number][0])
        weight, clutter = (value[int((low - curve.low) / step):] for value in found[number])
        num = max(round((high - low) / step), 1)
        weight, clutter = weight[:num], clutter[:num]
        shorter = [
            min((d for d in gaps if d >= GOES_ON), default=0.0) for gaps in (
                [x[0] - low for x in beside], [high - x[1] for x in beside],
            )
        ]
        for side, gap in enumerate(shorter):
            beyond = slice(0, int(gap / step)) if side == 0 else slice(num - int(gap / step), None)
            if (
                0.0 < gap <= MOST_CUT * (high - low) and clutter[beyond].mean() >= 0.5
                and weight[beyond].sum() < LEAST_FOR
            ):
                low, high = (low + gap, high) if side == 0 else (low, high - gap)
        result.append((low, high))
    return result


def _cut(points: Float64, curve: Curve, low: float, high: float) -> Curve:
    """Return a curve through the points between two x; the curve where these make none."""
    x, _ = curve.local(points[curve.points])
    kept = (x >= low - ROUNDING) & (x <= high + ROUNDING)
    try:
        return fit_curve(
            points, curve.points[kept], tolerance=curve.tolerance, azimuth=curve.azimuth
        )
    except FitError:
        return curve


@njit(cache=True, nogil=True, error_model='numpy')
def _weigh(points, grid, row, wire):  # type: ignore[no-untyped-def]
    """Return what each metre tells for a row's curve, and which have other things about it."""
    low, high = row[LOW], row[HIGH]
    num = max(int((high - low) / STEP), 1)
    distance, _, part, core = place_about(points, grid, row, wire, np.zeros(num, dtype=np.bool_))
    on, about, close = np.zeros(num), np.zeros(num), np.zeros(num)
    inner, outer = ring_about(core)
    for k in range(len(distance)):
        if distance[k] <= core:
            on[part[k]] += 1.0
        elif inner < distance[k] <= outer:
            about[part[k]] += 1.0
        if CLOSE_RING[0] * core < distance[k] <= CLOSE_RING[1] * core:
            close[part[k]] += 1.0

    # of what lies about the curve so much is expected on it, as foliage is everywhere
    share = core * core / (outer * outer - inner * inner)
    close_share = 1.0 / (CLOSE_RING[1]**2 - CLOSE_RING[0]**2)
    unseen = max(((on == 0.0).sum() + 1.0) / (num + 2.0), LEAST_UNSEEN)
    weight = np.empty(num)
    for place in range(num):
        by_chance = max(share * about[place], close_share * close[place], LEAST_CLUTTER)
        hidden = unseen
        if about[place] > on.mean():
            hidden = max(unseen, UNSEEN_BEHIND)
        nothing = math.exp(-by_chance)
        if on[place] > 0.0:
            weight[place] = math.log((1.0 - hidden * nothing) / (1.0 - nothing))
        else:
            weight[place] = min(math.log(hidden) + by_chance, 0.0)
    return weight, about > 0.0


@njit(cache=True, nogil=True, error_model='numpy')
def _find_ends(row, weight):  # type: ignore[no-untyped-def]
    """Return x between which a row's curve was seen [m]."""
    step = (row[HIGH] - row[LOW]) / len(weight)
    low, high = row[LOW] + step * _count_cut(weight), row[HIGH] - step * _count_cut(weight[::-1])
    return low, high


@njit(cache=True, nogil=True, error_model='numpy')
def _count_cut(weight):  # type: ignore[no-untyped-def]
    """Count the metres to cut from the first one on."""
    total, least, count = 0.0, -LEAST_AGAINST, 0
    for place in range(int(MOST_CUT * len(weight))):
        total += weight[place]
        if total < least:
            least, count = total, place + 1
    return count
