# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Breaks: the places where a track passes from one span to the next.

A track may run over many supports.  It is cut into short pieces, each a parabola in z and a line
in y, and neighbours are merged as long as one piece explains both about as well; what is left are
the spans.  A single best cut will not do: in a track of several spans it may lie within a span.
"""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.results import Float64

CELL = 0.5
"""
Breaks lie between cells of this length [m].
Source: judgement; not measured: `_settle` and `_crossing` find the place within a cell.
"""
MIN_SIDE = 5.0
"""Least extent of a piece [m].  Source: judgement; not measured."""
MIN_SIDE_POINTS = 6
"""Points of a piece, at least.  Source: derived: its five parameters, and one more."""
MIN_KINK = 0.012
"""
Smallest change of slope that counts as a kink, on top of four times its own deviation.
Source: derived: two spans of 10 m at a catenary constant of 800 m.
"""
MERGE_COST = 20.0
"""
Neighbours are merged where the squared error grows by at most this many variances of the noise.
Source: derived: by the five parameters that are saved it grows by 5 on average, by 20 in one case
of 800.
"""
MAX_MISFIT = 0.05
"""
One piece that misses the points by more (rms) is two, whatever its kink [m].
Source: derived: half the least tolerance of a curve, beyond which it loses points.
"""
NUM_SWEEPS = 2
"""
How often the places of all breaks are looked for anew between their neighbours.
Source: judgement; not measured.
"""
SUMS = 12
"""Sums of a cell, as `_solve` names them.  Source: numerical: what a parabola and a line take."""
BLOCK = 256
"""
Cells whose sums are about the middle of these.
Source: numerical: fourth powers about the middle of a track of 6 km leave nothing of a span's.
"""
ALIKE = 1e-12
"""
Parabolas whose curvatures differ by less meet as lines do [1/m].
Source: numerical: rounding of the coefficients.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """A place where a track is two curves rather than one."""

    x: float
    """Position along the track [m]."""
    kink: float
    """Change of slope, negative where the conductor hangs from a support."""
    turn: float
    """Change of plan direction [rad]."""


def find_breaks(x: Float64, y: Float64, z: Float64) -> tuple[Break, ...]:
    """
    Find the supports on a track, in order along it.

    A conductor hangs in convex arcs: from one span to the next the slope changes abruptly, or the
    plan direction turns.  A break is believed when its kink or its turn is greater than four
    times its own standard deviation, or when one curve would miss the points of both sides.  A
    kink may go either way: at a support on a low point the conductor is drawn upwards on both
    sides.  O(N + P^2) for a track of P pieces.

    Parameters
    ----------
    x, y, z : (N,) float64
        Along the track, across it and up [m].

    Returns
    -------
    tuple of Break

    """
    found = locate_breaks(*(np.ascontiguousarray(item, dtype=np.float64) for item in (x, y, z)))
    return tuple(Break(x=at, kink=kink, turn=turn) for at, kink, turn in found.tolist())


@njit(cache=True, nogil=True, error_model='numpy')
def locate_breaks(x, y, z):  # type: ignore[no-untyped-def]
    """Return (B, 3) the place of each break along x, its kink and its turn."""
    if len(x) < 2 * MIN_SIDE_POINTS or x.max() - x.min() < 2 * MIN_SIDE:
        return np.empty((0, 3))
    low = x.min()
    before = _add_up(x - low, y - y.mean(), z - z.mean())
    bounds = _cut_evenly(before)
    noise = _measure_noise(before, bounds)
    if noise == 0.0:
        noise = 1e-12
    bounds = _merge(before, bounds, noise)
    model, other, union = np.empty(5), np.empty(5), np.empty(5)
    while len(bounds) > 2:
        for _ in range(NUM_SWEEPS):
            _settle(before, bounds)
        # the least sure break is dropped first, as its pieces then tell more of the next one
        result = np.empty((len(bounds) - 2, 3))
        weakest, least = -1, 1.0
        for k in range(len(result)):
            first, cut, last = bounds[k], bounds[k + 1], bounds[k + 2]
            error = _solve(before, first, cut, model) + _solve(before, cut, last, other)
            count = before[last, 0] - before[first, 0]
            scatter = math.sqrt(error / max(count - 10.0, 1.0))
            at = _crossing(model, other, cut * CELL)
            kink = (other[1] + 2.0 * other[2] * at) - (model[1] + 2.0 * model[2] * at)
            turn = math.atan(other[4] - model[4])
            left, right = (cut - first) * CELL, (last - cut) * CELL
            spread = 1.0 / ((before[cut, 0] - before[first, 0]) * left**2)
            spread += 1.0 / ((before[last, 0] - before[cut, 0]) * right**2)
            kink_limit = MIN_KINK + 4.0 * scatter * math.sqrt(192.0 * spread)
            turn_limit = MIN_KINK + 4.0 * scatter * math.sqrt(12.0 * spread)
            result[k, 0], result[k, 1], result[k, 2] = at + low, kink, turn
            growth = max(_solve(before, first, last, union) - error, 0.0)
            # what a catenary differs from a parabola by, at the ends of both pieces
            bend = abs(2.0 * union[2]) ** 3 * (left + right) ** 4 / 384.0
            sure = max(
                abs(kink) / kink_limit, abs(turn) / turn_limit,
                math.sqrt(growth / count) / (MAX_MISFIT + 0.5 * bend),
            )
            if sure < least:
                weakest, least = k, sure
        if weakest < 0:
            return result
        bounds = np.concatenate((bounds[: weakest + 1], bounds[weakest + 2 :]))
    return np.empty((0, 3))


