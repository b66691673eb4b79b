# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import (
    hang,
    make_curve,
    make_ground,
    make_line_cloud,
    make_pole,
    make_tree,
    make_wire,
    turn,
)

from plc_inspect.config import Settings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.layout import find_layout, Layout
from plc_inspect.core.spans.route import trace_routes
from plc_inspect.core.spans.spans import build_spans, spread_spans
from plc_inspect.core.spans.stations import Station

SETTINGS = Settings()


def build(points, label, num_wires, seed=0):
    """Build the spans from curves fitted to the true points of each wire."""
    wire = np.flatnonzero(label == 14)
    curves = [make_curve(points, own) for own in np.array_split(wire, num_wires)]
    return finish(points, curves, seed)


def finish(points, curves, seed=0):
    """Build the spans of curves, and label all points."""
    layout = find_layout(points, curves, (), SETTINGS.supports)
    height = extract_high(points, SETTINGS.height)
    cloud = gather_off_ground(points, height, -np.inf)
    spans = build_spans(
        cloud, layout, trace_routes(layout), SETTINGS, np.random.default_rng(seed)
    )
    return spread_spans(spans, cloud)


@pytest.fixture(scope='module')
def cloud():
    """Make two spans of 100 m with three conductors on poles."""
    return make_line_cloud(spans=(100.0, 100.0))


@pytest.fixture(scope='module')
def result(cloud):
    """Build its spans."""
    return build(*cloud, 6)


def test_every_span_hangs_between_its_supports(result):
    assert [(model.span.line_id, model.span.span_id) for model in result.models] == [
        (line, span) for line in range(3) for span in range(2)
    ]
    for model in result.models:
        span = model.span
        assert span.length == pytest.approx(100.0, abs=0.4)
        np.testing.assert_allclose(span.start, [100.0 * span.span_id, 3.0 - 3 * span.line_id, 15],
                                   atol=0.25)
        assert span.azimuth == pytest.approx(0.0, abs=0.005)
        assert not span.open_start
        assert not span.open_end
        assert span.c == pytest.approx(800.0, rel=0.03)
        assert span.sag == pytest.approx(1.563, abs=0.02)
        assert span.rmse == pytest.approx(0.02, rel=0.2)
        assert span.coverage > 0.95
        assert 0 < span.sigma['sag'] < 0.02


def test_the_catenary_and_the_quadratic_of_a_span_are_its_curve(result):
    assert result.models
    for model in result.models:
        span = model.span
        x = np.linspace(0.0, span.length, 50)
        z = span.a + span.c * np.cosh((x - span.b) / span.c)
        assert z[0] == pytest.approx(span.start[2], abs=1e-6)
        assert z[-1] == pytest.approx(span.end[2], abs=1e-6)
        a2, a1, a0 = span.quadratic
        np.testing.assert_allclose(a2 * x**2 + a1 * x + a0, z, atol=0.03)
        assert span.lowest[2] == pytest.approx(z.min(), abs=1e-3)
        chord = span.start[2] + x / span.length * (span.end[2] - span.start[2])
        assert span.sag == pytest.approx((chord - z).max(), abs=2e-3)
        run = span.end[:2] - span.start[:2]
        assert np.hypot(*run) == pytest.approx(span.length)
        assert np.arctan2(run[1], run[0]) == pytest.approx(span.azimuth)


def test_labels_agree_with_the_truth_and_with_the_spans(cloud, result):
    points, label = cloud
    wire = result.line_id >= 0
    np.testing.assert_array_equal(wire, result.span_id >= 0)
    np.testing.assert_array_equal(wire, np.isfinite(result.residual))
    assert (wire & (label == 14)).sum() > 0.99 * (label == 14).sum()
    assert (wire & (label != 14)).sum() < 0.01 * wire.sum()
    for model in result.models:
        own = (result.line_id == model.span.line_id) & (result.span_id == model.span.span_id)
        assert own.sum() == model.span.num_points
        x, y = model.curve.local(points[own])
        z = points[own, 2] - model.curve.fit.height(x)
        np.testing.assert_allclose(result.residual[own], np.hypot(y, z), atol=5e-3)


