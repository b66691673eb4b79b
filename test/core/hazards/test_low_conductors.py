# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ground below conductors: what was not seen raises nothing, hills and banks do."""

import dataclasses
import math

from factories import make_model
import numpy as np
import pytest
from toys import make_line_cloud

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.hazards.low_conductors import (
    BELOW,
    find_low_conductors,
    find_low_wires,
    GROUND_SIGMA,
    keep_seen,
    measure_ground,
    ROUGH_SIGMA,
)
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import HazardKind

RULES = plain_rules(HazardSettings())
ENDS = ((0.0, 0.0, 12.0), (100.0, 0.0, 12.0))
CONSTANT = 2000.0


def measure(model, ground):
    """Return stations above ground [m] that is given along the span."""
    along = np.linspace(0.0, 100.0, 101)
    direction = 1.0 if model.end_x > model.start_x else -1.0
    height = model.curve.fit.height(model.start_x + direction * along)
    return np.column_stack([along, height - ground(along), np.full(101, GROUND_SIGMA)])


def find(model, ground):
    return find_low_conductors([model], [measure(model, ground)], (), RULES)


@pytest.mark.parametrize('backwards', [False, True])
@pytest.mark.parametrize(('low', 'high'), [(40.0, 60.0), (42.0, 58.0), (0.0, 30.0), (55.0, 100.0)])
@pytest.mark.parametrize('gap', [0.03, 0.8, -0.2])
def test_the_conductor_is_not_its_own_ground(backwards, low, high, gap):
    model = make_model(*(ENDS[::-1] if backwards else ENDS), c=CONSTANT)
    conductor = measure(model, lambda along: 0.0 * along)[:, 1]

    def ground(along):
        return np.where((along > low) & (along < high), conductor - gap, 0.0)

    found = find(model, ground)
    # of a long stretch by itself, only what touches the conductor is known not to be ground
    assert not [item for item in found if item['clearance'] < 0.5]
    if high - low < 2.0 * 10.0:
        assert not found


@pytest.mark.parametrize('backwards', [False, True])
def test_hills_and_banks_are_ground(backwards):
    model = make_model(*(ENDS[::-1] if backwards else ENDS), c=CONSTANT)
    (hill,) = find(model, lambda along: 9.0 * np.exp(-((along - 50.0) / 20.0) ** 2))
    assert 1.5 < hill['clearance'] < 3.0
    (bank,) = find(model, lambda along: 7.0 + 0.9 * (along > 50.0))
    assert 2.5 < bank['clearance'] < 4.0


def test_no_ground_and_a_bundle():
    model = make_model(*ENDS, c=CONSTANT)
    assert find_low_conductors([model], [np.zeros((0, 2))], (), RULES) == []
    assert keep_seen(model, np.zeros((0, 2))).shape == (0, 2)
    quad = dataclasses.replace(model, strands=np.array([[0.0, 0.2], [0.0, -0.2]]))
    (own,), (lower,) = (find(item, lambda along: 7.0 + 0.0 * along) for item in (model, quad))
    assert lower['clearance'] == pytest.approx(own['clearance'] - 0.2)
    np.testing.assert_allclose(lower['position'][2], 7.0, atol=0.01)


def make_ground(slope, density=20.0, noise=0.03, seed=0):
    """Return points about a span on a slope, and their heights above the lowest of cells."""
    rng = np.random.default_rng(seed)
    num = int(density * 110.0 * 12.0)
    points = np.column_stack([rng.uniform(-5.0, 105.0, num), rng.uniform(-6.0, 6.0, num),
                              np.zeros(num)])
    true = slope[0] * points[:, 0] + slope[1] * points[:, 1]
    points[:, 2] = true + rng.normal(0.0, noise, num)
    below = 0.4 * (abs(slope[0]) + abs(slope[1])) + 0.05
    return points, (points[:, 2] - true + below).astype(np.float32), below


