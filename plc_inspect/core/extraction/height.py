# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""High elevation extraction: height above local ground, and its histogram."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import HeightSettings
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.ground.ground_surface import measure_surface, Surface
from plc_inspect.results import Bool, Float32, Float64, Int64

MAX_PEAK = 1.0
"""
Greatest distance of the histogram's peak from the ground; shrubs are higher [m].
Source: judgement; not measured.
"""
MOST_BIN = 0.5
"""
Widest bin of the histogram, which leaves out the highest points where it needs wider ones [m].
Source: derived: half of MAX_PEAK; the peak is the middle of a bin.
"""
PEAK_SHARE = 0.5
"""The same distance as a share of beta.  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightResult:
    """Heights of N points above local ground, and which of them are high."""

    height: Float32
    """(N,) height above local ground [m]; NaN where no ground is known or not finite."""
    high: Bool
    """(N,) True for points that are searched for wires."""
    num_not_finite: int
    threshold: float
    """Least height of a high point [m]."""
    histogram: Int64
    """(num_bins,) points per bin of height; not those beyond the edges."""
    edges: Float64
    """(num_bins + 1,) bin edges [m]."""
    ground: GroundGrid
    airborne: Bool | None = None
    """(N,) points known not to be ground, None where none are."""


def extract_high(
    points: Float64,
    settings: HeightSettings,
    airborne: Bool | None = None,
    surface: Surface | None = None,
    peak: float | None = None,
) -> HeightResult:
    """
    Find the points that stand high above the ground below them.

    The lowest point of each cell makes a surface; a slope-limited lower envelope of it, freed of
    stray low points, is the ground.  The histogram of heights above it has its peak at the
    ground; points more than ``beta`` above that peak are high (paper, High Elevation
    Extraction).  Points under which no ground is known are kept.  Time and memory are linear in
    N and in the covered area.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m]; not-finite rows are counted and never high.
    settings : HeightSettings
        Settings of this stage.
    airborne : (N,) bool or None
        Points that cannot be ground.
    surface : Surface or None
        Surface of these points, where it is known already.
    peak : float or None
        Peak of the histogram of the whole cloud [m], if these points are a part of one.

    Returns
    -------
    HeightResult

    """
    if surface is None:
        surface = measure_surface(points, settings, airborne)
    height, extremes = surface.height, surface.extremes
    if surface.num_finite == 0:
        return _without_ground(surface, np.zeros(len(points), dtype=bool), math.inf, settings)
    if extremes[0] > extremes[1]:  # no ground known anywhere
        known = np.asarray(np.isfinite(points).all(axis=1))
        return _without_ground(surface, known, -math.inf, settings)
    edges = lay_edges(extremes, settings)
    histogram = count_heights(height, edges)
    if peak is None:
        peak = find_ground_peak(histogram, edges, settings.beta)
    threshold = peak + settings.beta
    return HeightResult(
        height=height,
        high=_is_high(points, height, threshold),
        num_not_finite=len(points) - surface.num_finite,
        threshold=threshold,
        histogram=histogram,
        edges=edges,
        ground=surface.ground,
        airborne=airborne,
    )


def lay_edges(extremes: Float32 | Float64, settings: HeightSettings) -> Float64:
    """Return the (num_bins + 1,) edges of the histogram from least and greatest height [m]."""
    widest = MOST_BIN * settings.num_bins
    top = max(float(extremes[1]), settings.beta)
    # how deep a stray point lies does not move the bins
    bottom = max(float(extremes[0]), -settings.beta, -widest / 2.0)
    return np.linspace(bottom, min(top, bottom + widest), settings.num_bins + 1)


def count_heights(height: Float32, edges: Float64) -> Int64:
    """Return the histogram of heights [m]; those of the parts of a cloud add up."""
    counts: Int64 = _histogram(height, float(edges[0]), float(edges[-1]), len(edges) - 1)
    return counts.sum(axis=0)


def _without_ground(
    surface: Surface, high: Bool, threshold: float, settings: HeightSettings
) -> HeightResult:
    return HeightResult(
        height=surface.height,
        high=high,
        num_not_finite=len(surface.height) - surface.num_finite,
        threshold=threshold,
        histogram=np.zeros(settings.num_bins, dtype=np.int64),
        edges=np.linspace(0.0, 1.0, settings.num_bins + 1),
        ground=surface.ground,
    )


def find_ground_peak(histogram: Int64, edges: Float64, beta: float) -> float:
    """Return the middle of the fullest bin near the ground, 0 where all are empty."""
    centers = (edges[:-1] + edges[1:]) / 2
    near = np.abs(centers) < min(MAX_PEAK, PEAK_SHARE * beta)
    if not near.any() or histogram[near].max() == 0:
        return 0.0
    return float(centers[near][np.argmax(histogram[near])])


@njit(cache=True, parallel=True, nogil=True)
def _histogram(height, bottom, top, num_bins):  # type: ignore[no-untyped-def]
    num_parts = 8
    counts = np.zeros((num_parts, num_bins), dtype=np.int64)
    scale = num_bins / (top - bottom)
    num = len(height)
    for part in prange(num_parts):
        for i in range(part * num // num_parts, (part + 1) * num // num_parts):
            if bottom <= height[i] <= top:
                counts[part, min(int((height[i] - bottom) * scale), num_bins - 1)] += 1
    return counts


@njit(cache=True, parallel=True, nogil=True)
def _is_high(points, height, threshold):  # type: ignore[no-untyped-def]
    result = np.empty(len(points), dtype=np.bool_)
    for i in prange(len(points)):
        if np.isnan(height[i]):
            finite = (
                np.isfinite(points[i, 0])
                and np.isfinite(points[i, 1])
                and np.isfinite(points[i, 2])
            )
            result[i] = finite
        else:
            result[i] = height[i] >= threshold
    return result
