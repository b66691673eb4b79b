# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Linearity of voxel neighbourhoods (paper Eqs. 1 to 3): likeness features and candidates."""

from dataclasses import dataclass, replace
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import LinearitySettings
from plc_inspect.core.extraction.occupancy import drop_bulk
from plc_inspect.core.numerics.eigen import principal_axis_of
from plc_inspect.core.numerics.hash_table import find_slot
from plc_inspect.core.numerics.voxels import (
    add_shifted,
    AXIS_BITS,
    build_voxels,
    coarsen,
    NUM_MOMENTS,
    pack,
    Voxels,
)
from plc_inspect.results import Bool, Float64, Int64

SAME_WAY = 0.97
"""
Least cosine between directions that count as the same: 14 degrees.
Source: judgement; not measured.
"""
STEEPEST_DEG = 40.0
"""
Steepest inclination of what is looked for after all that is nearly level, and of a tap [deg].
Source: derived: a drop of 6 m to a house 7 m away; stays stand at 45 degrees and more.
"""
NUM_BINS = 20
"""
Bins of the histogram of linear likeness.
Source: numerical: shown in the report; decides nothing.
"""
NUM_FEATURES = 6
"""Features of a block.  Source: derived: three likenesses, three components of a direction."""
BLOCK = 256
"""
Voxels whose features are computed together.
Source: numerical: what they need stays in the cache; time alone depends on it.
"""


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
    """Edges of the neighbourhoods of all scales [m]."""
    num_voxels: tuple[int, ...]
    """Occupied voxels of each scale."""
    num_bulk: int = 0
    """Points dropped first, inside bulky things."""
    histogram: tuple[int, ...] = ()
    """Histogram of the linear likeness of neighbourhoods with enough points, from 0 to 1."""

    def select(self, keep: Bool) -> 'LinearityResult':
        """Return the candidates for which (M,) ``keep`` is True."""
        return replace(
            self,
            position=self.position[keep],
            direction=self.direction[keep],
            size=self.size[keep],
            linear=self.linear[keep],
            count=self.count[keep],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scales:
    """The neighbourhoods of the high points, before any threshold."""

    levels: tuple[tuple[Voxels, Likeness], ...]
    """Voxels, and the features of the block about each, from fine to coarse."""
    num_bulk: int
    """Points dropped first, inside bulky things."""


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
    least_inclination_deg: float = 0.0,
) -> LinearityResult:
    """
    Find voxels whose neighbourhood is linear and nearly horizontal, at several scales.

    A voxel is a candidate where the block about it holds ``min_neighbors`` points or more, has a
    linear likeness of ``threshold`` or more and a first eigenvector within
    ``max_inclination_deg`` of the horizontal, and no nearer than asked.  Moments of coarse voxels
    are sums of those of fine ones, so every point is visited once.  A coarse voxel is left out if
    one of its eight parts is a candidate in the same direction.

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
        Scales of these points, where they are known already.
    least_inclination_deg : float
        Least inclination of a candidate [deg].

    Returns
    -------
    LinearityResult

    """
    if scales is None:
        scales = measure_scales(points, chosen, origin, settings)
    least, limit = (
        math.sin(math.radians(inclination))
        for inclination in (least_inclination_deg, settings.max_inclination_deg)
    )
    parts = []
    sizes, nums = [], []
    histogram = np.zeros(NUM_BINS + 1, dtype=np.int64)
    linear = np.zeros(0, dtype=bool)
    finer, before = None, None
    for voxels, likeness in scales.levels:
        # voxels with enough points, a linear block and a direction near the horizontal
        enough = likeness.count >= settings.min_neighbors
        histogram += np.bincount(
            (likeness.linear[enough] * NUM_BINS).astype(np.int64), minlength=NUM_BINS + 1
        )
        rise = np.abs(likeness.direction[:, 2])
        linear_before, linear = linear, (
            enough & (likeness.linear >= settings.threshold) & (rise >= least) & (rise <= limit)
        )
        # unless the scale before has a part of it
        good = np.flatnonzero(linear)
        if finer is not None and before is not None:
            good = good[
                ~_has_finer(
                    voxels.index[good], likeness.direction[good],
                    finer.key, finer.table, linear_before, before.direction,
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

    Voxels so stay where they are while a map grows.

    """
    if not len(chosen):
        return np.zeros(3)
    edge = settings.voxel_size * 2 ** (settings.num_scales - 1)
    origin: Float64 = (np.floor(find_lowest(points, chosen) / edge) - 1.0) * edge
    return origin


def measure_likeness(voxels: Voxels) -> Likeness:
    """
    Return the likeness features of the block of 27 voxels about each voxel.

    The covariance of a block is exact: it is computed from the moments of its voxels, without
    their points.  As voxels are visited in the order of their keys, the pointers to the nine
    columns of the block only move forwards.  O(M).

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
    index, direction, finer_key, table, linear, finer_direction
):
    """Tell which voxels have a part, of eight, that is linear in the same direction."""
    result = np.zeros(len(index), dtype=np.bool_)
    for k in range(len(index)):
        for part in range(8):
            here = pack(
                2 * index[k, 0] + (part >> 2),
                2 * index[k, 1] + ((part >> 1) & 1),
                2 * index[k, 2] + (part & 1),
            )
            slot = find_slot(here, table, finer_key)
            if slot >= 0 and linear[slot]:
                cosine = 0.0
                for axis in range(3):
                    cosine += direction[k, axis] * finer_direction[slot, axis]
                if abs(cosine) >= SAME_WAY:
                    result[k] = True
                    break
    return result


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
        # offsets of the keys of the nine columns of a block, and pointers to them
        step = np.empty(9, dtype=np.int64)
        at = np.empty(9, dtype=np.int64)
        for column in range(9):
            step[column] = ((column // 3 - 1) << 2 * AXIS_BITS) - 1
            step[column] += (column % 3 - 1) << AXIS_BITS
            at[column] = np.searchsorted(keys, keys[first] + step[column])
        sheet = np.ones((NUM_MOMENTS + NUM_FEATURES, BLOCK))
        total = np.empty(NUM_MOMENTS)
        # add up the moments of BLOCK voxels, derive their features together, and store them
        for start in range(first, last, BLOCK):
            stop = min(start + BLOCK, last)
            for i in range(start, stop):
                _add_block(keys, moments, size, i, step, at, total)
                sheet[:NUM_MOMENTS, i - start] = total
            _derive_features(sheet.ravel())
            features = sheet[NUM_MOMENTS:]
            for i in range(start, stop):
                k = i - start
                count[i] = int(sheet[0, k])
                linear[i], planar[i], spherical[i] = features[0, k], features[1, k], features[2, k]
                for axis in range(3):
                    direction[i, axis] = features[3 + axis, k]
    return count, linear, planar, spherical, direction


@njit(cache=True, nogil=True)
def _add_block(keys, moments, size, i, step, at, total):  # type: ignore[no-untyped-def]
    """Add up the moments of the block about a voxel; ``at`` points into its nine columns."""
    total[:] = 0.0
    for column in range(9):
        low = keys[i] + step[column]
        k = at[column]
        while k < len(keys) and keys[k] < low:
            k += 1
        at[column] = k
        while k < len(keys) and keys[k] <= low + 2:
            add_shifted(
                total, moments[k], (column // 3 - 1) * size, (column % 3 - 1) * size,
                (keys[k] - low - 1) * size,
            )
            k += 1


@njit(cache=True, nogil=True, error_model='numpy')
def _derive_features(flat):  # type: ignore[no-untyped-def]
    """
    Compute the feature rows of a sheet from its rows of moments, by vector instructions.

    ``flat`` is the sheet as ((NUM_MOMENTS + NUM_FEATURES) * BLOCK,) float64: count, sums [m]
    and products [m2] of points, then linear, planar and spherical likeness, and direction.
    """
    for k in range(BLOCK):
        l1, l2, l3, vx, vy, vz = principal_axis_of(flat, k, BLOCK)
        scale = 1.0 / l1 if l1 > 0.0 else 0.0
        own = k + NUM_MOMENTS * BLOCK
        flat[own] = (l1 - l2) * scale
        flat[own + BLOCK] = (l2 - l3) * scale
        flat[own + 2 * BLOCK] = l3 * scale
        flat[own + 3 * BLOCK] = vx
        flat[own + 4 * BLOCK] = vy
        flat[own + 5 * BLOCK] = vz
