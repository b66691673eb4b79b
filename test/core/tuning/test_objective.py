# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The objective without labels: each share by hand, and what it must not reward."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from toys import make_curve, make_line_cloud, make_tree, make_wire

from plc_inspect.config import Settings
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.core.stage_log import StageMemory
from plc_inspect.core.tuning.objective import (
    choose_part,
    FOUND_ONCE,
    gather_evidence,
    is_line,
    judge,
    measure_f1,
    measure_gaps,
    measure_stability,
    NOTHING,
    Objective,
    PRIOR,
    TIE_BREAK,
)
from plc_inspect.setting_names import update

EVIDENCE = np.column_stack([np.arange(0.5, 100.0), np.zeros(100), np.full(100, 15.0)])


def make_model(offset=0.0, noise=0.02, span_id=0, coverage=1.0, seed=0):
    """Make one span of 100 m along x with its curve."""
    points = make_wire((0.0, offset, 15.0), (100.0, offset, 15.0), noise=noise, c=5000.0,
                       seed=seed)
    curve = make_curve(points)
    span = SimpleNamespace(length=100.0, coverage=coverage, span_id=span_id)
    ends = curve.local(np.array([[0.0, offset], [100.0, offset]]))[0]
    return SpanModel(
        span=span, curve=curve, start_x=float(ends.min()), end_x=float(ends.max())
    )


def test_nothing_found_is_worth_nothing():
    assert judge([], [], EVIDENCE, Settings()) == NOTHING
    assert NOTHING.value == 0.0
    assert not is_line(NOTHING)


def test_a_clean_span_that_explains_all_is_worth_nearly_one():
    model = make_model()
    score = judge([model], [model], EVIDENCE, Settings())
    assert 0.98 < score.value <= 1.0
    assert (score.seen, score.stability, score.separation) == (1.0, 1.0, 1.0)
    assert is_line(score)


def test_what_is_not_explained_counts_against_it():
    model = make_model()
    more = np.vstack([EVIDENCE, EVIDENCE + np.array([0.0, 30.0, 0.0])])
    one = judge([model], [model], EVIDENCE, Settings())
    half = judge([model], [model], more, Settings())
    assert half.value == pytest.approx(one.value / 2, rel=1e-6)
    assert half.seen == pytest.approx(0.5)


def test_metres_without_points_are_not_seen():
    whole, part = make_model(), make_model(coverage=0.6)
    assert judge([part], [part], EVIDENCE, Settings()).value == pytest.approx(
        0.6 * judge([whole], [whole], EVIDENCE, Settings()).value
    )


def test_points_off_the_curve_count_against_it():
    scores = [
        judge([model], [model], EVIDENCE, Settings())
        for model in (make_model(noise=noise) for noise in (0.02, 0.05, 0.08))
    ]
    assert scores[0].fit > scores[1].fit > scores[2].fit
    assert scores[0].value > scores[1].value > scores[2].value


def test_one_conductor_taken_for_two_is_worth_less():
    one, same = make_model(), make_model(offset=0.03, seed=1)
    apart = make_model(offset=3.0, seed=1)
    pair = judge([one, same], [one, same], EVIDENCE, Settings())
    assert pair.separation < 0.5
    assert pair.value < judge([one], [one], EVIDENCE, Settings()).value
    assert judge([one, apart], [one, apart], EVIDENCE, Settings()).separation > 0.98


def test_gaps_are_between_conductors_of_one_span_only():
    models = [make_model(), make_model(offset=3.0), make_model(offset=0.5, span_id=1)]
    np.testing.assert_allclose(measure_gaps(models), [3.0, 3.0, np.inf], atol=0.05)


def test_what_half_of_the_points_do_not_show_again_is_worth_nothing():
    model, other = make_model(), make_model(offset=5.0)
    assert judge([model], [other], EVIDENCE, Settings()).value == 0.0
    assert not is_line(judge([model], [other], EVIDENCE, Settings()))
    assert not is_line(judge([model], [], EVIDENCE, Settings()))
    np.testing.assert_array_equal(measure_stability([model, other], [model]), [1.0, 0.0])


def test_one_of_two_that_is_not_found_again_is_worth_less_but_not_nothing():
    model, other = make_model(), make_model(offset=5.0)
    more = np.vstack([EVIDENCE, EVIDENCE + np.array([0.0, 5.0, 0.0])])
    both = judge([model, other], [model, other], more, Settings())
    once = judge([model, other], [model], more, Settings())
    lost = judge([model], [model], more, Settings())
    assert once.value == pytest.approx(both.value * (1.0 + FOUND_ONCE) / 2, rel=0.01)
    assert lost.value < once.value < both.value
    assert (once.num_stable, once.num_spans) == (1, 2)


