# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_curve, make_index, make_wire, turn

from plc_inspect.core.evidence.edges import find_edges


def make_bridge(side_height, seed=9):
    """Return a deck 4 m wide below one side of a cable, with what lies beyond its edge."""
    rng = np.random.default_rng(seed)
    cable = make_wire((0.0, 0.0, 20.0), (60.0, 0.0, 20.0), c=120.0, per_metre=6.0)
    deck = np.column_stack([
        rng.uniform(0.0, 60.0, 2000), rng.uniform(0.05, 4.0, 2000), rng.normal(10.0, 0.03, 2000)
    ])
    rail = np.column_stack([
        rng.uniform(0.0, 60.0, 300), rng.uniform(0.3, 0.4, 300), rng.uniform(10.0, 11.0, 300)
    ])
    beside = np.column_stack([
        rng.uniform(0.0, 60.0, 2000), rng.uniform(-4.0, -0.05, 2000),
        rng.normal(side_height, 0.03, 2000),
    ])
    return np.vstack([cable, deck, rail, beside]), len(cable)


def measure(line, others):
    """Return how high a curve through a line's points is above an edge of other points."""
    points = np.vstack([line, others])
    curve = make_curve(points, np.arange(len(line)))
    wire = np.arange(len(points)) < len(line)
    return find_edges(points, make_index(points), [curve], wire)[0]


def make_straight(y, z, low=5.0, high=55.0):
    rng = np.random.default_rng(2)
    num = int(4.0 * (high - low))
    return np.column_stack([
        np.linspace(low, high, num), rng.normal(y, 0.01, num), rng.normal(z, 0.02, num)
    ])


def test_a_cable_over_the_edge_of_a_deck_is_of_a_bridge():
    points, num = make_bridge(2.0)
    # it sags by 3.8 m in the middle
    assert measure(points[:num], points[num:]) == pytest.approx(6.2, abs=0.1)


def test_a_cable_over_a_deck_that_goes_on_is_along_no_edge():
    points, num = make_bridge(10.0)
    assert np.isnan(measure(points[:num], points[num:]))


def test_a_line_that_crosses_an_edge_does_not_hang_over_it():
    points, num = make_bridge(2.0)
    others = turn(points[num:] - [30.0, 0.0, 0.0], np.radians(10.0), (30.0, 0.0, 0.0))
    assert np.isnan(measure(points[:num], others))


def test_a_scan_line_on_a_wall_is_below_the_edge_of_its_roof():
    points, num = make_bridge(-1.0)
    line = make_straight(0.0, 7.5)
    assert measure(line, points[num:]) == pytest.approx(-2.5, abs=0.05)


def test_the_rail_of_a_roof_is_as_high_above_its_edge_as_it_is():
    points, num = make_bridge(2.0)
    assert measure(make_straight(0.0, 11.1), points[num:]) == pytest.approx(1.1, abs=0.05)


def test_a_deck_is_known_in_scan_lines():
    points, num = make_bridge(2.0)
    deck = np.vstack([make_straight(y, 10.0) for y in (0.6, 0.85, 1.45, 1.7)])
    assert measure(points[:num], deck) == pytest.approx(6.2, abs=0.1)


def test_a_deck_that_was_seen_from_below_is_known_at_its_edge():
    points, num = make_bridge(2.0)
    rng = np.random.default_rng(4)
    below = np.column_stack([
        rng.uniform(0.0, 60.0, 3000), rng.uniform(1.4, 2.0, 3000), rng.normal(2.0, 0.03, 3000)
    ])
    assert measure(points[:num], np.vstack([points[num:], below])) == pytest.approx(6.2, abs=0.1)


def test_another_wire_beside_and_below_is_no_edge():
    other = make_straight(0.7, 9.0)
    assert np.isnan(measure(make_straight(0.0, 10.0), other))


def test_a_wire_above_and_beside_with_the_arm_that_carries_it_is_no_roof():
    rng = np.random.default_rng(6)
    other = make_straight(0.7, 11.4)
    arm = np.column_stack([
        rng.normal(8.0, 0.1, 80), rng.uniform(0.3, 1.3, 80), rng.normal(11.4, 0.05, 80)
    ])
    assert np.isnan(measure(make_straight(0.0, 10.0), np.vstack([other, arm])))


def test_without_curves_there_are_no_edges():
    points, _ = make_bridge(2.0)
    wire = np.zeros(len(points), dtype=bool)
    assert find_edges(points, make_index(points), [], wire).shape == (0,)
