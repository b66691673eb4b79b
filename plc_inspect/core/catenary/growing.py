# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Collection of the points along a curve, and its extension as far as they go."""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
import math
from typing import Any

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.breaks import MIN_KINK
from plc_inspect.core.catenary.curve import (
    Curve,
    find_far_apart,
    MAX_POINTS,
    pack_curves,
    unpack_curve,
)
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    CURVATURE,
    fit_row,
    height_of,
    HIGH,
    is_curve,
    LOW,
    MIDDLE,
    NUM_POINTS,
    ORIGIN_X,
    ORIGIN_Y,
    ROUNDING,
    sigma_of,
    SIN,
    SLOPE,
    slope_of,
    slope_variance_of,
    to_local,
    TOLERANCE,
    TURN_SIGMA,
)
from plc_inspect.core.clustering.segment_fit import SHELL_RATIO, SHELL_SHARE
from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.sorting import argsort_spread
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64

CROWD_LENGTH = 4.0
"""Length of the parts of a curve that are crowded or not [m].  Source: judgement; not measured."""
FOLLOW_SHARE = 0.6
"""
A conductor is followed where the shell holds at most this share of the points on it.
Source: judgement; not measured.
"""
COMPANY_RADIUS = 0.8
"""Distance at which other things keep a curve company [m].  Source: judgement; not measured."""
MAX_ROUNDS = 8
"""Times that a curve grows at its ends, at most.  Source: numerical: a bound of time."""
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
LEAST_GROWTH = 1.0
"""A curve that grew by less is done [m].  Source: derived: one bin."""
BESIDE_SHARE = 0.5
"""
Curves with more of the shorter one beside the other do not go on in each other.
Source: judgement; not measured.
"""
GAP_MISS = 0.15
"""
Miss that is allowed between two parts of one conductor, beyond three times its uncertainty [m].
Source: judgement; not measured: as in `conductors.BRIDGE_SLACK`.
"""
STEP = 1.0
"""Length of a bin [m].  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """What lies on a curve and close about it, metre by metre."""

    low: float
    """x of the first bin's lower edge [m]."""
    step: float
    """Length of a bin [m]."""
    core: Int64
    """(B,) points on the curve in each bin."""
    shell: Int64
    """(B,) points close about the curve, but not on it."""
    chosen: Int64
    """Indices of the points on the curve, ascending."""

    @property
    def coverage(self) -> float:
        """Share of the bins that hold points of the curve."""
        return float((self.core > 0).mean()) if len(self.core) else 0.0

    @property
    def crowding(self) -> float:
        """Share of the curve, in parts of CROWD_LENGTH, that has points close about it."""
        parts = max(round(CROWD_LENGTH / self.step), 1)
        starts = np.arange(0, len(self.core), parts)
        core = np.add.reduceat(self.core, starts)
        shell = np.add.reduceat(self.shell, starts)
        filled = (core > 0) | (shell > 0)
        if not filled.any():
            return 1.0
        return float((shell > SHELL_SHARE * core + 1.0)[filled].mean())


def profile_curve(
    points: Float64,
    index: PlanIndex,
    curve: Curve,
    low: float,
    high: float,
    *,
    step: float = STEP,
    ignore: Bool | None = None,
) -> Profile:
    """
    Count the points on a curve and close about it between two x.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curve : Curve
        Used also beyond its own ends.
    low, high : float
        X of the ends [m].
    step : float
        Length of a bin [m].
    ignore : (N,) bool
        Points that do not count as close about the curve, such as other wires.

    Returns
    -------
    Profile

    """
    if ignore is None:
        ignore = np.zeros(0, dtype=bool)
    core, shell, chosen, _ = profile_row(
        points, index.grid, curve.row, low, high, step, ignore
    )
    return Profile(low=low, step=step, core=core, shell=shell, chosen=chosen)  # nosec B604


