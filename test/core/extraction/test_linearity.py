# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from toys import make_tree, make_wire, turn

from plc_inspect.config import LinearitySettings
from plc_inspect.core.extraction.linearity import (
    find_candidates,
    measure_likeness,
)
from plc_inspect.core.extraction.occupancy import drop_bulk
from plc_inspect.core.numerics.eigen import principal_axis
from plc_inspect.core.numerics.voxels import build_voxels
from plc_inspect.errors import ConfigError

SETTINGS = LinearitySettings()


def find(points, **changes):
    points = np.asarray(points, float).reshape(-1, 3)
    origin = points.min(axis=0) - 1.0 if len(points) else np.zeros(3)
    return find_candidates(points, np.arange(len(points)), origin, LinearitySettings(**changes))


def make_plate(num=4000, seed=0):
    return np.random.default_rng(seed).uniform((0, 0, 10), (12, 12, 10.02), (num, 3))


@given(arrays(np.int64, (3, 3), elements=st.integers(-999, 999)))
@settings(max_examples=300, deadline=None)
def test_principal_axis_is_that_of_eigh(root):
    matrix = root @ root.T / 100.0
    upper = matrix[np.triu_indices(3)]
    l1, l2, l3, *vector = principal_axis(*upper)
    values, vectors = np.linalg.eigh(matrix)
    scale = max(values[2], 1e-12)
    np.testing.assert_allclose([l3, l2, l1], values, atol=3e-7 * scale + 1e-12)
    assert np.linalg.norm(vector) == pytest.approx(1.0)
    if values[2] - values[1] > 1e-3 * scale:
        assert abs(vectors[:, 2] @ vector) == pytest.approx(1.0, abs=1e-5)
        assert vector[0] > 0 or (vector[0] == 0 and vector[1] >= 0) or abs(vector[0]) < 1e-9


@pytest.mark.parametrize(('upper', 'expected'), [
    ((4, 0, 0, 1, 0, 0), (4, 1, 0, 1, 0, 0)),
    ((1, 0, 0, 9, 0, 4), (9, 4, 1, 0, 1, 0)),
    ((1, 0, 0, 1, 0, 9), (9, 1, 1, 0, 0, 1)),
    ((2.5, 1.5, 0, 2.5, 0, 0), (4, 1, 0, 0.5**0.5, 0.5**0.5, 0)),
    ((0, 0, 0, 0, 0, 0), (0, 0, 0, 1, 0, 0)),
    ((3, 0, 0, 3, 0, 3), (3, 3, 3, 1, 0, 0)),
])
def test_principal_axis_by_hand(upper, expected):
    found = principal_axis(*map(float, upper))
    np.testing.assert_allclose(np.abs(found), expected, atol=1e-7)


def test_likeness_is_that_of_the_points_in_the_block():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1500, 3)) * [3.0, 1.0, 0.4]
    origin = points.min(axis=0) - 0.3
    voxels = build_voxels(points, np.arange(len(points)), origin, 0.5)
    likeness = measure_likeness(voxels)
    cell = np.floor((points - origin) / 0.5).astype(int)
    for number in range(0, len(voxels), 17):
        own = points[(np.abs(cell - voxels.index[number]) <= 1).all(axis=1)]
        assert likeness.count[number] == len(own)
        if len(own) < 4:
            continue
        values, vectors = np.linalg.eigh(np.cov(own.T, bias=True))
        l3, l2, l1 = values
        assert likeness.linear[number] == pytest.approx((l1 - l2) / l1, abs=1e-5)
        assert likeness.planar[number] == pytest.approx((l2 - l3) / l1, abs=1e-5)
        assert likeness.spherical[number] == pytest.approx(l3 / l1, abs=1e-5)
        if (l1 - l2) / l1 > 0.05:
            cosine = abs(vectors[:, 2] @ likeness.direction[number])
            assert cosine == pytest.approx(1.0, abs=1e-4)


