# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Wires told by their shape: rows of them, where they hang free, and straight pieces."""

import numpy as np
import pytest

from plc_inspect.core.hazards.wires import find_free, find_wires, ROW_LENGTH, tell_thin


def make_piece(direction, length=3.0, noise=0.03, num=40):
    direction = np.array(direction, float) / np.linalg.norm(direction)
    along = np.linspace(-length / 2, length / 2, num)[:, None]
    return along * direction + np.random.default_rng(1).normal(0.0, noise, (num, 3))


@pytest.mark.parametrize('direction', [(1, 0, 0), (0, 1, 0), (1, 1, 0.5), (1, -2, -1)])
def test_thin_pieces_tell_thin_in_any_direction(direction):
    assert tell_thin(make_piece(direction), np.zeros(40, np.int64))[1].all()


@pytest.mark.parametrize('piece', [
    make_piece((0, 0, 1)), make_piece((1, 0, 0), noise=0.3), make_piece((1, 0, 0), length=1.0),
    make_piece((1, 0, 0), num=9),
], ids=['upright', 'thick', 'short', 'few'])
def test_others_are_not(piece):
    assert not tell_thin(piece, np.zeros(len(piece), np.int64))[1].any()


def test_each_thing_by_itself():
    thin, thick = make_piece((0, 1, 0)), make_piece((0, 1, 0), noise=0.4) + 20.0
    order = np.random.default_rng(2).permutation(80)
    points, thing = np.vstack([thin, thick])[order], np.repeat([0, 1], 40)[order]
    for told in tell_thin(points, thing):
        assert told.tolist() == [True, False]
    assert tell_thin(np.zeros((0, 3)), np.zeros(0, np.int64))[0].shape == (0,)


def test_few_points_are_thin_and_not_straight():
    thin, straight = tell_thin(make_piece((0, 0, 1), num=4), np.zeros(4, np.int64))
    assert thin.all()
    assert not straight.any()


def make_row(offsets, length=30.0, noise=0.05, per_metre=6.0, seed=0):
    """Make wires beside each other, in the frame of a span."""
    rng = np.random.default_rng(seed)
    num = int(length * per_metre)
    return np.vstack([
        np.column_stack([rng.uniform(0.0, length, num), np.full((num, 2), offset)])
        + np.column_stack([np.zeros(num), rng.normal(0.0, noise, (num, 2))])
        for offset in offsets
    ])


@pytest.mark.parametrize('gap', [0.3, 0.35, 0.5, 0.6])
@pytest.mark.parametrize('upright', [False, True])
def test_wires_close_to_each_other_are_found(gap, upright):
    offsets = [(0.0, k * gap) if upright else (k * gap, 0.0) for k in range(3)]
    row = make_row(offsets)
    found = np.zeros(len(row), dtype=bool)
    for wire in find_wires(row):
        found[wire] = True
    assert found.mean() > 0.85


@pytest.mark.parametrize('upright', [False, True])
def test_a_row_is_found_whose_wires_a_drifting_map_has_doubled(upright):
    offsets = [(0.45 * k + shift, 0.0) for k in range(4) for shift in (0.0, 0.2)]
    row = make_row([offset[::-1] if upright else offset for offset in offsets], noise=0.03)
    found = np.zeros(len(row), dtype=bool)
    for wire in find_wires(row):
        found[wire] = True
    assert found.mean() > 0.85


def test_a_short_row_and_a_strip_of_a_wall_are_none():
    short = make_row([(0.0, 0.0), (0.3, 0.0), (0.6, 0.0)], length=ROW_LENGTH - 3.0, noise=0.06)
    assert not find_wires(short)
    rng = np.random.default_rng(4)
    wall = np.column_stack([
        rng.uniform(0.0, 30.0, 4000), rng.normal(0.0, 0.02, 4000), rng.uniform(-3.0, 0.0, 4000),
    ])
    assert not find_wires(wall)


@pytest.mark.parametrize('seed', range(5))
def test_hardly_any_foliage_is_a_wire(seed):
    rng = np.random.default_rng(seed)
    for num in (200, 800, 3000):
        crown = rng.uniform([0.0, -3.0, -3.0], [40.0, 3.0, 0.0], (num, 3))
        taken = np.unique(np.concatenate([np.zeros(0, np.int64), *find_wires(crown)]))
        assert len(taken) < 0.12 * num
        assert not len(taken) or num < 3000


def test_a_wire_hangs_free_beside_others_and_not_in_foliage():
    metre = np.repeat(np.arange(5), 10)
    off = np.zeros((50, 2))
    assert find_free(metre, off, 0.3)[1] == 1.0
    level = np.column_stack([np.full(50, 0.6), np.full(50, 0.05)])
    both = np.concatenate([metre, metre])
    for others in (level, level[:, ::-1]):
        free, share = find_free(both, np.vstack([off, others]), 0.3, beside=True)
        assert share == 1.0
        assert free.all()
        assert not find_free(both, np.vstack([off, others]), 0.3)[0].any()
    around = np.column_stack([np.full(50, 0.4), np.full(50, 0.4)])
    around[metre == 4] = 5.0
    free, share = find_free(both, np.vstack([off, around]), 0.3, beside=True)
    assert free.tolist() == [False] * 4 + [True]
    assert share == pytest.approx(0.2)
    assert find_free(np.zeros(0, np.int64), np.zeros((0, 2)), 0.3, beside=True)[1] == 0.0
