# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazards by rule on spans made by formula: every kind found, none raised on the safe side."""

import dataclasses
import math

from factories import find_nearby, make_model, make_span, make_span_result
import numpy as np
import pytest
from toys import make_tree, make_wire

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import parse_rules, plain_rules
from plc_inspect.core.hazards.falling_trees import Fallible, find_falling_trees
from plc_inspect.core.hazards.hazards import complete_spans, find_hazards
from plc_inspect.core.hazards.low_conductors import find_low_conductors, GROUND_SIGMA
from plc_inspect.core.spans.span_model import find_support
from plc_inspect.errors import ConfigError
from plc_inspect.results import HazardKind, Severity, Support

HEIGHT = 12.0


def hang(line_id, span_id, start, end, c=800.0, seed=0):
    """Return a span with the curve of a noisy wire, and its sag."""
    model = make_model(
        start, end, line_id, span_id, c=c, points=make_wire(start, end, c, 10.0, 0.02, seed),
        open_end=False, sigma={'a': 0.01, 'b': 0.01, 'c': 1.0, 'sag': 0.01},
    )
    sag, _ = model.curve.fit.sag(model.low, model.high)
    return dataclasses.replace(model, span=dataclasses.replace(model.span, sag=sag))


def make_supports(kind='pole', lines=(0, 1, 2)):
    return tuple(
        Support(support_id=10 + number, position=np.array([x, 0.0, 0.0]), height=HEIGHT,
                kind=kind, line_ids=lines)
        for number, x in enumerate((0.0, 100.0))
    )


def three_lines():
    return [hang(i, 0, (0, y, HEIGHT), (100, y, HEIGHT), seed=i)
            for i, y in enumerate((-2.0, 0.0, 2.0))]


def search(points, models, settings=None, rules=None, supports=(), reach=20.0):
    """Run find_hazards as the pipeline does, with flat ground at 0."""
    settings = settings or HazardSettings()
    points = np.asarray(points, float).reshape(-1, 3)
    nearby = find_nearby(points, models, reach)
    spans = make_span_result(models, len(points), supports=supports)
    found = find_hazards(
        points, points[:, 2].astype(np.float32), nearby, spans, settings, rules
    )
    assert len(found.foliage) == len(nearby.index)
    return found.hazards


def height_at(model, x):
    return float(model.curve.fit.height(model.curve.local(np.array([[x, 0.0]]))[0])[0])


def tree_beside(model, x, clearance, side=1.0, seed=5):
    """Make a crown whose nearest points are at ``clearance`` beside the conductor."""
    y = model.span.start[1] + side * (clearance + 1.5)
    z = height_at(model, x)
    crown = make_tree(x, y, z + 2.0, z - 2.0, radius=1.5, num=2500, seed=seed)
    below = make_tree(x, y, z - 1.0, 0.5, radius=1.0, num=1500, seed=seed + 1)
    return np.vstack([crown, below])


def test_one_tree_is_one_hazard_with_its_place_and_size():
    models = three_lines()
    tree = tree_beside(models[2], 30.0, 1.5)
    (hazard,) = search(tree, models, supports=make_supports())
    gap = np.linalg.norm(tree - [30.0, 2.0, height_at(models[2], 30.0)], axis=1).min()
    assert hazard.kind == HazardKind.VEGETATION
    assert (hazard.line_id, hazard.span_id) == (2, 0)
    assert hazard.severity == Severity.CRITICAL
    assert hazard.clearance == pytest.approx(gap, abs=0.1)
    assert hazard.clearance == pytest.approx(math.hypot(hazard.horizontal, hazard.vertical),
                                             abs=0.02)
    assert hazard.required == 4.0
    assert 0.015 < hazard.sigma < 0.1
    assert hazard.along_span == pytest.approx(hazard.position[0], abs=0.2)
    assert (hazard.support_id, hazard.from_support) == (10, pytest.approx(hazard.along_span))
    assert hazard.height == pytest.approx(tree[:, 2].max())
    assert (hazard.extent[0] >= tree.min(axis=0)).all()
    assert hazard.voltage == 'unknown'
    assert math.isnan(hazard.years)


def test_far_end_counts_from_the_nearer_support_and_reversed_spans_too():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    back = [hang(0, 0, (100, 0, HEIGHT), (0, 0, HEIGHT))]
    tree = tree_beside(models[0], 80.0, 1.0)
    for own, along in ((models, 80.0), (back, 20.0)):
        (hazard,) = search(tree, own, supports=make_supports())
        assert hazard.along_span == pytest.approx(along, abs=1.5)
        assert hazard.support_id == 11
        assert hazard.from_support == pytest.approx(20.0, abs=1.5)


