# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import json

import numba
import numpy as np
import pytest
from toys import hang, make_line_cloud, make_tree, make_wire, turn

from plc_inspect.config import CorridorSettings, HazardSettings, SegmentSettings, Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.stage_log import STAGES
from plc_inspect.errors import DataError
from plc_inspect.results import Decision, HazardKind, PointClass, Severity
from plc_inspect.sim.random_scenes.truth import make_random

ARRAYS = (
    'line_id', 'span_id', 'residual', 'clearance', 'classification', 'decision', 'ground_height',
    'corridor', 'corridor_line_id', 'corridor_span_id',
)


def describe(result):
    """Return all of a result that should repeat, bit for bit."""
    spans = [
        {key: np.asarray(value).tolist() if not isinstance(value, dict) else value
         for key, value in zip(
             (item.name for item in dataclasses.fields(span)),
             (getattr(span, item.name) for item in dataclasses.fields(span)), strict=True)}
        for span in result.spans
    ]
    supports = [(item.support_id, item.position.tolist(), item.height, item.kind, item.line_ids)
                for item in result.supports]
    hazards = [(item.line_id, item.span_id, item.kind, item.clearance, item.position.tolist())
               for item in result.hazards]
    return spans, supports, hazards


def check_same(one, other):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    assert describe(one) == describe(other)


@pytest.fixture(scope='module')
def cloud():
    """Make two spans of three conductors with a tree 1 m below the middle one."""
    return make_line_cloud(half_width=15.0, more=[make_tree(50.0, 0.0, 12.4)])


@pytest.fixture(scope='module')
def result(cloud):
    """Inspect it."""
    return Pipeline().run(cloud[0])


def test_the_line_is_found_as_it_is(cloud, result):
    _, label = cloud
    assert result.num_points == len(label)
    assert result.num_lines == 3
    assert [(span.line_id, span.span_id) for span in result.spans] == [
        (line, span) for line in range(3) for span in range(2)
    ]
    for span in result.spans:
        assert span.c == pytest.approx(800.0, rel=0.03)
        assert span.length == pytest.approx((100.0, 110.0)[span.span_id], abs=0.5)
    wire = result.classification == PointClass.WIRE
    assert (wire & (label == 14)).sum() > 0.99 * (label == 14).sum()
    assert (wire & (label != 14)).sum() < 0.01 * wire.sum()
    assert [support.kind for support in result.supports] == ['pole'] * 3
    assert len(result.hazards) == 1
    hazard = result.hazards[0]
    assert (hazard.line_id, hazard.span_id) == (1, 0)
    assert hazard.clearance == pytest.approx(1.1, abs=0.15)


def test_arrays_are_parallel_to_the_cloud_and_agree(cloud, result):
    num = len(cloud[0])
    for name, dtype in {
        'line_id': np.int32, 'span_id': np.int32, 'residual': np.float32,
        'clearance': np.float32, 'classification': np.uint8, 'decision': np.uint8,
        'ground_height': np.float32,
    }.items():
        array = getattr(result, name)
        assert array.shape == (num,), name
        assert array.dtype == dtype, name
    wire = result.line_id >= 0
    np.testing.assert_array_equal(wire, result.classification == PointClass.WIRE)
    np.testing.assert_array_equal(wire, result.decision == Decision.WIRE)
    np.testing.assert_array_equal(wire, np.isfinite(result.residual))
    np.testing.assert_array_equal(
        result.classification == PointClass.TOWER, result.decision == Decision.SUPPORT
    )
    inside = np.zeros(num, dtype=bool)
    inside[result.corridor] = True
    np.testing.assert_array_equal(inside, np.isfinite(result.clearance))
    assert (np.diff(result.corridor) > 0).all()
    assert inside[wire].mean() > 0.99
    np.testing.assert_array_equal(inside | wire, result.span_id >= 0)
    pairs = {(span.line_id, span.span_id) for span in result.spans}
    assert len(pairs) == len(result.spans)
    found = set(zip(result.line_id[wire].tolist(), result.span_id[wire].tolist(), strict=True))
    assert found == pairs
    near = zip(result.corridor_line_id.tolist(), result.corridor_span_id.tolist(), strict=True)
    assert set(near) <= pairs
    assert np.isin(result.classification, [item.value for item in PointClass]).all()


