# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Numbers of lines and spans that last, over ticks that number everything anew."""

import dataclasses
import itertools

import numpy as np
import pytest
from spans import make_result, make_span

from plc_inspect.core.tracking.continuation import continue_lines, find_ends
from plc_inspect.core.tracking.span_matching import (
    match_spans,
    may_overlap,
    measure_overlap,
    TOLERANCE,
)
from plc_inspect.core.tracking.span_registry import (
    CONFIRMATIONS,
    MAX_MISSES,
    MAX_WAIT,
    SpanRegistry,
)
from plc_inspect.core.tracking.wire_points import thin_points

LEFT, RIGHT = 1.0, -1.0


def at(x, y=LEFT, z=10.0):
    return (float(x), float(y), float(z))


def tick(registry, *spans, expected=None, **options):
    """Put in the spans of one tick; all known spans were in its window unless said."""
    result, points = make_result(spans)
    if expected is None:
        expected = [item.key for item in registry.spans]
    return registry.update(result, points, expected, **options)


def known(registry):
    """Return (line_id, span_id) to rounded (start x, end x) of the confirmed spans."""
    return {
        item.key: (round(float(item.span.start[0])), round(float(item.span.end[0])))
        for item in registry.spans if item.confirmed
    }


def test_toy_overlaps_by_hand():
    whole = make_span(at(0), at(100))
    piece = make_span(at(60), at(160))
    low, high, gap = measure_overlap(piece, whole)
    assert (low, high) == (60.0, 100.0)
    assert gap < 1.5
    backward = make_span(at(100), at(0))
    low, high, gap = measure_overlap(backward, whole)
    assert (low, high) == (0.0, 100.0)
    assert gap == pytest.approx(0.0, abs=1e-9)
    assert measure_overlap(make_span(at(0), at(50, 40)), whole) is None  # another direction
    assert measure_overlap(make_span(at(101), at(200)), whole) is None  # not beside it
    aside = make_span(at(0, LEFT + 0.3), at(100, LEFT + 0.3))
    assert measure_overlap(aside, whole)[2] == pytest.approx(0.3)


def test_a_tick_counts_for_the_views_that_it_gives():
    registry = SpanRegistry()
    tick(registry, make_span(at(0), at(50)), make_span(at(0, 30), at(50, 30), 1),
         views=[1, CONFIRMATIONS])
    assert len(known(registry)) == 1
    tick(registry, make_span(at(0), at(50)), make_span(at(0, 30), at(50, 30), 1))
    assert len(known(registry)) == 2


def test_neighbours_are_not_confused():
    ys = [0.0, 0.4, 0.8, 1.2]
    before = [make_span(at(0, y), at(50, y), i) for i, y in enumerate(ys)]
    after = [make_span(at(0, y + 0.15), at(55, y + 0.15), i) for i, y in enumerate(ys)]
    pairs = match_spans(after, before)
    assert sorted((p.first, p.second) for p in pairs) == [(i, i) for i in range(4)]
    assert match_spans([], before) == match_spans(before, []) == []
    far = [make_span(at(0, y + TOLERANCE + 2), at(50, y + TOLERANCE + 2)) for y in ys]
    assert match_spans(far, before) == []


def test_what_overlaps_is_never_ruled_out():
    rng = np.random.default_rng(0)
    spans = [
        make_span(start=(*start, 10.0), end=(*(start + run), 10.0))
        for start, run in zip(rng.uniform(0, 300, (60, 2)), rng.uniform(-90, 90, (60, 2)),
                              strict=True)
    ]
    others = spans[:3]
    may = may_overlap(spans, others)
    assert {pair.first for pair in match_spans(spans, others)} <= set(np.flatnonzero(may))
    assert may[:3].all()
    assert not may.all()
    assert not may_overlap(spans, []).any()
    assert may_overlap([], others).shape == (0,)


def test_one_span_on_two_and_two_on_one():
    whole = make_span(at(0), at(100), c=5e4)
    halves = [make_span(at(0), at(45), c=5e4), make_span(at(55), at(100), c=5e4)]
    assert sorted((p.first, p.second) for p in match_spans([whole], halves)) == [(0, 0), (0, 1)]
    assert sorted((p.first, p.second) for p in match_spans(halves, [whole])) == [(0, 0), (1, 0)]


