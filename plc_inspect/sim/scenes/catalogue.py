# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The scenes by name, each composed of terrain, lines, vegetation and structures."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.sim.scenes import lines, structures, vegetation
from plc_inspect.sim.scenes.conductors import Conductor
from plc_inspect.sim.scenes.routes import (
    extend_route,
    face_side,
    lay_route,
    shift_route,
    walk_route,
)
from plc_inspect.sim.scenes.scene import measure_offset, Scene, SceneBuilder
from plc_inspect.sim.scenes.terrain import make_terrain

Float64 = NDArray[np.float64]

_MARGIN = 130.0
_KEEP = 2.0
"""Least distance in plan of trees from houses and walls [m]."""


def make_scene(name: str, seed: int = 0) -> Scene:
    """
    Make a scene.

    Parameters
    ----------
    name : str
        One of `SCENES`.
    seed : int
        Seed of all randomness; the same seed gives the same scene.

    Returns
    -------
    Scene

    Raises
    ------
    DataError
        No scene has this name.

    """
    if name not in SCENES:
        raise DataError(f'unknown scene {name!r}; there are {", ".join(SCENES)}')
    return SCENES[name](name, seed)


def _begin(
    name: str, seed: int, route: Float64, half_width: float, relief: float,
    wavelength: float = 400.0, valley: tuple[float, float, float] | None = None,
) -> SceneBuilder:
    rng = np.random.default_rng([seed, *name.encode()])
    low = route.min(axis=0) - half_width - _MARGIN
    high = route.max(axis=0) + half_width + _MARGIN
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    terrain = make_terrain(rng, bounds, relief, wavelength, valley=valley)
    return SceneBuilder(name=name, seed=seed, terrain=terrain, rng=rng)


def _spread(
    builder: SceneBuilder, route: Float64, per_hectare: float, band: tuple[float, float],
) -> Float64:
    """Return random positions (N, 2) at distances in ``band`` from the route [m]."""
    low = route.min(axis=0) - band[1]
    high = route.max(axis=0) + band[1]
    num = builder.rng.poisson(per_hectare * float(np.prod(high - low)) / 1e4)
    xy = builder.rng.uniform(low, high, (num, 2))
    gap = measure_offset(xy, extend_route(route, band[1], band[1]))
    return xy[(gap >= band[0]) & (gap <= band[1])]


def _clump(builder: SceneBuilder, xy: Float64, wavelength: float, share: float) -> Float64:
    """Return the positions in patches that cover about ``share`` of the land."""
    phase = builder.rng.uniform(0.0, 2 * np.pi, 4)
    k = 2 * np.pi / wavelength
    field = (
        np.sin(k * xy[:, 0] + phase[0]) * np.sin(k * xy[:, 1] + phase[1])
        + 0.6 * np.sin(0.6 * k * (xy[:, 0] + xy[:, 1]) + phase[2])
        + 0.6 * np.sin(0.6 * k * (xy[:, 0] - xy[:, 1]) + phase[3])
    )
    return xy[field >= np.quantile(field, 1.0 - share)] if len(xy) else xy


def _pick(builder: SceneBuilder, span_id: int, side: int) -> Conductor:
    """Return the outermost conductor of a span on one side."""
    items = [item for item in builder.conductors if item.span_id == span_id]
    along = (items[0].end - items[0].start)[:2] / items[0].length
    normal = side * np.array([-along[1], along[0]])
    return max(items, key=lambda item: float(np.dot(item.start[:2], normal)))


def _high_voltage(name: str, seed: int) -> Scene:
    route = lay_route((250.0, 310.0, 230.0, 280.0), (0.0, 23.0, 0.0))
    builder = _begin(name, seed, route, 45.0, relief=16.0)
    lines.add_line(builder, lines.HIGH_VOLTAGE, route)
    vegetation.plant_beside(builder, _pick(builder, 0, 1), 0.45, 1, 1.2)
    vegetation.plant_beside(builder, _pick(builder, 1, -1), 0.6, -1, 3.0)
    vegetation.plant_under(builder, _pick(builder, 2, 1), 0.4, 1.8)
    places = _clump(builder, _spread(builder, route, 160.0, (13.0, 60.0)), 160.0, 0.55)
    vegetation.scatter_trees(builder, places, (5.0, 17.0))
    vegetation.scatter_trees(
        builder, _spread(builder, route, 90.0, (0.0, 40.0)), (0.8, 3.0),
        shapes=(vegetation.shape_bush,),
    )
    # the survey ends within the last span: the line continues beyond the cloud
    return builder.build(extend_route(route, 20.0, -60.0), 45.0)


