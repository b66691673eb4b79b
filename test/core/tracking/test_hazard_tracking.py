# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Supports and hazards keep their numbers, and change only when several ticks agree."""

import dataclasses

import numpy as np
import pytest
from spans import make_hazard, make_span, make_support

from plc_inspect.core.hazards.confidence import AT_END, IN_DOUBT
from plc_inspect.core.tracking.hazard_tracking import (
    carry_numbers,
    CONFIRMATIONS,
    END_CONFIRMATIONS,
    FOUND,
    HazardBook,
    HazardNews,
    NOT_FINAL,
    NOT_SEEN,
)
from plc_inspect.core.tracking.support_tracking import MAX_MISSES, SupportBook
from plc_inspect.results import HazardKind, Severity

NUMBERED = {(0, 0): (0, 0), (1, 0): (1, 0), (5, 5): (-3, -3)}


def everywhere(points):
    return np.ones(len(points), dtype=np.bool_)


def nowhere(points):
    return np.zeros(len(points), dtype=np.bool_)


def tick(book, *hazards, holds=everywhere, expected=((0, 0), (1, 0)), **options):
    return book.update(hazards, NUMBERED, set(expected), holds, **options)


def raise_hazard(book, hazard):
    for _ in range(CONFIRMATIONS):
        news = tick(book, hazard)
    assert [item.hazard_id for item in news.raised] == [book.hazards[-1].hazard_id]


def test_nothing():
    book = HazardBook()
    news = tick(book)
    assert (news.raised, news.updated, news.cleared, book.hazards) == ((), (), (), ())


def test_life_of_a_hazard():
    book = HazardBook()
    first = make_hazard((10, 0, 5))
    assert book.awaited.shape == (0, 3)
    assert tick(book, first).raised == ()
    assert book.hazards == ()
    np.testing.assert_array_equal(book.awaited, [[10, 0, 5]])
    news = tick(book, first)
    assert [item.hazard_id for item in news.raised] == [0]
    assert len(book.awaited) == 0
    for _ in range(5):  # it stands, and follows its place
        news = tick(book, make_hazard((10.4, 0, 5), clearance=2.9))
        assert (news.raised, news.updated, news.cleared) == ((), (), ())
    assert book.hazards[0].clearance == 2.9
    for _ in range(MAX_MISSES - 1):
        assert tick(book).cleared == ()
    news = tick(book)
    assert [item.hazard_id for item in news.cleared] == [0]
    assert news.reasons == (NOT_SEEN,)
    assert book.hazards == ()
    raise_hazard(book, first)
    assert book.hazards[0].hazard_id == 1  # a number is never given twice


def test_a_missing_conductor_is_taken_back_in_the_end_or_where_it_is_found():
    """A tick may hold the span, and not those beside it that tell of the conductor."""
    book, missing = HazardBook(), make_hazard((10, 0, 5), kind=HazardKind.MISSING)
    raise_hazard(book, missing)
    for _ in range(2 * MAX_MISSES):
        assert tick(book).cleared == ()
    (gone,) = tick(book, final=True).cleared
    assert gone.kind == HazardKind.MISSING
    tick(book, missing)
    tick(book)  # seen once, it waits no longer
    assert len(book.awaited) == 0


@pytest.mark.parametrize(('aside', 'is_there'), [(0.3, True), (0.5, False)])
def test_a_conductor_that_is_found_is_not_missing(aside, is_there):
    book = HazardBook()
    beside = make_span((0, 1.0, 5), (20, 1.0, 5), 0, 0, c=1e5)
    raise_hazard(book, make_hazard((10, 0, 5), kind=HazardKind.MISSING))
    found = make_span((0, aside, 5), (20, aside, 5), 1, 0, c=1e5)
    for other in (beside, make_span((30, 0, 5), (50, 0, 5), 1, 1, c=1e5)):
        assert book.clear_gone(HazardNews(), [beside, other]).cleared == ()
    news = book.clear_gone(HazardNews(), [beside, found])
    assert news.reasons == (FOUND,) * is_there
    assert len(book.hazards) == (not is_there)


def test_flicker_is_not_raised_and_not_cleared():
    book = HazardBook()
    for _ in range(6):
        assert tick(book, make_hazard((10, 0, 5))).raised == ()
        tick(book)
    raise_hazard(book, make_hazard((10, 0, 5)))
    for _ in range(6):
        for _ in range(MAX_MISSES - 1):
            assert tick(book).cleared == ()
        tick(book, make_hazard((10, 0, 5)))
    assert len(book.hazards) == 1