def test_every_stage_says_what_it_kept_and_why(cloud, result):
    assert tuple(stage.name for stage in result.stages) == STAGES
    for stage in result.stages:
        assert stage.seconds >= 0.0
        assert all(count > 0 for count in stage.dropped.values())
        json.dumps(stage.values)
    height = result.stages[0]
    assert height.num_in == len(cloud[0])
    assert height.num_kept + sum(height.dropped.values()) == height.num_in
    assert sum(height.values['histogram']) == height.num_in
    assert height.values['threshold'] == pytest.approx(4.0, abs=0.5)
    for stage in result.stages[1:4]:
        assert stage.num_kept + sum(stage.dropped.values()) == stage.num_in


def test_each_point_knows_the_stage_that_decided(cloud, result):
    points, label = cloud
    ground = result.decision[label == 2]
    assert (ground == Decision.GROUND).mean() > 0.99
    tree = result.decision[label == 1]
    assert not np.isin(tree, [Decision.NOT_FINITE, Decision.WIRE]).any()
    assert (tree == Decision.TOO_LOW).sum() > 0
    assert (points[result.decision == Decision.TOO_LOW, 2] < 4.5).all()


def test_progress_is_told_stage_by_stage(cloud):
    told = []
    Pipeline().run(cloud[0], lambda name, share: told.append((name, share)))
    assert [name for name, _ in told] == list(STAGES)
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] < 1.0


def test_two_runs_are_equal_and_the_input_is_unchanged(cloud, result):
    before = cloud[0].copy()
    check_same(result, Pipeline().run(cloud[0]))
    np.testing.assert_array_equal(cloud[0], before)


def test_the_number_of_threads_does_not_matter(cloud, result):
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        check_same(result, Pipeline().run(cloud[0]))
    finally:
        numba.set_num_threads(threads)


def test_the_order_of_points_hardly_matters(cloud, result):
    order = np.random.default_rng(0).permutation(len(cloud[0]))
    other = Pipeline().run(cloud[0][order])
    assert (other.line_id == result.line_id[order]).mean() > 0.999
    for one, two in zip(result.spans, other.spans, strict=True):
        np.testing.assert_allclose(one.start, two.start, atol=0.1)
        assert one.sag == pytest.approx(two.sag, abs=0.01)


def test_coordinates_as_large_as_utm_lose_nothing(cloud, result):
    shift = np.array([592_344.0, 6_617_352.0, 104.0])
    other = Pipeline().run(cloud[0] + shift)
    assert (other.line_id == result.line_id).mean() > 0.999
    for one, two in zip(result.spans, other.spans, strict=True):
        np.testing.assert_allclose(one.start + shift, two.start, atol=0.05)
        assert one.sag == pytest.approx(two.sag, abs=0.005)


@pytest.mark.parametrize('degrees', [90, 141])
def test_yaw_turns_the_result(cloud, result, degrees):
    points, label = cloud
    other = Pipeline().run(turn(points, np.radians(degrees)))
    assert sorted((s.span_id, s.line_id) for s in other.spans) == sorted(
        (s.span_id, s.line_id) for s in result.spans
    )
    wire = other.classification == PointClass.WIRE
    assert (wire == (label == 14)).mean() > 0.999
    sags = [sorted(round(span.sag, 2) for span in item.spans) for item in (result, other)]
    np.testing.assert_allclose(*sags, atol=0.02)
    assert other.hazards[0].clearance == pytest.approx(result.hazards[0].clearance, abs=0.03)


def test_rows_that_are_not_finite_are_counted_and_change_nothing_else(cloud, result):
    bad = np.array([[np.nan, 0.0, 1.0], [np.inf, 3.0, 4.0], [1.0, 2.0, -np.inf]])
    other = Pipeline().run(np.vstack([cloud[0], bad]))
    assert other.stages[0].dropped['not finite'] == 3
    assert (other.decision[-3:] == Decision.NOT_FINITE).all()
    assert (other.classification[-3:] == PointClass.OTHER).all()
    assert (other.line_id[-3:] == -1).all()
    assert np.isnan(other.clearance[-3:]).all()
    np.testing.assert_array_equal(other.line_id[:-3], result.line_id)


