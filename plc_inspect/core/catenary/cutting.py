# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves over several spans are cut: at a place, or where conductors side by side are all bent."""

from collections.abc import Sequence
from itertools import pairwise
import math

import numpy as np

from plc_inspect.core.catenary.breaks import (
    Break,
    find_breaks,
    find_hinge,
    fit_kinked,
    MIN_KINK,
    MIN_SIDE_POINTS,
)
from plc_inspect.core.catenary.curve import Curve, fit_curve
from plc_inspect.core.catenary.growing import KINK_SIGMAS
from plc_inspect.errors import FitError
from plc_inspect.results import Float64, Int64

ABOUT, LEAST_DENSITY = 10.0, 0.2
"""
A part of a curve that is cut has this share of the other one's points in the first metres that
were seen from the cut on [m], or of the whole's points a metre, at least.
Source: judgement: a conductor is seen from as near on both sides of its support; a curve that ran
over a support between the wires of a rack has a tenth of its points there.
"""
CLUSTER, PARAMETERS = 3.0, 4
"""
Points of all tracks within so many metres of each other are one sample of a kink; and it takes
more of them than a parabola with a kink has parameters.
Source: derived: scan lines 1.5 m apart, of two strips by turns; three, and the kink.
"""
LEAST_HINGED = 3
"""Conductors that show a hinge together, at least.  Source: judgement."""
PARALLEL = math.radians(5.0)
"""
Conductors side by side in one span differ by less in azimuth.
Source: judgement: those of a span of 20 m on arms that differ by 1.7 m.
"""
SHARED = 0.5
"""
They have more than this share of the shorter one's length in common.
Source: judgement; not measured.
"""


def cut_curve(points: Float64, curve: Curve, position: Float64) -> list[Curve]:
    """Return the parts of a curve on both sides of a (2,) plan position that can be fitted."""
    at, _ = curve.local_place(position)
    if not curve.low < at < curve.high:
        return [curve]
    x, _ = curve.local(points[curve.points])
    sides = [np.sort(away[away >= 0.0]) for away in (at - x, x - at)]
    near = [int((away < away[0] + ABOUT).sum()) if len(away) else 0 for away in sides]
    pieces = []
    for part, num in zip((x < at, x >= at), near, strict=True):
        try:
            piece = fit_curve(points, curve.points[part], tolerance=curve.tolerance)
        except FitError:
            continue
        share = part.mean() * curve.length / piece.length
        if num >= LEAST_DENSITY * max(near) or share >= LEAST_DENSITY:
            pieces.append(piece)
    return pieces


def measure_bend(
    points: Float64, curve: Curve, x: float, low: float = -math.inf, high: float = math.inf
) -> tuple[float, float]:
    """
    Measure the kink that a curve has at x beyond what it models.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curve : Curve
        Its points are used.
    x : float
        Where it may be bent [m].
    low, high : float
        Of its points those between these count [m].

    Returns
    -------
    bend, sigma : float
        By how much its slope falls there, and the standard deviation of that.

    """
    along, _ = curve.local(points[curve.points])
    inside = (along >= low) & (along <= high)
    along = along[inside]
    miss = points[curve.points[inside], 2] - curve.fit.height(along)
    bend, share, rest = fit_kinked(along - x, miss)
    variance = float(rest @ rest) / max(len(rest) - PARAMETERS, 1) * float(share @ share)
    return bend, math.sqrt(variance)


def cut_together(
    points: Float64, curves: Sequence[Curve], width: float, least: float
) -> list[Curve]:
    """
    Cut curves where, taken together with those that lie side by side with them, they are bent.

    Conductors of one line hang from the same supports.  Where spans are short, or returns few,
    the kink of a single one is lost in its noise.  One that grew over a support is bent itself.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Conductors.
    width : float
        They lie this near to each other [m].
    least : float
        Least length of a part [m].

    Returns
    -------
    list of Curve

    """
    parts: dict[int, list[Curve]] = {}
    rest = sorted(curves, key=lambda curve: -curve.length)
    while rest:
        first = rest[0]
        group = [first, *(other for other in rest[1:] if _lie_side_by_side(first, other, width))]
        for curve, own in zip(group, cut_each(points, group, least), strict=True):
            parts[id(curve)] = own
        rest = [curve for curve in rest if id(curve) not in parts]
    return [part for curve in curves for part in parts[id(curve)]]


