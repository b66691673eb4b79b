# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves that run from one wire of a rack into the next give way to one for each."""

from itertools import pairwise

import numpy as np
import pytest
from toys import make_curve, make_wire, turn

from plc_inspect.core.catenary.mixed import find_mixed
from plc_inspect.core.numerics.plan_index import build_plan_index

APART, NUM = 0.31, 5


def make_rack(per_metre=3.0, seed=0, yaw=0.0, length=21.0, num=NUM):
    """Return the points of wires one above the other, and which wire each is of."""
    wires = [
        make_wire((0.0, 0.0, 9.0 + APART * k), (length, 0.0, 8.0 + APART * k), 340.0, per_metre,
                  0.045, 100 * seed + k)
        for k in range(num)
    ]
    points = turn(np.vstack(wires), yaw, (300.0, -200.0, 0.0))
    return points, np.repeat(np.arange(num), [len(wire) for wire in wires])


def cross(points, wire, first=1, last=2):
    """Fit a curve to the beginning of one wire and the end of another."""
    along = np.hypot(*(points[:, :2] - points[0, :2]).T)
    half = along < np.median(along)
    return make_curve(points, np.flatnonzero(np.where(half, wire == first, wire == last)), 0.25)


def look(points, *curves):
    return find_mixed(points, build_plan_index(points, np.arange(len(points)), 4.0), curves)


@pytest.mark.parametrize('yaw', [0.0, 2.0])
@pytest.mark.parametrize('per_metre', [3.0, 8.0])
def test_each_wire_about_a_mixed_curve_is_a_track(per_metre, yaw):
    for seed in range(5):
        points, wire = make_rack(per_metre, seed, yaw)
        mixed, tracks = look(points, cross(points, wire))
        assert mixed.tolist() == [True]
        bounds = tracks.segments.point_start
        own = [
            wire[tracks.segments.points[low:high]]
            for low, high in pairwise(bounds)
        ]
        purest = [np.bincount(part).argmax() for part in own]
        assert set(purest) == set(range(NUM))
        assert all(
            np.mean(part == main) > 0.95 for part, main in zip(own, purest, strict=True)
        )
        for main in range(NUM):
            found = np.unique(np.concatenate([
                tracks.segments.points[low:high]
                for (low, high), k in zip(pairwise(bounds), purest, strict=True)
                if k == main
            ]))
            # more than 500 points of a window are thinned
            least = 0.85 if per_metre < 5.0 else 0.4
            assert (wire[found] == main).sum() > least * (wire == main).sum()


def test_a_curve_along_one_wire_is_not_mixed():
    for seed in range(5):
        points, wire = make_rack(seed=seed)
        curves = [make_curve(points, np.flatnonzero(wire == k), 0.2) for k in range(NUM)]
        mixed, tracks = look(points, *curves)
        assert not mixed.any()
        assert tracks.num_tracks == len(tracks.segments) == 0


def test_what_is_dense_short_or_alone_is_not_looked_at():
    points, wire = make_rack(per_metre=40.0)
    assert not look(points, cross(points, wire))[0].any()
    points, wire = make_rack(length=11.0)
    assert not look(points, cross(points, wire))[0].any()
    points, wire = make_rack()
    alone = points[wire == 0]
    assert not look(alone, make_curve(alone, tolerance=0.2))[0].any()
    mixed, tracks = look(points)
    assert len(mixed) == tracks.num_tracks == 0


def test_rows_of_a_wall_are_no_conductors():
    for seed in range(5):
        points, wire = make_rack(seed=seed, num=12)
        assert not look(points, cross(points, wire, 6, 7))[0].any()


def test_the_order_of_curves_does_not_matter():
    points, wire = make_rack()
    curves = [cross(points, wire), cross(points, wire, 3, 4), cross(points, wire, 2, 3)]
    mixed, tracks = look(points, *curves)
    other, again = look(points, *curves[::-1])
    assert mixed.tolist() == other[::-1].tolist()
    np.testing.assert_array_equal(tracks.segments.points, again.segments.points)
