# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest
from toys import (
    find_tracks,
    hang,
    make_curve,
    make_index,
    make_sight,
    make_tree,
    make_wire,
    turn,
)

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.bundles import merge_bundles
from plc_inspect.core.catenary.duplicates import drop_duplicates
from plc_inspect.core.catenary.track_fit import split_at_supports
from plc_inspect.core.evidence.conductors import (
    bridge,
    model_conductors,
)

SETTINGS = CatenarySettings()


def model(points, settings=SETTINGS, tracks=None):
    return model_conductors(
        points, make_index(points), tracks or find_tracks(points), make_sight(points), settings,
        np.random.default_rng(0),
    )


def make(y=0.0, z=20.0, length=100.0, **changes):
    return make_wire((0.0, y, z), (length, y, z), **changes)


def test_two_spans_of_one_wire_are_two_curves():
    points = np.vstack([
        make_wire((0.0, 0.0, 15.0), (90.0, 0.0, 15.0), seed=1),
        make_wire((90.0, 0.0, 15.0), (170.0, 0.0, 16.0), seed=2),
    ])
    found = model(points)
    assert len(found.curves) == 2
    assert [curve.length for curve in found.curves] == pytest.approx([90.0, 80.0], abs=1.0)
    for curve in found.curves:
        assert curve.fit.c == pytest.approx(800.0, rel=0.05)
        assert curve.fit.rmse == pytest.approx(0.02, rel=0.2)


def test_a_track_is_split_at_its_supports():
    points = np.vstack([
        make_wire((start, 0.0, 15.0), (start + 50.0, 0.0, 15.0), seed=start)
        for start in (0, 50, 100)
    ])
    parts = split_at_supports(points, np.arange(len(points)))
    assert len(parts) == 3
    assert sorted(np.concatenate(parts).tolist()) == list(range(len(points)))
    edges = sorted(float(points[part, 0].max()) for part in parts)
    assert edges == pytest.approx([50.0, 100.0, 150.0], abs=3.0)


def test_the_model_bridges_a_hidden_third():
    points = make(length=240.0, parts=((0.0, 0.33), (0.66, 1.0)))
    found = model(points)
    assert len(found.curves) == 1
    curve = found.curves[0]
    assert curve.length == pytest.approx(240.0, abs=1.0)
    x = np.linspace(1.0, 239.0, 100)
    at = curve.position(x + curve.low)
    np.testing.assert_allclose(at[:, 2], hang(at[:, 0], 240.0, 20.0, 20.0, 800.0), atol=0.03)
    # without the bridge it is two
    short = dataclasses.replace(SETTINGS, max_bridge=0.0)
    assert len(model(points, short).curves) == 2


def test_pieces_of_two_conductors_are_not_bridged():
    points = np.vstack([
        make(length=240.0, parts=((0.0, 0.33),)),
        make(y=0.8, length=240.0, parts=((0.66, 1.0),)),
    ])
    curves = [make_curve(points, part) for part in np.split(np.arange(len(points)), [633])]
    assert len(bridge(points, curves, SETTINGS)) == 2


def test_spans_on_both_sides_of_a_support_are_not_bridged():
    points = np.vstack([
        make_wire((0.0, 0.0, 15.0), (90.0, 0.0, 15.0), seed=1),
        make_wire((90.0, 0.0, 15.0), (170.0, 0.0, 15.0), seed=2),
    ])
    curves = [make_curve(points, np.arange(720)), make_curve(points, np.arange(720, 1360))]
    assert len(bridge(points, curves, SETTINGS)) == 2


class LateSearch:
    """Finds nothing but the points from a first one on, beside what is known."""

    def __init__(self, points, first):
        self.rest = points.copy()
        self.rest[:first] = np.random.default_rng(3).uniform(-1e3, 1e3, (first, 3))
        self.nothing = find_tracks(self.rest[:first])

    def look_steeply(self, curves):
        return self.nothing

    def look_sparsely(self, curves):
        return self.nothing

    def look_beside(self, curves, others):
        return find_tracks(self.rest)


