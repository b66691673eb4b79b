# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What goes to another process and back is the very object where both keep it."""

from dataclasses import dataclass, replace
import multiprocessing
from threading import Thread

import numpy as np
import pytest

from plc_inspect.ros.background.exchange import Exchange, LEAST_APART

MANY = LEAST_APART // 8 + 1


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """What both ends keep."""

    number: int
    points: np.ndarray


class Link:
    """Both ends of a pipe."""

    def __init__(self):
        ours, theirs = multiprocessing.Pipe()
        self.connections = ours, theirs
        self.ends = Exchange(ours, [Kept], first=True), Exchange(theirs, [Kept], first=False)

    def pass_on(self, start, *values, forget=False):
        """Send values from one end, and return what comes out at the other."""
        thread = Thread(target=self.ends[start].send, args=values, kwargs={'forget': forget})
        thread.start()
        got = self.ends[1 - start].receive()
        thread.join()
        return got


@pytest.fixture
def link():
    """Two ends."""
    link = Link()
    yield link
    for connection in link.connections:
        connection.close()


@pytest.fixture
def kept():
    """Two of what both ends keep, one with many points."""
    return Kept(1, np.arange(MANY) * 0.5), Kept(2, np.arange(3.0))


def test_values_are_the_same_on_the_other_side(link):
    values = {'large': np.arange(MANY), 'small': np.arange(4), 'text': 'ä'}, np.arange(8.0)[::2]
    got = link.pass_on(0, *values, np.zeros((0, 3)))
    assert got[0]['text'] == 'ä'
    for name in ('large', 'small'):
        np.testing.assert_array_equal(got[0][name], values[0][name])
        got[0][name][0] = 7  # may be written to
    np.testing.assert_array_equal(got[1], values[1])
    assert got[2].shape == (0, 3)
    assert len(link.ends[0]) == len(link.ends[1]) == 0


def test_what_was_sent_before_is_the_same_object(link, kept):
    first, = link.pass_on(0, list(kept))
    again, other = link.pass_on(0, {'second': kept[1]}, kept[0])
    assert other is first[0]
    assert again['second'] is first[1]
    np.testing.assert_array_equal(other.points, kept[0].points)


def test_what_comes_back_is_the_object_that_was_sent(link, kept):
    there, = link.pass_on(0, list(kept))
    new = Kept(3, np.ones(5))
    back, = link.pass_on(1, [there[1], new, there[0]])
    assert back[0] is kept[1]
    assert back[2] is kept[0]
    once_more, = link.pass_on(0, back[1])
    assert once_more is new


def test_arrays_stay_the_same_where_what_holds_them_is_new(link, kept):
    there, = link.pass_on(0, kept[0])
    back, loose = link.pass_on(1, replace(there, number=9), there.points)
    assert back is not kept[0]
    assert back.number == 9
    assert back.points is kept[0].points
    assert loose is kept[0].points


def test_two_that_share_an_array_share_it_there(link, kept):
    got, = link.pass_on(0, [kept[0], replace(kept[0], number=5)])
    assert got[0].points is got[1].points


def test_both_ends_forget_what_is_not_named(link, kept):
    there, = link.pass_on(0, list(kept))
    assert len(link.ends[0]) == len(link.ends[1]) == 4  # with an array each
    back, = link.pass_on(1, there[:1], forget=True)
    assert len(link.ends[0]) == len(link.ends[1]) == 2
    assert back[0] is kept[0]
    got, = link.pass_on(0, list(kept))
    assert got[0] is there[0]
    assert got[0].points is there[0].points
    assert got[1] is not there[1]
    np.testing.assert_array_equal(got[1].points, kept[1].points)


def test_nothing_is_held_after_many_rounds(link):
    state = [Kept(number, np.full(4, float(number))) for number in range(5)]
    for turn in range(30):
        got, = link.pass_on(0, state)
        after = [*got[1:], Kept(5 + turn, np.full(4, 5.0 + turn))]
        state, = link.pass_on(1, after, forget=True)
        assert [item.number for item in state] == list(range(turn + 1, turn + 6))
        assert all((item.points == item.number).all() for item in state)
    assert len(link.ends[0]) == len(link.ends[1]) == 10


def test_the_end_of_the_other_process_is_told(link):
    link.connections[1].close()
    with pytest.raises(EOFError):
        link.ends[0].receive()
    with pytest.raises(OSError, match='pipe'):
        link.ends[0].send(np.zeros(10 * MANY))