def cut_each(
    points: Float64, group: Sequence[Curve], least: float = 0.0
) -> list[list[Curve]]:
    """
    Cut each curve of a group where, taken together, they are bent.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    group : sequence of Curve
        C curves side by side.
    least : float
        Least length of a part [m].

    Returns
    -------
    list of list of Curve
        The parts of each, itself alone where it is not cut.

    """
    places = _find_shared(points, group)
    return [
        _cut_at(points, curve, own, least) for curve, own in zip(group, places, strict=True)
    ]


def _lie_side_by_side(first: Curve, other: Curve, width: float) -> bool:
    if abs(math.sin(first.azimuth - other.azimuth)) > math.sin(PARALLEL):
        return False
    ends = [first.local_place(place[:2]) for place in other.position(
        np.array([other.low, other.high])
    )]
    low, high = sorted(x for x, _ in ends)
    common = min(high, first.high) - max(low, first.low)
    return common > SHARED * other.length and max(abs(y) for _, y in ends) <= width


def _find_shared(points: Float64, group: Sequence[Curve]) -> list[list[float]]:
    """List for each curve of a group where it is bent as the others are [m along it]."""
    axis = group[0]
    own = np.concatenate([curve.points for curve in group])
    track = np.repeat(np.arange(len(group)), [len(curve.points) for curve in group])
    x, z = axis.local(points[own])[0], points[own, 2]
    # of the kinks alone: where scan lines cross conductors aslant, all lie aside alike
    found = find_breaks(x, np.zeros(len(own)), z, track)
    found = tuple(item for item in found if abs(item.kink) > MIN_KINK)  # not of a misfit alone
    breaks = _keep_sure(x, z, track, found)
    if len(group) >= LEAST_HINGED:
        breaks = _add_hinges(x, z, track, breaks)
    bounds = [-math.inf, *(item.x for item in breaks), math.inf]
    result: list[list[float]] = [[] for _ in group]
    for item, low, high in zip(breaks, bounds[:-2], bounds[2:], strict=True):
        place = axis.position(item.x)[0, :2]
        at = [curve.local_place(place)[0] for curve in group]
        passing = [k for k, curve in enumerate(group) if curve.low < at[k] < curve.high]
        bent = [
            k for k in passing if _may_be_bent(
                points, group[k], at[k], item.kink, _reach(axis, group[k], item.x, low, high)
            )
        ]
        if 2 * len(bent) > len(passing):  # or it is something at one of them
            for k in bent:
                result[k].append(at[k])
    return result


def _add_hinges(
    x: Float64, z: Float64, track: Int64, breaks: Sequence[Break]
) -> list[Break]:
    """Return the breaks, and a hinge between each two of them where there is one."""
    result = list(breaks)
    for low, high in pairwise([-math.inf, *(item.x for item in breaks), math.inf]):
        inside = (x > low) & (x < high)
        found = find_hinge(x[inside], z[inside], track[inside])
        if found is not None:
            result += _keep_sure(x[inside], z[inside], track[inside], [found])
    return sorted(result, key=lambda item: item.x)


def _keep_sure(
    x: Float64, z: Float64, track: Int64, breaks: Sequence[Break]
) -> list[Break]:
    """Return the breaks that are surely bent, though what is mislaid shifts all tracks alike."""
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


def _reach(
    axis: Curve, curve: Curve, x: float, low: float, high: float
) -> tuple[float, float]:
    """Return how far two places of the axis lie from its x along a curve, least first [m]."""
    along = math.copysign(1.0, math.cos(curve.azimuth - axis.azimuth))
    first, last = sorted((along * (low - x), along * (high - x)))
    return first, last


def _may_be_bent(
    points: Float64, curve: Curve, x: float, kink: float, reach: tuple[float, float]
) -> bool:
    """Tell whether a curve is not surely bent less at x than those beside it by ``kink``."""
    bend, sigma = measure_bend(points, curve, x, x + reach[0], x + reach[1])
    share = -bend if kink > 0.0 else bend
    return share + MIN_KINK + KINK_SIGMAS * sigma >= abs(kink)


def _cut_at(
    points: Float64, curve: Curve, places: Sequence[float], least: float
) -> list[Curve]:
    parts = [curve]
    for place in curve.position(np.array(places))[:, :2] if places else ():
        parts = [
            piece for part in parts
            for piece in (
                cut_curve(points, part, place)
                if part.low + least < part.local_place(place)[0] < part.high - least else [part]
            )
        ]
    return parts
