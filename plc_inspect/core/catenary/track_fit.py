# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves of tracks: each track is split at the supports that it passes, and each part fitted."""

import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.breaks import locate_breaks
from plc_inspect.core.catenary.catenary import draw_triples
from plc_inspect.core.catenary.curve import (
    Curve,
    MAX_POINTS,
    unpack_curve,
)
from plc_inspect.core.catenary.curve_row import (
    derive_tolerance,
    fit_row,
    is_curve,
    LATERAL_RMSE,
    RMSE,
    ROW,
    TOLERANCE,
)
from plc_inspect.core.clustering.clustering import ClusteringResult
from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.sorting import argsort_spread
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Float64


def fit_tracks(
    points: Float64,
    clustering: ClusteringResult,
    settings: CatenarySettings,
    rng: np.random.Generator,
) -> tuple[Curve, ...]:
    """
    Turn tracks into curves, each within one span.

    A track is split wherever it shows the kink of a support, and each part is fitted.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    clustering : ClusteringResult
        Segments and tracks.
    settings : CatenarySettings
        Settings of this stage.
    rng : numpy.random.Generator
        For MSAC.

    Returns
    -------
    tuple of Curve, longest first

    """
    segments, num = clustering.segments, clustering.num_tracks
    order = np.argsort(clustering.track, kind='stable')
    bounds = np.searchsorted(clustering.track[order], np.arange(num + 1))
    draws = draw_triples(num * settings.num_trials, rng).reshape(num, settings.num_trials, 3)
    rms = np.ascontiguousarray(segments.rms)
    found = call_each(
        lambda track: _fit(
            points, segments.points, segments.point_start, rms,
            order[bounds[track] : bounds[track + 1]], settings.tolerance, draws[track],
        ),
        num,
    )
    curves = [
        unpack_curve(row, own[first:last], int(stride))
        for rows, own, start, strides in found
        for row, first, last, stride in zip(rows, start[:-1], start[1:], strides, strict=True)
    ]
    curves.sort(key=lambda curve: (-curve.length, *curve.origin))
    return tuple(curves)


@njit(cache=True, nogil=True, error_model='numpy')
def split_at_supports(points, chosen):  # type: ignore[no-untyped-def]
    """
    Split a track at every break.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) int64
        Points of the track.

    Returns
    -------
    list of int64 arrays
        The parts, in order along the track.

    """
    num = len(chosen)
    dx, dy, z = np.empty(num), np.empty(num), np.empty(num)
    for k in range(num):
        dx[k], dy[k], z[k] = points[chosen[k], 0], points[chosen[k], 1], points[chosen[k], 2]
    dx -= dx.mean()
    dy -= dy.mean()
    xx = xy = yy = 0.0
    for k in range(num):
        xx += dx[k] * dx[k]
        xy += dx[k] * dy[k]
        yy += dy[k] * dy[k]
    azimuth = 0.5 * math.atan2(2.0 * xy, xx - yy)
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    x = ca * dx + sa * dy
    found = locate_breaks(x, ca * dy - sa * dx, z, np.zeros(num, dtype=np.int64))
    place = np.searchsorted(found[:, 0], x, side='right')
    return [chosen[place == part] for part in range(place.max() + 1)]


@njit(cache=True, nogil=True, error_model='numpy')
def _fit(  # type: ignore[no-untyped-def]
    points, segment_points, segment_start, rms, segments, tolerance, draws
):
    """
    Fit the parts of one track; a tolerance of 0 is derived from its segments.

    Returned are the rows, the points of all of them, where those of each begin and the last end,
    and how many points each of these stands for.
    """
    total = 0
    for segment in segments:
        total += segment_start[segment + 1] - segment_start[segment]
    chosen = np.empty(total, dtype=np.int64)
    total = 0
    for segment in segments:
        for k in range(segment_start[segment], segment_start[segment + 1]):
            chosen[total] = segment_points[k]
            total += 1
    chosen = chosen[argsort_spread(chosen)]
    fresh = np.ones(total, dtype=np.bool_)
    for k in range(1, total):  # windows overlap
        fresh[k] = chosen[k] > chosen[k - 1]
    chosen = chosen[fresh]
    if tolerance == 0.0:
        tolerance = derive_tolerance(np.median(rms[segments]))
    parts = split_at_supports(points, chosen)
    rows = np.empty((len(parts), ROW))
    own = np.empty(len(chosen), dtype=np.int64)
    start = np.zeros(len(parts) + 1, dtype=np.int64)
    strides = np.empty(len(parts), dtype=np.int64)
    num = 0
    for part in parts:
        row, kept, stride, _ = fit_row(
            points, part, MAX_POINTS, tolerance, tolerance, math.nan, draws
        )
        if is_curve(row):
            # a track of one conductor may have segments that lie over two of them
            tight = derive_tolerance(math.hypot(row[RMSE], row[LATERAL_RMSE]))
            row[TOLERANCE] = min(tight, tolerance)
            put(row, rows[num])
            strides[num] = stride
            start[num + 1] = start[num] + len(kept)
            put(kept, own[start[num] :])
            num += 1
    return rows[:num], own[: start[num]], start[: num + 1], strides[:num]
