# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of voxels: three voxel indices relative to the map's origin, packed into 21 bits each."""

from numba import njit
import numpy as np

from plc_inspect.results import Bool, Float32, Float64, Int64

KEY_BITS = 21
"""Bits of a key for each of three indices.  Source: numerical: three of them fit into int64."""
KEY_HALF_RANGE = 1 << (KEY_BITS - 1)
"""
Voxels from the origin of the keys to the edge of the map, in both directions of each axis.
Source: derived: half the range of KEY_BITS.
"""
TILE_BITS = 7
"""
Logarithm to base 2 of the width of a tile in x and in y, in voxels.
Source: numerical: 12.8 m at 0.1 m, about a plan cell; time alone depends on it.
"""
MOST_TILES = 1 << 18
"""
Greatest number of tiles by which points are sorted.
Source: numerical: their counts take 2 MB; time alone depends on it.
"""
SLACK = 1e-4
"""
Distance from its voxel up to which a centroid lies in it, in voxels.
Source: numerical: a mean at a border is off by a rounding of float32, 6e-8; a thousand of them.
"""
_MASK = (1 << KEY_BITS) - 1
"""Mask of one index in a key.  Source: derived: KEY_BITS bits."""


@njit(cache=True, nogil=True)
def locate_voxels(
    points: Float64, origin: Int64, voxel_size: float
) -> tuple[Int64, Float32, int]:
    """
    Find the voxel of each point and the point's offset from its centre.

    Parameters
    ----------
    points : Float64
        (N, 3) points [m].
    origin : Int64
        (3,) voxel index of the origin of the keys.
    voxel_size : float
        Edge of a voxel [m].

    Returns
    -------
    tuple[Int64, Float32, int]
        (N,) packed keys, (N, 3) offsets [m], and the first point that is not finite or has no
        key, -1 if there is none; after such a point the arrays mean nothing.

    """
    keys = np.empty(len(points), dtype=np.int64)
    offsets = np.empty((len(points), 3), dtype=np.float32)
    for i in range(len(points)):
        key = np.int64(0)
        for j in range(3):
            scaled = np.floor(points[i, j] / voxel_size)
            relative = scaled - origin[j] + KEY_HALF_RANGE
            if not 0.0 <= relative < 2.0 * KEY_HALF_RANGE:
                return keys, offsets, i
            key = (key << KEY_BITS) | np.int64(relative)
            offsets[i, j] = points[i, j] - (scaled + 0.5) * voxel_size
        keys[i] = key
    return keys, offsets, -1


@njit(cache=True, nogil=True)
def find_centroids(
    slots: Int64, slot_keys: Int64, means: Float32, origin: Int64, voxel_size: float
) -> Float64:
    """
    Return the centroids of some voxels.

    Parameters
    ----------
    slots : Int64
        (M,) slots of the voxels.
    slot_keys, means : Int64, Float32
        The map's arrays.
    origin : Int64
        (3,) voxel index of the origin of the keys.
    voxel_size : float
        Edge of a voxel [m].

    Returns
    -------
    Float64
        (M, 3) centroids [m].

    """
    result = np.empty((len(slots), 3))
    for i in range(len(slots)):
        key, row = slot_keys[slots[i]], means[slots[i]]
        for j in range(3):
            relative = ((key >> ((2 - j) * KEY_BITS)) & _MASK) - KEY_HALF_RANGE
            result[i, j] = (relative + origin[j] + 0.5) * voxel_size + row[j]
    return result


@njit(cache=True, nogil=True)
def lie_within(
    points: Float64, slots: Int64, slot_keys: Int64, origin: Int64, voxel_size: float
) -> Bool:
    """
    Tell which points lie in the voxels of some slots, up to rounding.

    Parameters
    ----------
    points : Float64
        (M, 3) points [m].
    slots : Int64
        (M,) slots of the map.
    slot_keys, origin, voxel_size
        As for ``find_centroids``.

    Returns
    -------
    Bool
        (M,)

    """
    result = np.ones(len(slots), dtype=np.bool_)
    most = (0.5 + SLACK) * voxel_size
    for i in range(len(slots)):
        key = slot_keys[slots[i]]
        for j in range(3):
            relative = ((key >> ((2 - j) * KEY_BITS)) & _MASK) - KEY_HALF_RANGE
            center = (relative + origin[j] + 0.5) * voxel_size
            result[i] &= abs(points[i, j] - center) <= most
    return result


@njit(cache=True, nogil=True)
def order_by_tile(keys: Int64) -> Int64:
    """
    Sort points by tile, so that voxels near each other become neighbours in memory.

    Parameters
    ----------
    keys : Int64
        (N,) packed keys.

    Returns
    -------
    Int64
        (N,) indices of the points; those of one tile keep their order.

    """
    # column and row of the tile of each point
    num = len(keys)
    column, row = np.empty(num, dtype=np.int64), np.empty(num, dtype=np.int64)
    for k in range(num):
        column[k] = keys[k] >> (2 * KEY_BITS + TILE_BITS)
        row[k] = (keys[k] & ((1 << 2 * KEY_BITS) - 1)) >> (KEY_BITS + TILE_BITS)
    if num == 0:
        return np.arange(num)
    left, low = column.min(), row.min()
    wide = column.max() - left + 1
    num_tiles = wide * (row.max() - low + 1)
    if num_tiles > MOST_TILES:
        return np.arange(num)
    # counting sort
    place = np.zeros(num_tiles + 1, dtype=np.int64)
    for k in range(num):
        column[k] += (row[k] - low) * wide - left
        place[column[k] + 1] += 1
    for tile in range(num_tiles):
        place[tile + 1] += place[tile]
    ordered = np.empty(num, dtype=np.int64)
    for k in range(num):
        ordered[place[column[k]]] = k
        place[column[k]] += 1
    return ordered
