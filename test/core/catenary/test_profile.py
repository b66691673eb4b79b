# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0


import numpy as np
import pytest
from toys import hang, make_curve, make_ground, make_index, make_wire

from plc_inspect.core.catenary.profile import (
    measure_distances,
    profile_curve,
    profile_row,
)


def make_line(parts=((0.0, 1.0),), per_metre=8.0, length=100.0):
    return make_wire((0.0, 0.0, 20.0), (length, 0.0, 20.0), per_metre=per_metre, parts=parts)


def profile(points, curve, **changes):
    return profile_curve(points, make_index(points), curve, curve.low, curve.high, **changes)


def test_toy_case_by_hand():
    x = np.arange(20) + 0.5
    line = np.column_stack([x, np.zeros(20), hang(x, 20.0, 10.0, 10.0, 500.0)])
    # in metre 5: one point 0.12 m beside, in the shell of 0.1 to 0.16 m; one 0.3 m above
    extra = line[[5, 5]] + np.array([[0.0, 0.12, 0.0], [0.0, 0.0, 0.3]])
    points = np.vstack([line, extra])
    curve = make_curve(points, np.arange(20))
    found = profile_curve(points, make_index(points), curve, -0.0 + curve.low - 0.5,
                          curve.high + 0.5)
    assert found.core.tolist() == [1] * 20
    assert found.shell.sum() == 1
    assert found.chosen.tolist() == list(range(20))
    assert found.coverage == 1.0
    assert found.crowding == 0.0


def test_counts_against_brute_force():
    sheet = make_ground((0, -3), (100, 3), 20.0) + np.array([0, 0, 18.5])
    points = np.vstack([make_line(), sheet])
    curve = make_curve(points, np.arange(800))
    found = profile(points, curve)
    x, y = curve.local(points)
    off = np.hypot(
        y, (points[:, 2] - curve.fit.height(x)) / np.hypot(1.0, curve.fit.slope(x))
    )
    inside = (x >= curve.low) & (x < curve.low + len(found.core))
    expected = np.flatnonzero(inside & (off <= curve.tolerance))
    assert len(np.setxor1d(found.chosen, expected)) <= 2
    assert found.core.sum() == len(found.chosen)
    shell = inside & (off > curve.tolerance) & (off <= 1.6 * curve.tolerance)
    assert abs(int(found.shell.sum()) - int(shell.sum())) <= 2


def test_coverage_is_the_share_of_metres_with_points():
    points = make_line(((0.0, 0.3), (0.7, 1.0)))
    curve = make_curve(points)
    assert profile(points, curve).coverage == pytest.approx(0.6, abs=0.03)


def test_a_wire_is_free_and_a_line_drawn_on_a_roof_is_not():
    wire = make_line()
    assert profile(wire, make_curve(wire)).crowding == 0.0
    roof = make_ground((0, -5), (100, 5), 40.0) + np.array([0, 0, 10.0])
    ridge = np.flatnonzero(np.abs(roof[:, 1]) < 0.08)
    assert profile(roof, make_curve(roof, ridge)).crowding > 0.9


def test_ignored_points_do_not_crowd():
    first = make_line()
    second = make_line() + np.array([0.0, 0.13, 0.0])
    points = np.vstack([first, second])
    curve = make_curve(points, np.arange(len(first)))
    ignore = np.arange(len(points)) >= len(first)
    assert profile(points, curve).crowding > 0.5
    assert profile(points, curve, ignore=ignore).crowding < 0.1


@pytest.mark.parametrize('constant', [15.0, 200.0, 1500.0])
def test_distances_of_the_profile_are_those_to_the_curve(constant):
    wire = make_wire((0.0, 0.0, 20.0), (30.0, 8.0, 24.0), c=constant)
    curve = make_curve(wire)
    points = np.vstack([wire, wire + np.array([0.0, 0.0, 3.0])])[
        np.random.default_rng(0).permutation(2 * len(wire))
    ]
    *_, chosen, distance = profile_row(
        points, make_index(points).grid, curve.row, curve.low, curve.high, 1.0,
        np.zeros(0, dtype=bool),
    )
    assert len(chosen) > 0.9 * len(wire)
    assert (np.diff(chosen) > 0).all()
    np.testing.assert_allclose(
        distance, measure_distances(points, curve, chosen), rtol=0, atol=1e-5
    )
