# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import hypothesis
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from plc_inspect.config import MapSettings
from plc_inspect.core.numerics.hash_table import hash_key
from plc_inspect.core.voxel_buffer.cell_lists import SAMPLE
from plc_inspect.core.voxel_buffer.voxel_keys import locate_voxels
from plc_inspect.core.voxel_buffer.voxel_map import INITIAL_CAPACITY, VoxelMap
from plc_inspect.errors import DataError

ALL = np.ones(256, dtype=np.uint8)
NOTHING = np.zeros(256, dtype=np.bool_)


def sort_rows(points):
    """Return the rows in lexicographic order."""
    return points[np.lexsort(points.T[::-1])]


def make_map(points=None, **settings):
    voxels = VoxelMap(MapSettings(**settings))
    if points is not None:
        voxels.insert(np.asarray(points, dtype=np.float64))
    return voxels


def find_voxels(points, size):
    """Return voxel -> points by tile, then in order of first touch, by brute force."""
    cells = {}
    for point in points:
        cells.setdefault(tuple(np.floor(point / size).astype(int)), []).append(point)
    origin = np.floor(points[0] / size).astype(int)
    tiles = {cell: tuple((np.array(cell) - origin) // 128)[1::-1] for cell in cells}
    return {cell: cells[cell] for cell in sorted(cells, key=tiles.get)}


def test_toy_case_by_hand():
    voxels = make_map([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [-0.1, 0.1, 0.1]], voxel_size=0.5)
    np.testing.assert_allclose(voxels.centroids(), [[-0.1, 0.1, 0.1], [0.2, 0.1, 0.1]], atol=1e-7)
    assert voxels.counts().tolist() == [1, 2]


def test_against_brute_force():
    points = np.random.default_rng(0).uniform(-3, 3, (3000, 3))
    voxels = make_map(points, voxel_size=0.5)
    cells = find_voxels(points, 0.5)
    assert len(voxels) == len(cells)
    expected = np.array([np.mean(cell, axis=0) for cell in cells.values()])
    np.testing.assert_allclose(voxels.centroids(), expected, atol=1e-6)
    assert voxels.counts().tolist() == [len(cell) for cell in cells.values()]


def test_keys_of_which_the_table_sees_no_difference_stay_apart():
    cells = np.random.default_rng(7).integers(0, 4000, (500_000, 3)) + 0.5
    keys, _, _ = locate_voxels(cells, np.zeros(3, dtype=np.int64), 1.0)
    entry = np.array([hash_key(key) for key in keys])
    order = np.argsort(entry, kind='stable')
    same = np.flatnonzero((np.diff(entry[order]) == 0) & (np.diff(keys[order]) != 0))
    assert len(same) > 5
    pairs = cells[order[np.column_stack((same, same + 1)).ravel()]]
    voxels = make_map(np.vstack(([0.5, 0.5, 0.5], pairs)), voxel_size=1.0)
    assert len(voxels) == 1 + len(pairs)
    voxels.insert(pairs[::2])
    voxels.insert(pairs[1::2])
    assert sorted(voxels.counts().tolist()) == [1] + len(pairs) * [2]
    found = voxels.centroids()[voxels.counts() == 2]
    np.testing.assert_allclose(sort_rows(found), sort_rows(pairs), atol=1e-6)


@pytest.mark.parametrize('points', [np.empty((0, 3)), np.array([[1.0, 2.0, 3.0]])])
def test_empty_and_one_point(points):
    voxels = make_map(points)
    np.testing.assert_allclose(voxels.centroids(), points, atol=1e-8)
    assert voxels.centroids().shape == points.shape
    assert len(voxels.cells) == len(points)


def test_utm_coordinates_keep_a_tenth_of_a_millimetre():
    corner = np.array([699_999.5, 9_876_543.2, 1234.5])
    points = corner + np.random.default_rng(1).uniform(0, 5, (500, 3))
    voxels = make_map(points, voxel_size=0.02)
    expected = [np.mean(cell, axis=0) for cell in find_voxels(points, 0.02).values()]
    np.testing.assert_allclose(voxels.centroids(), expected, rtol=0, atol=1e-4)


def test_a_voxel_hit_a_million_times_keeps_a_tenth_of_a_millimetre():
    rng = np.random.default_rng(2)
    voxels = make_map(voxel_size=2.0)
    total = np.zeros(3)
    for _ in range(10):
        points = rng.uniform(0.2, 1.9, (100_000, 3))
        voxels.insert(points)
        total += points.sum(axis=0)
    assert voxels.counts().tolist() == [1_000_000]
    np.testing.assert_allclose(voxels.centroids()[0], total / 1e6, rtol=0, atol=1e-4)


@hypothesis.settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_chunks_give_the_same_map_as_the_whole(seed, step):
    points = np.array([1e5, 0, 0]) + np.random.default_rng(seed).uniform(-1, 1, (200, 3))
    whole, chunked = make_map(points), make_map()
    for start in range(0, len(points), step):
        chunked.insert(points[start : start + step])
    order, other = (np.lexsort(m.centroids().T) for m in (whole, chunked))
    assert whole.centroids()[order].tobytes() == chunked.centroids()[other].tobytes()
    assert whole.counts()[order].tolist() == chunked.counts()[other].tolist()


def test_new_voxels_of_a_tile_lie_together():
    points = np.random.default_rng(5).uniform(-20, 20, (2000, 3))
    voxels = make_map(points)
    voxels.insert(points + 100.0)
    origin = np.floor(points[0] / 0.1)
    tile = (np.floor(voxels.centroids() / 0.1) - origin)[:, :2] // 128
    for made in (tile[:2000], tile[2000:]):
        assert len(made) == 2000
        num_tiles = len(np.unique(made, axis=0))
        assert num_tiles >= 9
        assert (np.diff(made, axis=0) != 0).any(axis=1).sum() == num_tiles - 1


def test_voxels_do_not_depend_on_the_first_point():
    points = np.random.default_rng(3).uniform(-2, 2, (400, 3))
    forward, backward = make_map(points), make_map(points[::-1])
    order, other = (np.lexsort(m.centroids().T) for m in (forward, backward))
    assert forward.counts()[order].tolist() == backward.counts()[other].tolist()
    np.testing.assert_allclose(
        forward.centroids()[order], backward.centroids()[other], atol=1e-7
    )


def test_growing_and_reserving_give_the_same_map():
    axis = np.arange(60) * 0.1 + 0.05
    points = np.stack(np.meshgrid(axis, axis, axis, indexing='ij'), axis=-1).reshape(-1, 3)
    assert len(points) > 2 * INITIAL_CAPACITY
    grown, reserved = make_map(points), make_map()
    reserved.insert(points[:100])
    reserved.reserve(10**9)
    reserved.insert(points[100:])
    assert len(grown) == len(points)
    np.testing.assert_allclose(grown.centroids(), points, atol=1e-7)
    assert grown.centroids().tobytes() == reserved.centroids().tobytes()
    assert grown.nbytes < 50 * len(points)


def test_beyond_the_cap_known_voxels_still_take_points():
    x = np.arange(1500) * 0.1 + 0.05
    points = np.column_stack((x, np.zeros(1500), np.zeros(1500)))
    voxels = make_map(max_voxels=1000)
    insertion = voxels.insert(np.concatenate((points, points[:10])))
    assert (len(voxels), insertion.num_new, insertion.num_refused) == (1000, 1000, 500)
    assert insertion.num_points == 1010
    assert voxels.counts()[:11].tolist() == [2] * 10 + [1]
    assert sum(voxels.drop(cell, NOTHING) for cell in range(5)) == 500
    assert voxels.insert(points[1000:]).num_refused == 0
    assert len(voxels) == 1000
    np.testing.assert_allclose(sort_rows(voxels.centroids()), points[500:], atol=1e-7)


@pytest.mark.parametrize('seed', range(4))
def test_dropped_voxels_are_gone_and_the_rest_is_found_again(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-40, 40, (20_000, 3))
    voxels = make_map(points, voxel_size=0.5)
    everything = voxels.centroids()
    slots, centroids = voxels.copy_voxels(voxels.collect(np.arange(len(voxels.cells)), ALL))
    assert len(slots) == len(voxels)
    kept = rng.random(len(slots)) < 0.4
    voxels.label(slots, centroids, np.where(kept, 14, 2).astype(np.uint8))
    gone = rng.permutation(len(voxels.cells))[:30]
    wires = np.zeros(256, dtype=np.bool_)
    wires[14] = True
    num = sum(voxels.drop(int(cell), wires) for cell in gone)
    cell_of = voxels.cells.find(voxels.cells.locate(centroids))
    stays = kept | ~np.isin(cell_of, gone)
    assert num == (~stays).sum()
    np.testing.assert_array_equal(sort_rows(voxels.centroids()), sort_rows(centroids[stays]))
    assert voxels.cells.count.sum() == len(voxels)
    assert voxels.insert(points).num_new == num
    np.testing.assert_allclose(
        sort_rows(np.round(voxels.centroids(), 5)), sort_rows(np.round(everything, 5)), atol=2e-5
    )


@pytest.mark.parametrize('reach', [0.0, 4.0, 25.0])
def test_all_cells_within_reach_are_found(reach):
    cells = make_map(np.random.default_rng(3).uniform(-50.0, 50.0, (40, 3))).cells
    place, size = np.array([-3.0, 6.5, 0.0]), cells.cell_size
    index = np.stack(np.meshgrid(np.arange(-9, 9), np.arange(-9, 9)), axis=-1).reshape(-1, 2)
    apart = np.clip(place[:2], index * size, (index + 1) * size) - place[:2]
    expected = cells.find(index[np.hypot(*apart.T) <= reach])
    assert sorted(cells.find_all(place, reach).tolist()) == sorted(expected.tolist())


def test_cells_know_their_voxels():
    voxels = make_map([[0.05, 0.05, 1.05], [9.95, 9.95, 3.05], [10.05, 0.05, 0.05], [-0.05, 0, 0]])
    cells = voxels.cells
    assert cells.index.tolist() == [[-1, 0], [0, 0], [1, 0]]
    assert cells.count.tolist() == cells.num_new.tolist() == [1, 2, 1]
    np.testing.assert_allclose(cells.low, [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(cells.high, [0.1, 3.1, 0.1], atol=1e-9)
    np.testing.assert_allclose(cells.centers, [[-5, 5], [5, 5], [15, 5]])
    assert cells.find(np.array([[1, 0], [5, 5], [-1, 0]])).tolist() == [2, -1, 0]
    _, centroids = voxels.copy_voxels(voxels.collect(np.array([1]), ALL))
    np.testing.assert_allclose(
        sort_rows(centroids), [[0.05, 0.05, 1.05], [9.95, 9.95, 3.05]], atol=1e-6
    )
    cells.settle(np.array([1]))
    voxels.insert(np.array([[5.05, 5.05, 0.05], [0.06, 0.06, 1.06]]))
    assert cells.num_new.tolist() == [1, 1, 1]
    assert cells.touched.tolist() == [1, 2, 1]
    assert cells.low[1] == 0.0


def test_cells_against_brute_force():
    points = np.random.default_rng(8).uniform(-900, 900, (20_000, 3))
    voxels = make_map(points)
    tiles = np.floor(voxels.centroids()[:, :2] / 10)
    places, number = np.unique(tiles, axis=0, return_counts=True)
    cells = voxels.cells
    assert len(cells) == len(places) > 4096
    np.testing.assert_array_equal(cells.count[cells.find(places.astype(np.int64))], number)
    chosen = np.arange(0, len(cells), 7)
    slots = voxels.collect(chosen, ALL)
    assert len(np.unique(slots)) == len(slots) == cells.count[chosen].sum()
    _, centroids = voxels.copy_voxels(slots)
    assert np.isin(cells.find(cells.locate(centroids)), chosen).all()


def test_free_slots_are_used_in_their_order():
    x = np.arange(1000) * 0.1 + 0.05
    points = np.column_stack((x, np.zeros(1000), np.zeros(1000)))
    voxels = make_map(points, max_voxels=1000)
    for cell in (7, 2, 4):
        assert voxels.drop(cell, NOTHING) == 100
    voxels.order_free()
    new = points[:300] + np.array([500.0, 0.0, 0.0])
    assert voxels.insert(new).num_new == 300
    slots, centroids = voxels.copy_voxels(voxels.collect(np.arange(len(voxels.cells)), ALL))
    here = centroids[:, 0] > 400.0
    order = np.argsort(centroids[here, 0])
    assert slots[here][order].tolist() == [*range(200, 300), *range(400, 500), *range(700, 800)]
    np.testing.assert_allclose(centroids[here][order], new, atol=1e-5)


def test_labels_choose_what_is_collected():
    voxels = make_map(np.random.default_rng(9).uniform(0, 9.9, (4000, 3)))
    slots, centroids = voxels.copy_voxels(voxels.collect(np.array([0]), ALL))
    voxels.label(slots, centroids, np.where(np.arange(len(slots)) < 100, 14, 2).astype(np.uint8))
    wanted = np.zeros(256, dtype=np.uint8)
    wanted[14] = 1
    assert sorted(voxels.collect(np.array([0]), wanted)) == sorted(slots[:100])
    for kinds in (4, 12):
        wanted[2] = 1 + kinds
        num = len(voxels.collect(np.array([0]), wanted)) - 100
        assert 0.8 * kinds * SAMPLE < num < 2.2 * kinds * SAMPLE
    voxels.drop(0, NOTHING)
    voxels.insert(centroids + 20.0)
    voxels.label(slots, centroids, np.full(len(slots), 14, dtype=np.uint8))
    assert len(voxels.collect(np.arange(len(voxels.cells)), wanted)) == 0


@pytest.mark.parametrize('origin', [0.0, 5e6])
def test_points_on_the_border_of_a_voxel_are_labelled(origin):
    grid = np.stack(np.meshgrid(*3 * [np.arange(-20, 20)]), axis=-1).reshape(-1, 3)
    voxels = make_map(origin + 0.1 * grid)
    everything = np.ones(256, np.uint8)
    slots, centroids = voxels.copy_voxels(voxels.collect(np.arange(len(voxels.cells)), everything))
    voxels.label(slots, centroids, np.full(len(slots), 7, np.uint8))
    everything[7] = 0
    assert not len(voxels.collect(np.arange(len(voxels.cells)), everything))


def test_voxels_with_few_points_are_not_used():
    voxels = make_map([[0.05, 0, 0], [0.06, 0, 0], [1.05, 0, 0]], min_points=2)
    slots, _ = voxels.copy_voxels(voxels.collect(np.array([0]), ALL))
    assert slots.tolist() == [0]
    assert len(voxels) == 2


@pytest.mark.parametrize('bad', [np.nan, np.inf, 2e5, -2e5])
def test_bad_point_leaves_the_map_as_it_was(bad):
    voxels = make_map([[0.0, 0.0, 0.0]])
    with pytest.raises(DataError, match='point 1'):
        voxels.insert(np.array([[5.0, 5, 5], [0, bad, 0]]))
    assert len(voxels) == 1
    assert voxels.sequence == 1


@pytest.mark.parametrize('bad', [np.nan, np.inf, 1e300])
def test_bad_first_point_does_not_set_the_origin(bad):
    voxels = make_map()
    with pytest.raises(DataError, match='point 0'):
        voxels.insert(np.array([[0, bad, 0]]))
    voxels.insert(np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(voxels.centroids(), [[1, 2, 3]], atol=1e-7)


def test_a_hundred_kilometres_fit():
    points = np.array([[0.0, 0, 0], [104_000.0, -104_000.0, 0]])
    np.testing.assert_allclose(make_map(points).centroids(), points, atol=1e-7)


def test_wrong_shape_and_unchanged_input():
    with pytest.raises(DataError, match=r'\(3, 2\)'):
        make_map(np.zeros((3, 2)))
    points = np.random.default_rng(6).random((10, 3))
    copy = points.copy()
    make_map(points)
    np.testing.assert_array_equal(points, copy)


def test_clear_begins_anew():
    voxels = make_map([[1e6, 0, 0]])
    voxels.clear()
    assert (len(voxels), voxels.centroids().shape) == (0, (0, 3))
    voxels.insert(np.zeros((1, 3)))
    np.testing.assert_allclose(voxels.centroids(), [[0, 0, 0]], atol=1e-7)
    assert voxels.counts().tolist() == [1]
    assert len(voxels.cells) == 1
