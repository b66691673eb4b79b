# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""RNN-DBSCAN against its definitions, and the clusterers beside one another."""

import numpy as np
import pytest
from sklearn.cluster import HDBSCAN
from toys import make_wire

from plc_inspect.config import Settings
from plc_inspect.core.clustering.clusterers import cluster_plane, count_neighbors
from plc_inspect.core.clustering.rnn_dbscan import find_neighbors, rnn_dbscan_plane
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.setting_names import update

METHODS = ('dbscan', 'hdbscan', 'rnn_dbscan')


def make_plane(seed, num=120):
    """Make dots of several densities and some noise."""
    rng = np.random.default_rng(seed)
    dots = [
        rng.normal(center, spread, (num // 4, 2))
        for center, spread in (((0, 0), 0.05), ((1, 0.3), 0.05), ((0.4, 2.0), 0.3))
    ]
    return np.vstack([*dots, rng.uniform(-2, 4, (num // 4, 2))])


def cluster_by_definition(points, k):
    """Return the clusters of RNN-DBSCAN as sets, from the definitions of the paper alone."""
    num = len(points)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = [
        sorted((j for j in range(num) if j != i), key=lambda j: (apart[i, j], j))[:k]
        for i in range(num)
    ]
    reverse = [{j for j in range(num) if i in near[j]} for i in range(num)]
    core = {i for i in range(num) if len(reverse[i]) >= k}
    clusters, left = [], set(core)
    while left:  # density-reachable: neighbours of core points, and core points that have them
        grown, front = set(), {min(left)}
        while front:
            grown |= front
            front = {
                j for i in front & core for j in {*near[i], *(reverse[i] & core)}
            } - grown - set().union(*clusters)
        clusters.append(grown)
        left -= grown
    width = [
        max((apart[i, j] for i in group & core for j in near[i] if j in group & core), default=0)
        for group in clusters
    ]
    held = set().union(*clusters)
    full = [set(group) for group in clusters]
    for i in set(range(num)) - held:
        for j in near[i]:
            owner = next((c for c, group in enumerate(clusters) if j in group & core), None)
            if owner is not None and apart[i, j] <= width[owner]:
                full[owner].add(i)
                break
    return full


@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('k', [4, 7, 12])
def test_rnn_dbscan_is_that_of_its_definitions(seed, k):
    points = make_plane(seed)
    label = rnn_dbscan_plane(points[:, 0].copy(), points[:, 1].copy(), k)
    found = [set(np.flatnonzero(label == c).tolist()) for c in range(label.max() + 1)]
    assert found == cluster_by_definition(points, k)
    assert len(found) >= 2
    assert (label < 0).any()


def test_neighbors_are_the_nearest_with_ties_in_order():
    u = np.array([0.0, 1.0, 1.0, 2.0, 0.0, 0.0])
    v = np.array([0.0, 0.0, 0.0, 0.0, 1.0, -1.0])
    near, apart = find_neighbors(u, v, 3)
    assert near[0].tolist() == [1, 2, 4]
    assert near[1].tolist() == [2, 0, 3]
    assert apart[1].tolist() == [0.0, 1.0, 1.0]


@pytest.mark.slow
def test_rnn_dbscan_finds_dots_of_two_densities_where_one_eps_cannot():
    rng = np.random.default_rng(3)
    dense = [rng.normal((x, 0.0), 0.02, (60, 2)) for x in (0.0, 0.2)]
    thin = rng.normal((5.0, 0.0), 0.5, (60, 2))
    points = np.vstack([*dense, thin])
    label = rnn_dbscan_plane(points[:, 0].copy(), points[:, 1].copy(), 12)
    groups = [label[:60], label[60:120], label[120:]]
    assert len({int(np.bincount(group[group >= 0]).argmax()) for group in groups}) == 3
    for eps in (0.05, 0.1, 0.2, 0.4):
        label = cluster_plane('dbscan', points[:, 0], points[:, 1], eps, 12, 0)
        groups = [label[:60], label[60:120], label[120:]]
        whole = [(group >= 0).mean() > 0.8 for group in groups]
        assert not all(whole) or label[:60].max() == label[60:120].max()


@pytest.mark.parametrize('num', [0, 1, 3, 4])
@pytest.mark.parametrize('method', METHODS)
def test_too_few_points_are_noise(method, num):
    place = np.linspace(0.0, 0.1, num)
    assert cluster_plane(method, place, place, 0.2, 5, 0).tolist() == [-1] * num


def test_hdbscan_is_that_of_scikit_learn():
    points = make_plane(1)
    for attempt, least, kind in ((0, 10, 'eom'), (1, 5, 'leaf')):
        own = cluster_plane('hdbscan', points[:, 0], points[:, 1], 0.2, 10, attempt)
        theirs = HDBSCAN(min_cluster_size=least, min_samples=least, allow_single_cluster=True,
                         cluster_selection_method=kind, copy=True).fit_predict(points)
        assert own.tolist() == theirs.tolist()
    assert own.max() >= 1


@pytest.mark.parametrize('method', ['dbscan', 'rnn_dbscan'])
def test_the_count_tells_core_points(method):
    points = make_plane(2)
    u, v = points[:, 0].copy(), points[:, 1].copy()
    label = cluster_plane(method, u, v, 0.2, 8, 1)
    counts = [count_neighbors(method, u, v, i, 0.2, 8, 1) for i in range(len(u))]
    core = np.array([value >= needed for value, needed in counts])
    assert (label[core] >= 0).all()
    assert 0 < core.sum() < len(u)
    assert count_neighbors('hdbscan', u, v, 0, 0.2, 8, 1) == (0, 0)


@pytest.mark.parametrize('method', METHODS)
def test_each_finds_three_conductors_and_not_one_more(method):
    wires = [
        make_wire((0.0, y, z), (120.0, y, z), noise=0.02, seed=k)
        for k, (y, z) in enumerate(((0.0, 12.0), (1.0, 12.0), (0.5, 13.0)))
    ]
    rng = np.random.default_rng(4)
    ground = np.column_stack([rng.uniform(-10, 130, 20000), rng.uniform(-20, 20, 20000),
                              rng.normal(0.0, 0.02, 20000)])
    settings = update(Settings(), {'clustering.method': method})
    result = Pipeline(settings).run(np.vstack([*wires, ground]))
    assert len(result.spans) == 3
    assert (result.line_id[: sum(map(len, wires))] >= 0).mean() > 0.98