def measure_distances(points: Float64, curve: Curve, chosen: Int64) -> Float32:
    """
    Return the distances of points near a curve to it.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curve : Curve
        Used also beyond its own ends.
    chosen : (K,) int64
        Indices of the points.

    Returns
    -------
    (K,) float32 [m]

    """
    result: Float32 = distances_to(points, curve.row, chosen)
    return result


def measure_company(
    points: Float64, index: PlanIndex, curve: Curve, profile: Profile, wire: Bool
) -> float:
    """
    Return the share of a curve, in parts, that has other things close beside it.

    A part counts where more points lie within ``COMPANY_RADIUS`` than on the curve itself, other
    wires left out.  Roofs, walls and the arcs that scan lines draw on them have company all
    along; a conductor has it only where it passes a crown.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curve : Curve
        The curve.
    profile : Profile
        Of the curve between its ends.
    wire : (N,) bool
        Points of this and other curves.

    """
    radius = max(COMPANY_RADIUS, 2 * curve.tolerance)
    around = profile_curve(
        points, index, dataclasses.replace(curve, tolerance=radius), curve.low, curve.high
    ).chosen
    others = around[~wire[around]]
    x, _ = curve.local(points[others])
    parts = max(round(CROWD_LENGTH / profile.step), 1)
    num = math.ceil(len(profile.core) / parts)
    place = np.clip(((x - profile.low) / CROWD_LENGTH).astype(np.int64), 0, num - 1)
    beside = np.bincount(place, minlength=num)
    on = np.add.reduceat(profile.core, np.arange(0, len(profile.core), parts))
    return float((beside > on).mean())


def extend(
    points: Float64, index: PlanIndex, curves: Sequence[Curve], settings: CatenarySettings,
    others: Sequence[Curve] = (),
) -> list[Curve]:
    """
    Let curves take in the points along them, within their ends and beyond, as far as they go.

    Each round extrapolates no farther than the fit is sure of, and stops for good where the next
    ``max_step`` metres hold no points of a free wire.  Points of a curve that begins with a kink
    or an offset where this one ends are left to it: it is the next span, or another conductor's.

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
    owner = _claim(points, grid, rows, settings.min_evidence)
    barred = _bar(rows, find_far_apart(known, settings.max_bridge))
    grown = call_each(
        lambda k: _extend(points, grid, rows[k], owner, barred[k], settings.max_step),
        len(curves),
    )
    return [
        unpack_curve(row, chosen, step) if step else curve
        for curve, row, (chosen, step) in zip(curves, rows[: len(curves)], grown, strict=True)
    ]


@njit(cache=True, nogil=True, error_model='numpy')
def distances_to(points, row, chosen):  # type: ignore[no-untyped-def]
    """Distances of some of the points to a row's curve near to them [m]."""
    result = np.empty(len(chosen), dtype=np.float32)
    for k in range(len(chosen)):
        i = chosen[k]
        x, y = to_local(row, points[i, 0], points[i, 1])
        above = (points[i, 2] - height_of(row, x)) / math.hypot(1.0, slope_of(row, x))
        result[k] = math.hypot(y, above)
    return result


def _claim(points: Float64, grid: Any, rows: Float64, least: float) -> Int32:
    """Return the curve of at least some length that each point lies on, -1 for none."""
    long = np.flatnonzero(rows[:, HIGH] - rows[:, LOW] >= least).tolist()
    nothing = np.zeros(0, dtype=np.bool_)
    profiles = call_each(
        lambda k: profile_row(
            points, grid, rows[long[k]], rows[long[k], LOW], rows[long[k], HIGH], STEP, nothing
        ),
        len(long),
    )
    owner = np.full(len(points), -1, dtype=np.int32)
    nearest = np.full(len(points), np.inf, dtype=np.float32)
    for number, (_, _, chosen, distance) in zip(long, profiles, strict=True):
        won = chosen[distance < nearest[chosen]]
        owner[won] = number
        nearest[chosen] = np.minimum(nearest[chosen], distance)
    return owner


