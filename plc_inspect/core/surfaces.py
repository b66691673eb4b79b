# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Surfaces: which points belong to roofs and walls rather than to foliage."""

from numba import njit, prange
import numpy as np

from plc_inspect.core.linearity import principal_axis_of
from plc_inspect.core.voxels import add_point, add_shifted, number_cells, pack
from plc_inspect.results import Bool, Float64, Int64

PLANAR = 0.45
"""Planar likeness from which a neighbourhood is a surface, not foliage."""
SPHERICAL = 0.08
"""And its spherical likeness is not beyond this."""
MIN_POINTS = 5
"""And it holds this many points."""
SIZE = 0.5
"""Edge of the voxels; a neighbourhood is 27 of them [m]."""


def is_surface(points: Float64, chosen: Int64) -> Bool:
    """
    Tell points of roofs and walls from foliage by the planar likeness about them.

    The likeness is that of `linearity.measure_likeness` at one size.  Voxels are visited in the
    order of their keys, so that the 27 about each are found by pointers that only move on.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    chosen : (K,) int64
        Indices of finite points.

    Returns
    -------
    (K,) bool

    """
    if not len(chosen):
        return np.zeros(0, dtype=bool)
    origin = _lowest(points, chosen) - 2.0
    cell_of, index, _, _ = number_cells(points, chosen, origin, SIZE)
    keys = pack_all(index)
    order = np.argsort(keys)
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    moments = _sum_moments(points, chosen, origin, SIZE, cell_of, rank)
    flat = _judge(keys[order], moments, SIZE)
    result: Bool = flat[rank[cell_of]]
    return result


@njit(cache=True, nogil=True)
def _lowest(points, chosen):  # type: ignore[no-untyped-def]
    low = np.full(3, np.inf)
    for i in chosen:
        for k in range(3):
            low[k] = min(low[k], points[i, k])
    return low


@njit(cache=True, nogil=True)
def pack_all(index):  # type: ignore[no-untyped-def]
    """Keys of voxels; ascending keys go by x, then y, then z."""
    keys = np.empty(len(index), dtype=np.int64)
    for k in range(len(index)):
        keys[k] = pack(index[k, 0], index[k, 1], index[k, 2])
    return keys


@njit(cache=True, nogil=True)
def _sum_moments(points, chosen, origin, size, cell_of, rank):  # type: ignore[no-untyped-def]
    """Count each voxel's points, and sum them and their products about its centre."""
    moments = np.zeros((len(rank), 10))
    for k in range(len(chosen)):
        i = chosen[k]
        x = (points[i, 0] - origin[0]) / size
        y = (points[i, 1] - origin[1]) / size
        z = (points[i, 2] - origin[2]) / size
        x = (x - int(x) - 0.5) * size
        y = (y - int(y) - 0.5) * size
        z = (z - int(z) - 0.5) * size
        add_point(moments[rank[cell_of[k]]], x, y, z)
    return moments


@njit(cache=True, parallel=True, nogil=True)
def _judge(keys, moments, size):  # type: ignore[no-untyped-def]
    """Whether the neighbourhood of each voxel is a surface; keys ascend."""
    num = len(keys)
    result = np.empty(num, dtype=np.bool_)
    num_parts = 16
    for part in prange(num_parts):
        first, last = part * num // num_parts, (part + 1) * num // num_parts
        if first == last:
            continue
        shift = np.empty(9, dtype=np.int64)
        at = np.empty(9, dtype=np.int64)
        total = np.empty(10)
        for column in range(9):
            step = ((column // 3 - 1) << 40) + ((column % 3 - 1) << 20) - 1
            shift[column] = step
            at[column] = np.searchsorted(keys, keys[first] + step)
        for i in range(first, last):
            total[:] = 0.0
            for column in range(9):
                low = keys[i] + shift[column]
                k = at[column]
                while k < num and keys[k] < low:
                    k += 1
                at[column] = k
                while k < num and keys[k] <= low + 2:
                    add_shifted(
                        total, moments[k], (column // 3 - 1) * size, (column % 3 - 1) * size,
                        (keys[k] - low - 1) * size,
                    )
                    k += 1
            result[i] = _is_flat(total)
    return result


@njit(cache=True, nogil=True)
def _is_flat(total):  # type: ignore[no-untyped-def]
    if total[0] < MIN_POINTS:
        return False
    l1, l2, l3, _, _, _ = principal_axis_of(total)
    scale = 1.0 / l1 if l1 > 0.0 else 0.0
    return (l2 - l3) * scale >= PLANAR and l3 * scale <= SPHERICAL
