# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import hang, make_curve, make_index, make_wire

from plc_inspect.core.evidence.contacts import find_held


def touch(places, thick=0.03):
    """Return a cable of 60 m, what stands below it at some x, and which points are the cable's."""
    rng = np.random.default_rng(8)
    cable = make_wire((0.0, 0.0, 20.0), (60.0, 0.0, 20.0), c=120.0, per_metre=20.0)
    things = []
    for x in places:
        top = hang(np.array([x]), 60.0, 20.0, 20.0, 120.0)[0]
        side = rng.uniform(-thick, thick, (200, 2))
        things.append(np.column_stack([
            x + side[:, 0], side[:, 1], rng.uniform(top - 5.0, top, 200)
        ]))
    points = np.vstack([cable, *things])
    return points, np.arange(len(points)) < len(cable)


@pytest.mark.parametrize(('places', 'thick', 'held'), [
    ((5.0, 12.0, 19.0, 26.0), 0.03, True),
    ((5.0, 12.1, 18.8, 33.0, 40.0, 47.1), 0.03, True),  # one was not seen
    ((5.0, 12.0, 19.1, 33.0, 40.0, 54.2), 0.03, True),  # two were not seen
    ((5.0, 12.0, 26.0, 33.0, 47.0), 0.03, False),  # two bays alone
    ((5.0, 15.0, 25.0, 35.0, 45.0), 0.03, False),  # posts of an insulated cable
    ((5.0, 12.0, 19.0), 0.03, False),  # too few to be sure
    ((5.0, 8.0, 15.0, 26.0, 29.0), 0.03, False),  # treetops
    ((5.0, 12.0, 19.0, 26.0), 1.5, False),  # crowns
    ((), 0.03, False),
])
def test_what_is_touched_at_regular_intervals_is_no_conductor(places, thick, held):
    points, wire = touch(places, thick)
    curve = make_curve(points, np.flatnonzero(wire))
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [held]


@pytest.mark.parametrize(('spacing', 'held'), [(6.5, True), (11.0, False)])
def test_posts_are_told_from_the_pipe_that_they_bear(spacing, held):
    rng = np.random.default_rng(8)
    around = rng.uniform(0.0, 2.0 * np.pi, 6000)
    pipe = np.column_stack([
        rng.uniform(0.0, 40.0, 6000), 0.25 * np.cos(around), 5.0 + 0.25 * np.sin(around)
    ])
    posts = [
        np.column_stack([rng.uniform(x - 0.1, x + 0.1, 200), rng.uniform(-0.1, 0.1, 200),
                         rng.uniform(0.0, 5.0, 200)])
        for x in np.arange(2.0, 40.0, spacing)
    ]
    points = np.vstack([pipe, *posts])
    top = np.flatnonzero((pipe[:, 2] > 5.15) & (np.abs(pipe[:, 1]) < 0.15))
    curve = make_curve(points, top)
    wire = np.zeros(len(points), dtype=bool)
    wire[top] = True
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [held]


@pytest.mark.parametrize(('side', 'spacing', 'held'), [
    (1.0, 6.5, True), (-1.0, 6.5, True), (1.0, 11.0, False),
])
def test_beams_beside_a_pipe_hold_it_as_brackets_below_do(side, spacing, held):
    rng = np.random.default_rng(8)
    pipe = rng.normal((0.0, 0.0, 5.0), (0.0, 0.1, 0.1), (1500, 3))
    pipe[:, 0] = rng.uniform(0.0, 40.0, 1500)
    beams = [
        np.column_stack([rng.uniform(x - 0.1, x + 0.1, 80), side * rng.uniform(0.2, 1.6, 80),
                         rng.uniform(4.9, 5.1, 80)])
        for x in np.arange(2.0, 40.0, spacing)
    ]
    points = np.vstack([pipe, *beams])
    wire = np.arange(len(points)) < len(pipe)
    curve = make_curve(points, np.flatnonzero(wire))
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [held]


@pytest.mark.parametrize(('spacing', 'held'), [(6.2, True), (11.0, False)])
def test_frames_of_a_rack_bear_all_that_runs_along_it(spacing, held):
    # three pieces of pipes 1 m apart, none over more than two of the frames, seen with few points
    rng = np.random.default_rng(8)
    ends = [(2.0, 13.0, -1.0), (12.0, 24.0, 0.0), (22.0, 33.0, 1.0)]
    pipes = [
        np.column_stack([rng.uniform(low, high, 80), np.full(80, y), np.full(80, 5.0)])
        + rng.normal(0.0, 0.03, (80, 3)) for low, high, y in ends
    ]
    frames = [
        np.column_stack([rng.normal(x, 0.05, 8), np.r_[-1.8, 1.8, rng.uniform(-1.9, 1.9, 6)],
                         np.r_[4.2, 4.2, np.full(6, 4.6)]])
        for x in np.arange(3.0, 33.0, spacing)
    ]
    points = np.vstack([*pipes, *frames])
    wire = np.arange(len(points)) < 240
    curves = [make_curve(points, np.arange(80 * k, 80 * k + 80)) for k in range(3)]
    found = find_held(points, make_index(points), curves, wire, 8.0, [3] * 3)
    assert found.tolist() == [held] * 3


def test_wires_beside_that_are_seen_in_scan_lines_hold_nothing():
    points, wire = touch(())
    cable = points[wire]
    seen = cable[np.abs(cable[:, 0] / 3.0 % 1.0 - 0.5) < 0.02]
    points = np.vstack([points, seen + np.array((0.0, 0.6, 0.0)),
                        seen + np.array((0.0, 1.0, 0.0))])
    curve = make_curve(points, np.arange(len(cable)))
    wire = np.arange(len(points)) < len(cable)
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [False]


def test_another_line_below_that_is_seen_in_scan_lines_holds_nothing():
    points, wire = touch(())
    cable = points[wire]
    below = cable[(np.round(cable[:, 0] / 3.0 - 0.5) - (cable[:, 0] / 3.0 - 0.5)).__abs__() < 0.05]
    points = np.vstack([points, below - [0.0, 0.0, 0.5]])
    curve = make_curve(points, np.arange(len(cable)))
    wire = np.arange(len(points)) < len(cable)
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [False]


def test_a_line_above_a_row_of_trees_at_even_distances_is_kept():
    points, wire = touch(())
    rng = np.random.default_rng(4)
    trees = []
    for x in range(6, 55, 6):
        top = hang(np.array([float(x)]), 60.0, 20.0, 20.0, 120.0)[0] - 0.3
        down = 6.0 * rng.uniform(0.0, 1.0, 900) ** 0.5
        around, out = rng.uniform(0.0, 2.0 * np.pi, 900), 0.25 * down * rng.uniform(0.5, 1.0, 900)
        trees.append(np.column_stack([
            x + out * np.cos(around), out * np.sin(around), top - down
        ]))
    points = np.vstack([points, *trees])
    wire = np.arange(len(points)) < wire.sum()
    curve = make_curve(points, np.flatnonzero(wire))
    assert find_held(points, make_index(points), [curve], wire, 8.0, [3]).tolist() == [False]


def test_without_curves_nothing_is_held():
    points, wire = touch((5.0, 12.0))
    assert find_held(points, make_index(points), [], wire, 8.0, []).tolist() == []