@pytest.mark.parametrize('slope', [(0.0, 0.0), (0.1, -0.2), (0.3, 0.3), (-0.5, 0.2)])
def test_ground_is_measured_and_not_its_lowest_points(slope):
    model = make_model((0.0, 0.0, 70.0), (100.0, 0.0, 70.0), c=CONSTANT)
    points, height, below = make_ground(slope)
    kept = points.copy(), height.copy()
    true = measure(model, lambda along: slope[0] * along)[:, :2]
    raw = true + np.array([0.0, below])
    (found,) = measure_ground(points, height, [model], [raw], 200.0)
    assert found.shape == (101, 3)
    error = found[:, 1] - true[:, 1]
    assert abs(np.median(error)) < 0.02
    assert np.abs(error).max() < 0.08
    assert (np.abs(error) < 2.0 * found[:, 2]).mean() > 0.95
    assert (found[:, 2] >= GROUND_SIGMA).all()
    np.testing.assert_array_equal(points, kept[0])
    np.testing.assert_array_equal(height, kept[1])


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize(('slope', 'more'), [(0.5, 0.1), (0.75, 0.18)])
@pytest.mark.parametrize('first', [30.0, 49.5])
def test_the_lowest_of_several_heaps_is_found_between_the_places(first, slope, more, seed):
    # the first heap is measured at its top, the higher one half a step from it
    tops = {first: 5.0, 70.5: 5.0 + more}
    model = make_model(*ENDS, c=CONSTANT)
    rng = np.random.default_rng(seed)
    num = 20_000
    points = np.column_stack(
        [rng.uniform(-5.0, 105.0, num), rng.uniform(-6.0, 6.0, num), np.zeros(num)])

    def lay(x, y):
        heaps = [z - slope * np.hypot(x - top, y) for top, z in tops.items()]
        return np.maximum(np.max(heaps, axis=0), 0.0)

    points[:, 2] = lay(points[:, 0], points[:, 1]) + rng.normal(0.0, 0.02, num)
    lowest = lay(points[:, 0], points[:, 1]) - 0.5 * slope
    stations = measure(model, lambda along: lay(along, 0.0 * along) - 0.5 * slope)[:, :2]
    (found,) = measure_ground(
        points, (points[:, 2] - lowest).astype(np.float32), [model], [stations], 10.0)
    true = min(model.curve.fit.height(model.at(np.array(top))) - z for top, z in tops.items())
    assert found[:, 1].min() == pytest.approx(true, abs=0.08)


def test_grass_is_left_out():
    model = make_model(*ENDS, c=CONSTANT)
    points, height, below = make_ground((0.0, 0.0))
    rng = np.random.default_rng(1)
    grass = rng.random(len(points)) < 0.2
    rise = np.where(grass, rng.uniform(0.15, 0.4, len(points)), 0.0)
    points[:, 2] += rise
    true = measure(model, lambda along: 0.0 * along)[:, :2]
    (found,) = measure_ground(
        points, height + rise.astype(np.float32), [model], [true + np.array([0.0, below])], 100.0)
    assert abs(np.median(found[:, 1] - true[:, 1])) < 0.03


@pytest.mark.parametrize('slope', [(0.0, 0.0), (0.2, -0.4)])
def test_the_ground_below_dense_shrub_is_found(slope):
    model = make_model((0.0, 0.0, 70.0), (100.0, 0.0, 70.0), c=CONSTANT)
    points, height, below = make_ground(slope, density=10.0, noise=0.02)
    rng = np.random.default_rng(1)
    shrub = rng.uniform((-5.0, -6.0, 0.2), (105.0, 6.0, 0.5), (25_000, 3))
    rise = shrub[:, 2].copy()
    shrub[:, 2] += slope[0] * shrub[:, 0] + slope[1] * shrub[:, 1]
    true = measure(model, lambda along: slope[0] * along)[:, :2]
    (found,) = measure_ground(
        np.concatenate([points, shrub]), np.concatenate([height, rise]).astype(np.float32),
        [model], [true + np.array([0.0, below])], 200.0)
    assert len(found) == 101
    error = found[:, 1] - true[:, 1]
    assert abs(np.median(error)) < 0.01
    assert (np.abs(error) < 0.05).mean() > 0.95


def test_without_heights_the_lowest_count_and_are_rough():
    model = make_model(*ENDS, c=CONSTANT)
    raw = measure(model, lambda along: 0.0 * along)[:, :2]
    (found,) = measure_ground(np.zeros((9, 3)), None, [model], [raw], 100.0)
    np.testing.assert_array_equal(found[:, :2], raw)
    assert (found[:, 2] == ROUGH_SIGMA).all()
    (none,) = measure_ground(np.zeros((9, 3)), np.zeros(9, np.float32), [model],
                             [np.zeros((0, 2))], 9.0)
    assert none.shape == (0, 3)


def test_where_hardly_anything_is_seen_nothing_is_measured():
    model = make_model(*ENDS, c=CONSTANT)
    raw = measure(model, lambda along: 0.0 * along)[:, :2]
    points = np.column_stack([np.linspace(0.0, 100.0, 400), np.zeros((400, 2))])  # one scan line
    for cloud, height in ((points, np.zeros(400, np.float32)),
                          (np.zeros((0, 3)), np.zeros(0, np.float32)),
                          (points, np.full(400, np.nan, np.float32))):
        (found,) = measure_ground(cloud, height, [model], [raw], 100.0)
        assert found.shape == (0, 3)


