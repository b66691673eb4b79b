# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Growth of curves: they take in the points along them and go on beyond, as far as those go."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.breaks import locate_breaks, MIN_KINK
from plc_inspect.core.catenary.curve import (
    Curve,
    find_near,
    MAX_POINTS,
    pack_curves,
    PART_MISS,
    unpack_curve,
)
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    fit_row,
    height_of,
    HIGH,
    is_curve,
    LATERAL_RMSE,
    LOW,
    NUM_POINTS,
    open_row,
    plan_of,
    RMSE,
    ROUNDING,
    see_above,
    see_beside,
    sigma_of,
    SIN,
    slope_of,
    slope_variance_of,
    to_local,
    TOLERANCE,
    TURN_SIGMA,
)
from plc_inspect.core.catenary.profile import profile_own, profile_row, STEP
from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Float64, Int32, Int64

FOLLOW_SHARE = 0.6
"""
A conductor is followed where the shell holds at most this share of the points on it.
Source: judgement; not measured.
"""
OWNER_LENGTH = 12.0
"""
Curves of this length and more own the points on them [m].
Source: judgement: as long as evidence is asked of a conductor that is alone.
"""
SURE_SIGMAS, KINK_SIGMAS = 3.0, 4.0
"""
Standard deviations by which curves may be off, and by which a kink or turn is more than MIN_KINK.
Source: derived: 0.3 % of normal errors lie beyond three; that of the kinks of `breaks`.
"""
CENTRE_RATIO, BEND = 1.0, 0.01
"""
The mean of a bin's points lies off the curve by at most so many times their scatter, and three
standard deviations of the mean, of the extrapolated curve and of what bends the map [m] more.
Source: judgement: strips of a survey lie off each other by as much as they scatter together; the
bend is that of `span_model.MAP_SIGMA`.
"""
LEAST_NOISE = 0.015
"""Scatter of the points of a conductor, at least [m].  Source: ranges of the best scanners."""
FEW_ROUNDS, MAX_ROUNDS = 8, 64
"""
Times that a curve grows at its ends, at most: one shorter than OWNER_LENGTH, and any other.
Source: judgement: a short piece of something else does not become a line; numerical: a conductor
grows by ``max_step`` a time, so that a span of 500 m is reached from its middle or an end.
"""
NUM_REACHES = 13
"""
Reaches beyond an end that are tried, from none to ``max_step``.
Source: numerical: a bound of time.
"""
LEAST_KEPT = 0.9
"""
A curve that holds a smaller share of its points, or of its length, than before has not grown.
Source: judgement; not measured.
"""
MOST_BACK = 0.15
"""
An end is walked back by at most this share of the curve's length.
Source: judgement: 3 m of a service span of 20 m.
"""
GAP_RATIO = 6.0
"""
What is seen in few places is followed over gaps of so many times the mean distance of these.
Source: derived: of 100 gaps between places that lie at random the longest is 5.0 times the mean in
the median, ln(100 / ln 2), and at most 6 times in 78 % of cases, exp(-100 exp(-6)).
"""
SUPPORT_KINK = 0.1
"""
A curve whose slope falls by so much where it grew, as at a support, has not grown [-].
Source: measured: on random scenes from -0.08 to 0.16 where parts of one conductor are mislaid, and
-0.25 to -0.31 where conductors of a rack grew into others of the next span.
"""
LEAST_GROWTH = 1.0
"""A curve that grew by less is done [m].  Source: derived: one bin."""
BESIDE_SHARE = 0.5
"""
Curves with more of the shorter one beside the other do not go on in each other: neither is barred.
Source: judgement; not measured.
"""


def extend(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], settings: CatenarySettings,
    others: Sequence[Curve] = (), *, apart: bool = False,
) -> list[Curve]:
    """
    Let curves take in the points along them, within their ends and beyond, as far as they go.

    Each round extrapolates no farther than the fit is sure of, and stops for good where the next
    ``max_step`` metres hold no points of a free wire; more of them where it is seen in few
    places.  Points of a curve that begins with a kink or an offset where this one ends are left to
    it: it is the next span, or another conductor's.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        Each is extended by itself.
    settings : CatenarySettings
        Settings of this stage.
    others : sequence of Curve
        Further curves, whose points are left to them likewise.
    apart : bool
        Whether curves beside each other are known to be different conductors, unless they lie on
        each other: then each leaves to the others what is nearer to them.

    Returns
    -------
    list of Curve
        Parallel to those given; the same where nothing more was found.

    """
    if not curves:
        return []
    known = [*curves, *others]
    rows = pack_curves(known)
    grid = index.grid
    near = find_near(curves, settings.max_bridge, known)
    barred = call_each(lambda k: _bar(rows, k, near.of(k), apart), len(curves))
    owner = _claim(points, index, rows, np.unique(np.concatenate(barred)))
    grown = call_each(
        lambda k: _extend(
            points, grid, rows[k], len(rows), owner, barred[k], settings.max_step
        ),
        len(curves),
    )
    return [
        unpack_curve(row, chosen, step) if step else curve
        for curve, row, (chosen, step) in zip(curves, rows[: len(curves)], grown, strict=True)
    ]