@njit(cache=True, nogil=True, error_model='numpy')
def _bar(rows, far):  # type: ignore[no-untyped-def]
    """Tell which curves (column) no curve (row) goes on in: (C, C) bool."""
    num = len(rows)
    barred = np.zeros((num, num), dtype=np.bool_)
    for k in range(num):
        for m in range(k):
            if not far[k, m] and not _may_be_one(rows[k], rows[m]):
                barred[k, m] = barred[m, k] = True
    return barred


@njit(cache=True, nogil=True, error_model='numpy')
def _may_be_one(row, other):  # type: ignore[no-untyped-def]
    """Tell whether two curves lie beside each other, or meet without an offset or a kink."""
    # where the other one begins and ends along this one
    first, _ = to_local(row, *_plan_of(other, other[LOW]))
    last, _ = to_local(row, *_plan_of(other, other[HIGH]))
    start, end = max(row[LOW], min(first, last)), min(row[HIGH], max(first, last))
    shorter = min(row[HIGH] - row[LOW], other[HIGH] - other[LOW])
    if end - start > BESIDE_SHARE * shorter:
        return True
    # both curves in the middle of the gap, or of what they have in common
    x = 0.5 * (start + end)
    px, py = _plan_of(row, x)
    other_x, across = to_local(other, px, py)
    miss = math.hypot(across, height_of(row, x) - height_of(other, other_x))
    sigma = math.hypot(sigma_of(row, x), sigma_of(other, other_x))
    if miss > GAP_MISS + 3.0 * sigma:
        return False
    along = math.copysign(1.0, row[COS] * other[COS] + row[SIN] * other[SIN])
    turn = abs(math.asin(row[COS] * other[SIN] - row[SIN] * other[COS]))
    if turn > MIN_KINK + 4.0 * math.hypot(row[TURN_SIGMA], other[TURN_SIGMA]):
        return False
    kink = abs(slope_of(row, x) - along * slope_of(other, other_x))
    sigma = math.sqrt(slope_variance_of(row, x) + slope_variance_of(other, other_x))
    return kink <= MIN_KINK + 4.0 * sigma


@njit(cache=True, nogil=True, error_model='numpy')
def _plan_of(row, x):  # type: ignore[no-untyped-def]
    """Plan position of a row's curve at x [m]."""
    return row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x


@njit(cache=True, nogil=True, error_model='numpy')
def _extend(points, grid, row, owner, barred, max_step):  # type: ignore[no-untyped-def]
    """Extend a row in place; returned are its points and their stride, 0 if it is the same."""
    own, stride = np.empty(0, dtype=np.int64), 0
    nothing, no_draws = np.zeros(0, dtype=np.bool_), np.empty((0, 3))
    allowed = math.ceil(max_step / STEP)
    for _ in range(MAX_ROUNDS):
        # bins along the curve and as far beyond as it is known
        reach = _sure_reach(row, max_step)
        first = row[LOW] - reach
        core, shell, chosen, _ = _profile(
            points, grid, row, first, row[HIGH] + reach, STEP, nothing, owner, barred
        )
        # from both ends over good bins, and over short gaps
        good = (core > 0) & (shell <= FOLLOW_SHARE * core)
        own_low = int(reach / STEP)
        own_high = int((row[HIGH] - first) / STEP)
        before = _walk(good[: own_low + 1][::-1], allowed)
        beyond = _walk(good[min(own_high, len(good) - 1) :], allowed)
        low = first + (own_low - before) * STEP
        high = first + (own_high + beyond + 1) * STEP
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
        if grown[NUM_POINTS] < LEAST_KEPT * row[NUM_POINTS] or length < LEAST_KEPT * was:
            break
        put(grown, row)
        own, stride = kept, step
        if length < was + LEAST_GROWTH:
            break
    return own, stride