@pytest.mark.parametrize(('num', 'scatter'), [(1, 0.02), (30, 0.02), (400, 0.5)])
def test_what_hangs_over_unseen_ground_is_not_the_ground(num, scatter):
    model = make_model(*ENDS, c=CONSTANT)
    points, height, _ = make_ground((0.0, 0.0))
    seen = np.abs(points[:, 0] - 50.0) > 10.0
    # a few returns of another wire, or the lower side of a crown, are the lowest of their cells
    rng = np.random.default_rng(7)
    across = 0.05 if scatter < 0.1 else 2.0
    hanging = np.column_stack([rng.uniform(46.0, 54.0, num), rng.normal(0.0, across, num),
                               8.0 + rng.normal(0.0, scatter, num)])
    lowest = measure(model, lambda along: np.maximum(8.5 - np.abs(along - 50.0), 0.0))
    raw = lowest[:, :2]
    (found,) = measure_ground(
        np.vstack([points[seen], hanging]),
        np.concatenate([height[seen], hanging[:, 2] - 8.0]).astype(np.float32),
        [model], [raw], 100.0,
    )
    assert found[:, 1].min() == pytest.approx(12.0 - 0.65, abs=0.4)
    assert not find_low_conductors([model], [found], (), RULES)
    assert find_low_conductors([model], [lowest], (), RULES)


def test_the_ground_far_below_is_not_measured_anew():
    model = make_model((0.0, 0.0, 30.0), (100.0, 0.0, 10.0), c=CONSTANT)
    points, height, below = make_ground((0.0, 0.0))
    raw = measure(model, lambda along: 0.0 * along)[:, :2] + np.array([0.0, below])
    (found,) = measure_ground(points, height, [model], [raw], 5.0)
    changed = found[:, 1] != raw[:, 1]
    assert changed[np.argmin(raw[:, 1])]
    assert not changed[raw[:, 1] > raw[:, 1].min() + 1.0].any()


def make_low_wire(below, first=30.0, last=60.0, sags=True, num=40, seed=2):
    """Return points below the conductor of CONSTANT that hang as it does, or are straight."""
    rng = np.random.default_rng(seed)
    model = make_model(*ENDS, c=400.0)
    along = rng.uniform(first, last, num)
    height = model.curve.fit.height(model.at(along if sags else np.array([first, last])))
    if not sags:
        height = np.interp(along, [first, last], height)
    points = model.curve.position(model.at(along))
    points[:, 2] = height - below
    return model, points + rng.normal(0.0, 0.02, points.shape)


def test_a_wire_below_that_was_not_modelled_is_what_hangs_too_low():
    model, points = make_low_wire(1.5)
    ground = measure(model, lambda along: 3.5 + 0.0 * along)
    lowest = ground[:, 1].min()
    assert lowest > 5.0 > lowest - 1.5
    assert find_low_conductors([model], [ground], (), RULES) == []
    (wire,) = find_low_wires([points], [model])
    (found,) = find_low_conductors([model], [ground], (), RULES, [wire])
    assert found['clearance'] == pytest.approx(lowest - 1.5, abs=0.02)
    assert found['note'] == BELOW
    assert found['confidence'] <= 0.5
    assert found['position'][2] == pytest.approx(3.5, abs=0.01)


def test_a_wire_that_is_not_sure_enough_hides_no_conductor():
    model, points = make_low_wire(1.5)
    ground = measure(model, lambda along: 5.0 + 0.0 * along)
    wires = find_low_wires([points], [model])
    (found,) = find_low_conductors([model], [ground], (), RULES, wires, least_chance=0.6)
    assert found['clearance'] == pytest.approx(ground[:, 1].min())
    assert found['note'] == ''
    assert found['chance'] > 0.9


def test_fences_and_what_hangs_beside_or_above_are_no_wires_below():
    model, fence = make_low_wire(3.0, sags=False)
    assert find_low_wires([fence], [model]) == []
    _, above = make_low_wire(-1.0)
    _, beside = make_low_wire(0.5)
    beside[:, 1] += 2.0
    assert find_low_wires([above, beside], [model]) == []
    assert find_low_wires([], [model]) == find_low_wires([fence], []) == []


def test_the_wire_hangs_below_the_nearest_conductor_above_it():
    model, points = make_low_wire(1.5)
    high = make_model((0.0, 0.0, 14.0), (100.0, 0.0, 14.0), c=400.0)
    (wire,) = find_low_wires([points], [high, model])
    assert wire.model == 1
    assert wire.below == pytest.approx(1.5, abs=0.02)


def test_where_no_ground_was_seen_below_a_line_no_clearance_is_told():
    """Beside the line the ground is seen; below it the surface is filled in, and may be wrong."""
    points, _ = make_line_cloud(spans=(100.0, 110.0), height=6.0, half_width=25.0)
    known = Pipeline().run(points)
    assert all(span.ground_clearance < 6.0 for span in known.spans)
    below = (np.abs(points[:, 1]) < 6.0) & (points[:, 2] < 2.0)
    hidden = Pipeline().run(points[~below])
    assert len(hidden.spans) == len(known.spans)
    assert all(math.isnan(span.ground_clearance) for span in hidden.spans)
    assert not [item for item in hidden.hazards if item.kind == HazardKind.GROUND]
