# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Truth: what was seen, distances and hazards against brute force and by hand."""

import json

import numpy as np
import pytest

from plc_inspect.sim.scenes.conductors import hang, measure_distances
from plc_inspect.sim.scenes.scene import Label, SceneBuilder
from plc_inspect.sim.scenes.terrain import Terrain
from plc_inspect.sim.surveys.truth import collect_sightings, make_truth, measure_seen


def make_scene(ends=((0.0, 0.0, 15.0), (100.0, 0.0, 15.0)), offsets=(0.0, 3.0)):
    """Make parallel conductors over flat ground."""
    terrain = Terrain(x0=-80.0, y0=-80.0, cell=4.0, grid=np.zeros((80, 80)))
    builder = SceneBuilder(name='toy', seed=0, terrain=terrain, rng=np.random.default_rng(0))
    for line_id, offset in enumerate(offsets):
        start, end = (np.add(end, (0.0, offset, 0.0)) for end in ends)
        builder.conductors.append(hang(start, end, 0.02, line_id=line_id, span_id=0))
    return builder.build(np.array([[0.0, 0.0], [100.0, 0.0]]), 30.0)


def see(scene, points=(), labels=(), conductor=None):
    """Make the truth of a survey that saw these points."""
    points = np.array(points, float).reshape(-1, 3)
    conductor = np.full(len(points), -1, np.int32) if conductor is None else conductor
    sightings = collect_sightings(scene, points, np.array(labels, np.uint8), conductor)
    return make_truth(scene, sightings, kind='map', frame_id='map', bin_size=1.0, noise=0.03)


def test_share_seen_by_hand():
    """Returns in 3 of 10 bins; places outside the span do not count."""
    x = np.array([-1.0, 0.2, 0.4, 5.5, 9.99, 10.5])
    assert measure_seen(x, 10.0, 1.0) == pytest.approx((0.3, 0.2, 9.99))
    assert measure_seen(np.zeros(0), 10.0, 1.0) == (0.0, 0.0, 0.0)


def test_nothing_seen():
    """Without points there are spans, unseen, and no hazards."""
    truth = see(make_scene())
    assert [(row['seen'], row['num_points']) for row in truth['spans']] == [(0.0, 0), (0.0, 0)]
    assert truth['spans'][0]['min_vegetation_distance'] is None
    assert truth['hazards'] == []
    json.dumps(truth, allow_nan=False)


def test_wires_are_counted_along_their_conductor():
    """Half of one conductor seen, nothing of the other."""
    scene = make_scene()
    points = scene.conductors[1].locate(np.linspace(50.1, 99.9, 200))
    truth = see(scene, points, [Label.WIRE] * 200, np.ones(200, np.int32))
    assert truth['spans'][0]['seen'] == 0.0
    assert truth['spans'][1]['seen'] == pytest.approx(0.5)
    assert truth['spans'][1]['seen_from'] == pytest.approx(50.1)
    assert truth['spans'][1]['num_points'] == 200


def test_hazards_by_hand():
    """Two groups of leaves 3 m and 1 m below a conductor; one at 4.1 m that need not be found."""
    scene = make_scene()
    low = {x: float(scene.conductors[0].heights(np.array([x]))[0]) for x in (20.0, 50.0, 80.0)}
    step = np.array([[0.0, 0, 0], [0.2, 0, -0.3], [-0.2, 0, -0.3], [0, 0.2, -0.5]])
    points = np.vstack([
        np.add((20.0, 0.0, low[20.0] - 3.0), step), np.add((50.0, 0.0, low[50.0] - 1.0), step),
        np.add((80.0, 0.0, low[80.0] - 4.1), step), [[50.0, 0.0, 0.5]],
    ])
    wire = np.vstack([item.locate(np.linspace(30.0, 95.0, 9)) for item in scene.conductors])
    truth = see(
        scene, np.vstack([points, wire]), [Label.VEGETATION] * len(points) + [Label.WIRE] * 18,
        np.repeat(np.array([-1, 0, 1], np.int32), [len(points), 9, 9]),
    )
    hazards = sorted(truth['hazards'], key=lambda row: row['clearance'])
    assert [row['required'] for row in hazards] == [True, True, False]
    assert [row['clearance'] for row in hazards] == pytest.approx([1.0, 3.0, 4.1], abs=0.01)
    assert [row['severity'] for row in hazards] == ['critical', 'warning', 'warning']
    assert {row['line_id'] for row in hazards} == {0}
    assert [item['line_id'] for item in hazards[0]['conductors']] == [0, 1]
    assert [item['line_id'] for item in hazards[2]['conductors']] == [0]
    brute = min(measure_distances(points, scene.conductors[1]))
    assert truth['spans'][1]['min_vegetation_distance'] == pytest.approx(brute)
    part = see(scene, np.vstack([points, wire[:2]]), [5] * len(points) + [14] * 2,
               np.repeat(np.array([-1, 0], np.int32), [len(points), 2]))
    distance = part['spans'][0]['min_vegetation_distance']
    assert distance == pytest.approx(measure_distances(points[:4], scene.conductors[0], 0.1,
                                                       (30.0, 38.125)).min(), abs=1e-3)
    assert distance > 9.0


def test_structures_are_listed_but_not_required():
    """A lamp near a conductor is no hazard of the default rules, but no false report either."""
    scene = make_scene()
    lamp = np.array([[50.0, 0.0, z] for z in (9.0, 10.0, 10.5)])
    wire = scene.conductors[0].sample(10.0)
    truth = see(scene, np.vstack([lamp, wire]), [Label.OTHER] * 3 + [Label.WIRE] * len(wire),
                np.repeat(np.array([-1, 0], np.int32), [3, len(wire)]))
    assert [(row['kind'], row['required']) for row in truth['hazards']] == [('structure', False)]
    assert truth['spans'][0]['min_structure_distance'] == pytest.approx(2.5, abs=0.05)


def test_low_span_is_a_ground_hazard():
    """A span that hangs 3 m above the ground breaks the rule of 5 m, once."""
    scene = make_scene(ends=((0.0, 0.0, 5.0), (100.0, 0.0, 5.0)))
    truth = see(scene)
    assert [(row['kind'], row['required']) for row in truth['hazards']] == [('ground', True)]
    assert truth['hazards'][0]['clearance'] == pytest.approx(3.0, abs=0.01)
    assert truth['hazards'][0]['position'] == pytest.approx([50.0, 0.0, 0.0], abs=0.5)


def test_origin_moves_all_coordinates():
    """An origin of UTM size moves places and heights, not shapes."""
    scene = make_scene()
    points = np.array([[50.0, 0.0, 11.0]] * 3)
    sightings = collect_sightings(scene, points, np.full(3, 5, np.uint8), np.full(3, -1, np.int32))
    near, far = (
        make_truth(scene, sightings, kind='map', frame_id='map', bin_size=1.0, noise=0.03,
                   origin=origin)
        for origin in ((0.0, 0.0, 0.0), (500_000.0, 6_000_000.0, 100.0))
    )
    for key, size in (('start', 3), ('end', 3), ('lowest', 3)):
        shift = np.array(far['spans'][1][key]) - near['spans'][1][key]
        np.testing.assert_allclose(shift, [5e5, 6e6, 100.0][:size])
    assert far['spans'][0]['a'] - near['spans'][0]['a'] == pytest.approx(100.0)
    assert far['spans'][0]['c'] == near['spans'][0]['c']
    shift = np.array(far['hazards'][0]['extent']) - near['hazards'][0]['extent']
    np.testing.assert_allclose(shift, [[5e5, 6e6, 100.0]] * 2)