def test_thin_conductors_that_are_in_line_in_few_cells_are_to_be_found_too():
    """Of 2 points a metre, too few cells hold enough of them to look like a line."""
    points = make_line_cloud(spans=(60.0,), half_width=15.0, per_metre=2.0)[0]
    settings = Settings()
    evidence = gather_evidence(points, settings, StageMemory(1))
    spans = Pipeline(settings).find_lines(points).spans.models
    assert len(spans) == 3
    metres = np.concatenate([
        model.curve.position(np.arange(model.low + 1.0, model.high)) for model in spans
    ])
    away = np.linalg.norm(evidence[None] - metres[:, None], axis=2)
    assert away.min(axis=1).max() <= 1.5
    assert len(evidence) < 2.5 * len(metres)
    none = gather_evidence(points, update(settings, {'catenary.min_length': 90.0}),
                           StageMemory(1))
    assert len(none) < len(evidence)


def test_of_equals_the_nearest_to_table_1_is_best():
    model = make_model()
    near, far = (
        judge([model], [model], EVIDENCE, update(Settings(), {'clustering.eps': eps}))
        for eps in (0.2, 1.0)
    )
    assert near.value * (1.0 - PRIOR) < far.value < near.value


def test_shares_of_f1():
    found = np.array([1, 1, 0, 0, 1], dtype=bool)
    wire = np.array([1, 0, 1, 0, 0], dtype=bool)
    none = np.zeros(5, dtype=bool)
    assert measure_f1(found, wire, none) == pytest.approx(0.4)
    left_out = np.array([0, 1, 0, 0, 1], dtype=bool)
    assert measure_f1(found, wire, left_out) == pytest.approx(2 / 3)
    assert measure_f1(none, none, none) == 0.0


@pytest.fixture(scope='module')
def cloud():
    return make_line_cloud(spans=(100.0, 60.0), half_width=15.0,
                           more=[make_tree(30.0, 9.0, 13.0), make_tree(60.0, -9.0, 12.0)])


def test_better_settings_have_the_better_score(cloud):
    points, label = cloud
    objective = Objective(points)
    good = objective.score(Settings())
    poor = objective.score(update(Settings(), {'catenary.min_length': 120.0}))
    nothing = objective.score(update(Settings(), {'linearity.threshold': 1.0}))
    assert good.value > 0.8
    assert good.value > poor.value + 0.1
    assert nothing == NOTHING
    truth = label == 14, np.zeros(len(label), dtype=bool)
    with_truth = Objective(points, truth=truth)
    assert with_truth.score(Settings()).f1 > 0.98
    far = with_truth.score(update(Settings(), {'height.num_bins': 500}))
    assert far.f1 * (1.0 - TIE_BREAK) <= far.value < far.f1
    assert with_truth.score(Settings()).f1 > with_truth.score(
        update(Settings(), {'catenary.min_length': 120.0})).f1


def test_trees_alone_are_worth_nothing_whatever_the_settings():
    rng = np.random.default_rng(3)
    cloud = make_line_cloud(
        offsets=(), poles=False, half_width=15.0,
        more=[make_tree(x, y, rng.uniform(8.0, 14.0), seed=k)
              for k, (x, y) in enumerate(rng.uniform((0.0, -12.0), (210.0, 12.0), (40, 2)))],
    )[0]
    objective = Objective(cloud)
    for change in ({}, {'linearity.threshold': 0.5}, {'clustering.eps': 0.5},
                   {'height.beta': 3.0, 'clustering.min_points': 30}):
        assert not is_line(objective.score(update(Settings(), change)))


def test_scores_repeat_and_points_stay(cloud):
    points = cloud[0].copy()
    first = Objective(points, seed=4).score(Settings())
    assert first == Objective(points, seed=4).score(Settings())
    np.testing.assert_array_equal(points, cloud[0])
    assert dataclasses.replace(first, value=0.0) != first


def test_the_part_of_a_large_cloud_lies_where_the_evidence_is():
    rng = np.random.default_rng(0)
    points = rng.uniform((0.0, 0.0, 0.0), (1000.0, 1000.0, 1.0), (20_000, 3))
    evidence = rng.uniform((800.0, 300.0, 9.0), (900.0, 400.0, 9.5), (50, 3))
    chosen = choose_part(points, evidence, 1000)
    assert 900 <= chosen.sum() <= 1000
    assert (np.abs(points[chosen, :2] - (850.0, 350.0)) < 150.0).all()
    assert choose_part(points, evidence, 20_000) is None
    assert choose_part(points, evidence[:0], 1000) is None
