# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Two surveys of one line: what moved, what grew, what came and went."""

import dataclasses

from factories import make_inspection, make_span
import numpy as np
import pytest

from plc_inspect.core.tracking.comparison import compare_surveys, match_spans
from plc_inspect.errors import DataError


def make_rack(c=600.0, first_line=0, shift=0.0):
    """Make four conductors 0.4 m above each other over two spans."""
    return [
        make_span(first_line + i, k, (100 * k, shift, 10 + 0.4 * i),
                  (100 * (k + 1), shift, 10 + 0.4 * i), c=c, open_end=False)
        for i in range(4) for k in range(2)
    ]


def compare(before, after, first=(), second=()):
    return compare_surveys(before, after, first, second, sag_deviation=0.25)


def test_the_same_survey_has_no_changes():
    spans = make_rack()
    done = compare(spans, spans)
    assert len(done.spans) == 8
    assert all(item.before is item.after for item in done.spans)
    assert all(item.height.difference == 0 and not item.is_abnormal for item in done.spans)
    assert (done.lost, done.added, done.new, done.cleared) == ((), (), (), ())


def test_conductors_close_to_each_other_are_told_apart_whatever_their_numbers():
    before = make_rack()
    after = [dataclasses.replace(span, line_id=90 - span.line_id, span_id=7 - span.span_id)
             for span in make_rack(c=580.0)][::-1]
    pairs = match_spans(before, after)
    assert sorted((before[i].start[2], before[i].start[0]) for i, _ in pairs) == sorted(
        (after[j].start[2], after[j].start[0]) for _, j in pairs
    )
    assert all(before[i].line_id == 90 - after[j].line_id for i, j in pairs)


def test_a_span_surveyed_the_other_way_round_is_the_same():
    span = make_span(0, 0, (0, 0, 15), (120, 0, 18))
    back = make_span(0, 0, (120, 0, 18), (0, 0, 15))
    (item,) = compare([span], [back]).spans
    assert item.height.difference == pytest.approx(0.0, abs=1e-9)
    assert item.common == pytest.approx(120.0)


def test_sag_and_height_with_their_uncertainty():
    before = make_span(0, 0, (0, 0, 15), (100, 0, 15), c=600.0, open_end=False)
    after = make_span(0, 0, (0, 0, 15), (100, 0, 15), c=450.0, open_end=False)
    (item,) = compare([before], [after]).spans
    assert item.sag.difference == pytest.approx(after.sag - before.sag)
    assert item.sag.sigma == pytest.approx(0.012 * 2**0.5)
    assert abs(item.sag.difference) > 2 * item.sag.sigma
    assert item.is_abnormal
    assert item.height.difference == pytest.approx(-(after.sag - before.sag) * 2 / 3, rel=0.06)
    slight = make_span(0, 0, (0, 0, 15), (100, 0, 15), c=590.0, open_end=False)
    (item,) = compare([before], [slight]).spans
    assert not item.is_abnormal


def test_open_spans_have_no_sag_to_compare():
    before = make_span(0, 1, (0, 0, 15), (100, 0, 15), c=600.0)
    after = make_span(0, 1, (0, 0, 15), (80, 0, 14.5), c=600.0)
    (item,) = compare([before], [after]).spans
    assert np.isnan(item.sag.difference)
    assert not item.is_abnormal
    assert item.common == pytest.approx(80.0)


def test_lost_and_added_spans():
    spans = make_rack()
    done = compare(spans[:6], spans[2:])
    assert [span.line_id for span in done.lost] == [0, 0]
    assert [span.line_id for span in done.added] == [3, 3]


def test_hazards_stay_come_and_go():
    inspection = make_inspection()
    spans, (hazard,) = inspection.result.spans, inspection.result.hazards
    grown = dataclasses.replace(hazard, position=hazard.position + 0.5, clearance=0.4)
    other = dataclasses.replace(hazard, extent=hazard.extent + 50.0, position=hazard.position + 50)
    done = compare(spans, spans, [hazard], [grown, other])
    assert done.kept == ((hazard, grown),)
    assert done.new == (other,)
    assert compare(spans, spans, [hazard], []).cleared == (hazard,)
    assert compare(spans, spans[1:], [hazard], []).unseen == (hazard,)


@pytest.mark.parametrize('is_turned', [False, True])
def test_a_hazard_is_cleared_only_where_the_second_survey_saw_the_conductor(is_turned):
    """The second survey ends in the middle of the span, or has a pole more there."""
    inspection = make_inspection()
    spans, (hazard,) = inspection.result.spans, inspection.result.hazards
    first = spans[0]
    middle = first.positions(np.array([first.length / 2]))[0]
    parts = [make_span(0, 0, first.start, middle, first.c, open_end=True),
             make_span(0, 5, middle, first.end, first.c)]
    if is_turned:
        parts[0] = make_span(0, 0, middle, first.start, first.c, open_start=True)
    near, far = (
        dataclasses.replace(hazard, hazard_id=number, along_span=share * first.length)
        for number, share in enumerate((0.4, 0.6))
    )
    done = compare(spans, [parts[0], *spans[1:]], [near, far], [])
    assert (done.cleared, done.unseen) == ((near,), (far,))
    done = compare(spans, [*parts, *spans[1:]], [near, far], [])
    assert (done.cleared, done.unseen) == ((near, far), ())


def test_surveys_that_do_not_overlap():
    with pytest.raises(DataError, match='do not overlap: none of 8 spans before is one of 8'):
        compare(make_rack(), make_rack(shift=30.0))
    with pytest.raises(DataError, match='do not overlap'):
        compare([], make_rack())


def test_a_long_survey_is_matched_as_its_parts_are():
    rng = np.random.default_rng(4)
    racks = [
        [dataclasses.replace(span, line_id=4 * number + span.line_id) for span in make_rack()]
        for number in range(150)
    ]
    before = [
        dataclasses.replace(
            span, start=span.start + move, end=span.end + move, lowest=span.lowest + move,
        )
        for number, own in enumerate(racks) for span in own
        for move in [np.array([300.0 * (number % 12), 40.0 * (number // 12), 0.0])]
    ]
    after = [
        dataclasses.replace(span, start=span.start + aside, end=span.end + aside)
        for span in before for aside in [np.array([0.0, 0.1, 0.0])]
    ]
    order = rng.permutation(len(after))
    pairs = match_spans(before, [after[k] for k in order])
    assert len(pairs) == len(before) == 1200
    assert all(order[j] == i for i, j in pairs)
    part = match_spans(before[:80], after[:80])
    assert part == [(k, k) for k in range(80)]
