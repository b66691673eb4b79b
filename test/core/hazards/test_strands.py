# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sub-conductors from the cross-section of a span, and distances to the nearest of them."""

import dataclasses

from factories import find_nearby, make_model, make_span_result
import numpy as np
import pytest
from toys import make_wire

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.hazards.conductor_hazards import find_interference
from plc_inspect.core.hazards.crossings import find_crossings
from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.core.hazards.strands import divide_section, find_strands, measure_distances
from plc_inspect.core.spans.span_model import MAP_SIGMA

BUNDLES = {
    1: [(0.0, 0.0)],
    2: [(-0.2, 0.0), (0.2, 0.0)],
    3: [(-0.23, 0.13), (0.23, 0.13), (0.0, -0.26)],
    4: [(-0.2, -0.2), (-0.2, 0.2), (0.2, -0.2), (0.2, 0.2)],
}
START, END = (0.0, 0.0, 20.0), (200.0, 0.0, 20.0)


def make_section(num, noise, seed=3, count=240):
    rng = np.random.default_rng(seed)
    centres = np.array(BUNDLES[num])
    part = rng.integers(num, size=count)
    return rng.uniform(0.0, 100.0, count), centres[part] + rng.normal(0.0, noise, (count, 2))


def make_bundle(num, noise=0.03):
    """Return the points of a bundle, its model through the middle, and its exact centres."""
    middle = make_wire(START, END, 900.0, noise=0.0, per_metre=8.0)
    rng = np.random.default_rng(num)
    centres = np.array(BUNDLES[num])
    points = middle.copy()
    points[:, 1:] += centres[rng.integers(num, size=len(middle))]
    points += rng.normal(0.0, noise, points.shape)
    return points, make_model(START, END, c=900.0, points=points, tolerance=0.6)


@pytest.mark.parametrize('num', BUNDLES)
@pytest.mark.parametrize('noise', [0.02, 0.05])
@pytest.mark.parametrize('seed', [1, 2, 3])
def test_sub_conductors_are_told_apart(num, noise, seed):
    strands, scatter = divide_section(*make_section(num, noise, seed))
    assert len(strands) == num
    if num > 1:
        for centre in BUNDLES[num]:
            assert np.linalg.norm(strands - centre, axis=1).min() < 0.03
    assert scatter == pytest.approx((noise, noise), rel=0.15)


def test_what_is_not_resolved_is_as_wide_as_it_looks():
    strands, scatter = divide_section(*make_section(2, 0.09))
    assert len(strands) == 2
    assert np.ptp(strands[:, 0]) == pytest.approx(0.4, abs=0.05)
    assert scatter == pytest.approx((0.09, 0.09), rel=0.15)


def test_a_conductor_whose_points_another_one_has_is_told_apart():
    """The curve is of the upper one alone, as it was fitted before it took those below."""
    upper = make_wire(START, END, 900.0, noise=0.03, per_metre=8.0)
    lower = make_wire(START, END, 900.0, noise=0.03, per_metre=8.0) - np.array([0.0, 0.0, 0.4])
    model = make_model(START, END, c=900.0, points=upper)
    points = np.vstack([upper, lower])
    spans = make_span_result([model], len(points))
    own = np.zeros(len(points), dtype=np.int32)
    apart = np.hypot(*model.part(points)[1:]).astype(np.float32)
    (found,) = find_strands(points, dataclasses.replace(
        spans, line_id=own, span_id=own, residual=apart))
    assert sorted(found.strands[:, 1].tolist()) == pytest.approx([-0.4, 0.0], abs=0.02)
    (alone,) = find_strands(points, dataclasses.replace(
        spans, line_id=np.where(apart < 0.2, own, -1), span_id=own, residual=apart))
    assert len(alone.strands) == 1


def test_strays_along_a_small_part_are_no_sub_conductor():
    x, section = make_section(1, 0.03)
    beside = np.tile([0.3, 0.0], (40, 1)) + np.random.default_rng(1).normal(0, 0.03, (40, 2))
    strands, _ = divide_section(
        np.concatenate([x, np.linspace(10.0, 14.0, 40)]), np.vstack([section, beside])
    )
    assert len(strands) < 3
    assert np.hypot(*strands.T).max() < 0.2