@njit(cache=True, nogil=True, error_model='numpy')
def _sure_reach(row, longest):  # type: ignore[no-untyped-def]
    """How far beyond both ends the curve is known to its tolerance, at most ``longest``."""
    for part in range(NUM_REACHES - 1, 0, -1):
        reach = longest * part / (NUM_REACHES - 1)
        sigma = max(sigma_of(row, row[HIGH] + reach), sigma_of(row, row[LOW] - reach))
        if 3.0 * sigma <= row[TOLERANCE]:
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


@njit(cache=True, nogil=True, error_model='numpy')
def profile_row(points, grid, row, low, high, step, ignore):  # type: ignore[no-untyped-def]
    """
    Count the points on the curve, and those close about it, in each bin.

    Further returned are those on it, ascending, and their distances to it.
    """
    nobody, none = np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.bool_)
    return _profile(points, grid, row, low, high, step, ignore, nobody, none)


@njit(cache=True, nogil=True, error_model='numpy')
def _profile(  # type: ignore[no-untyped-def]
    points, grid, row, low, high, step, ignore, owner, barred
):
    """Do the same without the points of barred owners."""
    tolerance = row[TOLERANCE]
    most = tolerance * SHELL_RATIO
    start, order, corner, cell, num_rows, num_columns = grid
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, most,
    )
    # the curve in each bin, as a polynomial
    num = max(math.ceil((high - low) / step), 1)
    course = _sample_course(row, low, step, num)
    core = np.zeros(num, dtype=np.int64)
    shell = np.zeros(num, dtype=np.int64)
    chosen = np.empty(len(near), dtype=np.int64)
    distance = np.empty(len(near), dtype=np.float32)
    outer, by_step = most * most, 1.0 / step
    found = 0
    ordered = True
    for i in near:
        x, y = to_local(row, points[i, 0], points[i, 1])
        if abs(y) > most or (len(owner) and owner[i] >= 0 and barred[owner[i]]):
            continue
        place = math.floor((x - low + ROUNDING) * by_step)
        if place < 0 or place >= num:
            continue
        # distance to the curve, squared
        d = x - low - (place + 0.5) * step
        at = course[place]
        dz = points[i, 2] - (at[0] + d * (at[1] + d * (at[2] + d * at[3])))
        dz /= at[4] + d * (at[5] + d * at[6])
        r2 = y * y + dz * dz
        if r2 <= tolerance * tolerance:
            core[place] += 1
            ordered = ordered and (found == 0 or i > chosen[found - 1])
            chosen[found], distance[found] = i, math.sqrt(r2)
            found += 1
        elif r2 <= outer and not (len(ignore) and ignore[i]):
            shell[place] += 1
    chosen, distance = chosen[:found].copy(), distance[:found].copy()
    if not ordered:  # the strip comes cell by cell
        ascending = argsort_spread(chosen)
        chosen, distance = chosen[ascending], distance[ascending]
    return core, shell, chosen, distance


@njit(cache=True, nogil=True, error_model='numpy')
def _sample_course(row, low, step, num):  # type: ignore[no-untyped-def]
    """
    Taylor series of a curve about the middle of each bin.

    Returned are (num, 7) coefficients: four of the height [m], and three of what a vertical
    distance is to be divided by to be perpendicular, the hyperbolic cosine.  Over half a metre
    they are exact to 3 um even for a constant of 10 m.
    """
    result = np.empty((num, 7))
    k, base = row[CURVATURE], math.asinh(row[SLOPE])
    for place in range(num):
        x = low + (place + 0.5) * step
        u = k * (x - row[MIDDLE]) + base
        sinh, cosh = math.sinh(u), math.cosh(u)
        result[place, 0], result[place, 1] = height_of(row, x), sinh
        result[place, 2], result[place, 3] = k * cosh / 2.0, k * k * sinh / 6.0
        result[place, 4], result[place, 5], result[place, 6] = cosh, k * sinh, k * k * cosh / 2.0
    return result
