# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Whole scenes through the pipeline, against their exact truth."""

import numba
import numpy as np
import pytest

from plc_inspect.core.pipeline import Pipeline
from plc_inspect.sim.evaluation.estimate import from_result
from plc_inspect.sim.evaluation.evaluate import evaluate
from plc_inspect.sim.evaluation.reference import parse_truth
from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.surveys.airborne import simulate_map
from plc_inspect.sim.surveys.truth import collect_sightings, make_truth

NOISE = 0.03


def survey(name, density=20.0, seed=0):
    """Return the map of a scene, its result, and the scores of it."""
    scene = make_scene(name, seed)
    cloud = simulate_map(scene, density, np.random.default_rng(seed), noise=NOISE)
    result = Pipeline().run(cloud.points)
    sightings = collect_sightings(scene, cloud.exact, cloud.label, cloud.conductor)
    truth = make_truth(scene, sightings, kind='map', frame_id='map', bin_size=1.0, noise=NOISE)
    scores = evaluate(from_result(result, cloud.points), parse_truth(truth, cloud.label))
    return cloud, result, scores


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'density', 'found'), [
    ('rack', 20.0, 0.85), ('street', 20.0, 1.0), ('angle', 10.0, 1.0), ('low_voltage', 10.0, 0.95),
    ('medium_voltage', 10.0, 1.0), ('hidden', 6.0, 1.0),
])
def test_lines_of_every_kind_are_found(name, density, found):
    cloud, result, scores = survey(name, density)
    assert scores.wire.f1 >= 0.98
    assert scores.spans.recall >= found
    assert scores.spans.false == 0
    assert scores.vertical_rmse.median <= 0.04
    assert scores.sag.median <= 0.05
    assert scores.support_position.median <= 1.0
    assert scores.clearance.median <= 0.10
    assert scores.hazards.required_found == scores.hazards.required
    assert scores.hazards.false == 0
    pairs = [(span.line_id, span.span_id) for span in result.spans]
    assert len(pairs) == len(set(pairs))
    assert pairs == sorted(pairs)
    wire = result.line_id >= 0
    labels = set(zip(result.line_id[wire].tolist(), result.span_id[wire].tolist(), strict=True))
    assert labels == set(pairs)
    for span in result.spans:
        own = (result.line_id == span.line_id) & (result.span_id == span.span_id)
        assert (own & wire).sum() == span.num_points
    assert len(cloud.points) == result.num_points


@pytest.mark.slow
@pytest.mark.parametrize('name', ['no_line', 'town'])
@pytest.mark.parametrize('density', [5.0, 12.0])
def test_there_is_no_line_where_there_is_none(name, density):
    cloud = simulate_map(make_scene(name, 0), density, np.random.default_rng(0), noise=NOISE)
    result = Pipeline().run(cloud.points)
    assert result.spans == result.hazards == ()
    assert (result.line_id == -1).all()


def test_three_points_a_metre_still_give_the_line():
    _, _, scores = survey('angle', 3.0 / 0.65)
    assert scores.wire.f1 >= 0.95
    assert scores.spans.recall >= 0.9
    assert scores.spans.false == 0


def test_runs_repeat_whatever_the_number_of_threads():
    cloud = simulate_map(make_scene('rack', 1), 10.0, np.random.default_rng(1), noise=NOISE)
    one, again = Pipeline().run(cloud.points), Pipeline().run(cloud.points)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = Pipeline().run(cloud.points)
    finally:
        numba.set_num_threads(threads)
    assert len(one.spans) > 10
    for other in (again, alone):
        for name in ('line_id', 'span_id', 'residual', 'clearance', 'classification',
                     'decision', 'corridor', 'ground_height'):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
        for first, second in zip(one.spans, other.spans, strict=True):
            assert (first.a, first.b, first.c, first.sag) == (
                second.a, second.b, second.c, second.sag
            )
            assert (first.start.tolist(), first.end.tolist()) == (
                second.start.tolist(), second.end.tolist()
            )
