# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Least squares and MSAC of a catenary, as kernels."""

import math

from numba import njit
import numpy as np

MIN_CURVATURE = 1e-6
"""
A straighter wire is given this curvature, 1 / c [1/m].
Source: numerical: c stays finite; a sag of 0.1 m in 900 m.
"""
NUM_STEPS = 12
"""Steps of Gauss-Newton, at most.  Source: numerical: a bound of time."""
SETTLED = 1e-7
"""Smaller steps change nothing any more [m].  Source: numerical: far below the noise of ranges."""
LEAST_EXTENT = 1e-3
"""
Points within less than this along the span have no catenary [m].
Source: numerical: rounding of coordinates.
"""
LEAST_POINTS = 4
"""
Points of a catenary, at least.
Source: derived: its three parameters, and one for the noise.
"""


@njit(cache=True, nogil=True, error_model='numpy')
def solve_catenary(x, z, tolerance, draws):  # type: ignore[no-untyped-def]
    """
    Fit a catenary to (N,) x along the span and z [m]; x are four or more and not all the same.

    With ``draws``, from draw_triples, MSAC (Torr and Zisserman 2000) fits the quadratic form
    through each triple and keeps the one of least truncated error; without, all points start as
    inliers.  Gauss-Newton on the inliers then solves Eq. 7 of the paper, with residuals squared,
    and the covariance is that of the linearised problem.  O(N (trials + steps)).

    Returned are the fields of CatenaryFit, with the (N,) inliers before the last.  Sums of many
    points are rounded as the processor adds best, so the last bits are those of one machine.
    """
    least = x.min()
    extent = x.max() - least
    middle = least + extent / 2
    t = x - middle
    inlier = np.ones(len(x), dtype=np.bool_)
    if len(draws):
        inlier = _find_consensus(t, z, draws, tolerance, extent)
        if inlier.sum() < LEAST_POINTS:
            inlier[:] = True
    shape, covariance, rmse, inlier, converged = _refine(t, z, inlier, tolerance)
    return middle, shape, covariance, rmse, inlier, converged


@njit(cache=True, nogil=True, error_model='numpy')
def _find_consensus(t, z, draws, tolerance, extent):  # type: ignore[no-untyped-def]
    """Inliers of the best quadratic through three points, by truncated squared error."""
    n = len(t)
    best = np.inf
    kept = np.ones(n, dtype=np.bool_)
    limit = tolerance * tolerance
    for trial in range(len(draws)):
        i, j, k = int(draws[trial, 0] * n), int(draws[trial, 1] * n), int(draws[trial, 2] * n)
        dij, dik, djk = t[i] - t[j], t[i] - t[k], t[j] - t[k]
        if min(abs(dij), abs(dik), abs(djk)) < 0.05 * extent:
            continue
        a2 = z[i] / (dij * dik) - z[j] / (dij * djk) + z[k] / (dik * djk)
        a1 = (z[i] - z[j]) / dij - a2 * (t[i] + t[j])
        a0 = z[i] - t[i] * (a1 + a2 * t[i])
        if a2 < -2.0 * tolerance / (extent * extent):
            continue
        error = 0.0
        for m in range(n):
            r = z[m] - a0 - t[m] * (a1 + a2 * t[m])
            error += min(r * r, limit)
            if error >= best:
                break
        if error < best:
            best = error
            for m in range(n):
                r = z[m] - a0 - t[m] * (a1 + a2 * t[m])
                kept[m] = r * r <= limit
    return kept


@njit(
    cache=True, nogil=True, error_model='numpy', fastmath={'reassoc', 'contract', 'nsz'}
)
def _add_up(t, z, h, g, k, scale, tolerance, weight, anew, sums):  # type: ignore[no-untyped-def]
    """
    Add up the normal equations over the points with weight 1; ``anew`` weighs them first.

    Close to the middle, at |k t| of 0.5 or less, cosh and sinh are polynomials, exact to 1e-12.
    """
    root, base = math.sqrt(1.0 + g * g), math.asinh(g)
    by_k, by_root, by_scale = 1.0 / k, 1.0 / (root * k * scale), 1.0 / (k * scale * scale)
    near = k * scale <= 0.5
    total = count = r0 = r1 = r2 = n1 = n2 = n11 = n12 = n22 = 0.0
    for m in range(len(t)):
        u = k * t[m]
        if near:
            u2 = u * u
            more = 0.5 * u2 * (1.0 + u2 / 12.0 * (1.0 + u2 / 30.0 * (1.0 + u2 / 56.0 * (
                1.0 + u2 / 90.0))))
            odd = u * (1.0 + u2 / 6.0 * (1.0 + u2 / 20.0 * (1.0 + u2 / 42.0 * (
                1.0 + u2 / 72.0 * (1.0 + u2 / 110.0)))))
            rise, run = root * more + g * odd, root * odd + g * more
        else:
            grown = math.exp(u + base)
            rise, run = 0.5 * (grown + 1.0 / grown) - root, 0.5 * (grown - 1.0 / grown) - g
        # residual, weight, and derivatives by slope and curvature
        r = z[m] - h - rise * by_k
        w = weight[m]
        if anew:
            w = 1.0 if abs(r) <= tolerance else 0.0
            weight[m] = w
        j1 = run * by_root
        j2 = (t[m] * (run + g) - rise * by_k) * by_scale
        total += w * r * r
        count += w
        r0 += w * r
        r1 += w * j1 * r
        r2 += w * j2 * r
        n1 += w * j1
        n2 += w * j2
        n11 += w * j1 * j1
        n12 += w * j1 * j2
        n22 += w * j2 * j2
    sums[0], sums[1], sums[2], sums[3], sums[4] = total, count, r0, r1, r2
    sums[5], sums[6], sums[7], sums[8], sums[9] = n1, n2, n11, n12, n22


