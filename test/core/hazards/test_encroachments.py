# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Objects near conductors: what a support explains, and what an object is as a whole."""

import dataclasses
from functools import partial

from factories import make_model
import numpy as np
import pytest
from toys import make_tree

from plc_inspect.config import HazardSettings
from plc_inspect.core.extraction.surfaces import tell_shapes
from plc_inspect.core.ground.ground_planes import find_planes
from plc_inspect.core.hazards.clearance_rules import parse_rules, plain_rules
from plc_inspect.core.hazards.encroachments import find_encroachments, is_held, Surroundings
from plc_inspect.core.hazards.falling_trees import Fallible, find_falling_trees
from plc_inspect.core.hazards.trees import segment_trees
from plc_inspect.results import HazardKind, Severity, Support

SETTINGS = HazardSettings(fall_distance=2.0)
RULES = plain_rules(SETTINGS)
ENDS = ((0.0, 0.0, 12.0), (100.0, 0.0, 12.0))


def make_supports(kind):
    if kind is None:
        return ()
    return tuple(
        Support(support_id=k, position=np.array([x, 0.0, 0.0]), height=12.0, kind=kind,
                line_ids=(0,))
        for k, x in enumerate((0.0, 100.0))
    )


def search(points, surface=None, supports=(), rules=RULES):
    """Find encroachments among points near one span over flat ground at 0."""
    model = make_model(*ENDS)
    x, horizontal, vertical = model.part(points)
    around = Surroundings(
        points=points, height=points[:, 2].copy(), distance=np.hypot(horizontal, vertical),
        owner=np.zeros(len(points), dtype=np.int64),
        surface=np.zeros(len(points), dtype=bool) if surface is None else surface,
    )
    assert x.shape == (len(points),)
    return find_encroachments(around, [model], supports, rules, SETTINGS)


def make_column(x, y=0.0, top=11.0, num=60):
    """Points of a thin pole."""
    rng = np.random.default_rng(4)
    return np.column_stack([x + rng.normal(0, 0.05, num), y + rng.normal(0, 0.05, num),
                            np.linspace(1.0, top, num)])


@pytest.mark.parametrize('backwards', [False, True])
@pytest.mark.parametrize(('kind', 'room'), [
    ('pole', 1.5), ('tower', 5.0), ('unseen', 0.75), (None, 0.75),
])
def test_supports_explain_what_is_near_them_along_the_line_on_both_sides(kind, room, backwards):
    places = np.array([-room - 0.1, -room + 0.1, 0.0, room - 0.1, room + 0.1, 50.0,
                       100.0 - room - 0.1, 100.0 - room + 0.1, 100.0 + room + 0.1])
    points = np.column_stack([places, np.full(9, 0.5), np.full(9, 11.0)])
    before = points.copy()
    held = is_held(points, make_model(*(ENDS[::-1] if backwards else ENDS)), make_supports(kind))
    assert held.tolist() == [False, True, True, True, False, False, False, True, False]
    np.testing.assert_array_equal(points, before)
    assert is_held(points[:0], make_model(*ENDS), make_supports(kind)).shape == (0,)


@pytest.mark.parametrize(('aside', 'held'), [(6.0, True), (15.0, False)])
def test_a_support_of_other_lines_explains_only_what_is_near_it(aside, held):
    others = tuple(
        dataclasses.replace(item, line_ids=(7,), position=np.add(item.position, [0.0, aside, 0.0]))
        for item in make_supports('tower')
    )
    assert is_held(np.array([[4.0, 0.0, 11.0]]), make_model(*ENDS), others).tolist() == [held]


@pytest.mark.parametrize('kind', ['pole', 'tower', 'unseen', None])
def test_the_pole_that_holds_an_end_is_no_hazard(kind):
    records, explained = search(make_column(0.1), supports=make_supports(kind))
    assert records == []
    assert explained.sum() >= 10


def test_a_bush_at_a_pole_is_as_near_as_its_own_points_are():
    bush = make_tree(2.0, 0.0, 9.0, bottom=2.0)
    (alone,), _ = search(bush, supports=make_supports('pole'))
    pole = make_column(0.0, top=10.5)
    (record,), explained = search(np.vstack([bush, pole]), supports=make_supports('pole'))
    assert record['clearance'] == alone['clearance']
    assert not explained[:len(bush)].any()