def test_nothing_and_first_sight():
    registry = SpanRegistry()
    assert tick(registry) == {}
    assert registry.spans == ()
    tick(registry, make_span(at(0), at(50)))
    assert known(registry) == {}
    assert len(registry.spans) == 1
    assert registry.spans[0].key < (-1, -1)
    numbered = tick(registry, make_span(at(0), at(60), 5, 7))
    assert known(registry) == {(0, 0): (0, 60)}
    assert numbered == {(5, 7): (0, 0)}
    assert len(registry.spans[0].points) == 60


def test_input_is_not_changed():
    registry = SpanRegistry()
    result, points = make_result([make_span(at(0), at(50), 3, 4)])
    copy = points.copy()
    for _ in range(3):
        registry.update(result, points, [item.key for item in registry.spans])
    np.testing.assert_array_equal(points, copy)
    assert (result.spans[0].line_id, result.spans[0].span_id) == (3, 4)
    assert set(result.line_id) == {3}


def test_numbers_last_whatever_the_ticks_call_them():
    registry = SpanRegistry()
    for number in range(6):
        end = 40 + 10 * number
        swap = number % 2
        tick(
            registry,
            make_span(at(0, LEFT), at(end, LEFT), swap, number),
            make_span(at(end, RIGHT), at(0, RIGHT), 1 - swap, number),
        )
    assert known(registry) == {(0, 0): (0, 90), (1, 0): (90, 0)}
    ys = {item.span.line_id: item.span.start[1] for item in registry.spans}
    assert sorted(ys.values()) == [RIGHT, LEFT]


def find_side(place, corners):
    """Return +1 or -1, the side of the route that a place lies on, 1 m from it."""
    for start, end in itertools.pairwise(corners):
        along = (end - start) / np.linalg.norm(end - start)
        apart = place - start
        across = along[0] * apart[1] - along[1] * apart[0]
        if 0 < apart @ along < 60 and abs(abs(across) - 1.0) < 0.1:
            return round(across)
    raise AssertionError(place)


def test_lines_keep_their_numbers_round_a_corner():
    """Five spans with a turn, each seen growing; two conductors."""
    registry = SpanRegistry()
    corners = [np.array([0.0, 0.0])]
    for heading in np.radians([0.0, 0.0, 25.0, 25.0, -10.0]):
        corners.append(corners[-1] + 60.0 * np.array([np.cos(heading), np.sin(heading)]))
    seen = {}
    for number in range(5):
        for share in (0.3, 0.6, 1.0):
            spans = []
            for line, side in ((1, 1.0), (0, -1.0)):
                for span in range(max(0, number - 1), number + 1):
                    start, end = corners[span], corners[span + 1]
                    along = (end - start) / 60.0
                    normal = side * np.array([-along[1], along[0]])
                    to = start + (end - start) * (share if span == number else 1.0)
                    spans.append(make_span(
                        (*(start + normal), 10.0), (*(to + normal), 10.0), line, span, c=5e4,
                    ))
            tick(registry, *spans, expected=[
                i.key for i in registry.spans
                if i.span.span_id < 0 or i.span.span_id >= number - 1
            ])
            for item in registry.spans:
                if item.confirmed:
                    middle = (item.span.start + item.span.end)[:2] / 2
                    seen.setdefault(item.span.line_id, set()).add(find_side(middle, corners))
    assert sorted(map(sorted, seen.values())) == [[-1], [1]]
    assert {item.span.line_id for item in registry.spans} == {0, 1}
    assert sorted(known(registry)) == [(line, span) for line in (0, 1) for span in range(5)]
    assert registry.num_merges == 0


def test_a_gap_that_closes_leaves_the_older_number():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(40), 0, 0, c=5e4))
    for _ in range(MAX_WAIT + 1):
        tick(registry, make_span(at(0), at(40), 0, 0, c=5e4),
             make_span(at(60), at(100), 1, 1, c=5e4))
    assert sorted(known(registry)) == [(0, 0), (1, 1)]
    for _ in range(CONFIRMATIONS):
        tick(registry, make_span(at(0), at(100), 0, 0, c=5e4))
    assert known(registry) == {(0, 0): (0, 100)}
    assert registry.num_merges == 1


def test_two_lines_side_by_side_never_become_one():
    """A result that mixes them up once must not unite them."""
    registry = SpanRegistry()
    good = [make_span(at(0, y), at(60, y), i, 0) for i, y in enumerate((LEFT, RIGHT))]
    for _ in range(3):
        tick(registry, *good)
    wrong = [dataclasses.replace(good[0], line_id=7), dataclasses.replace(good[1], line_id=7,
                                                                         span_id=1)]
    for _ in range(4):
        tick(registry, *wrong)
    assert sorted(item.span.line_id for item in registry.spans) == [0, 1]
    assert registry.num_merges == 0


