# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells of the first points seen are the landmark for later ones."""

import numpy as np

from plc_inspect.core.alignment.normal_cells import NormalCells
from plc_inspect.core.alignment.rigid_move import RigidMove

SECOND = 10**9


def see(cells, points, second, times=5):
    for number in range(times):
        cells.add(points, second * SECOND + number * SECOND // 4)


def count_matched(cells, points, second):
    return cells.compare(points, RigidMove(), second * SECOND, 1)[2]


def test_what_was_seen_is_the_landmark_also_where_time_goes_back():
    rng = np.random.default_rng(0)
    ground = np.column_stack((rng.uniform(0, 20, (6000, 2)), rng.normal(0.5, 0.02, 6000)))
    cells = NormalCells()
    see(cells, ground, 700)
    assert count_matched(cells, ground, 701) == 0  # its cells are open still
    assert count_matched(cells, ground, 720) == len(ground)
    assert count_matched(cells, ground, 100) == len(ground)
    before = cells._counts[: len(cells)].copy()
    see(cells, ground + np.array([0.0, 0.0, 0.3]), 101, times=20)
    np.testing.assert_array_equal(cells._counts[: len(before)], before)