def test_worse_at_once_better_only_in_the_end():
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5)))
    news = tick(book, make_hazard((10, 0, 5), severity=Severity.CRITICAL, clearance=1.0))
    assert [item.severity for item in news.updated] == [Severity.CRITICAL]
    for _ in range(MAX_MISSES - 1):
        news = tick(book, make_hazard((10, 0, 5)))
        assert news.updated == ()
        assert book.hazards[0].severity == Severity.CRITICAL
        assert book.hazards[0].clearance == 3.0
    news = tick(book, make_hazard((10, 0, 5)))
    assert [item.severity for item in news.updated] == [Severity.WARNING]
    assert book.hazards[0].hazard_id == 0


@pytest.mark.parametrize('apart', [0.5, 2.5])
def test_a_hazard_that_comes_into_view_takes_no_number_of_the_next(apart):
    """The boxes are 1 m wide: these overlap, or are near each other."""
    book = HazardBook()
    known = make_hazard((20, 0, 5), severity=Severity.CRITICAL, clearance=1.0)
    raise_hazard(book, known)
    new = make_hazard((20 - apart, 0, 5))
    for _ in range(CONFIRMATIONS):
        news = tick(book, new, known)  # in order along the span, which is flown backwards
        assert (book.hazards[0].clearance, book.hazards[0].severity) == (1.0, Severity.CRITICAL)
    assert [(item.hazard_id, item.clearance) for item in news.raised] == [(1, 3.0)]


def test_the_rest_of_a_tree_does_not_replace_what_was_nearest():
    book = HazardBook()
    near = dataclasses.replace(make_hazard((10, 0, 5)), clearance=1.4)
    raise_hazard(book, near)
    rest = dataclasses.replace(make_hazard((10.8, 0, 5)), clearance=2.7)

    def beyond(points):
        return points[:, 0] > 10.5

    tick(book, rest, holds=beyond)
    assert book.hazards[0].clearance == 1.4
    tick(book, dataclasses.replace(rest, clearance=1.1), holds=beyond)  # nearer counts
    assert book.hazards[0].clearance == 1.1
    tick(book, rest)  # all of it was seen: it has been cut back
    assert book.hazards[0].clearance == 2.7


def test_what_the_tick_did_not_see_stays():
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5)))
    for _ in range(10):
        assert tick(book, holds=nowhere).cleared == ()
        tick(book, make_hazard((10, 0, 5), clearance=0.1), holds=nowhere)
    assert book.hazards[0].clearance == 3.0
    for _ in range(5):
        assert tick(book, make_hazard((50, 0, 5)), holds=nowhere).raised == ()


@pytest.mark.parametrize(('other', 'same'), [
    (make_hazard((12.9, 0, 5)), True),  # boxes are 1.9 m apart
    (make_hazard((13.2, 0, 5)), False),
    (make_hazard((10, 0, 5), line_id=1), True),  # the nearest conductor changed
    (make_hazard((10, 0, 5), kind=HazardKind.STRUCTURE), False),
])
def test_which_hazard_is_the_same(other, same):
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5)))
    for _ in range(CONFIRMATIONS):
        tick(book, other)
    found = {item.hazard_id: item for item in book.hazards}
    assert (set(found) == {0}) == same
    if same:
        np.testing.assert_array_equal(found[0].position, other.position)
    assert sorted({0, 1}) == sorted({0, 1} | set(found))


def test_ground_is_one_hazard_a_span_wherever_its_lowest_place_is():
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5), kind=HazardKind.GROUND))
    tick(book, make_hazard((45, 0, 5), kind=HazardKind.GROUND))
    assert [item.hazard_id for item in book.hazards] == [0]
    assert book.hazards[0].position[0] == 45.0


def test_two_that_are_near_keep_apart():
    book = HazardBook()
    pair = [make_hazard((10, 0, 5)), make_hazard((12.5, 0, 5))]
    for _ in range(CONFIRMATIONS):
        tick(book, *pair)
    assert [item.position[0] for item in book.hazards] == [10.0, 12.5]
    for _ in range(4):
        tick(book, *reversed(pair))
    assert [(item.hazard_id, item.position[0]) for item in book.hazards] == [(0, 10.0), (1, 12.5)]


