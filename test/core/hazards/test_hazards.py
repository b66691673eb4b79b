# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from factories import find_nearby, make_model, make_span_result
import numpy as np
import pytest
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import cKDTree
from toys import make_tree

from plc_inspect.config import HazardSettings
from plc_inspect.core.extraction.surfaces import is_surface
from plc_inspect.core.hazards.hazards import find_hazards
from plc_inspect.core.numerics.grouping import group_points
from plc_inspect.errors import ConfigError
from plc_inspect.results import HazardKind, Severity

SETTINGS = HazardSettings()


def find(points, models, ground=None, **changes):
    points = np.asarray(points, float).reshape(-1, 3)
    nearby = find_nearby(points, models, 20.0)
    found = find_hazards(
        points, None, nearby, make_span_result(models, len(points), ground=ground),
        HazardSettings(**changes),
    )
    assert found.foliage.shape == nearby.index.shape
    assert [item.hazard_id for item in found.hazards] == list(range(len(found.hazards)))
    return found.hazards


LEVEL = ((0.0, 0.0, 15.0), (100.0, 0.0, 15.0))


@pytest.mark.parametrize(('top', 'severity'), [
    (9.0, None), (10.2, Severity.WARNING), (12.5, Severity.CRITICAL),
])
def test_a_tree_below_the_conductor(top, severity):
    # the conductor hangs at 13.44 m in the middle
    tree = make_tree(50.0, 0.0, top, bottom=2.0)
    hazards = find(tree, [make_model(*LEVEL)])
    if severity is None:
        assert hazards == ()
        return
    assert len(hazards) == 1
    hazard = hazards[0]
    assert (hazard.kind, hazard.severity) == (HazardKind.VEGETATION, severity)
    distance = np.hypot(tree[:, 1], 13.44 - tree[:, 2])
    assert hazard.clearance == pytest.approx(distance.min(), abs=0.05)
    assert hazard.required == SETTINGS.warning_distance
    assert hazard.vertical == pytest.approx(13.44 - hazard.position[2], abs=0.03)
    parts = np.hypot(hazard.horizontal, hazard.vertical)
    assert parts == pytest.approx(hazard.clearance, abs=0.02)
    assert hazard.along_span == pytest.approx(hazard.position[0], abs=0.1)
    assert (hazard.position == tree).all(axis=1).any()
    assert hazard.num_points == pytest.approx((distance < 4.0).sum(), abs=3)
    assert (hazard.extent[0] <= hazard.position).all()
    assert (hazard.extent[1] >= hazard.position).all()
    assert 0.01 <= hazard.sigma < 0.02  # the toy has no noise


def test_points_by_hand():
    model = make_model(*LEVEL)
    at = model.curve.position(np.array([0.0]))[0]
    points = at + np.array([[0.0, 3.0, 0.0], [0.2, 3.0, 0.1], [0.0, 3.2, 0.2]])
    hazards = find(points, [model])
    assert len(hazards) == 1
    assert hazards[0].clearance == pytest.approx(3.0, abs=0.01)
    assert hazards[0].horizontal == pytest.approx(3.0, abs=0.01)
    assert hazards[0].num_points == 3
    np.testing.assert_array_equal(hazards[0].position, points[0])
    assert find(points[:2], [model]) == ()  # fewer than min_points
    assert len(find(points[:2], [model], min_points=2)) == 1


def test_a_span_that_runs_backwards_measures_along_its_route():
    model = make_model((100.0, 0.0, 15.0), (0.0, 0.0, 15.0))
    assert model.start_x > model.end_x
    hazard = find(make_tree(30.0, 0.0, 12.0), [model])[0]
    assert hazard.along_span == pytest.approx(70.0, abs=1.5)


def test_two_trees_are_two_hazards_in_order_along_the_span():
    trees = np.vstack([make_tree(70.0, 0.0, 12.0), make_tree(30.0, 0.5, 12.5)])
    hazards = find(trees, [make_model(*LEVEL)])
    assert len(hazards) == 2
    assert [round(item.along_span, -1) for item in hazards] == [30, 70]


def test_a_tree_between_two_conductors_is_one_hazard_of_the_nearer():
    models = [make_model((0.0, y, 15.0), (100.0, y, 15.0), line)
              for line, y in enumerate((0.0, 4.0))]
    hazards = find(make_tree(50.0, 1.2, 11.5), models)
    assert [item.line_id for item in hazards] == [0]


