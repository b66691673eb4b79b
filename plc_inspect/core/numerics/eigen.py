# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Eigenvalues and first eigenvector of 3 x 3 covariances, in closed form."""

import math

from numba import njit

ROUNDING = 1e-12
"""
Spread of eigenvalues, as a share of their mean, up to which they count as equal.
Source: numerical: some thousand roundings of a double.
"""
LEAST_MEAN = 1e-300
"""
Smallest mean eigenvalue for which ROUNDING is relative [m2].
Source: numerical: ROUNDING times this is above the smallest double, 5e-324.
"""
LEAST_SPREAD = 1e-312
"""
Spread up to which smaller eigenvalues count as equal [m2].
Source: derived: ROUNDING times LEAST_MEAN.
"""


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def principal_axis(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Return the eigenvalues l1 >= l2 >= l3 >= 0 and first eigenvector of a 3 x 3 covariance.

    Closed form (Smith 1961), without branches and trigonometry, so that loops over many matrices
    become vector instructions.  The eigenvector has x > 0 or, at x = 0, y > 0; if all eigenvalues
    are equal it is (1, 0, 0).
    """
    # A = mean I + p B, with B of trace 0 and of norm sqrt(6): B's eigenvalues are 2 cos(angle)
    mean = (xx + yy + zz) / 3.0
    off = xy * xy + xz * xz + yz * yz
    spread = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2.0 * off
    p = math.sqrt(spread / 6.0)
    floor = ROUNDING * mean if mean > LEAST_MEAN else LEAST_SPREAD
    p = p if p > floor else 0.0
    scale = 1.0 / p if p > 0.0 else 0.0
    a, b, c = (xx - mean) * scale, (yy - mean) * scale, (zz - mean) * scale
    d, e, f = xy * scale, xz * scale, yz * scale
    # half the determinant of B is the cosine of three times the angle
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2.0
    size = math.fabs(half)
    size = size if size < 1.0 else 1.0
    # cos(acos(size) / 3), half the eigenvalue of B that lies apart: a cubic within 7e-5 of it, and
    # two steps of Newton on 4 x^3 - 3 x = size, which leave nothing but rounding
    far = 0.866025 + size * (0.165718 + size * (0.009962 * size - 0.041637))
    far -= ((4.0 * far * far - 3.0) * far - size) / (12.0 * far * far - 3.0)
    far -= ((4.0 * far * far - 3.0) * far - size) / (12.0 * far * far - 3.0)
    # the other two follow from it; the sign of the determinant says on which side it lies
    rest = 3.0 - 3.0 * far * far
    near = 0.5 * (far + math.sqrt(rest if rest > 0.0 else 0.0))
    l1 = mean + 2.0 * p * (far if half >= 0.0 else near)
    l3 = mean - 2.0 * p * (near if half >= 0.0 else far)
    l2 = 3.0 * mean - l1 - l3
    # v1 spans the null space of A - l1 I: cross products of two of its rows
    ax, by, cz = xx - l1, yy - l1, zz - l1
    ux, uy, uz = xy * yz - xz * by, xz * xy - ax * yz, ax * by - xy * xy
    vx, vy, vz = xy * cz - xz * yz, xz * xz - ax * cz, ax * yz - xy * xz
    wx, wy, wz = by * cz - yz * yz, yz * xz - xy * cz, xy * yz - by * xz
    nu = ux * ux + uy * uy + uz * uz
    nv = vx * vx + vy * vy + vz * vz
    nw = wx * wx + wy * wy + wz * wz
    # the longest of them is the least affected by rounding
    larger = nv > nu
    ux, uy, uz = vx if larger else ux, vy if larger else uy, vz if larger else uz
    nu = nv if larger else nu
    larger = nw > nu
    ux, uy, uz = wx if larger else ux, wy if larger else uy, wz if larger else uz
    nu = nw if larger else nu
    # scale it to unit length, with the sign that all callers expect
    known = (nu > 0.0) & (p > 0.0)
    scale = 1.0 / math.sqrt(nu) if known else 0.0
    scale = -scale if (ux < 0.0) | ((ux == 0.0) & (uy < 0.0)) else scale
    return (
        l1 if l1 > 0.0 else 0.0,
        l2 if l2 > 0.0 else 0.0,
        l3 if l3 > 0.0 else 0.0,
        ux * scale if known else 1.0,
        uy * scale,
        uz * scale,
    )


@njit(cache=True, nogil=True, inline='always', error_model='numpy')
def principal_axis_of(sums, first, step):  # type: ignore[no-untyped-def]
    """
    Return `principal_axis` of the covariance of points, from their moments.

    The ten moments stand in ``sums`` from ``first`` on, ``step`` apart: number of points, sums [m]
    and sums of products [m2].
    """
    n = sums[first]
    mx = sums[first + step] / n
    my = sums[first + 2 * step] / n
    mz = sums[first + 3 * step] / n
    return principal_axis(
        sums[first + 4 * step] / n - mx * mx,
        sums[first + 5 * step] / n - mx * my,
        sums[first + 6 * step] / n - mx * mz,
        sums[first + 7 * step] / n - my * my,
        sums[first + 8 * step] / n - my * mz,
        sums[first + 9 * step] / n - mz * mz,
    )
