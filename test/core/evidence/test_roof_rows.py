# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of a scanner on a roof are told from wires by the ground that is seen below."""

import numpy as np
import pytest
from toys import make_curve, make_sight, make_wire

from plc_inspect.core.evidence.roof_rows import are_roof_rows

EVERYWHERE = np.array([[-10.0, -10.0, 0.0], [20.0, 20.0, 0.0]])


def make_rows(num=4, apart=1.2, rise=0.0, turn=0.0, length=5.0):
    """Curves side by side, each higher by its rise and turned by an angle."""
    return [
        make_curve(make_wire(
            (0.0, apart * k, 6.0 + rise * k),
            (length * np.cos(turn * k), apart * k + length * np.sin(turn * k), 6.0 + rise * k),
            900.0, noise=0.01, per_metre=8.0,
        )) for k in range(num)
    ]


@pytest.mark.parametrize('rise', [0.0, 0.6])
@pytest.mark.parametrize('apart', [0.4, 1.4])
def test_rows_over_hidden_ground(apart, rise):
    rows = make_rows(apart=apart, rise=rise * apart)
    assert are_roof_rows(rows, make_sight(EVERYWHERE, seen=False)).all()
    assert not are_roof_rows(rows, make_sight(EVERYWHERE, seen=True)).any()


def test_one_at_the_edge_is_of_the_roof():
    """Ground is hidden below the first rows, and seen below half of the last."""
    sight = make_sight(EVERYWHERE, seen=False)
    place = make_rows()[3].position(np.array([0.0]))[0, :2]
    row = int((place[1] - sight.origin[1]) / sight.cell_size)
    column = int((0.0 - sight.origin[0]) / sight.cell_size)
    sight.view(sight.seen, (0, 0))[row, column : column + 3] = True
    assert are_roof_rows(make_rows(), sight).all()


@pytest.mark.parametrize('changes', [
    {'num': 1}, {'apart': 4.0}, {'turn': 0.5}, {'rise': 3.0}, {'apart': 0.0, 'rise': 0.4},
], ids=['alone', 'far', 'turned', 'steep', 'above each other'])
def test_what_is_no_roof(changes):
    assert not are_roof_rows(make_rows(**changes), make_sight(EVERYWHERE, seen=False)).any()


def test_beyond_the_grid_nothing_was_seen_and_none_is_none():
    rows = make_rows()
    assert are_roof_rows(rows, make_sight(EVERYWHERE + 500.0, seen=True)).all()
    assert are_roof_rows([], make_sight(EVERYWHERE)).shape == (0,)
