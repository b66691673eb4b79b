# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What lies on one surface, or is held together by bracing, and what only hangs side by side."""

import numpy as np
import pytest
from toys import make_curve, make_index, make_wire

from plc_inspect.core.evidence.ties import SHEET_WIDTH, Ties

LENGTH = 30.0


def lay_surface(width, seed, upright=False, per_metre=12.0):
    """Return points on a pipe, tray or net that sags, and those on three lines along it."""
    rng = np.random.default_rng(seed)
    x, across = rng.uniform((0.0, -width / 2), (LENGTH, width / 2), (int(per_metre * LENGTH), 2)).T
    noise = rng.normal(0.0, 0.02, len(x))
    sag = 0.0016 * x * (x - LENGTH)
    points = np.column_stack([x, noise, 12.0 + sag + across] if upright else
                             [x, across, 12.0 + sag + noise])
    lines = [np.flatnonzero(np.abs(across - place) < 0.1) for place in (-0.25, 0.0, 0.25)]
    return points, lines


def tell(points, lines, **masks):
    """Tell which of some lines are tied; all are asked of and sure and none hangs, if not told."""
    own = np.zeros(len(points), dtype=bool)
    own[np.concatenate(lines)] = True
    curves = [make_curve(points, line, tolerance=0.1) for line in lines]
    every = np.ones(len(lines), dtype=bool)
    masks = {'asked': every, 'sure': every, 'hung': ~every, **masks}
    return Ties(points, make_index(points)).find(curves, own, **masks).tolist()


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('upright', [False, True])
def test_lines_on_one_surface_are_tied(upright, seed):
    points, lines = lay_surface(0.8, seed, upright)
    assert tell(points, lines) == [True] * 3
    # a band of wires that strips lay askew, as these surely hang
    assert tell(points, lines, hung=np.ones(3, dtype=bool)) == [False] * 3
    assert tell(points, lines, hung=np.array([True, False, True])) == [True] * 3


@pytest.mark.parametrize('seed', range(3))
def test_what_is_narrower_may_be_a_conductor_that_drift_doubled(seed):
    points, lines = lay_surface(0.6 * SHEET_WIDTH, seed)
    assert tell(points, [np.sort(np.concatenate(lines)), lines[1]]) == [False] * 2


def lay_wires(places, noise, seed):
    """Return the points of wires beside each other, as far aside as given at their ends."""
    rng = np.random.default_rng(seed)
    parts = []
    for number, (first, last) in enumerate(places):
        wire = make_wire((0.0, first, 12.0), (LENGTH, last, 12.0), 600.0, noise=noise,
                         per_metre=25.0, seed=10 * seed + number)
        wire[:, 1] += rng.normal(0.0, noise, len(wire))
        parts.append(wire)
    ends = np.cumsum([0, *(len(part) for part in parts)])
    return np.vstack(parts), [np.arange(*ends[k : k + 2]) for k in range(len(parts))]


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('places', [
    [(0.25 * k, 0.25 * k) for k in range(4)],
    [(0.05 * k, 0.35 * k) for k in range(5)],
], ids=['cables', 'fan'])
def test_wires_side_by_side_are_not_tied(places, seed):
    points, lines = lay_wires(places, 0.03, seed)
    assert not any(tell(points, lines))


@pytest.mark.parametrize('seed', range(3))
def test_other_wires_of_a_fan_tie_no_two_of_them(seed):
    points, lines = lay_wires([(0.15 * k, 0.35 * k) for k in range(5)], 0.02, seed)
    assert not any(tell(points, [lines[0], lines[4]]))


def brace(deep, seed, length=LENGTH):
    """Return two lines a metre above each other, with something between them."""
    points, lines = lay_wires([(0.0, 0.0), (0.0, 0.0)], 0.02, seed)
    points[lines[1], 2] += 1.0
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, length, 1500)
    between = np.column_stack([
        x, rng.normal(0.0, deep, len(x)),
        np.interp(x, points[lines[0], 0], points[lines[0], 2]) + rng.uniform(0.0, 1.0, len(x)),
    ])
    return np.vstack([points, between]), lines


@pytest.mark.parametrize(('deep', 'length', 'sure', 'expected'), [
    (0.02, LENGTH, True, True), (0.4, LENGTH, True, True),
    (0.02, LENGTH, False, True), (0.4, LENGTH, False, False),
])
def test_what_may_be_of_a_crown_ties_only_by_what_is_flat(deep, length, sure, expected):
    points, lines = brace(deep, 1, length)
    found = tell(points, lines, asked=np.array([True, False]), sure=np.array([True, sure]))
    assert found == [expected] * 2


def test_what_may_be_of_a_crown_ties_only_along_most_of_a_line():
    points, lines = brace(0.02, 2)
    short = lines[1][points[lines[1], 0] < 0.4 * LENGTH]
    own = np.array([True, False])
    assert tell(points, [lines[0], short], asked=own, sure=own) == [False] * 2
    assert tell(points, [lines[0], short]) == [True] * 2


def test_only_what_is_asked_of_is_compared():
    points, lines = brace(0.02, 3)
    assert tell(points, lines, asked=np.zeros(2, dtype=bool)) == [False] * 2


def test_no_two_curves_are_compared_twice():
    points, lines = lay_surface(0.8, 0)
    curves = [make_curve(points, line, tolerance=0.1) for line in lines]
    ties = Ties(points, make_index(points))
    own, every, none = np.zeros(len(points), dtype=bool), np.ones(3, dtype=bool), np.zeros(3, bool)

    def find(ties, chosen, asked):
        own_curves = [curves[k] for k in chosen]
        num = len(chosen)
        return ties.find(own_curves, own, asked[:num], every[:num], none[:num]).tolist()

    assert find(ties, [0, 1, 2], none) == [False] * 3  # nothing was asked
    assert find(ties, [0, 1], every) == [True] * 2
    later = ties.copy()
    assert find(ties, [0, 1], every) == [False] * 2
    assert find(later, [0, 1, 2], every) == [True] * 3  # the third was compared with none
    assert find(later, [0, 1, 2], every) == [False] * 3
