# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Points about a conductor that the map shows blurred."""

import dataclasses

from factories import make_model
import numpy as np
import pytest
from toys import make_wire

from plc_inspect.core.hazards.blur import (
    choose_worst,
    find_blur,
    is_blurred,
    measure_reach,
    TALL,
)

START, END = (0.0, 0.0, 12.0), (100.0, 0.0, 12.0)


def make(noise):
    points = make_wire(START, END, 800.0, noise=0.02, per_metre=20.0)
    points[:, 2] += np.random.default_rng(1).normal(0.0, noise, len(points))
    return make_model(START, END, points=points, tolerance=0.35)


def place(model, y, above):
    x = np.linspace(model.low + 5.0, model.high - 5.0, 50)
    points = model.curve.position(x)
    direction = np.array([-np.sin(model.curve.azimuth), np.cos(model.curve.azimuth), 0.0])
    return points + y * direction + np.array([0.0, 0.0, above])


@pytest.mark.parametrize(('noise', 'blurred'), [(0.0, False), (0.15, True)])
def test_what_lies_about_a_blurred_conductor_is_of_it(noise, blurred):
    model = make(noise)
    owner = np.zeros(50, dtype=np.int64)
    assert is_blurred(model) == blurred
    for y, above, own in ((0.1, 0.4, True), (0.1, -0.4, True), (0.6, 0.0, False),
                          (0.0, 1.0, False), (0.0, -1.0, False)):
        found = find_blur(place(model, y, above), owner, [model])
        assert found.all() if own and blurred else not found.any()


def test_its_reach():
    sharp, blurred = make(0.0), make(0.15)
    assert measure_reach(sharp) == sharp.curve.tolerance == 0.35
    assert measure_reach(blurred) == pytest.approx(TALL * blurred.curve.fit.rmse)
    assert measure_reach(blurred) > 0.4


APART = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [9.0, 0.0, 0.0]])


def test_a_hazard_rests_on_what_cannot_be_the_conductor():
    model = make(0.0)
    owner = np.zeros(3, dtype=np.int64)
    share = np.array([0.1, 0.3, 0.2])
    assert choose_worst(APART, share, np.array([0.3, 0.9, 0.8]), owner, [model]) == 2
    assert choose_worst(APART, share, np.array([0.4, 0.9, 0.8]), owner, [model]) == 0
    assert choose_worst(APART, share, np.array([0.3, 0.3, 0.2]), owner, [model]) == 0


def test_bundles_are_as_near_as_their_tolerance():
    points = make_wire(START, END, 800.0, noise=0.3, per_metre=20.0)
    model = make_model(START, END, points=points, tolerance=0.35)
    bundle = dataclasses.replace(model, strands=np.array([[0.2, 0.0], [-0.2, 0.0]]))
    assert measure_reach(bundle) == 0.35
    assert not find_blur(place(model, 0.1, 0.2), np.zeros(50, np.int64), [bundle]).any()


@pytest.mark.parametrize(('num', 'first'), [(1, False), (4, False), (5, True), (20, True)])
def test_a_few_points_close_to_a_conductor_may_be_its_own(num, first):
    model = make_model(START, END, points=make_wire(START, END, 800.0, noise=0.02))
    assert measure_reach(model) < 0.2
    distance = np.concatenate([np.full(num, 0.25), [0.7, 0.9]])
    points, owner = np.zeros((len(distance), 3)), np.zeros(len(distance), np.int64)
    worst = choose_worst(points, distance / 4.0, distance, owner, [model])
    assert distance[worst] == (0.25 if first else 0.7)
    alone = np.full(num, 0.25)
    assert choose_worst(np.zeros((num, 3)), alone, alone, np.zeros(num, np.int64), [model]) == 0


@pytest.mark.parametrize(('num', 'stray'), [(1, True), (10, True), (25, False)])
def test_a_hazard_does_not_rest_on_strays_above_a_dense_crown(num, stray):
    model, rng = make(0.0), np.random.default_rng(4)
    crown = rng.uniform(0.0, 1.0, (500, 3))
    above = rng.uniform(0.0, 0.3, (num, 3)) + np.array([0.5, 0.5, 2.5])
    points = np.vstack([crown, above])
    distance = 4.0 - points[:, 2]
    worst = choose_worst(
        points, distance / 4.0, distance, np.zeros(len(points), np.int64), [model]
    )
    assert worst == int(np.argmin(distance[:500] if stray else distance))


def test_the_tip_of_a_sparse_tree_is_no_stray():
    model = make(0.0)
    points = np.column_stack([np.zeros(9), np.zeros(9), np.linspace(0.0, 3.0, 9)])
    points = np.vstack([points, np.random.default_rng(5).uniform(-0.9, 0.0, (24, 3))])
    distance = 4.0 - points[:, 2]
    assert choose_worst(
        points, distance / 4.0, distance, np.zeros(len(points), np.int64), [model]
    ) == 8