@pytest.mark.parametrize('x', [-3.0, 50.0])
def test_a_thin_tree_elsewhere_is_one_and_so_is_one_behind_the_last_pole(x):
    (record,), explained = search(make_column(x), supports=make_supports('pole'))
    assert record['kind'] == HazardKind.VEGETATION
    assert record['position'][0] == pytest.approx(x, abs=0.3)
    assert not explained.any()


def test_a_tree_at_a_tower_is_not_as_tall_as_the_tower():
    tower = make_column(4.7, y=0.5, top=25.0, num=200)
    tree = make_tree(4.7, 0.5, 10.0, bottom=2.0)
    assert segment_trees(np.vstack([tower, tree]), np.hstack([tower[:, 2], tree[:, 2]])).max() == 0
    records, _ = search(np.vstack([tower, tree]), supports=make_supports('tower'))
    assert records
    assert all(record['height'] < 12.5 for record in records)


@pytest.mark.parametrize(('share', 'kind'), [
    (0.05, HazardKind.VEGETATION), (0.35, HazardKind.VEGETATION), (0.8, HazardKind.STRUCTURE),
])
def test_most_of_the_whole_object_says_what_it_is(share, kind):
    points = make_tree(50.0, 0.0, 10.0, bottom=2.0)
    flat = np.random.default_rng(0).random(len(points)) < share
    records, _ = search(points, flat)
    assert [record['kind'] for record in records] == [kind]
    assert records[0]['clearance'] == pytest.approx(search(points)[0][0]['clearance'])


def test_what_may_be_either_is_judged_by_the_severer_rule():
    points = make_tree(50.0, 0.0, 9.0, bottom=2.0)
    flat = np.random.default_rng(0).random(len(points)) < 0.35
    near = dataclasses.replace(SETTINGS, critical_distance=1.0)
    limits = [
        limit if limit.feature == 'vegetation' else dataclasses.replace(
            limit, tiers=((Severity.CRITICAL, 3.9), (Severity.WARNING, 4.0)))
        for limit in plain_rules(near).limits
    ]
    records, _ = search(points, flat, rules=dataclasses.replace(RULES, limits=tuple(limits)))
    assert [(item['kind'], item['severity']) for item in records] == [
        (HazardKind.STRUCTURE, Severity.CRITICAL)
    ]


def test_a_flat_part_that_happens_to_offend_does_not_make_a_tree_a_structure():
    points = make_tree(50.0, 0.0, 9.0, bottom=2.0)
    flat = points[:, 2] > 8.6
    assert 0.0 < flat.mean() < 0.15
    records, _ = search(points, flat)
    assert [record['kind'] for record in records] == [HazardKind.VEGETATION]


@pytest.mark.parametrize(('rise', 'num'), [(0.02, 0), (0.25, 0), (0.4, 1), (3.0, 1)])
def test_what_hardly_rises_above_the_ground_is_of_it(rise, num):
    rng = np.random.default_rng(0)
    points = rng.uniform((48.0, -1.0, 0.5), (52.0, 1.0, 0.5 + rise), (60, 3))
    reach = make_model(*ENDS).part(points)[2].max() + 1.0
    rules = plain_rules(HazardSettings(warning_distance=float(reach), critical_distance=2.0))
    assert len(search(points, rules=rules)[0]) == num


def test_nothing_near_gives_nothing():
    records, explained = search(np.zeros((0, 3)))
    assert records == []
    assert explained.shape == (0,)


def make_fallible(points, slender=False):
    return Fallible(
        points=points, height=points[:, 2].copy(), surface=np.zeros(len(points), dtype=bool),
        slender=np.full(len(points), slender),
    )


@pytest.mark.parametrize(('x', 'y', 'slender', 'falls'), [
    (3.0, 4.0, True, False), (97.0, -8.0, True, False),  # towers whose support is not known
    (3.0, 4.0, False, True), (50.0, 4.0, True, True), (3.0, 14.0, True, True),
])
def test_a_tower_at_an_end_does_not_fall(x, y, slender, falls):
    points = make_column(x, y=y, top=20.0) if slender else make_tree(x, y, 20.0, bottom=2.0)
    records = find_falling_trees(
        make_fallible(points, slender), [make_model(*ENDS)], (), RULES, SETTINGS, []
    )
    assert [record['kind'] for record in records] == [HazardKind.FALL_IN] * falls


