# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Clutter of the random scenes: structures and vegetation, much of which looks like wires."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.sim.random_scenes import buildings, engineering
from plc_inspect.sim.scenes import structures, vegetation
from plc_inspect.sim.scenes.routes import walk_route
from plc_inspect.sim.scenes.scene import SceneBuilder

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spot:
    """Position and direction of one object."""

    xy: Float64
    """(2,) its centre [m]."""
    azimuth: float
    """Its direction [rad]."""

    def path(self, length: float) -> Float64:
        """Return both ends (2, 2) of a straight line about the centre, along the direction [m]."""
        u = np.array([math.cos(self.azimuth), math.sin(self.azimuth)])
        return np.array([self.xy - 0.5 * length * u, self.xy + 0.5 * length * u])


FOOT = 4.0
"""Least distance in plan of objects from the foot of a support [m]."""
ROAD = 2.5
"""Half width of the road, which is kept free [m]."""
TREE_ROAD = 5.0
"""Least distance of trees from the middle of the road, so that cars pass below them [m]."""
KEEP = 1.5
"""Least distance in plan of trees from the faces of buildings and walls [m]."""
STEP = 1.0
"""Spacing of the samples of solid objects [m]."""
Maker = Callable[[SceneBuilder, Spot], None]


def fill(
    builder: SceneBuilder, route: Float64, half_width: float, clear: float,
    road: Float64 | None,
) -> None:
    """
    Fill a corridor with structures and vegetation.

    Parameters
    ----------
    builder : SceneBuilder
        Holds the lines.
    route : ndarray
        (K, 2) middle of the corridor [m].
    half_width : float
        Half of the width of the corridor [m].
    clear : float
        Least distance of all objects from conductors [m].
    road : ndarray or None
        (L, 2) middle of a road that is kept free [m].

    """
    rng = builder.rng
    names = list(THINGS)
    favourites = rng.choice(len(names), min(len(names), int(rng.integers(1, 6))), replace=False)
    density = float(np.exp(rng.uniform(np.log(1e-4), np.log(2e-3))))
    site = Site(builder, clear, road)
    for xy, azimuth in _scatter(rng, route, half_width, density):
        turned = azimuth + (0.0 if rng.random() < 0.6 else rng.uniform(-math.pi, math.pi))
        site.put(THINGS[names[int(rng.choice(favourites))]], Spot(xy=xy, azimuth=turned))
    places = [xy for xy, _ in _scatter(rng, route, half_width, 0.004 * rng.uniform(0.0, 1.5))]
    strewn = structures.keep_off_faces(builder, np.array(places).reshape(-1, 2), KEEP)
    vegetation.scatter_trees(
        builder, strewn[site.find_road_gaps(strewn) > TREE_ROAD], (3.0, 20.0), clear,
    )


class Site:
    """Places objects clear of conductors, supports, the road and each other."""

    def __init__(self, builder: SceneBuilder, clear: float, road: Float64 | None) -> None:
        """Begin with the existing lines and houses."""
        self.builder, self.clear = builder, clear
        self._boxes: list[Float64] = [
            np.array([corners.min(axis=0), corners.max(axis=0)])
            for face in builder.triangles for corners in (face.reshape(3, 3)[:, :2],)
        ]
        self._road = None if road is None else cKDTree(walk_route(road, 1.0))
        curves = [item.sample(0.5) for item in builder.conductors]
        self._wires = cKDTree(np.vstack(curves)) if curves else None

    def put(self, make: Maker, spot: Spot) -> None:
        """Add an object unless it comes too near to a conductor or overlaps another object."""
        builder = self.builder
        aside = SceneBuilder(
            name=builder.name, seed=builder.seed, terrain=builder.terrain, rng=builder.rng,
        )
        make(aside, spot)
        shape = sample_solids(aside)
        if len(shape):
            box = np.array([shape[:, :2].min(axis=0), shape[:, :2].max(axis=0)])
            if any((box[0] < other[1]).all() and (box[1] > other[0]).all()
                   for other in self._boxes):
                return
            # half the spacing of samples on either side
            if not self._is_clear(np.pad(shape, ((0, 0), (0, 1)), constant_values=0.5 * STEP)):
                return
            if self.find_road_gaps(shape[:, :2]).min() < ROAD:
                return
            if any(np.hypot(*(shape[:, :2] - post.position[:2]).T).min() < FOOT
                   for post in builder.posts):
                return
            self._boxes.append(box)
        builder.struts += aside.struts
        builder.strut_label += aside.strut_label
        builder.triangles += aside.triangles
        builder.triangle_label += aside.triangle_label
        builder.blobs += [
            crown for crown in aside.blobs
            if self._is_clear(crown) and self.find_road_gaps(crown[:, :2]).min() > ROAD
        ]

    def find_road_gaps(self, xy: Float64) -> Float64:
        """Return the distances (N,) of positions xy (N, 2) from the road, inf without one [m]."""
        if self._road is None or not len(xy):
            return np.full(len(xy), np.inf)
        return np.asarray(self._road.query(xy)[0])

    def _is_clear(self, balls: Float64) -> bool:
        """Tell whether balls (N, 4+), centre and radius, are clear of all conductors."""
        if self._wires is None:
            return True
        reach = self.clear + float(balls[:, 3].max())
        gap, _ = self._wires.query(balls[:, :3], distance_upper_bound=reach)
        return bool((gap - balls[:, 3]).min() >= self.clear)


