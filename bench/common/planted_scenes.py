# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Things planted into random scenes, about at the limits of their rules, and their exact truth."""

from dataclasses import dataclass, field, replace
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import HazardKind
from plc_inspect.sim.random_scenes.buildings import add_box
from plc_inspect.sim.random_scenes.scenes import KINDS, make_random_scene
from plc_inspect.sim.random_scenes.surveys import draw_survey
from plc_inspect.sim.random_scenes.truth import measure_scene, RandomScene
from plc_inspect.sim.scenes import lines, vegetation
from plc_inspect.sim.scenes.conductors import Conductor, measure_distances
from plc_inspect.sim.scenes.scene import Label, Scene, SceneBuilder
from plc_inspect.sim.surveys.airborne import LabelledCloud

Float64 = NDArray[np.float64]

LIMITS = {
    HazardKind.VEGETATION: 4.0, HazardKind.STRUCTURE: 4.0, HazardKind.GROUND: 5.0,
    HazardKind.CROSSING: 2.0, HazardKind.FALL_IN: 2.0,
}
"""Of the default settings, and 2 m for falling trees [m]."""
SHARES = ((0.5,), (0.3, 0.7))
"""Where along a span things stand, one or two of them."""
PAIR_LENGTH = 70.0
"""Spans of this length and more get two things [m]."""
SHORTEST = 25.0
"""Spans shorter than this get none [m]."""
LEAST_ROOM = 2.5
"""Least height of what stands or runs below a conductor [m]."""
MOST_ROOM = 14.0
"""Buildings and bushes are lower than this [m]."""
HULL = 0.05
"""Points this near to the hull of an object are its own [m]."""
TREES = {
    'poplar': vegetation.shape_poplar, 'conifer': vegetation.shape_conifer,
    'broadleaf': vegetation.shape_broadleaf,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Item:
    """Something planted."""

    kind: HazardKind
    name: str
    position: Float64
    """(2,) about where [m]."""
    blobs: Float64 = field(default_factory=lambda: np.zeros((0, 5)))
    """(K, 5) of a plant."""
    faces: Float64 = field(default_factory=lambda: np.zeros((0, 9)))
    """(T, 9) of a building."""
    conductors: tuple[int, ...] = ()
    """Numbers of the conductors that were hung."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantedScene:
    """A random scene with things planted, surveyed."""

    made: RandomScene
    items: tuple[Item, ...]


def make_planted(seed: int, bundles: bool = False) -> PlantedScene | None:
    """Return the scene of a seed; None where it has no line, or no bundle though asked for."""
    rng = np.random.default_rng([seed, len(KINDS)])
    survey = draw_survey(rng)
    scene = make_random_scene(seed, 'any', survey)
    if not scene.conductors or (bundles and all(c.bundle_id < 0 for c in scene.conductors)):
        return None
    scene, items = plant(scene, np.random.default_rng([seed, 25]))
    return PlantedScene(made=measure_scene(scene, survey, rng), items=items) if items else None


def plant(scene: Scene, rng: np.random.Generator) -> tuple[Scene, tuple[Item, ...]]:
    """Return a scene with things at the conductors of its first line, and the things."""
    builder = SceneBuilder(
        name=scene.name, seed=scene.seed, terrain=scene.terrain, rng=rng,
        conductors=list(scene.conductors), posts=list(scene.posts),
    )
    own = set(scene.posts[0].line_ids)
    spans = sorted({item.span_id for item in scene.conductors if item.line_id in own})
    is_alone = all(item.line_id in own for item in scene.conductors)
    items: list[Item] = []
    for span_id in spans:
        numbers = tuple(k for k, item in enumerate(builder.conductors)
                        if item.span_id == span_id and item.line_id in own)
        length = builder.conductors[numbers[0]].length
        if length < SHORTEST:
            continue
        if is_alone and rng.random() < 0.25:
            items += _lower(builder, numbers)
        for share in SHARES[length >= PAIR_LENGTH]:
            spans_own = [builder.conductors[k] for k in numbers]
            items += _plant_one(builder, scene, spans_own, share + rng.uniform(-0.08, 0.08))
    added = builder.build(scene.route, scene.half_width)
    return replace(
        scene, conductors=added.conductors, posts=added.posts,
        struts=np.vstack([scene.struts, added.struts]),
        strut_label=np.concatenate([scene.strut_label, added.strut_label]),
        triangles=np.vstack([scene.triangles, added.triangles]),
        triangle_label=np.concatenate([scene.triangle_label, added.triangle_label]),
        blobs=np.vstack([scene.blobs, added.blobs]),
        crowns=np.concatenate([scene.crowns, scene.crowns[-1] + added.crowns[1:]]),
    ), tuple(items)


def _draw_clearance(rng: np.random.Generator, kind: HazardKind) -> float:
    """Return a clearance [m], half of the time close to the limit, on either side."""
    limit = LIMITS[kind]
    if rng.random() < 0.5:
        return float(max(limit + rng.normal(0.0, 0.4), 0.3))
    return float(rng.uniform(0.2 * limit, 1.8 * limit))


def _plant_one(
    builder: SceneBuilder, scene: Scene, own: list[Conductor], share: float
) -> list[Item]:
    """Plant one thing at a share of a span, of a kind for which there is room."""
    rng = builder.rng
    for name in rng.permutation(
        ['poplar', 'conifer', 'broadleaf', 'bush', 'under', 'box', 'fall', 'cross']
    ).tolist():
        first, first_face = len(builder.blobs), len(builder.triangles)
        first_wire = len(builder.conductors)
        at = own[0].locate(np.array([share * own[0].length]))[0, :2]
        lowest = min(own, key=lambda item: float(item.locate(
            np.array([share * item.length]))[0, 2]))
        try:
            kind = _try_kind(builder, own, lowest, share, name)
        except DataError:
            kind = None
        if kind is None:
            continue
        blobs = np.vstack([np.zeros((0, 5)), *builder.blobs[first:]])
        faces = np.array(builder.triangles[first_face:]).reshape(-1, 9)
        if len(blobs):
            at = blobs[:, :2].mean(axis=0)
        if not scene.covers(at[None])[0]:
            del builder.blobs[first:]
            continue
        return [Item(kind=kind, name=name, position=at, blobs=blobs, faces=faces,
                     conductors=tuple(range(first_wire, len(builder.conductors))))]
    return []


def _try_kind(
    builder: SceneBuilder, own: list[Conductor], lowest: Conductor, share: float, name: str
) -> HazardKind | None:
    """Plant a thing of one name, or nothing and return None."""
    rng = builder.rng
    place = lowest.locate(np.array([share * lowest.length]))[0]
    room = float(place[2]) - builder.ground(place[:2])
    side = 1 if rng.random() < 0.5 else -1
    outer = max(own, key=lambda item: side * float(
        np.array([-math.sin(own[0].azimuth), math.cos(own[0].azimuth)]) @ item.start[:2]))
    if name in TREES:
        vegetation.plant_beside(builder, outer, share, side,
                                _draw_clearance(rng, HazardKind.VEGETATION), TREES[name])
        return HazardKind.VEGETATION
    if name in ('bush', 'under'):
        clearance = _draw_clearance(rng, HazardKind.VEGETATION)
        if not 1.0 < room - clearance < MOST_ROOM:
            return None
        shape = vegetation.shape_bush if name == 'bush' else vegetation.shape_conifer
        vegetation.plant_under(builder, lowest, share, clearance, shape)
        return HazardKind.VEGETATION
    if name == 'box':
        clearance = _draw_clearance(rng, HazardKind.STRUCTURE)
        if not LEAST_ROOM < room - clearance < MOST_ROOM:
            return None
        u = np.array([math.cos(lowest.azimuth), math.sin(lowest.azimuth), 0.0])
        v = np.array([-u[1], u[0], 0.0])
        base = np.array([*place[:2], builder.ground(place[:2]) - 1.5])
        add_box(builder, base, 3.0 * u, 2.5 * v, room - clearance + 1.5)
        return HazardKind.STRUCTURE
    if name == 'fall':
        return _raise_tree(builder, outer, share, side)
    return _cross(builder, lowest, share, room)


def _raise_tree(
    builder: SceneBuilder, outer: Conductor, share: float, side: int
) -> HazardKind | None:
    """Raise a conifer that may reach a conductor when it falls, and keeps clear as it stands."""
    rng = builder.rng
    target = outer.locate(np.array([share * outer.length]))[0]
    normal = side * np.array([-math.sin(outer.azimuth), math.cos(outer.azimuth)])
    tall = float(rng.uniform(9.0, 20.0))
    wanted = tall + _draw_clearance(rng, HazardKind.FALL_IN)
    low, high = 0.0, 60.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        foot = target[:2] + middle * normal
        reach = measure_distances(np.array([[*foot, builder.ground(foot)]]), outer)[0]
        low, high = (middle, high) if reach < wanted else (low, middle)
    crown = vegetation.place(builder, vegetation.shape_conifer(rng, tall), foot)
    if low < 1.0 or builder.measure_gaps(crown).min() < 5.0:
        return None
    builder.add_blobs(crown)
    return HazardKind.FALL_IN


def _cross(
    builder: SceneBuilder, lowest: Conductor, share: float, room: float
) -> HazardKind | None:
    """Run a low line of three wires across, under the lowest conductor."""
    clearance = _draw_clearance(builder.rng, HazardKind.CROSSING)
    if room - clearance < 4.0:
        return None
    place = lowest.locate(np.array([share * lowest.length]))[0]
    turn = lowest.azimuth + math.pi / 2 + builder.rng.uniform(-0.4, 0.4)
    across = np.array([math.cos(turn), math.sin(turn)])
    feet = np.array([place[:2] - 22.0 * across, place[:2] + 22.0 * across])
    ratio = 0.012
    up = float(place[2]) - clearance + ratio * 44.0 - float(
        np.mean([builder.ground(foot) for foot in feet]))
    style = replace(lines.LOW_VOLTAGE, phases=((-0.5, up), (0.0, up), (0.5, up)),
                    sag_ratio=(ratio, ratio + 1e-4))
    lines.add_line(builder, style, feet)
    return HazardKind.CROSSING


def _lower(builder: SceneBuilder, numbers: tuple[int, ...]) -> list[Item]:
    """Let all conductors of a span sag until the lowest keeps a clearance to the ground."""
    wanted = _draw_clearance(builder.rng, HazardKind.GROUND)
    own = [builder.conductors[k] for k in numbers]
    low, high = 0.02, 1.0
    if _measure_ground(builder, [replace(item, c=low * item.c) for item in own]) > wanted or (
        _measure_ground(builder, own) < wanted
    ):
        return []
    for _ in range(40):
        middle = 0.5 * (low + high)
        sagging = [replace(item, c=middle * item.c) for item in own]
        low, high = (middle, high) if _measure_ground(builder, sagging) < wanted else (low, middle)
    if high * own[0].c < 1.5 * own[0].length:
        return []
    for number, item in zip(numbers, own, strict=True):
        builder.conductors[number] = replace(item, c=high * item.c)
    return [Item(kind=HazardKind.GROUND, name='ground', conductors=numbers,
                 position=0.5 * (own[0].start + own[0].end)[:2])]


def _measure_ground(builder: SceneBuilder, own: list[Conductor]) -> float:
    at = np.vstack([item.sample(1.0) for item in own])
    return float((at[:, 2] - builder.terrain.heights(at[:, :2])).min())


def measure_surfaces(
    points: Float64, scene: Scene, reach: float
) -> tuple[Float64, NDArray[np.int64]]:
    """
    Return the distances (N,) [m] of points to the nearest conductor's surface, and which that is.

    Inf and -1 where none comes nearer than ``reach``.
    """
    best, which = np.full(len(points), np.inf), np.full(len(points), -1)
    if not len(points):
        return best, which
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    for number, item in enumerate(scene.conductors):
        curve = item.sample(2.0)
        if (curve.max(axis=0) < low).any() or (curve.min(axis=0) > high).any():
            continue
        away = measure_distances(points, item) - item.radius
        nearer = away < best
        best[nearer], which[nearer] = away[nearer], number
    far = best >= reach
    best[far], which[far] = np.inf, -1
    return best, which


def find_own(item: Item, cloud: LabelledCloud) -> NDArray[np.int64]:
    """Return which points of a cloud are of a planted plant or building."""
    if len(item.blobs):
        middle = item.blobs[:, :2].mean(axis=0)
        reach = float((np.hypot(*(item.blobs[:, :2] - middle).T) + item.blobs[:, 3]).max()) + HULL
        near = np.flatnonzero(
            (cloud.label == Label.VEGETATION)
            & (np.hypot(*(cloud.exact[:, :2] - middle).T) <= reach)
        )
        away = np.linalg.norm(cloud.exact[near, None] - item.blobs[:, :3], axis=2)
        inside: NDArray[np.int64] = near[(away <= item.blobs[:, 3] + HULL).any(axis=1)]
        return inside
    if len(item.faces):
        corners = item.faces.reshape(-1, 3)
        low, high = corners.min(axis=0) - HULL, corners.max(axis=0) + HULL
        return np.flatnonzero(
            (cloud.label == Label.BUILDING)
            & ((cloud.exact >= low) & (cloud.exact <= high)).all(axis=1)
        )
    return np.zeros(0, dtype=np.int64)