def _low_voltage(name: str, seed: int) -> Scene:
    route = lay_route(
        (42.0, 38.0, 47.0, 40.0, 36.0, 44.0, 39.0, 45.0), (0.0, 9.0, 0.0, -14.0, 0.0, 12.0, 0.0),
    )
    builder = _begin(name, seed, route, 35.0, relief=5.0, wavelength=260.0)
    lines.add_line(builder, lines.LOW_VOLTAGE, route)
    structures.add_village(builder, route)
    structures.add_street_lights(builder, shift_route(route, -7.5), 41.0, 5.0)
    gardens = _spread(builder, route, 150.0, (3.0, 34.0))
    vegetation.scatter_trees(
        builder, structures.keep_off_faces(builder, gardens, _KEEP), (1.0, 9.0), clear=0.4,
        shapes=(vegetation.shape_broadleaf, vegetation.shape_bush, vegetation.shape_conifer),
    )
    vegetation.plant_beside(builder, _pick(builder, 2, 1), 0.5, 1, 1.2, vegetation.shape_poplar)
    return builder.build(extend_route(route, 15.0, 15.0), 35.0)


def _medium_voltage(name: str, seed: int) -> Scene:
    return _forest_line(name, seed, (1.5, 0.6, -0.3, 3.0, 1.0))


def _contact(name: str, seed: int) -> Scene:
    return _forest_line(name, seed, (-0.5, -0.2, -0.8, -0.3, -0.6))


def _forest_line(name: str, seed: int, clearances: tuple[float, ...]) -> Scene:
    route = lay_route((85.0, 105.0, 92.0, 76.0, 98.0), (0.0, 18.0, 0.0, -8.0))
    builder = _begin(name, seed, route, 30.0, relief=8.0, wavelength=300.0)
    lines.add_line(builder, lines.MEDIUM_VOLTAGE, route)
    for i, clearance in enumerate(clearances):
        side = 1 if i % 2 else -1
        shape = vegetation.shape_broadleaf if i % 2 else vegetation.shape_conifer
        shape = shape if clearance > -0.4 else vegetation.shape_broadleaf
        vegetation.plant_beside(
            builder, _pick(builder, i, side), 0.3 + 0.1 * i, side, clearance, shape,
        )
    forest = _spread(builder, route, 420.0, (5.0, 42.0))
    vegetation.scatter_trees(builder, forest, (7.0, 16.0))
    vegetation.scatter_trees(
        builder, _spread(builder, route, 250.0, (0.0, 30.0)), (0.8, 3.0),
        shapes=(vegetation.shape_bush, vegetation.shape_conifer),
    )
    return builder.build(extend_route(route, 15.0, 15.0), 30.0)


def _bundles(name: str, seed: int) -> Scene:
    route = lay_route((230.0, 260.0, 240.0), (0.0, -12.0), 20.0)
    return _open_line(name, seed, lines.BUNDLES, route, 40.0, 8.0)


def _double_circuit(name: str, seed: int) -> Scene:
    route = lay_route((260.0, 290.0, 240.0), (0.0, 15.0), -15.0)
    return _open_line(name, seed, lines.DOUBLE_CIRCUIT, route, 40.0, 10.0)


def _rack(name: str, seed: int) -> Scene:
    route = lay_route((40.0, 37.0, 46.0, 42.0, 38.0), (0.0, 10.0, 0.0, -16.0))
    return _open_line(name, seed, lines.RACK, route, 25.0, 3.0)


