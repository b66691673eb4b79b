# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Register points to the reference cells by a shift and a rotation about the vertical."""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.alignment.normal_cells import CELL, NOISE, NormalCells
from plc_inspect.core.alignment.rigid_move import RigidMove
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
    *, coarse: bool = False,
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

    Returns
    -------
    Fit

    """
    known = np.linalg.inv(before)
    move = start
    passes = [(1, COARSE_NOISE), (1, NOISE), (0, NOISE)] if coarse else [(0, NOISE)]
    for reach, noise in passes:
        for _ in range(MOST_STEPS):
            matrix, slope, *_ = cells.compare(points, move, stamp_ns, reach, noise)
            off = np.append(move.shift - start.shift, move.yaw - start.yaw)
            step = np.linalg.solve(matrix / SHARED + known, slope / SHARED - known @ off)
            step = np.clip(step, -CELL, CELL)
            move = RigidMove(move.shift + step[:3], move.yaw + float(step[3]), move.centre)
            if math.hypot(*step[:3]) < SMALL and abs(step[3]) < SMALL / 50.0:
                break
    matrix, _, matched, fitting, age = cells.compare(points, move, stamp_ns, 0)
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
    index = np.floor((points - points.min(axis=0)) / CELL).astype(np.int64)
    size = index.max(axis=0) + 1
    key = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    order = np.argsort(key, kind='stable')
    chosen = order[_take_few(key[order])]
    step = 1 + (len(chosen) - 1) // MOST_SAMPLES
    return points[chosen[::step]]


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
