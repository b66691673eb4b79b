# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest
from toys import make_curve, make_ground, make_index, make_sight, make_wire

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.profile import profile_curve
from plc_inspect.core.evidence.free_length import measure_free_length
from plc_inspect.core.evidence.validation import (
    CROWDED,
    find_objection,
    is_scan_line,
    list_evidence,
    prove_sag,
    UNPROVEN,
)
from plc_inspect.errors import ConfigError

SETTINGS = CatenarySettings()


def judge(wire, others=(), settings=SETTINGS, tolerance=0.1, seen=True, **changes):
    points = np.vstack([wire, *others])
    curve = make_curve(points, np.arange(len(wire)), tolerance)
    return find_objection(curve, *measure(points, curve, seen), settings, **changes)


def measure(points, curve, seen=True):
    """Return the profile and the free length of a curve among some points."""
    index, ignore = make_index(points), np.zeros(len(points), dtype=bool)
    return (
        profile_curve(points, index, curve, curve.low, curve.high),
        measure_free_length(points, index, curve, ignore, make_sight(points, seen)),
    )


def make(length=80.0, **changes):
    return make_wire((0.0, 0.0, 12.0), (length, 0.0, 12.0), **{'c': 700.0, **changes})


@pytest.mark.parametrize(('length', 'c'), [(40.0, 300.0), (80.0, 700.0), (300.0, 1500.0)])
def test_there_is_nothing_against_a_conductor(length, c):
    assert judge(make(length, c=c)) == ''


def test_a_very_short_piece_is_no_conductor():
    assert judge(make(3.9, c=100.0)) == 'too short'
    assert judge(make(3.9, c=100.0), settings=CatenarySettings(min_length=3.0)) == UNPROVEN


def test_few_points_are_no_span():
    assert judge(make(80.0, per_metre=0.13)) == 'too few points'


def test_points_in_few_places_are_no_span():
    wire = make(100.0, parts=((0.0, 0.1), (0.9, 1.0)), per_metre=30.0)
    assert judge(wire) == 'seen in too few places'


@pytest.mark.parametrize(('length', 'c', 'beside', 'objection'), [
    (10.0, 1e5, False, UNPROVEN), (14.0, 1e5, False, ''),
    (10.0, 100.0, False, ''),  # half proven
    (5.0, 1e5, True, ''), (5.0, 1e5, False, UNPROVEN),
])
def test_free_metres_curvature_and_a_conductor_beside_add_up(length, c, beside, objection):
    assert judge(make(length, c=c), beside=beside) == objection


@pytest.mark.parametrize(('c', 'beside', 'objection'), [
    (150.0, False, ''), (150.0, True, ''), (2000.0, True, ''), (1e5, False, UNPROVEN),
])
def test_one_line_beside_is_no_clutter_of_what_sags_or_runs_beside_a_conductor(
    c, beside, objection
):
    cables = make(30.0, c=c, per_metre=60.0)
    cables = cables + np.random.default_rng(0).normal(0.0, 0.08, cables.shape) * [0.0, 1.0, 1.0]
    aside = np.array([0.0, 0.2, 0.7])
    assert judge(make(30.0, c=c), [cables - aside], beside=beside) == objection
    # two are a surface
    both = [cables - aside, cables + aside]
    assert judge(make(30.0, c=c), both, beside=beside) in (CROWDED, UNPROVEN)


def test_what_is_straight_and_alone_must_be_free_in_both_rings():
    wire = make(30.0, c=1e5)
    assert judge(wire) == ''
    beside = make(24.0, c=1e5, per_metre=60.0, seed=4)  # it touches four fifths
    beside[:, 1] += np.random.default_rng(0).uniform(0.1, 0.16, len(beside))
    assert judge(wire, [beside]) == UNPROVEN
    crown = make_ground((10, -1), (22, 1), 60.0) + np.array([0, 0, 11.4])
    assert judge(wire, [crown]) in (UNPROVEN, CROWDED)
    assert judge(make(30.0, c=300.0), [crown - np.array([0, 0, 0.4])]) == ''


def test_what_is_surely_straight_must_be_free_for_longer():
    pipe = {'c': 1e6, 'per_metre': 60.0, 'noise': 0.01}
    assert judge(make(18.0, **pipe)) == UNPROVEN
    assert judge(make(18.0, **pipe), beside=True) == ''
    assert judge(make(25.0, **pipe)) == ''
    assert judge(make(18.0, c=1e6, noise=0.04), tolerance=0.2) == ''  # it may sag unseen


@pytest.mark.parametrize(('c', 'objection'), [(1e6, UNPROVEN), (1500.0, '')])
def test_the_longer_what_is_straight_the_freer_it_must_be(c, objection):
    # no conductor of 70 m sags as little as the points of a pipe allow
    crown = make_ground((5, -1), (23, 1), 60.0) + np.array([0, 0, 11.7])
    assert judge(make(70.0, c=c, noise=0.05), [crown], tolerance=0.2) == objection


@pytest.mark.parametrize(('c', 'objection'), [(1e6, UNPROVEN), (1500.0, '')])
def test_what_is_straight_is_slender_or_a_pipe(c, objection):
    bar = make(69.0, c=c, per_metre=14.0, noise=0.05)
    bar[:, 1] += np.random.default_rng(1).uniform(-0.18, 0.18, len(bar))
    assert judge(bar, tolerance=0.35) == objection
    assert judge(make(69.0, c=c, per_metre=14.0, noise=0.05), tolerance=0.35) == ''


