# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Hinges: supports that bend conductors by so little that one curve nearly fits both spans.

By chance a support stands about as high as one catenary over both its spans would pass, or the
line turns there by less than a degree.  On both sides a conductor has one curvature and is
straight in plan, and both parts meet; what strips or drift mislay does neither.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.breaks import Break, LEAST, MIN_SIDE, MIN_SIDE_POINTS, settle
from plc_inspect.core.catenary.growing import KINK_SIGMAS
from plc_inspect.core.numerics.piece_sums import add_up, CELL, solve_all
from plc_inspect.results import Float64, Int64

MIN_HINGE, HINGE_SIGMAS = 0.005, 10.0
"""
Kink of a hinge, at least, and how many of its own standard deviations it is.
Source: measured: supports that stand as high as one curve over both spans have kinks of 0.0065 to
0.013, and of 25 and more (four random scenes of 296000 to 304029).  As much is asked of a turn:
where lines turn 0.011 and 0.016, 0.0024 to 0.0029 where drift bends a span of 290 m (the flight
over two circuits of bench/accuracy.py).
"""
HINGE_SHARE, HINGE_MISFIT = 0.95, 0.01
"""
Share of what two pieces explain that a hinge explains, and what one piece misses the points by
without it (rms) [m], at least.
Source: measured: 0.98 and 0.014 to 0.024 at those supports; where strips and drift bend conductors
less than 0.9, or less than 0.006.
"""
TURN_MISFIT = 0.035
"""
What one piece misses the points by aside, as much as HINGE_MISFIT does above (rms) [m].
Source: measured: of 1389 curves within one span 98 % miss less than 0.013, all but three of one
scene less than 0.025; where lines turn by 0.011 and 0.016 rad, 0.047 and 0.062 (random scenes, any
362000:362040 and 368000:368040).
"""
CLUSTER, PARAMETERS = 3.0, 4
"""
Points of all tracks within so many metres of each other are one sample of a kink; and it takes
more of them than a parabola with a kink has parameters.
Source: derived: scan lines 1.5 m apart, of two strips by turns; three, and the kink.
"""
HINGE_STEPS = 5
"""A hinge is looked for so many steps of two cells to both sides.  Source: numerical."""


def find_hinge(
    x: Float64, y: Float64, z: Float64, track: Int64, doubt: float = 1.0
) -> Break | None:
    """
    Find where tracks side by side are all bent by a little, and are one catenary but for that.

    What one piece misses the points by above and aside is added up.

    Parameters
    ----------
    x, y, z : (N,) float64
        Along the tracks, across them and up [m]; zeros where that does not count.
    track : (N,) int64
        Which track each point is of, from 0 on.
    doubt : float
        By how much less is asked of it, where something else must tell of a support.

    Returns
    -------
    Break or None
        With the mean kink and turn of all tracks.

    """
    if len(x) < 2 * MIN_SIDE_POINTS or np.ptp(x) < 4 * MIN_SIDE:
        return None
    scale = HINGE_MISFIT / TURN_MISFIT
    low, aside = float(x.min()), y * scale
    middle, parts, growth = _part_in_two(x - low, aside, z, track)
    variance = max(parts, LEAST) / len(x)
    if growth < max(HINGE_SIGMAS**2 * variance, HINGE_MISFIT**2 * len(x)) / doubt**2:
        return None
    # two pieces that meet aslant may part a little beside the hinge
    places = low + middle + 2.0 * CELL * np.arange(-HINGE_STEPS, HINGE_STEPS + 1)
    above, beside = _fit_hinges(x, z, track, places, 2), _fit_hinges(x, aside, track, places, 1)
    best = int((above[:, 0] + beside[:, 0]).argmin())
    place = float(places[best])
    (error, rise, kink, weight), (more, swing, turn, sure) = (
        above[best].tolist(), beside[best].tolist()
    )
    if error + more - parts > (1.0 - HINGE_SHARE) * doubt * growth:
        return None
    if rise >= swing:
        is_bent = kink <= -max(MIN_HINGE, HINGE_SIGMAS * math.sqrt(variance / weight)) / doubt
    else:
        least = max(scale * MIN_HINGE, HINGE_SIGMAS * math.sqrt(variance / sure)) / doubt
        is_bent = abs(turn) >= least
        is_bent = is_bent and not _is_swung(x - place, aside, track, more)
    if not is_bent:
        return None
    return Break(x=place, kink=kink, turn=turn / scale)