def test_three_points_by_hand():
    # x -1, 0, 1 with y 0, 0, 0.3: covariance in the plan [[2, .3], [.3, .06]] / 3
    points = np.array([[0.1, 1.0, 5.0], [1.1, 1.0, 5.0], [2.1, 1.3, 5.0]])
    voxels = build_voxels(points, np.arange(3), np.zeros(3), 1.0)
    likeness = measure_likeness(voxels)
    middle = int(np.flatnonzero(voxels.index[:, 0] == 1)[0])
    l1, l2 = np.sort(np.linalg.eigvalsh([[2 / 3, 0.1], [0.1, 0.02]]))[::-1]
    assert likeness.count[middle] == 3
    assert likeness.linear[middle] == pytest.approx((l1 - l2) / l1)
    assert likeness.spherical[middle] == pytest.approx(0.0, abs=1e-9)


def test_a_wire_gives_candidates_along_it():
    wire = make_wire((0.0, 0.0, 20.0), (60.0, 25.0, 22.0))
    found = find(wire)
    assert len(found.position) > 60
    assert len(found.direction) == len(found.size) == len(found.linear) == len(found.count)
    assert (found.linear >= SETTINGS.threshold).all()
    assert (found.count >= SETTINGS.min_neighbors).all()
    azimuth = np.arctan2(found.direction[:, 1], found.direction[:, 0])
    assert np.degrees(np.median(np.abs(azimuth - np.arctan2(25, 60)))) < 2.0
    across = found.position[:, 1] * 60 / 65 - found.position[:, 0] * 25 / 65
    assert np.abs(across).max() < 0.5
    np.testing.assert_allclose(np.linalg.norm(found.direction, axis=1), 1.0)
    assert set(found.size) <= set(found.sizes)
    assert found.sizes == (0.75, 1.5, 3.0, 6.0)


@pytest.mark.parametrize('cloud', [
    make_plate(), make_tree(0.0, 0.0, 12.0, num=4000),
    np.ascontiguousarray(make_wire((0.0, 0.0, 20.0), (40.0, 0.0, 20.0))[:, ::-1]),
], ids=['plate', 'crown', 'mast'])
def test_what_is_no_wire_gives_next_to_no_candidates(cloud):
    found = find(cloud)
    assert len(found.position) <= 0.02 * sum(found.num_voxels)


def test_the_inclination_decides():
    steep = make_wire((0.0, 0.0, 20.0), (40.0, 0.0, 40.0), c=1e5)  # 26.6 degrees
    assert len(find(steep).position) < 10
    assert len(find(steep, max_inclination_deg=30.0).position) > 30


def test_neighbours_are_counted_inclusively():
    points = np.array([[x, 0.1, 10.1] for x in np.linspace(0.05, 0.65, 5)])
    assert len(find(points, min_neighbors=5).position) > 0
    assert len(find(points, min_neighbors=6).position) == 0


def test_several_scales_find_a_bundle_and_a_sparse_wire():
    bundle = np.vstack([
        make_wire((0.0, y, z), (80.0, y, z), c=900.0, per_metre=8.0, seed=number)
        for number, (y, z) in enumerate([(0.0, 20.0), (0.4, 20.0), (0.0, 20.4), (0.4, 20.4)])
    ])
    sparse = make_wire((0.0, 15.0, 20.0), (80.0, 15.0, 20.0), per_metre=1.2)

    def covered(found, y):
        near = np.abs(found.position[:, 1] - y) < 1.0
        return len(np.unique(np.floor(found.position[near, 0] / 2.0))) / 40

    one = find(np.vstack([bundle, sparse]), num_scales=1)
    all_scales = find(np.vstack([bundle, sparse]))
    assert covered(one, 15.0) < 0.2
    assert covered(all_scales, 15.0) > 0.7
    assert covered(one, 0.2) < 0.8
    assert covered(all_scales, 0.2) > 0.9


