# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Tracks beside and along curves that were found, of what was not found by itself.

Conductors of a line hang side by side, so one that is known gives the direction of the others;
the points of a sparse or blurred one do not.  A piece of a sparse one gives that of its rest.
"""

from collections.abc import Sequence
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import Curve, pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
    slope_of,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.clustering.clustering import cluster, ClusteringResult
from plc_inspect.core.extraction.alignment import align
from plc_inspect.core.extraction.linearity import find_lowest, LinearityResult
from plc_inspect.core.extraction.occupancy import drop_bulk
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.numerics.arrays import NUM_PARTS
from plc_inspect.core.numerics.plan_index import build_plan_index, gather_strip, PlanIndex
from plc_inspect.core.numerics.voxels import build_voxels
from plc_inspect.results import Bool, Float64, Int32, Int64

REACH = 8.0
"""
Distance across and above a conductor up to which others are looked for [m].
Source: derived: half the width of a tower of high voltage; those farther out are beside others.
"""
BEYOND = 30.0
"""
Length beyond the ends of a conductor along which others are looked for [m].
Source: judgement: as far as a line bends by less than the reach.
"""
ROOM = 1.0
"""
Distance from a curve within which it is searched again [m].
Source: judgement: a curve over several conductors lies within it of each.
"""
PLACE = 1.0
"""
Edge of the cubes whose points are one candidate [m].
Source: judgement: as the cells of a point's decision; scan lines are up to 1.5 m apart.
"""


def search_beside(
    cloud: OffGround, curves: Sequence[Curve], others: Sequence[Curve], settings: Settings
) -> ClusteringResult:
    """
    Cluster the points about conductors anew along their direction, without those on a curve.

    All points about a conductor are candidates for wires that run as it does, whether or not they
    lie along a line.

    Parameters
    ----------
    cloud : OffGround
        Points off the ground; the high ones are searched.
    curves : sequence of Curve
        Conductors.
    others : sequence of Curve
        What has a curve already, and is none.
    settings : Settings
        Of all stages.

    Returns
    -------
    ClusteringResult

    """
    owner, is_own = find_nearest(
        cloud.points, cloud.index_high(), pack_curves([*curves, *others]), len(curves), REACH,
        BEYOND,
    )
    return _cluster_about(
        cloud, curves, np.flatnonzero((owner >= 0) & ~is_own), REACH, settings
    )


def search_along(
    cloud: OffGround, curves: Sequence[Curve], known: Sequence[Curve], settings: Settings
) -> ClusteringResult:
    """
    Cluster the points along curves, their own too, whether or not they lie along a line.

    Parameters
    ----------
    cloud : OffGround
        Points off the ground; the high ones are searched.
    curves : sequence of Curve
        What may be conductors.
    known : sequence of Curve
        Conductors, whose points are left out.
    settings : Settings
        Of all stages.

    Returns
    -------
    ClusteringResult

    """
    index = cloud.index_high()
    owner, _ = find_nearest(
        cloud.points, index, pack_curves(curves), len(curves), ROOM, BEYOND
    )
    _, is_taken = find_nearest(cloud.points, index, pack_curves(known), 0, ROOM, BEYOND)
    return _cluster_about(
        cloud, curves, np.flatnonzero((owner >= 0) & ~is_taken), ROOM, settings
    )


def _cluster_about(
    cloud: OffGround, curves: Sequence[Curve], chosen: Int64, reach: float, settings: Settings
) -> ClusteringResult:
    """Cluster chosen points, as far as they are within reach [m] of curves, along these."""
    index, rows = cloud.index_high(), pack_curves(curves)
    low = find_lowest(cloud.points, chosen) if len(chosen) else np.zeros(3)
    corner = np.floor(low / PLACE) * PLACE
    chosen = drop_bulk(cloud.points, chosen, corner, settings.linearity.max_occupied)
    voxels = build_voxels(cloud.points, chosen, corner, PLACE)
    position = voxels.centroids()
    places = build_plan_index(position, np.arange(len(position)), index.cell_size)
    number, _ = find_nearest(position, places, rows, len(curves), reach, BEYOND)
    near = number >= 0
    position, count = position[near], voxels.moments[near, 0].astype(np.int64)
    candidates = LinearityResult(
        position=position,
        direction=_find_directions(position, number[near], rows),
        size=np.full(len(position), PLACE),
        linear=np.ones(len(position)),
        count=count,
        sizes=(PLACE,),
        num_voxels=(len(position),),
    )
    return cluster(
        cloud.points, build_plan_index(cloud.points, chosen, index.cell_size, index.origin),
        position, align(candidates, settings.alignment), settings.clustering,
    )


def find_nearest(
    points: Float64, index: PlanIndex, curves: Float64, num_known: int, about: float, past: float
) -> tuple[Int32, Bool]:
    """
    Find the nearest known curve about each point, and if the point lies on any curve.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Of those that are looked at.
    curves : (C, ROW) float64
        Rows of `pack_curves`.
    num_known : int
        The first so many are known.
    about, past : float
        How far beside known curves points are, and how far beyond their ends, at most [m].

    Returns
    -------
    owner : (N,) int32
        The nearest known curve, -1 where there is none.
    is_own : (N,) bool
        The point lies on any curve.

    """
    owner, best = np.full(len(points), -1, dtype=np.int32), np.full(len(points), np.inf)
    is_own = np.zeros(len(points), dtype=np.bool_)
    _find_nearest(points, *index.grid, curves, num_known, about, past, owner, is_own, best)
    return owner, is_own


@njit(cache=True, parallel=True, nogil=True, error_model='numpy')
def _find_nearest(  # type: ignore[no-untyped-def]
    points, start, order, origin, cell, rows, columns, curves, num_known, about, past,
    owner, is_own, best,
):
    for part in prange(NUM_PARTS):
        # no two parts have a row of cells in common, and so no point
        first, last = part * rows // NUM_PARTS, (part + 1) * rows // NUM_PARTS
        if first < last:
            corner = np.array([origin[0], origin[1] + first * cell])
            _look_about(
                points, start[first * columns : last * columns + 1], order, corner, cell,
                last - first, columns, curves, num_known, about, past, owner, is_own, best,
            )


@njit(cache=True, nogil=True, error_model='numpy')
def _look_about(  # type: ignore[no-untyped-def]
    points, start, order, origin, cell, rows, columns, curves, num_known, about, past,
    owner, is_own, best,
):
    """Set owners and distances of the points of some rows of cells."""
    for k in range(len(curves)):
        row = curves[k]
        # the outermost points of a curve lie at its ends exactly: no border may be there
        slack = row[TOLERANCE]
        reach, beyond = (about, past) if k < num_known else (slack, slack)
        low, high = row[LOW] - beyond, row[HIGH] + beyond
        near = gather_strip(
            start, order, origin, cell, rows, columns,
            row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
            row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, reach,
        )
        opened = open_row(row)
        for item in near:
            x, y = see_beside(opened, points[item, 0], points[item, 1])
            if abs(y) > reach or x < low or x > high:
                continue
            above, _ = see_above(opened, x, points[item, 2])
            if abs(above) > reach:
                continue
            away = math.hypot(y, above)
            is_own[item] |= away <= slack and row[LOW] - slack <= x <= row[HIGH] + slack
            if away < best[item] and k < num_known:
                owner[item], best[item] = k, away


@njit(cache=True, nogil=True, error_model='numpy')
def _find_directions(position, number, curves):  # type: ignore[no-untyped-def]
    """Return the directions of curves, by their numbers, at places about them."""
    result = np.empty((len(position), 3))
    for k in range(len(position)):
        row = curves[number[k]]
        x, _ = to_local(row, position[k, 0], position[k, 1])
        slope = slope_of(row, min(max(x, row[LOW]), row[HIGH]))
        norm = math.hypot(1.0, slope)
        result[k, 0], result[k, 1], result[k, 2] = row[COS] / norm, row[SIN] / norm, slope / norm
    return result