def make_lattice(x, y, top):
    """Return points (N, 3) of legs, rings and braces of a tower [m]."""
    levels = np.linspace(0.0, top, 9)
    half = np.linspace(5.0, 1.5, 9)
    ways = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    corners = np.concatenate(
        [half[:, None, None] * ways, np.tile(levels[:, None, None], (1, 4, 1))], axis=2
    )
    bars = []
    for k in range(8):
        for way in range(4):
            beside = (way + 1) % 4
            bars += [(corners[k, way], corners[k + 1, way]), (corners[k, way], corners[k, beside]),
                     (corners[k, way], corners[k + 1, beside])]
    share = np.linspace(0.0, 1.0, 60)[:, None]
    place = np.array([x, y, 0.0])
    return np.vstack([place + start + share * (end - start) for start, end in bars])


@pytest.mark.parametrize(('thing', 'falls'), [('lattice', 0), ('tree', 1), ('trunk', 1)])
def test_a_tower_of_another_line_does_not_fall(thing, falls):
    """Its conductors were not found; a bare trunk as tall does fall."""
    points = {'lattice': make_lattice, 'tree': make_tree, 'trunk': make_column}[thing](
        50.0, 14.0, 40.0, *([300] if thing == 'trunk' else []))
    surface, slender = tell_shapes(points)
    fallible = Fallible(points=points, height=points[:, 2].copy(), surface=surface,
                        slender=slender)
    records = find_falling_trees(fallible, [make_model(*ENDS)], (), RULES, SETTINGS, [])
    assert len(records) == falls


@pytest.mark.parametrize(('y', 'falls'), [(4.0, False), (14.0, True)])
def test_a_pole_of_few_points_at_an_end_does_not_fall(y, falls):
    points = make_column(3.0, y=y, top=20.0, num=17)  # too few about each to tell its shape
    records = find_falling_trees(
        make_fallible(points), [make_model(*ENDS)], (), RULES, SETTINGS, []
    )
    assert [record['kind'] for record in records] == [HazardKind.FALL_IN] * falls


@pytest.mark.parametrize(('bottom', 'top', 'falls'), [
    (18.0, 23.0, False), (2.5, 20.0, True), (11.0, 22.0, True),
])
def test_what_hangs_above_a_few_points_by_more_than_they_are_tall_does_not_fall(
    bottom, top, falls
):
    points = np.array([
        (50.0, 6.0, bottom), (50.3, 6.0, 19.0), (50.1, 6.0, top), (50.2, 6.0, 23.1),
    ])
    records = find_falling_trees(
        make_fallible(points), [make_model(*ENDS)], (), RULES, SETTINGS, []
    )
    assert [record['height'] for record in records] == [23.1] * falls


@pytest.mark.parametrize(('seen', 'sigma'), [(True, 0.15), (False, 0.335)])
def test_a_tree_is_less_surely_as_tall_where_the_ground_below_it_was_not_seen(seen, sigma):
    tree = make_tree(50.0, 6.0, 11.0, bottom=2.5)
    side = np.arange(-1.5, 1.51, 0.25) + (0.0 if seen else 6.0)
    x, y = (axis.ravel() for axis in np.meshgrid(50.0 + side, 6.0 + side))
    rough = np.random.default_rng(0).normal(0.0, 0.02, x.size)
    points = np.vstack([tree, np.column_stack([x, y, rough])])
    (record,) = find_falling_trees(
        make_fallible(tree), [make_model(*ENDS)], (), RULES, SETTINGS, [],
        partial(find_planes, points, points[:, 2].astype(np.float32)),
    )
    assert record['sigma'] == pytest.approx(sigma, abs=0.01)


