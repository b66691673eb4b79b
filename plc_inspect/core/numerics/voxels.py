# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sparse voxels with the moments of their points."""

from dataclasses import dataclass

from numba import njit, prange
import numpy as np

from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.hash_table import (
    find_slot,
    hash_key,
    index_keys,
    make_entry,
    make_table,
    probe,
    UInt32,
)
from plc_inspect.errors import DataError
from plc_inspect.results import Float64, Int32, Int64

NUM_PARTS = 4
"""
Runs of points that are hashed into voxels independently.
Source: numerical: fixed, so that results do not depend on the number of threads.
"""
AXIS_BITS = 20
"""
Bits of a key for each of three coordinates: 2^20 voxels along an axis.
Source: numerical: three of them fit into int64.
"""
NUM_MOMENTS = 10
"""Moments of a voxel.  Source: derived: its count, three sums and six products."""
INITIAL_VOXELS = 1 << 12
"""
Initial capacity of a run of points, in voxels.
Source: numerical: the room doubles whenever it is full.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Voxels:
    """M occupied voxels, sorted by x, then y, then z."""

    size: float
    """Edge [m]."""
    origin: Float64
    """(3,) corner of the voxel with index 0, 0, 0 [m]."""
    key: Int64
    """(M,) the coordinates packed into one number, ascending."""
    index: Int32
    """(M, 3) integer coordinates."""
    moments: Float64
    """
    (M, 10) count, sums of x y z [m], of xx xy xz yy yz zz [m2], relative to the voxel's centre.
    """
    table: UInt32
    """Hash table of the keys."""

    def __len__(self) -> int:
        """Return the number of occupied voxels."""
        return len(self.index)

    def centroids(self, chosen: Int64 | slice = slice(None)) -> Float64:
        """Return the (K, 3) means of the points of K voxels, by default all [m]."""
        center = self.origin + (self.index[chosen] + 0.5) * self.size
        moments = self.moments[chosen]
        result: Float64 = center + moments[:, 1:4] / moments[:, :1]
        return result


def build_voxels(points: Float64, chosen: Int64, origin: Float64, size: float) -> Voxels:
    """
    Hash the chosen points into voxels; O(K), fastest for points sorted in space.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) int64
        Indices of the points to use, all finite and not below origin.
    origin : (3,) float64
        Coordinates [m].
    size : float
        Edge of a voxel [m].

    Returns
    -------
    Voxels

    Raises
    ------
    DataError
        The extent divided by ``size`` exceeds 2**20 voxels along an axis.

    """
    if len(chosen):
        extent = _extent(points, chosen, origin)
        if extent.max() / size >= (1 << AXIS_BITS) - 2:
            raise DataError(
                f'the cloud spans {extent.max():.0f} m, too much for voxels of {size:g} m'
            )
    return _sort(size, origin, *_fill_parts(points, chosen, origin, size))


def find_voxels(points: Float64, chosen: Int64, voxels: Voxels) -> Int32:
    """
    Find the voxel of each chosen point.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) int64
        Indices of points that the voxels were built from.
    voxels : Voxels
        The voxels to search.

    Returns
    -------
    (K,) int32

    """
    result: Int32 = _look_up(
        points, chosen, voxels.origin, voxels.size, voxels.table, voxels.key
    )
    return result


def coarsen(voxels: Voxels) -> Voxels:
    """Merge 2 x 2 x 2 voxels into one of twice the size, exactly, from their moments."""
    keys, moments = _shift_to_parents(voxels.index, voxels.moments, voxels.size)
    return _sort(voxels.size * 2, voxels.origin, keys, moments)


def _sort(size: float, origin: Float64, keys: Int64, moments: Float64) -> Voxels:
    keys, moments = _unite(keys, moments, np.argsort(keys, kind='stable'))
    mask = (1 << AXIS_BITS) - 1
    return Voxels(
        size=size,
        origin=origin,
        key=keys,
        index=np.stack(
            [(keys >> (2 * AXIS_BITS)) & mask, (keys >> AXIS_BITS) & mask, keys & mask], axis=1
        ).astype(np.int32),
        moments=moments,
        table=index_keys(keys, len(keys)),
    )


@njit(cache=True, nogil=True, inline='always')
def pack(ix, iy, iz):  # type: ignore[no-untyped-def]
    """Return the key of three voxel coordinates."""
    return (np.int64(ix) << 2 * AXIS_BITS) | (np.int64(iy) << AXIS_BITS) | np.int64(iz)


@njit(cache=True, nogil=True)
def _extent(points, chosen, origin):  # type: ignore[no-untyped-def]
    extent = np.zeros(3)
    for i in chosen:
        for k in range(3):
            extent[k] = max(extent[k], points[i, k] - origin[k])
    return extent


@njit(cache=True, nogil=True)
def _fill_part(points, chosen, origin, size):  # type: ignore[no-untyped-def]
    capacity = INITIAL_VOXELS
    table = make_table(capacity)
    keys = np.empty(capacity, dtype=np.int64)
    moments = np.zeros((capacity, NUM_MOMENTS))
    used = 0
    for i in chosen:
        x = (points[i, 0] - origin[0]) / size
        y = (points[i, 1] - origin[1]) / size
        z = (points[i, 2] - origin[2]) / size
        ix, iy, iz = int(x), int(y), int(z)
        key = pack(ix, iy, iz)
        hashed, mask = hash_key(key), len(table) - 1
        slot, place = probe(key, hashed, hashed & mask, table, keys)
        # make a voxel, in arrays of twice the size if they are full
        if slot < 0:
            if used == capacity:
                capacity *= 2
                more_keys = np.empty(capacity, dtype=np.int64)
                put(keys, more_keys)
                keys = more_keys
                more = np.zeros((capacity, NUM_MOMENTS))
                put(moments.ravel(), more.ravel())
                moments = more
                table = index_keys(keys[:used], capacity)
                mask = len(table) - 1
                _, place = probe(key, hashed, hashed & mask, table, keys)
            slot = used
            used += 1
            table[place] = make_entry(hashed, slot, mask)
            keys[slot] = key
        x = (x - ix - 0.5) * size
        y = (y - iy - 0.5) * size
        z = (z - iz - 0.5) * size
        add_point(moments[slot], x, y, z)
    return keys[:used], moments[:used]


@njit(cache=True, parallel=True, nogil=True)
def _fill_parts(points, chosen, origin, size):  # type: ignore[no-untyped-def]
    """Return keys and moments of voxels; voxels in several parts occur several times."""
    keys = [np.empty(0, dtype=np.int64) for _ in range(NUM_PARTS)]
    moments = [np.empty((0, NUM_MOMENTS)) for _ in range(NUM_PARTS)]
    for part in prange(NUM_PARTS):
        first, last = part * len(chosen) // NUM_PARTS, (part + 1) * len(chosen) // NUM_PARTS
        keys[part], moments[part] = _fill_part(points, chosen[first:last], origin, size)
    start = np.zeros(NUM_PARTS + 1, dtype=np.int64)
    for part in range(NUM_PARTS):
        start[part + 1] = start[part] + len(keys[part])
    all_keys = np.empty(start[NUM_PARTS], dtype=np.int64)
    all_moments = np.empty((start[NUM_PARTS], NUM_MOMENTS))
    for part in prange(NUM_PARTS):
        put(keys[part], all_keys[start[part] :])
        put(moments[part].ravel(), all_moments[start[part] :].ravel())
    return all_keys, all_moments


@njit(cache=True, parallel=True, nogil=True)
def _unite(keys, moments, order):  # type: ignore[no-untyped-def]
    """Sort keys, and add up the moments of those that occur several times."""
    first = np.empty(len(keys) + 1, dtype=np.int64)
    used = 0
    for k in range(len(order)):
        if k == 0 or keys[order[k]] != keys[order[k - 1]]:
            first[used] = k
            used += 1
    first[used] = len(order)
    own = np.empty(used, dtype=np.int64)
    total = np.empty((used, NUM_MOMENTS))
    for m in prange(used):
        own[m] = keys[order[first[m]]]
        total[m] = 0.0
        for k in range(first[m], first[m + 1]):
            for column in range(NUM_MOMENTS):
                total[m, column] += moments[order[k], column]
    return own, total


@njit(cache=True, parallel=True, nogil=True)
def _look_up(points, chosen, origin, size, table, key):  # type: ignore[no-untyped-def]
    result = np.empty(len(chosen), dtype=np.int32)
    for k in prange(len(chosen)):
        i = chosen[k]
        here = pack(
            int((points[i, 0] - origin[0]) / size),
            int((points[i, 1] - origin[1]) / size),
            int((points[i, 2] - origin[2]) / size),
        )
        result[k] = find_slot(here, table, key)
    return result


@njit(cache=True, nogil=True)
def add_point(row, x, y, z):  # type: ignore[no-untyped-def]
    """Add a point at x, y, z [m] to the (10,) count, sums and products of a voxel."""
    row[0] += 1.0
    add_moments(row, 1, x, y, z)


@njit(cache=True, nogil=True)
def add_moments(row, first, x, y, z):  # type: ignore[no-untyped-def]
    """Add a point's sums [m] and products [m2] to nine columns of a row from ``first`` on."""
    row[first] += x
    row[first + 1] += y
    row[first + 2] += z
    row[first + 3] += x * x
    row[first + 4] += x * y
    row[first + 5] += x * z
    row[first + 6] += y * y
    row[first + 7] += y * z
    row[first + 8] += z * z


