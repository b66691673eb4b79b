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

"""
The global map: a hash of voxels that keep the moments of their points, not the points.

A voxel stores its number of points, their mean offset from the voxel's centre, the mean outer
product of those offsets and the number of the insertion that last touched it: 52 bytes, and 8 to
16 bytes of hash table.  Means instead of sums, so that float32 keeps its precision however often
a voxel is hit; sums of any union of voxels follow exactly from means and counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plc_inspect.config import MapSettings
from plc_inspect.core.voxel_hash import (
    accumulate_points,
    build_table,
    KEY_HALF_RANGE,
    locate_voxels,
    UInt32,
    unpack_keys,
)
from plc_inspect.errors import DataError
from plc_inspect.results import Float32, Float64, Int32, Int64

INITIAL_CAPACITY = 1 << 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Insertion:
    """What one call of ``VoxelMap.insert`` did."""

    sequence: int
    """Number of this insertion, counted from 1."""
    num_points: int
    """Points that are now part of the map."""
    num_new: int
    """Voxels that were touched for the first time."""
    num_refused: int
    """Points that would have needed a voxel beyond ``max_voxels`` and were left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapSnapshot:
    """Copies of M voxels in the order of their slots; nothing in it changes afterwards."""

    slots: Int64
    """(M,) slot of each voxel, valid while ``generation`` stays the same."""
    centroids: Float64
    """(M, 3) mean of the points of each voxel, map frame [m]."""
    counts: Int64
    """(M,) number of points."""
    covariances: Float32 | None
    """(M, 6) xx xy xz yy yz zz about the centroid, divided by the count [m2], if asked for."""
    touched: Int32
    """(M,) number of the insertion that last touched each voxel."""
    sequence: int
    """Number of the newest insertion in the snapshot; the ``since`` of the next one."""
    generation: int
    """Changes whenever slots are renumbered."""