@njit(cache=True, nogil=True, error_model='numpy')
def _invert(matrix, result):  # type: ignore[no-untyped-def]
    """Invert a symmetric positive 3 x 3 matrix; return False where it is none."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    i00, i01, i02 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * i00 + b * i01 + c * i02
    if not (determinant > 0.0 and determinant < np.inf):
        return False
    result[0, 0], result[0, 1], result[0, 2] = i00, i01, i02
    result[1, 0], result[1, 1], result[1, 2] = i01, a * f - c * c, b * c - a * e
    result[2, 0], result[2, 1], result[2, 2] = i02, b * c - a * e, a * d - b * b
    result /= determinant
    return True


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def expand(u):  # type: ignore[no-untyped-def]
    """Return cosh(u) - 1 and sinh(u): polynomials, exact to 1e-12, where ``u`` is 0.5 or less."""
    if abs(u) > 0.5:
        return math.cosh(u) - 1.0, math.sinh(u)
    u2 = u * u
    return 0.5 * u2 * (1.0 + u2 / 12.0 * (1.0 + u2 / 30.0 * (1.0 + u2 / 56.0 * (
        1.0 + u2 / 90.0)))), u * (1.0 + u2 / 6.0 * (1.0 + u2 / 20.0 * (1.0 + u2 / 42.0 * (
            1.0 + u2 / 72.0 * (1.0 + u2 / 110.0)))))


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def height_at(middle, h, g, k, x):  # type: ignore[no-untyped-def]
    """Return z [m] at x [m] of the catenary with height, slope and curvature at ``middle``."""
    more, odd = expand(k * (x - middle))
    return h + (math.sqrt(1.0 + g * g) * more + g * odd) / k


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def slope_at(middle, g, k, x):  # type: ignore[no-untyped-def]
    """Return dz/dx at x [m] of that catenary."""
    more, odd = expand(k * (x - middle))
    return g + g * more + math.sqrt(1.0 + g * g) * odd


@njit(cache=True, nogil=True, error_model='numpy', fastmath={'reassoc', 'contract', 'nsz'})
def add_up_quadratic(t, z, scale, weight):  # type: ignore[no-untyped-def]
    """
    Return the normal equations of a quadratic form in (N,) t / scale, fitted to z.

    Those are their (3, 3) matrix and (3,) right side; sums are rounded as the processor adds best.
    """
    n = t1 = t2 = t3 = t4 = r0 = r1 = r2 = 0.0
    by_scale = 1.0 / scale
    for m in range(len(t)):
        u, w = t[m] * by_scale, weight[m]
        wu = w * u
        wu2 = wu * u
        n, t1, t2, t3, t4 = n + w, t1 + wu, t2 + wu2, t3 + wu2 * u, t4 + wu2 * u * u
        r0, r1, r2 = r0 + w * z[m], r1 + wu * z[m], r2 + wu2 * z[m]
    return np.array([[n, t1, t2], [t1, t2, t3], [t2, t3, t4]]), np.array([r0, r1, r2])


@njit(cache=True, nogil=True, error_model='numpy')
def _refine(t, z, inlier, tolerance):  # type: ignore[no-untyped-def]
    """
    Gauss-Newton on height, slope and curvature, the inliers chosen anew at each step.

    There are no inliers where the points do not tell all three.
    """
    scale = max(np.abs(t).max(), 1e-9)
    # quadratic start
    weight = inlier.astype(np.float64)
    normal, right = add_up_quadratic(t, z, scale, weight)
    for p in range(3):
        normal[p, p] += 1e-9 * (normal[0, 0] + 1.0)
    inverse = np.zeros((3, 3))
    if not _invert(normal, inverse):
        return np.zeros(3), np.zeros((3, 3)), 0.0, np.zeros(len(t), dtype=np.bool_), False
    start = inverse @ right
    h, g = start[0], start[1] / scale
    k = max(2.0 * start[2] / (scale * scale * math.sqrt(1.0 + g * g)), MIN_CURVATURE)
    k = min(k, 20.0 / scale)
    converged = False
    covariance = np.zeros((3, 3))
    # unknowns are scaled so that all are lengths
    units = np.array([1.0, 1.0 / scale, 1.0 / (scale * scale)])
    sums = np.zeros(10)
    rmse = 0.0
    for step in range(NUM_STEPS):
        _add_up(t, z, h, g, k, scale, tolerance, weight, step >= 2, sums)
        # normal equations
        total, count = sums[0], sums[1]
        right[0], right[1], right[2] = sums[2], sums[3], sums[4]
        normal[0, 0], normal[0, 1], normal[0, 2] = count, sums[5], sums[6]
        normal[1, 1], normal[1, 2], normal[2, 2] = sums[7], sums[8], sums[9]
        normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
        if count < LEAST_POINTS:
            break
        for p in range(3):
            normal[p, p] += 1e-12 * (normal[0, 0] + 1.0)
        rmse = math.sqrt(total / count)
        if not _invert(normal, inverse):
            weight[:] = 0.0
            break
        # the step, and the covariance from the scatter about the curve
        change = inverse @ right
        noise = total / max(count - 3, 1)
        for p in range(3):
            for q in range(3):
                covariance[p, q] = inverse[p, q] * noise * units[p] * units[q]
        h += change[0]
        g += change[1] * units[1]
        k = min(max(k + change[2] * units[2], MIN_CURVATURE), 20.0 / scale)
        small = (
            abs(change[0]) < SETTLED and abs(change[1]) < SETTLED and abs(change[2]) < SETTLED
        )
        if step > 2 and small:
            converged = True
            break
    shape = np.array([h, g, k])
    return shape, covariance, rmse, weight > 0.5, converged