def test_trees_side_by_side_are_a_hazard_each():
    models = three_lines()
    trees = [tree_beside(models[2], x, 1.0, seed=int(x)) for x in (30.0, 34.5, 60.0)]
    found = search(np.vstack(trees), models)
    assert [round(item.along_span / 2) * 2 for item in found] == [30, 34, 60]


def test_a_crown_near_two_conductors_is_one_hazard():
    models = three_lines()
    z = height_at(models[0], 50.0)
    crown = make_tree(50.0, 0.0, z - 1.0, z - 5.0, radius=3.5, num=4000)
    found = search(crown, models)
    assert len(found) == 1
    assert found[0].vertical > 0


@pytest.mark.parametrize(('clearance', 'severity'), [
    (1.85, Severity.CRITICAL), (2.15, Severity.WARNING), (3.85, Severity.WARNING), (4.15, None),
])
def test_limits_hold_within_two_sigma(clearance, severity):
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    rng = np.random.default_rng(1)
    z = height_at(models[0], 40.0)
    wall = np.column_stack([rng.uniform(39, 41, 400), np.full(400, clearance),
                            rng.uniform(z - 0.5, z + 0.5, 400)])
    found = search(wall + rng.normal(0, 0.02, wall.shape), models)
    assert [item.severity for item in found] == ([severity] if severity else [])


def test_too_few_points_are_no_hazard():
    models = three_lines()
    z = height_at(models[1], 50.0)
    lone = np.array([[50.0, 0.0, z - 2.0], [70.0, 0.0, z - 2.0], [50.3, 0.0, z - 2.0]])
    assert search(lone, models) == ()
    assert len(search(lone, models, HazardSettings(min_points=2))) == 1


def test_no_points_no_models():
    assert search(np.zeros((0, 3)), three_lines()) == ()
    assert search(np.ones((5, 3)), []) == ()


@pytest.mark.parametrize(('kind', 'room'), [('pole', 1.5), ('tower', 5.0)])
def test_arms_of_a_support_are_no_hazard_but_a_tree_at_it_is(kind, room):
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    rng = np.random.default_rng(2)
    arm = rng.uniform((0.0, 0.8, 8.0), (0.8 * room, 2.8, 11.5), (3000, 3))
    assert search(arm, models, supports=make_supports(kind)) == ()
    assert len(search(arm, models)) == 1
    bush = rng.uniform((0.0, 0.8, 8.0), (2.0 * room, 2.8, 11.5), (6000, 3))
    assert len(search(bush, models, supports=make_supports(kind))) == 1


def test_roofs_are_structures():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    rng = np.random.default_rng(2)
    z = height_at(models[0], 50.0) - 2.5
    roof = np.column_stack([rng.uniform(45, 55, 6000), rng.uniform(-4, 4, 6000), np.full(6000, z)])
    (hazard,) = search(roof, models)
    assert hazard.kind == HazardKind.STRUCTURE
    assert hazard.clearance == pytest.approx(2.5, abs=0.05)
    assert hazard.vertical == pytest.approx(2.5, abs=0.05)


def test_years_to_the_critical_distance():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    tree = tree_beside(models[0], 40.0, 3.0)
    (hazard,) = search(tree, models, HazardSettings(growth=0.5))
    assert hazard.years == pytest.approx((hazard.clearance - 2.0) / 0.5)
    (hazard,) = search(tree_beside(models[0], 40.0, 1.0), models, HazardSettings(growth=0.5))
    assert hazard.years == 0.0


def test_rules_travel_in_the_hazard():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    settings = HazardSettings(rules='nerc', voltage=230.0, elevation=0.0)
    rules = parse_rules({
        'name': 'nerc', 'title': 'MVCD', 'edition': 'FAC', 'source': 'table 2',
        'tiers': {'critical': 1.0, 'warning': 2.5, 'notice': 6.25},
        'limits': [{'feature': 'vegetation', 'kv': 230, 'distance': 1.2, 'note': 'no work'}],
    }, settings)
    for clearance, severity in (
        (1.0, Severity.CRITICAL), (2.0, Severity.WARNING), (5.0, Severity.NOTICE),
    ):
        (hazard,) = search(tree_beside(models[0], 40.0, clearance), models, settings, rules)
        assert hazard.severity == severity
        assert hazard.required == pytest.approx(1.2)
        assert (hazard.rule, hazard.edition, hazard.source) == ('MVCD', 'FAC', 'table 2')
        assert (hazard.voltage, hazard.note) == ('230 kV', 'no work')
    with pytest.raises(ConfigError, match=r"hazards.rules is 'nerc', but"):
        search(np.zeros((0, 3)), models, settings)


