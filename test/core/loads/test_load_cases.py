# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What-if on a run made by formula: known sags, known distances."""

import dataclasses
import json
import math

from factories import make_inspection, make_span
import numpy as np
import pytest

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.loads.blowout import SwungSpan
from plc_inspect.core.loads.load_cases import evaluate_cases, SURVEYED
from plc_inspect.core.loads.sag_tension import Case, change_state, Conductor, State
from plc_inspect.core.loads.sections import group_sections
from plc_inspect.errors import DataError
from plc_inspect.offline.export.files import render_json
from plc_inspect.offline.records.load_case_record import describe_what_if
from plc_inspect.offline.report.findings import list_what_if
from plc_inspect.results import PointClass, Severity

CONDUCTOR = Conductor(
    name='test', diameter=0.028, weight=15.0, stiffness=36e6, expansion=19.3e-6,
)
HOT = Case(name='hot', temperature=80.0)
GALE = Case(name='gale', temperature=15.0, wind=25.0)


def evaluate(inspection, *cases):
    return evaluate_cases(
        inspection.points, inspection.result, CONDUCTOR, 15.0, cases,
        plain_rules(HazardSettings()), 3,
    )


def state_of(swing=0.0, c=600.0, length=120.0, rise=0.0):
    return State(c=c, tension=c * 15.0, load=15.0, swing=swing, length=length, rise=rise)


def test_distances_to_a_vertical_span_against_its_samples():
    span = make_span(0, 0, (0, 0, 15), (120, 30, 19))
    length = span.length
    frame = SwungSpan(span, state_of(length=length, rise=4.0))
    x = np.linspace(0.0, length, 40_001)
    curve = frame.position(x)
    assert curve[0] == pytest.approx(span.start)
    assert curve[-1] == pytest.approx(span.end)
    expected = span.a + span.c * np.cosh((x - span.b) / span.c)
    np.testing.assert_allclose(curve[:, 2], expected, atol=1e-9)
    points = np.random.default_rng(0).uniform((-5, -5, 5), (125, 35, 25), (300, 3))
    distance, _ = frame.measure(points)
    exact = np.array([np.linalg.norm(curve - point, axis=1).min() for point in points])
    np.testing.assert_allclose(distance, exact, atol=2e-3)


@pytest.mark.parametrize(('side', 'sign'), [(1.0, 1.0), (-1.0, -1.0)])
def test_wind_from_one_side_moves_the_span_to_the_other(side, sign):
    span = make_span(0, 0, (0, 0, 15), (120, 0, 15))
    frame = SwungSpan(span, state_of(swing=0.5), side)
    (middle,) = frame.position(np.array([60.0]))
    sag = state_of().sag
    assert middle == pytest.approx([60.0, sign * sag * math.sin(0.5), 15 - sag * math.cos(0.5)])
    points = frame.position(np.linspace(0, 120, 7)) + 0.0
    assert frame.measure(points)[0] == pytest.approx(np.zeros(7), abs=1e-9)


def test_an_inclined_span_keeps_its_ends_in_wind():
    span = make_span(0, 0, (0, 0, 15), (100, 50, 45))
    case = change_state(span.length, 30.0, span.c, 15.0, CONDUCTOR, GALE)
    ends = SwungSpan(span, case).position(np.array([0.0, case.length]))
    assert ends[0] == pytest.approx(span.start)
    assert ends[1] == pytest.approx(span.end)