def test_supports_stand_where_the_poles_are(cloud, result):
    _, label = cloud
    assert len(result.supports) == 3
    for number, support in enumerate(result.supports):
        assert support.support_id == number
        np.testing.assert_allclose(support.position, [100.0 * number, 0.0, 0.0], atol=0.3)
        assert support.height == pytest.approx(16.0, abs=0.2)
        assert support.kind in ('pole', 'tower')
        assert support.line_ids == (0, 1, 2)
    assert (result.support & (label == 15)).sum() > 0.7 * (label == 15).sum()
    assert not (result.support & (result.line_id >= 0)).any()


def test_the_height_above_ground_is_measured_along_the_span(result):
    assert result.models
    for model, stations in zip(result.models, result.ground_below, strict=True):
        assert stations.shape[1] == 2
        assert stations[:, 0].min() >= 0.0
        assert stations[:, 0].max() <= model.span.length + 1e-6
        expected = hang(stations[:, 0], 100.0, 15.0, 15.0, 800.0)
        np.testing.assert_allclose(stations[:, 1], expected, atol=0.3)


def test_points_that_earlier_stages_dropped_come_back():
    points, label = make_line_cloud(spans=(100.0, 100.0))
    wire = np.flatnonzero(label == 14)
    curves = [make_curve(points, own[::5]) for own in np.array_split(wire, 6)]
    result = finish(points, curves)
    assert (result.line_id[wire] >= 0).mean() > 0.98


def test_a_line_that_leaves_the_cloud_is_open():
    points, label = make_line_cloud(spans=(100.0, 100.0), poles=False)
    keep = (points[:, 0] > 15.0) & (points[:, 0] < 180.0)
    result = build(points[keep], label[keep], 6)
    for model in result.models:
        span = model.span
        assert span.open_start == (span.span_id == 0)
        assert span.open_end == (span.span_id == 1)
    assert [support.kind for support in result.supports] == ['unseen']


def test_conductors_that_end_at_a_pole_from_both_sides_are_closed_there():
    """One high, one low, and nothing says that the one goes on as the other."""
    wires = (
        make_wire((-60.0, 0.0, 15.0), (-0.5, 0.0, 15.0)),
        make_wire((0.5, 0.5, 11.0), (60.0, 0.5, 11.0)),
    )
    points = np.vstack([*wires, make_ground((-80.0, -20.0), (80.0, 20.0)), make_pole(0, 0, 16)])
    numbers = np.split(np.arange(sum(map(len, wires))), [len(wires[0])])
    spans = finish(points, [make_curve(points, own) for own in numbers])
    ends = [
        (end[0], is_open)
        for model in spans.models
        for end, is_open in ((model.span.start, model.span.open_start),
                             (model.span.end, model.span.open_end))
        if abs(end[0]) < 30
    ]
    assert len(ends) == 2
    for x, is_open in ends:
        assert abs(x) < 1.0
        assert not is_open


@pytest.mark.parametrize('degrees', [90, 90.001, -90, 37, 180])
@pytest.mark.parametrize('seed', [3, 5, 7])
def test_the_spans_of_one_stretch_run_the_same_way(degrees, seed):
    points, label = make_line_cloud(
        spans=(100.0, 100.0), per_metre=1.5, noise=0.04, seed=seed, half_width=12.0
    )
    result = build(turn(points, np.radians(degrees)), label, 6, seed)
    assert len(result.models) == 6
    for number in range(2):
        azimuth = [m.span.azimuth for m in result.models if m.span.span_id == number]
        assert np.cos(np.array(azimuth) - azimuth[0]).min() > 0.99
    for support in result.supports:
        assert support.line_ids == (0, 1, 2)
    for model in result.models:
        run = model.span.end - model.span.start
        assert np.cos(np.arctan2(run[1], run[0]) - model.span.azimuth) > 0.99


def test_a_tree_beside_a_support_is_not_part_of_it():
    tree = make_tree(103.0, 0.0, 14.0)
    points, label = make_line_cloud(spans=(100.0, 100.0), poles=False, more=[tree])
    result = build(points, label, 6)
    assert result.support[-len(tree):].mean() < 0.5


def test_no_curves_give_no_spans():
    points, _ = make_line_cloud(poles=False)
    result = finish(points, [])
    assert result.models == result.supports == result.ground_below == ()
    assert (result.line_id == -1).all()
    assert not result.support.any()