def test_under_and_beside_have_their_own_distances_and_horizontal_is_horizontal():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    settings = HazardSettings()
    rules = parse_rules({
        'name': 'x', 'title': 'x', 'edition': '1', 'source': 'x', 'limits': [
            {'feature': 'vegetation', 'where': 'under', 'distance': 3.0},
            {'feature': 'vegetation', 'where': 'beside', 'distance': 1.0},
        ],
    }, settings)
    z = height_at(models[0], 50.0)
    blob = np.random.default_rng(0).normal(0.0, 0.15, (200, 3))
    (under,) = search(blob + np.array([50.0, 0.0, z - 2.5]), models, settings, rules)
    assert under.required == 3.0
    assert search(blob + np.array([50.0, 2.5, z]), models, settings, rules) == ()
    level = parse_rules({
        'name': 'x', 'title': 'x', 'edition': '1', 'source': 'x', 'limits': [
            {'feature': 'vegetation', 'measure': 'horizontal', 'distance': 3.0},
        ],
    }, settings)
    (deep,) = search(blob + np.array([50.0, 2.0, z - 8.0]), models, settings, level)
    assert deep.horizontal < 2.0
    assert deep.clearance > 7.0
    assert search(blob + np.array([50.0, 4.0, z - 1.0]), models, settings, level) == ()


@pytest.mark.parametrize(('foot', 'falls'), [(9.0, True), (13.5, True), (14.8, False)])
def test_falling_trees(foot, falls):
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT), c=5000.0)]
    tall = 18.0
    cone = make_tree(50.0, foot, tall, 0.2, radius=1.2, num=3000)
    cone = np.vstack([cone, [50.0, foot, tall]])
    settings = HazardSettings(fall_distance=0.5)
    found = [item for item in search(cone, models, settings)
             if item.kind == HazardKind.FALL_IN]
    assert len(found) == falls
    z = height_at(models[0], 50.0)
    for item in found:
        assert item.clearance == pytest.approx(math.hypot(foot, z) - tall, abs=0.05)
        assert item.height == pytest.approx(tall, abs=0.05)
    assert not any(item.kind == HazardKind.FALL_IN for item in search(cone, models))


@pytest.mark.parametrize(('num', 'below', 'falls'), [
    (1, 3.0, False), (12, 3.0, True),
    pytest.param(12, 0.7, False, id='returns of the wires that it holds'),
])
def test_the_head_of_a_pole_is_no_tree_for_points_that_reach_beyond(num, below, falls):
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    rng = np.random.default_rng(6)
    head = np.vstack([
        rng.uniform((-1.2, -0.9, 9.0), (1.2, 0.9, 11.8), (40, 3)),
        rng.uniform((1.6, -0.9, HEIGHT - below), (2.4, 0.9, HEIGHT - 0.6), (num, 3)),
    ])
    nothing = np.zeros(len(head), dtype=bool)
    found = find_falling_trees(
        Fallible(points=head, height=head[:, 2], surface=nothing, slender=nothing),
        models, make_supports(), plain_rules(HazardSettings(fall_distance=1.0)),
        HazardSettings(), (),
    )
    assert bool(found) == falls


def test_a_crown_about_a_conductor_is_not_taken_for_returns_of_it():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    crown = np.random.default_rng(7).uniform((49.0, -0.4, -0.9), (51.0, 0.4, 0.6), (60, 3))
    crown[:, 2] += HEIGHT - models[0].span.sag
    nothing = np.zeros(len(crown), dtype=bool)
    found = find_falling_trees(
        Fallible(points=crown, height=crown[:, 2], surface=nothing, slender=nothing),
        models, make_supports(), plain_rules(HazardSettings(fall_distance=1.0)),
        HazardSettings(), (),
    )
    assert len(found) == 1


def test_a_tree_that_is_a_hazard_where_it_stands_is_not_told_twice():
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    found = search(tree_beside(models[0], 40.0, 1.0), models, HazardSettings(fall_distance=1.0))
    assert [item.kind for item in found] == [HazardKind.VEGETATION]


