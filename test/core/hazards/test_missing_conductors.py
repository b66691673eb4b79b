# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors that are missing over one span are told of, those that were not seen well are not."""

from factories import make_model
import numpy as np
import pytest
from toys import make_line_cloud, make_wire, turn

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.hazards.missing_conductors import find_missing_conductors
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import HazardKind, Severity

SPANS = 90.0, 100.0, 95.0


def find_missing(points):
    return [item for item in Pipeline().run(points).hazards if item.kind == HazardKind.MISSING]


def make_cloud(aside, **options):
    """Make a line, and tell the points of its middle conductor in the second span."""
    options = {'spans': SPANS, 'half_width': 15.0, 'offsets': (-aside, 0.0, aside)} | options
    points, label = make_line_cloud(**options)
    own = (label == 14) & (np.abs(points[:, 1]) < 0.1) & (np.abs(points[:, 0] - 140.0) < 50.0)
    return points, own


@pytest.mark.parametrize('aside', [0.45, 3.0, 9.0])
@pytest.mark.parametrize('degrees', [0.0, 200.0])
def test_a_conductor_that_is_down_is_missing(aside, degrees):
    points, own = make_cloud(aside)
    down = points[own] * (1.0, 1.0, 0.0)  # lies on the ground
    cloud = np.vstack([points[~own], down])
    (hazard,) = find_missing(turn(cloud, np.radians(degrees), (500.0, -200.0, 30.0)))
    assert hazard.severity == Severity.WARNING
    assert hazard.required == pytest.approx(100.0, abs=1.0)
    assert hazard.clearance <= 2.0
    assert hazard.confidence == pytest.approx(1.0)
    middle = turn(np.array([[140.0, 0.0, 13.4]]), np.radians(degrees), (500.0, -200.0, 30.0))[0]
    assert np.linalg.norm(hazard.position - middle) < 1.5
    assert 'may be down' in hazard.note


@pytest.mark.parametrize('aside', [0.45, 3.0])
def test_a_line_that_is_whole_misses_none(aside):
    assert not find_missing(make_cloud(aside)[0])


@pytest.mark.parametrize('share', [0.08, 0.3])
def test_one_of_which_a_little_was_seen_is_not_missing(share):
    points, own = make_cloud(3.0)
    kept = ~own | (np.random.default_rng(2).random(len(points)) < share)
    assert not find_missing(points[kept])


def test_beside_wires_that_were_hardly_seen_none_is_missing():
    points, own = make_cloud(3.0, per_metre=0.9)
    assert not find_missing(points[~own])


def test_a_conductor_that_ends_is_not_missing():
    points, own = make_cloud(3.0)
    beyond = (np.abs(points[:, 1]) < 0.1) & (points[:, 2] > 10.0) & (points[:, 0] > 91.0)
    assert not find_missing(points[~(own | beyond)])


def test_a_crown_hides_a_conductor():
    points, own = make_cloud(3.0)
    rng = np.random.default_rng(3)
    crown = rng.uniform((110.0, -1.5, 11.0), (170.0, 1.5, 15.0), (6000, 3))
    assert not find_missing(np.vstack([points[~own], crown]))


def test_a_conductor_that_drift_doubled_is_not_missing():
    points, own = make_cloud(3.0)
    double = points[(np.abs(points[:, 1]) < 0.1) & (points[:, 2] > 12.0) & ~own]
    assert not find_missing(np.vstack([points, double + np.array([0.0, 0.3, 0.0])]))


def test_a_layer_that_is_absent_ends_there():
    """Three wires below end before the second span, and others begin after it."""
    points, _ = make_line_cloud(spans=SPANS, half_width=15.0)
    below, others = make_line_cloud(
        spans=SPANS, offsets=(-1.0, 0.0, 1.0), half_width=15.0, height=10.0, seed=1
    )
    wires = below[(others == 14) & (np.abs(below[:, 0] - 140.0) > 50.0)]
    assert not find_missing(np.vstack([points, wires]))


def hang_spans(*places):
    """Return models of spans of 100 m, for each number and place aside at start and end."""
    return [
        make_model(
            (100.0 * span_id, first, 15.0), (100.0 * span_id + 100.0, last, 15.0), number,
            span_id, num_points=1000, coverage=1.0, open_end=False,
        ) for number, (span_id, first, last) in enumerate(places)
    ]


def search(points, models):
    return find_missing_conductors(points, models, (), plain_rules(HazardSettings()))


WHOLE = tuple((span_id, left, left) for span_id in range(3) for left in (-0.6, 0.6))
"""Two conductors over three spans."""
OUTER = (0, 0.0, 0.0), (2, 0.0, 0.0)
"""One between them, over the first and the last."""


@pytest.mark.parametrize(('deeper', 'is_missing'), [
    (-0.4, False), (-0.25, False), (0.0, False), (0.25, False), (0.9, False), (1.1, True),
])
def test_one_without_a_curve_that_sags_otherwise_is_seen(deeper, is_missing):
    points = make_wire((100.0, 0.0, 15.0), (200.0, 0.0, 15.0))
    points[:, 2] -= np.where(np.abs(points[:, 0] - 150.0) < 48.0, deeper, 0.0)
    assert len(search(points, hang_spans(*WHOLE, *OUTER))) == is_missing


def test_what_hangs_otherwise_over_one_span_is_not_missing():
    nothing = np.zeros((0, 3))
    assert len(search(nothing, hang_spans(*WHOLE, *OUTER))) == 1
    outer = [place for place in (*WHOLE, *OUTER) if place[0] != 1]
    wider = [(1, left, left) for left in (-1.5, -0.5, 0.5, 1.5)]
    assert not search(nothing, hang_spans(*outer, *wider))


def test_nothing_hangs_where_nothing_is():
    assert not search(np.zeros((0, 3)), [])
    assert not search(np.zeros((0, 3)), hang_spans(*OUTER))