def test_spans_without_lasting_numbers_have_no_hazards():
    book = HazardBook()
    for _ in range(4):
        tick(book, make_hazard((10, 0, 5), line_id=5, span_id=5))
        tick(book, make_hazard((10, 0, 5), line_id=8, span_id=8))
    assert book.hazards == ()


def test_numbers_of_lines_are_translated():
    book = HazardBook()
    for _ in range(CONFIRMATIONS):
        book.update([make_hazard((1, 0, 5), 7, 8)], {(7, 8): (2, 3)}, set(), everywhere)
    assert (book.hazards[0].line_id, book.hazards[0].span_id) == (2, 3)
    assert [item.hazard_id for item in book.keep({(0, 0)})] == [0]
    assert book.hazards == ()


def test_near_a_support_more_ticks_must_agree():
    book = HazardBook()
    near = make_hazard((10, 0, 5), from_support=1.0)
    for _ in range(END_CONFIRMATIONS - 1):
        assert tick(book, near).raised == ()
    assert [item.hazard_id for item in tick(book, near).raised] == [0]
    assert tick(book, make_hazard((50, 0, 5), from_support=1.0), final=True).raised


def test_a_glimpse_of_the_rest_raises_nothing_that_waits_near_a_support():
    book = HazardBook()
    near = make_hazard((10, 0, 5), from_support=3.0)
    for _ in range(CONFIRMATIONS):
        tick(book, near)
    rest = make_hazard((11.5, 0, 5), from_support=4.5, clearance=3.5)
    assert tick(book, rest, holds=nowhere).raised == ()
    assert book.hazards == ()


def test_the_final_word():
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5)))
    news = tick(book, make_hazard((50, 0, 5)), final=True)
    assert news.reasons == (NOT_FINAL,)
    assert [item.hazard_id for item in news.raised] == [1]
    assert [item.hazard_id for item in news.cleared] == [0]


def test_at_an_end_without_a_support_it_waits_as_near_a_support():
    book = HazardBook()
    at_end = make_hazard((10, 0, 5), note=IN_DOUBT + AT_END)
    for _ in range(END_CONFIRMATIONS - 1):
        assert tick(book, at_end).raised == ()
    assert [item.hazard_id for item in tick(book, at_end).raised] == [0]


def test_a_tick_counts_for_the_views_that_it_gives():
    book = HazardBook()
    near = make_hazard((50, 0, 5), from_support=1.0)
    news = tick(book, make_hazard((10, 0, 5)), near, views=[CONFIRMATIONS, CONFIRMATIONS])
    assert [item.position[0] for item in news.raised] == [10.0]
    assert [item.position[0] for item in tick(book, near, views=[2]).raised] == [50.0]
    # what it did not see whole gives none
    assert tick(book, make_hazard((90, 0, 5)), holds=nowhere, views=[9]).raised == ()
    assert tick(book, make_hazard((90, 0, 5))).raised == ()


def support_tick(book, *supports, holds=everywhere, **options):
    book.update(supports, NUMBERED, holds, **options)


def test_life_of_a_support():
    book = SupportBook()
    support_tick(book, make_support((0, 0, 0)), make_support((60, 0, 0), (0, 1)))
    assert [(item.support_id, item.line_ids) for item in book.supports] == [(0, (0,)), (1, (0, 1))]
    for _ in range(5):
        support_tick(book, make_support((61, 0.5, 0), (1, 0)), make_support((0.3, 0, 0)))
    assert [item.support_id for item in book.supports] == [0, 1]
    assert book.supports[1].position[0] == 61.0
    for _ in range(10):
        support_tick(book, holds=nowhere)
    assert len(book.supports) == 2
    for _ in range(MAX_MISSES - 1):
        support_tick(book, make_support((0, 0, 0)))
    assert len(book.supports) == 2
    support_tick(book, make_support((0, 0, 0)))
    assert [item.support_id for item in book.supports] == [0]


def test_a_support_that_comes_into_view_takes_no_number_of_the_next():
    book = SupportBook()
    support_tick(book, make_support((0, 0, 0)))
    support_tick(book, make_support((3, 0, 0)), make_support((0.2, 0, 0)))
    assert [(item.support_id, item.position[0]) for item in book.supports] == [(0, 0.2), (1, 3.0)]


