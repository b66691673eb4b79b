# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The final fit of each span, to all its points."""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.catenary import draw_triples
from plc_inspect.core.catenary.curve import Curve, pack_curves, unpack_curve
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    COVARIANCE,
    fit_row,
    HIGH,
    is_curve,
    LOW,
    MIN_TOLERANCE,
    NUM_POINTS,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    sigma_of,
    SIN,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.catenary.growing import GAP_RATIO
from plc_inspect.core.catenary.profile import profile_own, profile_row, STEP
from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.core.spans.layout import Layout
from plc_inspect.results import Float32, Float64, Int32, Int64

MISFIT_PARTS = 20
"""
Parts of a span whose mean residuals are compared with the noise.
Source: judgement; holds from 14 to 40 on bench/constants.py.
"""
MAX_NOISE = 3.0
"""
Residuals beyond this many standard deviations are not the conductor's, or not good.
Source: derived: 0.3 % of normal errors lie beyond.
"""
MAX_POINTS = 8_000
"""Points that the fit of a span uses at most.  Source: numerical: bounds time."""
MIN_KEPT = 0.8
"""
A fit that keeps less than this share of the points of the curve before is not taken.
Source: judgement; not measured.
"""
OPEN_SLACK = 1.0
"""
An open end moves in by more than this to the last point, else not at all [m].
Source: judgement; not measured.
"""
SIGMA_OF_MAD = 1.4826
"""
Standard deviation by the median of absolute residuals.
Source: derived: 1 / 0.6745, the third quartile of the normal distribution.
"""
LEAST_FREEDOM = 3
"""Degrees of freedom, at least, from which a misfit is told.  Source: judgement; not measured."""
STRAY_RADIUS = 0.5
"""
A conductor's own points stray this far from it [m].
Source: judgement; holds up to 0.7, not down to 0.7 of it, on bench/constants.py.
"""
FREE_SHARE, FREE_CHANCE = 0.1, 1.0
"""
A place is free where at most this share of its points, and this number, are that far away.
Source: judgement; FREE_SHARE holds from 0.05 to 0.2, FREE_CHANCE not measured on
bench/constants.py.
"""
ASTRAY_DENSITY = 0.3
"""
Points a metre beyond an open end, at least, by those of the conductor before; FREE_CHANCE of them
may lack.
Source: judgement: conductors fade out at the edge of a cloud; leaves beyond an end are fewer.
"""
ASTRAY_GAP, ASTRAY_REACH = 3, 30
"""
Metres without a point there over which a conductor is followed, or GAP_RATIO times the mean
distance of its points, and how far [m].
Source: judgement; numerical: a bound of time.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CutCurve:
    """A curve, cut where its span ends."""

    curve: Curve
    low: float
    """x of its low end [m]."""
    high: float
    """x of its high end [m]."""


def pack_ends(cuts: Sequence[CutCurve]) -> Float64:
    """Return the (C, 2) x of the low and the high end of each curve [m]."""
    return np.array([(cut.low, cut.high) for cut in cuts]).reshape(-1, 2)


def fit_spans(
    points: Float64,
    index: PlanIndex,
    layout: Layout,
    settings: CatenarySettings,
    rng: np.random.Generator,
) -> list[CutCurve]:
    """
    Fit each curve to all points between its ends.

    MSAC and least squares give a first fit, and what lies about that the second.  The
    covariance is enlarged where the residuals of neighbours go together.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    layout : Layout
        The curves, and x of their ends.
    settings : CatenarySettings
        Settings of the fit.
    rng : numpy.random.Generator
        For MSAC.

    Returns
    -------
    list of CutCurve
        For each curve of the layout the final one.

    """
    num = len(layout.curves)
    if not num:
        return []
    rows = pack_curves(layout.curves)
    ends = np.stack([layout.start_x, layout.end_x], axis=1)
    is_open = np.stack([layout.start_station, layout.end_station], axis=1) < 0
    draws = draw_triples(num * settings.num_trials, rng).reshape(num, settings.num_trials, 3)
    grid = index.grid
    found = call_each(
        lambda k: _fit(
            points, grid, rows[k], ends[k], is_open[k], layout.curves[k].points, draws[k]
        ),
        num,
    )
    finals = []
    for curve, row, (chosen, stride), (low, high) in zip(
        layout.curves, rows, found, ends.tolist(), strict=True
    ):
        fresh = unpack_curve(row, chosen, stride) if stride else dataclasses.replace(
            curve, fit=dataclasses.replace(
                curve.fit, covariance=row[COVARIANCE : COVARIANCE + 9].reshape(3, 3)
            ),
        )
        finals.append(CutCurve(curve=fresh, low=low, high=high))
    return finals


def collect_points(
    points: Float64, index: PlanIndex, finals: Sequence[CutCurve], slack: float
) -> list[tuple[Int64, Float32]]:
    """
    Find the points on each curve between its ends, and their distances to it.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    finals : sequence of CutCurve
        Curves of the spans.
    slack : float
        Points may lie this far beyond the ends [m].

    Returns
    -------
    list of (chosen, distance)
        (K,) int64 ascending, (K,) float32 [m].

    """
    ends = pack_ends(finals) + np.array([-slack, slack])
    rows = pack_curves([cut.curve for cut in finals])
    grid = index.grid
    return call_each(lambda k: _collect(points, grid, rows[k], ends[k]), len(finals))


def follow_strays(
    points: Float64, index: PlanIndex, cut: CutCurve, side: int, owner: Int32,
    num_owners: int, per_metre: float,
) -> tuple[float, Int64, Float32]:
    """
    Follow a conductor beyond an open end, where drift puts its points beside its curve.

    It goes on as far as the points near the extrapolated curve are as dense as those before it,
    in the mean, and have air about them.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    cut : CutCurve
        The curve of the span.
    side : int
        1 for its high end, -1 for its low one.
    owner : (N,) int32
        The line of each point, -1 for none; points of one neither count nor are about it.
    num_owners : int
        Number of lines.
    per_metre : float
        Points of the conductor [1/m].

    Returns
    -------
    beyond : float
        How far it goes on [m], 0 for no farther.
    chosen : (K,) int64
        Points of it there, ascending.
    distance : (K,) float32
        Of them from the curve [m].

    """
    row = pack_curves([cut.curve])[0]
    row[TOLERANCE] = STRAY_RADIUS
    end = cut.high if side > 0 else cut.low
    reach = ASTRAY_REACH
    while reach and MAX_NOISE * sigma_of(row, end + side * reach) > STRAY_RADIUS:
        reach -= 1
    ends = sorted((end, end + side * reach))
    core, shell, chosen, distance = profile_own(
        points, index.grid, row, ends[0], ends[1], STEP, np.zeros(0, dtype=bool), owner,
        np.ones(num_owners, dtype=bool),
    )
    core, shell = core[::side], shell[::side]
    total = core.cumsum()
    good = (core > 0) & (shell.cumsum() <= FREE_SHARE * total + FREE_CHANCE)
    least = ASTRAY_DENSITY * per_metre * STEP * np.arange(1, len(core) + 1)
    good &= total >= least - FREE_CHANCE
    seen = np.flatnonzero(core > 0)
    longest = max(ASTRAY_GAP, GAP_RATIO / per_metre / STEP)
    seen = seen[: int(np.argmax(np.append(np.diff(seen, prepend=-1) > longest, True)))]
    last = seen[good[seen]]
    if not len(last):
        return 0.0, chosen[:0], distance[:0]
    ahead = (cut.curve.local(points[chosen])[0] - end) * side
    kept = ahead <= (last[-1] + 1) * STEP
    return float(ahead[kept].max()), chosen[kept], distance[kept]


def measure_coverage(points: Float64, index: PlanIndex, finals: Sequence[CutCurve]) -> Float64:
    """Return the (C,) share of the metres of each curve that hold points of it."""
    ends = pack_ends(finals)
    rows = pack_curves([cut.curve for cut in finals])
    grid, nothing = index.grid, np.zeros(0, dtype=bool)
    cores = call_each(
        lambda k: profile_row(points, grid, rows[k], ends[k, 0], ends[k, 1], STEP, nothing)[0],
        len(finals),
    )
    return np.array([(core > 0).mean() for core in cores])


@njit(cache=True, nogil=True, error_model='numpy')
def _collect(points, grid, row, ends):  # type: ignore[no-untyped-def]
    _, _, own, distance = profile_row(
        points, grid, row, ends[0], ends[1], STEP, np.zeros(0, dtype=np.bool_)
    )
    return own, distance


@njit(cache=True, nogil=True, error_model='numpy')
def _fit(points, grid, row, ends, is_open, own, draws):  # type: ignore[no-untyped-def]
    """Fit a row and its ends in place; returned are its points and stride, 0 if not fitted."""
    stride = 0
    vertical = np.inf
    nothing = np.zeros(0, dtype=np.bool_)
    # plan positions of the ends
    px, py = row[ORIGIN_X] + row[COS] * ends, row[ORIGIN_Y] + row[SIN] * ends
    for turn in range(2):  # what lies about the first fit are inliers of the second
        _, _, chosen, _ = profile_row(points, grid, row, ends[0], ends[1], STEP, nothing)
        fresh, kept, step, _ = fit_row(
            points, chosen, MAX_POINTS, row[TOLERANCE], min(row[TOLERANCE], vertical),
            row[AZIMUTH], draws if turn == 0 else draws[:0],
        )
        if not is_curve(fresh) or fresh[NUM_POINTS] < MIN_KEPT * row[NUM_POINTS]:
            break
        put(fresh, row)
        own, stride = kept, step
        x, residual = _residuals(points, row, own)
        # the standard deviation, whatever the tails
        noise = SIGMA_OF_MAD * np.median(np.abs(residual))
        vertical = max(MAX_NOISE * noise, MIN_TOLERANCE / 2)
        for side in range(2):
            ends[side] = to_local(row, px[side], py[side])[0]
        if is_open[0]:
            ends[0] = min(ends[0], row[LOW]) if row[LOW] < ends[0] + OPEN_SLACK else row[LOW]
        if is_open[1]:
            ends[1] = max(ends[1], row[HIGH]) if row[HIGH] > ends[1] - OPEN_SLACK else row[HIGH]
    x, residual = _residuals(points, row, own)
    misfit = _misfit(x, residual, row[LOW], row[HIGH])
    for k in range(COVARIANCE, len(row)):
        row[k] *= misfit
    return own, stride


@njit(cache=True, nogil=True, error_model='numpy')
def _residuals(points, row, own):  # type: ignore[no-untyped-def]
    """X of points along a row's curve, and how far they are above it [m]."""
    x, residual, opened = np.empty(len(own)), np.empty(len(own)), open_row(row)
    for m in range(len(own)):
        i = own[m]
        x[m], _ = see_beside(opened, points[i, 0], points[i, 1])
        residual[m], _ = see_above(opened, x[m], points[i, 2])
    return x, residual


@njit(cache=True, nogil=True, error_model='numpy')
def _misfit(x, residual, low, high):  # type: ignore[no-untyped-def]
    """
    Factor by which the scatter of the residuals' local means exceeds that of pure noise.

    Residuals of neighbours go together where poses drift or something hangs on the conductor;
    least squares alone would then be too sure of itself.  At least 1.
    """
    count, total = np.zeros(MISFIT_PARTS), np.zeros(MISFIT_PARTS)
    variance = 0.0
    for k in range(len(x)):
        place = int((x[k] - low) / max(high - low, 1e-9) * MISFIT_PARTS)
        place = min(max(place, 0), MISFIT_PARTS - 1)
        count[place] += 1.0
        total[place] += residual[k]
        variance += residual[k] * residual[k] / len(x)
    freedom, between = -3, 0.0
    for place in range(MISFIT_PARTS):
        if count[place] > 1.0:
            freedom += 1
            between += total[place] ** 2 / count[place]
    if freedom < LEAST_FREEDOM or variance <= 0.0:
        return 1.0
    return max(between / variance / freedom, 1.0)
