# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plc_inspect.config import Settings
from plc_inspect.core.alignment.moved_results import move_box, move_result
from plc_inspect.core.alignment.rigid_move import find_heading, RigidMove
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.errors import DataError

RNG = np.random.default_rng(4)
POINTS = RNG.normal(0, 100, (50, 3))
ONE = RigidMove(np.array([1.0, 2.0, 3.0]), 0.3, np.array([10.0, -5.0, 2.0]))
TWO = RigidMove(np.array([-4.0, 0.5, 1.0]), -1.1, np.array([0.0, 50.0, 0.0]))


def test_a_quarter_turn_by_hand():
    move = RigidMove(np.array([1.0, 0.0, 0.0]), math.pi / 2, np.array([10.0, 0.0, 0.0]))
    np.testing.assert_allclose(move.apply(np.array([12.0, 0.0, 7.0])), [11.0, 2.0, 7.0])


def test_moves_compose_and_invert():
    np.testing.assert_allclose(ONE.inverse().apply(ONE.apply(POINTS)), POINTS)
    np.testing.assert_allclose(TWO.after(ONE).apply(POINTS), TWO.apply(ONE.apply(POINTS)))
    np.testing.assert_allclose(ONE.about(POINTS[0]).apply(POINTS), ONE.apply(POINTS))


def test_a_move_survives_its_record():
    again = RigidMove.from_record(ONE.record())
    np.testing.assert_array_equal(again.apply(POINTS), ONE.apply(POINTS))
    assert RigidMove.from_record(None).trivial
    with pytest.raises(DataError, match='3 coordinates'):
        RigidMove.from_record({'shift': [1.0], 'yaw': 0.0, 'centre': [0.0, 0.0, 0.0]})


@pytest.mark.parametrize('scale', [1.0, 0.5, 3.0])
def test_the_heading_is_where_the_x_axis_points_in_plan(scale):
    turns = Rotation.random(50, random_state=6)
    for quaternion, axis in zip(turns.as_quat(), turns.apply([1.0, 0.0, 0.0]), strict=True):
        expected = math.atan2(axis[1], axis[0])
        assert find_heading(scale * quaternion) == pytest.approx(expected, abs=1e-9)


def test_the_box_holds_what_was_in_it():
    box = np.array([POINTS.min(axis=0), POINTS.max(axis=0)])
    low, high = move_box(box, ONE)
    moved = ONE.apply(POINTS)
    assert (moved >= low).all()
    assert (moved <= high).all()


def test_moved_spans_lie_where_their_points_do():
    result = Pipeline(Settings()).run(make_sample())
    moved = move_result(result, ONE)
    assert len(moved.spans) == len(result.spans) > 0
    for before, after in zip(result.spans, moved.spans, strict=True):
        along = np.linspace(0.0, before.length, 7)
        np.testing.assert_allclose(
            after.positions(along), ONE.apply(before.positions(along)), atol=1e-9
        )
        np.testing.assert_allclose(after.lowest, ONE.apply(before.lowest))
        unit = (after.end - after.start)[:2] / after.length
        np.testing.assert_allclose(
            unit, [math.cos(after.azimuth), math.sin(after.azimuth)], atol=1e-9
        )
    assert move_result(result, RigidMove()) is result