def test_a_span_that_is_less_is_not_believed_at_once():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(100), c=5e4))
    for number in range(1, MAX_MISSES):
        tick(registry, make_span(at(0), at(50), c=5e4))
        assert known(registry) == {(0, 0): (0, 100)}, number
    tick(registry, make_span(at(0), at(50), c=5e4))
    assert known(registry) == {(0, 0): (0, 50)}


def test_a_span_that_is_gone_is_dropped_in_the_end():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(100)))
    for _ in range(10):
        tick(registry, expected=[])  # elsewhere
    assert known(registry) == {(0, 0): (0, 100)}
    for _ in range(MAX_MISSES - 1):
        tick(registry)
    assert known(registry)
    tick(registry)
    assert registry.spans == ()


def test_finished_spans_stay():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(100), c=5e4))
    num_points = len(registry.spans[0].points)
    registry.finish([(0, 0)])
    assert registry.spans[0].finished
    assert 0 < len(registry.spans[0].points) <= num_points
    for _ in range(10):
        tick(registry)
        tick(registry, make_span(at(0), at(30), c=5e4))
    assert known(registry) == {(0, 0): (0, 100)}
    tick(registry, make_span(at(0), at(110), c=5e4))
    assert known(registry) == {(0, 0): (0, 110)}


def test_doubtful_spans_left_behind_are_dropped():
    registry = SpanRegistry()
    tick(registry, make_span(at(0), at(100)))
    registry.finish([item.key for item in registry.spans])
    assert registry.spans == ()


def test_spans_at_the_edge_of_the_window_are_left_alone():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(100), c=5e4))
    for _ in range(5):
        tick(registry, make_span(at(70), at(100), 4, 4, c=5e4), expected=[])
    assert known(registry) == {(0, 0): (0, 100)}
    assert registry.spans[0].misses == 0


def test_a_support_that_is_found_splits_a_span():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, *(make_span(at(0, y), at(120, y), i, 0, c=5e4)
                         for i, y in enumerate((LEFT, RIGHT))))
    for _ in range(3):
        tick(registry, *(
            make_span(at(x, y), at(x + 60, y), i, s, c=5e4)
            for i, y in enumerate((LEFT, RIGHT)) for s, x in enumerate((0, 60))
        ))
    places = known(registry)
    assert {key[0] for key in places} == {0, 1}
    groups = {}
    for (_, span), place in places.items():
        groups.setdefault(span, set()).add(place)
    assert sorted(map(sorted, groups.values())) == [[(0, 60)], [(60, 120)]]
    assert 0 in groups


def test_a_piece_ahead_continues_the_line_without_a_joint():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(60)))
    for number in range(2, 5):
        tick(registry, make_span(at(0), at(60), 0, 0),
             make_span(at(61), at(61 + 10 * number), 1, 1))
    assert sorted(known(registry)) == [(0, 0), (0, 1)]


def test_a_piece_far_ahead_waits_for_its_line():
    registry = SpanRegistry()
    first = make_span(at(0), at(60), c=5e4)
    for _ in range(2):
        tick(registry, first)
    for _ in range(MAX_WAIT - 2):
        tick(registry, first, make_span(at(90), at(120), 1, 1, c=5e4))
        assert sorted(known(registry)) == [(0, 0)]
    tick(registry, first, make_span(at(61), at(120), 0, 1, c=5e4))
    tick(registry, first, make_span(at(61), at(120), 0, 1, c=5e4))
    assert sorted(known(registry)) == [(0, 0), (0, 1)]


def test_continuations_one_to_one_and_within_limits():
    lines = [make_span(at(0, y), at(50, y), i) for i, y in enumerate((0.0, 0.5, 1.0))]
    pieces = [make_span(at(51, y + 0.1), at(90, y + 0.1), 10 + i)
              for i, y in enumerate((0.0, 0.5, 1.0))]
    found, ahead = continue_lines(find_ends(lines), find_ends(pieces))
    assert found == {10: 0, 11: 1, 12: 2}
    assert ahead == frozenset()
    away = [make_span(at(51, 5.0), at(90, 5.0), 10)]
    assert continue_lines(find_ends(lines), find_ends(away)) == ({}, frozenset())
    further = [make_span(at(90, 0.0), at(130, 0.0), 10)]
    assert continue_lines(find_ends(lines), find_ends(further)) == ({}, {10})
    back = [make_span(at(51), at(51, 40.0), 10)]  # turns by 90 degrees
    assert continue_lines(find_ends(lines), find_ends(back))[0] == {}
    assert continue_lines([], find_ends(pieces)) == ({}, frozenset())


