# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Airborne maps: labels, densities, and points that lie where they should."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from plc_inspect.errors import DataError
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.scene import Label
from plc_inspect.sim.surveys.airborne import simulate_map


@pytest.fixture(scope='module')
def scene():
    """Make a small scene."""
    return make_scene('rack', 3)


@pytest.fixture(scope='module')
def cloud(scene):
    """Scan it at 20 pulses per square metre."""
    return simulate_map(scene, 20.0, np.random.default_rng(0))


def test_wire_points_lie_on_their_conductors(scene, cloud):
    """Each wire point is within noise of the catenary that its labels name."""
    for number, item in enumerate(scene.conductors):
        rows = cloud.conductor == number
        assert (cloud.label[rows] == Label.WIRE).all()
        assert (cloud.line_id[rows] == item.line_id).all()
        assert (cloud.span_id[rows] == item.span_id).all()
        assert measure_distances(cloud.exact[rows], item).max() < 1e-3
        off = measure_distances(cloud.points[rows], item)
        assert np.sqrt(np.mean(off**2)) == pytest.approx(0.03 * np.sqrt(2), rel=0.15)
    assert (cloud.line_id[cloud.label != Label.WIRE] == -1).all()


def test_other_points_lie_on_their_objects(scene, cloud):
    """Ground is on the terrain, leaves are inside a crown or trunk."""
    ground = cloud.exact[cloud.label == Label.GROUND]
    np.testing.assert_allclose(ground[:, 2], scene.terrain.heights(ground[:, :2]), atol=1e-3)
    leaf = cloud.exact[cloud.label == Label.VEGETATION][::50]
    gap = np.linalg.norm(leaf[:, None] - scene.blobs[None, :, :3], axis=2) - scene.blobs[:, 3]
    assert np.mean(gap.min(axis=1) < 1e-6) > 0.95
    assert scene.covers(cloud.exact[:, :2]).all()


@pytest.mark.parametrize(('density', 'low', 'high'), [(5.0, 3.0, 4.0), (20.0, 8.0, 15.0)])
def test_density_of_ground_and_wire(scene, density, low, high):
    """Points per square metre follow the density, points per metre of wire with them."""
    cloud = simulate_map(scene, density, np.random.default_rng(1))
    assert len(cloud.points) / scene.area == pytest.approx(density, rel=0.25)
    total = sum(item.length for item in scene.conductors)
    assert low <= (cloud.label == Label.WIRE).sum() / total <= high


def test_canopy_hides_ground_but_not_all_of_it():
    """Under the crowns of a forest there is less ground than in the open, but some."""
    scene = make_scene('contact', 1)
    cloud = simulate_map(scene, 5.0, np.random.default_rng(1))
    ground = cloud.exact[cloud.label == Label.GROUND]
    tops = scene.blobs[scene.blobs[:, 3] > 1.5]
    spots = np.random.default_rng(2).uniform(ground.min(axis=0), ground.max(axis=0), (40_000, 3))
    spots = spots[scene.covers(spots[:, :2])]
    under, shade = np.zeros(len(ground), dtype=bool), np.zeros(len(spots), dtype=bool)
    for places, covered in ((ground, under), (spots, shade)):
        below = cKDTree(places[:, :2]).query_ball_point(tops[:, :2], tops[:, 3])
        covered[np.concatenate(below).astype(int)] = True
    rate = under.mean() / shade.mean() / ((~under).mean() / (~shade).mean())
    assert 0.05 < rate < 0.75


def test_exact_number_of_points(scene):
    """A given number of points is met exactly; the same generator gives the same bytes."""
    first = simulate_map(scene, 2.0, np.random.default_rng(9), num_points=50_001)
    again = simulate_map(scene, 2.0, np.random.default_rng(9), num_points=50_001)
    assert first.points.shape == (50_001, 3)
    assert first.points.dtype == np.float64
    assert first.points.tobytes() == again.points.tobytes()


@pytest.mark.parametrize(('density', 'num'), [(0.0, None), (-1.0, None), (5.0, 0)])
def test_impossible_maps_raise(scene, density, num):
    """No map without points."""
    with pytest.raises(DataError, match='no map with'):
        simulate_map(scene, density, np.random.default_rng(0), num_points=num)
