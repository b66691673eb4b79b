# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The fit of a vertical plane and of a catenary in it, and curves as rows of numbers."""

import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.solver import (
    expand,
    height_at,
    LEAST_EXTENT,
    LEAST_POINTS,
    slope_at,
    solve_catenary,
)
from plc_inspect.core.numerics.arrays import put
from plc_inspect.results import Float64

MIN_TOLERANCE, MAX_TOLERANCE = 0.1, 0.35
"""
Bounds of the residual of an inlier, when it is derived from the noise [m].
Source: judgement; not measured.
"""
ROUNDING = 1e-6
"""
Margin at ends that are themselves places of points [m].
Source: numerical: rounding must not decide whether they are within.
"""
NUM_PLANES = 4
"""
Rounds of fitting the plane and choosing the points near it.
Source: judgement; not measured.
"""
ORIGIN_X, ORIGIN_Y, COS, SIN, MIDDLE, HEIGHT, SLOPE, CURVATURE, LOW, HIGH = range(10)
"""
Columns of a row: the plan origin [m], the direction of x, where the catenary is expanded [m],
height [m], slope and curvature [1/m] there, and x of both ends [m].
"""
AZIMUTH, RMSE, LATERAL_RMSE, OFFSET_SIGMA, TURN_SIGMA, MEAN_X, CONVERGED = range(10, 17)
TOLERANCE, NUM_POINTS, COVARIANCE, ROW = 17, 18, 19, 28
"""
Further ones, as the fields of Curve.  NUM_POINTS are all points on the curve, 0 where there is
none; the covariance of height, slope and curvature takes nine; ROW is the length of a row.
Source: numerical: the layout of a row.
"""
LEAST_SPREAD = 1e-9
"""
Sum of squares along a plane below which points have no direction [m2].
Source: numerical: rounding of their coordinates.
"""


def describe_misfit(row: Float64, num: int, num_plane: int, num_curve: int) -> str:
    """
    Say why fit_row found no curve, or return an empty string.

    Parameters
    ----------
    row : (ROW,) float64
        From fit_row.
    num, num_plane, num_curve : int
        Points that it used, those of them in a vertical plane, and those on a catenary.

    """
    if row[NUM_POINTS]:
        return ''
    if num < LEAST_POINTS:
        return f'a conductor needs {LEAST_POINTS} points, got {num}'
    if num_plane < LEAST_POINTS:
        return f'{num_plane} of {num} points lie in a vertical plane'
    if row[HIGH] - row[LOW] < LEAST_EXTENT:
        return f'a catenary cannot be fitted to points within {row[HIGH] - row[LOW]:.1e} m'
    return f'{num_curve} of {num} points lie on a catenary'


@njit(cache=True, nogil=True, error_model='numpy')
def derive_tolerance(noise: float) -> float:
    """Residual that separates inliers from others, for a noise (rms) [m]."""
    return min(max(3.0 * noise, MIN_TOLERANCE), MAX_TOLERANCE)


