# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves side by side prove together what each does not prove by itself."""

import numpy as np
import pytest
from toys import make_curve, make_index, make_sight, make_wire

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.duplicates import is_thick
from plc_inspect.core.evidence.groups import cut_groups, find_groups, prove_together
from plc_inspect.core.evidence.judge import Judge
from plc_inspect.core.evidence.validation import prove_sag

SETTINGS = CatenarySettings()
EVERYWHERE = np.array([[-10.0, -30.0, 0.0], [60.0, 30.0, 0.0]])
SEEN = make_sight(EVERYWHERE)
SIDE = 3.0


def make_wires(num=5, apart=1.0, c=900.0, length=34.0, rise=0.0, turn=0.0, noise=0.08):
    """Curves side by side, or one above the other, seen with few points and much noise."""
    return [
        make_curve(make_wire(
            (0.0, apart * k, 20.0 + rise * k),
            (length, apart * k + length * np.tan(turn * k), 20.0 + rise * k),
            c, noise=noise, per_metre=2.0, seed=k,
        )) for k in range(num)
    ]


def judge_all(wires):
    """Judge the curves of wires, each of all its points."""
    points = np.vstack(wires)
    numbers = np.split(np.arange(len(points)), np.cumsum([len(wire) for wire in wires])[:-1])
    curves = [make_curve(points, own, tolerance=0.3) for own in numbers]
    judge = Judge(points, make_index(points), make_sight(EVERYWHERE), curves, SETTINGS)
    judge.decide()
    return judge


def test_sags_that_agree_add_up():
    curves = make_wires()
    proofs = [prove_sag(curve, SETTINGS) for curve in curves]
    assert max(proofs) < 1.0
    assert prove_together(curves, SETTINGS)
    ((group, beside),) = find_groups(curves, SEEN, SIDE, SETTINGS)
    assert sorted(group.tolist()) == [0, 1, 2, 3, 4]
    assert len(beside) == 0


@pytest.mark.parametrize(('changes', 'num'), [
    ({'num': 2, 'noise': 0.05}, 0),
    ({'num': 3, 'noise': 0.05}, 1),
    ({'num': 3, 'noise': 0.09}, 1),
    ({'num': 3, 'noise': 0.14}, 0),
    ({'c': 1e5}, 0),  # straight ones
    ({'num': 30, 'apart': 0.3, 'c': 150.0, 'length': 11.0}, 0),
    ({'num': 30, 'apart': 0.3, 'c': 150.0, 'length': 13.0}, 1),
    ({'apart': 4.0}, 0),
    ({'apart': 0.5, 'rise': 4.0}, 0),
    ({'turn': 0.15}, 0),
    ({'apart': 0.0, 'rise': 2.0}, 1),
])
def test_what_is_a_group(changes, num):
    assert len(find_groups(make_wires(**changes), SEEN, SIDE, SETTINGS)) == num


def test_rows_over_hidden_ground_are_no_group():
    curves = make_wires()
    assert not find_groups(curves, make_sight(EVERYWHERE, seen=False), SIDE, SETTINGS)
    assert find_groups([], SEEN, SIDE, SETTINGS) == []


def test_groups_far_apart_are_two():
    far = [make_curve(make_wire((0.0, y, 20.0), (34.0, y, 20.0), 900.0, noise=0.08,
                                per_metre=2.0, seed=int(y) + 40))
           for y in (-20.0, -19.0, -18.0, -17.0, -16.0)]
    groups = find_groups([*make_wires(), *far], SEEN, SIDE, SETTINGS)
    assert sorted(sorted(group.tolist()) for group, _ in groups) == [
        [0, 1, 2, 3, 4], [5, 6, 7, 8, 9]
    ]


def test_two_beside_a_conductor_are_a_group_and_one_is_not():
    first, second, known, away = make_wires(num=4, noise=0.09)
    ((group, beside),) = find_groups([first, second], SEEN, SIDE, SETTINGS, [known, away])
    assert (group.tolist(), beside.tolist()) == ([0, 1], [0, 1])
    assert find_groups([first, second], SEEN, SIDE, SETTINGS) == []
    assert find_groups([first], SEEN, SIDE, SETTINGS, [second, known]) == []


def test_conductors_unite_no_groups():
    first, second, known, third, fourth = make_wires(num=5, apart=2.0, noise=0.05)
    groups = find_groups(
        [first, second, third, fourth], SEEN, 2.5, SETTINGS, [known]
    )
    assert [(group.tolist(), beside.tolist()) for group, beside in groups] == [
        ([0, 1], [0]), ([2, 3], [0])
    ]