@njit(cache=True, nogil=True)
def add_shifted(total, row, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Add to ``total`` the moments ``row``, taken about a centre at dx, dy, dz [m]."""
    n, sx, sy, sz = row[0], row[1], row[2], row[3]
    total[0] += n
    total[1] += sx + n * dx
    total[2] += sy + n * dy
    total[3] += sz + n * dz
    total[4] += row[4] + 2 * dx * sx + n * dx * dx
    total[5] += row[5] + dx * sy + dy * sx + n * dx * dy
    total[6] += row[6] + dx * sz + dz * sx + n * dx * dz
    total[7] += row[7] + 2 * dy * sy + n * dy * dy
    total[8] += row[8] + dy * sz + dz * sy + n * dy * dz
    total[9] += row[9] + 2 * dz * sz + n * dz * dz


@njit(cache=True, nogil=True)
def _shift_to_parents(index, moments, size):  # type: ignore[no-untyped-def]
    """Return the key of each voxel's parent, and its moments about the parent's centre."""
    keys = np.empty(len(index), dtype=np.int64)
    shifted = np.empty((len(index), NUM_MOMENTS))
    for i in range(len(index)):
        ix, iy, iz = index[i, 0], index[i, 1], index[i, 2]
        keys[i] = pack(ix >> 1, iy >> 1, iz >> 1)
        shifted[i] = 0.0
        add_shifted(
            shifted[i],
            moments[i],
            ((ix & 1) - 0.5) * size,
            ((iy & 1) - 0.5) * size,
            ((iz & 1) - 0.5) * size,
        )
    return keys, shifted