def _street(name: str, seed: int) -> Scene:
    route = lay_route((42.0, 38.0, 45.0, 40.0), (0.0, 7.0, 0.0))
    builder = _begin(name, seed, route, 25.0, relief=4.0, wavelength=260.0)
    lines.add_line(builder, lines.LOW_VOLTAGE, route)
    for pole, side, along, across, eaves in (
        (0, 1, 3.0, 12.0, 4.4), (1, 1, 3.0, 13.0, 4.6), (1, -1, -2.0, 15.0, 5.0),
        (2, 1, 0.5, 10.0, 4.3), (3, 1, -4.0, 12.0, 5.5), (3, -1, 4.0, 17.0, 5.0),
    ):
        ahead, left = face_side(route, pole, side)
        wall = route[pole] + along * ahead + across * left
        structures.add_house(
            builder, wall + 4.1 * left, float(np.arctan2(ahead[1], ahead[0])),
            eaves=eaves, ridge=eaves + 2.5,
        )
        lines.add_drop(
            builder, _raise(builder, route[pole] + 0.1 * left, 7.4, route[pole]),
            _raise(builder, wall, eaves + 0.3),
        )
    ahead, left = face_side(route, 2, -1)
    for height in (7.4, 7.1, 6.8, 6.5):  # a line across the street, out of the survey
        lines.add_drop(
            builder, _raise(builder, route[2] + 0.15 * left, height, route[2]),
            _raise(builder, route[2] + 3.0 * ahead + 42.0 * left, height), sag_ratio=0.015,
        )
    gardens = _spread(builder, route, 150.0, (2.0, 25.0))
    vegetation.scatter_trees(
        builder, structures.keep_off_faces(builder, gardens, _KEEP), (1.0, 9.0), clear=0.4,
    )
    return builder.build(extend_route(route, 15.0, 15.0), 20.0)


def _raise(
    builder: SceneBuilder, xy: Float64, height: float, foot: Float64 | None = None,
) -> Float64:
    """Return the point (3,) above xy at a height above the ground there, or at ``foot``."""
    return np.array([*xy, builder.ground(xy if foot is None else foot) + height])


def _angle(name: str, seed: int) -> Scene:
    route = lay_route((95.0, 90.0, 100.0, 85.0), (0.0, 30.0, 0.0), 10.0)
    return _open_line(name, seed, lines.MEDIUM_VOLTAGE, route, 30.0, 6.0)


def _demo(name: str, seed: int) -> Scene:
    route = lay_route((76.0, 84.0, 70.0, 80.0), (0.0, 21.0, 0.0), -8.0)
    builder = _begin(name, seed, route, 32.0, 7.0, wavelength=260.0)
    lines.add_line(builder, lines.MEDIUM_VOLTAGE, route)
    vegetation.plant_beside(builder, _pick(builder, 0, -1), 0.55, -1, 1.5)
    vegetation.plant_beside(
        builder, _pick(builder, 1, 1), 0.4, 1, 3.0, vegetation.shape_conifer,
    )
    vegetation.plant_under(builder, _pick(builder, 3, -1), 0.5, 1.0)
    structures.add_house(builder, route[2] + np.array([14.0, -21.0]), 0.4)
    structures.add_fence(builder, shift_route(route[1:3], -15.0))
    _landscape(builder, route, 32.0, 60.0)
    return builder.build(extend_route(route, 15.0, 15.0), 32.0)


def _open_line(
    name: str, seed: int, style: lines.LineStyle, route: Float64, half: float, relief: float,
) -> Scene:
    builder = _begin(name, seed, route, half, relief)
    lines.add_line(builder, style, route)
    vegetation.plant_under(builder, _pick(builder, 1, 1), 0.35, 3.0)
    vegetation.plant_beside(builder, _pick(builder, 0, -1), 0.6, -1, 1.6)
    _landscape(builder, route, half)
    return builder.build(extend_route(route, 15.0, 15.0), half)


def _landscape(
    builder: SceneBuilder, route: Float64, half: float, per_hectare: float = 150.0,
) -> None:
    """Add groves and bushes, all clear of the conductors."""
    places = _spread(builder, route, per_hectare, (4.0, half + 15.0))
    groves = _clump(builder, places, 130.0, 0.45)
    vegetation.scatter_trees(builder, groves, (4.0, 15.0))
    vegetation.scatter_trees(
        builder, _spread(builder, route, 0.4 * per_hectare, (0.0, half)), (0.8, 3.0),
        shapes=(vegetation.shape_bush,),
    )


def _valley(name: str, seed: int) -> Scene:
    route = lay_route((180.0, 300.0, 170.0))
    builder = _begin(name, seed, route, 40.0, 10.0, valley=(330.0, 35.0, 110.0))
    style = lines.HIGH_VOLTAGE
    lines.add_line(builder, _with_sag(style, 10.0 / 300.0), route)
    vegetation.plant_beside(builder, _pick(builder, 0, 1), 0.5, 1, 2.6)
    _landscape(builder, route, 40.0)
    return builder.build(extend_route(route, 15.0, 15.0), 40.0)


def _with_sag(style: lines.LineStyle, ratio: float) -> lines.LineStyle:
    return replace(style, sag_ratio=(ratio, ratio + 1e-9))


