# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Alarms stand until they are cleared and acknowledged, in whatever order."""

from dataclasses import replace
import itertools

from hypothesis import given, settings, strategies
import pytest

from plc_inspect.monitor.picture.alarms import (
    AlarmBook,
    BEGAN_ANEW,
    Cause,
    MOST_OPEN,
    MOST_PAST,
)

TREE = Cause(text='a tree', hazard_id=7, place=(10.0, 0.0, 5.0))
WIRE = Cause(text='a wire', fixed=False)


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
    book.update({}, 2.0)
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


def test_another_run_of_the_node_takes_no_alarm_of_the_one_before():
    book = AlarmBook()
    (raised,) = book.update({'hazard 7': TREE}, 1.0)
    assert raised.number == 1
    book.begin_anew(2.0)
    assert states(book) == [('hazard 7', 'unsure', False)]
    assert book.open[0].reason == BEGAN_ANEW
    elsewhere = replace(TREE, place=(90.0, 0.0, 5.0), text='another tree')
    (raised,) = book.update({'hazard 7': elsewhere}, 3.0)
    assert raised.number == 2
    assert {item.number: item.state for item in book.open} == {1: 'unsure', 2: 'new'}
    assert book.update({}, 4.0) == ()
    assert {item.number: item.state for item in book.open} == {1: 'unsure', 2: 'cleared'}
    book.acknowledge([1, 2], 'crew', 5.0)
    assert book.open == ()
    assert [(item.number, item.reason) for item in reversed(book.past)] == [
        (1, BEGAN_ANEW), (2, 'no longer there')
    ]


@pytest.mark.parametrize('when', ['never', 'before', 'after'])
def test_what_the_node_kept_goes_on_as_it_was(when):
    book = AlarmBook()
    book.update({'hazard 7': TREE}, 1.0)
    if when == 'before':
        book.acknowledge([1], 'crew', 1.5)
    book.begin_anew(2.0)
    if when == 'after':
        book.acknowledge([1], 'crew', 2.5)
    book.begin_anew(2.7)  # it was killed again before it told of anything
    moved = replace(TREE, place=(12.0, 0.0, 5.0))
    assert book.update({'hazard 7': moved}, 3.0) == ()  # no bell for what is known
    (alarm,) = book.open
    assert (alarm.number, alarm.raised, alarm.times, alarm.stands) == (1, 1.0, 1, True)
    assert alarm.state == ('new' if when == 'never' else 'acknowledged')
    assert book.past == ()
    book.update({}, 4.0)
    assert len(book.past) == (when != 'never')


def test_an_acknowledged_hazard_that_the_node_forgot_is_to_be_acknowledged_again():
    book = AlarmBook()
    book.update({'hazard 7': TREE}, 1.0)
    book.acknowledge([1], 'crew', 1.5)
    book.begin_anew(2.0)
    assert states(book) == [('hazard 7', 'unsure', False)]
    assert (book.open[0].who, book.past) == ('crew', ())
    book.update({}, 3.0)
    assert states(book) == [('hazard 7', 'unsure', False)]
    book.acknowledge([1], 'chief', 4.0)
    assert book.open == ()
    assert (book.past[0].who, book.past[0].reason) == ('chief', BEGAN_ANEW)


@pytest.mark.parametrize('who', ['', 'crew'])
def test_what_is_too_near_in_another_run_of_the_node_is_new(who):
    book = AlarmBook()
    near = replace(WIRE, distance=0.7, place=(0.0, 0.0, 0.0))
    book.update({'keep-out conductor': near}, 1.0)
    if who:
        book.acknowledge([1], who, 1.5)
    book.begin_anew(2.0)
    assert [item.state for item in book.open] == ([] if who else ['cleared'])
    (raised,) = book.update({'keep-out conductor': replace(near, distance=6.0)}, 3.0)
    assert (raised.number, raised.state, raised.raised, raised.worst.distance) == (
        2, 'new', 3.0, 6.0
    )


@pytest.mark.parametrize(('fixed', 'away', 'numbers'), [
    (True, 60.0, {1, 2}), (True, 2.0, {1}), (False, 60.0, {1}),
])
def test_another_thing_that_is_too_near_is_another_alarm(fixed, away, numbers):
    book = AlarmBook()
    first = Cause(text='a tree', distance=5.5, place=(0.0, 0.0, 0.0), fixed=fixed)
    book.update({'keep-out obstacle': first}, 1.0)
    book.update({}, 2.0)
    assert book.open[0].reason == 'no longer near'
    book.update({'keep-out obstacle': replace(first, distance=3.6, place=(away, 0.0, 0.0))}, 3.0)
    assert {item.number for item in book.open} == numbers
    assert max(item.times for item in book.open) == 3 - len(numbers)


