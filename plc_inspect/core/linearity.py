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

"""Likeness features of voxel neighbourhoods, and the oriented candidates among them."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import LinearitySettings
from plc_inspect.core.bulk import drop_bulk
from plc_inspect.core.voxels import (
    add_shifted,
    build_voxels,
    coarsen,
    find_slot,
    pack,
    Voxels,
)
from plc_inspect.results import Float64, Int64

SAME_WAY = 0.97
"""Cosine between directions that are about the same."""
NUM_BINS = 20
"""Bins of the histogram of linear likeness."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likeness:
    """Features of the 3 x 3 x 3 block about each of M voxels (paper Eqs. 1 to 3)."""

    count: Int64
    """(M,) points in the block."""
    linear: Float64
    """(M,) (l1 - l2) / l1."""
    planar: Float64
    """(M,) (l2 - l3) / l1."""
    spherical: Float64
    """(M,) l3 / l1."""
    direction: Float64
    """(M, 3) unit eigenvector v1, with x > 0 or, at x = 0, y > 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearityResult:
    """Oriented candidates of all scales: places where points lie along a line."""

    position: Float64
    """(M, 3) centroid of the candidate's voxel [m]."""
    direction: Float64
    """(M, 3) unit vector along the line."""
    size: Float64
    """(M,) edge of the neighbourhood [m]."""
    linear: Float64
    """(M,) linear likeness."""
    count: Int64
    """(M,) points of the neighbourhood."""
    sizes: tuple[float, ...]
    """Edges of all neighbourhoods that were looked at [m]."""
    num_voxels: tuple[int, ...]
    """Occupied voxels at each of them."""
    num_bulk: int = 0
    """Points that were dropped first, as inside of bulky things."""
    histogram: tuple[int, ...] = ()
    """Neighbourhoods with enough points by linear likeness, in equal bins from 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scales:
    """The neighbourhoods of the high points, before any threshold."""

    levels: tuple[tuple[Voxels, Likeness], ...]
    """Voxels and the features of the block about each, from fine to coarse."""
    num_bulk: int
    """Points that were dropped first, as inside of bulky things."""


def measure_scales(
    points: Float64, chosen: Int64, origin: Float64, settings: LinearitySettings
) -> Scales:
    """
    Measure the likeness of neighbourhoods of several sizes.

    ``threshold``, ``max_inclination_deg`` and ``min_neighbors`` are not used.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    chosen : (K,) int64
        Indices of the high points.
    origin : (3,) float64
        Not above any chosen point [m].
    settings : LinearitySettings
        Settings of this stage.

    Returns
    -------
    Scales

    """
    sparse = drop_bulk(points, chosen, origin, settings.max_occupied)
    voxels = build_voxels(points, sparse, origin, settings.voxel_size)
    levels = [(voxels, measure_likeness(voxels))]
    for _ in range(settings.num_scales - 1):
        voxels = coarsen(voxels)
        levels.append((voxels, measure_likeness(voxels)))
    return Scales(levels=tuple(levels), num_bulk=len(chosen) - len(sparse))


def find_candidates(
    points: Float64,
    chosen: Int64,
    origin: Float64,
    settings: LinearitySettings,
    scales: Scales | None = None,
) -> LinearityResult:
    """
    Find voxels whose neighbourhood is linear and near horizontal, at several scales.

    A voxel is a candidate where the block about it holds ``min_neighbors`` points or more, has a
    linear likeness of ``threshold`` or more and a first eigenvector within
    ``max_inclination_deg`` of the horizontal.  Moments of coarse scales are sums of those of
    fine ones, so the points are visited once.  A coarse voxel that has a part which is linear
    the same way is left out: the finer one says it already.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    chosen : (K,) int64
        Indices of the high points.
    origin : (3,) float64
        Not above any chosen point [m].
    settings : LinearitySettings
        Settings of this stage.
    scales : Scales or None
        Those of these points, where they are known already.

    Returns
    -------
    LinearityResult

    """
    if scales is None:
        scales = measure_scales(points, chosen, origin, settings)
    limit = math.sin(math.radians(settings.max_inclination_deg))
    parts = []
    sizes, nums = [], []
    histogram = np.zeros(NUM_BINS + 1, dtype=np.int64)
    linear = np.zeros(0, dtype=bool)
    finer, before = None, None
    for voxels, likeness in scales.levels:
        enough = likeness.count >= settings.min_neighbors
        histogram += np.bincount(
            (likeness.linear[enough] * NUM_BINS).astype(np.int64), minlength=NUM_BINS + 1
        )
        linear_before, linear = linear, (
            enough
            & (likeness.linear >= settings.threshold)
            & (np.abs(likeness.direction[:, 2]) <= limit)
        )
        good = np.flatnonzero(linear)
        if finer is not None and before is not None:
            good = good[
                ~_has_finer(
                    voxels.index[good], likeness.direction[good],
                    finer.table_key, finer.table_slot, linear_before, before.direction,
                )
            ]
        sizes.append(3 * voxels.size)
        nums.append(len(voxels))
        parts.append(
            (
                voxels.centroids(good),
                likeness.direction[good],
                np.full(len(good), 3 * voxels.size),
                likeness.linear[good],
                likeness.count[good],
            )
        )
        finer, before = voxels, likeness
    position, direction, edge, likely, count = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return LinearityResult(
        position=position,
        direction=direction,
        size=edge,
        linear=likely,
        count=count,
        sizes=tuple(sizes),
        num_voxels=tuple(nums),
        num_bulk=scales.num_bulk,
        histogram=(*histogram[:-2].tolist(), int(histogram[-2:].sum())),
    )


def anchor(points: Float64, chosen: Int64, settings: LinearitySettings) -> Float64:
    """
    Return the origin of the voxels: below all chosen points, at a multiple of the coarsest edge.

    So a map that grows keeps its voxels where they are.

    """
    if not len(chosen):
        return np.zeros(3)
    edge = settings.voxel_size * 2 ** (settings.num_scales - 1)
    origin: Float64 = (np.floor(find_lowest(points, chosen) / edge) - 1.0) * edge
    return origin


def measure_likeness(voxels: Voxels) -> Likeness:
    """
    Return the likeness features of the block of 27 voxels about each voxel.

    The covariance of a block is exact: the moments of its voxels are added, no point is
    visited.  Voxels are taken in the order of their keys, so that the nine columns of the block
    are found by pointers that only move on.  O(M).

    """
    count, linear, planar, spherical, direction = _measure(
        voxels.key, voxels.moments, voxels.size
    )
    return Likeness(
        count=count,
        linear=linear,
        planar=planar,
        spherical=spherical,
        direction=direction,
    )


@njit(cache=True, nogil=True)
def _has_finer(  # type: ignore[no-untyped-def]
    index, direction, table_key, table_slot, linear, finer_direction
):
    """Tell which voxels have an eighth that is linear in about the same direction."""
    result = np.zeros(len(index), dtype=np.bool_)
    for k in range(len(index)):
        for part in range(8):
            slot = find_slot(
                table_key,
                table_slot,
                pack(
                    2 * index[k, 0] + (part >> 2),
                    2 * index[k, 1] + ((part >> 1) & 1),
                    2 * index[k, 2] + (part & 1),
                ),
            )
            if slot >= 0 and linear[slot]:
                cosine = 0.0
                for axis in range(3):
                    cosine += direction[k, axis] * finer_direction[slot, axis]
                if abs(cosine) >= SAME_WAY:
                    result[k] = True
                    break
    return result


@njit(cache=True, nogil=True, inline='always')
def _cos_third(value):  # type: ignore[no-untyped-def]
    """cos(acos(value) / 3) for 0 to 1, by Newton's method for its triple-angle formula."""
    c = 0.866025 + value * (0.165718 + value * (0.009962 * value - 0.041637))
    for _ in range(2):
        c -= ((4.0 * c * c - 3.0) * c - value) / (12.0 * c * c - 3.0)
    return c


