# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What a crown about a conductor takes back of the points that lie on it."""

import numpy as np
import pytest
from toys import make_line_cloud, make_tree

from plc_inspect.core.catenary.profile import CROWD_LENGTH
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.spans import point_claims
from plc_inspect.core.spans.point_claims import find_held, find_intruders
from plc_inspect.results import PointClass

TOLERANCE = 0.12


def make_surroundings(crown=150.0, seed=0, sigma=0.03, per_metre=8.0):
    """Make 40 m of conductor with a crown of some points/m3 from 12 to 20 m; truth last."""
    rng = np.random.default_rng(seed)
    num = int(40 * per_metre)
    wire = np.column_stack([rng.uniform(0, 40, num), rng.normal(0, sigma, (num, 2))])
    num = int(crown * 8 * 1.0)
    leaves = np.column_stack([rng.uniform(12, 20, num), rng.uniform(-0.5, 0.5, (num, 2))])
    points = np.vstack([wire, leaves])
    distance = np.hypot(points[:, 1], points[:, 2])
    is_wire = np.arange(len(points)) < len(wire)
    return points[:, 0], distance, distance <= TOLERANCE, is_wire


@pytest.mark.parametrize('crown', [100.0, 200.0, 600.0])
def test_most_that_is_given_back_is_the_crowns(crown):
    along, distance, own, is_wire = make_surroundings(crown)
    given = find_intruders(along, distance, own, ~own, TOLERANCE)
    leaves = own & ~is_wire
    assert leaves.sum() > 5
    assert given[leaves].mean() > 0.5
    assert (given & is_wire).sum() < (given & leaves).sum()
    assert not given[~own].any()
    assert ((along[given] >= 12 - CROWD_LENGTH) & (along[given] <= 20 + CROWD_LENGTH)).all()


def test_the_limit_is_where_both_densities_are_equal():
    along, distance, own, _ = make_surroundings(crown=300.0, per_metre=50.0)
    given = find_intruders(along, distance, own, ~own, TOLERANCE)
    inside = (along > 12.5) & (along < 19.5) & own
    limit = distance[given & inside].min()
    density = 50.0 / (2 * np.pi * 0.03**2) * np.exp(-(limit**2) / (2 * 0.03**2))
    assert density == pytest.approx(300.0, rel=0.5)
    assert (given[inside] == (distance[inside] >= limit)).mean() > 0.9


def test_nothing_is_given_back_without_a_crown_or_without_free_parts():
    along, distance, own, _ = make_surroundings(crown=0.0)
    assert not find_intruders(along, distance, own, ~own, TOLERANCE).any()
    along, distance, own, _ = make_surroundings()
    within = (along > 12) & (along < 20)
    assert not find_intruders(
        along[within], distance[within], own[within], ~own[within], TOLERANCE
    ).any()
    none = np.zeros(0)
    assert find_intruders(none, none, none > 0, none > 0, TOLERANCE).tolist() == []


def make_pin(num=150, at=30.0, radius=0.12, sigma=0.02, per_metre=20.0, seed=0):
    """Make 30 m of conductor and a pin at its end or elsewhere on it; truth last."""
    rng = np.random.default_rng(seed)
    count = int(30 * per_metre)
    wire = np.column_stack([rng.uniform(0, 30, count), rng.normal(0, sigma, (count, 2))])
    away, turn = radius * np.sqrt(rng.uniform(0, 1, num)), rng.uniform(0, 2 * np.pi, num)
    pin = np.column_stack([
        at + rng.uniform(-0.15, 0.15, num), away * np.cos(turn), away * np.sin(turn),
    ])
    points = np.vstack([wire, pin])
    distance = np.hypot(points[:, 1], points[:, 2])
    return np.abs(points[:, 0]), distance, distance <= TOLERANCE, np.arange(len(points)) < count


@pytest.mark.parametrize('at', [0.0, 30.0])
@pytest.mark.parametrize('seed', range(5))
def test_a_pin_on_a_conductor_is_its_supports(at, seed):
    along, distance, own, is_wire = make_pin(at=at, seed=seed)
    held = find_held(along, distance, own, 30.0, (True, True))
    assert held[own & ~is_wire].mean() > 0.7
    assert (held & is_wire).sum() <= 3
    assert not find_held(along, distance, own, 30.0, (at > 0.0, at == 0.0)).any()  # open there


@pytest.mark.parametrize(('radius', 'sigma'), [(0.0, 0.0), (0.01, 0.03)])
def test_points_that_scatter_no_wider_than_a_conductor_are_its_own(radius, sigma):
    along, distance, own, _ = make_pin(radius=radius, sigma=sigma)
    assert not find_held(along, distance, own, 30.0, (True, True)).any()


@pytest.mark.parametrize('changes', [{'num': 0}, {'at': 15.0}, {'num': 5}])
@pytest.mark.parametrize('seed', range(5))
def test_no_support_is_where_no_more_points_are_than_elsewhere(changes, seed):
    along, distance, own, _ = make_pin(seed=seed, **changes)
    assert not find_held(along, distance, own, 30.0, (True, True)).any()
    along, distance, own, _ = make_pin(per_metre=0.5, seed=seed)  # too few to tell
    assert not find_held(along, distance, own, 30.0, (True, True)).any()


def test_a_crown_about_a_conductor_keeps_its_leaves(monkeypatch):
    trees = [make_tree(x, 0.0, 15.8, 11.0, 2.5, 12000, seed=int(x)) for x in (30.0, 45.0)]
    points, label = make_line_cloud(spans=(90.0,), offsets=(0.0,), more=trees)

    def count_leaves():
        result = Pipeline().run(points)
        assert len(result.spans) == 1
        assert (result.line_id[label == 14] >= 0).mean() > 0.9
        return int(((result.line_id >= 0) & (label == 1)).sum())

    after = count_leaves()
    monkeypatch.setattr(
        point_claims, 'find_intruders', lambda along, *others: np.zeros(len(along), dtype=bool)
    )
    before = count_leaves()
    assert before > 30
    assert after < 0.6 * before


def test_what_is_given_back_is_no_obstacle_at_no_distance():
    trees = [make_tree(x, 0.0, 15.8, 11.0, 2.5, 12000, seed=int(x)) for x in (30.0, 45.0)]
    points, _ = make_line_cloud(spans=(90.0,), offsets=(0.0,), more=trees)
    trace = Pipeline().trace(points)
    taken = np.isin(np.arange(len(points)), trace.lines.spans.intruders)
    assert taken.sum() > 20
    assert (trace.result.line_id[taken] < 0).all()
    assert not (trace.result.classification[taken] == PointClass.VEGETATION).any()
    assert trace.result.hazards
    for hazard in trace.result.hazards:
        assert not (np.linalg.norm(points[taken] - hazard.position, axis=1) < 1e-6).any()


def test_arms_and_insulators_about_an_end_keep_their_points():
    """Without them as surroundings 33 of the 2000 points would be the conductor's."""
    taken = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        arms = rng.uniform((99.2, -0.6, 14.4), (100.0, 0.6, 15.6), (500, 3))
        points, label = make_line_cloud(spans=(100.0,), offsets=(0.0,), more=[arms], seed=seed)
        wire = Pipeline().run(points).line_id >= 0
        assert wire[label == 14].mean() > 0.99
        taken += int(wire[label == 1].sum())
    assert taken < 25
