# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Scenes with planted hazards of each kind, on both sides of their limits.

`plc_simulate` does not offer them: tests and ``bench/hazards.py`` survey them from above.
"""

from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from plc_inspect.results import HazardKind
from plc_inspect.sim.scenes import lines, structures, vegetation
from plc_inspect.sim.scenes.conductors import Conductor, measure_distances, solve_constant
from plc_inspect.sim.scenes.scene import Label, Scene, SceneBuilder
from plc_inspect.sim.scenes.terrain import make_terrain
from plc_inspect.sim.surveys.airborne import LabelledCloud

Float64 = NDArray[np.float64]

SPAN = 90.0
"""Length of the spans of the main line [m]."""
PLACES = {
    HazardKind.VEGETATION: 6.0, HazardKind.FALL_IN: 6.0, HazardKind.STRUCTURE: 10.0,
    HazardKind.CROSSING: 6.0, HazardKind.GROUND: 30.0, HazardKind.SAG: 30.0,
    HazardKind.INTERFERENCE: 30.0,
}
"""Greatest distance of a reported hazard from the planted one, by kind [m]."""
LOW_LINE = replace(
    lines.LOW_VOLTAGE, phases=((-0.5, 7.6), (0.0, 7.6), (0.5, 7.6)), sag_ratio=(0.012, 0.0121),
)
PAIR = replace(
    lines.LOW_VOLTAGE, phases=((0.3, 9.2), (0.3, 8.0)), sag_ratio=(0.012, 0.0121),
)
_FAR = 70.0
"""Distance from the main line of the lines for ground and interference hazards [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planted:
    """A planted object, which is a hazard or just not one."""

    kind: HazardKind
    position: Float64
    """(2,) approximate position in plan [m]."""
    radius: float = 0.0
    """Greatest distance in plan of points of the object from the position [m]."""
    conductors: tuple[int, ...] = ()
    """Indices of the conductors concerned; the first one is at fault."""


def plant(seed: int) -> tuple[Scene, tuple[Planted, ...]]:
    """
    Make a medium-voltage line of six spans with planted objects of each kind.

    Clearances are drawn from both sides of the limits of the default settings.

    Parameters
    ----------
    seed : int
        Seed of all randomness.

    Returns
    -------
    scene : Scene
    planted : tuple of Planted

    """
    rng = np.random.default_rng(seed)
    terrain = make_terrain(rng, (-80.0, -150.0, 7 * SPAN, 150.0), rng.uniform(0.5, 6.0), 300.0)
    builder = SceneBuilder(name='planted', seed=seed, terrain=terrain, rng=rng)
    route = np.column_stack([np.arange(7) * SPAN, np.zeros(7)])
    lines.add_line(builder, lines.MEDIUM_VOLTAGE, route)
    sagging = _sink(builder, int(rng.integers(3)), 2, rng.uniform(1.05, 1.6))
    planted = [
        Planted(kind=HazardKind.SAG, position=_at(2.5), conductors=sagging),
        *_grow_trees(builder, rng), _build_house(builder, rng), *_raise_trees(builder, rng),
        *_cross(builder, 3.5 * SPAN, rng.uniform(0.8, 3.2)),
        *_run_low(builder, rng), *_run_pair(builder, rng),
    ]
    scene = builder.build(np.array([[-15.0, 0.0], [6 * SPAN + 15.0, 0.0]]), _FAR + 25.0)
    return scene, tuple(planted)


def measure(item: Planted, scene: Scene, cloud: LabelledCloud) -> tuple[float, float]:
    """
    Return the exact value of a planted object, and its limit.

    Parameters
    ----------
    item : Planted
        The object.
    scene : Scene
        Its scene.
    cloud : LabelledCloud
        A survey: only returns of a tree or house count, at their true positions.

    Returns
    -------
    value, limit : float
        A value below the limit is a hazard [m].  For sag, both are negative: minus the excess and
        minus what is tolerated.  Limits are those of the default settings, and 2 m for falling
        trees.

    """
    own = [scene.conductors[number] for number in item.conductors]
    if item.kind == HazardKind.SAG:
        usual = float(np.median([other.sag for other in own[1:]]))
        return -(own[0].sag - usual), -max(0.25 * usual, 0.15)
    if item.kind == HazardKind.INTERFERENCE:
        gap = own[1].sample(0.1)[:, 2] - own[0].sample(0.1)[:, 2]
        return float(np.abs(gap).min()), 0.5 * float(min(abs(gap[0]), abs(gap[-1])))
    if item.kind == HazardKind.CROSSING:
        others = [other for other in scene.conductors if other.line_id < 3]
        return min(float(measure_distances(first.sample(0.1), other).min())
                   for first in own for other in others), 2.0
    if item.kind == HazardKind.GROUND:
        at = np.vstack([other.sample(0.25) for other in own])
        return float((at[:, 2] - scene.terrain.heights(at[:, :2])).min()), 5.0
    wanted = Label.BUILDING if item.kind == HazardKind.STRUCTURE else Label.VEGETATION
    mine = (cloud.label == wanted) & (
        np.hypot(*(cloud.exact[:, :2] - item.position).T) <= item.radius
    )
    points = cloud.exact[mine]
    if item.kind == HazardKind.FALL_IN:
        top = points[np.argmax(points[:, 2])]
        foot = top.copy()
        foot[2] = scene.terrain.height(float(top[0]), float(top[1]))
        nearest = min(float(measure_distances(foot[None], other)[0])
                      for other in scene.conductors)
        return nearest - float(top[2] - foot[2]), 2.0
    return min(float(measure_distances(points, other).min()) for other in scene.conductors), 4.0


def _at(spans: float) -> Float64:
    return np.array([spans * SPAN, 0.0])


def _sink(
    builder: SceneBuilder, line_id: int, span_id: int, share: float
) -> tuple[int, ...]:
    """Let one conductor sag more than the others of its span; return its index, then theirs."""
    own, peers = -1, []
    for number, item in enumerate(builder.conductors):
        if item.span_id == span_id and item.line_id == line_id:
            own = number
            builder.conductors[number] = _rehang(item, item.c / share)
        elif item.span_id == span_id:
            peers.append(number)
    return own, *peers


def _rehang(item: Conductor, c: float) -> Conductor:
    return replace(item, c=c, bundle_id=-1)


def _cross(builder: SceneBuilder, x: float, clearance: float) -> list[Planted]:
    """Add a low line that crosses under the main one at a vertical clearance."""
    lowest = min(
        float(item.locate(np.array([x - item.start[0]]))[0, 2]) for item in builder.conductors
        if item.start[0] < x < item.end[0]
    )
    feet = np.array([[x, -30.0], [x, 30.0]])
    sag = LOW_LINE.sag_ratio[0] * 60.0
    up = lowest - clearance + sag - 0.5 * sum(builder.ground(foot) for foot in feet)
    style = replace(LOW_LINE, phases=tuple((y, up) for y, _ in LOW_LINE.phases))
    first = len(builder.conductors)
    lines.add_line(builder, style, feet)
    own = tuple(range(first, len(builder.conductors)))
    at = np.array([x, 0.0])
    return [Planted(kind=kind, position=at, conductors=own)
            for kind in (HazardKind.CROSSING, HazardKind.GROUND)]


def _run_low(builder: SceneBuilder, rng: np.random.Generator) -> list[Planted]:
    """Add separate spans beside the main line, at different heights above the ground."""
    result = []
    for k, x in enumerate((20.0, 250.0)):
        up = rng.uniform(4.4, 7.2)
        style = replace(LOW_LINE, phases=tuple((y, up) for y, _ in LOW_LINE.phases))
        first = len(builder.conductors)
        side = _FAR if k else _FAR - 8.0
        lines.add_line(builder, style, np.array([[x, side], [x + 45.0, side]]))
        result.append(Planted(
            kind=HazardKind.GROUND, position=np.array([x + 22.5, side]),
            conductors=tuple(range(first, len(builder.conductors))),
        ))
    return result


def _run_pair(builder: SceneBuilder, rng: np.random.Generator) -> list[Planted]:
    """Add pairs of conductors, the upper one of which sags towards the lower."""
    result = []
    for k, x in enumerate((20.0, 250.0)):
        first = len(builder.conductors)
        side = -_FAR if k else 8.0 - _FAR
        lines.add_line(builder, PAIR, np.array([[x, side], [x + 50.0, side]]))
        upper = builder.conductors[first]
        sag = upper.sag + 1.2 * rng.uniform(0.2, 0.8)
        builder.conductors[first] = _rehang(upper, solve_constant(upper.length, sag))
        result.append(Planted(
            kind=HazardKind.INTERFERENCE, position=np.array([x + 25.0, side]),
            conductors=(first, first + 1),
        ))
    return result


def _grow_trees(builder: SceneBuilder, rng: np.random.Generator) -> list[Planted]:
    """Plant trees beside the first two spans, far enough apart."""
    result = []
    for span_id, shares in ((0, (0.2, 0.5, 0.8)), (1, (0.25, 0.75))):
        for share in shares:
            side = 1 if rng.random() < 0.5 else -1
            items = [item for item in builder.conductors
                     if item.span_id == span_id and item.line_id < 3]
            outer = max(items, key=lambda item: side * item.start[1])
            clearance = rng.uniform(0.6, 6.0)
            shape = (vegetation.shape_poplar, vegetation.shape_conifer,
                     vegetation.shape_broadleaf)[int(rng.integers(3))]
            num = len(builder.blobs)
            vegetation.plant_beside(builder, outer, share, side, clearance, shape)
            crown = np.vstack(builder.blobs[num:])
            middle = crown[:, :2].mean(axis=0)
            spread = np.hypot(*(crown[:, :2] - middle).T) + crown[:, 3]
            result.append(Planted(kind=HazardKind.VEGETATION, position=middle,
                                  radius=float(spread.max()) + 0.3))
    return result


def _build_house(builder: SceneBuilder, rng: np.random.Generator) -> Planted:
    at = np.array([4.5 * SPAN, rng.uniform(-16.0, 16.0)])
    structures.add_house(builder, at, rng.uniform(0.0, math.pi), length=9.0, eaves=3.5,
                         ridge=rng.uniform(5.0, 7.5))
    return Planted(kind=HazardKind.STRUCTURE, position=at, radius=8.0)


def _raise_trees(builder: SceneBuilder, rng: np.random.Generator) -> list[Planted]:
    """Add conifers clear of the last span, some tall enough to fall onto it."""
    result = []
    for k, x in enumerate((5.2, 5.5, 5.8)):
        tall = rng.uniform(9.0, 17.0)
        at = np.array([x * SPAN, (-1) ** k * rng.uniform(10.0, 14.0)])
        crown = vegetation.place(builder, vegetation.shape_conifer(rng, tall), at)
        builder.add_blobs(crown)
        result.append(Planted(kind=HazardKind.FALL_IN, position=at, radius=0.3 * tall))
    return result
