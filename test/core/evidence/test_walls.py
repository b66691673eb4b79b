# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import hang, make_curve, make_index, make_wire

from plc_inspect.core.evidence.walls import Walls

LENGTH, TOP = 24.0, 18.0


def scan(low, high, rng, share=1.0, step=0.2):
    """Return scan lines between two heights [m] on a facade, along pillars of a share of it."""
    parts = []
    for z in np.arange(low, high, step):
        x = rng.uniform(0.0, LENGTH, 700)
        x = x[(x % 2.4) < 2.4 * share]
        parts.append(np.column_stack([x, np.zeros(len(x)), z + hang(x, LENGTH, 0.0, 0.0, 300.0)]))
    points = np.concatenate(parts)
    return points + rng.normal(0.0, 0.02, points.shape)


def find(below, seed=3):
    """Tell whether a curve that hangs at the top lies on a wall, with other points below it."""
    line = make_wire((0.0, 0.0, TOP), (LENGTH, 0.0, TOP), c=300.0, per_metre=8.0)
    points = np.vstack([line, *below])
    curve = make_curve(points, np.arange(len(line)))
    return bool(Walls(points, make_index(points)).find([curve])[0])


def test_a_scan_line_on_a_facade_with_windows_is_on_a_wall():
    rng = np.random.default_rng(3)
    parapet = scan(TOP - 1.4, TOP - 0.1, rng)
    pillars = [scan(foot, foot + 3.4, rng, share=0.35) for foot in (0.0, 4.0, 8.0, 13.0)]
    assert find([parapet, *pillars])


@pytest.mark.parametrize('spacing', [0.2, 0.35, 0.6])
def test_a_rack_of_wires_is_no_wall(spacing):
    wires = [
        make_wire((0.0, 0.0, TOP - spacing * n), (LENGTH, 0.0, TOP - spacing * n), c=300.0,
                  per_metre=8.0, seed=n)
        for n in range(1, 7)
    ]
    rng = np.random.default_rng(4)
    poles = [
        np.column_stack([rng.normal(x, 0.1, 900), rng.normal(0.0, 0.1, 900),
                         rng.uniform(0.0, TOP, 900)])
        for x in (0.2, LENGTH - 0.2)
    ]
    assert not find([*wires, *poles])


def test_wires_over_a_hedge_are_on_no_wall():
    rng = np.random.default_rng(5)
    hedge = np.column_stack([
        rng.uniform(0.0, LENGTH, 30000), rng.uniform(-1.5, 1.5, 30000),
        rng.uniform(TOP - 5.0, TOP - 0.8, 30000),
    ])
    assert not find([hedge])
    assert not find([])