def test_what_a_later_search_finds_of_a_conductor_is_bridged():
    points = make(length=200.0, parts=((0.0, 0.55), (0.6, 1.0)))
    num = int((points[:, 0] < 115.0).sum())
    found = model_conductors(
        points, make_index(points), find_tracks(points[:num]), make_sight(points), SETTINGS,
        np.random.default_rng(0), LateSearch(points, num),
    )
    assert [curve.length for curve in found.curves] == pytest.approx([200.0], abs=1.0)


def make_pair(apart, noise, length=200.0):
    points = np.vstack([
        make(length=length, noise=noise, seed=1), make(y=apart, length=length, noise=noise, seed=2)
    ])
    half = len(points) // 2
    tolerance = max(0.1, 3 * noise)
    curves = [
        make_curve(points, np.arange(half), tolerance),
        make_curve(points, np.arange(half, 2 * half), tolerance),
    ]
    return points, curves


def test_sub_conductors_that_cannot_be_told_apart_are_one():
    points, curves = make_pair(0.3, 0.06)
    merged = merge_bundles(points, curves, SETTINGS)
    assert len(merged) == 1
    assert merged[0].num_points > 0.95 * len(points)
    assert np.abs(merged[0].position(merged[0].mean_x)[0, 1] - 0.15) < 0.05
    apart = dataclasses.replace(SETTINGS, bundle_width=0.0)
    assert len(merge_bundles(points, curves, apart)) == 2


@pytest.mark.parametrize(('apart', 'noise', 'length'), [
    (0.4, 0.02, 200.0), (1.2, 0.06, 200.0), (0.3, 0.06, 45.0),
], ids=['clear of each other', 'too far apart', 'too short for a bundle'])
def test_conductors_that_can_be_told_apart_stay_two(apart, noise, length):
    points, curves = make_pair(apart, noise, length)
    assert len(merge_bundles(points, curves, SETTINGS)) == 2


def test_a_line_across_others_has_no_points_of_its_own():
    wires = [make(y=y, seed=number) for number, y in enumerate((0.0, 0.2, 0.4))]
    points = np.vstack(wires)
    own = [make_curve(points, np.arange(800 * k, 800 * k + 800)) for k in range(3)]
    x, y = points[:, 0], points[:, 1]
    across = make_curve(points, np.flatnonzero(np.abs(y - 0.004 * x) < 0.06))
    kept = drop_duplicates(points, [*own, across], CatenarySettings())
    assert len(kept) == 3
    assert across not in kept


def test_the_rest_of_a_bundle_is_no_duplicate_of_a_conductor_that_is_told_apart():
    wires = [make(y=y, seed=number) for number, y in enumerate((0.3, 0.0, 0.6))]
    points, num = np.vstack(wires), len(wires[0])
    alone = make_curve(points, np.arange(num))
    # the rest was fitted to a sample, so it has fewer points than the one that is alone
    rest = make_curve(points, np.arange(num, 3 * num, 3), tolerance=0.6)
    inside = make_curve(points, np.arange(num, 2 * num, 4))
    for order in ([alone, rest, inside], [inside, rest, alone]):
        kept = drop_duplicates(points, order, SETTINGS)
        assert {id(curve) for curve in kept} == {id(alone), id(rest)}


def test_an_edge_with_other_things_all_along_it_is_no_conductor():
    # an edge that sags like a wire, with a sheet hanging from 0.25 m beside it
    edge = make(length=60.0, c=500.0, per_metre=12.0)
    sheet = make(length=60.0, c=500.0, per_metre=60.0, seed=5)
    rng = np.random.default_rng(6)
    sheet[:, 1] += rng.uniform(0.25, 0.8, len(sheet))
    sheet[:, 2] += rng.uniform(-0.4, 0.1, len(sheet))
    points = np.vstack([edge, sheet])
    tracks = find_tracks(points, np.arange(len(edge)))
    found = model(points, tracks=tracks)
    assert len(found.curves) == 0
    assert found.objections == {'not free in the air': 1}
    lenient = dataclasses.replace(SETTINGS, max_clutter=1.0, min_evidence=0.0)
    assert len(model(points, lenient, tracks).curves) == 1


