# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from toys import make_curve, make_line_cloud, make_tree, turn

from plc_inspect.config import Settings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.layout import find_layout
from plc_inspect.core.spans.route import trace_routes
from plc_inspect.core.spans.span_fit import CutCurve
from plc_inspect.core.spans.supports import place_supports

SETTINGS = Settings()


def place(points, label, num_wires=6):
    """
    Place the supports of the true conductors.

    Returns
    -------
    supports, closed, and which of the points are marked

    """
    wire = np.flatnonzero(label == 14)
    curves = [make_curve(points, wire[own]) for own in np.array_split(
        np.arange(len(wire)), num_wires
    )] if num_wires else []
    layout = find_layout(points, curves, (), SETTINGS.supports)
    finals = [
        CutCurve(curve=curve, low=float(low), high=float(high))
        for curve, low, high in zip(layout.curves, layout.start_x, layout.end_x, strict=True)
    ]
    cloud = gather_off_ground(points, extract_high(points, SETTINGS.height), -np.inf)
    supports, mask, closed = place_supports(
        cloud, (label == 14)[cloud.place], layout, trace_routes(layout), finals,
        np.zeros((len(finals), 2)), range(len(finals)),
    )
    return supports, closed, cloud.scatter(mask, False)


def cut_out(points, label, low, high):
    keep = (points[:, 0] > low) & (points[:, 0] < high)
    return points[keep], label[keep]


def make_line(**changes):
    return make_line_cloud(**{'spans': (100.0, 100.0), **changes})


def test_a_pole_stands_at_the_ends_of_each_span():
    points, label = make_line()
    supports, closed, mask = place(points, label)
    assert [support.support_id for support in supports] == [0, 1, 2]
    for number, support in enumerate(supports):
        np.testing.assert_allclose(support.position, [100.0 * number, 0.0, 0.0], atol=0.2)
        assert support.height == pytest.approx(16.0, abs=0.2)
        assert support.kind == 'pole'
        assert support.line_ids == (0, 1, 2)
    assert len(closed) == 12
    assert mask[label == 15].mean() > 0.7
    assert mask[label == 2].mean() < 0.01


def test_a_single_conductor_hangs_on_poles_as_well():
    points, label = make_line(offsets=(0.0,))
    supports, _, _ = place(points, label, num_wires=2)
    assert [(support.kind, support.line_ids) for support in supports] == [('pole', (0,))] * 3


def test_a_support_without_points_is_unseen_and_as_high_as_its_conductors():
    points, label = make_line(poles=False)
    supports, closed, _ = place(points, label)
    assert [support.kind for support in supports] == ['unseen']
    np.testing.assert_allclose(supports[0].position, [100.0, 0.0, 0.0], atol=0.3)
    assert supports[0].height == pytest.approx(15.0, abs=0.1)
    assert supports[0].line_ids == (0, 1, 2)
    assert closed == {}


def test_conductors_that_leave_the_cloud_stay_open():
    points, label = cut_out(*make_line(), 15.0, 180.0)
    supports, closed, _ = place(points, label)
    assert len(supports) == 1
    np.testing.assert_allclose(supports[0].position, [100.0, 0.0, 0.0], atol=0.2)
    assert supports[0].kind == 'pole'
    # of each curve the end at the pole alone
    assert sorted(number for number, _ in closed) == list(range(6))


@pytest.mark.parametrize('yaw', [0.0, 0.5, 1.1, 2.4])
def test_trees_where_the_cloud_ends_hold_no_conductors(yaw):
    """Ground is seen near the ends, but not beyond them, whichever way the edge lies."""
    trees = [make_tree(14.0, y, 15.5, radius=2.0, seed=k) for k, y in enumerate((-4.0, 1.0, 4.0))]
    points, label = cut_out(*make_line(more=trees), 14.0, 180.0)
    points = turn(points, yaw)
    supports, closed, _ = place(points, label)
    assert len(supports) == 1
    assert len(closed) == 6


def test_ends_that_are_seen_short_of_their_pole_go_on_to_it():
    points, label = make_line(spans=(100.0,))
    wire = label == 14
    keep = ~wire | (points[:, 0] < 99.2)
    supports, closed, _ = place(points[keep], label[keep], num_wires=3)
    assert len(supports) == 2
    np.testing.assert_allclose(supports[1].position[:2], [100.0, 0.0], atol=0.2)
    beyond = [more for (_, side), (more, _) in closed.items() if side == 1]
    np.testing.assert_allclose(beyond, [0.8] * 3, atol=0.3)


