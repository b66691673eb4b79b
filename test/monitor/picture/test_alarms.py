# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Alarms stand until they are cleared and acknowledged, in whatever order."""

import itertools

from hypothesis import given, settings, strategies

from plc_inspect.monitor.picture.alarms import AlarmBook, Cause, MOST_OPEN, MOST_PAST

TREE, WIRE = Cause(text='a tree', hazard_id=7), Cause(text='a wire')


def states(book):
    return [(item.key, item.state, item.stands) for item in book.open]


def test_an_alarm_stands_until_it_is_cleared_and_acknowledged():
    book = AlarmBook()
    book.update({'tree': TREE}, 1.0)
    assert states(book) == [('tree', 'new', True)]
    book.update({'tree': TREE}, 1000.0)
    assert book.open[0].raised == 1.0
    (seen,) = book.acknowledge([1], 'crew', 1001.0)
    assert (seen.who, seen.acknowledged) == ('crew', 1001.0)
    assert states(book) == [('tree', 'acknowledged', True)]
    assert book.past == ()
    book.update({}, 1002.0)
    assert book.open == ()
    (past,) = book.past
    assert (past.cleared, past.reason, past.who) == (1002.0, 'no longer there', 'crew')


def test_what_cleared_unseen_is_told_until_somebody_sees_it():
    book = AlarmBook()
    book.update({'tree': TREE}, 1.0)
    book.update({}, 2.0, 'the node began anew')
    assert states(book) == [('tree', 'cleared', False)]
    book.update({'tree': TREE}, 3.0)  # the same alarm, raised again before anybody saw it
    assert states(book) == [('tree', 'new', True)]
    assert (book.open[0].number, book.open[0].times) == (1, 2)
    book.update({}, 4.0)
    book.acknowledge([1], 'crew', 5.0)
    assert book.open == ()
    book.update({'tree': TREE}, 6.0)  # after it was seen and over: another one
    assert [item.number for item in book.open] == [2]
    assert states(book) == [('tree', 'new', True)]


def test_new_ones_stand_before_those_that_were_seen():
    book = AlarmBook()
    book.update({'tree': TREE}, 1.0)
    book.acknowledge([1], 'crew', 2.0)
    book.update({'tree': TREE, 'wire': WIRE}, 3.0)
    assert [item.key for item in book.open] == ['wire', 'tree']


def test_only_what_is_open_and_unseen_is_acknowledged():
    book = AlarmBook()
    book.update({'tree': TREE}, 1.0)
    assert book.acknowledge([5, -1], 'crew', 2.0) == ()
    assert len(book.acknowledge([1, 1], 'crew', 2.0)) == 1
    assert book.acknowledge([1], 'Bert', 3.0) == ()
    assert book.open[0].who == 'crew'


def test_what_is_remembered_is_bounded():
    book = AlarmBook()
    for number in range(2 * MOST_OPEN):
        book.update({f'hazard {number}': TREE}, float(number))
    assert len(book.open) == MOST_OPEN
    assert book.open[0].stands
    assert len(book.past) <= MOST_PAST


@settings(max_examples=60, deadline=None)
@given(strategies.lists(strategies.tuples(
    strategies.sets(strategies.sampled_from('abc')), strategies.sets(strategies.integers(1, 6)),
), max_size=12))
def test_nothing_disappears_by_itself(steps):
    book, clock, raised, seen = AlarmBook(), itertools.count(), 0, set()
    for found, numbers in steps:
        raised_before = {item.key for item in book.open}
        book.update(dict.fromkeys(found, TREE), float(next(clock)))
        raised += len(found - raised_before)
        seen |= {item.number for item in book.acknowledge(numbers, 'crew', float(next(clock)))}
        assert {item.key for item in book.open if item.stands} == found
        assert {item.number for item in book.past} <= seen
        assert len(book.open) + len(book.past) == raised


def test_what_has_cleared_tells_how_near_it_was():
    book = AlarmBook()
    for now, distance in enumerate((7.9, 5.2, 8.8)):
        cause = Cause(text=f'conductor {distance} m', distance=distance)
        book.update({'keep-out conductor': cause}, float(now))
    (item,) = book.open
    assert item.text == 'conductor 8.8 m; nearest 5.2 m'
    book.update({}, 4.0)
    (item,) = book.open
    assert item.text == 'conductor 5.2 m'
    book.acknowledge([item.number], 'crew', 5.0)
    assert book.past[0].text == 'conductor 5.2 m'
    assert book.raises == 1