def test_one_point_high_above_a_few_is_not_of_their_tree():
    low = np.column_stack([50.0 + 0.2 * np.arange(6), np.full(6, 6.0), 1.0 + 0.5 * np.arange(6)])
    stray = np.array([[50.4, 6.0, 12.0]])
    assert not find_falling_trees(
        make_fallible(np.vstack([low, stray])), [make_model(*ENDS)], (), RULES, SETTINGS, []
    )


@pytest.mark.parametrize(('num', 'tall'), [(1, 0.2), (2, 0.2), (9, 0.2), (9, 3.0), (12, 0.2)])
def test_points_of_a_wire_high_above_a_bush_are_not_of_it(num, tall):
    """A crown has more points, or is taller than a wire is thick."""
    rng = np.random.default_rng(0)
    bush = rng.uniform((49.5, 5.5, 6.5), (50.5, 6.5, 8.0), (14, 3))
    above = rng.uniform((49.5, 5.5, 30.0), (50.5, 6.5, 30.0 + tall), (num, 3))
    above[:2, 2] = (30.0, 30.0 + tall)[: min(num, 2)]
    records = find_falling_trees(
        make_fallible(np.vstack([bush, above])), [make_model(*ENDS)], (), RULES, SETTINGS, []
    )
    assert len(records) == (num >= 10 or tall > 1.0)


@pytest.mark.parametrize(('x', 'falls'), [(0.0, False), (50.0, True)])
def test_what_holds_a_conductor_does_not_fall_on_it(x, falls):
    points = make_column(x, y=3.0, top=20.0)
    fallible = make_fallible(points)
    records = find_falling_trees(
        fallible, [make_model(*ENDS)], make_supports('tower'), RULES, SETTINGS, []
    )
    assert [record['kind'] for record in records] == [HazardKind.FALL_IN] * falls


@pytest.mark.parametrize(('num', 'falls'), [(1, False), (4, False), (0, True)])
def test_wires_that_were_not_found_do_not_fall(num, falls):
    """A rack of wires beside the conductor; without one, a tree that is as tall."""
    rng = np.random.default_rng(2)
    x = rng.uniform(30.0, 70.0, 400)
    points = np.column_stack([x, np.full(400, 6.0), 11.0 - 0.4 * (np.arange(400) % max(num, 1))])
    points += rng.normal(0.0, 0.03, points.shape)
    if num == 0:
        points = make_tree(50.0, 6.0, 11.0, bottom=3.0)
    fallible = make_fallible(points)
    records = find_falling_trees(
        fallible, [make_model(*ENDS)], make_supports('pole'), RULES, SETTINGS, []
    )
    assert [record['kind'] for record in records] == [HazardKind.FALL_IN] * falls


@pytest.mark.parametrize(('aside', 'falls'), [(0.0, False), (0.5, True)])
def test_a_few_points_on_one_straight_line_do_not_fall(aside, falls):
    points = np.column_stack([np.full(5, 50.0), np.full(5, 4.0), np.linspace(2.0, 10.0, 5)])
    points[::2, 0] += aside
    records = find_falling_trees(
        make_fallible(points), [make_model(*ENDS)], (), RULES, SETTINGS, []
    )
    assert [record['kind'] for record in records] == [HazardKind.FALL_IN] * falls


def test_pieces_of_wires_high_up_do_not_fall_with_the_tree_below():
    tree = make_tree(50.0, 6.0, 11.0, bottom=3.0)
    piece = np.array([[50.0, 6.0, 30.0], [50.5, 6.2, 30.1], [51.0, 6.4, 30.0]])
    for points, num in ((tree, 1), (piece, 0), (np.vstack([tree, piece]), 1)):
        fallible = make_fallible(points)
        records = find_falling_trees(
            fallible, [make_model(*ENDS)], make_supports('pole'), RULES, SETTINGS, []
        )
        assert len(records) == num
        assert all(record['height'] == pytest.approx(11.0, abs=0.2) for record in records)


@pytest.mark.parametrize('gap', [0.08, 3.0])
def test_what_may_reach_the_conductor_says_so_in_sigma(gap):
    """Points this near are taken for the conductor, so a tree may begin nearer than it seems."""
    model = make_model(*ENDS)
    top = float(model.curve.position(model.at(np.array(50.0)))[0, 2]) - gap
    (record,), _ = search(make_column(50.0, top=top))
    assert record['clearance'] == pytest.approx(gap, abs=0.06)
    touches = record['clearance'] - 1.96 * record['sigma'] <= 0.0
    assert touches == (gap < 1.0)
    if gap > 1.0:
        x, _, _ = model.part(record['position'][None])
        assert record['sigma'] == pytest.approx(model.sigma(float(x[0])))


