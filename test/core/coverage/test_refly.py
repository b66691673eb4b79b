# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The way proposed passes all that was not seen, and nothing too near."""

from itertools import pairwise

import numpy as np
import pytest
from spans import make_span, sample_points

from plc_inspect.core.coverage.airspace import LEAD, NEAR, OBSTACLES, SAFE
from plc_inspect.core.coverage.coverage import Coverage, look_at_section, Part
from plc_inspect.core.coverage.refly import (
    ABOVE,
    ASIDES,
    Kind,
    LOW_LEAD,
    MISSED,
    MOST_SLOPE,
    plan_refly,
)
from plc_inspect.core.coverage.sections import find_sections
from plc_inspect.core.coverage.seen_ground import see_ground


@pytest.fixture
def one_way(monkeypatch):
    """Lay runs at the least distance alone, where a tree stands in the way."""
    monkeypatch.setattr('plc_inspect.core.coverage.refly.ASIDES', (0.0,))


def make_corner():
    """Return two spans with a corner of 60 degrees between them, two conductors each."""
    end = 100.0 + 100.0 * np.cos(np.pi / 3), 100.0 * np.sin(np.pi / 3)
    return [
        make_span((0.0, -2.0, 20.0), (100.0, -2.0, 20.0), 0, 0),
        make_span((0.0, 2.0, 20.0), (100.0, 2.0, 20.0), 1, 0),
        make_span((100.0, -2.0, 20.0), (end[0] + 2.0, end[1] - 1.0, 24.0), 0, 1),
        make_span((100.0, 2.0, 20.0), (end[0] - 2.0, end[1] + 1.0, 24.0), 1, 1),
    ]


def plan(hidden, tree=None, start=None, spans=None):
    """Return coverage, plan and dense places on conductors where some ground is hidden."""
    x, y = np.mgrid[-60.0:260.0:0.5, -80.0:180.0:0.5].reshape(2, -1)
    keep = ~hidden(x, y)
    points = np.column_stack([x, y, np.zeros(len(x))])[keep]
    if tree is not None:
        points = np.vstack([points, tree])
    ground = see_ground(points, np.zeros(len(points), dtype=bool))
    spans = make_corner() if spans is None else spans
    coverage = Coverage(sections=tuple(
        look_at_section(section, [sample_points(span) for span in section.spans], ground, None)
        for section in find_sections(spans)
    ))
    wires = np.vstack([sample_points(span, 1000) for span in spans])
    return coverage, plan_refly(coverage, ground, start), wires


def walk(places):
    """Return places every half metre along a way."""
    parts = [
        first + np.linspace(0.0, 1.0, 2 + int(2 * np.linalg.norm(last - first)))[:, None]
        * (last - first) for first, last in pairwise(places)
    ]
    return np.vstack(parts)


def test_nothing_to_fly_where_all_was_seen():
    coverage, refly, _ = plan(lambda x, y: x > np.inf)
    assert coverage.gaps == ()
    assert refly.runs == refly.kinds == ()
    assert refly.places.shape == (0, 3)
    assert refly.length == 0.0


@pytest.mark.parametrize('hidden', [
    lambda x, y: np.abs(y) < 15.0,
    lambda x, y: y < -2.0,
    lambda x, y: x > -np.inf,
    lambda x, y: (y > 0.0) & (x > 60.0),
])
def test_all_is_passed_at_a_safe_distance(hidden):
    coverage, refly, wires = plan(hidden)
    gaps = coverage.gaps
    assert gaps
    shown = {(number, run.is_left) for run in refly.runs for number in run.gaps}
    assert {number for number, _ in shown} == {*range(len(gaps))}
    for number, gap in enumerate(gaps):
        if gap.part in (Part.LEFT, Part.RIGHT):
            assert (number, gap.part == Part.LEFT) in shown
    way = walk(refly.places)
    apart = np.linalg.norm(way[:, None] - wires[None, ::4], axis=2).min(axis=1)
    assert apart.min() >= SAFE
    for run in refly.runs:
        for number in run.gaps:
            gap = gaps[number]
            near = np.linalg.norm(walk(run.places)[:, None, :2] - gap.places[None, :, :2], axis=2)
            assert near.min(axis=0).max() <= SAFE + max(ASIDES) + 15.0
    assert len(refly.kinds) == len(refly.run) == len(refly.places)
    assert list(refly.run) == sorted(refly.run)


