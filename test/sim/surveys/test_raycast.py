# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ray caster against scenes whose answers are known by hand, and against brute force."""

from dataclasses import replace

import numpy as np
import pytest

from plc_inspect.sim.scenes.conductors import hang
from plc_inspect.sim.scenes.scene import Label, SceneBuilder
from plc_inspect.sim.scenes.terrain import make_terrain, Terrain
from plc_inspect.sim.surveys.ray_kernels import GROUND, MISS
from plc_inspect.sim.surveys.raycast import Beam, build_world, cast, label_items

ROUTE = np.array([[-50.0, 0.0], [50.0, 0.0]])
SHARP = Beam(divergence=0.0, exit_width=0.0, wire_range=1e9)


def make_builder(height=0.0):
    """Begin a scene on flat ground, 160 m square."""
    terrain = Terrain(x0=-80.0, y0=-80.0, cell=2.0, grid=np.full((81, 81), height))
    return SceneBuilder(name='toy', seed=0, terrain=terrain, rng=np.random.default_rng(0))


def shoot(builder, origin, target, beam=SHARP, reach=100.0):
    """Cast one beam and return range and item, and what the item is."""
    scene = builder.build(ROUTE, 40.0)
    world = build_world(scene)
    origin, target = np.array([origin], float), np.array([target], float)
    direction = (target - origin) / np.linalg.norm(target - origin)
    ranges, items = cast(world, origin, direction, np.array([reach]), beam, 1)
    return ranges[0], items[0], label_items(scene, world).label[items[0]]


def test_flat_ground_by_hand():
    """A 3-4-5 triangle: 6 m up, 8 m away, so 10 m along the beam."""
    ranges, items, _ = shoot(make_builder(), (0, 0, 6), (8, 0, 0))
    assert items[0] == GROUND
    assert ranges[0] == pytest.approx(10.0, abs=1e-4)


def test_beam_into_the_sky_or_too_far_misses():
    """Nothing above, nothing beyond reach, nothing beside the grid."""
    assert shoot(make_builder(), (0, 0, 6), (8, 0, 9))[1][0] == MISS
    assert shoot(make_builder(), (0, 0, 6), (8, 0, 0), reach=9.9)[1][0] == MISS
    assert shoot(make_builder(), (200, 0, 6), (300, 0, 5))[1][0] == MISS


def test_solid_objects_by_hand():
    """A wall 10 m away is hit before the pole behind it; without it, the pole's near side."""
    builder = make_builder()
    builder.add_strut(np.array([20.0, 0, 0]), np.array([20.0, 0, 9]), 0.25, Label.TOWER)
    ranges, _, label = shoot(builder, (0, 0, 5), (20, 0, 5))
    assert (ranges[0], label[0]) == (pytest.approx(19.75, abs=1e-6), Label.TOWER)
    wall = np.array([[10.0, -3, 0], [10, 3, 0], [10, 3, 6], [10, -3, 6]])
    builder.add_face(wall, Label.BUILDING)
    ranges, _, label = shoot(builder, (0, 0, 5), (20, 0, 5))
    assert (ranges[0], label[0]) == (pytest.approx(10.0, abs=1e-9), Label.BUILDING)
    ranges, _, label = shoot(builder, (0, 0, 5), (20, 0, 9))
    assert label[0] == Label.TOWER


@pytest.mark.parametrize(('offset', 'hit'), [(0.0, True), (0.009, True), (0.012, False)])
def test_sharp_beam_meets_a_wire_within_its_radius(offset, hit):
    """A beam without width meets a wire of 1 cm radius exactly within 1 cm of its axis."""
    builder = make_builder()
    builder.conductors.append(hang(
        np.array([-40.0, 15, 20]), np.array([40.0, 15, 24]), 0.03, line_id=3, span_id=7))
    point = builder.conductors[0].locate(np.array([33.3]))[0] + [0.0, 0.0, offset]
    ranges, items, label = shoot(builder, (-6.7, 0.0, point[2]), point)
    assert bool(items[0] >= 0) is hit
    if hit:
        assert label[0] == Label.WIRE
        assert ranges[0] == pytest.approx(15.0, abs=1e-3)