def test_a_tree_may_begin_at_its_strays_and_no_nearer():
    rng, model = np.random.default_rng(7), make_model(*ENDS)
    z = float(model.curve.position(model.at(np.array(50.0)))[0, 2])
    crown = np.array([49.0, -0.5, z - 4.0]) + rng.uniform(0.0, 1.0, (500, 3))
    stray = np.array([[49.5, -0.5, z - 1.9]])
    (record,), _ = search(np.vstack([crown, stray]))
    assert record['clearance'] == pytest.approx(3.0, abs=0.05)
    assert record['sigma'] == pytest.approx((3.0 - 2.0) / np.sqrt(3.0), abs=0.07)
    assert record['confidence'] > 0.95


def test_what_may_reach_another_conductor_says_so_in_sigma():
    """The nearest point is of the sharp conductor, others are at the edge of the blurred one."""
    sharp = make_model(*ENDS, tolerance=0.1)
    blurred = make_model((0.0, 0.8, 12.0), (100.0, 0.8, 12.0), line_id=1, tolerance=0.4)
    rng = np.random.default_rng(6)
    z = float(sharp.curve.position(sharp.at(np.array(50.0)))[0, 2])
    points = np.column_stack([rng.uniform(49.5, 50.5, 400), rng.uniform(-0.5, 1.3, 400),
                              rng.uniform(z - 1.5, z - 0.3, 400)])
    apart = np.array([np.hypot(*model.part(points)[1:]) for model in (sharp, blurred)])
    free = apart[1] > 0.4  # what is nearer is taken for it
    around = Surroundings(
        points=points[free], height=points[free, 2], distance=apart.min(axis=0)[free],
        owner=apart.argmin(axis=0)[free], surface=np.zeros(int(free.sum()), dtype=bool),
    )
    (record,), _ = find_encroachments(around, [sharp, blurred], (), RULES, SETTINGS)
    assert record['line_id'] == 0
    assert record['clearance'] == pytest.approx(0.32, abs=0.05)
    assert record['clearance'] - 1.96 * record['sigma'] <= 0.0


@pytest.mark.parametrize(('first', 'second'), [
    (('horizontal', 3.0, 'warning'), ('distance', 2.0, 'critical')),
    (('distance', 2.0, 'critical'), ('horizontal', 3.0, 'warning')),
])
def test_of_several_limits_the_severest_that_is_broken_counts(first, second):
    tree = make_tree(50.0, 0.0, 9.5, bottom=4.0)
    limits = [
        {'feature': 'vegetation', 'measure': measure, 'distance': distance, 'tiers': {tier: 1.0}}
        for measure, distance, tier in (first, second)
    ]
    rules = parse_rules(
        {'name': 'x', 'title': 'x', 'edition': '1', 'source': 's', 'limits': limits}, SETTINGS
    )
    (record,), _ = search(tree, rules=rules)
    assert record['severity'] is Severity.CRITICAL
    assert record['clearance'] < 2.0


@pytest.mark.parametrize(('place', 'kept'), [(0.0, 0), (100.0, 1)])
@pytest.mark.parametrize('severity', [Severity.NOTICE, Severity.CRITICAL])
def test_a_tree_that_is_as_severe_by_itself_does_not_fall_as_well(place, kept, severity):
    """A bush elsewhere is no reason to leave out a tree, nor is a milder hazard of its own."""
    tree = make_tree(50.0, 4.0, 20.0, bottom=2.0)
    known = [{
        'kind': HazardKind.VEGETATION, 'severity': severity,
        'position': tree[0] + np.array([place, 0.0, 0.0]),
    }]
    records = find_falling_trees(
        make_fallible(tree), [make_model(*ENDS)], (), RULES, SETTINGS, known
    )
    assert len(records) == max(kept, int(severity is Severity.NOTICE))