def test_runs_lead_in_and_out_and_begin_at_the_nearer_end():
    hidden = lambda x, y: (y > 2.0) & (y < 20.0) & (x > 40.0) & (x < 60.0)  # noqa: E731
    for start, near in (((-55.0, 20.0, 16.0), 0), ((150.0, 160.0, 30.0), -1)):
        _, refly, _ = plan(hidden, start=np.array(start))
        assert {run.is_left for run in refly.runs} == {True, False}
        for run in refly.runs:
            x = run.places[:, 0]
            assert x.min() == pytest.approx(40.0 - LOW_LEAD, abs=5.0)
            assert x.max() == pytest.approx(60.0 + LOW_LEAD, abs=5.0)
        x = refly.runs[0].places[:, 0]
        assert x[0] == (x.min() if near == 0 else x.max())
        # the second start is beyond the conductors of the other span
        assert refly.kinds[0] == (Kind.RUN if near == 0 else Kind.TRANSIT)


def test_way_over_what_was_not_seen_is_above_all_beside_it():
    gap = lambda x, y: (y > 2.0) & (y < 20.0) & (x > 40.0) & (x < 60.0)  # noqa: E731
    start = np.array([-50.0, 20.0, 15.0])
    _, refly, _ = plan(gap, start=start)
    assert refly.kinds[0] == Kind.RUN
    tree = np.column_stack([np.full(50, -40.0), np.full(50, 50.0), np.linspace(0.0, 25.0, 50)])
    _, refly, _ = plan(lambda x, y: gap(x, y) | (x < -45.0), tree, start=start)
    assert refly.kinds[:2] == (Kind.TRANSIT, Kind.TRANSIT)
    assert refly.places[:2, 2].min() >= 25.0 + OBSTACLES


@pytest.mark.parametrize('is_seen', [True, False])
def test_no_run_goes_beyond_known_conductors_where_nothing_was_seen(is_seen):
    """The line may turn there."""
    span = make_span((0.0, 0.0, 40.0), (150.0, 0.0, 40.0), 0, 0, is_open=(False, True))
    gap = lambda x, y: (np.abs(y) < 12.0) & (np.abs(x - 130.0) < 15.0)  # noqa: E731
    coverage, refly, _ = plan(
        lambda x, y: gap(x, y) | ((x > 152.0) if not is_seen else (x > np.inf)), spans=[span],
    )
    assert {gap.part for gap in coverage.gaps} == {*Part}
    assert len(refly.runs) > 1
    for run in refly.runs:
        assert (run.places[:, 0].max() > 152.0 + NEAR) == is_seen


@pytest.mark.usefixtures('one_way')
def test_way_goes_over_a_tree_that_was_seen():
    tree = np.column_stack([np.full(50, 50.0), np.full(50, 22.0), np.linspace(0.0, 35.0, 50)])
    hidden = lambda x, y: (y > 2.0) & (y < 12.0) & (x > 40.0) & (x < 60.0)  # noqa: E731
    _, refly, _ = plan(hidden, tree)
    way = walk(refly.places)
    over = np.hypot(*(way[:, :2] - tree[0, :2]).T) <= NEAR
    assert over.any()
    assert way[over, 2].min() >= 35.0 + OBSTACLES - 1e-6


@pytest.mark.usefixtures('one_way')
@pytest.mark.parametrize('aside', [0.0, 3.0, 5.0, 7.5])
def test_tree_beside_a_leg_counts_as_one_beside_a_waypoint(aside):
    hidden = lambda x, y: (y > 2.0) & (y < 12.0) & (x > 20.0) & (x < 90.0)  # noqa: E731
    _, refly, _ = plan(hidden)
    middle = (refly.places[2] + refly.places[3]) / 2
    x, y = middle[0], middle[1] + aside
    tree = np.column_stack([np.full(50, x), np.full(50, y), np.linspace(0.0, 35.0, 50)])
    way = walk(plan(hidden, tree)[1].places)
    over = np.hypot(*(way[:, :2] - tree[0, :2]).T) <= NEAR
    assert way[over, 2].min() >= 35.0 + OBSTACLES - 1e-6