def test_ends_where_spans_meet_are_not_free():
    spans = [make_span(at(0), at(50), 0, 0), make_span(at(50.5), at(100), 0, 1)]
    assert sorted(end.position[0] for end in find_ends(spans)) == [0.0, 100.0]


def test_the_final_word_is_believed_at_once():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(100), c=5e4), make_span(at(0, 9), at(50, 9), 1))
    registry.finish([(0, 0)])
    numbered = tick(
        registry, make_span(at(0), at(40), 3, 3, c=5e4), make_span(at(0, 30), at(60, 30), 4, 4),
        final=True, complete=True,
    )
    assert known(registry) == {(0, 0): (0, 40), (2, 2): (0, 60)} or known(registry) == {
        (0, 0): (0, 40), (2, 1): (0, 60)}
    assert numbered[3, 3] == (0, 0)


def test_the_final_word_does_not_undo_what_was_evicted():
    registry = SpanRegistry()
    for _ in range(2):
        tick(registry, make_span(at(0), at(100), c=5e4), make_span(at(0, 9), at(50, 9), 1))
    registry.finish([(0, 0)])
    tick(registry, make_span(at(0), at(40), 3, 3, c=5e4), final=True)
    assert known(registry) == {(0, 0): (0, 100)}


def test_same_ticks_give_the_same_registry():
    def run():
        registry = SpanRegistry()
        rng = np.random.default_rng(3)
        for number in range(12):
            ends = rng.uniform(40, 60, 4) + 4 * number
            tick(registry, *(make_span(at(0, 3.0 * i), at(x, 3.0 * i), i, 0)
                             for i, x in enumerate(ends)))
        return [(item.key, item.span.length, item.hits) for item in registry.spans]

    assert run() == run()


def test_thinning_keeps_one_point_a_cube():
    points = np.array([[0.1, 0, 0], [0.2, 0, 0], [0.6, 0, 0], [-0.1, 0, 0]])
    assert thin_points(points, 0.5).tolist() == [0, 2, 3]
    assert thin_points(np.empty((0, 3)), 0.5).tolist() == []


def test_a_span_over_two_lines_takes_along_the_next_of_the_second():
    registry = SpanRegistry()
    apart = [make_span(at(0), at(40), 0, 0), make_span(at(60), at(100), 1, 1),
             make_span(at(100), at(150), 1, 2)]
    for _ in range(CONFIRMATIONS):
        tick(registry, *apart)
    assert {line for line, _ in known(registry)} == {0, 1}
    for _ in range(MAX_MISSES):
        numbered = tick(
            registry, make_span(at(0), at(100), 0, 0), make_span(at(100), at(150), 0, 1)
        )
    assert len({line for line, _ in known(registry)}) == 1
    assert sorted(known(registry).values()) == [(0, 100), (100, 150)]
    assert set(numbered.values()) == set(known(registry))


@pytest.mark.parametrize('seed', range(20))
def test_whatever_ticks_say_each_span_is_there_once_by_its_numbers(seed):
    rng = np.random.default_rng(seed)
    registry = SpanRegistry()
    for _ in range(12):
        spans = []
        for y in (LEFT, RIGHT):
            edges = np.sort(rng.choice(np.arange(0, 320, 20), rng.integers(2, 7), replace=False))
            lines = np.cumsum(rng.random(len(edges)) < 0.3)  # spans of one line, or of several
            spans += [
                make_span(at(a, y), at(b, y), 2 * int(line) + (y > 0), number)
                for number, (line, (a, b)) in enumerate(
                    zip(lines, itertools.pairwise(edges), strict=False)
                ) if rng.random() < 0.9
            ]
        keys = [item.key for item in registry.spans]
        expected = [key for key in keys if rng.random() < 0.8]
        numbered = tick(registry, *spans, expected=expected)
        now = registry.spans
        assert len({item.key for item in now}) == len(now)
        assert all((item.span.line_id, item.span.span_id) == item.key for item in now)
        assert len(set(numbered.values())) == len(numbered)
