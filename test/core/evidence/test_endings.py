# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves that grew on beyond the end of their conductor are cut back."""

import numpy as np
import pytest
from toys import make_curve, make_index, make_tree, make_wire

from plc_inspect.core.evidence.endings import cut_ends


def make(y=0.0, length=60.0, per_metre=8.0, seed=0, parts=((0.0, 1.0),)):
    return make_wire((0.0, y, 12.0), (length, y, 12.0), c=700.0, per_metre=per_metre, seed=seed,
                     parts=parts)


NO_POLES = np.zeros((0, 2))


def cut(wires, others, grown, poles=NO_POLES):
    """Cut curves of wires, with those of the other points that lie on the first one if grown."""
    points = np.vstack([*wires, *others])
    first = np.cumsum([0, *map(len, wires)])
    curves = []
    for k, wire in enumerate(wires):
        own = np.arange(first[k], first[k] + len(wire))
        if grown and k == 0:
            curve = make_curve(points, own, 0.2)
            rest = np.arange(first[-1], len(points))
            x, y = curve.local(points[rest])
            on = np.hypot(y, points[rest, 2] - curve.fit.height(x)) <= 0.1
            own = np.concatenate([own, rest[on]])
        curves.append(make_curve(points, own, 0.2))
    wire = np.arange(len(points)) < first[-1]
    return curves, cut_ends(points, make_index(points), curves, wire, poles)


def make_crown(x):
    return make_tree(x, 0.0, 14.0, 9.0, radius=2.5, num=1500)


@pytest.mark.parametrize('num', [1, 2])
def test_what_grew_into_a_crown_beyond_a_gap_is_cut(num):
    wires = [make(y=2.0 * k, parts=((0.0, 0.7),), seed=k) for k in range(num)]
    curves, (curve, *_) = cut(wires, [make_crown(52.0)], grown=True)
    assert curves[0].length > 48.0
    assert curve.length == pytest.approx(42.0, abs=1.0)
    assert len(curve.points) == pytest.approx(len(wires[0]), abs=3)


@pytest.mark.parametrize('seed', range(8))
def test_rounding_takes_no_point_from_the_other_end(seed):
    points = make_wire((0.0, 0.0, 12.0), (60.0, 0.0, 12.0), c=700.0, parts=((0.0, 0.7),))
    first, num = int(np.argmin(points[:, 0])), len(points)
    points = np.vstack([points, make_crown(52.0)])
    turn = 0.1 + 0.7 * seed
    points[:, :2] = points[:, :2] @ np.array([
        [np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)],
    ]) + 3000.0 * np.array([np.cos(seed), np.sin(seed)])
    curve = make_curve(points, np.arange(num), 0.2)
    x, y = curve.local(points)
    on = np.hypot(y, points[:, 2] - curve.fit.height(x)) <= 0.1
    on[:num] = True
    curve = make_curve(points, np.flatnonzero(on), 0.2)
    (after,) = cut_ends(
        points, make_index(points), [curve], np.arange(len(points)) < num, NO_POLES
    )
    assert after.length < curve.length - 5.0
    assert first in after.points


def test_a_conductor_that_ends_in_a_crown_is_kept():
    (before,), (after,) = cut([make()], [make_crown(58.0)], grown=False)
    assert after is before


def test_one_beside_that_was_seen_as_far_spares_it():
    wires = [make(parts=((0.0, 0.7),)), make(y=2.0, seed=1)]
    curves, (curve, other) = cut(wires, [make_crown(52.0)], grown=True)
    assert curve is curves[0]
    assert other is curves[1]


def test_what_ends_at_a_pole_is_not_cut_there():
    wires = [make(parts=((0.0, 0.7),))]
    curves, (curve,) = cut(wires, [make_crown(52.0)], grown=True)
    end = curves[0].position(curves[0].high)[0, :2]
    assert curve.length < curves[0].length - 5.0
    _, (held,) = cut(wires, [make_crown(52.0)], grown=True, poles=end[None] + 0.5)
    assert held.length == curves[0].length


def test_more_must_speak_for_what_goes_on_beyond_one_beside_that_ended():
    """Leaves without a gap before them, a few of which lie on the curve by chance."""
    rng = np.random.default_rng(5)
    leaves = np.column_stack([
        rng.uniform(42.0, 50.0, 200), rng.uniform(-1.2, 1.2, 200), rng.uniform(-1.2, 1.2, 200)
    ])
    leaves = leaves[np.hypot(leaves[:, 1], leaves[:, 2]) > 0.25]
    leaves[:2] = [[45.5, 0.0, 0.0], [49.5, 0.0, 0.0]]
    leaves[:, 2] += np.interp(leaves[:, 0], *make(per_metre=60.0, seed=7)[:, [0, 2]].T)
    alone = make(parts=((0.0, 0.7),))
    curves, (curve,) = cut([alone], [leaves], grown=True)
    assert curve is curves[0]
    assert curve.length > 48.0
    beside = [alone, make(y=2.0, parts=((0.0, 0.7),), seed=1)]
    _, (curve, _) = cut(beside, [leaves], grown=True)
    assert curve.length == pytest.approx(42.0, abs=1.0)


def test_gaps_within_and_few_points_cut_nothing():
    for wire in (make(parts=((0.0, 0.4), (0.6, 1.0))), make(per_metre=0.7)):
        (before,), (after,) = cut([wire], [], grown=False)
        assert after is before


def test_without_curves_there_is_nothing_to_cut():
    points = make()
    assert cut_ends(
        points, make_index(points), [], np.zeros(len(points), dtype=bool), NO_POLES) == ()
