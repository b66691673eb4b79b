# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.spatial import cKDTree

from plc_inspect.config import Settings
from plc_inspect.core.extraction.dust import (
    _count_near,
    _find_fewest,
    BALL,
    CHANCE,
    find_dust,
    find_lone,
    LEFT,
    REACH,
)
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import HazardKind

LOW, HIGH = np.array([0.0, -8.0, 4.0]), np.array([40.0, 8.0, 18.0])
WAY = np.column_stack((np.linspace(-5.0, 45.0, 26), np.zeros(26), np.full(26, 11.0)))


def make_air(density, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(LOW, HIGH, (int(density * np.prod(HIGH - LOW)), 3))


def make_twig(place, num=8, length=0.25):
    rng = np.random.default_rng(2)
    return place + np.column_stack((
        rng.normal(0.0, 0.01, (num, 2)), np.linspace(0.0, length, num),
    ))


def make_crown(place, num=4000, radius=2.0):
    rng = np.random.default_rng(3)
    way = rng.normal(size=(num, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return place + way * radius * rng.uniform(0.6, 1.0, (num, 1))


@pytest.mark.parametrize('density', [0.05, 0.3, 1.0, 4.0])
def test_returns_of_the_air_are_told(density):
    air = make_air(density)
    assert find_dust(air, WAY).mean() > 0.99


@pytest.mark.parametrize('density', [0.05, 0.3, 1.0, 4.0])
def test_what_is_there_is_kept_in_dust_too(density):
    twig, crown = make_twig(np.array([20.0, 2.0, 9.0])), make_crown(np.array([30.0, -4.0, 6.0]))
    points = np.concatenate((twig, crown, make_air(density)))
    found = find_dust(points, WAY)
    assert not found[:len(twig)].any()
    assert found[len(twig):len(twig) + len(crown)].mean() < 0.3  # the thinnest of it
    assert found[len(twig) + len(crown):].mean() > 0.9  # but for what lies in the crown


def test_in_clear_air_every_return_is_kept():
    few = np.array([[20.0, 2.0, 9.0], [20.3, 2.0, 9.1], [20.6, 2.1, 9.0]])
    crown = make_crown(np.array([30.0, -4.0, 6.0]))
    assert not find_dust(few, WAY).any()
    assert not find_dust(np.concatenate((few, crown)), WAY).any()


def test_within_a_crown_every_return_is_kept():
    rng = np.random.default_rng(4)
    crown = rng.uniform((10.0, -4.0, 7.0), (20.0, 4.0, 15.0), (50_000, 3))  # about the lidar
    assert not find_dust(crown, WAY).any()


def test_only_near_the_lidar_returns_are_doubted():
    air = make_air(0.5)
    assert not find_dust(air, WAY + np.array([0.0, 40.0, 0.0])).any()
    assert not find_dust(air, np.zeros((0, 3))).any()
    half = find_dust(air, WAY[WAY[:, 0] < 10.0])
    assert half[air[:, 0] < 10.0].mean() > 0.99
    assert not half[air[:, 0] > 24.0].any()


def test_few_points_order_and_input():
    assert find_dust(np.zeros((0, 3)), WAY).shape == (0,)
    assert not find_dust(np.full((1, 3), 9.0), WAY).any()
    air = np.concatenate((make_air(0.5), make_twig(np.array([20.0, 2.0, 9.0]))))
    before, order = air.copy(), np.random.default_rng(5).permutation(len(air))
    found = find_dust(air, WAY)
    np.testing.assert_array_equal(find_dust(air[order], WAY), found[order])
    np.testing.assert_array_equal(air, before)


def test_neighbours_are_those_of_a_tree():
    rng = np.random.default_rng(6)
    points, others = rng.uniform(-3.0, 4.0, (400, 3)), rng.uniform(-2.0, 3.0, (900, 3))
    wanted = cKDTree(others).query_ball_point(points, 0.7, return_length=True)
    np.testing.assert_array_equal(_count_near(points, others, 0.7, 1000), wanted)
    np.testing.assert_array_equal(_count_near(points, others, 0.7, 3), np.minimum(wanted, 3))
    far = _count_near(points, others + 100.0, 0.7, 3)
    assert not far.any()


def test_chance_is_that_of_poisson():
    mean = np.array([0.001, 0.03, 0.5, 3.0])
    rng = np.random.default_rng(7)
    found = _find_fewest(mean / BALL, CHANCE)
    for value, least in zip(mean.tolist(), found.tolist(), strict=True):
        drawn = rng.poisson(value, 2_000_000)
        assert (drawn >= least).mean() < 5.0 * CHANCE
    assert Settings().hazards.group_distance > REACH


def test_dust_raises_no_hazard_and_hides_none():
    sample = make_sample()
    clean = Pipeline(Settings()).run(sample)
    (tree,) = clean.hazards
    span = max(clean.spans, key=lambda item: np.linalg.norm(item.lowest - tree.position))
    along = np.linspace(0.0, span.length, 40)
    way = span.positions(along) + np.array([0.0, 0.0, 3.0])
    rng = np.random.default_rng(8)
    # a return in two cubic metres of a tube of 8 m, and a twig below the wire
    air = np.repeat(way, 60, axis=0)
    air = air + rng.uniform(-8.0, 8.0, air.shape)
    twig = make_twig(span.positions(np.array([span.length / 2.0]))[0] - (0.0, 0.0, 1.3))

    def count(points, flown=None):
        result = Pipeline(Settings(), None, flown).run(points)
        near = [
            item for item in result.hazards if item.kind is HazardKind.VEGETATION
            and np.linalg.norm(item.position - twig.mean(axis=0)) < 0.5
        ]
        return len(result.hazards), len(near)

    num, _ = count(sample)
    assert count(np.concatenate((sample, twig)), way) == (num + 1, 1)
    dusty = np.concatenate((sample, twig, air))
    assert count(dusty)[0] > num + 3  # without knowing where the lidar was
    assert count(dusty, way) == (num + 1, 1)


def make_strung(num_per_metre, seed=9):
    """Return a wire that hangs in the air about the way."""
    rng = np.random.default_rng(seed)
    along = np.sort(rng.uniform(LOW[0], HIGH[0], int(num_per_metre * (HIGH - LOW)[0])))
    return np.column_stack((along, np.full(len(along), 2.0), 8.0 + (along - 20.0) ** 2 / 900.0))


@pytest.mark.parametrize('density', [0.3, 1.0, 4.0])
def test_a_wire_in_the_air_is_kept_and_the_air_is_not(density):
    wire, air = make_strung(6.0), make_air(density)
    lone = find_lone(np.concatenate((wire, air)), WAY)
    assert lone[: len(wire)].mean() < 0.2
    # as many as have nothing within 0.2 m, but for those at the edge of the air
    assert lone[len(wire) :].mean() > 0.85 * np.exp(-0.0335 * density)


@pytest.mark.parametrize('density', [9.0, 30.0])
def test_of_dense_air_few_returns_stay(density):
    wire, air = make_strung(60.0), make_air(density)
    lone = find_lone(np.concatenate((wire, air)), WAY)
    assert lone[: len(wire)].mean() < 0.02
    inner = ((air > LOW + 4.0) & (air < HIGH - 4.0)).all(axis=1)  # of even density all about
    assert (inner & ~lone[len(wire) :]).sum() < 1.1 * LEFT * np.prod(HIGH - LOW - 8.0)


def test_as_few_stay_as_poisson_says():
    density = np.array([0.1, 1.0, 4.0, 9.0, 30.0, 100.0])
    rng = np.random.default_rng(11)
    for value, fewest in zip(
        density.tolist(), _find_fewest(density, LEFT / density).tolist(), strict=True
    ):
        drawn = rng.poisson(value * BALL, 1_000_000)
        assert value * (drawn >= fewest).mean() < 1.02 * LEFT
        assert fewest == 1 or value * (drawn >= fewest - 1).mean() > 0.98 * LEFT


@pytest.mark.parametrize('num_per_metre', [1.0, 2.5, 6.0])
def test_wires_in_clear_air_are_kept_whole(num_per_metre):
    wires = [make_strung(num_per_metre, n) + np.array([0.0, 0.7 * n - 5.0, 0.0]) for n in range(8)]
    assert not find_lone(np.concatenate(wires), WAY).any()


def test_nothing_is_lone_far_from_the_lidar_or_where_nobody_knows_its_way():
    air = np.concatenate((make_air(1.0), np.full((3, 3), np.nan)))
    assert not find_lone(air, np.zeros((0, 3))).any()
    assert not find_lone(air, WAY + np.array([0.0, 40.0, 0.0])).any()
    assert find_lone(np.zeros((0, 3)), WAY).shape == (0,)
    before = air.copy()
    assert not find_lone(air, WAY)[-3:].any()
    np.testing.assert_array_equal(air, before)


def test_lines_are_found_in_dust():
    sample = make_sample()
    clean = Pipeline(Settings()).run(sample)
    way = np.column_stack((np.linspace(0.0, 120.0, 60), np.full(60, 4.0), np.full(60, 13.0)))
    rng = np.random.default_rng(10)
    air = np.repeat(way, 600, axis=0)
    reach = rng.uniform(1.0, 10.0, (len(air), 1))
    turn = rng.normal(size=air.shape)
    air = air + reach * turn / np.linalg.norm(turn, axis=1, keepdims=True)
    dusty = np.concatenate((sample, air[air[:, 2] > 0.5]))
    assert len(Pipeline(Settings()).run(dusty).spans) < len(clean.spans)
    result = Pipeline(Settings(), None, way).run(dusty)
    assert len(result.spans) == len(clean.spans) == 6
    for span in result.spans:
        middle = span.positions(np.array([span.length / 2.0]))[0]
        known = [item.positions(np.array([item.length / 2.0]))[0] for item in clean.spans]
        assert min(np.linalg.norm(item - middle) for item in known) < 0.1