def _claim(points: Float64, index: PlanIndex, rows: Float64, wanted: Int64) -> Int32:
    """Return the nearest of some curves that each point lies on, -1 for none."""
    numbers = wanted.tolist()
    nothing = np.zeros(0, dtype=np.bool_)
    profiles = call_each(
        lambda k: profile_row(
            points, index.grid, rows[numbers[k]], rows[numbers[k], LOW], rows[numbers[k], HIGH],
            STEP, nothing,
        ),
        len(numbers),
    )
    owner = np.full(len(points), -1, dtype=np.int32)
    nearest = np.full(len(points), np.inf, dtype=np.float32)
    for number, (_, _, chosen, distance) in zip(numbers, profiles, strict=True):
        won = chosen[distance < nearest[chosen]]
        owner[won] = number
        nearest[chosen] = np.minimum(nearest[chosen], distance)
    return owner


@njit(cache=True, nogil=True, error_model='numpy')
def _bar(rows, number, near, apart):  # type: ignore[no-untyped-def]
    """Return the owners near a curve, by its number, that it does not go on in."""
    barred = np.zeros(len(near), dtype=np.bool_)
    for place in range(len(near)):
        other = near[place]
        if other == number or rows[other, HIGH] - rows[other, LOW] < OWNER_LENGTH:
            continue
        # the same for both of a pair
        one, two = max(number, other), min(number, other)
        barred[place] = not _may_be_one(rows[one], rows[two], apart)
    return near[barred]


@njit(cache=True, nogil=True, error_model='numpy')
def _may_be_one(row, other, apart):  # type: ignore[no-untyped-def]
    """
    Tell whether two curves lie beside each other, or meet without an offset or a kink.

    Those beside each other are looked at likewise where they are known to be ``apart``.
    """
    # where the other one begins and ends along this one
    first, _ = to_local(row, *plan_of(other, other[LOW]))
    last, _ = to_local(row, *plan_of(other, other[HIGH]))
    start, end = max(row[LOW], min(first, last)), min(row[HIGH], max(first, last))
    shorter = min(row[HIGH] - row[LOW], other[HIGH] - other[LOW])
    if end - start > BESIDE_SHARE * shorter and not apart:
        return True
    # both curves in the middle of the gap, or of what they have in common
    x = 0.5 * (start + end)
    px, py = plan_of(row, x)
    other_x, across = to_local(other, px, py)
    miss = math.hypot(across, height_of(row, x) - height_of(other, other_x))
    sigma = math.hypot(sigma_of(row, x), sigma_of(other, other_x))
    if miss > PART_MISS + SURE_SIGMAS * sigma:
        return False
    along = math.copysign(1.0, row[COS] * other[COS] + row[SIN] * other[SIN])
    sine = row[COS] * other[SIN] - row[SIN] * other[COS]
    turn = abs(math.asin(min(max(sine, -1.0), 1.0)))
    if turn > MIN_KINK + KINK_SIGMAS * math.hypot(row[TURN_SIGMA], other[TURN_SIGMA]):
        return False
    kink = abs(slope_of(row, x) - along * slope_of(other, other_x))
    sigma = math.sqrt(slope_variance_of(row, x) + slope_variance_of(other, other_x))
    return kink <= MIN_KINK + KINK_SIGMAS * sigma


@njit(cache=True, nogil=True, error_model='numpy')
def _extend(  # type: ignore[no-untyped-def]
    points, grid, row, num_curves, owner, barred, max_step
):
    """Extend a row in place; returned are its points and their stride, 0 if it is the same."""
    own, stride = np.empty(0, dtype=np.int64), 0
    nothing, no_draws = np.zeros(0, dtype=np.bool_), np.empty((0, 3))
    is_barred = np.zeros(num_curves, dtype=np.bool_)
    is_barred[barred] = True
    longest = max_step
    for number in range(MAX_ROUNDS if row[HIGH] - row[LOW] >= OWNER_LENGTH else FEW_ROUNDS):
        # bins along the curve and as far beyond as it is known
        allowed, reach = math.ceil(longest / STEP), _sure_reach(row, longest)
        first = row[LOW] - reach
        core, shell, chosen, _ = profile_own(
            points, grid, row, first, row[HIGH] + reach, STEP, nothing, owner, is_barred
        )
        # back from both ends over bins that lie beside the curve, then on over good ones, and
        # over short gaps
        centred = _find_centred(points, row, chosen, first, len(core))
        good = centred & (core > 0) & (shell <= FOLLOW_SHARE * core)
        own_low = int(reach / STEP)
        own_high = min(int((row[HIGH] - first) / STEP), len(good) - 1)
        num_own = own_high - own_low + 1
        seen = max((core[own_low : own_high + 1] > 0).sum(), 1)
        followed, longest = longest, max(max_step, GAP_RATIO * STEP * num_own / seen)
        most = int(MOST_BACK * num_own)
        before = _walk_back(core[own_low:], centred[own_low:], most)
        beyond = _walk_back(core[: own_high + 1][::-1], centred[: own_high + 1][::-1], most)
        # how far points may lie beside it, it tells once it is fitted to all along it
        waits = number == 0 and before + beyond > 0
        if waits:
            before = beyond = 0
        own_low, own_high = own_low + before, own_high - beyond
        left = (num_own - before - beyond) / num_own
        low = first + (own_low - _walk(good[: own_low + 1][::-1], allowed)) * STEP
        high = first + (own_high + _walk(good[own_high:], allowed) + 1) * STEP
        # fit it anew to all points between
        num = 0
        for i in chosen:
            x, _ = to_local(row, points[i, 0], points[i, 1])
            if low - ROUNDING <= x <= high + ROUNDING:
                chosen[num] = i
                num += 1
        grown, kept, step, _ = fit_row(
            points, chosen[:num], MAX_POINTS, row[TOLERANCE], row[TOLERANCE], row[AZIMUTH],
            no_draws,
        )
        if not is_curve(grown):
            break
        length, was = grown[HIGH] - grown[LOW], row[HIGH] - row[LOW]
        least = LEAST_KEPT * left
        if grown[NUM_POINTS] < least * row[NUM_POINTS] or length < least * was:
            break
        if length >= was + LEAST_GROWTH and _is_broken(points, chosen[:num], row):
            break
        put(grown, row)
        own, stride = kept, step
        if not waits and length < was + LEAST_GROWTH and longest <= followed + STEP:
            break
    return own, stride