def test_the_inside_of_a_crown_is_dropped_and_the_wire_beside_it_stays():
    crown = np.random.default_rng(0).uniform((0, 5, 5), (10, 15, 15), (9000, 3))
    wire = make_wire((-20.0, 0.0, 10.0), (30.0, 0.0, 10.0))
    points = np.vstack([crown, wire])
    origin = points.min(axis=0) - 1.0
    kept = drop_bulk(points, np.arange(len(points)), origin, SETTINGS.max_occupied)
    assert (kept >= len(crown)).sum() == len(wire)
    assert (kept < len(crown)).sum() < 0.5 * len(crown)
    assert len(drop_bulk(points, np.arange(len(points)), origin, 27)) == len(points)
    found = find(points)
    assert found.num_bulk == len(points) - len(kept)


def test_bulk_cells_by_hand():
    # the middle of 3 x 3 x 3 full cells has 27, a face 18, an edge 12, a corner 8
    x, y, z = np.meshgrid(*[np.arange(3) + 1.5] * 3, indexing='ij')
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    chosen = np.arange(27)
    sizes = [len(drop_bulk(points, chosen, np.zeros(3), limit)) for limit in (7, 8, 12, 18, 27)]
    assert sizes == [0, 8, 20, 26, 27]


def test_bulk_cells_as_by_numpy_over_tall_columns():
    rng = np.random.default_rng(5)
    points = rng.uniform(0.0, (6.0, 6.0, 200.0), (3000, 3))
    full = np.zeros((8, 8, 202), dtype=np.int64)
    full[tuple(points.astype(np.int64).T + 1)] = 1
    around = sum(
        np.roll(full, (x, y, z), (0, 1, 2))
        for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)
    )
    of_point = around[tuple(points.astype(np.int64).T + 1)]
    for limit in (6, 8, 10, 12):
        kept = drop_bulk(points, np.arange(len(points)), np.zeros(3), limit)
        np.testing.assert_array_equal(kept, np.flatnonzero(of_point <= limit))


@pytest.mark.parametrize('num', [0, 1, 3])
def test_few_points(num):
    found = find(np.arange(3.0 * num).reshape(num, 3))
    assert found.position.shape == found.direction.shape == (0, 3)
    assert found.linear.shape == found.size.shape == found.count.shape == (0,)
    assert found.position.dtype == np.float64


def test_duplicates_of_one_place_are_no_line():
    assert len(find(np.tile([3.0, 4.0, 5.0], (40, 1))).position) == 0


def test_translation_order_and_input():
    wire = np.vstack([make_wire((0.0, 0.0, 20.0), (60.0, 25.0, 22.0)), make_tree(30.0, 9.0, 19.0)])
    before = wire.copy()
    one = find(wire)
    np.testing.assert_array_equal(wire, before)
    moved = find(wire + np.array([5e5, 6.6e6, 0.0]))
    order = np.random.default_rng(0).permutation(len(wire))
    shuffled = find(wire[order])
    assert abs(len(moved.position) - len(one.position)) <= 2
    assert len(shuffled.position) == len(one.position)
    np.testing.assert_allclose(
        np.sort(shuffled.position, axis=0), np.sort(one.position, axis=0), atol=1e-9
    )


def test_yaw_hardly_matters():
    wire = make_wire((0.0, 0.0, 20.0), (60.0, 0.0, 22.0))
    counts = [len(find(turn(wire, yaw)).position) for yaw in np.linspace(0, np.pi, 7)]
    assert min(counts) > 0.6 * max(counts)


@pytest.mark.parametrize('change', [
    {'threshold': 0.4}, {'threshold': 1.01}, {'max_inclination_deg': -1.0},
    {'min_neighbors': 2}, {'num_scales': 0}, {'max_occupied': 28}, {'voxel_size': -0.1},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        LinearitySettings(**change)
