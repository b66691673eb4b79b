# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sklearn.cluster import DBSCAN
from toys import find_tracks, make_tree, make_wire, turn

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.clustering.clustering import _join
from plc_inspect.core.clustering.dbscan import dbscan_plane
from plc_inspect.core.clustering.segments import Segments
from plc_inspect.errors import ConfigError

SETTINGS = ClusteringSettings()


def renumber(label):
    """Return the labels numbered by first member, so that they can be compared."""
    order = {value: None for value in label.tolist() if value >= 0}
    return np.array([list(order).index(value) if value >= 0 else -1 for value in label.tolist()])


def check_against_sklearn(u, v, eps, min_points):
    found = dbscan_plane(u, v, eps, min_points)
    oracle = DBSCAN(eps=eps, min_samples=min_points).fit(np.column_stack([u, v]))
    core = np.zeros(len(u), dtype=bool)
    core[oracle.core_sample_indices_] = True
    np.testing.assert_array_equal(found >= 0, oracle.labels_ >= 0)
    np.testing.assert_array_equal(renumber(found[core]), renumber(oracle.labels_[core]))
    # a border point belongs to a cluster that has a core point near it
    for number in np.flatnonzero((found >= 0) & ~core):
        near = core & (np.hypot(u - u[number], v - v[number]) <= eps * (1 + 1e-12))
        assert found[number] in found[near]
    return found, oracle.labels_


