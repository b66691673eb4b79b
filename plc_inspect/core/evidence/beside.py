# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Tracks beside conductors that were found, of what was not found by itself.

Conductors of a line hang side by side, so one that is known gives the direction of the others;
the points of a sparse or blurred one do not.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import Curve, pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    height_of,
    HIGH,
    LOW,
    ORIGIN_X,
    ORIGIN_Y,
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
from plc_inspect.core.numerics.plan_index import build_plan_index, gather_strip
from plc_inspect.core.numerics.voxels import build_voxels, find_voxels

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
PLACE = 1.0
"""
Edge of the cubes whose points are one candidate [m].
Source: judgement: as the cells of a point's decision; scan lines are up to 1.5 m apart.
"""
OWN = -2
"""Owner of the points on a conductor.  Source: numerical: none has this number."""


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
    index = cloud.index_high()
    owner = _find_owners(cloud.points, *index.grid, pack_curves([*curves, *others]), len(curves))
    chosen = np.flatnonzero(owner >= 0)
    low = find_lowest(cloud.points, chosen) if len(chosen) else np.zeros(3)
    corner = np.floor(low / PLACE) * PLACE
    chosen = drop_bulk(cloud.points, chosen, corner, settings.linearity.max_occupied)
    voxels = build_voxels(cloud.points, chosen, corner, PLACE)
    number = np.zeros(len(voxels), dtype=np.int64)
    number[find_voxels(cloud.points, chosen, voxels)] = owner[chosen]
    position = voxels.centroids()
    candidates = LinearityResult(
        position=position,
        direction=_find_directions(position, number, pack_curves(curves)),
        size=np.full(len(voxels), PLACE),
        linear=np.ones(len(voxels)),
        count=voxels.moments[:, 0].astype(np.int64),
        sizes=(PLACE,),
        num_voxels=(len(voxels),),
    )
    return cluster(
        cloud.points, build_plan_index(cloud.points, chosen, index.cell_size, index.origin),
        position, align(candidates, settings.alignment), settings.clustering,
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _find_owners(  # type: ignore[no-untyped-def]
    points, start, order, origin, cell, rows, columns, curves, num_known
):
    """
    Return the nearest known curve about each point, -1 where there is none.

    The first curves are known; points on any have the owner OWN.
    """
    owner = np.full(len(points), -1, dtype=np.int32)
    best = np.full(len(points), np.inf)
    for k in range(len(curves)):
        row = curves[k]
        reach, beyond = (REACH, BEYOND) if k < num_known else (row[TOLERANCE], 0.0)
        low, high = row[LOW] - beyond, row[HIGH] + beyond
        near = gather_strip(
            start, order, origin, cell, rows, columns,
            row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
            row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, reach,
        )
        for item in near:
            x, y = to_local(row, points[item, 0], points[item, 1])
            if owner[item] == OWN or abs(y) > reach or x < low or x > high:
                continue
            above = points[item, 2] - height_of(row, x)
            away = math.hypot(y, above)
            if away <= row[TOLERANCE] and row[LOW] <= x <= row[HIGH]:
                owner[item] = OWN
            elif abs(above) <= reach and away < best[item] and k < num_known:
                owner[item], best[item] = k, away
    return owner


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