@pytest.mark.parametrize('axis', [1, 2])
def test_the_points_of_a_wire_do_not_lie_in_a_plane(axis):
    rng = np.random.default_rng(5)
    line = np.column_stack([np.linspace(0.0, 15.0, 170), np.zeros(170), np.full(170, 12.0)])
    line[:, axis] += rng.normal(0.0, 0.06, 170)
    assert is_scan_line(make_curve(line, tolerance=0.25))
    line[:, 3 - axis] += rng.normal(0.0, 0.012, 170)
    assert not is_scan_line(make_curve(line, tolerance=0.25))


def test_a_curve_tighter_than_any_conductor_proves_nothing_by_its_curvature():
    assert judge(make(11.0, c=80.0, per_metre=40.0)) == ''
    assert judge(make(11.0, c=40.0, per_metre=40.0)) == UNPROVEN


def test_over_what_was_not_seen_only_a_long_curve_that_sags_is_believed():
    assert judge(make(60.0, c=1e5), seen=False) == UNPROVEN
    assert judge(make(10.0, c=100.0, per_metre=60.0), seen=False) == CROWDED
    assert judge(make(30.0, c=300.0), seen=False) == ''


def test_over_what_was_not_seen_what_may_sag_must_hang_alone():
    wire = make(40.0, c=2400.0, per_metre=2.0, noise=0.04)
    assert 0.0 < prove_sag(make_curve(wire, np.arange(len(wire))), SETTINGS) < 1.0
    assert judge(wire, seen=False) == ''
    row = make(40.0, c=1e5, per_metre=2.0, seed=1) + np.array([0.0, 1.5, 0.0])
    assert judge(wire, [row], seen=False) == UNPROVEN


def test_what_is_thick_must_be_free_of_what_touches_it():
    bundle = make(300.0, c=1500.0, per_metre=30.0, noise=0.13)
    assert judge(bundle, tolerance=0.5) == ''
    beside = make(300.0, c=1500.0, per_metre=60.0, noise=0.13, seed=3)
    assert judge(bundle, [beside + np.array([0.0, 0.6, 0.0])], tolerance=0.5).startswith('thick')


def test_a_straight_edge_of_a_roof_has_no_proven_curvature():
    edge = make(60.0, c=1e5)
    roof = make_wire((0.0, 0.0, 12.0), (60.0, 0.0, 12.0), c=1e5, per_metre=200.0)
    roof[:, 1] = np.random.default_rng(0).uniform(0.0, 3.0, len(roof))
    assert judge(edge, [roof]) == UNPROVEN


def test_what_is_straight_and_thick_is_no_conductor():
    told = judge(make(60.0, c=1e5, noise=0.14), tolerance=0.5)
    assert told == 'straighter than a conductor'


def test_the_thicker_a_curve_the_more_of_it_must_be_free():
    told = [
        judge(make(30.0, c=1200.0, per_metre=60.0, noise=noise), tolerance=0.5)
        for noise in (0.13, 0.2)
    ]
    assert told == ['', UNPROVEN]


def test_a_thick_curve_whose_curvature_is_too_small_is_no_conductor():
    wire = make(300.0, c=12_000.0, per_metre=30.0, noise=0.14)
    assert judge(wire, tolerance=0.5) == 'straighter than a conductor'
    settings = dataclasses.replace(SETTINGS, max_constant=20_000.0)
    assert judge(wire, settings=settings, tolerance=0.5) == ''


def test_an_arc_is_deeper_than_a_conductor():
    assert judge(make(60.0, c=60.0)) == 'deeper than a conductor'


def test_a_line_on_a_sheet_is_not_free():
    wire = make(80.0)
    sheet = make_wire((0.0, 0.0, 12.0), (80.0, 0.0, 12.0), c=700.0, per_metre=400.0)
    sheet[:, 1] = np.random.default_rng(0).uniform(-2, 2, len(sheet))
    assert judge(wire, [sheet]) == 'not free in the air'


def test_trees_at_a_third_of_the_span_are_no_objection():
    wire = make(80.0)
    crown = make_ground((30, -2), (55, 2), 60.0) + np.array([0, 0, 11.0])
    assert judge(wire, [crown]) == ''


def test_evidence_says_how_near_each_limit_is():
    curve = make_curve(make(80.0), np.arange(640))
    points = make(80.0)
    profile, free = measure(points, curve)
    evidence = {item.setting: item for item in list_evidence(curve, profile, free, SETTINGS)}
    assert all(item.kept for item in evidence.values())
    assert evidence['catenary.min_length'].value == curve.length
    assert evidence['catenary.max_sag_ratio'].limit == pytest.approx(0.08 * curve.length)
    for name, limit in (
        ('min_length', 80.1), ('min_points', 700), ('max_sag_ratio', 0.01),
        ('max_clutter', -1.0), ('min_evidence', 89.0),
    ):
        changed = dataclasses.replace(SETTINGS, **{name: limit})
        fails = [
            item.setting for item in list_evidence(curve, profile, free, changed) if not item.kept
        ]
        setting = f'catenary.{name}'
        assert fails == [setting]
        assert find_objection(curve, profile, free, changed) == evidence[setting].objection


@pytest.mark.parametrize('change', [
    {'tolerance': -1.0}, {'num_trials': 7}, {'min_points': 3}, {'min_coverage': 1.1},
    {'max_sag_ratio': 0.0}, {'max_crowding': -0.1}, {'min_points': 12.0},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        CatenarySettings(**change)
