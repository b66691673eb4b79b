# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Breaks of a track: the supports that it passes show as kinks."""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.sorting import argsort_spread
from plc_inspect.results import Float64

MIN_SIDE = 5.0
"""Least extent on either side of a break [m]."""
MIN_SIDE_POINTS = 6
STEP = 0.5
"""Distance of the places that are tried [m]."""
MIN_KINK = 0.012
"""Smallest change of slope that counts as a kink, on top of its own uncertainty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """A place where a track is two curves rather than one."""

    x: float
    """Position along the track [m]."""
    kink: float
    """Change of slope, negative where the conductor hangs from a support."""
    turn: float
    """Change of plan direction [rad]."""


def find_break(x: Float64, y: Float64, z: Float64) -> Break | None:
    """
    Find the most pronounced support on a track, if there is one.

    A conductor hangs in convex arcs: between two spans the slope falls abruptly, or the plan
    direction turns.  All splits are tried, with a parabola in z and a line in y on either side
    (least squares by prefix sums), and the one of least squared error is believed when its kink
    is greater than four times its own standard deviation.  O(N log N).

    Parameters
    ----------
    x, y, z : (N,) float64
        Along the track, across it and up [m].

    Returns
    -------
    Break or None

    """
    found, at, kink, turn = locate_break(
        np.ascontiguousarray(x), np.ascontiguousarray(y), np.ascontiguousarray(z)
    )
    return Break(x=at, kink=kink, turn=turn) if found else None


@njit(cache=True, nogil=True, error_model='numpy')
def locate_break(x, y, z):  # type: ignore[no-untyped-def]
    """Whether there is a break, and the fields of Break."""
    nothing = False, 0.0, 0.0, 0.0
    if len(x) < 2 * MIN_SIDE_POINTS or x.max() - x.min() < 2 * MIN_SIDE:
        return nothing
    order = argsort_spread(x)
    x, y, z = x[order], y[order], z[order]
    middle, scale = (x[0] + x[-1]) / 2, (x[-1] - x[0]) / 2
    t = (x - middle) / scale
    cut, error, ml, mr = _best_cut(x, t, y - y.mean(), z - z.mean())
    if cut == 0:
        return nothing
    noise = math.sqrt(error / max(len(x) - 10, 1))
    t_cut = (t[cut - 1] + t[cut]) / 2
    t_meet = _crossing(ml, mr, t_cut, t[cut - 1], t[cut])
    kink = ((mr[1] + 2 * mr[2] * t_meet) - (ml[1] + 2 * ml[2] * t_meet)) / scale
    turn = math.atan((mr[4] - ml[4]) / scale)
    spread = (
        1.0 / (cut * (x[cut - 1] - x[0]) ** 2) + 1.0 / ((len(x) - cut) * (x[-1] - x[cut]) ** 2)
    )
    kink_sigma, turn_sigma = noise * math.sqrt(192.0 * spread), noise * math.sqrt(12.0 * spread)
    if kink > -(MIN_KINK + 4 * kink_sigma) and abs(turn) < MIN_KINK + 4 * turn_sigma:
        return nothing
    if kink > 4 * kink_sigma + MIN_KINK:  # bends upwards: no support hangs like that
        return nothing
    return True, middle + scale * t_meet, kink, turn


@njit(cache=True, nogil=True, error_model='numpy')
def _crossing(left, right, near, low, high):  # type: ignore[no-untyped-def]
    """Where the two parabolas meet nearest to ``near``; ``near`` if they do not meet there."""
    d0, d1, d2 = right[0] - left[0], right[1] - left[1], right[2] - left[2]
    if abs(d2) > 1e-12:
        inside = d1 * d1 - 4.0 * d2 * d0
        if inside < 0.0:
            return near
        q = -0.5 * (d1 + math.copysign(math.sqrt(inside), d1))
        meet, other = (q / d2, d0 / q) if q != 0.0 else (0.0, 0.0)
        if abs(other - near) < abs(meet - near):
            meet = other
    else:
        meet = -d0 / d1 if d1 != 0.0 else near
    slack = 0.02
    return meet if low - slack <= meet <= high + slack else near


@njit(cache=True, nogil=True, error_model='numpy')
def _solve(s, model):  # type: ignore[no-untyped-def]
    """
    Least-squares parabola in z and line in y of points whose sums ``s`` are given.

    Sums are of 1, t, t2, t3, t4, z, zt, zt2, zz, y, yt, yy.  Returned is the squared error;
    ``model`` takes the three coefficients of the parabola and the two of the line.
    """
    ridge = 1e-9 * s[0]
    a, b, c = s[0] + ridge, s[1], s[2]
    d, e, f = s[2] + ridge, s[3], s[4] + ridge
    # inverse of the symmetric matrix a b c / b d e / c e f
    i00, i01, i02 = d * f - e * e, c * e - b * f, b * e - c * d
    i11, i12, i22 = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * i00 + b * i01 + c * i02
    if determinant <= 0.0:
        return np.inf
    model[0] = (i00 * s[5] + i01 * s[6] + i02 * s[7]) / determinant
    model[1] = (i01 * s[5] + i11 * s[6] + i12 * s[7]) / determinant
    model[2] = (i02 * s[5] + i12 * s[6] + i22 * s[7]) / determinant
    error_z = s[8] - (model[0] * s[5] + model[1] * s[6] + model[2] * s[7])
    model[4] = (s[0] * s[10] - s[1] * s[9]) / (s[0] * s[2] - s[1] * s[1] + 1e-12)
    model[3] = (s[9] - model[4] * s[1]) / s[0]
    error_y = s[11] - model[4] * s[10] - model[3] * s[9]
    return max(error_z, 0.0) + max(error_y, 0.0)


@njit(cache=True, nogil=True, error_model='numpy')
def _add(s, t, y, z):  # type: ignore[no-untyped-def]
    """Add a point to the sums."""
    t2 = t * t
    s[0] += 1.0
    s[1] += t
    s[2] += t2
    s[3] += t2 * t
    s[4] += t2 * t2
    s[5] += z
    s[6] += z * t
    s[7] += z * t2
    s[8] += z * z
    s[9] += y
    s[10] += y * t
    s[11] += y * y


@njit(cache=True, nogil=True, error_model='numpy')
def _best_cut(x, t, y, z):  # type: ignore[no-untyped-def]
    """
    Best place to cut points in order of x: the first point after it, 0 if there is none.

    Places are about STEP apart and leave MIN_SIDE and MIN_SIDE_POINTS on either side.  Further
    returned are the squared error and the models of both sides.
    """
    num = len(x)
    left, right, total = np.zeros(12), np.zeros(12), np.zeros(12)
    for k in range(num):
        _add(total, t[k], y[k], z[k])
    own_left, own_right = np.zeros(5), np.zeros(5)
    best_left, best_right = np.zeros(5), np.zeros(5)
    best, cut, place = np.inf, 0, -np.inf
    for k in range(num - MIN_SIDE_POINTS + 1):
        if k >= MIN_SIDE_POINTS and x[k] - x[0] >= MIN_SIDE and x[num - 1] - x[k] >= MIN_SIDE:
            here = math.floor(x[k] / STEP)
            if here > place:
                place = here
                for m in range(len(total)):
                    right[m] = total[m] - left[m]
                error = _solve(left, own_left) + _solve(right, own_right)
                if error < best:
                    best, cut = error, k
                    put(own_left, best_left)
                    put(own_right, best_right)
        _add(left, t[k], y[k], z[k])
    return cut, best, best_left, best_right