def test_ground_is_told_once_a_span_at_its_lowest_place():
    models = three_lines()
    ground = [np.array([[10.0, 9.0], [50.0, 4.0 + k], [90.0, 9.0]]) for k in (0.3, 0.1, 0.2)]
    ground = [np.column_stack([own, np.full(3, GROUND_SIGMA)]) for own in ground]
    (hazard,) = find_low_conductors(models, ground, make_supports(), plain_rules(HazardSettings()))
    assert hazard['kind'] == HazardKind.GROUND
    assert hazard['line_id'] == 1
    assert hazard['clearance'] == hazard['vertical'] == pytest.approx(4.1)
    assert hazard['position'][0] == pytest.approx(50.0, abs=0.1)
    spans = complete_spans(models, ground)
    assert [span.ground_clearance for span in spans] == pytest.approx([4.3, 4.1, 4.2])
    assert [span.ground_along for span in spans] == [50.0] * 3
    unknown = complete_spans(models, [np.zeros((0, 2))] * 3)
    assert all(math.isnan(span.ground_clearance) for span in unknown)


def test_spans_hang_above_the_ground_that_hazards_are_judged_by():
    models = three_lines()[:1]
    # at 30 m, it would step up to the conductor, which was seen before what is below it
    ground = [np.array([
        [28.0, 9.0, 0.05], [30.0, 1.5, 0.05], [32.0, 9.0, 0.05], [50.0, 4.2, 0.05],
    ])]
    (hazard,) = find_low_conductors(models, ground, make_supports(), plain_rules(HazardSettings()))
    (span,) = complete_spans(models, ground)
    assert span.ground_clearance == hazard['clearance'] == pytest.approx(4.2)
    assert span.ground_along == hazard['along_span'] == 50.0


@pytest.mark.parametrize('turned', [False, True])
def test_spans_tell_their_conductors_to_the_left_of_their_way(turned):
    (model,) = three_lines()[:1]
    model = dataclasses.replace(model, strands=np.array([[0.3, 0.1], [-0.3, 0.0]]))
    if turned:
        span = dataclasses.replace(model.span, start=model.span.end, end=model.span.start)
        model = dataclasses.replace(model, span=span, start_x=model.end_x, end_x=model.start_x)
    (span,) = complete_spans([model], [np.zeros((0, 2))])
    way = (span.end - span.start)[:2] / span.length
    middle = model.curve.position(np.array([(model.low + model.high) / 2.0]))
    (first,), (second,) = model.strand_positions(np.array([(model.low + model.high) / 2.0]))
    left = np.array([-way[1], way[0]])
    for place, (across, above) in zip((first, second), span.strands, strict=True):
        assert (place - middle[0])[:2] @ left == pytest.approx(across)
        assert (place - middle[0])[2] == pytest.approx(above)


@pytest.mark.parametrize(('gap', 'is_found'), [(1.8, True), (2.2, False)])
def test_crossing_lines(gap, is_found):
    upper = hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))
    z = height_at(upper, 50.0)
    sag = 30.0**2 / 8 / 4000.0
    lower = hang(1, 5, (50, -15, z - gap + sag), (50, 15, z - gap + sag), c=4000.0)
    found = [item for item in search(np.zeros((0, 3)), [upper, lower])
             if item.kind == HazardKind.CROSSING]
    assert len(found) == is_found
    for item in found:
        assert (item.line_id, item.other_line_id) == (0, 1)
        assert item.clearance == pytest.approx(gap, abs=0.05)
        assert item.vertical > 0
        assert item.position == pytest.approx([50.0, 0.0, z - gap], abs=0.1)


def test_the_distance_of_curves_is_surer_than_that_of_a_point():
    found = []
    for seed in range(30):
        upper = hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT), seed=seed)
        lower = hang(1, 5, (50, -15, HEIGHT - 3.0), (50, 15, HEIGHT - 3.0), seed=100 + seed)
        true = (HEIGHT - 100.0**2 / 6400.0) - (HEIGHT - 3.0 - 30.0**2 / 6400.0)
        (item,) = search(np.zeros((0, 3)), [upper, lower])
        found.append((item.clearance - true, item.sigma))
    errors, sigma = np.array(found).T
    assert (np.abs(errors) <= 1.96 * sigma).mean() > 0.9
    assert sigma.max() < 0.02  # one point scatters by as much


