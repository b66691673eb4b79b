# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_curve

from plc_inspect.core.catenary.stays import find_stays

X = np.linspace(0.0, 60.0, 600)


def bar(low, high, first, last, y=0.0):
    """Return the curve of a straight bar between two heights, over some of the beam [m]."""
    x = X[(low <= X) & (high >= X)]
    z = first + (last - first) * (x - low) / (high - low)
    noise = np.random.default_rng(3).normal(0.0, 0.01, (len(x), 3))
    points = np.column_stack([x, np.full(len(x), y), z]) + noise
    return make_curve(points, np.arange(len(points)))


BEAM = bar(0.0, 60.0, 20.0, 20.0)


@pytest.mark.parametrize('curve', [
    bar(2.0, 40.0, 20.5, 27.0), bar(40.0, 58.0, 27.0, 21.0), bar(5.0, 40.0, 21.5, 27.0, y=0.8),
])
def test_bars_that_come_down_on_a_beam_are_its_stays(curve):
    assert find_stays([curve], [BEAM]).tolist() == [True]


@pytest.mark.parametrize('curve', [
    bar(2.0, 58.0, 22.0, 22.5),  # beside the beam all along, as a second conductor
    bar(2.0, 40.0, 20.5, 27.0, y=3.0),  # in another plane
    bar(2.0, 40.0, 26.0, 32.0),  # high above
    bar(2.0, 40.0, 14.0, 19.5),  # below
])
def test_other_lines_near_a_beam_are_none(curve):
    assert find_stays([curve], [BEAM]).tolist() == [False]


def test_without_beams_or_curves_there_are_no_stays():
    assert find_stays([], [BEAM]).tolist() == []
    assert find_stays([BEAM], []).tolist() == [False]