def test_a_hazard_names_support_and_other_line_by_their_lasting_numbers():
    book = SupportBook()
    told = {(7, 0): (0, 0), (8, 0): (3, 0)}
    near = dataclasses.replace(make_support((0, 0, 0), (7,)), support_id=0)
    far = dataclasses.replace(make_support((60, 0, 0), (7,)), support_id=1)
    book.update([near, far], told, everywhere)
    # the next tick sees from the other side, and what it has not seen before comes first
    seen = [dataclasses.replace(far, support_id=0),
            dataclasses.replace(make_support((120, 0, 0), (99,)), support_id=1),
            dataclasses.replace(near, support_id=2)]
    numbers = book.update(seen, told, everywhere)
    assert numbers == {0: 1, 2: 0}
    hazards = [
        dataclasses.replace(make_hazard((1, 0, 5), 7, 0), support_id=support, other_line_id=other)
        for support, other in ((0, 8), (2, -1), (1, 55))
    ]
    carried = carry_numbers(hazards, told, numbers)
    assert [(item.support_id, item.other_line_id) for item in carried] == [
        (1, 3), (0, -1), (-1, -1)
    ]
    assert [(item.line_id, item.span_id) for item in carried] == [(7, 0)] * 3


def test_supports_elsewhere_are_left_as_they_are_known():
    book = SupportBook()
    support_tick(book, make_support((0, 0, 0), kind='tower'))
    support_tick(book, make_support((1, 0, 0), kind='unseen'), holds=nowhere)
    assert book.supports[0].kind == 'tower'
    support_tick(book, make_support((1, 0, 0), kind='pole'))
    assert book.supports[0].kind == 'pole'


def test_supports_without_known_lines_are_left_out():
    book = SupportBook()
    support_tick(book, make_support((0, 0, 0), (5,)), make_support((9, 0, 0), (8,)))
    assert book.supports == ()
    support_tick(book, make_support((0, 0, 0), (0, 5)))
    assert book.supports[0].line_ids == (0,)


def test_hazards_and_supports_follow_lines_that_prove_to_be_one():
    """A hazard behind the vehicle is not taken back since its line has another number now."""
    hazards, supports = HazardBook(), SupportBook()
    for _ in range(CONFIRMATIONS):
        hazards.update(
            [make_hazard((1.0, 2.0, 3.0), line_id=1, span_id=0)], NUMBERED, [(1, 0)], everywhere
        )
    supports.update([make_support((0.0, 0.0, 0.0), line_ids=(0, 1))], NUMBERED, everywhere)
    (before,) = hazards.hazards

    def rename(key):
        return 0 if key[0] == 1 else key[0], 7 if key == (1, 0) else key[1]

    hazards.follow(lambda key, place: rename(key))
    supports.follow(rename)
    assert hazards.keep([(0, 7)]) == ()
    (after,) = hazards.hazards
    assert (after.hazard_id, after.line_id, after.span_id) == (before.hazard_id, 0, 7)
    assert after.other_line_id == before.other_line_id
    assert supports.supports[0].line_ids == (0,)


def test_the_end_of_a_flight_raises_what_is_new_though_voxels_were_evicted():
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5), clearance=1.0, severity=Severity.CRITICAL))
    news = tick(
        book, make_hazard((10, 0, 5), clearance=3.0), make_hazard((40, 0, 5)),
        holds=nowhere, final=True, complete=False,
    )
    assert [item.hazard_id for item in news.raised] == [1]
    assert news.cleared == ()
    assert book.hazards[0].severity is Severity.CRITICAL  # its nearest part may be gone
    tick(book, make_hazard((10, 0, 5), clearance=3.0), final=True)
    assert book.hazards[0].severity is Severity.WARNING


@pytest.mark.parametrize('kind', [HazardKind.SAG, HazardKind.GROUND])
def test_a_map_that_is_not_complete_takes_back_nothing(kind):
    """The session expects no span of it."""
    book = HazardBook()
    raise_hazard(book, make_hazard((10, 0, 5), kind=kind, severity=Severity.CRITICAL))
    for found in ((), (make_hazard((10, 0, 5), kind=kind, clearance=3.5),)):
        news = tick(book, *found, holds=nowhere, expected=(), final=True, complete=False)
        assert news.cleared == ()
        assert book.hazards[0].severity is Severity.CRITICAL