@njit(cache=True, nogil=True, error_model='numpy')
def fit_row(  # type: ignore[no-untyped-def]
    points, chosen, max_points, tolerance, vertical, wanted, draws
):
    """
    Fit a vertical plane, and a catenary in it, to some of the points.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) int64
        Indices of the conductor's points.
    max_points : int
        More points than this are thinned evenly.
    tolerance, vertical : float
        Largest residual of an inlier across the plane and in it [m].
    wanted : float
        Azimuth that x runs about along, rather than opposite [rad]; NaN to the east.
    draws : (T, 3) float64
        From draw_triples.

    Returns
    -------
    row : (ROW,) float64
        A curve only where is_curve says so.
    own : (M,) int64
        Those of ``chosen`` that were used and are on the curve.
    stride : int
        How many points each of these stands for.
    num_plane : int
        How many of those used lie in the plane.

    """
    # as many points as are allowed
    row = np.zeros(ROW)
    stride = max(-(-len(chosen) // max_points), 1)
    chosen = chosen[::stride].copy()
    if len(chosen) < LEAST_POINTS:
        return row, chosen[:0], stride, 0
    # those in one vertical plane
    ox, oy, azimuth, x, y, z, keep = _find_plane(points, chosen, tolerance, wanted)
    num_plane = keep.sum()
    if num_plane < LEAST_POINTS:
        return row, chosen[:0], stride, num_plane
    if num_plane < len(chosen):
        chosen, x, y, z = chosen[keep], x[keep], y[keep], z[keep]
    row[LOW], row[HIGH] = x.min(), x.max()
    if row[HIGH] - row[LOW] < LEAST_EXTENT:
        return row, chosen[:0], stride, num_plane
    # a catenary in it
    middle, shape, covariance, rmse, inlier, converged = solve_catenary(x, z, vertical, draws)
    own = chosen[inlier]
    num = len(own)
    if num < LEAST_POINTS:
        return row, own, stride, num_plane
    # extent of its points, and how sure the plane is
    low, high, mean, square = np.inf, -np.inf, 0.0, 0.0
    for k in range(len(x)):
        if inlier[k]:
            low, high = min(low, x[k]), max(high, x[k])
            mean += x[k] / num
            square += y[k] * y[k]
    spread = 0.0
    for k in range(len(x)):
        if inlier[k]:
            spread += (x[k] - mean) ** 2
    rms = math.sqrt(square / num)
    noise = max(rms, 1e-3)
    azimuth -= 2.0 * math.pi * round(azimuth / (2.0 * math.pi))
    row[ORIGIN_X], row[ORIGIN_Y], row[COS], row[SIN] = ox, oy, math.cos(azimuth), math.sin(azimuth)
    row[MIDDLE] = middle
    put(shape, row[HEIGHT:])
    row[LOW], row[HIGH], row[AZIMUTH], row[RMSE], row[LATERAL_RMSE] = low, high, azimuth, rmse, rms
    row[OFFSET_SIGMA], row[TURN_SIGMA] = noise / math.sqrt(num), noise / math.sqrt(
        max(spread, LEAST_SPREAD)
    )
    row[MEAN_X], row[CONVERGED], row[TOLERANCE] = mean, converged, tolerance
    row[NUM_POINTS] = num * stride
    for p in range(3):
        for q in range(3):
            row[COVARIANCE + 3 * p + q] = covariance[p, q]
    return row, own, stride, num_plane


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def is_curve(row):  # type: ignore[no-untyped-def]
    """Whether fit_row found one."""
    return row[NUM_POINTS] > 0.0


@njit(cache=True, nogil=True, error_model='numpy')
def height_of(row, x):  # type: ignore[no-untyped-def]
    """Return the height of a row's curve at x [m]."""
    return height_at(row[MIDDLE], row[HEIGHT], row[SLOPE], row[CURVATURE], x)


@njit(cache=True, nogil=True, error_model='numpy')
def slope_of(row, x):  # type: ignore[no-untyped-def]
    """Return dz/dx of a row's curve at x."""
    return slope_at(row[MIDDLE], row[SLOPE], row[CURVATURE], x)


@njit(cache=True, nogil=True, error_model='numpy')
def variances_of(row, x):  # type: ignore[no-untyped-def]
    """Return the variances of the height and of the lateral place of a row's curve at x [m2]."""
    g, k, t = row[SLOPE], row[CURVATURE], x - row[MIDDLE]
    root, u = math.sqrt(1.0 + g * g), k * t + math.asinh(g)
    sinh, cosh = math.sinh(u), math.cosh(u)
    by_slope = (sinh - g) / (root * k)
    by_curvature = t * sinh / k - (cosh - root) / (k * k)
    c = row[COVARIANCE:]
    vertical = (
        c[0] + by_slope * (by_slope * c[4] + 2.0 * c[1])
        + by_curvature * (by_curvature * c[8] + 2.0 * (c[2] + by_slope * c[5]))
    )
    lateral = row[OFFSET_SIGMA] ** 2 + (row[TURN_SIGMA] * (x - row[MEAN_X])) ** 2
    return max(vertical, 0.0), lateral


@njit(cache=True, nogil=True, error_model='numpy')
def sigma_of(row, x):  # type: ignore[no-untyped-def]
    """Return the standard deviation of the position of a row's curve at x [m]."""
    vertical, lateral = variances_of(row, x)
    return math.sqrt(vertical + lateral)


@njit(cache=True, nogil=True, error_model='numpy')
def slope_variance_of(row, x):  # type: ignore[no-untyped-def]
    """Return the variance of dz/dx of a row's curve at x."""
    g, t = row[SLOPE], x - row[MIDDLE]
    root, cosh = math.sqrt(1.0 + g * g), math.cosh(row[CURVATURE] * t + math.asinh(g))
    c = row[COVARIANCE:]
    return max(cosh**2 * ((c[4] / root + 2.0 * t * c[5]) / root + t * t * c[8]), 0.0)


@njit(cache=True, nogil=True, error_model='numpy')
def to_local(row, px, py):  # type: ignore[no-untyped-def]
    """Return x along and y across a row's curve of a plan position [m]."""
    dx, dy = px - row[ORIGIN_X], py - row[ORIGIN_Y]
    return row[COS] * dx + row[SIN] * dy, row[COS] * dy - row[SIN] * dx


@njit(cache=True, nogil=True, error_model='numpy')
def plan_of(row, x):  # type: ignore[no-untyped-def]
    """Plan position of a row's curve at x [m]."""
    return row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def open_row(row):  # type: ignore[no-untyped-def]
    """
    Return a row's curve as numbers that a loop over points keeps in registers, for `see_beside`.

    The row itself would be read anew at each point, as what the loop writes might be part of it.
    """
    root = math.sqrt(1.0 + row[SLOPE] * row[SLOPE])
    return (
        row[ORIGIN_X], row[ORIGIN_Y], row[COS], row[SIN],
        row[MIDDLE], row[HEIGHT], row[SLOPE], row[CURVATURE], root, 1.0 / row[CURVATURE],
    )


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def see_beside(opened, px, py):  # type: ignore[no-untyped-def]
    """Return x along and y across an opened row's curve of a plan position [m]."""
    dx, dy = px - opened[0], py - opened[1]
    return opened[2] * dx + opened[3] * dy, opened[2] * dy - opened[3] * dx


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def see_above(opened, x, pz):  # type: ignore[no-untyped-def]
    """Return how far a height [m] is above an opened row's curve at x [m], and dz/dx there."""
    _, _, _, _, middle, height, slope, curvature, root, constant = opened
    more, odd = expand(curvature * (x - middle))
    rise = pz - height - (root * more + slope * odd) * constant
    return rise, slope + slope * more + root * odd


@njit(cache=True, nogil=True, error_model='numpy')
def _find_plane(points, chosen, tolerance, wanted):  # type: ignore[no-untyped-def]
    """
    Find the vertical plane of points, robustly.

    Returned are its origin and azimuth, x and y of the points in it, their z, and which of them
    lie within the tolerance.
    """
    num = len(chosen)
    ox = oy = 0.0
    for i in chosen:
        ox += points[i, 0] / num
        oy += points[i, 1] / num
    # plan positions from their mean: the loops below stay exact for map coordinates
    dx, dy, z = np.empty(num), np.empty(num), np.empty(num)
    xx = xy = yy = 0.0
    for k in range(num):
        i = chosen[k]
        dx[k], dy[k], z[k] = points[i, 0] - ox, points[i, 1] - oy, points[i, 2]
        xx += dx[k] * dx[k]
        xy += dx[k] * dy[k]
        yy += dy[k] * dy[k]
    azimuth = 0.5 * math.atan2(2.0 * xy, xx - yy)
    if math.cos(azimuth - wanted) < 0.0:  # never where none is wanted: NaN
        azimuth += math.pi
    # a line in plan by least squares, then by those near it
    sx = sy = 0.0
    keep = np.ones(num, dtype=np.bool_)
    x, y = np.empty(num), np.empty(num)
    for step in range(NUM_PLANES + 1):
        ca, sa = math.cos(azimuth), math.sin(azimuth)
        count = 0
        mx = my = 0.0
        for k in range(num):
            x[k] = ca * (dx[k] - sx) + sa * (dy[k] - sy)
            y[k] = ca * (dy[k] - sy) - sa * (dx[k] - sx)
            if step:
                keep[k] = abs(y[k]) <= tolerance
            if keep[k]:
                count += 1
                mx += x[k]
                my += y[k]
        if step == NUM_PLANES or count < LEAST_POINTS:
            break
        # turn and shift the line to the points it keeps
        mx /= count
        my /= count
        spread = product = 0.0
        for k in range(num):
            if keep[k]:
                spread += (x[k] - mx) * (x[k] - mx)
                product += (x[k] - mx) * (y[k] - my)
        slope = product / spread if spread > LEAST_SPREAD else 0.0
        offset = my - slope * mx
        sx -= offset * sa
        sy += offset * ca
        azimuth += math.atan(slope)
    return ox + sx, oy + sy, azimuth, x, y, z, keep