@pytest.mark.parametrize('num_above', [0, 2])
def test_short_ones_that_crowd_each_other_are_believed_beside_conductors(num_above):
    """What three of 13 m prove together is too little."""
    short = [
        make_wire((0.0, y, z), (13.0, y, z), 650.0, noise=0.05, per_metre=10.0, seed=k)
        for k, (y, z) in enumerate([(0.0, 20.0), (0.7, 20.0), (0.35, 20.6)])
    ]
    long = [
        make_wire((0.0, y, 23.0), (60.0, y, 23.0), 650.0, noise=0.05, per_metre=20.0, seed=9)
        for y in (-1.0, 1.7)[:num_above]
    ]
    believed = judge_all([*short, *long]).believed
    assert len(believed) == (5 if num_above else 0)


@pytest.mark.parametrize(('seen', 'num'), [(True, 6), (False, 0)])
def test_wires_that_are_free_but_for_each_other_are_believed(seen, num):
    wires = [make_wire((0.0, y, 20.0), (34.0, y, 20.0), 900.0, noise=0.06, per_metre=2.5, seed=k)
             for k, y in enumerate(np.arange(6) * 0.45)]
    points = np.vstack(wires)
    numbers = np.split(np.arange(len(points)), np.cumsum([len(wire) for wire in wires])[:-1])
    curves = [make_curve(points, own, tolerance=0.2) for own in numbers]
    judge = Judge(points, make_index(points), make_sight(EVERYWHERE, seen=seen), curves, SETTINGS)
    judge.decide()
    assert len(judge.believed) == num


@pytest.mark.parametrize(('c', 'seen', 'num'), [
    (650.0, True, 4), (650.0, False, 0), (1e5, True, 0),
])
def test_blurred_wires_that_are_free_but_for_each_other_are_believed(c, seen, num):
    """As drift blurs them: each is as thick as a bundle, and no air is left between them."""
    rng = np.random.default_rng(3)
    wires = [make_wire((0.0, y, 20.0), (55.0, y, 20.0), c, noise=0.05, per_metre=10.0, seed=k)
             for k, y in enumerate(np.arange(4) * 0.5)]
    for wire in wires:
        wire[:, 1] += rng.normal(0.0, 0.13, len(wire))
    points = np.vstack(wires)
    numbers = np.split(np.arange(len(points)), np.cumsum([len(wire) for wire in wires])[:-1])
    curves = [make_curve(points, own, tolerance=0.4) for own in numbers]
    assert all(is_thick(curve) for curve in curves)
    sight = make_sight(EVERYWHERE, seen=seen)
    judge = Judge(points, make_index(points), sight, curves, SETTINGS)
    judge.decide()
    assert len(judge.believed) == num


def test_a_wire_doubled_as_strips_lie_askew_is_believed_beside_another():
    rng = np.random.default_rng(4)
    wires = [make_wire((0.0, y, 20.0), (50.0, y, 20.0), 240.0, noise=0.03, per_metre=9.0, seed=k)
             for k, y in enumerate((0.0, 0.47))]
    for wire, askew in zip(wires, (0.18, 0.26), strict=True):
        wire[:, 1] += askew * rng.integers(0, 2, len(wire))
    judge = judge_all(wires)
    assert [is_thick(curve) for curve in judge.curves] == [False, True]
    assert len(judge.believed) == 2


def test_what_is_left_about_a_wire_is_no_other_one():
    rng = np.random.default_rng(4)
    wire = make_wire((0.0, 0.0, 20.0), (50.0, 0.0, 20.0), 240.0, noise=0.03, per_metre=20.0)
    rest = make_wire((0.0, 0.0, 20.0), (50.0, 0.0, 20.3), 300.0, per_metre=2.0)
    rest[:, 2] += rng.normal(0.0, 0.14, len(rest))
    judge = judge_all([wire, rest])
    assert [is_thick(curve) for curve in judge.curves] == [False, True]
    assert len(judge.believed) == 1


def make_stepped_rack():
    """Return points of five wires over a support that stands low, and a track over all of each."""
    points = np.vstack([
        make_wire((start, 0.0, low - 0.5 * k), (end, 0.0, high - 0.5 * k), 460.0, 5.0, 0.02, seed)
        for k in range(5)
        for seed, (start, low, end, high) in enumerate(
            ((0.0, 9.0, 21.0, 10.0), (21.0, 10.0, 33.0, 10.5)), 2 * k
        )
    ])
    return points, np.array_split(np.arange(len(points)), 5)


def test_wires_of_a_rack_that_ran_over_a_support_are_cut_before_they_are_judged():
    """As one curve they are straight, and of one plane, as the bars of a frame."""
    points, own = make_stepped_rack()
    curves = [make_curve(points, chosen, 0.3) for chosen in own]
    parts = cut_groups(points, curves, make_sight(points), SIDE, SETTINGS)
    lengths = sorted(part.length for part in parts)
    assert lengths == pytest.approx([12.0] * 5 + [21.0] * 5, abs=1.5)
    assert len(cut_groups(points, curves[:2], make_sight(points), SIDE, SETTINGS)) == 2
