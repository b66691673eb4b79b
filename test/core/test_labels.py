# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from types import SimpleNamespace

import numpy as np
import pytest
from toys import make_line_cloud, make_tree

from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.core.labels import choose_surroundings, GROUND_BAND, label
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import Decision, PointClass


@pytest.fixture(scope='module')
def scene():
    """Make a line on poles with a tree beside it."""
    return make_line_cloud(
        spans=(100.0, 100.0), per_metre=12.0, more=[make_tree(50.0, 8.0, 9.0, radius=2.0)]
    )


@pytest.fixture(scope='module')
def trace(scene):
    """Inspect it."""
    return Pipeline().trace(scene[0])


def relabel(points, trace, foliage=None):
    """Label the points of a scene anew, and tell what surrounds its conductors."""
    pipeline, lines = Pipeline(), trace.lines
    height, spans = lines.height.height, lines.spans
    nearby = choose_surroundings(height, spans, trace.corridor)
    if foliage is None:
        foliage = find_hazards(
            points, height, nearby, spans, pipeline.settings.hazards, pipeline.rules
        ).foliage
    else:
        foliage = np.full(len(nearby.index), foliage)
    return label(lines, trace.corridor, nearby, foliage), nearby


@pytest.mark.parametrize('num', [0, 1, 17, 5000])
def test_surroundings_are_off_the_ground_and_belong_to_no_line(num):
    rng = np.random.default_rng(num)
    total = 2 * num
    height = rng.uniform(0.0, 3.0 * GROUND_BAND, total).astype(np.float32)
    height[::7] = np.nan
    spans = SimpleNamespace(
        line_id=rng.integers(-3, 2, total).clip(-1).astype(np.int32),
        support=rng.uniform(size=total) < 0.1,
        intruders=rng.permutation(total)[: total // 10],
    )
    near = np.sort(rng.permutation(total)[:num])
    corridor = SimpleNamespace(
        near=near,
        near_distance=rng.uniform(0.0, 20.0, num).astype(np.float32),
        near_span=rng.integers(0, 9, num).astype(np.int32),
    )
    around = ~(height[near] < GROUND_BAND) & (spans.line_id[near] < 0) & ~spans.support[near]
    around &= ~np.isin(near, spans.intruders)
    found = choose_surroundings(height, spans, corridor)
    fields = found.index, found.distance, found.span
    for own, expected in zip(
        fields, (near, corridor.near_distance, corridor.near_span), strict=True
    ):
        np.testing.assert_array_equal(own, expected[around])
    assert [own.dtype for own in fields] == [np.int64, np.float64, np.int64]


def test_points_of_conductors_are_wire_and_near_to_one(scene, trace):
    _, truth = scene
    found = trace.result
    wire = found.decision == Decision.WIRE
    np.testing.assert_array_equal(wire, found.classification == PointClass.WIRE)
    np.testing.assert_array_equal(wire, found.line_id >= 0)
    assert wire[truth == 14].mean() > 0.98
    assert wire[truth != 14].mean() < 0.01
    assert (found.clearance[wire] < 0.5).all()
    assert (found.span_id[wire] >= 0).all()


def test_points_on_the_ground_are_ground(scene, trace):
    _, truth = scene
    found = trace.result
    assert (found.decision[truth == 2] == Decision.GROUND).all()
    assert (found.classification[truth == 2] == PointClass.GROUND).all()


def test_points_of_poles_are_supports_and_tower(scene, trace):
    _, truth = scene
    found = trace.result
    support = found.decision == Decision.SUPPORT
    np.testing.assert_array_equal(support, found.classification == PointClass.TOWER)
    assert support[truth == 15].mean() > 0.7
    assert support[truth == 2].sum() == support[truth == 1].sum() == 0


def test_a_tree_beside_the_line_is_vegetation(scene, trace):
    points, truth = scene
    found = trace.result
    crown = (truth == 1) & (points[:, 2] > 4.0)
    assert (found.classification[crown] == PointClass.VEGETATION).mean() > 0.95
    assert not np.isin(found.decision[crown], (Decision.WIRE, Decision.SUPPORT)).any()
    assert (found.classification[truth != 1] != PointClass.VEGETATION).mean() > 0.99


def test_only_what_is_foliage_is_vegetation(scene, trace):
    bare, _ = relabel(scene[0], trace, foliage=False)
    assert not (bare.classification == PointClass.VEGETATION).any()
    green, nearby = relabel(scene[0], trace, foliage=True)
    np.testing.assert_array_equal(
        np.flatnonzero(green.classification == PointClass.VEGETATION), np.sort(nearby.index)
    )


def test_clearance_is_known_in_the_corridor_alone(trace):
    found = trace.result
    known = np.zeros(len(found.clearance), dtype=bool)
    known[found.corridor] = True
    np.testing.assert_array_equal(np.isfinite(found.clearance), known)
    np.testing.assert_array_equal(found.clearance[found.corridor], trace.corridor.distance)
    np.testing.assert_array_equal(found.span_id[found.corridor], found.corridor_span_id)
    own = found.line_id[found.corridor]
    np.testing.assert_array_equal(found.corridor_line_id[own >= 0], own[own >= 0])


def test_labels_made_anew_are_those_of_the_result(scene, trace):
    labels, _ = relabel(scene[0], trace)
    for name in (
        'classification', 'decision', 'clearance', 'span_id', 'corridor_line_id',
        'corridor_span_id',
    ):
        np.testing.assert_array_equal(getattr(labels, name), getattr(trace.result, name))


def test_a_point_that_is_not_finite_and_an_empty_cloud():
    points = np.vstack([make_line_cloud(spans=(60.0,))[0], [[5.0, 5.0, np.nan]]])
    found = Pipeline().run(points)
    assert found.decision[-1] == Decision.NOT_FINITE
    assert found.classification[-1] == PointClass.OTHER
    assert (found.decision == Decision.NOT_FINITE).sum() == 1
    assert Pipeline().run(np.zeros((0, 3))).decision.shape == (0,)
