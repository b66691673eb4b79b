# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Gaps between boxes, worked out by hand."""

import numpy as np
import pytest

from plc_inspect.core.numerics.boxes import measure_box_gap

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


@pytest.mark.parametrize(('shift', 'gap'), [
    ((0.5, 0.5, 0.5), 0.0), ((1.0, 0.0, 0.0), 0.0), ((3.0, 0.0, 0.0), 2.0),
    ((-3.0, 0.5, 0.0), 2.0), ((4.0, 5.0, 0.0), 5.0), ((2.0, -3.0, 3.0), 3.0),
])
def test_the_gap_is_that_of_the_nearest_points(shift, gap):
    other = UNIT + shift
    assert measure_box_gap(UNIT, other) == pytest.approx(gap)
    assert measure_box_gap(other, UNIT) == measure_box_gap(UNIT, other)


def test_a_box_may_be_a_point():
    assert measure_box_gap(np.full((2, 3), 2.0), UNIT) == pytest.approx(np.sqrt(3.0))
