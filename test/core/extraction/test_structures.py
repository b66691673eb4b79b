# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_index, make_pole, make_tree, turn

from plc_inspect.core.extraction.structures import find_structure, Stand


def find(points, near=(0.0, 0.0), reach=2.5, attachment=15.0, wire=None, **changes):
    wire = np.zeros(len(points), dtype=bool) if wire is None else wire
    azimuth, top = changes.get('azimuth', 0.0), changes.get('top', attachment)
    stand = Stand(
        near=np.array(near), azimuth=azimuth, reach=reach, attachment=attachment, top=top,
        lowest=changes.get('lowest', 0.0), may_be_tower=changes.get('may_be_tower', True),
        is_told=changes.get('is_told', True),
    )
    return find_structure(
        points, points[:, 2].astype(np.float32), make_index(points), wire, stand
    )


def make_tower(height=30.0, base=3.0, seed=0):
    """Make the four legs and the bracing of a lattice tower, with two arms."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.0, height, 1600)
    half = base * (1 - 0.85 * z / height)
    side = rng.uniform(-1.0, 1.0, 1600)
    x = np.where(rng.random(1600) < 0.5, np.sign(side), side)
    y = np.where(np.abs(x) == 1.0, side, np.sign(rng.normal(size=1600)))
    body = np.column_stack([half * x, half * y, z])
    arm = rng.uniform((-0.5, -6.0, height - 6.0), (0.5, 6.0, height - 5.0), (200, 3))
    return np.vstack([body, arm])


def test_a_pole_is_found_where_it_stands():
    found = find(make_pole(0.8, -0.5, 16.0))
    assert found.kind == 'pole'
    np.testing.assert_allclose(found.position, [0.8, -0.5], atol=0.1)
    assert found.top == pytest.approx(16.0, abs=0.1)


def test_a_lattice_tower_is_found_about_its_axis():
    found = find(make_tower() + np.array([0.5, 0.3, 0.0]), reach=4.0, attachment=24.0)
    assert found.kind == 'tower'
    np.testing.assert_allclose(found.position, [0.5, 0.3], atol=0.7)
    assert found.top == pytest.approx(30.0, abs=0.5)


def test_nothing_stands_where_only_a_wire_passes():
    x = np.linspace(-20, 20, 400)
    wire = np.column_stack([x, np.zeros(400), np.full(400, 15.0)])
    assert find(wire) is None
    assert find(wire, wire=np.ones(400, dtype=bool)) is None


def test_a_bush_does_not_reach_the_conductor():
    assert find(make_tree(0.0, 0.0, 4.0)) is None


def test_a_pole_beyond_the_reach_is_not_taken():
    assert find(make_pole(6.0, 0.0, 16.0)) is None


def test_a_pole_among_crowns_is_found_where_it_stands():
    crowns = [make_tree(2.0, 1.5, 9.0), make_tree(-1.5, 0.2, 7.0, seed=201)]
    found = find(np.vstack([make_pole(0.4, -0.6, 16.0), *crowns]), attachment=8.0, top=15.0)
    assert found.kind == 'pole'
    np.testing.assert_allclose(found.position, [0.4, -0.6], atol=0.15)


@pytest.mark.parametrize('seed', range(3))
def test_crowns_are_no_poles(seed):
    crown = make_tree(0.5, 0.5, 16.0, num=4000, seed=seed)
    found = find(crown, attachment=14.0)
    assert found is None or found.kind != 'pole'


@pytest.mark.parametrize(('top', 'is_found'), [(5.5, True), (11.0, False)])
def test_a_pole_that_nothing_tells_of_may_stand_in_a_crown_but_for_its_upper_half(top, is_found):
    crown = make_tree(0.4, 0.3, top, bottom=1.0, radius=1.2, num=700)
    pole = make_pole(0.0, 0.0, 13.0)[::8]
    found = find(np.vstack([pole, crown]), attachment=13.0, is_told=False)
    assert (found is not None and found.kind == 'pole') == is_found


@pytest.mark.parametrize('beside', [(), [(0.6, 0.2, 5.4)]], ids=['alone', 'not alone'])
def test_few_points_are_a_pole_where_there_is_nothing_else(beside):
    points = [(0.0, 0.0, z) for z in (2.3, 4.9, 7.4, 8.2, 10.6)]
    points = np.array([*points, *beside])
    found = find(points, attachment=12.0, reach=1.0, may_be_tower=False, is_told=False)
    assert (found is None) == bool(beside)


@pytest.mark.parametrize('seed', range(5))
def test_the_corner_of_a_house_is_no_pole(seed):
    rng = np.random.default_rng(seed)
    walls = rng.uniform((0.0, 0.0, 0.0), (5.0, 0.0, 5.5), (700, 3))
    walls[::2, :2] = walls[::2, 1::-1]
    found = find(walls + rng.normal(0.0, 0.03, walls.shape), attachment=5.3)
    assert found is None or found.kind != 'pole'


def test_a_support_of_a_narrow_line_is_no_tower():
    trees = np.vstack([make_tree(x, y, 12.0, seed=5) for x, y in ((1.5, 1.0), (-1.0, 2.0))])
    assert find(trees, attachment=8.0, may_be_tower=True).kind == 'tower'
    assert find(trees, attachment=8.0, may_be_tower=False) is None


def test_a_leg_beside_the_line_is_no_pole():
    legs = np.vstack([make_pole(0.0, y, 16.0)[:300] for y in (-3.0, 3.0)])
    along, across = (find(legs, reach=4.0, azimuth=azimuth) for azimuth in (np.pi / 2, 0.0))
    assert along.kind == 'pole'
    assert across.kind == 'tower'
    np.testing.assert_allclose(across.position, [0.0, 0.0], atol=0.3)


def test_points_of_conductors_do_not_count():
    pole = make_pole(0.0, 0.0, 16.0)
    assert find(pole, wire=np.ones(len(pole), dtype=bool)) is None


@pytest.mark.parametrize('degrees', [33, 90])
def test_yaw_and_translation(degrees):
    shift = (5e5, 6.6e6, 0.0)
    pole = turn(make_pole(0.8, -0.5, 16.0), np.radians(degrees), shift)
    place = turn(np.array([[0.8, -0.5, 0.0]]), np.radians(degrees), shift)[0, :2]
    found = find(pole, near=shift[:2])
    assert found.kind == 'pole'
    np.testing.assert_allclose(found.position, place, atol=0.15)


def test_order_duplicates_and_input():
    pole = np.repeat(make_pole(0.8, -0.5, 16.0), 2, axis=0)
    before = pole.copy()
    one = find(pole)
    np.testing.assert_array_equal(pole, before)
    other = find(pole[np.random.default_rng(0).permutation(len(pole))])
    np.testing.assert_allclose(one.position, other.position, atol=0.05)


@pytest.mark.parametrize('num', [0, 1])
def test_few_points(num):
    assert find(np.full((num, 3), 5.0)) is None