def test_as_surveyed_is_what_was_surveyed_and_heat_lowers_it():
    inspection = make_inspection()
    spans = [dataclasses.replace(span, ground_clearance=6.0 + span.line_id, ground_along=50.0)
             for span in inspection.result.spans]
    inspection = dataclasses.replace(
        inspection, result=dataclasses.replace(inspection.result, spans=tuple(spans))
    )
    done = evaluate(inspection, HOT)
    assert len(done.spans) == 6
    spans = {(span.line_id, span.span_id): span for span in inspection.result.spans}
    for row in done.spans:
        surveyed, hot = row.outcomes
        span = spans[row.line_id, row.span_id]
        assert surveyed.case == SURVEYED
        assert surveyed.sag == pytest.approx(span.sag, abs=1e-3)
        assert hot.sag > surveyed.sag + 0.3
        assert surveyed.ground.clearance == span.ground_clearance
        assert surveyed.ground.along == pytest.approx(span.ground_along)
        assert hot.ground.clearance < surveyed.ground.clearance - 0.2
    expected = change_state(120.0, 1.0, 600.0, 15.0, CONDUCTOR, HOT)
    assert done.spans[0].outcomes[1].c == pytest.approx(expected.c, rel=2e-3)
    near = inspection.result.hazards[0].clearance
    surveyed, hot = done.hazards[0]
    assert surveyed == pytest.approx(near)
    assert hot < surveyed - 0.1
    first = done.spans[0].outcomes[0].vegetation
    assert first.severity == Severity.CRITICAL
    assert first.clearance == pytest.approx(near)


def test_a_span_that_does_not_tell_its_tension_has_no_figures_of_cases():
    """As surveyed it is as it was; other conductors that hang farther do not stand for it."""
    inspection = make_inspection()
    hazard = inspection.result.hazards[0]
    straight = {(hazard.line_id, hazard.span_id), (2, 1)}
    spans = tuple(
        dataclasses.replace(span, c=1e6, sigma=span.sigma | {'c': 4e8})
        if (span.line_id, span.span_id) in straight else span for span in inspection.result.spans
    )
    inspection = dataclasses.replace(
        inspection, result=dataclasses.replace(inspection.result, spans=spans)
    )
    done = evaluate(inspection, HOT, GALE)
    for row in done.spans:
        surveyed, *cases = row.outcomes
        untold = (row.line_id, row.span_id) in straight
        assert surveyed.sag > 0.0
        assert math.isnan(surveyed.tension) == untold
        for item in cases:
            figures = item.sag, item.c, item.tension
            assert [math.isnan(value) for value in figures] == [untold] * 3
            if untold:
                assert math.isnan(item.vegetation.clearance)
                assert item.vegetation.severity is item.ground.severity is None
    surveyed, *cases = done.hazards[hazard.hazard_id]
    assert surveyed == pytest.approx(hazard.clearance)
    assert all(math.isnan(value) for value in cases)
    record = json.loads(render_json(describe_what_if(done, inspection.units)))
    row = next(row for row in record['spans'] if (row['line_id'], row['span_id']) == (2, 1))
    assert [item['sag'] is None for item in row['outcomes']] == [False, True, True]
    # what is not known in the other cases is not worst as surveyed
    assert set(row['worst'].values()) == {None}
    told = list_what_if(dataclasses.replace(inspection, what_if=done))
    place = record['spans'].index(row)
    assert np.flatnonzero(np.isnan(told['worst_sags'])).tolist() == [
        k for k, item in enumerate(record['spans'])
        if (item['line_id'], item['span_id']) in straight
    ]
    assert told['worst_reaches'][place] == dict.fromkeys(('vegetation', 'building', 'ground'))


def test_ground_that_was_not_seen_has_no_height_in_any_case():
    for row in evaluate(make_inspection(), HOT).spans:
        assert all(math.isnan(outcome.ground.clearance) for outcome in row.outcomes)


def test_heights_above_ground_that_is_no_longer_known_are_as_surveyed_alone():
    inspection = make_inspection()
    spans = tuple(dataclasses.replace(span, ground_clearance=4.0, ground_along=60.0)
                  for span in inspection.result.spans)
    unknown = np.full(len(inspection.points), np.nan, np.float32)
    result = dataclasses.replace(inspection.result, spans=spans, ground_height=unknown)
    for row in evaluate(dataclasses.replace(inspection, result=result), HOT, GALE).spans:
        surveyed, *cases = [item.ground for item in row.outcomes]
        assert surveyed.clearance == 4.0
        assert all(math.isnan(item.clearance) and item.severity is None for item in cases)