@pytest.mark.parametrize('num', BUNDLES)
def test_clearance_is_from_the_nearest_sub_conductor(num):
    points, model = make_bundle(num)
    x = 70.0
    z = model.curve.fit.height(model.curve.local(np.array([[x, 0.0, 0.0]]))[0])[0]
    tree = np.array([[x, 1.6 + step, z - 0.3 - step] for step in np.arange(0.0, 2.0, 0.05)])
    tree = np.vstack([tree, tree + np.array([0.1, 0.1, 0.0]), tree + np.array([0.2, 0.0, -0.1])])
    cloud = np.vstack([points, tree])
    spans = make_span_result([model], len(cloud))
    spans.line_id[: len(points)] = spans.span_id[: len(points)] = 0
    nearby = find_nearby(tree, [model], 6.0)
    nearby = dataclasses.replace(nearby, index=nearby.index + len(points))
    found = find_hazards(cloud, cloud[:, 2], nearby, spans, HazardSettings())
    (hazard,) = found.hazards
    true = min(
        np.hypot(tree[:, 1] - y, tree[:, 2] - z - up).min() for y, up in BUNDLES[num]
    )
    assert abs(hazard.clearance - true) < 0.05
    assert abs(hazard.clearance - true) < 3.0 * hazard.sigma
    parts = np.hypot(hazard.horizontal, hazard.vertical)
    assert parts == pytest.approx(hazard.clearance, abs=0.01)
    assert hazard.sigma == pytest.approx(0.03, rel=0.3)


@pytest.mark.parametrize('num', [1, 2])
def test_what_is_near_is_as_sure_as_heights_of_wires(num):
    """Across its beam, a wire may be anywhere in the footprint; trees and structures fill it."""
    points, model = make_bundle(num, noise=0.0)
    points += np.random.default_rng(7).normal(0.0, (0.0, 0.06, 0.02), points.shape)
    model = make_model(START, END, c=900.0, points=points, tolerance=0.6)
    spans = make_span_result([model], len(points))
    spans.line_id[:] = spans.span_id[:] = 0
    (found,) = find_strands(points, spans)
    assert len(found.strands) == num
    assert found.noise == pytest.approx(0.02, rel=0.15)
    middle = 0.5 * (found.low + found.high)
    assert found.sigma(middle) == pytest.approx(np.hypot(0.02, MAP_SIGMA), rel=0.15)
    assert found.scatter == pytest.approx(np.hypot(0.06, 0.02) / np.sqrt(2.0), rel=0.15)


def test_a_conductor_in_a_bad_part_of_a_map_is_less_sure():
    places = [(START, END), ((0.0, 30.0, 20.0), (200.0, 30.0, 20.0)),
              ((0.0, 60.0, 20.0), (200.0, 60.0, 20.0))]
    wires = [make_wire(*ends, 900.0, noise=noise, per_metre=8.0)
             for ends, noise in zip(places, (0.02, 0.02, 0.06), strict=True)]
    models = [make_model(*ends, k, c=900.0, points=points, tolerance=0.3)
              for k, (ends, points) in enumerate(zip(places, wires, strict=True))]
    found = find_strands(np.vstack(wires), make_span_result(models, sum(map(len, wires))))
    assert [item.noise for item in found] == pytest.approx([0.02, 0.02, 0.06], rel=0.15)


def test_distances_beyond_the_end_and_on_slopes():
    points, model = make_bundle(2, noise=0.0)
    spans = make_span_result([model], len(points))
    spans.line_id[:] = spans.span_id[:] = 0
    (wide,) = find_strands(points, spans)
    beyond = np.array([[-3.0, 0.2, 20.0], [100.0, 1.2, 14.44]])
    near = find_nearby(beyond, [wide], 9.0)
    distance = measure_distances(beyond, near.distance, near.span, [wide], 4.0)
    np.testing.assert_allclose(distance, [3.0, 1.0], atol=0.06)