@pytest.mark.usefixtures('one_way')
@pytest.mark.parametrize('tree', [
    (54.8672, 20.5114, 67.777), (37.8525, 20.0343, 68.294), (35.1618, 20.5496, 132.0454),
])
def test_every_place_of_a_steep_leg_is_above_the_trees_near_it(tree):
    """Also those between the places that are compared."""
    tree = np.array([tree, tree])
    _, refly, _ = plan(lambda x, y: (y > 2.0) & (y < 10.0) & (x > 40.0) & (x < 70.0), tree)
    way = walk(refly.places)
    near = np.hypot(*(way[:, :2] - tree[0, :2]).T) <= NEAR
    assert way[near, 2].min() >= tree[0, 2] + OBSTACLES - 1e-6


@pytest.mark.parametrize('seed', range(12))
def test_nothing_on_the_way_is_near_a_line_that_crosses_above(seed):
    rng = np.random.default_rng(seed)
    middle, low, turn = rng.uniform(0.0, 200.0), rng.uniform(9.0, 14.0), rng.uniform(-0.6, 0.6)
    high, begin = low + rng.uniform(20.0, 35.0), rng.uniform(0.0, 120.0)
    along = 75.0 * np.array([np.sin(turn), np.cos(turn)])
    spans = [make_span((0.0, 0.0, low), (200.0, 0.0, low), 0, 0)] + [
        make_span(
            (middle + aside - along[0], -along[1], high),
            (middle + aside + along[0], along[1], high), 5 + number, 7,
        ) for number, aside in enumerate((-8.0, 0.0, 8.0))
    ]
    _, refly, wires = plan(
        lambda x, y: (np.abs(y) > 1) & (np.abs(y) < 12) & (x > begin) & (x < begin + 70.0),
        spans=spans, start=np.array([rng.uniform(-50.0, 250.0), *rng.uniform(30.0, 60.0, 2)]),
    )
    assert refly.runs
    apart = [np.linalg.norm(place - wires, axis=1).min() for place in walk(refly.places)]
    assert min(apart) >= SAFE


@pytest.mark.parametrize('start', [
    (30.0, -5.0, 14.0), (30.0, 0.0, 12.0), (30.0, -4.0, 26.0),
])
def test_first_run_on_the_other_side_is_reached_over_the_conductors(start):
    hidden = lambda x, y: (y > 2.0) & (y < 14.0) & (x < 60.0)  # noqa: E731
    _, refly, wires = plan(hidden, start=np.array(start))
    assert refly.kinds[0] == Kind.TRANSIT
    assert refly.run[0] == 0
    way = walk(np.vstack([start, refly.places]))
    apart = np.array([np.linalg.norm(place - wires, axis=1).min() for place in way])
    # it leaves what is near at the start, and comes near nothing again
    assert np.diff(np.minimum(apart, SAFE)).min() >= -1e-2


def test_start_below_conductors_on_the_ground_is_left_to_the_pilot():
    hidden = lambda x, y: (y > 2.0) & (y < 14.0) & (x < 60.0)  # noqa: E731
    _, refly, _ = plan(hidden, start=np.array([30.0, 0.0, 1.0]))
    assert set(refly.kinds) == {Kind.RUN}


@pytest.mark.usefixtures('one_way')
def test_run_that_no_lift_makes_safe_is_left_out():
    hidden = lambda x, y: (y > 2.0) & (y < 12.0) & (x > 20.0) & (x < 90.0)  # noqa: E731
    _, refly, _ = plan(hidden)
    middle = (refly.places[2] + refly.places[3]) / 2
    masts = np.concatenate([np.column_stack([
        np.tile([middle[0], y], (50, 1)), np.linspace(0.0, 400.0, 50),
    ]) for y in (middle[1], -middle[1])])
    coverage, refly, _ = plan(hidden, masts)
    assert coverage.gaps
    assert refly.runs == refly.kinds == ()
    assert refly.places.shape == (0, 3)