def test_a_roof_is_a_structure_and_a_crown_is_vegetation():
    roof = np.random.default_rng(0).uniform((40, -4, 11.0), (50, 4, 11.02), (3000, 3))
    hazards = find(roof, [make_model(*LEVEL)])
    assert [item.kind for item in hazards] == [HazardKind.STRUCTURE]
    assert is_surface(roof).mean() > 0.8
    crown = make_tree(50.0, 0.0, 12.0, num=4000)
    assert is_surface(crown).mean() < 0.2
    assert is_surface(crown[:0]).shape == (0,)


def test_a_conductor_too_near_to_the_ground():
    model = make_model((0.0, 0.0, 6.0), (100.0, 0.0, 6.0))
    along = np.linspace(0.0, 100.0, 101)
    x = model.start_x + along * np.sign(model.end_x - model.start_x)
    ground = np.column_stack([along, model.curve.position(x)[:, 2]])
    hazards = find(np.zeros((0, 3)), [model], [ground])
    assert [item.kind for item in hazards] == [HazardKind.GROUND]
    assert hazards[0].clearance == pytest.approx(6.0 - 1.563, abs=0.01)
    assert hazards[0].along_span == pytest.approx(50.0, abs=1.0)
    np.testing.assert_allclose(hazards[0].position, [50.0, 0.0, 0.0], atol=1.0)
    assert hazards[0].num_points == (ground[:, 1] < 5.0).sum()
    assert find(np.zeros((0, 3)), [model], [ground], ground_distance=4.0) == ()


def test_conductors_that_come_too_near_to_each_other():
    apart = make_model((0.0, 0.0, 15.0), (100.0, 0.0, 15.0), 0)
    low = make_model((0.0, 0.0, 13.0), (100.0, 0.0, 13.0), 1)
    assert find(np.zeros((0, 3)), [apart, low]) == ()
    slack = make_model((0.0, 0.0, 15.0), (100.0, 0.0, 15.0), 0, c=450.0)
    hazards = find(np.zeros((0, 3)), [slack, low])
    assert [item.kind for item in hazards] == [HazardKind.INTERFERENCE]
    # sags of 2.78 and 1.56 m: from 2 m at the supports to 0.78 m in the middle
    assert hazards[0].clearance == pytest.approx(0.78, abs=0.02)
    assert hazards[0].required == pytest.approx(1.0, abs=0.02)


def test_a_conductor_that_sags_more_than_its_peers():
    peers = [make_model((0.0, y, 15.0), (100.0, y, 15.0), line)
             for line, y in enumerate((0.0, 5.0, 10.0))]
    iced = make_model((0.0, -5.0, 15.0), (100.0, -5.0, 15.0), 3, c=500.0)
    hazards = find(np.zeros((0, 3)), [*peers, iced])
    assert [(item.kind, item.line_id) for item in hazards] == [(HazardKind.SAG, 3)]
    assert hazards[0].clearance == pytest.approx(2.504 - 1.563, abs=0.02)
    assert find(np.zeros((0, 3)), peers) == ()
    # two conductors cannot tell which of them is the abnormal one
    assert find(np.zeros((0, 3)), [peers[0], iced]) == ()


@pytest.mark.parametrize(('num_deep', 'raised'), [(1, 1), (2, 0), (3, 0)])
def test_conductors_that_sag_as_a_third_of_their_peers_do_are_of_another_kind(num_deep, raised):
    models = [
        make_model((0.0, 5.0 * line, 15.0), (100.0, 5.0 * line, 15.0), line,
                   c=500.0 if line < num_deep else 800.0)
        for line in range(6 if num_deep == 3 else 4)
    ]
    hazards = find(np.zeros((0, 3)), models)
    assert [item.kind for item in hazards] == [HazardKind.SAG] * raised


@pytest.mark.parametrize('angle', [6.0, 10.0, 15.0, 20.0])
def test_a_crossing_at_a_small_angle_is_none_of_its_neighbours(angle):
    """Its poles stand aside, so that both lines may be numbered as one section."""
    lower = [make_model((0.0, y, 15.0), (100.0, y, 15.0), k) for k, y in enumerate((-1.0, 1.0))]
    way = 80.0 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    place = np.array([50.0, 0.0, 18.5])
    upper = make_model(tuple(place - way), tuple(place + way), 2, c=2000.0)
    hazards = find(np.zeros((0, 3)), [*lower, upper], crossing_distance=4.0)
    assert [item.kind for item in hazards] == [HazardKind.CROSSING]