@pytest.mark.parametrize(('num_wires', 'last'), [(1, 96.0), (3, 94.0)])
def test_ends_that_are_seen_far_short_of_their_pole_go_on_to_it(num_wires, last):
    offsets = (0.0,) if num_wires == 1 else (-1.2, 0.0, 1.2)
    points, label = make_line(spans=(100.0,), offsets=offsets)
    keep = (label != 14) | (points[:, 0] < last)
    supports, closed, _ = place(points[keep], label[keep], num_wires=num_wires)
    assert len(supports) == 2
    np.testing.assert_allclose(supports[1].position[:2], [100.0, 0.0], atol=0.2)
    beyond = [more for (_, side), (more, _) in closed.items() if side == 1]
    np.testing.assert_allclose(beyond, [100.0 - last] * num_wires, atol=0.7)


def test_a_tree_below_the_conductors_does_not_hold_them():
    points, label = make_line(poles=False, more=[make_tree(100.0, 0.0, 11.0)])
    supports, _, mask = place(points, label)
    assert [support.kind for support in supports] == ['unseen']
    assert supports[0].height == pytest.approx(15.0, abs=0.1)
    assert not mask[points[:, 2] < 11.5].any()  # and is a hazard to them


def test_a_tower_seen_in_a_few_points_is_of_the_line():
    few = np.column_stack([np.full(4, 100.0), np.zeros(4), [3.0, 8.0, 12.0, 14.8]])
    points, label = make_line(poles=False, more=[few])
    supports, _, mask = place(points, label)
    assert [support.kind for support in supports] == ['unseen']
    assert mask[np.flatnonzero(np.isin(points, few).all(axis=1))].all()


def test_only_what_stands_in_the_slice_of_a_support_is_its_own():
    tree = make_tree(102.0, 0.0, 9.0, radius=2.5)
    points, label = make_line(more=[tree])
    _, _, mask = place(points, label)
    far = (label == 1) & (np.abs(points[:, 0] - 100.0) > 2.3)
    assert far.sum() > 300
    assert not mask[far].any()


def test_a_tree_beside_a_support_that_was_not_seen_is_not_of_it():
    # 1.2 m and more beside the outermost conductor
    tree = make_tree(100.0, 4.8, 15.5, bottom=9.0, radius=0.5)
    points, label = make_line(poles=False, offsets=(-3.0, 0.0, 3.0), more=[tree])
    supports, _, mask = place(points, label)
    assert [support.kind for support in supports] == ['unseen']
    assert not mask[np.flatnonzero(np.isin(points, tree).all(axis=1))].any()


@pytest.mark.parametrize(('thick', 'gap', 'num_marked'), [
    (0.5, 0.3, 2), (0.5, 2.0, 1), (4.0, 0.3, 1),
])
def test_an_arm_reaches_beyond_the_conductors_that_were_found(thick, gap, num_marked):
    random = np.random.default_rng(3)
    near, far = (
        random.uniform((100.0 - deep, low, 15.5), (100.0 + deep, high, 16.0), (300, 3))
        for low, high, deep in ((-3.5, 3.8, 0.5), (3.8 + gap, 8.0, thick))
    )  # what is as thick along the line as a crown may be one
    points, label = make_line(poles=False, offsets=(-3.0, 0.0, 3.0), more=[near, far])
    supports, _, mask = place(points, label)
    assert [support.kind for support in supports] == ['unseen']
    for part, is_marked in zip((near, far), (True, num_marked == 2), strict=True):
        own = np.isin(points, part).all(axis=1)
        assert mask[own].any() == is_marked
        assert mask[own].all() == is_marked


@pytest.mark.parametrize(('above', 'num'), [(2.0, 1), (4.5, 1), (6.0, 0)])
def test_ends_below_an_arm_are_at_a_support(above, num):
    offsets = (-3.0, 0.0, 3.0)
    y = np.repeat(offsets, 4) + np.tile([-0.6, -0.2, 0.2, 0.6], 3)
    arm = np.column_stack([np.full(12, 100.0), y, np.full(12, 15.0 + above)])
    points, label = make_line(spans=(100.0,), offsets=offsets, poles=False, more=[arm])
    supports, closed, mask = place(points, label, num_wires=3)
    assert [support.kind for support in supports] == ['unseen'] * num
    assert {side for _, side in closed} == ({1} if num else set())
    assert mask[np.flatnonzero(np.isin(points, arm).all(axis=1))].all() == bool(num)


def test_the_input_is_not_changed():
    points, label = make_line()
    before = points.copy()
    place(points, label)
    np.testing.assert_array_equal(points, before)