def test_a_crossing_that_is_not_sure_enough_hides_no_other():
    sure = hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))
    z = height_at(sure, 50.0)
    lower = hang(2, 5, (50, -15, z - 1.7), (50, 15, z - 1.7), c=4000.0)
    unsure = hang(1, 0, (0, 0.5, z - 0.3), (54, 0.5, z - 0.3), c=4000.0)
    unsure = dataclasses.replace(
        unsure, span=dataclasses.replace(unsure.span, open_end=True))
    for least, line in ((0.2, 1), (0.6, 0)):
        found = search(np.zeros((0, 3)), [sure, unsure, lower],
                       HazardSettings(min_confidence=least))
        assert [item.line_id for item in found if item.kind == HazardKind.CROSSING] == [line]


@pytest.mark.parametrize('turned', [False, True])
def test_of_several_limits_the_most_severe_counts(turned):
    limits = [{'feature': feature, 'distance': 6.0, 'tiers': tiers}
              for feature in ('line', 'ground', 'fall_in')
              for tiers in ({'notice': 1.0}, {'critical': 0.9})]
    rules = parse_rules({'name': 'own', 'title': 'own', 'edition': '1', 'source': 'a letter',
                         'limits': limits[::-1] if turned else limits}, HazardSettings())
    models = [hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))]
    found = search(tree_beside(models[0], 40.0, 5.0), models, rules=rules)
    z = height_at(models[0], 50.0)
    lower = hang(1, 5, (50, -15, z - 1.5), (50, 15, z - 1.5), c=4000.0)
    found += search(np.zeros((0, 3)), [*models, lower], rules=rules)
    ground = [np.array([[10.0, 9.0, 0.05], [50.0, 4.0, 0.05], [90.0, 9.0, 0.05]])]
    (low,) = find_low_conductors(models, ground, (), rules)
    severity = {item.kind: item.severity for item in found} | {low['kind']: low['severity']}
    assert severity == dict.fromkeys(
        (HazardKind.FALL_IN, HazardKind.CROSSING, HazardKind.GROUND), Severity.CRITICAL)


def test_spans_that_meet_at_a_support_do_not_cross():
    first = hang(0, 0, (0, 0, HEIGHT), (100, 0, HEIGHT))
    second = hang(0, 1, (99.0, -0.4, HEIGHT), (180, 30, HEIGHT))
    assert search(np.zeros((0, 3)), [first, second]) == ()


@pytest.mark.parametrize(('deeper', 'is_found'), [(0.6, True), (0.1, False)])
def test_conductors_that_come_near_in_the_span(deeper, is_found):
    upper = hang(0, 0, (0, 0, HEIGHT + 1.0), (100, 0, HEIGHT + 1.0),
                       c=100.0**2 / 8 / (1.6 + deeper))
    lower = hang(1, 0, (0, 0, HEIGHT), (100, 0, HEIGHT), c=100.0**2 / 8 / 1.6)
    found = [item for item in search(np.zeros((0, 3)), [lower, upper])
             if item.kind == HazardKind.INTERFERENCE]
    assert len(found) == is_found
    for item in found:
        assert item.clearance == pytest.approx(1.0 - deeper, abs=0.05)
        assert {item.line_id, item.other_line_id} == {0, 1}
        assert item.required == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(('share', 'is_found'), [(1.4, True), (1.15, False)])
def test_sag_beyond_the_other_conductors(share, is_found):
    models = [
        hang(i, 0, (0, y, HEIGHT), (100, y, HEIGHT), c=800.0 / (share if i == 1 else 1.0))
        for i, y in enumerate((-4.0, 0.0, 4.0))
    ]
    found = search(np.zeros((0, 3)), models)
    assert [item.line_id for item in found] == ([1] if is_found else [])
    for item in found:
        assert item.kind == HazardKind.SAG
        assert item.clearance == pytest.approx((share - 1.0) * 100.0**2 / 8 / 800.0, abs=0.03)
        assert 'ice' in item.note


def test_nearest_support_needs_a_closed_end_and_a_support_of_the_line():
    span = make_span(0, 0, (0, 0, 10), (100, 0, 10), open_start=False, open_end=True)
    assert find_support(span, 30.0, make_supports()) == (10, 30.0)
    assert find_support(span, 90.0, make_supports()) == (10, 90.0)
    assert find_support(span, 30.0, make_supports(lines=(7,)))[0] == -1
    assert find_support(span, 30.0, ())[0] == -1