@pytest.mark.parametrize('gap', [5.0, 8.0, 12.0])
@pytest.mark.parametrize('bad', [0, 1, 2])
def test_a_conductor_sags_by_the_others_of_a_wide_tower(gap, bad):
    models = [
        make_model((0.0, gap * line, 30.0), (300.0, gap * line, 30.0), line,
                   c=700.0 if line == bad else 1200.0)
        for line in range(3)
    ]
    hazards = find(np.zeros((0, 3)), models)
    assert [(item.kind, item.line_id) for item in hazards] == [(HazardKind.SAG, bad)]


@pytest.mark.parametrize('seed', range(40))
def test_a_crossing_is_as_near_as_its_nearest_places(seed):
    """On slopes of up to 30 % and at small angles, whatever the order."""
    rng = np.random.default_rng(seed)
    models = []
    for number in range(2):
        angle = rng.uniform(np.radians(6.0), np.radians(90.0)) * number
        way = np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.3, 0.3)])
        middle = np.array([0.0, 0.0, 40.0 + 8.0 * number + rng.uniform(-3.0, 3.0)])
        back, ahead = rng.uniform(15.0, 120.0, 2)
        models.append(make_model(
            tuple(middle - back * way), tuple(middle + ahead * way), number, number, c=900.0
        ))
    a, b = (model.curve.position(np.linspace(model.low, model.high, 3001)) for model in models)
    truth = float(cKDTree(a).query(b)[0].min())
    for order in (1, -1):
        found = find(np.zeros((0, 3)), models[::order], crossing_distance=60.0)
        (hazard,) = (item for item in found if item.kind == HazardKind.CROSSING)
        assert truth - 0.06 < hazard.clearance < truth + 0.002  # places are 0.08 m apart


@pytest.mark.parametrize(('gap', 'num'), [(1.0, 1), (3.0, 0)])
def test_lines_that_cross_too_near(gap, num):
    lower = make_model(*LEVEL)
    upper = make_model((50.0, -50.0, 15.0 + gap), (50.0, 50.0, 15.0 + gap), 1, 1)
    hazards = find(np.zeros((0, 3)), [lower, upper])
    assert len(hazards) == num
    if num:
        assert hazards[0].clearance == pytest.approx(gap, abs=0.05)
        np.testing.assert_allclose(hazards[0].position[:2], [50.0, 0.0], atol=0.5)


def test_groups_are_those_of_single_linkage():
    points = np.random.default_rng(0).uniform(0, 20, (300, 3))
    label = group_points(points, 2.0)
    oracle = fcluster(linkage(points, 'single'), 2.0, 'distance')
    assert len(np.unique(label)) == len(np.unique(oracle))
    assert len(np.unique(np.column_stack([label, oracle]), axis=0)) == len(np.unique(oracle))
    assert group_points(np.zeros((0, 3)), 2.0).shape == (0,)
    assert group_points(np.ones((5, 3)), 2.0).tolist() == [0] * 5


def test_order_and_input():
    points = np.vstack([make_tree(70.0, 0.0, 12.0), make_tree(30.0, 0.5, 12.5)])
    before = points.copy()
    one = find(points, [make_model(*LEVEL)])
    np.testing.assert_array_equal(points, before)
    order = np.random.default_rng(0).permutation(len(points))
    other = find(points[order], [make_model(*LEVEL)])
    assert [item.clearance for item in one] == [item.clearance for item in other]
    assert [item.num_points for item in one] == [item.num_points for item in other]


def test_nothing_near():
    assert find(np.zeros((0, 3)), [make_model(*LEVEL)]) == ()
    assert find(np.full((40, 3), 300.0), [make_model(*LEVEL)]) == ()


@pytest.mark.parametrize('change', [
    {'warning_distance': -1.0}, {'min_points': 0}, {'group_distance': 0.0},
    {'interference_ratio': 2.0}, {'sag_deviation': 0.0},
])
def test_bad_settings(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        HazardSettings(**change)