def test_the_same_generator_gives_the_same_spans_and_input_is_unchanged(cloud, result):
    points, label = cloud
    before = points.copy()
    again = build(points, label, 6)
    np.testing.assert_array_equal(points, before)
    np.testing.assert_array_equal(again.line_id, result.line_id)
    np.testing.assert_array_equal(again.residual, result.residual)
    assert [m.span.sag for m in again.models] == [m.span.sag for m in result.models]


def test_a_pole_tells_where_a_span_ends_better_than_curves_that_cross_at_a_shallow_angle():
    errors = []
    for seed in range(4):
        points, label = make_line_cloud(
            spans=(60.0, 60.0), c=1500.0, per_metre=3.0, noise=0.05, seed=seed
        )
        for chosen in (np.ones(len(points), dtype=bool), label != 15):
            result = build(points[chosen], label[chosen], 6)
            ends = [model.span.end for model in result.models if model.span.span_id == 0]
            errors.append(np.abs(np.array(ends)[:, 0] - 60.0).mean())
    with_pole, without = np.array(errors).reshape(-1, 2).mean(axis=0)
    assert with_pole < 0.1
    assert with_pole < 0.5 * without


def test_ends_at_one_pole_have_one_support():
    pole = make_pole(0.0, 0.0, 9.5)[:300]
    wires = [
        make_wire((-60.0, 0.2, 9.0), (-0.2, 0.2, 9.0), c=300.0),
        make_wire((1.0, -0.2, 7.0), (38.0, -46.0, 7.5), c=300.0, seed=1),
        make_wire((-1.0, 0.0, 8.0), (-40.0, 44.0, 8.5), c=300.0, seed=2),
    ]
    points = np.vstack([*wires, pole, make_ground((-65.0, -50.0), (45.0, 50.0))])
    bounds = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(points, np.arange(*bounds[k : k + 2])) for k in range(3)]
    result = finish(points, curves)
    assert [item.line_ids for item in result.supports if item.kind == 'pole'] == [(0, 1, 2)]
    for model in result.models:
        ends = np.array([model.span.start[:2], model.span.end[:2]])
        assert np.linalg.norm(ends, axis=1).min() < 0.85  # they pass its axis that near


def test_what_goes_on_beyond_the_last_pole_belongs_to_it():
    stub = make_wire((100.05, 0.0, 15.0), (102.0, 0.0, 14.95), c=800.0)
    points, label = make_line_cloud(spans=(100.0,), more=[stub])
    result = build(points, label, 3)
    assert (result.support | (result.line_id >= 0))[label == 1].all()


def test_what_crosses_at_one_place_has_one_support():
    wires = [
        make_wire((-60.0, 0.0, 9.0), (0.0, 0.0, 9.0), c=300.0),
        make_wire((0.0, 0.0, 9.0), (60.0, 0.0, 9.0), c=300.0, seed=1),
        make_wire((0.1, -50.0, 8.0), (0.1, 0.0, 8.0), c=300.0, seed=2),
        make_wire((0.1, 0.0, 8.0), (0.1, 50.0, 8.0), c=300.0, seed=3),
    ]
    points = np.vstack([*wires, make_ground((-65.0, -55.0), (65.0, 55.0))])
    bounds = np.cumsum([0, *map(len, wires)])
    curves = [make_curve(points, np.arange(*bounds[k : k + 2])) for k in range(4)]
    result = finish(points, curves)
    middle = [item for item in result.supports if np.linalg.norm(item.position[:2]) < 5.0]
    assert [item.line_ids for item in middle] == [(0, 1)]


def test_a_piece_whose_ends_are_drawn_past_each_other_is_no_span():
    wire = make_wire((0.05, 0.0, 9.0), (12.0, 0.0, 9.0), c=300.0, per_metre=60.0)
    points = np.vstack([wire, make_ground((-10.0, -10.0), (20.0, 10.0))])
    curve = make_curve(points, np.arange(len(wire)))
    layout = Layout(
        curves=(curve,), start_x=np.array([curve.low]), end_x=np.array([curve.high]),
        start_station=(-1,), end_station=(0,), joints=(),
        stations=(Station(position=np.zeros(2), direction=0.0, attachments=wire[:1]),),
    )
    height = extract_high(points, SETTINGS.height)
    spans = build_spans(
        gather_off_ground(points, height, -np.inf), layout, trace_routes(layout), SETTINGS,
        np.random.default_rng(0),
    )
    assert not spans.models
    assert not spans.supports
    assert (spans.line_id < 0).all()
