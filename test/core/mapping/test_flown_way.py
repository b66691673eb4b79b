# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The path of the vehicle is thinned, bounded and made of places."""

import numpy as np

from plc_inspect.core.mapping.flown_way import FlownWay, MOST_PLACES, STEP


def test_positions_near_the_last_one_and_those_at_no_place_are_left_out():
    way = FlownWay()
    for second, x in enumerate((0.0, 0.9 * STEP, 1e300, np.nan, -np.inf, 1.1 * STEP)):
        way.add(second * 10**9, np.array([x, 0.0, 20.0]))
        way.add(second * 10**9, np.array([x, 0.0, np.nan]))
    np.testing.assert_allclose(way.places, [[0, 0, 0, 20], [5, 1.1 * STEP, 0, 20]])
    way.clear()
    assert way.places.shape == (0, 4)


def test_a_long_path_is_kept_in_longer_steps():
    way = FlownWay()
    for number in range(MOST_PLACES + 10):
        way.add(number, np.array([2.0 * STEP * number, 0.0, 0.0]))
    places = way.places
    assert MOST_PLACES // 2 <= len(places) <= MOST_PLACES // 2 + 10
    assert places[-1, 1] == 2.0 * STEP * (MOST_PLACES + 9)