def test_without_conductors_there_are_no_supports():
    points, label = make_line()
    supports, closed, mask = place(points, label, num_wires=0)
    assert supports == ()
    assert closed == {}
    assert mask.shape == (len(points),)
    assert not mask.any()
    assert place(points[:0], label[:0], num_wires=0)[0] == ()


@pytest.mark.parametrize('top', [17.0, 30.0])
def test_a_crown_that_reaches_the_lowest_of_open_ends_is_no_tower(top):
    # circuits one above the other leave the cloud at 60 m, where a tree stands
    lines = [
        make_line_cloud(spans=(100.0,), offsets=(-4.0, 4.0), height=height, poles=False)
        for height in (15.0, 20.0, 25.0)
    ]
    points = np.vstack([lines[0][0], *(cloud[label == 14] for cloud, label in lines[1:])])
    label = np.concatenate([lines[0][1], *(own[own == 14] for _, own in lines[1:])])
    points, label = cut_out(points, label, 2.0, 60.0)
    mast = make_tree(1.9, 0.0, 27.0, bottom=0.5, radius=0.15, num=4000)
    crown = make_tree(60.0, 0.0, top, bottom=1.0, radius=3.0, num=6000)
    points = np.vstack([points, mast, crown])
    label = np.concatenate([label, np.full(len(mast), 15), np.full(len(crown), 5)])
    supports, _, _ = place(points, label)
    assert len(supports) == 1


@pytest.mark.parametrize('half', [1.0, 3.0])
def test_a_tower_at_the_border_of_a_cloud_is_seen_from_both_sides(half):
    lines = [
        make_line_cloud(spans=(100.0,), offsets=(-4.0, 4.0), height=height, poles=False)
        for height in (15.0, 20.0)
    ]
    points = np.vstack([lines[0][0], lines[1][0][lines[1][1] == 14]])
    label = np.concatenate([lines[0][1], lines[1][1][lines[1][1] == 14]])
    points, label = cut_out(points, label, 2.0, 60.0)
    body = np.random.default_rng(7).uniform((-half, -3.0, 0.5), (half, 3.0, 22.0), (4000, 3))
    points = np.vstack([points, body + np.array([60.0, 0.0, 0.0])])
    label = np.concatenate([label, np.full(len(body), 15)])
    supports, closed, _ = place(points, label, num_wires=4)
    # what is as thick along the line as a crown may be one
    assert [round(support.position[0]) for support in supports] == [60] * (half < 2.0)
    assert len(closed) == 4 * (half < 2.0)
    points, label = cut_out(points, label, 2.0, 60.0)
    assert place(points, label, num_wires=4)[0] == ()


@pytest.mark.parametrize(('near', 'kind'), [(12.0, 'tower'), (0.0, 'unseen')])
def test_the_head_of_a_tower_tells_of_it_where_its_foot_is_out_of_sight(near, kind):
    """Where the ground below is in view, so would be what stands on it."""
    rng = np.random.default_rng(0)
    body = rng.uniform((99.3, -0.7, 9.0), (100.7, 0.7, 17.0), (600, 3))
    arm = rng.uniform((99.7, -6.0, 15.6), (100.3, 6.0, 16.2), (400, 3))
    points, label = make_line(poles=False, offsets=(-5.0, 0.0, 5.0), more=[body, arm])
    keep = (label != 2) | (np.hypot(points[:, 0] - 100.0, points[:, 1]) > near)
    (support,), _, _ = place(points[keep], label[keep])
    assert support.kind == kind
    np.testing.assert_allclose(support.position[:2], [100.0, 0.0], atol=0.3)
    if kind == 'tower':
        assert support.position[2] + support.height == pytest.approx(17.0, abs=0.2)


@pytest.mark.parametrize(('masts', 'kind'), [((-5.0, 5.0), 'tower'), ((-5.0,), 'unseen')])
def test_a_tower_may_stand_on_two_masts(masts, kind):
    rng = np.random.default_rng(0)
    parts = [
        rng.uniform((99.3, y - 0.7, 0.0), (100.7, y + 0.7, 16.5), (800, 3)) for y in masts
    ]
    beam = rng.uniform((99.7, -5.0, 13.0), (100.3, 5.0, 14.0), (400, 3))
    points, label = make_line(poles=False, offsets=(-5.0, 5.0), more=[*parts, beam])
    (support,), _, _ = place(points, label, num_wires=4)
    assert support.kind == kind
    np.testing.assert_allclose(support.position[:2], [100.0, 0.0], atol=0.5)
