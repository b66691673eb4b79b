# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves over several spans are cut: at a place, or where conductors side by side are all bent."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
import math

import numpy as np

from plc_inspect.core.catenary.breaks import Break, find_breaks, MIN_KINK
from plc_inspect.core.catenary.curve import Curve, fit_curve
from plc_inspect.core.catenary.growing import KINK_SIGMAS
from plc_inspect.core.catenary.hinges import find_hinge, fit_kinked, keep_sure, PARAMETERS
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64, Int64

ABOUT, LEAST_DENSITY = 10.0, 0.2
"""
A part of a curve that is cut has this share of the other one's points in the first metres that
were seen from the cut on [m], or of the whole's points a metre, at least.
Source: judgement: a conductor is seen from as near on both sides of its support; a curve that ran
over a support between the wires of a rack has a tenth of its points there.
"""
DOUBT = 2.0
"""
By how much less is asked of a hinge where something else must tell of a support.
Source: measured: of 1389 curves within one span 57 have so much (random scenes, any 362000:362040
and 368000:368040), and 12 of 31 over a support that ran over it until then.
"""
NUM_SETTLED = 3
"""Times that the place of a cut is looked for anew.  Source: numerical."""
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


def cut_turned(points: Float64, curve: Curve) -> list[Curve]:
    """
    Cut a curve where it turns in plan by so little that it grew over the support.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curve : Curve
        The curve.

    Returns
    -------
    list of Curve
        Its parts, or itself.

    """
    x, y = curve.local(points[curve.points])
    track = np.zeros(len(x), dtype=np.int64)
    found = find_hinge(x, y, np.zeros(len(x)), track)
    if found is None or not keep_sure(x, y, track, [replace(found, kink=found.turn)]):
        return [curve]
    parts = cut_curve(points, curve, curve.position(found.x)[0, :2])
    for _ in range(NUM_SETTLED):
        if len(parts) == 2:
            parts = cut_curve(points, curve, _settle_between(points, curve, *parts))
    if not parts or parts[0] is curve:  # the place is at its end
        return [curve]
    return [piece for part in parts for piece in cut_turned(points, part)]


def _settle_between(points: Float64, curve: Curve, first: Curve, last: Curve) -> Float64:
    """Return the (2,) plan position at which a curve's points go over to its other part."""
    own = points[curve.points]
    x, _ = curve.local(own)
    order = np.argsort(x)
    misses = []
    for part in (first, last):
        along, aside = part.local(own[order])
        misses.append(aside**2 + (own[order, 2] - part.fit.height(along)) ** 2)
    low, high = sorted(
        curve.local_place(part.position(part.mean_x)[0, :2])[0] for part in (first, last)
    )
    gain = np.cumsum(misses[0] - misses[1])
    inside = (x[order] > low) & (x[order] < high)
    place = x[order][np.argmin(np.where(inside, gain, np.inf))]
    return curve.position(place)[0, :2]


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
    parts = {
        id(curve): own for group in _list_side_by_side(curves, width)
        for curve, own in zip(group, cut_each(points, group, least), strict=True)
    }
    return [part for curve in curves for part in parts[id(curve)]]


def find_doubtful(
    points: Float64, curves: Sequence[Curve], width: float
) -> list[tuple[Curve, float]]:
    """
    Find where curves side by side may be bent, so that something else must tell of a support.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Conductors.
    width : float
        They lie this near to each other [m].

    Returns
    -------
    list of (Curve, float)
        The curves and the places along them [m].

    """
    result = []
    for group in _list_side_by_side(curves, width):
        axis = group[0]
        x, y, z, track = _gather(points, group)
        breaks = _find_sure(x, z, track)
        for inside in _list_between(x, breaks):
            found = find_hinge(x[inside], y[inside], z[inside], track[inside], DOUBT)
            if found is not None:
                place = axis.position(found.x)[0, :2]
                at = [curve.local_place(place)[0] for curve in group]
                result += [
                    (curve, own) for curve, own in zip(group, at, strict=True)
                    if curve.low < own < curve.high
                ]
    return result


def _list_side_by_side(curves: Sequence[Curve], width: float) -> list[list[Curve]]:
    """Group curves with those beside the longest ones."""
    groups: list[list[Curve]] = []
    rest = sorted(curves, key=lambda curve: -curve.length)
    while rest:
        first = rest[0]
        beside = [other for other in rest[1:] if _lie_side_by_side(first, other, width)]
        groups.append([first, *beside])
        known = set(map(id, groups[-1]))
        rest = [curve for curve in rest if id(curve) not in known]
    return groups


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
    x, _, z, track = _gather(points, group)
    breaks = _add_hinges(x, z, track, _find_sure(x, z, track))
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


def _gather(
    points: Float64, group: Sequence[Curve]
) -> tuple[Float64, Float64, Float64, Int64]:
    """Gather the points of a group along its first curve, across it and up, and their curve."""
    own = np.concatenate([curve.points for curve in group])
    track = np.repeat(np.arange(len(group)), [len(curve.points) for curve in group])
    return *group[0].local(points[own]), points[own, 2], track


def _find_sure(x: Float64, z: Float64, track: Int64) -> list[Break]:
    """Find where the tracks are surely bent."""
    # of the kinks alone: where scan lines cross conductors aslant, all lie aside alike
    found = find_breaks(x, np.zeros(len(x)), z, track)
    found = tuple(item for item in found if abs(item.kink) > MIN_KINK)  # not of a misfit alone
    return keep_sure(x, z, track, found)


def _list_between(x: Float64, breaks: Sequence[Break]) -> list[Bool]:
    """Return (N,) which points lie between each two breaks."""
    bounds = pairwise([-math.inf, *(item.x for item in breaks), math.inf])
    return [(x > low) & (x < high) for low, high in bounds]


def _add_hinges(
    x: Float64, z: Float64, track: Int64, breaks: Sequence[Break]
) -> list[Break]:
    """Return the breaks, and a hinge between each two of them where there is one."""
    result = list(breaks)
    for inside in _list_between(x, breaks):
        found = find_hinge(x[inside], np.zeros(inside.sum()), z[inside], track[inside])
        if found is not None:
            result += keep_sure(x[inside], z[inside], track[inside], [found])
    return sorted(result, key=lambda item: item.x)


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
