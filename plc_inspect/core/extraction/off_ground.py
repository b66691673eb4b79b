# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The points off the ground, sorted by plan cell: the cloud that is searched for wires."""

from dataclasses import dataclass, replace

from numba import njit, prange
import numpy as np

from plc_inspect.core.extraction.height import HeightResult
from plc_inspect.core.numerics.arrays import find_true
from plc_inspect.core.numerics.plan_index import build_plan_index, PlanIndex
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64

CELL = 2.0
"""
Edge of the plan cells [m].
Source: numerical: searches are exact; time and the order of points depend on it.
"""

LEAST_AIRBORNE = 0.5
"""
Height from which points near a conductor that comes down to the ground are off it [m].
Source: as labels.GROUND_BAND.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OffGround:
    """
    The K points off the ground of a cloud of N.

    Neighbours in space are neighbours in memory here, so that searches along conductors read few
    places, and what is counted point by point is counted over K.
    """

    points: Float64
    """(K, 3) [m]"""
    place: Int32
    """(K,) their indices in the cloud."""
    num_total: int
    """N, number of points of the cloud."""
    least: float
    """Least height above the ground, unless high or near a low conductor [m]."""
    high: Int64
    """Indices, ascending, of the high points among these, which are searched for wires."""
    height: HeightResult
    """The result of the height stage, with ``height`` and ``high`` of these points."""
    index: PlanIndex
    """Index of these points by plan cell."""

    def index_high(self) -> PlanIndex:
        """Return the index of the high points alone, with the same cells."""
        return replace(
            self.index,
            start=_count_before(self.high, self.index.start),
            order=self.high.astype(np.int32),
        )

    def scatter(self, values: np.ndarray, elsewhere: float) -> np.ndarray:
        """
        Return values for the whole cloud from (K,) values of these points.

        Returns
        -------
        (N,) array of the same dtype, ``elsewhere`` for all other points

        """
        result = np.empty(self.num_total, dtype=values.dtype)
        _scatter(values, self.place, values.dtype.type(elsewhere), result)
        return result


def gather_off_ground(
    points: Float64, height: HeightResult, least: float, anchor: Float64 | None = None
) -> OffGround:
    """
    Copy the points off the ground, sorted by plan cell; O(N).

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    height : HeightResult
        Of these points.
    least : float
        Height from which points are off the ground; high points always are, and airborne ones
        from LEAST_AIRBORNE on [m].
    anchor : (2,) float64 or None
        A corner of the plan cells, if these points are a part of a cloud [m].

    Returns
    -------
    OffGround

    """
    is_off = _are_off(height.height, height.high, least)
    if height.airborne is not None:
        is_off |= height.airborne & (height.height >= LEAST_AIRBORNE)
    off = find_true(is_off)
    index = build_plan_index(points, off, CELL, anchor)
    own, own_height, is_high = _take(points, height.height, height.high, index.order)
    return OffGround(
        points=own,
        place=index.order,
        num_total=len(points),
        least=least,
        high=find_true(is_high),
        height=replace(height, height=own_height, high=is_high, airborne=None),
        index=replace(index, order=np.arange(len(own), dtype=np.int32)),
    )


def _take(
    points: Float64, height: Float32, high: Bool, chosen: Int32
) -> tuple[Float64, Float32, Bool]:
    """Return the chosen points, in the given order, with their heights [m]."""
    # allocated here, not in the kernel: numpy asks for large pages of memory
    num = len(chosen)
    rows = np.empty((num, 3)), np.empty(num, dtype=np.float32), np.empty(num, dtype=np.bool_)
    _copy(points, height, high, chosen, *rows)
    return rows


@njit(cache=True, nogil=True)
def _count_before(numbers, limits):  # type: ignore[no-untyped-def]
    """Count the ascending numbers below each of the ascending limits."""
    result = np.empty(len(limits), dtype=np.int32)
    count = 0
    for k in range(len(limits)):
        while count < len(numbers) and numbers[count] < limits[k]:
            count += 1
        result[k] = count
    return result


@njit(cache=True, parallel=True, nogil=True)
def _are_off(height, high, least):  # type: ignore[no-untyped-def]
    """Tell the points off the ground."""
    result = np.empty(len(height), dtype=np.bool_)
    for i in prange(len(height)):
        result[i] = high[i] | (height[i] >= least)
    return result


@njit(cache=True, parallel=True, nogil=True)
def _copy(points, height, high, chosen, own, own_height, is_high):  # type: ignore[no-untyped-def]
    for k in prange(len(chosen)):
        i = chosen[k]
        own[k, 0], own[k, 1], own[k, 2] = points[i, 0], points[i, 1], points[i, 2]
        own_height[k], is_high[k] = height[i], high[i]


@njit(cache=True, parallel=True, nogil=True)
def _scatter(values, place, elsewhere, result):  # type: ignore[no-untyped-def]
    for i in prange(len(result)):
        result[i] = elsewhere
    for k in prange(len(values)):
        value = values[k]
        if value != elsewhere and (value == value or elsewhere == elsewhere):  # not NaN over NaN
            result[place[k]] = value
