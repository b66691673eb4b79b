# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""When the halo of a tile is wide enough."""

import itertools

import numpy as np
import pytest
from spans import make_result, make_span

from plc_inspect.grid.tiles.tile_run import _judge

TILE = (0.0, 0.0, 110.0, 200.0)
BOUND = (-5000.0, -5000.0, 5000.0, 5000.0)
SUPPORTS = (20.0, 180.0, 480.0, 780.0)


@pytest.mark.parametrize(('edge', 'num_cut'), [
    (470.0, 1),  # the next span is cut off
    (516.0, 1),  # where the next span ends rests on 36 m of the span beyond it
    (600.0, 0),
])
def test_a_halo_shows_enough_of_what_hangs_beyond_the_next_span(edge, num_cut):
    spans = [
        make_span((low, 100.0, 20.0), (min(high, edge), 100.0, 20.0), 0, number)
        for number, (low, high) in enumerate(itertools.pairwise(SUPPORTS))
        if low < edge
    ]
    outer = (-400.0, -400.0, edge, 600.0)
    look = _judge(make_result(spans)[0], np.ones(1, dtype=bool), TILE, outer, BOUND)
    assert look.claimed.tolist() == [True] + [False] * (len(spans) - 1)
    assert look.near.tolist() == [True, True, False][:len(spans)]
    assert look.num_cut == num_cut


def test_spans_that_end_with_the_grid_are_not_cut_off():
    spans = [make_span((20.0, 100.0, 20.0), (180.0, 100.0, 20.0))]
    outer = (-60.0, -60.0, 185.0, 260.0)
    look = _judge(make_result(spans)[0], np.ones(1, dtype=bool), TILE, outer, (-60, -60, 185, 260))
    assert look.num_cut == 0
