# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What was not seen is listed, and only that."""

from dataclasses import replace

import numpy as np
import pytest
from spans import make_span, sample_points

from plc_inspect.config import Settings
from plc_inspect.core.coverage.coverage import (
    look_at_section,
    measure_coverage,
    Part,
    SIDE,
)
from plc_inspect.core.coverage.sections import BEYOND, find_reach, find_sections
from plc_inspect.core.coverage.seen_ground import CELL, LEAST_POINTS, see_ground
from plc_inspect.core.mapping import flown_way
from plc_inspect.core.mapping.flown_way import FlownWay
from plc_inspect.core.pipeline import Pipeline

LENGTH = 100.0


def make_line(azimuth=0.0, turned=False):
    """Return two conductors of one section, 4 m apart, 20 m above the origin."""
    spans = []
    for line_id, y in enumerate((-2.0, 2.0)):
        ends = np.array([(0.0, y), (LENGTH, y)]) @ make_turn(azimuth).T
        start, end = ((*ends[0], 20.0), (*ends[1], 20.0))
        spans.append(make_span(*((end, start) if turned and line_id else (start, end)), line_id))
    return spans


def make_turn(azimuth):
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s], [s, c]])


def make_ground(leave_out=lambda x, y: x > np.inf, azimuth=0.0):
    """Return points of the ground, four a square metre, but for what is hidden."""
    x, y = np.mgrid[-40.0:LENGTH + 40.0:0.5, -40.0:40.0:0.5].reshape(2, -1)
    keep = ~leave_out(x, y)
    xy = np.column_stack([x, y])[keep] @ make_turn(azimuth).T
    return np.column_stack([xy, np.zeros(len(xy))])


def look(spans, ground, wires=None, way=None):
    wires = [sample_points(span) for span in spans] if wires is None else wires
    (section,) = find_sections(spans)
    seen = see_ground(ground, np.zeros(len(ground), dtype=bool))
    return look_at_section(section, wires, seen, way)


@pytest.mark.parametrize('azimuth', [0.0, 0.7, 3.0])
@pytest.mark.parametrize('turned', [False, True])
def test_nothing_is_listed_where_all_was_seen(azimuth, turned):
    sight = look(make_line(azimuth, turned), make_ground(azimuth=azimuth))
    assert sight.is_enough
    assert [row.share for row in sight.conductors] == [1.0, 1.0]
    assert [row.share for row in sight.strips] == [1.0, 1.0, 1.0]
    assert [row.density for row in sight.conductors] == pytest.approx([1.0, 1.0], abs=0.02)


def test_hidden_third_of_a_conductor_is_listed():
    spans = make_line()
    wires = [sample_points(span) for span in spans]
    wires[1] = wires[1][(wires[1][:, 0] < 33.0) | (wires[1][:, 0] > 66.0)]
    (gap,) = look(spans, make_ground(), wires).gaps
    assert (gap.part, gap.line_id, gap.is_beyond) == (Part.CONDUCTOR, 1, False)
    assert (gap.low, gap.high) == (pytest.approx(33.0, abs=1.1), pytest.approx(66.0, abs=1.1))
    np.testing.assert_allclose(gap.places[:, 1], 2.0)
    np.testing.assert_allclose(gap.places[:, 2], spans[1].heights(gap.places[:, 0]))


@pytest.mark.parametrize(('part', 'hidden'), [
    (Part.BELOW, lambda x, y: (np.abs(y) < 6.0) & (x > 40.0) & (x < 60.0)),
    (Part.LEFT, lambda x, y: (y > 2.0) & (x > 40.0) & (x < 60.0)),
    (Part.RIGHT, lambda x, y: (y < -2.0) & (x > 40.0) & (x < 60.0)),
])
@pytest.mark.parametrize('azimuth', [0.0, 2.0])
def test_shadow_on_the_ground_is_listed(part, hidden, azimuth):
    sight = look(make_line(azimuth), make_ground(hidden, azimuth))
    gaps = [gap for gap in sight.gaps if gap.part == part]
    assert len(gaps) == 1
    assert gaps[0].low == pytest.approx(40.0, abs=5.0)
    assert gaps[0].high == pytest.approx(60.0, abs=5.0)
    across = (gaps[0].places[:, :2] @ make_turn(azimuth))[:, 1]
    middle = {Part.BELOW: 0.0, Part.LEFT: 2.0 + SIDE / 2, Part.RIGHT: -2.0 - SIDE / 2}[part]
    np.testing.assert_allclose(across, middle, atol=1e-9)