def _crossing(name: str, seed: int) -> Scene:
    route = lay_route((240.0, 250.0))
    builder = _begin(name, seed, route, 55.0, 5.0)
    lines.add_line(builder, lines.HIGH_VOLTAGE, route)
    low = lay_route((70.0, 80.0, 75.0), (), 75.0) + np.array([90.0, -105.0])
    lines.add_line(builder, lines.MEDIUM_VOLTAGE, low)
    _landscape(builder, route, 55.0)
    return builder.build(extend_route(route, 15.0, 15.0), 55.0)


def _hidden(name: str, seed: int) -> Scene:
    route = lay_route((240.0, 260.0, 230.0), (0.0, 10.0))
    builder = _begin(name, seed, route, 40.0, 8.0)
    lines.add_line(builder, lines.HIGH_VOLTAGE, route)
    _landscape(builder, route, 40.0)
    builder.conductors = [
        replace(item, hidden=(0.33, 0.66)) if item.span_id == 1
        else replace(item, hidden=(0.05, 0.4)) if (item.line_id, item.span_id) == (2, 0) else item
        for item in builder.conductors
    ]
    return builder.build(extend_route(route, 15.0, 15.0), 40.0)


def _no_line(name: str, seed: int) -> Scene:
    route = lay_route((150.0, 120.0, 130.0), (15.0, -20.0))
    builder = _begin(name, seed, route, 50.0, relief=14.0, wavelength=250.0)
    structures.add_village(builder, route[:2], spacing=30.0)
    structures.add_guard_rail(builder, shift_route(route, 5.0))
    structures.add_fence(builder, shift_route(route[1:], -14.0))
    forest = _spread(builder, route[1:], 350.0, (16.0, 60.0))
    kept = structures.keep_off_faces(builder, forest, _KEEP)
    vegetation.scatter_trees(builder, kept, (5.0, 18.0))
    bushes = _spread(builder, route, 80.0, (6.0, 50.0))
    vegetation.scatter_trees(
        builder, bushes, (0.8, 3.0), shapes=(vegetation.shape_bush,),
    )
    return builder.build(extend_route(route, 10.0, 10.0), 50.0)


def _town(name: str, seed: int) -> Scene:
    route = lay_route((130.0, 110.0, 120.0), (20.0, -30.0), 5.0)
    builder = _begin(name, seed, route, 50.0, relief=4.0)
    structures.add_village(builder, route, setback=15.0, spacing=17.0)
    for low, high in pairwise(route):
        u = (high - low) / np.hypot(*(high - low))
        for side in (-1.0, 1.0):
            middle = 0.5 * (low + high) + side * 36.0 * np.array([-u[1], u[0]])
            structures.add_house(
                builder, middle, float(np.arctan2(u[1], u[0])), length=62.0, width=10.0,
                eaves=6.5, ridge=9.5,
            )
    structures.add_street_lights(builder, shift_route(route, 5.0), 26.0)
    structures.add_street_lights(builder, shift_route(route, -5.0), 31.0, 6.0)
    structures.add_guard_rail(builder, shift_route(route, 4.2))
    structures.add_rails(builder, shift_route(route, 45.0))
    structures.add_rails(builder, shift_route(route, -44.0))
    structures.add_footbridge(builder, route[1] + [-12.0, -26.0], route[1] + [-14.0, 22.0])
    structures.add_fence(builder, shift_route(route, 48.0), 2.0, 4)
    row = walk_route(shift_route(route, 7.0), 9.0)
    vegetation.scatter_trees(
        builder, row, (6.0, 9.0), shapes=(vegetation.shape_broadleaf, vegetation.shape_poplar),
    )
    hedge = walk_route(shift_route(route, 27.0), 0.8)
    vegetation.scatter_trees(builder, hedge, (1.8, 2.2), shapes=(vegetation.shape_bush,))
    return builder.build(extend_route(route, 10.0, 10.0), 52.0)


SCENES: dict[str, Callable[[str, int], Scene]] = {
    'high_voltage': _high_voltage,
    'low_voltage': _low_voltage,
    'medium_voltage': _medium_voltage,
    'no_line': _no_line,
    'bundles': _bundles,
    'double_circuit': _double_circuit,
    'rack': _rack,
    'street': _street,
    'angle': _angle,
    'valley': _valley,
    'crossing': _crossing,
    'hidden': _hidden,
    'contact': _contact,
    'town': _town,
    'demo': _demo,
}
"""Makers of scenes by name; each takes its name and a seed."""