@njit(cache=True, nogil=True, error_model='numpy')
def _part_in_two(x, y, z, track):  # type: ignore[no-untyped-def]
    """Return where two pieces fit tracks from 0 on best, their error, and what one adds to it."""
    before = add_up(x, y - y.mean(), z - z.mean(), track)
    last = before.shape[1] - 1
    bounds = np.array([0, last // 2, last])
    settle(before, bounds)
    parts = solve_all(before, 0, bounds[1]) + solve_all(before, bounds[1], last)
    return bounds[1] * CELL, parts, solve_all(before, 0, last) - parts


def _fit_hinges(
    x: Float64, values: Float64, track: Int64, places: Float64, degree: int
) -> Float64:
    """
    Fit tracks with a hinge at each of some places.

    Returned are (P, 4) squared errors and what the hinges gain [m2], mean bends, and their
    weights [m2].
    """
    result = np.zeros((len(places), 4))
    for number in range(int(track.max()) + 1):
        own = track == number
        if own.sum() < 2 * MIN_SIDE_POINTS:
            continue
        length = float(np.ptp(x[own])) or 1.0
        along = (x[own] - places[:, None]) / length
        level = values[own] - values[own].mean()
        columns = _lay_columns(along, degree)
        inverse = np.linalg.pinv(columns @ columns.transpose(0, 2, 1), hermitian=True)
        sums = columns @ level
        model = (inverse @ sums[:, :, None])[:, :, 0]
        fall, sure = model[:, -1] / length, length**2 / np.maximum(inverse[:, -1, -1], LEAST)
        result[:, 0] += level @ level - (model * sums).sum(axis=1)
        result[:, 1] += sure * fall**2
        result[:, 2] -= sure * fall
        result[:, 3] += sure
    result[:, 3] = np.maximum(result[:, 3], LEAST)
    result[:, 2] /= result[:, 3]
    return result


def _is_swung(x: Float64, y: Float64, track: Int64, error: float) -> bool:
    """Tell whether parabolas explain what is aside as well as hinges do, as wind swings it."""
    swung = 0.0
    for number in range(int(track.max()) + 1):
        own = track == number
        if own.sum() >= 2 * MIN_SIDE_POINTS:
            model = np.polynomial.Polynomial.fit(x[own], y[own], 2)
            swung += float(((y[own] - model(x[own])) ** 2).sum())
    return swung <= error


def _lay_columns(along: Float64, degree: int) -> Float64:
    """Return powers of (..., N) places and what adds a kink at 0, (..., degree + 2, N)."""
    return np.stack([
        *(along**power for power in range(degree + 1)), np.minimum(along, 0.0)
    ], axis=-2)


def fit_kinked(x: Float64, values: Float64) -> tuple[float, Float64, Float64]:
    """
    Fit a parabola with a kink at 0.

    Parameters
    ----------
    x, values : (N,) float64
        Along a track, and up or aside [m].

    Returns
    -------
    fall : float
        By how much the slope falls at 0.
    share : (N,) float64
        By how much that changes with each value [1/m].
    rest : (N,) float64
        Residuals [m].

    """
    length = (float(np.ptp(x)) if len(x) else 0.0) or 1.0
    columns = _lay_columns(x / length, 2).T
    inverse = np.linalg.pinv(columns)
    added = inverse @ values
    return float(added[-1]) / length, inverse[-1] / length, values - columns @ added


def keep_sure(
    x: Float64, z: Float64, track: Int64, breaks: Sequence[Break]
) -> list[Break]:
    """
    Return the breaks that are surely bent, though what is mislaid shifts all tracks alike.

    Parameters
    ----------
    x, z : (N,) float64
        Along the tracks and up [m].
    track : (N,) int64
        Which track each point is of, from 0 on.
    breaks : sequence of Break
        In order along the tracks.

    Returns
    -------
    list of Break

    """
    bounds = [-math.inf, *(item.x for item in breaks), math.inf]
    result = []
    for item, low, high in zip(breaks, bounds[:-2], bounds[2:], strict=True):
        inside = (x >= low) & (x <= high)
        kink, sigma = _measure_kink(x[inside] - item.x, z[inside], track[inside])
        if math.copysign(kink, kink * item.kink) >= KINK_SIGMAS * sigma:
            result.append(item)
    return result


def _measure_kink(x: Float64, z: Float64, track: Int64) -> tuple[float, float]:
    """
    Measure the mean kink that tracks have at 0, and its standard deviation.

    Strips that lie askew shift the points of a scan line on all tracks alike: those of a part of
    CLUSTER are one sample (standard deviations robust to clusters; Liang and Zeger, 1986).
    """
    kink = weight = 0.0
    scores = np.zeros(len(x))
    for number in range(int(track.max()) + 1):
        own = np.flatnonzero(track == number)
        if min((x[own] < 0.0).sum(), (x[own] > 0.0).sum()) < MIN_SIDE_POINTS:
            continue
        fall, share, rest = fit_kinked(x[own], z[own])
        sure = 1.0 / float(share @ share)
        kink -= sure * fall
        weight += sure
        scores[own] = sure * share * rest
    part = np.floor(x / CLUSTER).astype(np.int64)
    used, part = np.unique(part, return_inverse=True)
    if weight == 0.0 or len(used) <= PARAMETERS:
        return 0.0, math.inf
    total = np.bincount(part, scores)
    variance = float(total @ total) * len(used) / (len(used) - PARAMETERS)
    return kink / weight, math.sqrt(variance) / weight