@pytest.mark.parametrize('points', [
    np.zeros((0, 3)), np.zeros((1, 3)), np.arange(9.0).reshape(3, 3), np.ones((500, 3)),
    np.full((20, 3), np.nan),
], ids=['empty', 'one', 'three', 'duplicates', 'not finite'])
def test_a_cloud_without_anything_gives_an_empty_result(points):
    result = Pipeline().run(points)
    assert result.spans == result.supports == result.hazards == ()
    assert result.num_points == len(points)
    assert result.num_lines == 0
    assert len(result.corridor) == 0
    assert (result.line_id == -1).all()
    assert tuple(stage.name for stage in result.stages) == STAGES
    assert result.residual.shape == result.clearance.shape == (len(points),)


def test_fewer_points_than_asked_for_are_not_searched(cloud):
    settings = Settings(segment=SegmentSettings(min_points=1_000_000))
    assert Pipeline(settings).run(cloud[0]).spans == ()


@pytest.mark.parametrize('shape', [(5,), (5, 2), (5, 4), (2, 5, 3)])
def test_a_wrong_shape_raises(shape):
    with pytest.raises(DataError, match='shape'):
        Pipeline().run(np.zeros(shape))


def test_an_extent_beyond_the_voxels_raises(cloud):
    far = cloud[0] + np.array([3e6, 0.0, 0.0])  # as many points: no strays
    with pytest.raises(DataError, match='m, too much for voxels of'):
        Pipeline().run(np.vstack([cloud[0], far]))


def test_a_small_corridor_hides_no_hazard(cloud, result):
    settings = Settings(corridor=CorridorSettings(radius=0.6))
    other = Pipeline(settings).run(cloud[0])
    assert [item.clearance for item in other.hazards] == pytest.approx(
        [item.clearance for item in result.hazards]
    )
    assert len(other.corridor) < len(result.corridor)


@pytest.mark.parametrize('radius', [0.0, 1.0])
@pytest.mark.parametrize('place', [6.0, 50.0])
def test_rules_that_reach_less_far_than_parts_of_a_line_are_not_silent(place, radius):
    height = hang(place, 100.0, 12.0, 12.0, 1500.0)
    tree = make_tree(place, 0.0, height - 0.4, bottom=2.0, num=3000)
    points, _ = make_line_cloud(height=12.0, c=1500.0, half_width=15.0, more=(tree,))
    (hazard,) = Pipeline(Settings(
        corridor=CorridorSettings(radius=radius),
        hazards=HazardSettings(warning_distance=1.0, critical_distance=0.9),
    )).run(points).hazards
    assert (hazard.kind, hazard.severity) == (HazardKind.VEGETATION, Severity.CRITICAL)
    assert hazard.position[0] == pytest.approx(place, abs=1.0)


@pytest.mark.parametrize('offsets', [(-1.2, 0.0, 1.2), (-2.0, -1.0, 0.0, 1.0), (-6.0, 0.0, 6.0)])
@pytest.mark.parametrize('degrees', [0.0, 45.0, 70.0])
def test_conductors_side_by_side_over_a_valley_are_not_the_ground(offsets, degrees):
    """No ground was seen, or only where the vehicle took off."""
    points, label = make_line_cloud(spans=(100.0, 80.0), offsets=offsets)
    points = turn(points, np.radians(degrees))
    start = np.hypot(*points[:, :2].T) < 20.0
    for kept in (label != 2, (label != 2) | start):
        found = Pipeline().run(points[kept])
        wire = found.classification[label[kept] == 14] == PointClass.WIRE
        assert wire.mean() > 0.98


def test_dense_shrubs_do_not_hide_a_low_line():
    shrubs = np.random.default_rng(0).uniform((-20, -12, 2.9), (110, 12, 3.1), (30_000, 3))
    points, _ = make_line_cloud(
        spans=(90.0,), height=6.5, c=1200.0, half_width=12.0, more=[shrubs]
    )
    assert Pipeline().run(points).num_lines == 3