@njit(cache=True, nogil=True, error_model='numpy')
def _add_up(x, y, z):  # type: ignore[no-untyped-def]
    """
    Add up the points before each cell, from the first cell of its block on.

    Those of powers of x are about the middle of the block; the first are the points of the whole
    track before the cell.
    """
    num = int(x.max() / CELL) + 1
    before = np.zeros((num + 1, SUMS))
    for k in range(len(x)):
        cell = int(x[k] / CELL)
        middle = (cell // BLOCK + 0.5) * BLOCK * CELL
        _add(before[cell + 1], x[k] - middle, y[k], z[k])
    for cell in range(num):
        for m in range(SUMS if cell % BLOCK else 1):
            before[cell + 1, m] += before[cell, m]
    return before


@njit(cache=True, nogil=True, error_model='numpy')
def _cut_evenly(before):  # type: ignore[no-untyped-def]
    """Bounds of the shortest pieces that are long and full enough, in cells."""
    num = len(before) - 1
    least = math.ceil(MIN_SIDE / CELL)
    bounds = np.empty(num // least + 2, dtype=np.int64)
    bounds[0] = 0
    count = 1
    for cell in range(1, num + 1):
        last = bounds[count - 1]
        full = before[cell, 0] - before[last, 0] >= MIN_SIDE_POINTS
        rest = before[num, 0] - before[cell, 0] >= MIN_SIDE_POINTS and num - cell >= least
        if cell - last >= least and full and rest:
            bounds[count] = cell
            count += 1
    bounds[count] = num
    return bounds[: count + 1].copy()


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_noise(before, bounds):  # type: ignore[no-untyped-def]
    """Variance of the points about the shortest pieces: the median of the pieces."""
    model = np.empty(5)
    variance = np.empty(len(bounds) - 1)
    for k in range(len(variance)):
        count = before[bounds[k + 1], 0] - before[bounds[k], 0]
        error = _solve(before, bounds[k], bounds[k + 1], model)
        variance[k] = error / max(count - 5.0, 1.0)
    return np.median(variance)


@njit(cache=True, nogil=True, error_model='numpy')
def _merge(before, bounds, noise):  # type: ignore[no-untyped-def]
    """Merge neighbours, the most alike first, while one piece explains both."""
    num = len(bounds) - 1
    bounds = bounds.copy()
    model = np.empty(5)
    error = np.empty(num)
    for k in range(num):
        error[k] = _solve(before, bounds[k], bounds[k + 1], model)
    union = np.empty(max(num - 1, 0))
    for k in range(num - 1):
        union[k] = _solve(before, bounds[k], bounds[k + 2], model)
    while num > 1:
        best, least = -1, MERGE_COST * noise
        for k in range(num - 1):
            growth = union[k] - error[k] - error[k + 1]
            if growth < least:
                best, least = k, growth
        if best < 0:
            break
        error[best] = union[best]
        for k in range(best + 1, num - 1):
            error[k] = error[k + 1]
        for k in range(best + 1, num):
            bounds[k] = bounds[k + 1]
        for k in range(best, num - 2):
            union[k] = union[k + 1]
        num -= 1
        for k in range(max(best - 1, 0), min(best + 1, num - 1)):
            union[k] = _solve(before, bounds[k], bounds[k + 2], model)
    return bounds[: num + 1].copy()


@njit(cache=True, nogil=True, error_model='numpy')
def _settle(before, bounds):  # type: ignore[no-untyped-def]
    """Move each inner bound, in place, to where both its pieces fit best."""
    model = np.empty(5)
    least = math.ceil(MIN_SIDE / CELL)
    for k in range(1, len(bounds) - 1):
        first, last = bounds[k - 1], bounds[k + 1]
        best, place, tried = np.inf, bounds[k], -1.0
        for cut in range(first + least, last - least + 1):
            if before[cut, 0] == tried:
                continue  # an empty cell before it parts the points alike, up to rounding
            tried = before[cut, 0]
            if (
                before[cut, 0] - before[first, 0] < MIN_SIDE_POINTS
                or before[last, 0] - before[cut, 0] < MIN_SIDE_POINTS
            ):
                continue
            error = _solve(before, first, cut, model) + _solve(before, cut, last, model)
            if error < best:
                best, place = error, cut
        bounds[k] = place


@njit(cache=True, nogil=True, error_model='numpy')
def _crossing(left, right, near):  # type: ignore[no-untyped-def]
    """Where the two parabolas meet within a cell of ``near``; ``near`` if they do not."""
    d0, d1, d2 = right[0] - left[0], right[1] - left[1], right[2] - left[2]
    if abs(d2) > ALIKE:
        inside = d1 * d1 - 4.0 * d2 * d0
        if inside < 0.0:
            return near
        q = -0.5 * (d1 + math.copysign(math.sqrt(inside), d1))
        meet, other = (q / d2, d0 / q) if q != 0.0 else (0.0, 0.0)
        if abs(other - near) < abs(meet - near):
            meet = other
    else:
        meet = -d0 / d1 if d1 != 0.0 else near
    return meet if abs(meet - near) <= 2.0 * CELL else near


@njit(cache=True, nogil=True, error_model='numpy')
def _solve(before, first, last, model):  # type: ignore[no-untyped-def]
    """
    Least-squares parabola in z and line in y of the points of some cells.

    Sums are of 1, t, t2, t3, t4, z, zt, zt2, zz, y, yt, yy.  Returned is the squared error;
    ``model`` takes the three coefficients of the parabola and the two of the line, in x.
    """
    s0 = before[last, 0] - before[first, 0]
    if s0 <= 0.0:
        model[:] = 0.0
        return 0.0
    # moments about the middle of the piece, from those of the blocks that it lies in
    middle = 0.5 * (first + last) * CELL
    r1 = r2 = r3 = r4 = z0 = q1 = q2 = zz = y0 = p1 = yy = 0.0
    for block in range(first // BLOCK, (last - 1) // BLOCK + 1):
        start = max(first, block * BLOCK)
        left, right = before[start], before[min(last, (block + 1) * BLOCK)]
        less = 1.0 if start > block * BLOCK else 0.0  # its sums begin with the block
        d = (block + 0.5) * BLOCK * CELL - middle
        n, t1, t2 = right[0] - left[0], right[1] - less * left[1], right[2] - less * left[2]
        t3, t4 = right[3] - less * left[3], right[4] - less * left[4]
        r1 += t1 + d * n
        r2 += t2 + d * (2.0 * t1 + d * n)
        r3 += t3 + d * (3.0 * t2 + d * (3.0 * t1 + d * n))
        r4 += t4 + d * (4.0 * t3 + d * (6.0 * t2 + d * (4.0 * t1 + d * n)))
        v0, v1 = right[5] - less * left[5], right[6] - less * left[6]
        z0, q1 = z0 + v0, q1 + v1 + d * v0
        q2 += right[7] - less * left[7] + d * (2.0 * v1 + d * v0)
        zz += right[8] - less * left[8]
        u0 = right[9] - less * left[9]
        y0, p1 = y0 + u0, p1 + right[10] - less * left[10] + d * u0
        yy += right[11] - less * left[11]
    # and about the mean x of its points
    m = r1 / s0
    s2 = r2 - m * m * s0
    s3 = r3 - 3.0 * m * r2 + 2.0 * m**3 * s0
    s4 = r4 - 4.0 * m * r3 + 6.0 * m * m * r2 - 3.0 * m**4 * s0
    z1, z2, y1 = q1 - m * z0, q2 - 2.0 * m * q1 + m * m * z0, p1 - m * y0
    # z = a + b t + c (t2 - s2/s0): orthogonal but for b and c
    zc, s4 = z2 - s2 / s0 * z0, s4 - s2 * s2 / s0
    s2, s4 = s2 + 1e-9 * s0, s4 + 1e-9 * s0
    determinant = s2 * s4 - s3 * s3
    if determinant <= 0.0:
        model[:] = 0.0
        return np.inf
    b = (s4 * z1 - s3 * zc) / determinant
    c = (s2 * zc - s3 * z1) / determinant
    error = max(zz - z0 * z0 / s0 - b * z1 - c * zc, 0.0)
    slope = y1 / s2
    error += max(yy - y0 * y0 / s0 - slope * y1, 0.0)
    a = z0 / s0 - c * s2 / s0
    m += middle
    model[0], model[1], model[2] = a - b * m + c * m * m, b - 2.0 * c * m, c
    model[3], model[4] = y0 / s0 - slope * m, slope
    return error


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
