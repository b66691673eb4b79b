# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A tick counts for the views that the way since the one before gave of a place."""

import numpy as np

from plc_inspect.core.live.owed_cells import NEAR
from plc_inspect.core.live.views import VIEW, ViewCounter


def fly(first, last):
    x = np.arange(first, last + 0.5, 2.0)
    return np.column_stack([x, np.zeros_like(x), np.full_like(x, 20.0)])


def test_views_by_hand():
    counter = ViewCounter()
    counter.advance(fly(0, 40))
    places = np.array([[0.0, 5.0, 8.0], [40.0, 0.0, 0.0], [NEAR + 25.0, 0.0, 0.0], [500, 0, 0]])
    assert counter.count(places).tolist() == [4, 4, 1, 1]  # 16 m of way count for one
    assert counter.count(np.zeros((0, 3))).tolist() == []


def test_what_was_flown_before_the_last_tick_does_not_count_again():
    counter, place = ViewCounter(), np.array([[20.0, 0.0, 0.0]])
    counter.advance(fly(0, 40))
    counter.advance(fly(0, 40))
    assert counter.count(place).tolist() == [1]  # a vehicle that hovers
    counter.advance(fly(0, 40 + 3 * VIEW))
    assert counter.count(place).tolist() == [3]
    counter.advance(fly(0, 10))  # the map began anew
    counter.advance(fly(0, 10 + 2 * VIEW))
    assert counter.count(place).tolist() == [2]


def test_an_unknown_way_leaves_ticks_to_be_counted():
    counter = ViewCounter()
    for way in (None, np.zeros((0, 3)), fly(0, 0)):
        counter.advance(way)
        assert counter.count(np.zeros((2, 3))).tolist() == [1, 1]
