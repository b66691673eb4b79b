# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A simulated line with one hazard of each kind, and things that are none."""

import dataclasses

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.results import HazardKind
from plc_inspect.setting_names import update
from plc_inspect.sim.scenes import lines, structures, vegetation
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.scene import SceneBuilder
from plc_inspect.sim.scenes.terrain import make_terrain
from plc_inspect.sim.surveys.airborne import simulate_map

pytestmark = pytest.mark.slow

ROUTE = np.column_stack([np.arange(5) * 90.0, np.zeros(5)])
SIDE = np.array([0.0, 1.0])
LOW_LINE = dataclasses.replace(
    lines.LOW_VOLTAGE, phases=((-0.5, 7.6), (0.0, 7.6), (0.5, 7.6)), sag_ratio=(0.012, 0.0121),
)


def outermost(builder, span_id, side):
    items = [item for item in builder.conductors if item.span_id == span_id]
    return max(items, key=lambda item: side * item.start[1])


def sink(builder, line_id, span_id, share):
    """Let one conductor sag more than the others of its span."""
    for number, item in enumerate(builder.conductors):
        if (item.line_id, item.span_id) == (line_id, span_id):
            builder.conductors[number] = dataclasses.replace(item, c=item.c / share)


def build():
    rng = np.random.default_rng(8)
    terrain = make_terrain(rng, (-80.0, -90.0, 440.0, 90.0), 1.0, 300.0)
    builder = SceneBuilder(name='planted', seed=8, terrain=terrain, rng=rng)
    lines.add_line(builder, lines.MEDIUM_VOLTAGE, ROUTE)
    sink(builder, 1, 2, 1.6)
    lines.add_line(builder, LOW_LINE, np.array([[315.0, -40.0], [315.0, 0.5], [315.0, 40.0]]))
    first = outermost(builder, 0, 1)
    for share, clearance in ((0.3, 1.2), (0.42, 2.6), (0.75, 5.0)):
        vegetation.plant_beside(builder, first, share, 1, clearance, vegetation.shape_poplar)
    structures.add_house(builder, np.array([135.0, 0.0]), 0.0, length=9.0, eaves=3.5, ridge=6.2)
    for x, tall in ((215.0, 15.0), (245.0, 9.0)):
        crown = vegetation.shape_conifer(rng, tall)
        builder.add_blobs(vegetation.place(builder, crown, np.array([x, -13.0])))
    return builder.build(np.array([[-15.0, 0.0], [375.0, 0.0]]), 45.0)


@pytest.fixture(scope='module')
def survey():
    """Scan the scene and run the pipeline, falling trees looked at."""
    scene = build()
    cloud = simulate_map(scene, 40.0, np.random.default_rng(1))
    settings = update(Settings(), {'hazards.fall_distance': 2.0})
    return scene, cloud, Pipeline(settings).run(cloud.points)


def of_kind(survey, kind):
    return [item for item in survey[2].hazards if item.kind == kind]


def test_each_planted_tree_is_one_hazard_and_the_far_one_is_none(survey):
    found = sorted(of_kind(survey, HazardKind.VEGETATION), key=lambda item: item.position[0])
    assert [round(item.position[0] / 10) for item in found] == [3, 4]
    for item in found:
        tree = survey[1].points[
            (survey[1].label == 5)
            & (np.abs(survey[1].points[:, 0] - item.position[0]) < 4.0)
            & (survey[1].points[:, 1] > 0.0)
        ]
        exact = min(measure_distances(tree, other).min() for other in survey[0].conductors)
        assert item.clearance == pytest.approx(exact, abs=0.1)
        assert item.height == pytest.approx(tree[:, 2].max() - tree[:, 2].min(), abs=1.0)
        assert item.from_support == pytest.approx(item.position[0], abs=2.0)


def test_the_house_is_a_structure(survey):
    (found,) = of_kind(survey, HazardKind.STRUCTURE)
    assert found.position[:2] == pytest.approx([135.0, 0.0], abs=6.0)
    assert 1.0 < found.vertical < 4.0


def test_the_tall_trees_can_fall_and_the_low_one_cannot(survey):
    near, found = of_kind(survey, HazardKind.FALL_IN)
    assert near.position[0] == pytest.approx(67.5, abs=2.0)
    assert near.clearance < 0.0
    assert found.position[:2] == pytest.approx([215.0, -13.0], abs=1.0)
    assert found.height == pytest.approx(15.0, abs=0.8)
    assert found.clearance < 2.0


def test_the_conductor_that_sags_too_much(survey):
    (found,) = of_kind(survey, HazardKind.SAG)
    scene, _, result = survey
    span = next(item for item in result.spans
                if (item.line_id, item.span_id) == (found.line_id, found.span_id))
    assert span.start[1] == pytest.approx(0.0, abs=0.2)
    assert found.position[0] == pytest.approx(225.0, abs=6.0)
    sags = {item.line_id: item.sag for item in scene.conductors if item.span_id == 2}
    assert found.clearance == pytest.approx(sags[1] - sags[0], abs=0.05)


def test_the_crossing(survey):
    (found,) = of_kind(survey, HazardKind.CROSSING)
    assert found.position[:2] == pytest.approx([315.0, 0.0], abs=2.0)
    assert found.vertical > 0
    over = [item for item in survey[0].conductors if item.line_id < 3 and item.span_id == 3]
    under = [item for item in survey[0].conductors if item.line_id >= 3]
    exact = min(measure_distances(item.sample(0.1), other).min() for item in under
                for other in over)
    assert found.clearance == pytest.approx(exact, abs=0.1)


def test_nothing_else_is_raised(survey):
    kinds = [item.kind for item in survey[2].hazards]
    assert set(kinds) == {
        HazardKind.VEGETATION, HazardKind.STRUCTURE, HazardKind.FALL_IN, HazardKind.SAG,
        HazardKind.CROSSING,
    }
    assert len(kinds) == 7
