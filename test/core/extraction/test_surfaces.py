# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Roofs and walls against foliage."""

import numpy as np
import pytest

from plc_inspect.core.extraction.linearity import measure_likeness
from plc_inspect.core.extraction.surfaces import is_surface, MIN_POINTS, PLANAR, SIZE, SPHERICAL
from plc_inspect.core.numerics.voxels import build_voxels


def make_scene(rng, offset=(0.0, 0.0, 0.0)):
    """Make a flat roof of 4000 points and a crown of 400, 20 m apart."""
    roof = np.column_stack([rng.uniform(0, 6, (4000, 2)), rng.normal(5.0, 0.01, 4000)])
    crown = rng.normal((20.0, 0.0, 6.0), 1.5, (400, 3))
    return np.vstack([roof, crown]) + offset


@pytest.mark.parametrize('offset', [(0.0, 0.0, 0.0), (250_000.0, 4_100_000.0, -30.0)])
def test_a_roof_is_a_surface_and_a_crown_is_not(offset):
    points = make_scene(np.random.default_rng(0), offset)
    flat = is_surface(points)
    inner = (np.abs(points[:4000, :2] - np.array(offset[:2]) - 3.0) < 1.5).all(axis=1)
    assert flat[:4000][inner].mean() > 0.97
    assert flat[4000:].mean() < 0.2


@pytest.mark.parametrize('seed', range(5))
def test_it_is_the_likeness_of_the_voxel_a_point_lies_in(seed):
    rng = np.random.default_rng(seed)
    points = make_scene(rng)
    chosen = np.flatnonzero(rng.random(len(points)) < 0.3)
    origin = np.floor((points[chosen].min(axis=0) - 2.0) / SIZE) * SIZE
    voxels = build_voxels(points, chosen, origin, SIZE)
    likeness = measure_likeness(voxels)
    good = (
        (likeness.planar >= PLANAR) & (likeness.spherical <= SPHERICAL)
        & (likeness.count >= MIN_POINTS)
    )
    own = np.floor((points[chosen] - origin) / SIZE).astype(int)
    expected = [good[np.flatnonzero((voxels.index == row).all(axis=1))[0]] for row in own]
    np.testing.assert_array_equal(is_surface(points[chosen]), expected)


def test_the_order_of_points_does_not_matter():
    rng = np.random.default_rng(3)
    points = make_scene(rng)
    order = rng.permutation(len(points))
    flat = is_surface(points)
    shuffled = is_surface(points[order])
    assert (shuffled == flat[order]).mean() > 0.999  # sums in another order


@pytest.mark.parametrize('num', [0, 1, MIN_POINTS - 1])
def test_too_few_points_are_no_surface(num):
    points = np.zeros((10, 3))
    points[:, 0] = np.arange(10) * 100.0
    before = points.copy()
    flat = is_surface(points[:num])
    assert flat.shape == (num,)
    assert flat.dtype == bool
    assert not flat.any()
    np.testing.assert_array_equal(points, before)