@njit(cache=True, nogil=True)
def principal_axis(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Eigenvalues l1 >= l2 >= l3 >= 0 and first eigenvector of a symmetric 3 x 3 matrix.

    Closed form (Smith 1961); the vector has x > 0 or, at x = 0, y > 0.
    """
    mean = (xx + yy + zz) / 3.0
    off = xy * xy + xz * xz + yz * yz
    spread = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2.0 * off
    p = math.sqrt(spread / 6.0)
    if p <= 1e-12 * max(mean, 1e-300):
        return mean, mean, mean, 1.0, 0.0, 0.0
    a, b, c = (xx - mean) / p, (yy - mean) / p, (zz - mean) / p
    d, e, f = xy / p, xz / p, yz / p
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2.0
    far = _cos_third(min(abs(half), 1.0))  # the eigenvalue that lies apart from the others
    near = 0.5 * (far + math.sqrt(max(3.0 - 3.0 * far * far, 0.0)))
    l1 = mean + 2.0 * p * (far if half >= 0.0 else near)
    l3 = mean - 2.0 * p * (near if half >= 0.0 else far)
    l2 = 3.0 * mean - l1 - l3
    # v1 spans the null space of A - l1 I: the largest cross product of two of its rows
    ax, by, cz = xx - l1, yy - l1, zz - l1
    ux, uy, uz = xy * yz - xz * by, xz * xy - ax * yz, ax * by - xy * xy
    vx, vy, vz = xy * cz - xz * yz, xz * xz - ax * cz, ax * yz - xy * xz
    wx, wy, wz = by * cz - yz * yz, yz * xz - xy * cz, xy * yz - by * xz
    nu = ux * ux + uy * uy + uz * uz
    nv = vx * vx + vy * vy + vz * vz
    nw = wx * wx + wy * wy + wz * wz
    if nv > nu and nv >= nw:
        ux, uy, uz, nu = vx, vy, vz, nv
    elif nw > nu:
        ux, uy, uz, nu = wx, wy, wz, nw
    if nu <= 0.0:
        return l1, l2, l3, 1.0, 0.0, 0.0
    scale = 1.0 / math.sqrt(nu)
    if ux < 0.0 or (ux == 0.0 and uy < 0.0):
        scale = -scale
    return max(l1, 0.0), max(l2, 0.0), max(l3, 0.0), ux * scale, uy * scale, uz * scale


@njit(cache=True, nogil=True)
def principal_axis_of(total):  # type: ignore[no-untyped-def]
    """``principal_axis`` of the covariance [m2] of (10,) count, sums and products of points."""
    n = total[0]
    mx, my, mz = total[1] / n, total[2] / n, total[3] / n
    return principal_axis(
        total[4] / n - mx * mx,
        total[5] / n - mx * my,
        total[6] / n - mx * mz,
        total[7] / n - my * my,
        total[8] / n - my * mz,
        total[9] / n - mz * mz,
    )


@njit(cache=True, nogil=True)
def find_lowest(points, chosen):  # type: ignore[no-untyped-def]
    """Return the (3,) least coordinates of the chosen points."""
    low = np.full(3, np.inf)
    for i in chosen:
        for k in range(3):
            low[k] = min(low[k], points[i, k])
    return low


@njit(cache=True, parallel=True, nogil=True)
def _measure(keys, moments, size):  # type: ignore[no-untyped-def]
    num = len(keys)
    count = np.empty(num, dtype=np.int64)
    linear = np.empty(num)
    planar = np.empty(num)
    spherical = np.empty(num)
    direction = np.empty((num, 3))
    num_parts = 16
    for part in prange(num_parts):
        first, last = part * num // num_parts, (part + 1) * num // num_parts
        if first == last:
            continue
        step = np.empty(9, dtype=np.int64)
        at = np.empty(9, dtype=np.int64)
        total = np.empty(10)
        for column in range(9):
            step[column] = ((column // 3 - 1) << 40) + ((column % 3 - 1) << 20) - 1
            at[column] = np.searchsorted(keys, keys[first] + step[column])
        for i in range(first, last):
            total[:] = 0.0
            for column in range(9):
                low = keys[i] + step[column]
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
            l1, l2, l3, vx, vy, vz = principal_axis_of(total)
            count[i] = int(total[0])
            scale = 1.0 / l1 if l1 > 0.0 else 0.0
            linear[i] = (l1 - l2) * scale
            planar[i] = (l2 - l3) * scale
            spherical[i] = l3 * scale
            direction[i, 0], direction[i, 1], direction[i, 2] = vx, vy, vz
    return count, linear, planar, spherical, direction
