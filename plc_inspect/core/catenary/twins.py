# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Twins: conductors side by side that clustering took for one."""

from collections.abc import Sequence
import math

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, fit_curve
from plc_inspect.core.catenary.duplicates import drop_duplicates, is_thick
from plc_inspect.errors import FitError
from plc_inspect.results import Float64, Int64

DIP, DIP_SIGMAS = 0.5, 3.0
"""
Between two conductors the points are at most this share of those on either, and this many
standard deviations fewer.
Source: judgement; 0.18 of them for normal points 4.4 deviations apart; chance makes 0.1 % of dips.
"""
LEAST_APART = 0.2
"""
Two conductors hang at least this far apart [m].
Source: judgement: spacers of low voltage are 0.3 m and more; strips of a survey may lie 0.15 m
beside each other.
"""
CELL = 0.03
"""
Points are counted across in cells of this width, three at a time [m].
Source: derived: three of them are half of LEAST_APART.
"""
LEAST_SHARE = 0.1
"""Share of the points on each of them, at least.  Source: judgement."""
STRETCH = 3.0
"""All of them are looked for in every stretch of this length [m].  Source: judgement."""
SEEN_SHARE = 0.8
"""Share of the stretches that show all of them, at least.  Source: judgement."""
LEAST_POINTS = 2
"""Points of each in a stretch that shows it, at least.  Source: judgement."""


def part_twins(
    points: Float64, curves: Sequence[Curve], settings: CatenarySettings
) -> tuple[Curve, ...]:
    """
    Put a curve for each conductor in the place of one that lies over several.

    Conductors of low voltage hang 0.3 m apart, in reach of one another for clustering.  Where
    the points about a thick curve fall into groups all along it, side by side or one above the
    other, each group is a conductor.  What is as long as the spans of bundles (``bundle_length``)
    may be one, and stays whole.  A conductor that has its own curve already gets no other one.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Each within one span.
    settings : CatenarySettings
        Settings of this stage.

    Returns
    -------
    tuple of Curve, longest first

    """
    whole: list[Curve] = []
    parts: list[Curve] = []
    for curve in curves:
        may_be_more = is_thick(curve) and curve.length < settings.bundle_length
        found = _part(points, curve) if may_be_more else (curve,)
        (whole if len(found) == 1 else parts).extend(found)
    return drop_duplicates(points, parts, settings, whole)


def _part(points: Float64, curve: Curve) -> tuple[Curve, ...]:
    """Return the conductors under a curve; the curve alone where there is one or no telling."""
    own = points[curve.points]
    x, across = curve.local(own)
    offset = np.column_stack([across, own[:, 2] - curve.fit.height(x)])
    offset -= offset.mean(axis=0)
    _, axes = np.linalg.eigh(offset.T @ offset)
    place = offset @ axes[:, -1]
    cuts = _divide(np.sort(place), max(int(LEAST_SHARE * len(place)), LEAST_POINTS))
    group = np.searchsorted(cuts, place)
    if not cuts or not _run_along(x, group):
        return (curve,)
    try:
        return tuple(
            fit_curve(
                points, curve.points[group == number], tolerance=curve.tolerance / (len(cuts) + 1),
                azimuth=curve.azimuth,
            ) for number in range(len(cuts) + 1)
        )
    except FitError:
        return (curve,)


def _divide(place: Float64, least: int) -> list[float]:
    """
    Return where groups of ascending numbers meet, ascending; each has at least so many of them.

    Between two groups there are surely fewer numbers than in either.
    """
    if len(place) < 2 * least:
        return []
    cell = ((place - place[0]) / CELL).astype(np.int64)
    counts = np.convolve(np.bincount(cell), np.ones(3), mode='same')
    sides = np.minimum(
        np.maximum.accumulate(counts), np.maximum.accumulate(counts[::-1])[::-1]
    )
    inner = np.arange(cell[least - 1], cell[-least] + 1)
    valley = int(inner[np.argmin(counts[inner] / sides[inner])])
    peak = sides[valley]
    cut = float(place[0] + (valley + 0.5) * CELL)
    low, high = np.split(place, np.searchsorted(place, [cut]))
    if (
        min(len(low), len(high)) < least or high.mean() - low.mean() < LEAST_APART
        or counts[valley] > min(DIP * peak, peak - DIP_SIGMAS * math.sqrt(peak))
    ):
        return []
    return [*_divide(low, least), cut, *_divide(high, least)]


def _run_along(x: Float64, group: Int64) -> bool:
    """Return whether all groups are seen all along."""
    stretch = ((x - x.min()) / STRETCH).astype(np.int64)
    counts = np.zeros((int(stretch.max()) + 1, int(group.max()) + 1))
    np.add.at(counts, (stretch, group), 1)
    seen = counts.sum(axis=1) >= counts.shape[1] * LEAST_POINTS
    full = (counts >= LEAST_POINTS).all(axis=1)
    return bool(full.sum() >= max(SEEN_SHARE * seen.sum(), 2))
