# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Random scenes: the truth about them is right, and they can stand."""

import functools
import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from plc_inspect.errors import DataError
from plc_inspect.sim.random_scenes.scenes import KINDS
from plc_inspect.sim.random_scenes.truth import CLEAN, make_random
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.scene import Label

SEEDS = {'any': (3, 4), 'clean': (3, 6), 'no-lines': (2, 5)}
"""Quick ones of each kind: from the air with a crossing line, from a car, from the air."""


@pytest.fixture(scope='module')
def make():
    """Return a function that makes each scene once."""
    cached = functools.cache(make_random)
    yield cached
    cached.cache_clear()


@pytest.fixture(params=SEEDS['any'])
def made(request, make):
    """Return a scene with everything."""
    return make(request.param, 'any')


@pytest.fixture(params=SEEDS['clean'])
def clean(request, make):
    """Return a scene whose conductors are clean."""
    return make(request.param, 'clean')


def test_wire_points_lie_on_their_catenaries(made):
    cloud = made.cloud
    for number, item in enumerate(made.scene.conductors):
        rows = cloud.conductor == number
        if not rows.any():
            continue
        assert (cloud.label[rows] == Label.WIRE).all()
        assert (cloud.line_id[rows] == item.line_id).all()
        assert (cloud.span_id[rows] == item.span_id).all()
        assert measure_distances(cloud.exact[rows], item).max() < 2e-3
        # Noise, half a footprint and the misalignment of strips; drift is in the truth's spans.
        off = measure_distances(cloud.points[rows], item)
        assert np.median(off) < 0.15
        assert np.quantile(off, 0.95) < 0.3
    assert (cloud.line_id[cloud.label != Label.WIRE] == -1).all()


def test_conductors_hang_on_their_supports_and_off_the_ground(made):
    scene = made.scene
    feet = np.array([post.position for post in scene.posts])
    struts = scene.struts[scene.strut_label == Label.TOWER]
    ends = np.vstack([struts[:, :3], struts[:, 3:6]])
    carried = {line_id for post in scene.posts for line_id in post.line_ids}
    for item in scene.conductors:
        for end in (item.start, item.end) if item.line_id in carried else (item.start,):
            assert np.hypot(*(feet[:, :2] - end[:2]).T).min() < 15.0
            # A conductor hangs on an insulator, an arm or a peak.
            assert np.linalg.norm(ends - end, axis=1).min() < 0.5
        curve = item.sample(1.0)
        height = (curve[:, 2] - scene.terrain.heights(curve[:, :2])).min()
        # Drops hang lower than lines.
        assert height > (4.0 if item.line_id in carried else 2.5)


def test_spans_are_counted_as_they_are_seen(made):
    rows = made.truth['spans']
    assert len(rows) == len(made.scene.conductors)
    assert len({(row['line_id'], row['span_id']) for row in rows}) == len(rows)
    for number, row in enumerate(rows):
        assert row['num_points'] == int((made.cloud.conductor == number).sum())
        assert row['sag'] == made.scene.conductors[number].sag


def test_clean_conductors_have_nothing_near(clean):
    assert clean.truth['spans']
    assert all(row['clean'] for row in clean.truth['spans'])
    cloud = clean.cloud
    foreign = cloud.exact[~np.isin(cloud.label, (0, Label.WIRE, Label.TOWER))]
    for item in clean.scene.conductors:
        gap, _ = cKDTree(item.sample(0.1)).query(foreign, distance_upper_bound=CLEAN)
        assert not np.isfinite(gap).any()


@pytest.mark.parametrize('seed', SEEDS['no-lines'])
def test_scenes_without_lines_have_no_wire(make, seed):
    made = make(seed, 'no-lines')
    assert made.truth['spans'] == []
    assert not (made.cloud.label == Label.WIRE).any()
    assert len(made.cloud.points) > 10_000


@pytest.mark.parametrize('kind', KINDS)
def test_seeds_reproduce(make, kind):
    seed, other = SEEDS[kind]
    first, second = make(seed, kind), make_random(seed, kind)
    assert first.cloud.points.tobytes() == second.cloud.points.tobytes()
    assert json.dumps(first.truth) == json.dumps(second.truth)
    assert first.cloud.points.tobytes() != make(other, kind).cloud.points.tobytes()


@pytest.mark.slow
def test_no_flight_is_below_the_ground(make):
    # 18 m beside the route, 2.6 m above it, lies a hill: from within it, nothing else is seen
    scene = make(393003, 'no-lines')
    assert np.ptp(scene.cloud.points[:, :2], axis=0).min() > 60.0


def test_an_unknown_kind_is_refused():
    with pytest.raises(DataError, match='cloudy'):
        make_random(0, 'cloudy')
