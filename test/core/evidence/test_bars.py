# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bars and pipes are told from conductors by the arc of their cross-section."""

import numpy as np
import pytest
from toys import make_curve, make_wire, turn

from plc_inspect.core.evidence.bars import is_bar


def make_pipe(radius, side=np.pi / 2, num=300, noise=0.03, seed=3):
    """Return points on the half of a level pipe that is seen from one side [rad]."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(side - np.pi / 2, side + np.pi / 2, num)
    points = np.column_stack([
        rng.uniform(0.0, 30.0, num), radius * np.cos(around), 6.0 + radius * np.sin(around)
    ])
    return points + rng.normal(0.0, noise, points.shape)


def tell(points):
    return is_bar(points, make_curve(points, tolerance=0.5))


@pytest.mark.parametrize('side', [np.pi / 2, 0.2, 2.4])
@pytest.mark.parametrize('radius', [0.15, 0.3])
def test_a_pipe_is_seen_from_one_side(radius, side):
    points = make_pipe(radius, side)
    before = points.copy()
    assert tell(points)
    assert tell(turn(points, 1.1, (40.0, -7.0, 3.0)))
    np.testing.assert_array_equal(points, before)


@pytest.mark.parametrize('noise', [0.02, 0.1])
def test_noise_about_a_conductor_is_no_arc(noise):
    for seed in range(20):
        wire = make_wire((0.0, 0.0, 9.0), (30.0, 0.0, 9.0), c=1e5, per_metre=10.0, seed=seed)
        wire[:, 1:] += np.random.default_rng(seed).normal(0.0, noise, (len(wire), 2))
        assert not tell(wire)


def test_two_and_four_sub_conductors_are_no_arc():
    for offsets in (((-0.2, 0.0), (0.2, 0.0)), ((0.0, -0.2), (0.0, 0.2)),
                    ((-0.2, -0.2), (-0.2, 0.2), (0.2, -0.2), (0.2, 0.2))):
        strands = [
            make_wire((0.0, y, 9.0 + z), (40.0, y, 9.0 + z), c=1e5, per_metre=10.0, seed=k)
            for k, (y, z) in enumerate(offsets)
        ]
        assert not tell(np.vstack(strands))


def test_a_few_points_are_no_arc():
    assert not tell(make_pipe(0.2, num=7))
