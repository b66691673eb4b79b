# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves that run from one conductor into the next, and the conductors that they lie over."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.duplicates import is_thick
from plc_inspect.core.clustering.clustering import ClusteringResult
from plc_inspect.core.clustering.segments import Segments
from plc_inspect.core.clustering.sharpening import (
    find_dots,
    LEAST_POINTS,
    MOST_DOTS,
    sharpen,
)
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Bool, Float64, Int32, Int64

HALF_LENGTH = 10.0
"""
Half the length of a window, at most [m].
Source: derived: spans of racks are 20 m and more; over more than one span none runs as another.
"""
LEAST_LENGTH = 12.0
"""
Least length of a curve that is looked at [m].
Source: judgement: as long as evidence is asked of a conductor that is alone.
"""
MOST_DENSE = 15.0
"""
Points a metre up to which a curve is looked at.
Source: measured: those on wires of racks that ran into the next had 3 to 11 (random scenes, any
362019, 368030 and 370039); denser ones are told apart by their windows, and are many.
"""
LEAST_SCATTER = 0.05
"""
Scatter of its points, aside and in height, from which on a curve is looked at [m].
Source: derived: with 0.15 to 0.5 of the points on a wire 0.3 m away a parabola misses them by
0.058 and more; measured: 33 that are mixed have 0.055 and more (nine random scenes, any 362019 to
373004).
"""
ASIDE, ABOVE = 0.6, 1.6
"""
Distances aside and above of the curve at which others are looked for [m].
Source: derived: two wires of a flat low-voltage line, five of a rack.
"""
COMPANY = 0.5
"""
Share of the metres of a window in which other points lie about the curve, at least.
Source: judgement: another conductor is seen along most of it.
"""
MIXED_SHARE = 0.15
"""
Share of the points of a mixed curve that lie on another dot than most of them, in one window.
Source: measured: 242 curves along one conductor have 0.08 at most (random scenes, any
360000:360030), 16 of 20 over two wires of a rack 0.16 to 0.47 (five scenes, 362019 to 370039).
"""
MOST_POINTS = 500
"""More points of a window are thinned evenly.  Source: numerical: time goes with the square."""
KNOWN_SHARE = 0.7
"""
A dot with so many of its points on another one is that one, seen from another window.
Source: derived: windows overlap by half.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Dot:
    """A conductor in one window along a curve."""

    curve: Curve
    points: Int32
    rms: float
    """Of the distances of its points from its middle, bend and direction taken out [m]."""


def find_mixed(
    points: Float64, index: PlanIndex, curves: Sequence[Curve]
) -> tuple[Bool, ClusteringResult]:
    """
    Find the curves that run from one conductor into the next.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curves : sequence of Curve
        C of them.

    Returns
    -------
    mixed : (C,) bool
        Whether each does.
    tracks : ClusteringResult
        Of the conductors about them, one segment each.

    """
    order = sorted(
        range(len(curves)), key=lambda k: (-curves[k].num_points, *curves[k].origin)
    )
    looked = call_each(lambda k: _look(points, index, curves[order[k]]), len(order))
    mixed = np.zeros(len(curves), dtype=np.bool_)
    done = np.zeros(len(points), dtype=np.bool_)
    chosen: list[_Dot] = []
    for number, (is_mixed, dots) in zip(order, looked, strict=True):
        if is_mixed:
            mixed[number] = True
            chosen += [dot for dot in dots if done[dot.points].mean() < KNOWN_SHARE]
            done[np.concatenate([dot.points for dot in dots])] = True
    return mixed, _make_tracks(points, chosen)


def _look(points: Float64, index: PlanIndex, curve: Curve) -> tuple[bool, list[_Dot]]:
    """Tell whether a curve lies over several conductors, and list these, window by window."""
    is_mixed, dots = False, []
    if not is_thick(curve) and _may_be_mixed(curve):
        for near, own, dot, across in _see_dots(points, index, curve):
            count = np.sort(np.bincount(dot[own & (dot >= 0)], minlength=2))
            is_mixed |= bool(count[-2] >= MIXED_SHARE * own.sum())
            for number in range(int(dot.max()) + 1):
                chosen = dot == number
                rms = math.sqrt(float(across[chosen].var(axis=0).sum()))
                dots.append(_Dot(curve=curve, points=np.sort(near[chosen]), rms=rms))
    return is_mixed, dots


def _may_be_mixed(curve: Curve) -> bool:
    """Tell whether a curve is long and sparse and misses its points as one over two wires."""
    return (
        curve.length >= LEAST_LENGTH and len(curve.points) <= MOST_DENSE * curve.length
        and math.hypot(curve.lateral_rmse, curve.fit.rmse) >= LEAST_SCATTER
    )


def _see_dots(
    points: Float64, index: PlanIndex, curve: Curve
) -> Iterator[tuple[Int32, Bool, Int64, Float64]]:
    """
    Yield for each window along a curve the points about it, which are its own, and their dots.

    Further yielded are (n, 2) places aside and above, direction and bend taken out [m].
    """
    half = min(HALF_LENGTH, 0.5 * curve.length)
    num = math.ceil((curve.length - 2.0 * half) / half) + 1
    for middle in np.linspace(curve.low + half, curve.high - half, num).tolist():
        first, last = curve.position(np.array([middle - half, middle + half]))[:, :2]
        near = np.sort(index.strip(first, last, ASIDE))
        x, y = curve.local(points[near])
        w, x = points[near, 2] - curve.fit.height(x), x - middle
        inside = (np.abs(x) <= half) & (np.abs(y) <= ASIDE) & (np.abs(w) <= ABOVE)
        thin = np.flatnonzero(inside)[:: inside.sum() // MOST_POINTS + 1]
        near, x, y, w = near[thin], x[thin], y[thin], w[thin]
        own = np.isin(near, curve.points, assume_unique=True)
        if min(own.sum(), (~own).sum()) < LEAST_POINTS:
            continue
        seen = np.bincount((x[~own] + half).astype(np.int64))
        if np.count_nonzero(seen) < COMPANY * 2.0 * half:
            continue
        y, w = sharpen(x, y, w, float(curve.fit.shape[2]))
        dot = find_dots(x, y, w, half)
        if 0 < dot.max() < MOST_DOTS - 1:  # or it is a wall
            yield near, own, dot, np.column_stack([y, w])


def _make_tracks(points: Float64, dots: Sequence[_Dot]) -> ClusteringResult:
    """Return tracks of one segment each."""
    num = len(dots)
    rows = np.empty((num, 8))
    for k, dot in enumerate(dots):
        x, _ = dot.curve.local(points[dot.points])
        slope = float(dot.curve.fit.slope(x.mean()))
        azimuth = dot.curve.azimuth
        rows[k, :3] = points[dot.points].mean(axis=0)
        rows[k, 3:6] = math.cos(azimuth), math.sin(azimuth), slope
        rows[k, 3:6] /= math.hypot(1.0, slope)
        rows[k, 6:] = 0.5 * np.ptp(x), dot.rms
    return ClusteringResult(
        segments=Segments(
            window=np.arange(num, dtype=np.int32),
            center=rows[:, :3],
            direction=rows[:, 3:6],
            half_length=rows[:, 6],
            rms=rows[:, 7],
            point_start=np.cumsum([0, *(len(dot.points) for dot in dots)]),
            points=np.concatenate([np.empty(0, dtype=np.int32), *(dot.points for dot in dots)]),
        ),
        track=np.arange(num, dtype=np.int32),
        num_tracks=num,
        num_clusters=num,
        eps=0.0,
        min_points=LEAST_POINTS,
    )
