# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
A simulated scene as data, and the builder that composes one.

The scene frame is a local map: x east, y north, z up [m].  All that beams can hit are struts (thin
cylinders), triangles, blobs (porous spheres of leaves), conductors and terrain.
"""

from dataclasses import dataclass, field
import enum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.sim.scenes.conductors import Conductor
from plc_inspect.sim.scenes.terrain import Terrain

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
UP = np.array([0.0, 0.0, 1.0])
"""Unit vector along z."""


class Label(enum.IntEnum):
    """ASPRS classes of the simulated points."""

    OTHER = 1
    GROUND = 2
    VEGETATION = 5
    BUILDING = 6
    WIRE = 14
    TOWER = 15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Post:
    """Truth of a support."""

    position: Float64
    """(3,) foot on the ground [m]."""
    height: float
    kind: str
    """'tower' or 'pole'."""
    line_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planted:
    """A tree planted at a known clearance."""

    line_id: int
    span_id: int
    position: Float64
    """(3,) point of the conductor nearest to the tree, about [m]."""
    clearance: float
    """Distance of the hull of the crown from the nearest conductor [m]; negative inside."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """All objects of a scene; arrays of one kind of object are parallel."""

    name: str
    seed: int
    terrain: Terrain
    route: Float64
    """(K, 2) centre line of the surveyed corridor [m]."""
    half_width: float
    """Half width of the surveyed corridor [m]."""
    conductors: tuple[Conductor, ...]
    posts: tuple[Post, ...]
    planted: tuple[Planted, ...]
    struts: Float64
    """(S, 7) both ends and radius [m]."""
    strut_label: Int32
    triangles: Float64
    """(T, 9) three corners [m]."""
    triangle_label: Int32
    blobs: Float64
    """(B, 5) centre, radius [m] and extinction [1/m]."""
    crowns: NDArray[np.int64]
    """(C + 1,) first blob of each crown, and the number of blobs."""

    @property
    def num_lines(self) -> int:
        """Number of conductors over all spans."""
        return len({conductor.line_id for conductor in self.conductors})

    @property
    def area(self) -> float:
        """Area of the corridor [m2], measured on a 1 m grid."""
        low = self.route.min(axis=0) - self.half_width
        high = self.route.max(axis=0) + self.half_width
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        return float(self.covers(np.column_stack([x.ravel(), y.ravel()]) + 0.5).sum())

    def covers(self, xy: Float64) -> NDArray[np.bool_]:
        """Tell whether positions xy (N, 2) lie in the surveyed corridor, which has square ends."""
        return measure_offset(xy, self.route) <= self.half_width


def measure_offset(xy: Float64, route: Float64) -> Float64:
    """Return the distances (N,) from a polyline, inf beyond its first and last point [m]."""
    best = np.full(len(xy), np.inf)
    last = len(route) - 2
    for i in range(last + 1):
        edge = route[i + 1] - route[i]
        length = np.hypot(*edge)
        rel = xy - route[i]
        along = rel @ edge / length
        inside = np.clip(along, 0.0, length)
        gap = np.hypot(*(rel - inside[:, None] * edge / length).T)
        if i == 0:
            gap = np.where(along < 0.0, np.inf, gap)
        if i == last:
            gap = np.where(along > length, np.inf, gap)
        best = np.minimum(best, gap)
    return best


@dataclass(slots=True)
class SceneBuilder:
    """Collects the parts of a scene; `build` freezes them."""

    name: str
    seed: int
    terrain: Terrain
    rng: np.random.Generator
    conductors: list[Conductor] = field(default_factory=list)
    posts: list[Post] = field(default_factory=list)
    planted: list[Planted] = field(default_factory=list)
    struts: list[tuple[float, ...]] = field(default_factory=list)
    strut_label: list[int] = field(default_factory=list)
    triangles: list[Float64] = field(default_factory=list)
    triangle_label: list[int] = field(default_factory=list)
    blobs: list[Float64] = field(default_factory=list)
    _tree: cKDTree | None = None
    _num_conductors: int = -1

    def next_ids(self) -> tuple[int, int]:
        """Return the next free line and span ids."""
        return (
            1 + max((item.line_id for item in self.conductors), default=-1),
            1 + max((item.span_id for item in self.conductors), default=-1),
        )

    def add_strut(self, start: Float64, end: Float64, radius: float, label: Label) -> None:
        """Add a cylinder from start (3,) to end (3,) [m]."""
        self.struts.append((*map(float, start), *map(float, end), radius))
        self.strut_label.append(int(label))

    def add_face(self, corners: Float64, label: Label) -> None:
        """Add a flat convex face with corners (K, 3) as a fan of triangles [m]."""
        for i in range(1, len(corners) - 1):
            self.triangles.append(np.concatenate([corners[0], corners[i], corners[i + 1]]))
            self.triangle_label.append(int(label))

    def add_blobs(self, blobs: Float64) -> None:
        """Add a crown of porous spheres (K, 5): centre, radius [m], extinction [1/m]."""
        self.blobs.append(blobs)

    def ground(self, xy: Float64) -> float:
        """Return the ground height [m] at xy (2,)."""
        return self.terrain.height(float(xy[0]), float(xy[1]))

    def measure_gaps(self, blobs: Float64) -> Float64:
        """
        Return the distances (K,) of the hulls of blobs from the nearest conductor [m].

        Negative if a conductor runs inside; inf without conductors.
        """
        if not self.conductors:
            return np.full(len(blobs), np.inf)
        if self._tree is None or self._num_conductors != len(self.conductors):
            self._tree = cKDTree(np.vstack([item.sample(0.1) for item in self.conductors]))
            self._num_conductors = len(self.conductors)
        distance, _ = self._tree.query(blobs[:, :3])
        return np.asarray(distance - blobs[:, 3])

    def build(self, route: Float64, half_width: float) -> Scene:
        """Return the scene, with a corridor ``half_width`` to both sides of the route [m]."""
        return Scene(
            name=self.name, seed=self.seed, terrain=self.terrain,
            route=np.asarray(route, dtype=np.float64), half_width=half_width,
            conductors=tuple(self.conductors), posts=tuple(self.posts),
            planted=tuple(self.planted),
            struts=np.array(self.struts, dtype=np.float64).reshape(-1, 7),
            strut_label=np.array(self.strut_label, dtype=np.int32),
            triangles=np.array(self.triangles, dtype=np.float64).reshape(-1, 9),
            triangle_label=np.array(self.triangle_label, dtype=np.int32),
            blobs=np.vstack([np.zeros((0, 5)), *self.blobs]),
            crowns=np.cumsum([0, *(len(item) for item in self.blobs)]),
        )
