# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes: what each promises, and that a seed fixes everything."""

import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.sim.scenes import lines, vegetation
from plc_inspect.sim.scenes.catalogue import lay_route, make_scene, SCENES
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.scene import measure_offset, SceneBuilder
from plc_inspect.sim.scenes.terrain import Terrain

pytestmark = pytest.mark.slow

WIRELESS = ('no_line', 'town')


@pytest.fixture(scope='module')
def scenes():
    """Make every scene once."""
    return {name: make_scene(name, 2) for name in SCENES}


def _measure_hulls(scene):
    """Return the distance of each crown's hull to the nearest conductor."""
    gaps = np.min([
        measure_distances(scene.blobs[:, :3], item) for item in scene.conductors
    ], axis=0) - scene.blobs[:, 3]
    return np.minimum.reduceat(gaps, scene.crowns[:-1])


@pytest.mark.parametrize('name', SCENES)
def test_conductors_of_a_span_hang_alike(scenes, name):
    """One constant a span, ends shared from span to span, nothing near the ground."""
    scene = scenes[name]
    assert bool(scene.conductors) is (name not in WIRELESS)
    constants = {}
    for item in scene.conductors:
        constants.setdefault(item.span_id, set()).add(item.c)
        curve = item.sample(1.0)
        assert (curve[:, 2] - scene.terrain.heights(curve[:, :2])).min() > 4.0
    assert all(len(values) == 1 for values in constants.values())
    ends = {(item.line_id, item.span_id): item for item in scene.conductors}
    for (line_id, span_id), item in ends.items():
        after = ends.get((line_id, span_id + 1))
        if after is not None:
            np.testing.assert_allclose(item.end, after.start, atol=1e-9)


@pytest.mark.parametrize('name', [name for name in SCENES if name not in WIRELESS])
def test_vegetation_is_planted_or_clear(scenes, name):
    """Planted crowns are exactly as near as was said, all others keep clear."""
    scene = scenes[name]
    hulls = np.sort(_measure_hulls(scene))
    planted = np.sort([item.clearance for item in scene.planted])
    if name not in ('low_voltage', 'street'):
        np.testing.assert_allclose(hulls[:len(planted)], planted, atol=0.02)
        assert hulls[len(planted)] > 4.65
    else:
        assert all(np.abs(hulls - gap).min() < 0.02 for gap in planted)
        assert hulls[0] > 0.35


def test_scenes_are_what_their_names_say(scenes):
    """Numbers of lines, turns and shapes of the issue's list."""
    lines_of = {name: scene.num_lines for name, scene in scenes.items()}
    assert lines_of == {
        'high_voltage': 5, 'low_voltage': 4, 'medium_voltage': 3, 'no_line': 0, 'bundles': 8,
        'double_circuit': 7, 'rack': 4, 'street': 14, 'angle': 3, 'valley': 5, 'crossing': 8,
        'hidden': 5, 'contact': 3, 'town': 0, 'demo': 3,
    }
    valley = next(item for item in scenes['valley'].conductors if item.span_id == 1)
    assert valley.length == pytest.approx(300.0)
    assert valley.sag == pytest.approx(10.0, abs=0.1)
    first, second = (
        next(item for item in scenes['angle'].conductors if item.span_id == number)
        for number in (1, 2)
    )
    assert np.degrees(second.azimuth - first.azimuth) == pytest.approx(30.0, abs=1.5)
    low = [item.start for item in scenes['low_voltage'].conductors if item.span_id == 0]
    assert np.linalg.norm(np.diff(low, axis=0), axis=1) == pytest.approx([0.4] * 3)
    rack = [item.start for item in scenes['rack'].conductors if item.span_id == 0]
    assert np.diff(rack, axis=0)[:, 2] == pytest.approx([-0.4] * 3)
    drops = [item.length for item in scenes['street'].conductors if item.line_id >= 4]
    assert sum(length < 20.0 for length in drops) == 6
    assert sum(item.hidden is not None for item in scenes['hidden'].conductors) == 6


def test_crossing_lines_keep_their_distance(scenes):
    """The low line passes under the high one, well clear of it."""
    scene = scenes['crossing']
    low = np.vstack([item.sample(0.5) for item in scene.conductors if item.line_id >= 5])
    high = [item for item in scene.conductors if item.line_id < 5]
    gap = min(float(measure_distances(low, item).min()) for item in high)
    assert gap > 2.5


def test_seed_fixes_the_scene():
    """The same seed gives the same bytes, another seed another scene."""
    first, again, other = (make_scene('angle', seed) for seed in (5, 5, 6))
    assert first.blobs.tobytes() == again.blobs.tobytes()
    assert first.terrain.grid.tobytes() == again.terrain.grid.tobytes()
    assert first.blobs.shape != other.blobs.shape or (first.blobs != other.blobs).any()


def test_unknown_scene_raises():
    """The message lists what there is."""
    with pytest.raises(DataError, match=r"unknown scene 'moon'.*high_voltage"):
        make_scene('moon')


def test_new_scene_is_a_few_lines():
    """Parts compose: a line of one's own with a tree under it."""
    route = lay_route((60.0, 50.0), (90.0,))
    np.testing.assert_allclose(route, [[0, 0], [60, 0], [60, 50]], atol=1e-9)
    terrain = Terrain(x0=-80.0, y0=-80.0, cell=4.0, grid=np.zeros((60, 60)))
    builder = SceneBuilder(name='mine', seed=0, terrain=terrain, rng=np.random.default_rng(0))
    lines.add_line(builder, lines.RACK, route)
    vegetation.plant_under(builder, builder.conductors[3], 0.5, 2.0)
    scene = builder.build(route, 20.0)
    assert len(scene.conductors) == 8
    assert _measure_hulls(scene) == pytest.approx([2.0], abs=0.01)
    with pytest.raises(DataError, match='no tree fits'):
        vegetation.plant_under(builder, builder.conductors[0], 0.5, 30.0)


def test_corridor_and_area_by_hand():
    """A 100 m route of half width 10 covers 2000 m2; its ends are square."""
    route = np.array([[0.0, 0.0], [100.0, 0.0]])
    xy = np.array([[50.0, 9.9], [50.0, 10.1], [-0.1, 0.0], [100.0, -10.0]])
    assert measure_offset(xy, route).tolist() == pytest.approx([9.9, 10.1, np.inf, 10.0])
    terrain = Terrain(x0=-80.0, y0=-80.0, cell=4.0, grid=np.zeros((60, 60)))
    builder = SceneBuilder(name='mine', seed=0, terrain=terrain, rng=np.random.default_rng(0))
    scene = builder.build(route, 10.0)
    assert scene.covers(xy).tolist() == [True, False, False, True]
    assert scene.area == pytest.approx(2000.0, rel=0.01)
