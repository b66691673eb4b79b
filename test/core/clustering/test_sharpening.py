# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Wires of a rack are dots along the direction in which all of them lie sharpest."""

import numpy as np
import pytest

from plc_inspect.core.clustering.sharpening import find_dots, sharpen

HALF = 10.0


def make_window(turn=0.0, rise=0.0, bend=0.0, num=60, noise=0.045, seed=0):
    """Return points of three wires about a curve that runs askew, and the wire of each."""
    rng = np.random.default_rng(seed)
    wire = np.repeat(np.arange(3), num)
    x = rng.uniform(-HALF, HALF, len(wire))
    y = turn * x + rng.normal(0.0, noise, len(x))
    w = 0.33 * (wire - 1) + rise * x + 0.5 * bend * x * x + rng.normal(0.0, noise, len(x))
    return x, y, w, wire


@pytest.mark.parametrize(('turn', 'rise', 'bend'), [
    (0.0, 0.0, 0.0), (0.015, 0.03, 0.004), (-0.01, -0.06, 0.008), (0.0, 0.05, -0.002),
])
def test_points_are_as_sharp_as_they_scatter(turn, rise, bend):
    for seed in range(5):
        x, y, w, wire = make_window(turn, rise, bend, seed=seed)
        y, w = sharpen(x, y, w, 0.002)
        for k in range(3):
            assert y[wire == k].std() < 0.075
            assert w[wire == k].std() < 0.065


def test_each_wire_is_a_dot():
    for seed in range(5):
        x, y, w, wire = make_window(0.01, 0.03, 0.003, seed=seed)
        dot = find_dots(x, *sharpen(x, y, w, 0.0), HALF)
        assert dot.max() == 2
        for k in range(3):
            own = np.bincount(dot[(wire == k) & (dot >= 0)], minlength=3)
            assert own.max() > 0.9 * (wire == k).sum()


def test_what_is_at_one_place_along_is_no_dot():
    """A pole beside the wires has more points than they, in one piece."""
    x, y, w, _ = make_window(num=40)
    rng = np.random.default_rng(1)
    pole = rng.uniform(-1.5, 1.5, 200)
    x = np.concatenate([x, rng.normal(4.0, 0.05, 200)])
    y = np.concatenate([y, rng.normal(0.35, 0.05, 200)])
    dot = find_dots(x, y, np.concatenate([w, pole]), HALF)
    assert dot.max() == 2
    assert np.mean(dot[-200:] < 0) > 0.9


def test_few_points_are_no_dot():
    x, y, w, _ = make_window(num=2)
    assert (find_dots(x, y, w, HALF) == -1).all()
    nothing = np.zeros(0)
    assert len(find_dots(nothing, nothing, nothing, HALF)) == 0