@pytest.mark.parametrize('lowest', [0.9, 1.7])
def test_what_nearly_touches_the_ground_of_a_conductor_is_the_conductor(lowest):
    points, label = make_line_cloud(
        spans=(120.0,), height=8.0, c=120.0**2 / (8.0 * (8.0 - lowest)), half_width=12.0
    )
    result = Pipeline().run(points)
    assert len(result.spans) == 3
    assert (result.classification[label == 14] == PointClass.WIRE).mean() > 0.98
    (hazard,) = result.hazards
    assert (hazard.kind, hazard.severity) == (HazardKind.GROUND, Severity.WARNING)
    assert hazard.clearance == pytest.approx(lowest, abs=0.2)
    assert (hazard.confidence, hazard.note) == (pytest.approx(1.0), '')


def test_a_tree_by_an_unseen_support_is_still_a_hazard():
    points, _ = make_line_cloud(poles=False, half_width=15.0, more=[make_tree(103.0, 0.0, 14.0)])
    result = Pipeline().run(points)
    assert len(result.spans) == 6
    assert any(hazard.clearance < 2.0 for hazard in result.hazards)


def test_a_short_piece_is_found_where_it_continues_a_line():
    points, label = make_line_cloud(spans=(60.0, 60.0), offsets=(0.0,), c=400.0)
    x = points[:, 0]
    seen = points[(label != 14) | (x < 69.0)]  # the edge of the cloud cuts the second span
    result = Pipeline().run(seen)
    assert [round(span.length) for span in result.spans] == [60, 9]
    assert {span.line_id for span in result.spans} == {0}
    alone = seen[(seen[:, 0] > 60.0) | (seen[:, 2] < 5.0)]
    assert not Pipeline().run(alone).spans


def test_conductors_that_lay_for_ground_are_searched_once_the_ground_is_known():
    """The ground is seen below the first third of a span alone, as beside a river."""
    points, label = make_line_cloud(spans=(120.0,), half_width=15.0)
    ground = (label == PointClass.GROUND) & (points[:, 0] > 40.0)
    result = Pipeline().run(points[~ground])
    wires = label[~ground] == PointClass.WIRE
    # one search finds 0.44 of the wire points
    assert (result.classification[wires] == PointClass.WIRE).mean() > 0.75


def test_wires_within_a_thick_curve_that_is_none_are_found():
    """Four wires 0.45 m apart, in strips that lie some centimetres off each other."""
    made = make_random(15004, 'clean')
    called = Pipeline().run(made.cloud.points).classification == PointClass.WIRE
    # where the thick curve stands for them, four of them have less than 0.7
    assert min(called[made.cloud.conductor == k].mean() for k in range(3, 12)) > 0.75


@pytest.mark.parametrize('seed', [1, 2, 3])
@pytest.mark.parametrize(('c', 'least', 'most'), [(360.0, 0.8, 1.0), (1e5, 0.0, 0.0)])
def test_a_band_of_wires_that_strips_askew_leave_no_air_between_is_one(c, least, most, seed):
    rng = np.random.default_rng(seed)
    wires = [
        make_wire((0.0, y, 8.0), (41.0, y, 8.0), c, 14.0, 0.03, 10 * seed + k)
        for k, y in enumerate((-0.3, 0.0, 0.3))
    ]
    for wire in wires:
        wire[:, 1] += rng.uniform(-0.25, 0.25, len(wire))
    ground = rng.uniform((-15.0, -20.0, -0.03), (56.0, 20.0, 0.03), (20_000, 3))
    result = Pipeline().run(np.vstack([ground, *wires]))
    share = (result.line_id[len(ground) :] >= 0).mean()
    assert least <= share <= most


def test_each_span_tells_the_evidence_for_it(result):
    # conductors of a clean line hang free all along, and others run beside them
    for span in result.spans:
        assert span.evidence == pytest.approx(span.length + 8.0, abs=0.1 * span.length)
