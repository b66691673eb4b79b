# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the stages saw along spans that were found and spans that were missed."""

import numpy as np
import pytest
from toys import make_line_cloud

from plc_inspect.config import Settings
from plc_inspect.core.explain.span import (
    confirm_stretch,
    explain_stretch,
    follow_span,
    make_course,
    STAGES,
)
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.errors import DataError
from plc_inspect.setting_names import update

ENDS = np.array([[0.0, 3.0, 15.0], [100.0, 3.0, 15.0]])


@pytest.fixture(scope='module')
def points():
    """Make two spans of three conductors."""
    return make_line_cloud(half_width=15.0)[0]


def look(points, settings, course=None):
    """Explain the first span of the outer conductor."""
    trace = Pipeline(settings).trace(points)
    course = course or make_course(ENDS, settings, 1.0)
    return explain_stretch(trace, points, settings, course)


def test_a_span_that_was_found(points):
    settings = Settings()
    trace = Pipeline(settings).trace(points)
    course = follow_span(trace, 0, 0, 1.0)
    stretch = explain_stretch(trace, points, settings, course)
    assert stretch.found
    assert course.length == pytest.approx(100.0, abs=1.0)
    assert set(stretch.counts) == set(STAGES)
    assert min(stretch.counts['wire']) > 20
    assert [view.fate for view in stretch.curves] == ['conductor']
    trials = confirm_stretch(stretch, points, settings)
    assert trials[-1].holds
    proposal = trials[-1].proposal
    again = Pipeline(update(settings, {proposal.setting: proposal.after})).run(points)
    wire = points[again.line_id >= 0]
    assert course.locate(wire)[1].sum() == trials[-1].after < trials[-1].before / 2


@pytest.mark.parametrize(('setting', 'value', 'lost'), [
    ('catenary.min_length', 150.0, 'wire'),
    ('catenary.min_evidence', 250.0, 'wire'),
    ('linearity.threshold', 1.0, 'candidates'),
    ('height.beta', 20.0, 'high'),
])
def test_a_span_that_was_missed_says_where_and_why(points, setting, value, lost):
    settings = update(Settings(), {setting: value})
    stretch = look(points, settings)
    assert not stretch.found
    assert stretch.lost == lost
    trials = confirm_stretch(stretch, points, settings)
    assert trials[-1].holds
    assert trials[-1].proposal.setting == setting
    assert trials[-1].before == 0
    assert trials[-1].after > 400


def test_nothing_where_nothing_hangs(points):
    course = make_course(np.array([[0.0, 12.0, 30.0], [90.0, 12.0, 30.0]]), Settings(), 1.0)
    stretch = look(points, Settings(), course)
    assert stretch.lost == 'points'
    assert (stretch.curves, stretch.examples, stretch.proposals) == ((), (), ())


def test_three_places_give_the_sag(points):
    sag = 100.0**2 / 8 / 800.0
    places = np.array([ENDS[0], [50.0, 3.0, 15.0 - sag], ENDS[1]])
    course = make_course(places, Settings(), 0.5)
    assert course.depth == 0.5
    assert look(points, Settings(), course).found


@pytest.mark.parametrize(('places', 'message'), [
    ([[0, 0, 9], [0.5, 0, 0]], 'a metre apart'),
    ([[0, 0, 9], [20, 0, 9], [10, 0, 9]], 'between'),
])
def test_bad_courses(places, message):
    with pytest.raises(DataError, match=message):
        make_course(np.array(places, float), Settings(), 1.0)


def test_a_span_that_does_not_exist():
    trace = Pipeline().trace(np.zeros((3, 3)))
    with pytest.raises(DataError, match='no span 1 of line 2'):
        follow_span(trace, 2, 1, 1.0)


def test_all_limits_that_a_curve_fails_are_named_together(points):
    settings = update(
        Settings(), {'catenary.min_length': 150.0, 'catenary.min_evidence': 250.0}
    )
    stretch = look(points, settings)
    trials = confirm_stretch(stretch, points, settings)
    assert trials[-1].holds
    assert set(trials[-1].proposal.moves) == {'catenary.min_length', 'catenary.min_evidence'}
    for name, value in trials[-1].proposal.moves.items():
        alone = look(points, update(settings, {name: value}))
        assert not alone.found
