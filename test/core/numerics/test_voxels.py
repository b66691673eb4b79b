# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from plc_inspect.core.numerics.hash_table import find_slot
from plc_inspect.core.numerics.voxels import (
    add_shifted,
    build_voxels,
    coarsen,
    find_voxels,
    pack,
)
from plc_inspect.errors import DataError

ORIGIN = np.array([-5.0, -5.0, -5.0])


def build(points, size=0.5, chosen=None, origin=ORIGIN):
    points = np.asarray(points, float).reshape(-1, 3)
    chosen = np.arange(len(points)) if chosen is None else np.asarray(chosen)
    return build_voxels(points, chosen, origin, size)


def make_points(num=2000, seed=0):
    return np.random.default_rng(seed).uniform(-4, 4, (num, 3))


def as_dictionary(voxels):
    keys = map(tuple, voxels.index.tolist())
    return dict(zip(keys, voxels.moments, strict=True))


def test_toy_case_by_hand():
    voxels = build([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [0.6, 0.1, 0.1]])
    assert sorted(map(tuple, voxels.index.tolist())) == [(10, 10, 10), (11, 10, 10)]
    first = as_dictionary(voxels)[(10, 10, 10)]
    # from the centre (0.25, 0.25, 0.25): x -0.15 and 0.05, y and z -0.15
    np.testing.assert_allclose(
        first, [2, -0.1, -0.3, -0.3, 0.025, 0.015, 0.015, 0.045, 0.045, 0.045], atol=1e-12
    )


def test_moments_are_those_of_numpy():
    points = make_points()
    voxels = build(points)
    cell = np.floor((points - ORIGIN) / 0.5).astype(int)
    assert voxels.moments[:, 0].sum() == len(points)
    for index, row, centroid in zip(
        voxels.index[::20], voxels.moments[::20], voxels.centroids()[::20], strict=True
    ):
        own = points[(cell == index).all(axis=1)]
        assert row[0] == len(own)
        np.testing.assert_allclose(centroid, own.mean(axis=0), atol=1e-12)
        mean = row[1:4] / row[0]
        covariance = row[[4, 5, 6, 7, 8, 9]] / row[0] - np.outer(mean, mean)[np.triu_indices(3)]
        expected = np.cov(own.T, bias=True).reshape(3, 3)[np.triu_indices(3)]
        np.testing.assert_allclose(covariance, expected, atol=1e-12)


def test_coarse_voxels_are_exactly_those_built_from_the_points():
    points = make_points()
    merged, direct = coarsen(build(points, 0.25)), build(points, 0.5)
    assert merged.size == direct.size
    one, other = as_dictionary(merged), as_dictionary(direct)
    assert one.keys() == other.keys()
    for key, row in one.items():
        np.testing.assert_allclose(row, other[key], atol=1e-10)


def test_every_key_finds_its_slot_and_no_other_does():
    voxels = build(make_points())
    taken = set(map(tuple, voxels.index.tolist()))
    for slot, (x, y, z) in enumerate(voxels.index.tolist()):
        assert find_slot(pack(x, y, z), voxels.table, voxels.key) == slot
    for place in [(0, 0, 0), (1, 2, 3), (700, 3, 9)]:
        if place not in taken:
            assert find_slot(pack(*place), voxels.table, voxels.key) == -1


def test_points_find_their_voxels_as_by_numpy():
    points = make_points()
    chosen = np.arange(0, len(points), 3)
    voxels = build_voxels(points, chosen, ORIGIN, 1.0)
    expected = np.floor(points[chosen] - ORIGIN).astype(int)
    np.testing.assert_array_equal(voxels.index[find_voxels(points, chosen, voxels)], expected)
    np.testing.assert_array_equal(voxels.index, np.unique(expected, axis=0))
    assert (np.diff(voxels.key) > 0).all()


@given(st.integers(0, 2**32), st.integers(1, 40))
@settings(max_examples=30, deadline=None)
def test_chunks_add_up_to_the_whole(seed, cut):
    points = make_points(60, seed)
    whole = as_dictionary(build(points))
    total = {}
    for part in (np.arange(cut), np.arange(cut, 60)):
        for key, row in as_dictionary(build(points, chosen=part)).items():
            total[key] = total.get(key, 0) + row
    assert whole.keys() == total.keys()
    for key, row in whole.items():
        np.testing.assert_allclose(row, total[key], atol=1e-9)


@given(st.integers(0, 2**32))
@settings(max_examples=30, deadline=None)
def test_shifted_moments_are_those_of_shifted_points(seed):
    rng = np.random.default_rng(seed)
    points, shift = rng.normal(size=(9, 3)), rng.normal(size=3)

    def moments(p):
        pairs = [(p[:, i] * p[:, j]).sum() for i in range(3) for j in range(i, 3)]
        return np.array([len(p), *p.sum(axis=0), *pairs])

    total = np.zeros(10)
    add_shifted(total, moments(points), *shift)
    np.testing.assert_allclose(total, moments(points + shift), atol=1e-10)


def test_the_order_of_points_changes_only_the_order_of_voxels():
    points = make_points()
    one = as_dictionary(build(points))
    other = as_dictionary(build(points[::-1].copy()))
    assert one.keys() == other.keys()
    for key, row in one.items():
        np.testing.assert_allclose(row, other[key], atol=1e-10)


def test_nothing_is_lost_at_coordinates_as_large_as_utm():
    shift = np.array([5e5, 6.6e6, 300.0])
    points = make_points()
    near, far = build(points), build(points + shift, origin=ORIGIN + shift)
    one, other = as_dictionary(near), as_dictionary(far)
    shared = one.keys() & other.keys()
    assert len(shared) >= 0.99 * len(one)
    np.testing.assert_allclose(
        far.centroids().mean(axis=0) - shift, near.centroids().mean(axis=0), atol=1e-3
    )


def test_only_chosen_points_are_taken():
    points = make_points(10)
    points[3] = np.nan
    assert build(points, chosen=[0, 5, 7]).moments[:, 0].sum() == 3


@pytest.mark.parametrize('num', [0, 1])
def test_few_points(num):
    voxels = build(np.zeros((num, 3)))
    assert len(voxels) == num
    assert voxels.index.shape == voxels.centroids().shape == (num, 3)
    assert voxels.moments.shape == (num, 10)
    assert voxels.index.dtype == np.int32
    assert len(coarsen(voxels)) == num


def test_duplicates_share_a_voxel():
    voxels = build(np.tile([1.2, 0.3, 0.4], (50, 1)))
    assert voxels.moments[:, 0].tolist() == [50]
    np.testing.assert_allclose(voxels.centroids(), [[1.2, 0.3, 0.4]])


def test_input_is_unchanged():
    points, chosen = make_points(100), np.arange(100)
    before = points.copy()
    build(points, chosen=chosen)
    np.testing.assert_array_equal(points, before)
    np.testing.assert_array_equal(chosen, np.arange(100))


def test_an_extent_beyond_the_keys_raises():
    with pytest.raises(DataError, match=r'600005 m, too much for voxels of 0.5 m'):
        build([[0, 0, 0], [600_000.0, 0, 0]])
