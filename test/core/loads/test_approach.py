# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Approaches of points to spans against the limits one by one, and the geometry by hand."""

from factories import make_span
import numpy as np
import pytest

from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.loads.approach import Approach, KEPT, MovedSpan, SEVERER
from plc_inspect.core.loads.obstacles import survey_state
from plc_inspect.core.loads.sag_tension import Case, change_state, Conductor
from plc_inspect.results import Severity

CONDUCTOR = Conductor(
    name='test', diameter=0.028, weight=15.0, stiffness=36e6, expansion=19.3e-6,
)
STORM = Case(name='storm', temperature=15.0, wind=35.0)
LIMITS = (
    Limit(feature='vegetation', distance=0.5, where='under',
          tiers=((Severity.CRITICAL, 0.5), (Severity.WARNING, 2.1))),
    Limit(feature='vegetation', distance=0.6, where='beside',
          tiers=((Severity.CRITICAL, 0.6), (Severity.WARNING, 2.1))),
    Limit(feature='vegetation', distance=9.0, measure='horizontal', where='beside',
          tiers=((Severity.NOTICE, 9.5),)),
    Limit(feature='vegetation', distance=2.5, measure='vertical', where='under',
          tiers=((Severity.WARNING, 2.5),)),
)


def approach(horizontal, vertical):
    horizontal, vertical = np.atleast_1d(horizontal, vertical)
    return Approach(values=np.stack([
        np.hypot(horizontal, vertical), horizontal, vertical, np.zeros(len(horizontal)),
    ]))


def test_each_point_is_judged_by_the_limit_that_it_breaks_most():
    rng = np.random.default_rng(0)
    near = approach(rng.uniform(0, 4, 2000), rng.uniform(-4, 4, 2000))
    rank, severity = near.judge(LIMITS)
    for k, (distance, horizontal, vertical, _) in enumerate(near.values.T.tolist()):
        under = vertical > 0 and vertical >= horizontal
        broken = []
        for limit in LIMITS:
            value = {'distance': distance, 'horizontal': horizontal, 'vertical': abs(vertical)}
            found = limit.judge(value[limit.measure])
            if found and limit.where in ('any', 'under' if under else 'beside'):
                broken.append((-int(found), value[limit.measure] / limit.distance))
        worst, share = min(broken, default=(0, KEPT + distance))
        assert severity[k] == -worst
        assert rank[k] == pytest.approx(share + SEVERER * worst)


@pytest.mark.parametrize(('horizontal', 'vertical', 'severity'), [
    (0.0, 0.55, 2),  # under: 0.5 m
    (0.55, 0.0, 3),  # beside: 0.6 m
    (0.55, -0.1, 3),
    (0.0, 0.5, 2),  # a limit is kept at its distance
    (0.0, 0.49, 3),
    (1.5, 1.6, 0),
])
def test_limits_hold_under_the_conductor_or_beside_it(horizontal, vertical, severity):
    assert approach(horizontal, vertical).judge(LIMITS[:2])[1].tolist() == [severity]


@pytest.mark.parametrize(('horizontal', 'vertical', 'severity'), [
    (9.4, -20.0, 1), (9.6, 0.0, 0), (9.4, 20.0, 0),
])
def test_limits_hold_for_the_horizontal_part(horizontal, vertical, severity):
    assert approach(horizontal, vertical).judge(LIMITS[2:3])[1].tolist() == [severity]


def test_distances_are_from_the_nearest_sub_conductor():
    span = make_span(0, 0, (0, 0, 15), (120, 0, 15))
    strands = np.array([[0.0, 0.2, 0.2], [0.0, -0.2, 0.2], [0.0, 0.2, -0.2], [0.0, -0.2, -0.2]])
    moved = MovedSpan(span, [survey_state(span)], strands)
    low = span.heights(np.array([60.0]))[0]
    points = np.array([[60.0, 0.2, low - 3.2], [60.0, 2.2, low + 0.2], [60.0, -0.2, low - 0.2]])
    near = moved.approach(points)[0]
    np.testing.assert_allclose(near.values[:3], [
        [3.0, 2.0, 0.0], [0.0, 2.0, 0.0], [3.0, 0.0, 0.0]
    ], atol=1e-6)
    np.testing.assert_allclose(near.along, 60.0, atol=1e-6)


def test_heights_above_ground_are_those_of_the_nearest_ground():
    span = make_span(0, 0, (0, 0, 15), (120, 0, 15))
    moved = MovedSpan(span, [survey_state(span)], np.zeros((1, 3)))
    ground = np.array([[60.0, 1.0, 2.0], [61.5, 0.0, 3.0]])
    (gaps,) = moved.rise(np.array([0.5, 0.51, 0.9]), ground, 3.0)
    heights = span.heights(np.array([60.0, 61.2]))
    np.testing.assert_allclose(gaps, [heights[0] - 2.0, heights[1] - 3.0, np.inf])
    assert np.isinf(moved.rise(np.array([0.5]), ground[:0], 3.0)[0]).all()
    assert moved.approach(ground[:0])[0].values.shape == (4, 0)


def test_place_along_a_swung_inclined_span_is_horizontal():
    span = make_span(0, 0, (0, 0, 15), (60, 80, 55))
    state = change_state(span.length, 40.0, span.c, 15.0, CONDUCTOR, STORM)
    moved = MovedSpan(span, [state], np.zeros((1, 3)))
    points = moved.frames[0][0].position(np.linspace(0.0, state.length, 5))
    (near,) = moved.approach(points)
    assert near.distance == pytest.approx(np.zeros(5), abs=1e-6)
    assert near.along == pytest.approx(points[:, :2] @ [0.6, 0.8], abs=1e-6)
    assert near.along[-1] == pytest.approx(100.0)
