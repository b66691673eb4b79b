# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Register points to the reference cells by a shift and a rotation about the vertical."""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.alignment.cell_comparison import CELL, compare_cells, PASS_NS
from plc_inspect.core.alignment.normal_cells import NOISE, NormalCells
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.core.numerics.cell_sums import pack_cells
from plc_inspect.results import Float64, Int64

MOST_STEPS = 12
"""Most Gauss-Newton steps.  Source: numerical: 4 to 6 lead to less than 1 mm."""
SMALL = 1e-3
"""Step length that ends the iteration [m].  Source: numerical."""
SHARED = 6.0
"""
Points that count as one independent measurement, as the errors within a cell are correlated.
Source: judgement; the sampling takes up to three a cell.
"""
BASIN = 0.25
"""
Predicted drift from which points are also compared as without any [m].
Source: derived: a quarter of a cell; from farther a search may end on other things.
"""
SAMPLES = 3
"""Most points of a batch taken from one cell.  Source: judgement."""
MOST_SAMPLES = 1500
"""Most points of a batch that are compared.  Source: numerical: a comparison takes 0.3 ms."""
FEW_SAMPLES = 500
"""Most points for which the turn is searched.  Source: numerical: 3 ms."""
COARSE_NOISE = 0.5
"""
Standard deviation of a point in the coarse search [m].
Source: derived: half a cell.
"""
PASSES = (1, COARSE_NOISE), (1, NOISE), (0, NOISE)
"""
Cells on each side that are searched, and standard deviation of a point [m], in turn.
Source: judgement; not measured.
"""
FREE_TURN = 0.2
"""
Standard deviation of the turn where nothing is known of it [rad].
Source: judgement: 3 degrees/s for four seconds.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """The result of a registration."""

    move: RigidMove
    covariance: Float64
    """(4, 4) of shift and turn [m2, rad2], prior included."""
    matched: int
    """Points that have a cell."""
    fitting: int
    """Points that fit their cell."""
    age: float
    """Mean age of those cells [s]."""

    @property
    def share(self) -> float:
        """Share of the matched points that fit."""
        return self.fitting / max(self.matched, 1)


def fit_points(
    cells: NormalCells, points: Float64, start: RigidMove, before: Float64, stamp_ns: int,
    *, coarse: bool = False, held: RigidMove | None = None,
) -> Fit:
    """
    Return the most likely move of points, given the prior and the cells.

    Parameters
    ----------
    cells : NormalCells
        The reference.
    points : Float64
        (N, 3) frame of the odometry [m].
    start : RigidMove
        Prior, with the vehicle as its centre.
    before : Float64
        (4, 4) covariance of its shift and turn [m2, rad2].
    stamp_ns : int
        Of the points [ns].
    coarse : bool
        Search neighbouring cells first.
    held : RigidMove or None
        A move from which the search begins as well, if the prior lies far from it; what fits more
        points is returned.

    Returns
    -------
    Fit

    """
    points = np.ascontiguousarray(points)
    prior = np.append(start.shift, start.yaw)
    best = _fit_from(np.zeros(4), cells, points, start, before, stamp_ns, coarse)
    if held is not None:
        near = held.about(start.centre)
        off = np.append(near.shift, near.yaw) - prior
        if np.linalg.norm(off[:3]) > BASIN:
            other = _fit_from(off, cells, points, start, before, stamp_ns, coarse)
            best = other if other.fitting > best.fitting else best
    return best


def _fit_from(
    off: Float64, cells: NormalCells, points: Float64, start: RigidMove, before: Float64,
    stamp_ns: int, coarse: bool,
) -> Fit:
    """Search from so far off the prior, (4,) shift and turn [m, rad]; it is changed."""
    known, prior = np.linalg.inv(before), np.append(start.shift, start.yaw)
    centre, tables = np.array(start.centre), cells.tables(stamp_ns)
    within = 0 if coarse else PASS_NS  # after a break either side tells where the vehicle is
    for reach, noise in PASSES if coarse else PASSES[-1:]:
        _approach(  # SHARED points weigh as one beside the prior
            points, prior, centre, off, SHARED * known, *tables, stamp_ns, reach, noise * noise,
            within,
        )
    now = prior + off
    move = RigidMove(now[:3], float(now[3]), start.centre)
    matrix, _, matched, fitting, age = cells.compare(points, move, stamp_ns, 0, within=within)
    return Fit(
        move=move, covariance=np.linalg.inv(matrix / SHARED + known), matched=matched,
        fitting=fitting, age=age,
    )


def fit_heading(
    cells: NormalCells, points: Float64, start: RigidMove, before: Float64, stamp_ns: int
) -> Fit:
    """
    Return the most likely move of points if nothing is known of their turn.

    What is known of the shift and of a good heading would call a heading that turns a shift.
    Arguments and result are those of ``fit_points``.
    """
    free = before.copy()
    free[3], free[:, 3] = 0.0, 0.0
    free[3, 3] = FREE_TURN**2
    few = points[:: 1 + len(points) // FEW_SAMPLES]
    return fit_points(cells, few, start, free, stamp_ns, coarse=True)


def sample_points(points: Float64) -> Float64:
    """
    Thin points to a few in each cell, and to MOST_SAMPLES, evenly.

    Parameters
    ----------
    points : Float64
        (N, 3) [m].

    Returns
    -------
    Float64
        (M, 3).

    """
    if not len(points):
        return points
    key = pack_cells(np.floor((points - points.min(axis=0)) / CELL).astype(np.int64))
    order = np.argsort(key, kind='stable')
    chosen = order[_take_few(key[order])]
    step = 1 + (len(chosen) - 1) // MOST_SAMPLES
    return points[chosen[::step]]


@njit(cache=True, nogil=True)
def _approach(  # type: ignore[no-untyped-def]
    points, prior, centre, off, known, origin, keys, sums, counts, times, table, stamp, reach,
    floor, within,
):
    """
    Move points onto the cells by Gauss-Newton steps; ``off`` is added to the shift and the turn.

    All steps are one call: while a callback waits for Python's lock, the worker may hold it.
    """
    moved, about = np.empty_like(points), np.empty(3)
    for _ in range(MOST_STEPS):
        # by the turn about the vertical through the centre, and the shift
        cos, sin = math.cos(prior[3] + off[3]), math.sin(prior[3] + off[3])
        for p in range(3):
            about[p] = centre[p] + prior[p] + off[p] - origin[p]
        for n in range(len(points)):
            x, y = points[n, 0] - centre[0], points[n, 1] - centre[1]
            moved[n, 0] = cos * x - sin * y + about[0]
            moved[n, 1] = sin * x + cos * y + about[1]
            moved[n, 2] = points[n, 2] - centre[2] + about[2]
        matrix, slope, _, _, _ = compare_cells(
            moved, about, keys, sums, counts, times, table, stamp, reach, floor, within
        )
        for p in range(4):
            for q in range(4):
                slope[p] -= known[p, q] * off[q]
                matrix[p, q] += known[p, q]
        _solve(matrix, slope)
        for p in range(4):
            slope[p] = min(max(slope[p], -CELL), CELL)
            off[p] += slope[p]
        size = math.sqrt(slope[0] ** 2 + slope[1] ** 2 + slope[2] ** 2)
        if size < SMALL and abs(slope[3]) < SMALL / 50.0:
            break


@njit(cache=True, nogil=True)
def _solve(matrix, right):  # type: ignore[no-untyped-def]
    """Solve in place; the matrix is symmetric and positive definite, so that no pivot is 0."""
    num = len(right)
    for k in range(num):
        for p in range(k + 1, num):
            factor = matrix[p, k] / matrix[k, k]
            for q in range(k, num):
                matrix[p, q] -= factor * matrix[k, q]
            right[p] -= factor * right[k]
    for k in range(num - 1, -1, -1):
        for q in range(k + 1, num):
            right[k] -= matrix[k, q] * right[q]
        right[k] /= matrix[k, k]


@njit(cache=True, nogil=True)
def _take_few(keys: Int64):  # type: ignore[no-untyped-def]
    """Return up to SAMPLES places, apart from each other, in each run of equal keys."""
    out = np.empty(len(keys), dtype=np.int64)
    num, start = 0, 0
    for n in range(1, len(keys) + 1):
        if n < len(keys) and keys[n] == keys[start]:
            continue
        count = n - start
        for m in range(min(count, SAMPLES)):
            out[num] = start + (m * count) // SAMPLES if count > SAMPLES else start + m
            num += 1
        start = n
    return out[:num]
