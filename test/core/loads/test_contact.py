# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Temperatures of contact against the change of state itself."""

import dataclasses

from factories import make_inspection, make_span
import numpy as np
import pytest

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.loads.approach import MovedSpan
from plc_inspect.core.loads.contact import ASIDE, find_contacts, HOTTEST
from plc_inspect.core.loads.obstacles import survey_state
from plc_inspect.core.loads.sag_tension import Case, change_state, Conductor, height_at
from plc_inspect.results import HazardKind, PointClass

CONDUCTOR = Conductor(
    name='test', diameter=0.028, weight=15.0, stiffness=36e6, expansion=19.3e-6,
)
SURVEYED = 15.0
RULES = plain_rules(HazardSettings())


def place(degrees, aside=0.0, origin=(0.0, 0.0, 0.0), at=40.0):
    """Return a span, and a point where its conductor is at a temperature, moved aside."""
    start, end = np.add(origin, [0, 0, 15]), np.add(origin, [120, 0, 19])
    span = make_span(0, 0, start, end, c=700.0)
    state = change_state(span.length, 4.0, span.c, SURVEYED, CONDUCTOR,
                         Case(name='', temperature=degrees))
    z = float(height_at(np.array([at]), state.length, state.rise, state.c)[0])
    return span, np.add(span.start, [at, aside, z])


def contact(span, points, kind=HazardKind.VEGETATION, classes=PointClass.VEGETATION, height=9.0):
    """Return the temperature of contact with the vegetation among some points, one hazard."""
    result = make_inspection().result
    points = np.asarray(points, float).reshape(-1, 3)
    classes = np.broadcast_to(np.uint8(classes), len(points))
    near = MovedSpan(span, [survey_state(span)], np.zeros((1, 3))).approach(points)[0].values
    at = int(np.argmin(np.where(classes == PointClass.VEGETATION, near[0], np.inf)))
    clearance, horizontal, vertical, along = near[:, at]
    hazard = dataclasses.replace(
        result.hazards[0], span_id=0, kind=kind, position=points[at], clearance=clearance,
        extent=np.stack([points.min(axis=0), points.max(axis=0)]), horizontal=horizontal,
        vertical=vertical, along_span=along,
    )
    of_none = np.full(len(points), -1, dtype=np.int32)
    result = dataclasses.replace(
        result, spans=(span,), hazards=(hazard,), ground_height=np.full(len(points), height),
        classification=classes, clearance=np.full(len(points), np.nan), line_id=of_none,
        span_id=of_none,
    )
    before = points.copy()
    found = find_contacts(points, result, CONDUCTOR, SURVEYED, RULES)
    np.testing.assert_array_equal(points, before)
    return found.get(hazard.hazard_id)


@pytest.mark.parametrize('degrees', [20.0, 60.0, 119.0])
@pytest.mark.parametrize('origin', [(0.0, 0.0, 0.0), (250_000.0, 4_100_000.0, 70.0)])
def test_a_point_is_touched_at_the_temperature_that_lowers_the_conductor_to_it(degrees, origin):
    span, point = place(degrees, aside=0.1, origin=origin)
    assert contact(span, point) == pytest.approx(degrees, abs=0.05)


def test_the_highest_point_is_touched_first():
    span, first = place(40.0)
    _, second = place(70.0, at=80.0)
    assert contact(span, [second, first]) == pytest.approx(40.0, abs=0.05)
    assert contact(span, [second, first], HazardKind.STRUCTURE) == pytest.approx(40.0, abs=0.05)


def test_what_is_beside_above_or_too_low_is_never_touched():
    for span, point in (
        place(60.0, aside=ASIDE + 0.05), place(-10.0), place(HOTTEST + 5.0),
        place(60.0, at=-1.0), place(60.0, at=121.0),
    ):
        assert contact(span, point) is None


def test_only_objects_are_touched():
    span, point = place(60.0)
    assert contact(span, point, HazardKind.GROUND) is None
    nearer = place(40.0)[1]
    for kind in (PointClass.WIRE, PointClass.TOWER):
        found = contact(span, [point, nearer], classes=[PointClass.VEGETATION, kind])
        assert found == pytest.approx(60.0, abs=0.05)


def test_what_is_nearer_than_the_hazard_is_not_of_its_object():
    span, point = place(60.0)
    stray = place(40.0)[1]
    found = contact(span, [point, stray], classes=[PointClass.VEGETATION, PointClass.OTHER])
    assert found == pytest.approx(60.0, abs=0.05)


def test_objects_over_unseen_ground_are_touched():
    span, point = place(60.0)
    assert contact(span, point, height=np.nan) == pytest.approx(60.0, abs=0.05)


def test_without_hazards_there_is_no_contact():
    result = dataclasses.replace(make_inspection().result, hazards=())
    assert find_contacts(
        make_inspection().points, result, CONDUCTOR, SURVEYED, RULES
    ) == {}