@pytest.mark.parametrize('num', [2, 500, 5000])
@pytest.mark.parametrize('decimals', [0, 1, 15])
def test_points_in_heaps_are_clustered_as_by_sklearn(num, decimals):
    # sorted by buckets, of which a heap fills one
    rng = np.random.default_rng(num)
    u = np.concatenate([rng.uniform(-9, 9, num // 2), rng.normal(3, 0.01, num - num // 2)])
    v = rng.uniform(-1, 1, num)
    for shift in (0.0, 1024.0):
        check_against_sklearn(u.round(decimals) + shift, v.round(2), 0.125, 5)


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
def test_a_place_that_is_not_finite_is_noise(value):
    u = np.array([0.0, value, 0.1, 0.2, 9.0])
    assert dbscan_plane(u, np.zeros(5), 0.5, 3).tolist() == [0, -1, 0, 0, -1]


def test_dbscan_by_hand():
    u = np.array([0.0, 1.0, 2.0, 10.0, 11.0, 12.0, 30.0])
    assert dbscan_plane(u, np.zeros(7), 1.0, 3).tolist() == [0, 0, 0, 1, 1, 1, -1]
    # the boundary is inclusive, and a point is its own neighbour
    assert dbscan_plane(u, np.zeros(7), 0.999, 2).tolist() == [-1] * 7
    assert dbscan_plane(u, np.zeros(7), 0.5, 1).tolist() == list(range(7))


@given(st.integers(0, 2**32), st.integers(1, 9), st.floats(0.05, 0.6), st.booleans())
@settings(max_examples=80, deadline=None)
def test_dbscan_is_that_of_sklearn(seed, min_points, eps, gridded):
    rng = np.random.default_rng(seed)
    num = int(rng.integers(1, 150))
    centers = rng.uniform(-2, 2, (4, 2))
    points = centers[rng.integers(0, 4, num)] + rng.normal(0, 0.2, (num, 2))
    if gridded:  # many equal distances and duplicates
        points, eps = np.round(points * 8) / 8, round(eps * 8) / 8 or 0.125
    found, oracle = check_against_sklearn(
        points[:, 0].copy(), points[:, 1].copy(), eps, min_points
    )
    np.testing.assert_array_equal(found, oracle)


@pytest.mark.parametrize('num', [0, 1])
def test_dbscan_of_few_points(num):
    assert dbscan_plane(np.zeros(num), np.zeros(num), 0.2, 1).tolist() == [0] * num
    assert dbscan_plane(np.zeros(num), np.zeros(num), 0.2, 2).tolist() == [-1] * num


def get_members(result, track):
    segments = result.segments
    return np.unique(np.concatenate([
        segments.points[segments.point_start[segment]:segments.point_start[segment + 1]]
        for segment in np.flatnonzero(result.track == track)
    ]))


def check_tracks(result, wires, least=0.9):
    """Check that no track mixes wires, and that each wire has one track of most of it."""
    ends = np.cumsum([0, *map(len, wires)])
    share = np.zeros((result.num_tracks, len(wires)))
    for track in range(result.num_tracks):
        members = get_members(result, track)
        wire = np.searchsorted(ends, members, side='right') - 1
        counts = np.bincount(wire, minlength=len(wires))
        if len(members) > 20:  # a scrap of a few points may lie across two
            assert counts.max() > 0.98 * len(members)
        share[track] = counts / np.diff(ends)
    assert (share.sum(axis=0) > least).all()
    assert (share.max(axis=0) > 0.7 * least).all()


def test_one_wire_is_one_track():
    wire = make_wire((0.0, 0.0, 20.0), (100.0, 40.0, 21.0))
    result = find_tracks(wire)
    check_tracks(result, [wire])
    segments = result.segments
    assert len(segments) == len(segments.window) == len(segments.rms) == len(result.track)
    assert segments.point_start[-1] == len(segments.points)
    np.testing.assert_allclose(np.linalg.norm(segments.direction, axis=1), 1.0)
    assert np.median(segments.rms) == pytest.approx(0.02 * np.sqrt(2), rel=0.3)
    axis = np.array([100.0, 40.0]) / np.hypot(100, 40)
    assert np.abs(segments.center[:, :2] @ [-axis[1], axis[0]]).max() < 0.1


@pytest.mark.parametrize('offsets', [
    [(0.0, 8.0), (0.0, 8.4), (0.0, 8.8), (0.0, 9.2)],
    [(0.0, 8.0), (0.4, 8.0), (0.8, 8.0), (1.2, 8.0)],
    [(-6.0, 20.0), (0.0, 20.0), (6.0, 20.0), (-4.0, 26.0), (4.0, 26.0)],
], ids=['rack', 'low voltage', 'two layers'])
def test_conductors_side_by_side_are_tracks_of_their_own(offsets):
    wires = [
        make_wire((0.0, y, z), (45.0, y, z), c=400.0, per_metre=15.0, noise=0.025, seed=number)
        for number, (y, z) in enumerate(offsets)
    ]
    check_tracks(find_tracks(np.vstack(wires)), wires)


@pytest.mark.parametrize('degrees', [17, 90, -45, 179])
def test_yaw_and_translation_change_nothing(degrees):
    wires = [make_wire((0.0, y, 9.0), (60.0, y, 10.0), seed=number)
             for number, y in enumerate((0.0, 0.6, 1.2))]
    moved = [turn(wire, np.radians(degrees), (5e5, 6.6e6, 100.0)) for wire in wires]
    check_tracks(find_tracks(np.vstack(moved)), moved)


def test_the_order_of_points_changes_only_the_numbers():
    wires = [make_wire((0.0, y, 9.0), (60.0, y, 10.0), seed=number)
             for number, y in enumerate((0.0, 0.6, 1.2))]
    points = np.vstack(wires)
    order = np.random.default_rng(0).permutation(len(points))
    one, other = find_tracks(points), find_tracks(points[order])
    sets = [
        {frozenset(np.asarray(back)[get_members(result, track)].tolist())
         for track in range(result.num_tracks)}
        for result, back in ((one, np.arange(len(points))), (other, order))
    ]
    large = [members for members in sets[0] if len(members) > 300]
    assert len(large) == 3
    for members in large:
        best = max(len(members & others) / len(members | others) for others in sets[1])
        assert best > 0.95


def test_a_sparse_wire_is_a_track_though_min_points_is_50():
    wire = make_wire((0.0, 0.0, 20.0), (120.0, 0.0, 20.0), per_metre=2.0)
    result = find_tracks(wire)
    check_tracks(result, [wire])
    assert result.min_points == 50


def test_pieces_across_a_gap_are_one_track():
    wire = make_wire((0.0, 0.0, 20.0), (100.0, 0.0, 20.0), parts=((0.0, 0.4), (0.5, 1.0)))
    assert find_tracks(wire).num_tracks == 1
    far = make_wire((0.0, 0.0, 20.0), (100.0, 0.0, 20.0), parts=((0.0, 0.35), (0.7, 1.0)))
    assert find_tracks(far).num_tracks == 2


def test_crowns_have_few_points_on_tracks():
    crowns = np.vstack([
        make_tree(4.0 * number, 0.0, 14.0, 6.0, 3.0, 4000, number) for number in range(6)
    ])
    result = find_tracks(crowns)
    on_tracks = sum(len(get_members(result, track)) for track in range(result.num_tracks))
    assert on_tracks < 0.03 * len(crowns)


def make_segments(centers, windows):
    centers = np.array(centers, float)
    num = len(centers)
    return Segments(
        window=np.array(windows, dtype=np.int32), center=centers,
        direction=np.tile([1.0, 0.0, 0.0], (num, 1)), half_length=np.full(num, 3.0),
        rms=np.full(num, 0.02), point_start=np.arange(num + 1) * 4,
        points=np.arange(4 * num, dtype=np.int32),
    )


def test_two_segments_of_one_window_are_never_one_track():
    # the windows before and after each see one segment only, half way between two conductors
    segments = make_segments(
        [[0, 0.0, 10], [0, 0.16, 10], [8, 0.05, 10], [-8, 0.11, 10], [14, 0.08, 10]],
        [0, 0, 1, 2, 3],
    )
    track = _join(segments, SETTINGS)
    assert track[0] != track[1]
    assert len(set(track.tolist())) == 2
    # without the rule, the same links join them through the others
    apart = make_segments(segments.center, [0, 5, 1, 2, 3])
    assert len(set(_join(apart, SETTINGS).tolist())) == 1


@pytest.mark.parametrize('num', [0, 1])
def test_few_points(num):
    result = find_tracks(np.ones((num, 3)))
    assert len(result.segments) == result.num_tracks == 0
    assert result.track.shape == (0,)
    assert result.segments.center.shape == (0, 3)
    assert result.segments.point_start.tolist() == [0]


def test_duplicates_and_input():
    wire = np.repeat(make_wire((0.0, 0.0, 20.0), (60.0, 0.0, 20.0)), 2, axis=0)
    before = wire.copy()
    assert find_tracks(wire).num_tracks == 1
    np.testing.assert_array_equal(wire, before)


@pytest.mark.parametrize('change', [
    {'eps': 0.0}, {'eps': -0.1}, {'min_points': 0}, {'max_thickness': 0.0}, {'max_gap': 0.0},
    {'max_crowding': 1.5}, {'join_tolerance': 0.0},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        ClusteringSettings(**change)
