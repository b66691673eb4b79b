# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import tracemalloc

import numpy as np
import pytest
from toys import make_ground

from plc_inspect.core.ground.ground_planes import find_planes


def test_ground_of_sites_far_apart_is_that_of_each_alone_in_little_memory():
    site = make_ground((0.0, 0.0), (40.0, 40.0), per_square_metre=5.0)
    feet = np.column_stack([np.linspace(5.0, 35.0, 7), np.linspace(30.0, 8.0, 7), np.full(7, 0.2)])
    away = np.array([60e3, 50e3, 90.0])
    points, places = np.vstack([site, site + away]), np.vstack([feet, feet + away])
    height = np.zeros(len(points), dtype=np.float32)
    alone = find_planes(site, height[: len(site)], feet)
    tracemalloc.start()
    both = find_planes(points, height, places)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200e6
    assert np.isfinite(alone[0]).all()
    for found, expected, rise in zip(both, alone, (90.0, 0.0), strict=True):
        np.testing.assert_allclose(found, np.concatenate([expected, expected + rise]), atol=1e-9)


def lay(shape, density, rough=0.02, seed=0):
    """Return points on a surface about the origin, and heights above the lowest of cells."""
    rng = np.random.default_rng(seed)
    plan = rng.uniform(-5.0, 5.0, (int(density * 100.0), 2))
    points = np.column_stack([plan, shape(*plan.T) + rng.normal(0.0, rough, len(plan))])
    cell = np.floor(plan + 5.0).astype(int)
    lowest = np.full((10, 10), np.inf)
    np.minimum.at(lowest, tuple(cell.T), points[:, 2])
    return points, (points[:, 2] - lowest[tuple(cell.T)]).astype(np.float32)


SHAPES = {
    'heap': lambda x, y: -0.75 * np.hypot(x, y),
    'dyke': lambda x, y: -0.75 * np.abs(0.6 * x + 0.8 * y) + 0.2 * y,
    'slope': lambda x, y: 0.75 * x - 0.3 * y,
}


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('density', [8.0, 40.0])
@pytest.mark.parametrize('shape', SHAPES.values(), ids=SHAPES.keys())
def test_the_ground_of_a_crest_is_its_crest(shape, density, seed):
    ground, sigma = find_planes(*lay(shape, density, seed=seed), np.zeros((1, 3)))
    assert abs(ground[0]) < 0.13
    assert sigma[0] < 0.06


@pytest.mark.parametrize('bottom', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('aside', [0.0, 0.25])
@pytest.mark.parametrize('unseen', [0.0, 0.5])
def test_the_ground_of_a_hollow_is_never_too_low(bottom, aside, unseen):
    points, height = lay(
        lambda x, y: 0.75 * np.clip(np.abs(x - aside) - bottom / 2.0, 0.0, 1.0), 20.0
    )
    seen = np.abs(points[:, 0] - aside) >= unseen
    true = 0.75 * max(aside - bottom / 2.0, 0.0)
    ground, _ = find_planes(points[seen], height[seen], np.array([[0.0, 0.0, true]]))
    assert not ground[0] < true - 0.05


def test_what_grows_on_one_side_bends_no_ground():
    points, height = lay(SHAPES['slope'], 40.0)
    rise = np.random.default_rng(1).uniform(0.0, 0.45, len(points)) * (points[:, 1] > 0.0)
    points[:, 2] += rise
    ground, _ = find_planes(points, height + rise.astype(np.float32), np.zeros((1, 3)))
    assert abs(ground[0]) < 0.08


def test_returns_from_below_the_ground_draw_no_plane_down():
    points, height = lay(SHAPES['slope'], 20.0)
    low = np.arange(len(points)) % 8 == 0
    points[low, 2] -= 2.0
    ground, _ = find_planes(points, height - 2.0 * low.astype(np.float32), np.zeros((1, 3)))
    assert abs(ground[0]) < 0.05