def sample_solids(builder: SceneBuilder) -> Float64:
    """Return points (N, 3) on the struts and triangles of a builder, at most STEP apart [m]."""
    parts = [np.zeros((0, 3))]
    for row in builder.struts:
        ends = np.array(row[:6]).reshape(2, 3)
        num = max(2, math.ceil(float(np.linalg.norm(ends[1] - ends[0])) / STEP) + 1)
        parts.append(ends[0] + np.linspace(0.0, 1.0, num)[:, None] * (ends[1] - ends[0]))
    for face in builder.triangles:
        corner = face.reshape(3, 3)
        size = max(float(np.linalg.norm(corner[k] - corner[0])) for k in (1, 2))
        share = np.linspace(0.0, 1.0, max(2, math.ceil(size / STEP) + 1))
        u, v = (grid.ravel() for grid in np.meshgrid(share, share))
        inside = u + v <= 1.0
        parts.append(corner[0] + u[inside, None] * (corner[1] - corner[0])
                     + v[inside, None] * (corner[2] - corner[0]))
    return np.vstack(parts)


def _scatter(
    rng: np.random.Generator, route: Float64, half_width: float, density: float,
) -> list[tuple[Float64, float]]:
    """Return random positions (2,) in a corridor, with its direction there [rad]."""
    edges = np.diff(route, axis=0)
    lengths = np.hypot(*edges.T)
    num = rng.poisson(2 * half_width * lengths.sum() * density)
    edge = rng.choice(len(edges), num, p=lengths / lengths.sum())
    along, across = rng.uniform(0.0, 1.0, num), rng.uniform(-half_width, half_width, num)
    normal = np.column_stack([-edges[:, 1], edges[:, 0]]) / lengths[:, None]
    xy = route[edge] + along[:, None] * edges[edge] + across[:, None] * normal[edge]
    return [(xy[k], math.atan2(*edges[edge[k]][::-1])) for k in range(num)]


def _fence(builder: SceneBuilder, spot: Spot) -> None:
    rng = builder.rng
    structures.add_fence(builder, spot.path(rng.uniform(15.0, 80.0)), rng.uniform(1.0, 2.5),
                         int(rng.integers(2, 6)))


def _wall(builder: SceneBuilder, spot: Spot) -> None:
    structures.add_wall(builder, spot.path(builder.rng.uniform(10.0, 50.0)),
                        builder.rng.uniform(1.0, 3.0))


def _rails(builder: SceneBuilder, spot: Spot) -> None:
    structures.add_rails(builder, spot.path(150.0))


def _guard_rail(builder: SceneBuilder, spot: Spot) -> None:
    structures.add_guard_rail(builder, spot.path(builder.rng.uniform(30.0, 120.0)))


def _lights(builder: SceneBuilder, spot: Spot) -> None:
    structures.add_street_lights(builder, spot.path(120.0), builder.rng.uniform(20.0, 40.0),
                                 builder.rng.uniform(5.0, 12.0))


def _footbridge(builder: SceneBuilder, spot: Spot) -> None:
    start, end = spot.path(builder.rng.uniform(20.0, 45.0))
    structures.add_footbridge(builder, start, end, builder.rng.uniform(4.5, 7.0))


def _hedge(builder: SceneBuilder, spot: Spot) -> None:
    rng = builder.rng
    start, end = spot.path(rng.uniform(15.0, 60.0))
    high = rng.uniform(1.0, 3.0)
    for share in np.linspace(0.0, 1.0, int(np.hypot(*(end - start)) / 0.8)):
        xy = start + share * (end - start)
        builder.add_blobs(vegetation.place(builder, vegetation.shape_bush(rng, high), xy))


def _tree_row(builder: SceneBuilder, spot: Spot) -> None:
    rng = builder.rng
    shapes = (vegetation.shape_poplar, vegetation.shape_broadleaf, vegetation.shape_conifer)
    shape, high = shapes[int(rng.integers(3))], rng.uniform(5.0, 18.0)
    start, end = spot.path(rng.uniform(30.0, 100.0))
    gap = high * rng.uniform(0.25, 0.6)
    for share in np.linspace(0.0, 1.0, max(2, int(np.hypot(*(end - start)) / gap))):
        xy = start + share * (end - start)
        crown = shape(rng, high * rng.uniform(0.85, 1.1))
        builder.add_blobs(vegetation.place(builder, crown, xy))


THINGS: dict[str, Maker] = {
    'fence': _fence,
    'wall': _wall,
    'rails': _rails,
    'guard rail': _guard_rail,
    'street lights': _lights,
    'footbridge': _footbridge,
    'hedge': _hedge,
    'tree row': _tree_row,
    'house': lambda builder, spot: buildings.add_random_house(builder, spot.xy, spot.azimuth),
    'flat roof': lambda builder, spot: buildings.add_flat_roof(builder, spot.xy, spot.azimuth),
    'tower crane': lambda builder, spot: engineering.add_tower_crane(builder, spot.xy),
    'guyed mast': lambda builder, spot: engineering.add_guyed_mast(builder, spot.xy),
    'sign gantry': lambda builder, spot: engineering.add_gantry(builder, spot.xy, spot.azimuth),
    'pipe rack': lambda builder, spot: engineering.add_pipe_rack(builder, spot.xy, spot.azimuth),
    'stayed bridge': lambda builder, spot: engineering.add_stayed_bridge(
        builder, spot.xy, spot.azimuth),
    'suspension bridge': lambda builder, spot: engineering.add_suspension_bridge(
        builder, spot.xy, spot.azimuth),
}
"""Makers of objects of random scenes, by name."""