@njit(cache=True, nogil=True, error_model='numpy')
def _is_broken(points, chosen, row):  # type: ignore[no-untyped-def]
    """Tell whether a row's curve has grown beyond a support, to points of the next span."""
    x, y, z = np.empty(len(chosen)), np.empty(len(chosen)), np.empty(len(chosen))
    for k in range(len(chosen)):
        x[k], y[k] = to_local(row, points[chosen[k], 0], points[chosen[k], 1])
        z[k] = points[chosen[k], 2]
    breaks = locate_breaks(x, y, z, np.zeros(len(chosen), dtype=np.int64))
    for k in range(len(breaks)):
        place, kink = breaks[k, 0], breaks[k, 1]
        if kink <= -SUPPORT_KINK and not row[LOW] <= place <= row[HIGH]:
            return True
    return False


@njit(cache=True, nogil=True, error_model='numpy')
def _find_centred(points, row, chosen, low, num):  # type: ignore[no-untyped-def]
    """
    Tell the bins from ``low`` on whose points lie about the curve, and not to one side of it.

    What crosses the curve, or leaves it, is on one side of it from bin to bin.
    """
    count, aside, above = np.zeros(num), np.zeros(num), np.zeros(num)
    opened = open_row(row)
    for i in chosen:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        rise, _ = see_above(opened, x, points[i, 2])
        place = min(max(int((x - low + ROUNDING) / STEP), 0), num - 1)
        count[place] += 1.0
        aside[place] += y
        above[place] += rise
    result = np.ones(num, dtype=np.bool_)
    for place in range(num):
        if count[place] == 0.0:
            continue
        chance = CENTRE_RATIO + SURE_SIGMAS / math.sqrt(count[place])
        x = low + (place + 0.5) * STEP
        spread = BEND
        if not row[LOW] <= x <= row[HIGH]:
            spread = math.hypot(BEND, sigma_of(row, x))
        result[place] = (
            abs(aside[place]) / count[place]
            <= chance * max(row[LATERAL_RMSE], LEAST_NOISE) + SURE_SIGMAS * spread
        ) and (
            abs(above[place]) / count[place]
            <= chance * max(row[RMSE], LEAST_NOISE) + SURE_SIGMAS * spread
        )
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _walk_back(core, centred, most):  # type: ignore[no-untyped-def]
    """
    Count the bins from the first one on that are beside the curve, or empty before such.

    Where they are more than ``most`` the curve is wrong, and not its end: then none.
    """
    last = 0
    for step in range(len(core)):
        if core[step] == 0:
            continue
        if centred[step]:
            break
        last = step + 1
        if last > most:
            return 0
    return last


@njit(cache=True, nogil=True, error_model='numpy')
def _sure_reach(row, longest):  # type: ignore[no-untyped-def]
    """How far beyond both ends the curve is known to its tolerance, at most ``longest``."""
    for part in range(NUM_REACHES - 1, 0, -1):
        reach = longest * part / (NUM_REACHES - 1)
        sigma = max(sigma_of(row, row[HIGH] + reach), sigma_of(row, row[LOW] - reach))
        if SURE_SIGMAS * sigma <= row[TOLERANCE]:
            return reach
    return 0.0


@njit(cache=True, nogil=True, error_model='numpy')
def _walk(good, allowed):  # type: ignore[no-untyped-def]
    """Count the steps to the last good bin reached over at most ``allowed`` bad in a row."""
    last = bad = 0
    for step in range(len(good)):
        if good[step]:
            last, bad = step, 0
        else:
            bad += 1
            if bad > allowed:
                break
    return last