def test_side_that_was_never_flown_or_seen():
    spans = make_line()
    way = np.array([(t, 2.0 * t, 20.0, 25.0) for t in np.arange(60.0)])
    sight = look(spans, make_ground(lambda x, y: y < -2.0), way=way)
    strips = {row.part: row for row in sight.strips}
    assert (strips[Part.LEFT].is_flown, strips[Part.RIGHT].is_flown) == (True, False)
    assert strips[Part.RIGHT].share == 0.0
    assert {gap.part for gap in sight.gaps} == {Part.RIGHT}
    assert sum(gap.length for gap in sight.gaps) == pytest.approx(LENGTH)
    assert sight.age == pytest.approx(59.0 - 50.0)
    assert sight.distance == pytest.approx(np.hypot(20.0, 5.0), abs=1.6)
    assert 0.0 < sight.angle < 0.5
    assert look(spans, make_ground()).strips[1].is_flown is None


def test_wires_say_nothing_of_the_ground():
    wires = np.column_stack([np.linspace(0.0, 100.0, 500), np.zeros(500), np.full(500, 20.0)])
    seen = see_ground(wires, np.ones(len(wires), dtype=bool))
    assert not seen.is_seen(wires).any()
    assert seen.find_top(wires, 0.0) == pytest.approx(20.0)
    once = see_ground(wires[:1], np.zeros(1, dtype=bool))
    assert LEAST_POINTS > 1
    assert not once.is_seen(wires[:1]).any()
    nothing = see_ground(np.full((2, 3), np.nan), np.zeros(2, dtype=bool))
    assert not nothing.is_seen(wires).any()
    assert np.isneginf(nothing.find_top(wires, 5.0)).all()


@pytest.mark.parametrize('reach', [0.0, 2.5, 7.1, 12.0])
def test_top_of_all_points_near(reach):
    rng = np.random.default_rng(7)
    points = np.column_stack([rng.uniform(-60.0, 60.0, (400, 2)), rng.normal(0.0, 9.0, 400)])
    places = np.vstack([points[:9, :2], rng.uniform(-90.0, 90.0, (300, 2))])
    found = see_ground(points, rng.random(400) < 0.5).find_top(places, reach)
    apart = np.linalg.norm(places[:, None] - points[:, :2], axis=2)
    least, most = (
        np.where(apart <= limit, points[:, 2], -np.inf).max(axis=1)
        for limit in (reach, reach + np.hypot(2.0, 2.0) * CELL)
    )
    assert (least <= found).all()
    assert (found <= most).all()
    assert np.isfinite(least).any()
    assert np.isneginf(most).any()


def test_seen_cells_tell_the_heights_of_all_but_conductors():
    points = np.array([
        [-4.0, 1.0, 0.5], [-4.0, 1.0, 7.0], [-4.0, 1.0, 20.0], [9.0, -1.0, -3.0],
        [9.0, -1.0, -2.0], [30.0, 1.0, 0.0], [60.0, 1.0, 0.0], [60.0, 1.0, 1.0],
    ])
    is_wire = np.array([False, False, True, False, False, False, True, True])
    middles, heights = see_ground(points, is_wire).list_seen()
    assert middles.tolist() == [[-3.75, 1.25], [8.75, -1.25]]
    assert heights.tolist() == [7.0, -2.0]


