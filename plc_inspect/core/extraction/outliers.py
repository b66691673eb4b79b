# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Statistical outlier removal."""

from dataclasses import dataclass

from numba import njit, prange
import numpy as np

from plc_inspect.config import OutlierSettings
from plc_inspect.core.numerics.arrays import NUM_PARTS
from plc_inspect.core.numerics.plan_index import build_plan_index
from plc_inspect.results import Bool, Float64

CELL = 1.0
"""
Edge of the plan cells of the index of positions [m].
Source: numerical: the search is exact; time alone depends on it.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OutlierResult:
    """Which of M positions have neighbours as near as usual."""

    keep: Bool
    """(M,) True for inliers."""
    mean: float
    """Mean over all positions of the mean distance to the neighbours [m]."""
    sigma: float
    """Standard deviation of these mean distances [m]."""
    threshold: float
    """Greatest mean distance of an inlier [m]."""


def remove_outliers(
    positions: Float64, settings: OutlierSettings, usual: tuple[float, float] | None = None
) -> OutlierResult:
    """
    Remove positions whose mean distance to their neighbours is unusually great.

    The mean distance to the ``num_neighbors`` nearest others is compared with mean + ``sigma``
    standard deviations over the whole set (Shi et al. 2018, cited by the paper).  A set with too
    few positions is kept whole, unless it is a part of a larger one: neighbours that it lacks
    then count as too far away.  O(M) for positions spread over the plan.

    Parameters
    ----------
    positions : (M, 3) float64
        Coordinates [m].
    settings : OutlierSettings
        Settings of this stage.
    usual : tuple of float or None
        Mean and standard deviation of the whole set, if these positions are a part of one [m].

    Returns
    -------
    OutlierResult

    """
    num = settings.num_neighbors
    if len(positions) <= num and usual is None:
        keep = np.ones(len(positions), dtype=bool)
        return OutlierResult(keep=keep, mean=0.0, sigma=0.0, threshold=np.inf)
    average = measure_spacing(positions, num)
    mean, sigma = usual or (float(average.mean()), float(average.std()))
    threshold = mean + settings.sigma * sigma
    return OutlierResult(keep=average <= threshold, mean=mean, sigma=sigma, threshold=threshold)


def measure_spacing(positions: Float64, num: int) -> Float64:
    """Return the (M,) mean distance of each position to its ``num`` nearest others [m]."""
    index = build_plan_index(positions, np.arange(len(positions)), CELL)
    average = np.empty(len(positions))
    average[index.order] = _measure_averages(
        np.ascontiguousarray(positions[index.order].T), index.start, index.origin,
        index.cell_size, index.shape[0], index.shape[1], num,
    )
    return average


@njit(cache=True, parallel=True, nogil=True, error_model='numpy')
def _measure_averages(places, start, origin, cell, rows, columns, num):  # type: ignore[no-untyped-def]
    """
    Return the mean distance of (3, M) places, sorted by plan cell, to their nearest others.

    Each searches a square of cells about its own, and doubles it while neighbours may lie beyond
    its edge.  The cells of a row are next to each other.
    """
    x, y, z = places[0], places[1], places[2]
    result = np.empty(len(x))
    for part in prange(NUM_PARTS):
        nearest = np.empty(num + 1)
        for i in range(part * len(x) // NUM_PARTS, (part + 1) * len(x) // NUM_PARTS):
            row, column = int((y[i] - origin[1]) / cell), int((x[i] - origin[0]) / cell)
            reach = 1
            while True:
                low, high = max(row - reach, 0), min(row + reach + 1, rows)
                left, right = max(column - reach, 0), min(column + reach + 1, columns)
                nearest[:] = np.inf
                for other in range(low, high):
                    first, last = start[other * columns + left], start[other * columns + right]
                    _keep_nearest(
                        x[first:last], y[first:last], z[first:last], x[i], y[i], z[i], nearest
                    )
                is_all = low == 0 and left == 0 and high == rows and right == columns
                if nearest[num] <= (reach * cell) ** 2 or is_all:
                    break
                reach *= 2
            result[i] = np.sqrt(nearest[1:]).sum() / num  # the first is the place itself
    return result


@njit(cache=True, nogil=True)
def _keep_nearest(x, y, z, x0, y0, z0, nearest):  # type: ignore[no-untyped-def]
    """Insert squared distances into ``nearest``, the least so far, ascending."""
    for m in range(len(x)):
        value = (x[m] - x0) ** 2 + (y[m] - y0) ** 2 + (z[m] - z0) ** 2
        if value < nearest[-1]:
            k = len(nearest) - 1
            while k > 0 and nearest[k - 1] > value:
                nearest[k] = nearest[k - 1]
                k -= 1
            nearest[k] = value
