# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Lines of points that lie too far apart for a neighbourhood, with little else about them.

A wire that returns a point in a metre or two is a line in no block of voxels: one that holds
enough of its points also holds its neighbours.  So it is with scan lines more than a metre apart,
however many points each has of the wire: they are one place.  About each sparse place the
direction is looked for along which a tube of a few decimetres holds other places all along.
"""

import math

from numba import njit
import numpy as np

from plc_inspect.config import LinearitySettings
from plc_inspect.core.extraction.alignment import LINE_RADIUS, NUM_BINS
from plc_inspect.core.extraction.linearity import LinearityResult, Scales
from plc_inspect.core.numerics.arrays import count_bits
from plc_inspect.core.numerics.eigen import principal_axis_of
from plc_inspect.core.numerics.hash_table import find_slot
from plc_inspect.core.numerics.plan_index import build_plan_index
from plc_inspect.core.numerics.voxels import NUM_MOMENTS, pack
from plc_inspect.results import Float64, Int64

BLOCK = 3
"""Voxels along the edge of a block.  Source: derived: that of `linearity.Likeness`."""
MOST_FILLED = 6
"""
Parts of a block, half as long as its voxels, that hold points about a sparse place, at most.
Source: derived: steps of half a metre fill six at most; so does a wire without gaps along the
blocks, which is known by then.  With 8 a cloud of 10 million points took 45 ms longer.
"""
REACH = 8.0
"""
Distance from a place up to which others are looked at [m].
Source: derived: as `alignment.reach`, over which a conductor is straight; with 12 m no more was
found in thinned clouds (ahn_12AN2_20, ahn_12BZ1_21 and uav_costarica_mv, 4 to 12 % of the points).
"""
BASE = 3.0
"""
Distance of the place that gives the direction of a tube, at least [m].
Source: derived: 5 cm of noise turn it by less than LINE_RADIUS over the reach.
"""
MOST_NEAR = 128
"""
Places within reach, at most: about others there is no air.
Source: derived: eight wires with a place in every metre; also a bound of time.
"""


def list_places(scales: Scales) -> tuple[Float64, Int64]:
    """
    Return the places of a cloud, and which have few others close by.

    Parameters
    ----------
    scales : Scales
        Neighbourhoods of the high points.

    Returns
    -------
    position : (M, 3) float64
        Mean of the points of each voxel [m].
    sparse : (S,) int64
        Numbers of those that are sparse; none where no finer voxels are known.

    """
    voxels, fine = (scales.levels[max(len(scales.levels) - k, 0)][0] for k in (2, 3))
    if voxels is fine:
        return voxels.centroids(), np.empty(0, dtype=np.int64)
    sparse = np.flatnonzero(_are_sparse(
        voxels.index, voxels.key, voxels.table, fine.index, round(voxels.size / fine.size)
    ))
    return voxels.centroids(), sparse


def find_sparse_lines(
    position: Float64, sparse: Int64, settings: LinearitySettings, min_votes: int
) -> LinearityResult:
    """
    Find sparse places with others in line.

    Parameters
    ----------
    position : (M, 3) float64
        All places [m].
    sparse : (S,) int64
        Numbers of those about which is looked.
    settings : LinearitySettings
        The greatest inclination is used.
    min_votes : int
        Parts of the tube, of NUM_BINS, that hold others, at least.

    Returns
    -------
    LinearityResult
        Sparse places with the directions of their tubes.

    """
    index = build_plan_index(position, np.arange(len(position)), REACH)
    steepest = math.tan(math.radians(settings.max_inclination_deg))
    count, direction = _look_about(position, sparse, index.grid, steepest, min_votes)
    good = count > 0
    return LinearityResult(
        position=position[sparse[good]],
        direction=direction[good],
        size=np.full(int(good.sum()), 2.0 * REACH),
        linear=np.ones(int(good.sum())),
        count=count[good],
        sizes=(2.0 * REACH,),
        num_voxels=(len(position),),
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _are_sparse(index, key, table, fine, parts):  # type: ignore[no-untyped-def]
    """Tell about which voxels few parts of a block are filled; ``fine`` are those that are."""
    filled = np.zeros(len(index), dtype=np.int64)
    for k in range(len(fine)):
        filled[find_slot(
            pack(fine[k, 0] // parts, fine[k, 1] // parts, fine[k, 2] // parts), table, key
        )] += 1
    result = np.ones(len(index), dtype=np.bool_)
    for k in range(len(index)):
        num = 0
        for part in range(BLOCK**3):
            slot = find_slot(
                pack(
                    index[k, 0] + part // BLOCK**2 - 1,
                    index[k, 1] + part // BLOCK % BLOCK - 1,
                    index[k, 2] + part % BLOCK - 1,
                ), table, key,
            )
            if slot >= 0:
                num += filled[slot]
            if num > MOST_FILLED:
                result[k] = False
                break
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _look_about(position, sparse, grid, steepest, min_votes):  # type: ignore[no-untyped-def]
    """Count the places in the fullest tube about each sparse one, 0 for none, and its axis."""
    count, direction = np.zeros(len(sparse), dtype=np.int64), np.zeros((len(sparse), 3))
    near = np.empty((MOST_NEAR, 3))
    for k in range(len(sparse)):
        num = _gather(position, position[sparse[k]], grid, near)
        if min_votes <= num <= MOST_NEAR:
            axis, votes = _find_tube(near[:num], steepest)
            if votes >= min_votes:
                count[k], direction[k] = _fit_axis(near[:num], axis)
    return count, direction


@njit(cache=True, nogil=True, error_model='numpy')
def _gather(position, middle, grid, near):  # type: ignore[no-untyped-def]
    """List places within REACH of a middle, from there; return how many, or one too many."""
    start, order, origin, cell, rows, columns = grid
    row, column = int((middle[1] - origin[1]) / cell), int((middle[0] - origin[0]) / cell)
    num = 0
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        first = start[r * columns + max(column - 1, 0)]
        last = start[r * columns + min(column + 1, columns - 1) + 1]
        for m in range(first, last):
            i = order[m]
            x, y = position[i, 0] - middle[0], position[i, 1] - middle[1]
            z = position[i, 2] - middle[2]
            if x * x + y * y + z * z < REACH * REACH:
                if num == MOST_NEAR:
                    return num + 1
                near[num, 0], near[num, 1], near[num, 2] = x, y, z
                num += 1
    return num


@njit(cache=True, nogil=True, error_model='numpy')
def _find_tube(near, steepest):  # type: ignore[no-untyped-def]
    """Return the axis of the tube with most parts that hold places, and how many these are."""
    best, most, votes = np.zeros(3), 0, 0
    for k in range(len(near)):
        run = math.hypot(near[k, 0], near[k, 1])
        if run < BASE or abs(near[k, 2]) > steepest * run:
            continue
        axis = near[k] / math.hypot(run, near[k, 2])
        occupied, num = np.uint32(0), 0
        for m in range(len(near)):
            along, off = _see(near, m, axis)
            if off <= LINE_RADIUS * LINE_RADIUS:
                place = min(int((along + REACH) * NUM_BINS / (2.0 * REACH)), NUM_BINS - 1)
                occupied |= np.uint32(1) << np.uint32(place)
                num += 1
        seen = count_bits(occupied)
        if (seen, num) > (votes, most):
            best, most, votes = axis, num, seen
    return best, votes


@njit(cache=True, nogil=True, error_model='numpy')
def _fit_axis(near, axis):  # type: ignore[no-untyped-def]
    """Return how many places the tube about an axis holds, and the axis that is fitted to them."""
    total = np.zeros(NUM_MOMENTS)
    for k in range(len(near)):
        _, off = _see(near, k, axis)
        if off <= LINE_RADIUS * LINE_RADIUS:
            x, y, z = near[k]
            for m, value in enumerate((1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z)):
                total[m] += value
    _, _, _, vx, vy, vz = principal_axis_of(total, 0, 1)
    return int(total[0]), np.array([vx, vy, vz])


@njit(cache=True, nogil=True, error_model='numpy', inline='always')
def _see(near, k, axis):  # type: ignore[no-untyped-def]
    """Return how far a place lies along an axis [m], and the square of how far aside [m2]."""
    x, y, z = near[k, 0], near[k, 1], near[k, 2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    return along, x * x + y * y + z * z - along * along