def test_other_side_is_reached_over_the_conductors():
    spans = [make_span((-50.0, y, 20.0), (250.0, y, 20.0), int(y > 0.0), 0) for y in (-2.0, 2.0)]
    _, refly, wires = plan(
        lambda x, y: (np.abs(y) > 2.0) & (np.abs(y) < 14.0) & (np.abs(x - 100.0) < 9.0),
        spans=spans,
    )
    assert {run.is_left for run in refly.runs} == {True, False}
    assert Kind.TRANSIT in refly.kinds
    over = refly.places[np.array(refly.kinds) == Kind.TRANSIT]
    near = wires[(wires[:, 0] > over[:, 0].min()) & (wires[:, 0] < over[:, 0].max() + 1.0)]
    assert over[:, 2].min() >= near[:, 2].max() + SAFE + MISSED


def test_ground_is_passed_low_and_conductors_at_their_height():
    (span,) = spans = [make_span((-60.0, 0.0, 40.0), (200.0, 0.0, 40.0), 0, 0)]
    points = sample_points(span)
    points = points[np.abs(points[:, 0] - 70.0) > 20.0]
    x, y = np.mgrid[-200.0:340.0:0.5, -80.0:80.0:0.5].reshape(2, -1)
    keep = (x < 50.0) | (x > 90.0) | (np.abs(y) > 15.0)
    floor = np.column_stack([x, y, np.zeros(len(x))])[keep]
    ground = see_ground(floor, np.zeros(len(floor), dtype=bool))
    (section,) = find_sections(spans)
    sight = look_at_section(section, [points], ground, None)
    refly = plan_refly(Coverage(sections=(sight,)), ground)
    assert {gap.part for gap in sight.gaps} == {*Part}
    for run in refly.runs:
        parts = {sight.gaps[number].part for number in run.gaps}
        is_low = Part.CONDUCTOR not in parts
        assert len(parts) == 1 or is_low
        high = span.heights(run.places[:, 0] + 60.0) + ABOVE
        assert run.places[:, 2] == pytest.approx(OBSTACLES if is_low else high, abs=1.0)
        lead = LOW_LEAD if is_low else LEAD
        assert run.places[:, 0].min() == pytest.approx(50.0 - lead, abs=6.0)


def test_unseen_ground_is_passed_as_high_as_trees_beside_it_and_not_too_steeply():
    spans = [make_span((-60.0, 0.0, 40.0), (200.0, 0.0, 40.0), 0, 0)]
    x, y, z = np.mgrid[44.0:50.0, -30.0:50.0, 0.0:21.0].reshape(3, -1)
    trees = np.concatenate([np.column_stack([x, y, z]), np.column_stack([x + 47.0, y, z])])
    _, refly, _ = plan(lambda x, y: (x > 50.0) & (x < 90.0) & (y > -30.0), trees, spans=spans)
    for run in refly.runs:
        if run.is_left:
            over = (run.places[:, 0] > 55.0) & (run.places[:, 0] < 85.0)
            assert over.any()
            assert run.places[over, 2] == pytest.approx(20.0 + OBSTACLES, abs=0.5)
        legs = np.diff(run.places, axis=0)
        assert (np.abs(legs[:, 2]) <= MOST_SLOPE * np.hypot(*legs[:, :2].T) + 1e-9).all()


def test_ground_is_passed_where_most_of_it_comes_into_view():
    """Over a tree in the nearest way nothing would."""
    spans = [make_span((-60.0, 0.0, 40.0), (200.0, 0.0, 40.0), 0, 0)]
    gap = lambda x, y: (y > 0.0) & (y < 10.0) & (np.abs(x - 70.0) < 20.0)  # noqa: E731
    _, near, _ = plan(gap, spans=spans)
    x, y, z = np.mgrid[-40.0:200.0:2.0, 10.0:14.0, 0.0:30.0].reshape(3, -1)
    trees = np.column_stack([x, y + 6.0, z])
    _, far, _ = plan(gap, trees, spans=spans)
    (low,), (aside,) = (
        [run for run in found.runs if run.is_left] for found in (near, far)
    )
    assert low.places[:, 1].max() < SAFE + 5.0
    assert aside.places[:, 1].min() > SAFE + 10.0
    assert aside.places[:, 2].max() < 30.0