def test_open_end_goes_on_for_a_while_or_half_way_to_the_one_that_faces_it():
    one = make_span((0.0, 0.0, 20.0), (40.0, 0.0, 20.0), is_open=(False, True))
    other = make_span((70.0, 0.0, 20.0), (110.0, 0.0, 20.0), 0, 1, is_open=(True, False))
    beside = make_span((70.0, 9.0, 20.0), (110.0, 9.0, 20.0), 0, 2, is_open=(True, False))
    assert find_reach(one, [one]) == (0.0, BEYOND)
    assert find_reach(one, [one, other, beside]) == (0.0, pytest.approx(15.0))
    assert find_reach(other, [one, other, beside]) == (pytest.approx(15.0), 0.0)
    assert find_reach(beside, [one, other, beside]) == (BEYOND, 0.0)
    sections = find_sections([one, other])
    assert [section.high for section in sections] == pytest.approx([55.0, 55.0])
    for section, span in zip(sections, (one, other), strict=True):
        ground = make_ground()
        seen = see_ground(ground, np.zeros(len(ground), dtype=bool))
        sight = look_at_section(section, [sample_points(span)], seen, None)
        (gap,) = sight.gaps
        assert gap.is_beyond
        assert gap.length == pytest.approx(15.0)
        assert 40.0 <= gap.places[:, 0].min() < gap.places[:, 0].max() <= 70.0
        assert sight.conductors[0].share == pytest.approx(40.0 / 55.0)


def test_open_end_beside_one_does_not_face_it():
    """It ends there, too: a conductor 2 m aside that was seen 2 m farther does not go on."""
    one, beside = (
        make_span((0.0, y, 20.0), (x, y, 20.0), line, is_open=(False, True))
        for line, (x, y) in enumerate(((98.0, 0.0), (100.0, 2.0)))
    )
    other = make_span((200.0, 0.0, 20.0), (300.0, 0.0, 20.0), 0, 1, is_open=(True, False))
    spans = [one, beside, other]
    assert find_reach(one, spans) == (0.0, pytest.approx(51.0))
    assert find_reach(beside, spans) == (0.0, pytest.approx(50.0))
    assert find_reach(other, spans) == (pytest.approx(50.0), 0.0)
    assert find_reach(one, [one, beside]) == (0.0, BEYOND)


def test_spans_of_one_number_far_apart_are_no_section():
    far = make_span((0.0, 60.0, 20.0), (LENGTH, 60.0, 20.0), 2)
    assert [len(item.spans) for item in find_sections([*make_line(), far])] == [2, 1]
    assert find_sections([]) == []


def test_nothing_found_is_nothing_covered():
    points = make_ground()
    result = Pipeline(Settings()).run(points)
    found = measure_coverage(result, points, see_ground(points, np.zeros(len(points), dtype=bool)))
    assert (found.sections, found.gaps, found.num_poor) == ((), (), 0)


def test_gaps_bear_the_number_of_their_section():
    spans = [*make_line(), replace(make_span((100.0, 0.0, 20.0), (200.0, 0.0, 20.0)), span_id=1)]
    result = replace(
        Pipeline(Settings()).run(np.empty((0, 3))), spans=tuple(spans),
    )
    nothing = see_ground(np.empty((0, 3)), np.empty(0, dtype=bool))
    found = measure_coverage(result, np.empty((0, 3)), nothing)
    assert found.num_poor == 2
    assert {(gap.section, gap.span_id) for gap in found.gaps} == {(0, 0), (1, 1)}


def test_way_is_thinned_and_bounded(monkeypatch):
    monkeypatch.setattr(flown_way, 'MOST_PLACES', 50)
    way = FlownWay()
    assert way.places.shape == (0, 4)
    for number in range(1000):
        way.add(number * 10**9, np.array([0.5 * number, 0.0, 0.0]))
    places = way.places
    assert len(places) <= 50
    np.testing.assert_allclose(places[:, 1], 0.5 * places[:, 0])
    assert np.diff(places[:, 1]).min() >= 2.0
    way.clear()
    assert not len(way.places)
