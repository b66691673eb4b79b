# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How sure hazards are, and that those in doubt say so."""

import dataclasses

from factories import find_nearby, make_model, make_span_result
import numpy as np
import pytest
from toys import make_tree, make_wire

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.blur import measure_reach
from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.hazards.confidence import (
    AT_END,
    cap_severity,
    find_doubts,
    IN_DOUBT,
    judge_confidence,
    list_doubts,
    NOT_SHARP,
)
from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.results import HazardKind, Severity

START, END = (0.0, 0.0, 15.0), (100.0, 0.0, 15.0)
LIMIT = Limit(feature='vegetation', distance=4.0,
              tiers=((Severity.CRITICAL, 2.0), (Severity.WARNING, 4.0)))


def fit_model(**changes):
    """Return a span with the curve of points that scatter."""
    points = make_wire(START, END, 800.0, noise=0.02, per_metre=20.0)
    return make_model(START, END, points=points, **changes)


def judge(model, x, clearance, severity=Severity.CRITICAL, sigma=0.1, **changes):
    values = {
        'kind': HazardKind.VEGETATION, 'severity': severity, 'clearance': clearance,
        'horizontal': clearance, 'vertical': 0.0, 'sigma': sigma,
    } | changes
    doubts = list_doubts(model, x, LIMIT, values)
    found = judge_confidence(LIMIT, values | {'note': '; '.join(doubts)})
    return found.severity, [doubt.removeprefix(IN_DOUBT) for doubt in doubts]


@pytest.mark.parametrize(('clearance', 'confidence'), [
    (0.5, 1.0), (1.9, 0.841), (1.8, 0.977), (2.0, 0.5),
])
def test_confidence_is_the_chance_that_the_limit_is_broken(clearance, confidence):
    model = fit_model()
    middle = (model.start_x + model.end_x) / 2
    found, doubts = judge(model, middle, clearance)
    assert found == pytest.approx(confidence, abs=0.001)
    assert doubts == []
    warning, _ = judge(model, middle, clearance, Severity.WARNING)
    assert warning == pytest.approx(1.0)
    sag, _ = judge(model, middle, 4.1, Severity.WARNING, kind=HazardKind.SAG)
    assert sag == pytest.approx(0.841, abs=0.001)


def test_doubts_halve_it():
    model = fit_model(open_start=True)
    assert judge(model, model.start_x + 3.0, 0.5) == (pytest.approx(0.5), [AT_END])
    assert judge(model, model.start_x + 8.0, 0.5)[1] == []
    assert judge(model, model.end_x - 3.0, 0.5)[1] == []
    blurred = dataclasses.replace(model, scatter=model.curve.fit.rmse / 3.0)
    found = judge(blurred, model.start_x + 3.0, 0.05, sigma=0.01)
    assert found == (pytest.approx(0.25), [AT_END, NOT_SHARP])


@pytest.mark.parametrize(('clearance', 'doubted'), [
    (0.05, True), (0.11, False), (0.5, False), (1.89, False), (1.95, True), (2.05, True),
])
def test_blur_is_a_doubt_where_it_reaches_the_object_or_the_limit(clearance, doubted):
    model = fit_model()
    blurred = dataclasses.replace(model, scatter=model.curve.fit.rmse / 3.0)
    assert measure_reach(blurred) == pytest.approx(0.1, abs=0.005)
    middle = (model.start_x + model.end_x) / 2
    assert judge(blurred, middle, clearance)[1] == ([NOT_SHARP] if doubted else [])
    assert judge(model, middle, clearance)[1] == []


def test_what_lies_below_an_open_end_is_of_no_support():
    model = fit_model(open_start=True)
    values = {'clearance': 1.0, 'horizontal': 1.0, 'vertical': 0.0, 'severity': Severity.CRITICAL}
    found = [kind for kind in HazardKind
             if list_doubts(model, model.start_x, LIMIT, values | {'kind': kind})]
    assert found == [kind for kind in HazardKind
                     if kind not in (HazardKind.GROUND, HazardKind.SAG, HazardKind.MISSING)]


def test_blur_is_no_doubt_that_a_conductor_is_missing():
    model = fit_model()
    blurred = dataclasses.replace(model, scatter=model.curve.fit.rmse / 3.0)
    values = {'clearance': 0.0, 'horizontal': 0.0, 'vertical': 0.0, 'severity': Severity.WARNING}
    middle = (model.start_x + model.end_x) / 2
    found = [bool(list_doubts(blurred, middle, LIMIT, values | {'kind': kind}))
             for kind in (HazardKind.VEGETATION, HazardKind.MISSING)]
    assert found == [True, False]


@pytest.mark.parametrize('severity', Severity)
def test_what_is_in_doubt_is_at_most_a_warning(severity):
    assert cap_severity(severity, 'measured horizontally') == severity
    note = f'measured horizontally; {IN_DOUBT}{NOT_SHARP}'
    assert cap_severity(severity, note) == min(severity, Severity.WARNING)


def test_hazards_say_how_sure_they_are_and_the_unsure_are_not_raised():
    model = fit_model(open_start=True)
    trees = np.vstack([make_tree(x, 0.0, 13.0, bottom=2.0) for x in (3.5, 50.0)])
    near, spans = find_nearby(trees, [model], 20.0), make_span_result([model], len(trees))
    args = trees, trees[:, 2].astype(np.float32), near, spans
    first, second = find_hazards(*args, HazardSettings()).hazards
    assert first.confidence == pytest.approx(0.5, abs=0.01)
    assert first.note == f'in doubt: {AT_END}'
    assert (first.severity, second.severity) == (Severity.WARNING, Severity.CRITICAL)
    assert second.confidence == pytest.approx(1.0)
    assert 'doubt' not in second.note
    (only,) = find_hazards(*args, HazardSettings(min_confidence=0.6)).hazards
    assert only.along_span == second.along_span


@pytest.mark.parametrize('least', [0.2, 0.6, 0.95])
def test_what_breaks_the_warning_for_certain_is_raised_however_near_the_critical_it_is(least):
    model = fit_model()
    for top in np.arange(10.6, 11.8, 0.05):  # clearances about the critical 2 m
        tree = make_tree(50.0, 0.0, top, bottom=2.0)
        near, spans = find_nearby(tree, [model], 20.0), make_span_result([model], len(tree))
        settings = HazardSettings(min_confidence=least)
        found = find_hazards(tree, tree[:, 2].astype(np.float32), near, spans, settings).hazards
        assert len(found) == 1
        assert found[0].clearance < 3.5


def test_doubts_are_told_from_the_note_of_a_rule():
    rule = 'ask the owner when in doubt'
    assert find_doubts(rule) == ''
    note = '; '.join([rule, IN_DOUBT + AT_END, IN_DOUBT + NOT_SHARP])
    assert find_doubts(note) == f'{IN_DOUBT}{AT_END}; {IN_DOUBT}{NOT_SHARP}'