def test_a_stray_within_the_box_of_a_tree_is_not_of_it():
    plain = make_inspection()
    hazard, span = plain.result.hazards[0], plain.result.spans[0]
    stray = span.positions(np.array([hazard.along_span])) - [0.0, 0.0, 0.3]
    inspection = add_points(plain, stray, PointClass.OTHER, extent=np.stack(
        [np.minimum(hazard.extent[0], stray[0]), np.maximum(hazard.extent[1], stray[0])]
    ))
    assert evaluate(inspection, HOT, GALE).hazards == evaluate(plain, HOT, GALE).hazards


def test_what_the_pipeline_took_for_parts_of_lines_is_no_vegetation():
    plain = make_inspection()
    x = np.linspace(5.0, 115.0, 60)
    wire = plain.result.spans[4].positions(x) - [0.0, 0.0, 0.9]
    known = add_points(plain, wire, PointClass.OTHER)
    for before, after in zip(
        evaluate(plain, HOT).spans, evaluate(known, HOT).spans, strict=True
    ):
        assert [repr(item) for item in before.outcomes] == [repr(item) for item in after.outcomes]


def add_points(inspection, points, kind, **changes):
    """Return a run with more points near conductors, and its hazard with changes."""
    result, num = inspection.result, len(points)
    more = {
        'classification': kind, 'clearance': 0.5, 'ground_height': 9.0, 'line_id': -1,
        'span_id': -1, 'residual': np.nan, 'decision': 2,
    }
    return dataclasses.replace(
        inspection, points=np.vstack([inspection.points, points]),
        result=dataclasses.replace(
            result, hazards=(dataclasses.replace(result.hazards[0], **changes),),
            **{name: np.append(getattr(result, name), np.full(num, value)).astype(
                getattr(result, name).dtype) for name, value in more.items()},
        ),
    )


def test_wind_is_tried_from_both_sides():
    inspection = make_inspection()
    still, gale = evaluate(inspection, GALE).spans[2].outcomes
    assert gale.swing > 0.3
    assert gale.tension > still.tension
    assert abs(gale.vegetation.clearance - still.vegetation.clearance) > 0.05


def test_sections_share_tension_only_where_they_pull_straight():
    spans = [
        make_span(0, 0, (0, 0, 15), (100, 0, 15), open_end=False),
        make_span(0, 1, (100, 0, 15), (300, 2, 15), open_end=False),
        make_span(0, 2, (300, 2, 15), (400, 40, 15), open_end=False),
        make_span(1, 0, (0, 5, 15), (100, 5, 15), open_end=False),
        make_span(1, 1, (100, 5, 15), (200, 5, 15), c=900.0, open_end=False),
    ]
    assert group_sections(spans) == [[0, 1], [2], [3], [4]]
    assert group_sections([]) == []
    opened = [dataclasses.replace(spans[0], open_end=True), spans[1]]
    assert group_sections(opened) == [[0], [1]]


def test_a_section_takes_the_ruling_span():
    inspection = make_inspection()
    ends = [dataclasses.replace(span, open_end=False) for span in inspection.result.spans]
    far = ends[0].end + np.array([60.0, 0.0, 0.0])
    ends[1] = make_span(0, 1, ends[0].end, far, open_end=False)
    result = dataclasses.replace(inspection.result, spans=tuple(ends[:2]))
    done = evaluate(dataclasses.replace(inspection, result=result), HOT)
    ruling = math.sqrt((120**3 + 60**3) / 180)
    assert [row.ruling_span for row in done.spans] == pytest.approx([ruling, ruling])
    tensions = [row.outcomes[1].tension / row.outcomes[0].tension for row in done.spans]
    assert tensions[0] == pytest.approx(tensions[1], rel=1e-9)


def test_no_spans_and_bad_cases():
    inspection = make_inspection()
    empty = dataclasses.replace(inspection.result, spans=(), hazards=())
    done = evaluate(dataclasses.replace(inspection, result=empty), HOT)
    assert done.spans == ()
    with pytest.raises(DataError, match='names of cases must differ'):
        evaluate(inspection, HOT, HOT)
    points = inspection.points.copy()
    evaluate(inspection, HOT)
    assert (points == inspection.points).all()