def test_an_acknowledged_keep_out_rings_anew_at_another_thing():
    book = AlarmBook()

    def come_near(x, now):
        return [item.number for item in book.update({'keep-out obstacle': Cause(
            text=f'a tree at {x}', distance=6.0, place=(x, 0.0, 0.0)
        )}, now)]

    assert come_near(0.0, 1.0) == [1]
    assert come_near(20.0, 2.0) == []  # nobody has seen either: one bell rings for both
    book.acknowledge([1], 'crew', 3.0)
    for k in range(10):  # along a hedge
        assert come_near(20.0 + 4.0 * k, 4.0) == []
    assert come_near(80.0, 5.0) == [2]
    assert [(item.number, item.state) for item in book.open] == [(2, 'new')]
    (past,) = book.past
    assert (past.number, past.who, past.reason) == (1, 'crew', 'another one is nearer')
    book.acknowledge([2], 'crew', 6.0)
    for k in range(10):  # between both, whichever is nearer now
        assert come_near((80.0, 56.0)[k % 2], 7.0) == []
    assert come_near(110.0, 8.0) == [3]
    assert come_near(80.0, 9.0) == []  # it rings
    book.update({}, 10.0)
    assert come_near(80.0, 11.0) == [3]  # nobody had seen it: the same again
    book.acknowledge([3], 'crew', 12.0)
    book.update({}, 13.0)
    assert come_near(80.0, 14.0) == [4]
    book.acknowledge([4], 'crew', 15.0)
    assert come_near(56.0, 16.0) == [5]  # what was acknowledged holds until it clears


def test_another_kind_of_hazard_takes_no_acknowledgement_with_the_number():
    book = AlarmBook()
    book.update({'hazard 7': replace(TREE, kind='vegetation')}, 1.0)
    book.acknowledge([1], 'crew', 1.5)
    book.begin_anew(2.0)
    (raised,) = book.update({'hazard 7': replace(TREE, kind='sag')}, 3.0)
    assert (raised.number, raised.state) == (2, 'new')
    assert {item.number: item.state for item in book.open} == {1: 'unsure', 2: 'new'}


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


def test_of_too_many_those_that_cleared_first_are_dropped():
    book = AlarmBook()
    book.update({'hazard 1': TREE, 'hazard 2': TREE}, 1.0)
    book.update({'hazard 1': TREE}, 2.0)
    book.update({}, 3.0)
    book.update({f'hazard {number}': TREE for number in range(3, MOST_OPEN + 2)}, 4.0)
    assert {item.key for item in book.open if not item.stands} == {'hazard 1'}
    assert [item.key for item in book.past] == ['hazard 2']


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


def test_alarm_that_stands_clears_after_an_older_one_of_its_key_was_acknowledged():
    book = AlarmBook()
    first = Cause(text='a tower', distance=3.0, place=(0.0, 0.0, 0.0))
    second = replace(first, place=(100.0, 0.0, 0.0))
    book.update({'keep-out structure': first}, 1.0)
    book.update({}, 2.0)
    book.update({'keep-out structure': second}, 3.0)
    book.acknowledge([1], 'crew', 4.0)
    assert book.update({'keep-out structure': second}, 5.0) == ()
    assert states(book) == [('keep-out structure', 'new', True)]
    book.update({}, 6.0)
    assert states(book) == [('keep-out structure', 'cleared', False)]


CAUSES = strategies.dictionaries(
    strategies.sampled_from(('keep-out structure', 'hazard 1', 'hazard 2')),
    strategies.sampled_from((0.0, 100.0)),
)


@settings(max_examples=300, deadline=None)
@given(strategies.lists(strategies.one_of(
    CAUSES, strategies.sets(strategies.integers(1, 8), min_size=1), strategies.none(),
), max_size=25))
def test_alarms_that_stand_are_the_present_causes(steps):
    book = AlarmBook()
    for now, step in enumerate(steps):
        if step is None:
            book.begin_anew(float(now))
        elif isinstance(step, set):
            book.acknowledge(step, 'crew', float(now))
        else:
            book.update({
                key: Cause(text=key, place=(x, 0.0, 0.0), distance=3.0,
                           hazard_id=int(key[-1]) if key.startswith('hazard') else -1)
                for key, x in step.items()
            }, float(now))
            stands = [item.key for item in book.open if item.stands]
            assert sorted(stands) == sorted(step)
