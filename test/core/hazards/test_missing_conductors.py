# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors that are missing over one span are told of, those that were not seen well are not."""

import numpy as np
import pytest
from toys import make_line_cloud, turn

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