def test_the_chords_of_a_truss_are_not_even_doubtful():
    chords = [make(y=y, length=60.0, c=500.0, per_metre=30.0, seed=k)
              for k, y in enumerate((0.0, 1.5))]
    rng = np.random.default_rng(3)
    x = rng.uniform(0.0, 60.0, 480)
    bracing = np.column_stack([
        x, 1.5 * np.abs(2.0 * (x % 1.0) - 1.0), hang(x, 60.0, 20.0, 20.0, 500.0)
    ])
    points = np.vstack([*chords, bracing + rng.normal(0.0, 0.02, bracing.shape)])
    found = model(points, tracks=find_tracks(points, np.arange(len(points) - len(bracing))))
    assert len(found.curves) == 0
    assert found.objections['tied to another line along its length'] == 2
    assert all(curve.length < 30.0 for curve in found.doubtful)


def test_a_tree_across_a_wire_costs_nothing():
    wire = make(z=12.0)
    tree = make_tree(40.0, 0.5, 14.0, 3.0, 2.5, 3000)
    found = model(np.vstack([wire, tree]))
    assert len(found.curves) == 1
    assert found.curves[0].length == pytest.approx(100.0, abs=1.0)


def test_the_eave_of_a_roof_is_not_even_doubtful():
    rng = np.random.default_rng(3)
    eave = make(length=9.0, c=1200.0, per_metre=8.0)
    roof = np.column_stack([
        rng.uniform(0.0, 9.0, 900), rng.uniform(0.3, 5.0, 900), rng.normal(20.1, 0.02, 900)
    ])
    points = np.vstack([eave, roof])
    tracks = find_tracks(points, np.arange(len(eave)))
    found = model(points, tracks=tracks)
    assert len(found.curves) == len(found.doubtful) == len(found.crowded) == 0


def test_what_is_too_short_to_be_sure_is_doubtful():
    found = model(make(length=10.0, c=1200.0, per_metre=5.0))
    assert len(found.curves) == 0
    assert len(found.doubtful) == 1
    assert found.objections == {'curvature not proven': 1}


@pytest.mark.parametrize(('length', 'num'), [(9.0, 1), (3.5, 0)])
def test_a_short_piece_is_doubtful_unless_it_is_very_short(length, num):
    found = model(make(length=length, c=1200.0, per_metre=8.0))
    assert len(found.curves) == 0
    assert len(found.doubtful) == num


def test_a_short_piece_that_is_hardly_seen_is_not_doubtful_but_nothing():
    seen = make(length=9.0, c=1200.0, per_metre=8.0)
    assert len(model(seen).doubtful) == 1
    few = dataclasses.replace(SETTINGS, min_points=len(seen) + 1)
    found = model(seen, few)
    assert len(found.doubtful) == 0
    assert found.objections == {'too few points': 1}


@pytest.mark.parametrize('degrees', [90, 30, -70])
def test_yaw_and_translation(degrees):
    points = np.vstack([make(y=y, seed=number) for number, y in enumerate((0.0, 3.0, 6.0))])
    moved = turn(points, np.radians(degrees), (5e5, 6.6e6, 50.0))
    found = model(moved)
    assert len(found.curves) == 3
    for curve in found.curves:
        assert curve.length == pytest.approx(100.0, abs=1.0)
        assert abs(np.sin(curve.azimuth - np.radians(degrees))) < 2e-3


def test_the_same_generator_gives_the_same_curves_and_input_is_unchanged():
    points = np.vstack([make(y=y, seed=number) for number, y in enumerate((0.0, 3.0))])
    before = points.copy()
    one, other = model(points), model(points)
    np.testing.assert_array_equal(points, before)
    for first, second in zip(one.curves, other.curves, strict=True):
        np.testing.assert_array_equal(first.fit.shape, second.fit.shape)
        np.testing.assert_array_equal(first.points, second.points)


@pytest.mark.parametrize('num', [0, 1])
def test_few_points(num):
    found = model(np.ones((num, 3)))
    assert found.curves == found.doubtful == ()
    assert found.objections == {}
    assert drop_duplicates(np.ones((num, 3)), [], CatenarySettings()) == ()
    assert bridge(np.ones((num, 3)), [], SETTINGS) == ()
    assert merge_bundles(np.ones((num, 3)), [], SETTINGS) == ()
