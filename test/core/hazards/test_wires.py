# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Pieces that are thin and straight."""

import numpy as np
import pytest

from plc_inspect.core.hazards.wires import are_straight


def make_piece(direction, length=3.0, noise=0.03, num=40):
    direction = np.array(direction, float) / np.linalg.norm(direction)
    along = np.linspace(-length / 2, length / 2, num)[:, None]
    return along * direction + np.random.default_rng(1).normal(0.0, noise, (num, 3))


@pytest.mark.parametrize('direction', [(1, 0, 0), (0, 1, 0), (1, 1, 0.5), (1, -2, -1)])
def test_thin_pieces_are_straight_in_any_direction(direction):
    assert are_straight(make_piece(direction), np.zeros(40, np.int64)).all()


@pytest.mark.parametrize('piece', [
    make_piece((0, 0, 1)), make_piece((1, 0, 0), noise=0.3), make_piece((1, 0, 0), length=1.0),
    make_piece((1, 0, 0), num=9),
], ids=['upright', 'thick', 'short', 'few'])
def test_others_are_not(piece):
    assert not are_straight(piece, np.zeros(len(piece), np.int64)).any()


def test_each_thing_by_itself():
    thin, thick = make_piece((0, 1, 0)), make_piece((0, 1, 0), noise=0.4) + 20.0
    order = np.random.default_rng(2).permutation(80)
    points, thing = np.vstack([thin, thick])[order], np.repeat([0, 1], 40)[order]
    assert are_straight(points, thing).tolist() == [True, False]
    assert are_straight(np.zeros((0, 3)), np.zeros(0, np.int64)).shape == (0,)
