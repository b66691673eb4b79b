# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bare columns at conductors: poles that no span hangs on."""

from factories import find_nearby, make_model, make_span_result
import numpy as np
import pytest
from toys import make_tree

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.columns import find_columns, find_straight
from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.results import HazardKind

MODEL = make_model((0.0, 0.0, 12.0), (100.0, 0.0, 12.0))


def make_pole(x, y=1.0, *, top=12.5, bottom=2.0, width=0.35, num=200):
    """Points on the surface of a pole."""
    rng = np.random.default_rng(3)
    angle = rng.uniform(0.0, 2.0 * np.pi, num)
    return np.column_stack([
        x + width / 2 * np.cos(angle), y + width / 2 * np.sin(angle), rng.uniform(bottom, top, num)
    ]) + rng.normal(0.0, 0.03, (num, 3))


def find(points, straight=None):
    """Return the points that are of held and of lone columns, or by straight as it tells them."""
    near = find_nearby(points, [MODEL], 20.0)
    held, lone = np.zeros((2, len(points)), dtype=bool)
    own = points[near.index]
    held[near.index], lone[near.index] = (
        find_columns(own, near.distance, near.span, [MODEL]) if straight is None
        else straight(own, near.span, [MODEL])
    )
    return held, lone


def raise_hazards(points, model=MODEL):
    near = find_nearby(points, [model], 20.0)
    return find_hazards(points, points[:, 2].astype(np.float32), near,
                        make_span_result([model], len(points)), HazardSettings()).hazards


@pytest.mark.parametrize('y', [0.0, 1.0, -2.0])
@pytest.mark.parametrize('x', [3.0, 6.0, 94.0])
def test_a_pole_near_an_end_holds_the_conductor(x, y):
    held, lone = find(make_pole(x, y))
    pole = make_pole(x, y)
    assert held[pole[:, 2] > 6.5].mean() > 0.98
    assert not lone.any()


def test_a_pole_away_from_the_ends_is_a_structure():
    pole = make_pole(50.0)
    held, lone = find(pole)
    assert lone.mean() > 0.7
    assert not held.any()
    (hazard,) = raise_hazards(pole)
    assert hazard.kind == HazardKind.STRUCTURE
    assert hazard.clearance == pytest.approx(0.8, abs=0.15)


def test_a_pole_among_crowns_is_none_and_they_still_are_hazards():
    """The pole is 6 m from the end, and a crown that is nearer than allowed touches it."""
    pole, crown = make_pole(6.0, 0.3), make_tree(9.0, 0.5, 9.5, radius=1.5, bottom=5.0)
    points = np.vstack([pole, crown])
    held, _ = find(points)
    assert held[: len(pole)].mean() > 0.6
    assert not held[len(pole):].any()
    hazards = raise_hazards(points)
    (alone,) = raise_hazards(crown)
    assert [item.kind for item in hazards] == [HazardKind.VEGETATION]
    assert hazards[0].clearance == pytest.approx(alone.clearance, abs=1e-9)


@pytest.mark.parametrize('points', [
    make_pole(6.0, 4.0),  # too far beside
    make_pole(6.0, top=8.5),  # too low
    make_pole(6.0, width=1.0),  # as thick as a crown
    make_pole(6.0, bottom=10.8),  # too short
    make_pole(6.0, num=8),  # hardly seen
], ids=['far', 'low', 'thick', 'short', 'sparse'])
def test_what_is_no_pole_of_the_line(points):
    held, lone = find(points)
    assert not held.any()
    assert not lone.any()


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('x', [5.0, 50.0])
def test_crowns_hold_no_columns(x, seed):
    for per_crown in (40, 400, 4000):
        tree = make_tree(x, 0.0, 11.0, radius=1.5, bottom=4.0, num=per_crown, seed=seed)
        held, lone = find(tree)
        assert not held.any()
        assert not lone.any()


def test_nothing_near():
    held, lone = find_columns(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64), [MODEL])
    assert held.shape == lone.shape == (0,)


def make_drop(end, num, seed=4):
    """Points of a straight wire from beside the end of the conductor to an end (3,)."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0.2, 0.9, num)[:, None]
    return (np.array([0.3, 0.4, 11.8]) * (1.0 - share) + np.array(end) * share
            + rng.normal(0.0, 0.03, (num, 3)))


@pytest.mark.parametrize('num', [5, 8])
def test_few_returns_of_a_drop_or_stay_are_of_the_line(num):
    drop = make_drop((3.0, 4.0, 9.0), num)
    held, lone = find(drop, find_straight)
    assert held.all()
    assert not lone.any()
    assert not raise_hazards(drop)


def test_a_straight_edge_that_leads_past_no_end_stays_a_hazard():
    rng = np.random.default_rng(5)
    edge = np.column_stack([np.full(9, 6.0), np.linspace(1.5, 5.0, 9), np.full(9, 9.0)])
    edge += rng.normal(0.0, 0.02, edge.shape)
    held, lone = find(edge, find_straight)
    assert lone.all()
    assert not held.any()
    (hazard,) = raise_hazards(edge)
    assert hazard.kind == HazardKind.STRUCTURE
    # with a second row beside it, it is not by itself
    roof = np.vstack([edge, edge + np.array([1.3, 0.0, 0.4])])
    held, lone = find(roof, find_straight)
    assert not (held | lone).any()
    assert raise_hazards(roof)


@pytest.mark.parametrize('seed', range(20))
def test_sparse_crowns_are_not_straight(seed):
    rng = np.random.default_rng(seed)
    crown = rng.uniform([48.0, 0.5, 7.0], [50.0, 2.5, 10.5], (8, 3))
    assert not np.any(find(crown, find_straight))
    (hazard,) = raise_hazards(crown)
    assert hazard.kind == HazardKind.VEGETATION