def test_no_spans_have_no_sub_conductors():
    assert find_strands(np.zeros((5, 3)), make_span_result([], 5)) == ()


@pytest.mark.parametrize('seed', range(6))
def test_strays_are_no_sub_conductor(seed):
    x, section = make_section(4, 0.03, seed)
    rng = np.random.default_rng(seed)
    section[:5] += rng.normal(0.0, 0.3, (5, 2))
    strands, _ = divide_section(x, section)
    assert len(strands) == 4
    for centre in BUNDLES[4]:
        assert np.linalg.norm(strands - centre, axis=1).min() < 0.03


def test_positions_of_sub_conductors_are_parted_by_nothing():
    model = dataclasses.replace(make_model(START, END, c=900.0), strands=np.array(BUNDLES[3]))
    places = model.strand_positions(np.array([20.0, 90.0]))
    assert places.shape == (3, 2, 3)
    for own in places:
        _, horizontal, vertical = model.part(own)
        assert np.hypot(horizontal, vertical) == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize('above', [1.5, -1.5])
def test_lines_cross_at_the_nearest_sub_conductors(above):
    """Whichever comes first, and whichever is above."""
    bundle = dataclasses.replace(make_model(START, END, c=900.0), strands=np.array(BUNDLES[4]))
    z = float(bundle.curve.position(bundle.at(np.array(100.0)))[0, 2]) + above
    single = make_model((100.0, -20.0, z), (100.0, 20.0, z), c=1e5, line_id=1, span_id=1)
    rules = plain_rules(HazardSettings())
    for models in ((bundle, single), (single, bundle)):
        (record,) = find_crossings(models, (), rules)
        assert record['clearance'] == pytest.approx(1.3, abs=0.02)
        assert record['vertical'] == pytest.approx(record['clearance'], abs=0.02)


def test_parts_of_a_distance_between_lines_are_of_the_nearest_sub_conductors():
    """These are aside of the curves, by half of a bundle each."""
    bundle = dataclasses.replace(make_model(START, END, c=900.0), strands=np.array(BUNDLES[2]))
    z = float(bundle.curve.position(bundle.at(np.array(100.0)))[0, 2]) - 1.0
    # it climbs across, so that the nearest place is beside the middle
    start, end = (100.0, -20.0, z - 8.0), (100.0, 20.0, z + 8.0)
    steep = make_model(start, end, c=1e5, line_id=1, span_id=1)
    steep = dataclasses.replace(steep, strands=np.array(BUNDLES[2]))
    (record,) = find_crossings((bundle, steep), (), plain_rules(HazardSettings()))
    parts = np.hypot(record['horizontal'], record['vertical'])
    assert parts == pytest.approx(record['clearance'], abs=1e-6)
    away = np.linalg.norm(
        steep.strand_positions(np.linspace(steep.low, steep.high, 4001)) - record['position'],
        axis=2)
    assert away.min() < 0.01


def test_interference_is_between_the_nearest_sub_conductors():
    """Of bundles one above the other: 2 m between their middles at the ends, 0.8 m within."""
    lower = make_model((0.0, 0.0, 13.0), (100.0, 0.0, 13.0), c=800.0)
    slack = make_model((0.0, 0.0, 15.0), (100.0, 0.0, 15.0), 1, c=450.0)
    models = [dataclasses.replace(item, strands=np.array(BUNDLES[4])) for item in (lower, slack)]
    (record,) = find_interference(models, (), plain_rules(HazardSettings()), HazardSettings())
    assert record['clearance'] == pytest.approx(0.78 - 0.4, abs=0.02)
    assert record['required'] == pytest.approx(0.5 * (2.0 - 0.4), abs=0.02)
    assert record['vertical'] == pytest.approx(record['clearance'], abs=1e-6)
    assert abs(record['position'][1]) == pytest.approx(0.2, abs=1e-6)