def test_wires_return_less_often_with_range():
    """The share of beams that a thin wire returns falls with the range, never above one."""
    builder = make_builder()
    builder.conductors.append(hang(
        np.array([-60.0, 0, 10]), np.array([60.0, 0, 10]), 0.02, line_id=0, span_id=0,
        radius=0.007))
    world = build_world(builder.build(ROUTE, 40.0))
    target = builder.conductors[0].locate(np.linspace(20.0, 100.0, 4000))
    shares = []
    for distance in (5.0, 15.0, 30.0, 60.0):
        origins = target + np.array([0.0, distance, 0.0])
        directions = np.tile([0.0, -1.0, 0.0], (len(target), 1))
        _, items = cast(world, origins, directions, np.full(len(target), 100.0), Beam(), 5)
        shares.append(float((items != MISS).mean()))
    assert shares[0] > 0.95
    assert shares == sorted(shares, reverse=True)
    assert 0.01 < shares[-1] < 0.3


def test_crown_lets_through_what_its_extinction_says():
    """Through 4 m of leaves at 0.5 per metre, exp(-2) of the beams pass; hits lie inside."""
    builder = make_builder()
    builder.add_blobs(np.array([[0.0, 0, 30, 2.0, 0.5]]))
    world = build_world(builder.build(ROUTE, 40.0))
    num = 20_000
    origins = np.tile([-10.0, 0.0, 30.0], (num, 1))
    ranges, items = cast(
        world, origins, np.tile([1.0, 0, 0], (num, 1)), np.full(num, 50.0), SHARP, 3)
    passed = float((items == MISS).mean())
    assert passed == pytest.approx(np.exp(-2.0), abs=0.01)
    hits = ranges[items != MISS]
    assert hits.min() > 8.0
    assert hits.max() < 12.0


def test_pulse_goes_on_behind_a_wire():
    """With several returns a pulse meets the wire and then the ground under it."""
    builder = make_builder()
    builder.conductors.append(hang(
        np.array([-30.0, 0, 12]), np.array([30.0, 0, 12]), 0.02, line_id=0, span_id=0))
    top = float(builder.conductors[0].locate(np.array([20.0]))[0, 2])
    ranges, items, label = shoot(
        builder, (-10.0, 0.1, 40), (-10.0, 0.1, 0), Beam(wire_reach=0.3, max_returns=4))
    assert label[:2].tolist() == [Label.WIRE, Label.GROUND]
    assert ranges[:2] == pytest.approx([40.0 - top, 40.0], abs=1e-3)
    assert (items[2:] == MISS).all()


def test_hidden_stretch_is_not_seen():
    """Beams find a conductor on both sides of its hidden stretch, and nothing on it."""
    builder = make_builder()
    item = hang(np.array([-50.0, 0, 12]), np.array([50.0, 0, 12]), 0.02, line_id=0, span_id=0)
    builder.conductors.append(replace(item, hidden=(0.4, 0.6)))
    for x, found in ((30.0, True), (50.0, False), (70.0, True)):
        point = item.locate(np.array([x]))[0]
        _, _, label = shoot(builder, point + np.array([0, 0, 20]), point, Beam(wire_reach=0.3))
        assert bool(label[0] == Label.WIRE) is found


def test_grid_walk_against_brute_force():
    """The grid finds the same first triangle or ground as trying all of them."""
    rng = np.random.default_rng(4)
    builder = make_builder()
    builder.terrain = make_terrain(rng, (-80.0, -80.0, 80.0, 80.0), 10.0, 60.0)
    for _ in range(60):
        corner = rng.uniform((-60, -60, 0), (60, 60, 15))
        builder.add_face(corner + rng.normal(0, 6, (3, 3)), Label.OTHER)
    scene = builder.build(ROUTE, 40.0)
    origins = rng.uniform((-40, -40, 12), (40, 40, 25), (400, 3))
    directions = rng.normal(0, 1, (400, 3)) * [1, 1, 0.4]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ranges, _ = cast(build_world(scene), origins, directions, np.full(400, 35.0), SHARP, 1)
    t = np.arange(0.0, 35.0, 0.02)
    for origin, direction, found in zip(origins, directions, ranges[:, 0], strict=True):
        along = origin + t[:, None] * direction
        under = np.flatnonzero(along[:, 2] < scene.terrain.heights(along[:, :2]))
        expected = t[under[0]] if len(under) else np.inf
        for corners in scene.triangles.reshape(-1, 3, 3):
            edges = np.column_stack([corners[1] - corners[0], corners[2] - corners[0], -direction])
            u, v, reach = np.linalg.solve(edges, origin - corners[0])
            if min(u, v) >= 0 and u + v <= 1 and 0 < reach < 35.0:
                expected = min(expected, reach)
        if np.isfinite(expected) and np.isfinite(found):
            assert found == pytest.approx(expected, abs=0.15)
        else:
            assert np.isinf(expected) == np.isinf(found)
