# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise
import math

import numpy as np
import pytest
from toys import make_curve, make_ground, make_tree, make_wire

from plc_inspect.config import Settings
from plc_inspect.core.extraction.height import extract_high
from plc_inspect.core.extraction.off_ground import gather_off_ground
from plc_inspect.core.spans.crossarms import find_crossarms
from plc_inspect.core.spans.standing_poles import find_poles
from plc_inspect.core.spans.stations import cut_at_poles

SETTINGS = Settings()
LEVEL = 8.0  # of the conductors at the middle of 120 m


def make_bar(x=60.0, half=1.0, *, drop=0.1, num=24, turn=0.0, thick=0.05):
    """Return returns of an arm across the line, ``drop`` below the conductors."""
    rng = np.random.default_rng(4)
    along = np.linspace(-half, half, num)
    bar = np.column_stack((
        x + along * math.sin(turn), along * math.cos(turn), np.full(num, LEVEL - drop),
    ))
    return bar + rng.uniform(-thick, thick, bar.shape)


SHAFT = np.array([[60.05, 0.03, 3.4], [59.97, -0.02, 5.2]])


def look(*things, offsets=(-0.8, 0.0, 0.8), turn=0.0):
    """Return the cloud, the curves, their points, and the arms between them."""
    wires = [
        make_wire((0.0, y, LEVEL + 4.0), (120.0, y, LEVEL + 4.0), c=450.0, seed=number)
        for number, y in enumerate(offsets)
    ]
    points = np.vstack([*wires, make_ground((-10.0, -15.0), (130.0, 15.0)), *things])
    points[:, :2] = points[:, :2] @ np.array(
        [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
    )
    cloud = gather_off_ground(points, extract_high(points, SETTINGS.height), 2.0)
    number = np.full(len(points), -1)
    number[cloud.place] = np.arange(len(cloud.place))
    ends = np.cumsum([0, *map(len, wires)])
    curves = [
        make_curve(cloud.points, np.sort(number[low:high])) for low, high in pairwise(ends)
    ]
    wire = np.zeros(len(cloud.points), dtype=bool)
    wire[number[: ends[-1]]] = True
    return cloud, curves, wire, find_crossarms(cloud, curves, wire)


@pytest.mark.parametrize('drop', [-0.4, 0.1, 0.5])
@pytest.mark.parametrize('turn', [0.0, 0.7, 2.5, -2.0])
def test_an_arm_with_a_point_of_its_pole_is_found_however_the_line_runs(drop, turn):
    *_, arms = look(make_bar(drop=drop), SHAFT, turn=turn)
    (arm,) = arms
    np.testing.assert_allclose(
        arm.position, [60.0 * math.cos(turn), 60.0 * math.sin(turn)], atol=0.25
    )
    assert arm.top == pytest.approx(LEVEL - drop, abs=0.1)
    assert arm.base == pytest.approx(0.0, abs=0.1)


def test_conductors_that_hang_as_if_nothing_held_them_are_cut_there():
    cloud, curves, wire, arms = look(make_bar(), SHAFT)
    assert find_poles(cloud, curves, wire) == ()
    poles = find_poles(cloud, curves, wire, arms)
    parts = cut_at_poles(cloud.points, curves, poles, 5.0)
    assert len(parts) == 2 * len(curves)
    assert {round(part.length, -1) for part in parts} == {60.0}


def test_an_arm_askew_between_two_conductors_is_found():
    *_, arms = look(make_bar(turn=0.12), SHAFT, offsets=(-0.8, 0.8))
    assert len(arms) == 1


def make_bush(length):
    """Return leaves in the gaps, so far along the line."""
    rng = np.random.default_rng(5)
    num = int(60 * length)
    return np.column_stack((
        rng.uniform(60.0 - length / 2, 60.0 + length / 2, num), rng.uniform(-1.0, 1.0, num),
        rng.uniform(LEVEL - 0.5, LEVEL, num),
    ))


@pytest.mark.parametrize('things', [
    (make_bar(),),
    (SHAFT,),
    (make_bar(half=1.0)[:3], SHAFT),
    (make_bar(half=0.2, num=12), SHAFT),
    (make_bar(drop=1.5), SHAFT),
    (make_bush(3.0), SHAFT),
    (make_tree(60.0, 0.0, 8.2, bottom=2.0, radius=1.5, num=1500),),
], ids=['nothing below it', 'no arm', 'an end of it', 'a thing at one conductor', 'a beam below',
        'leaves as long as wide', 'a crown'])
def test_what_is_no_arm_on_a_pole_is_none(things):
    assert look(*things)[-1] == ()


def test_spacers_of_a_bundle_are_no_arms():
    offsets = (-0.2, 0.2)
    spacer = make_bar(half=0.2, num=20, drop=0.0)
    assert look(spacer, SHAFT, offsets=offsets)[-1] == ()


def test_few_curves_and_none():
    cloud, curves, wire, _ = look(make_bar(), SHAFT)
    assert find_crossarms(cloud, [], wire) == ()
    assert find_crossarms(cloud, curves[:1], wire) == ()