class VoxelMap:
    """
    Voxels of point moments with a hard cap; owned by one thread.

    The voxel grid is fixed to multiples of ``voxel_size``, so that the voxels do not depend on
    which point came first.  Slots are given in the order of first touch: the same points in the
    same order give the same arrays.

    Parameters
    ----------
    settings : MapSettings
        All of them are used.

    """

    def __init__(self, settings: MapSettings) -> None:
        self._voxel_size = settings.voxel_size
        self._max_voxels = settings.max_voxels
        self._min_points = settings.min_points
        self._generation = 0
        self._sequence = 0
        self._num_points = 0
        self._set_empty(min(INITIAL_CAPACITY, self._max_voxels))

    def _set_empty(self, capacity: int) -> None:
        self._size = 0
        self._origin: Int64 | None = None
        self._allocate(capacity)
        self._table = build_table(self._keys[:0], self._capacity)

    def _allocate(self, capacity: int) -> None:
        """Make room for ``capacity`` voxels and carry over those that are there."""
        old = self._arrays() if self._size else None
        self._capacity = capacity
        self._keys: Int64 = np.empty(capacity, dtype=np.int64)
        self._counts: UInt32 = np.zeros(capacity, dtype=np.uint32)
        self._moments: Float32 = np.zeros((capacity, 9), dtype=np.float32)
        self._touched: Int32 = np.zeros(capacity, dtype=np.int32)
        if old is not None:
            for source, target in zip(old, self._all_arrays(), strict=True):
                target[: self._size] = source

    def _all_arrays(self) -> tuple[NDArray[np.generic], ...]:
        return self._keys, self._counts, self._moments, self._touched

    def _arrays(self) -> tuple[NDArray[np.generic], ...]:
        return tuple(array[: self._size] for array in self._all_arrays())

    def __len__(self) -> int:
        """Return the number of occupied voxels."""
        return self._size

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel [m]."""
        return self._voxel_size

    @property
    def max_voxels(self) -> int:
        """Hard cap of occupied voxels."""
        return self._max_voxels

    @property
    def num_points(self) -> int:
        """Points that were ever put in and not refused, removed voxels included."""
        return self._num_points

    @property
    def sequence(self) -> int:
        """Number of the newest insertion, 0 before the first."""
        return self._sequence

    @property
    def generation(self) -> int:
        """Changes whenever slots are renumbered, by ``remove`` and ``clear``."""
        return self._generation

    @property
    def nbytes(self) -> int:
        """Memory of the voxels in use and of the hash table [bytes]."""
        return sum(array.nbytes for array in self._arrays()) + self._table.nbytes

    def clear(self) -> None:
        """Forget all voxels; the sequence goes on."""
        self._generation += 1
        self._set_empty(self._capacity)

    def reserve(self, num_voxels: int, *, touch: bool = False) -> None:
        """
        Make room ahead, so that no insertion pays for growing.

        Parameters
        ----------
        num_voxels : int
            Voxels to make room for; more than ``max_voxels`` is taken as ``max_voxels``.
        touch : bool
            Use the memory now.  Otherwise the system hands it out when it is first written,
            which costs an insertion up to 20 ms now and then.

        """
        wanted = min(num_voxels, self._max_voxels)
        if wanted > self._capacity:
            self._allocate(wanted)
            self._table = build_table(self._keys[: self._size], self._capacity)
        if touch:
            self._table |= 0
            for array in self._all_arrays():
                array[self._size :].fill(0)

    def insert(self, points: Float64) -> Insertion:
        """
        Add points; either all that fit or, on an error, none.

        Beyond ``max_voxels`` the map does not grow and does not raise: points in voxels that
        exist are still added, the others are refused and counted.  Cost O(N).

        Parameters
        ----------
        points : Float64
            (N, 3) finite points in the map frame [m].

        Returns
        -------
        Insertion
            What was added and what was refused.

        Raises
        ------
        DataError
            The shape is wrong, or a point is not finite or too far from the first one (2^20
            voxels along an axis).

        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise DataError(f'points must have shape (N, 3), got {points.shape}')
        if len(points) == 0:
            return Insertion(
                sequence=self._sequence, num_points=0, num_new=0, num_refused=0
            )
        if not np.isfinite(points[0]).all():
            raise DataError(f'point 0 is not finite: {points[0].tolist()}')
        origin = self._origin
        if origin is None:
            if np.abs(points[0]).max() / self._voxel_size > 2**52:
                raise DataError(f'point 0 is out of all bounds: {points[0].tolist()}')
            origin = np.floor(points[0] / self._voxel_size).astype(np.int64)
        keys, offsets, bad = locate_voxels(points, origin, self._voxel_size)
        if bad >= 0:
            reach = KEY_HALF_RANGE * self._voxel_size
            raise DataError(
                f'point {bad} {points[bad].tolist()} is not finite or more than {reach:.0f} m '
                f'from the first point {(origin * self._voxel_size).tolist()}'
            )
        return self._accumulate(keys, offsets, origin)

    def _accumulate(self, keys: Int64, offsets: Float32, origin: Int64) -> Insertion:
        self._origin = origin
        self._sequence += 1
        size, start, num_refused = self._size, 0, 0
        while True:
            self._size, start, refused = accumulate_points(
                keys, offsets, start, self._sequence, self._size,
                self._capacity == self._max_voxels,
                self._table, self._keys, self._counts, self._moments, self._touched,
            )
            num_refused += refused
            if start == len(keys):
                break
            self._allocate(min(2 * self._capacity, self._max_voxels))
            self._table = build_table(self._keys[: self._size], self._capacity)
        num_added = len(keys) - num_refused
        self._num_points += num_added
        return Insertion(
            sequence=self._sequence,
            num_points=num_added,
            num_new=self._size - size,
            num_refused=num_refused,
        )

    def centroids(self) -> Float64:
        """Return the (M, 3) mean of the points of every voxel [m], by slot."""
        return self._centroids(np.arange(self._size))

    def _centroids(self, slots: Int64) -> Float64:
        if self._origin is None:
            return np.empty((0, 3))
        centers = (unpack_keys(self._keys[slots]) + self._origin + 0.5) * self._voxel_size
        return np.add(centers, self._moments[slots, :3], dtype=np.float64)

    def counts(self) -> Int64:
        """Return the (M,) number of points of every voxel, by slot."""
        return self._counts[: self._size].astype(np.int64)

    def covariances(self) -> Float32:
        """Return the (M, 6) xx xy xz yy yz zz of every voxel about its centroid [m2], by slot."""
        return self._covariances(np.arange(self._size))

    def _covariances(self, slots: Int64) -> Float32:
        moments = self._moments[slots].astype(np.float64)
        x, y, z = moments[:, 0], moments[:, 1], moments[:, 2]
        products = np.column_stack((x * x, x * y, x * z, y * y, y * z, z * z))
        result = moments[:, 3:] - products
        # Rounding may leave a variance of a few 1e-10 m2 below zero.
        diagonal = [0, 3, 5]
        result[:, diagonal] = np.maximum(result[:, diagonal], 0.0)
        return result.astype(np.float32)

    def snapshot(self, since: int | None = None, *, covariances: bool = False) -> MapSnapshot:
        """
        Copy voxels, for another thread to read.

        Voxels with fewer than ``min_points`` points are left out.

        Parameters
        ----------
        since : int or None
            Only voxels touched by insertions after the one of this number; None: all.
        covariances : bool
            Copy the covariances too.

        Returns
        -------
        MapSnapshot
            Copies in the order of the slots.

        """
        chosen = self._counts[: self._size] >= self._min_points
        if since is not None:
            chosen &= self._touched[: self._size] > since
        slots = np.flatnonzero(chosen).astype(np.int64)
        return MapSnapshot(
            slots=slots,
            centroids=self._centroids(slots),
            counts=self._counts[slots].astype(np.int64),
            covariances=self._covariances(slots) if covariances else None,
            touched=self._touched[slots],
            sequence=self._sequence,
            generation=self._generation,
        )

    def remove(self, chosen: ArrayLike) -> Int64:
        """
        Remove voxels and close the gaps; the order of the others stays.

        Cost O(M), so remove many at once.

        Parameters
        ----------
        chosen : array_like
            (M,) bool mask over the slots, or integer slots.

        Returns
        -------
        Int64
            (M,) new slot of every old slot, -1 where it was removed.

        Raises
        ------
        DataError
            The mask has another length, or a slot does not exist.

        """
        index = np.asarray(chosen)
        removed = np.zeros(self._size, dtype=np.bool_)
        if index.dtype == np.bool_:
            if index.shape != removed.shape:
                raise DataError(f'a mask of shape {index.shape} for {self._size} voxels')
            removed = index
        elif index.size:
            if index.min() < 0 or index.max() >= self._size:
                raise DataError(
                    f'slots {index.min()} to {index.max()}, the map holds {self._size}'
                )
            removed[index] = True
        kept = np.flatnonzero(~removed)
        renumbered = np.full(self._size, -1, dtype=np.int64)
        renumbered[kept] = np.arange(len(kept))
        if len(kept) < self._size:
            for array in self._all_arrays():
                array[: len(kept)] = array[kept]
            self._counts[len(kept): self._size] = 0
            self._moments[len(kept): self._size] = 0.0
            self._size = len(kept)
            self._table = build_table(self._keys[: self._size], self._capacity)
            self._generation += 1
        return renumbered
