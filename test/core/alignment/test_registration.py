# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Points are moved onto the cells by what these tell, and along wires they tell nothing."""

import numpy as np
import pytest

from plc_inspect.core.alignment.cell_comparison import LEAST_LOOKS, OPEN_NS
from plc_inspect.core.alignment.normal_cells import NormalCells
from plc_inspect.core.alignment.registration import fit_points
from plc_inspect.core.alignment.rigid_move import RigidMove

LATER = 2 * OPEN_NS
PLACE = np.array([0.0, 0.0, 15.0])
KNOWN = np.diag([1.0, 1.0, 1.0, 0.002]) ** 2
START = RigidMove(centre=PLACE)


def look_at_wires(rng, num=300):
    """Return (3 * num, 3) points of three conductors that sag, with the noise of a lidar [m]."""
    x = rng.uniform(-30.0, 30.0, (3, num))
    y = np.repeat(4.0 * np.arange(3.0)[:, None], num, axis=1)
    points = np.stack((x, y, 10.0 + x**2 / 2000.0), axis=-1).reshape(-1, 3)
    return points + rng.normal(0.0, 0.04, points.shape)


def look_at_poles(rng, behind, num=200):
    """Return points of four poles 0.4 m thick, of the side towards x < 0, or that behind [m]."""
    angle = rng.uniform(-0.5, 0.5, (4, num)) * np.pi + (0.0 if behind else np.pi)
    feet = np.array([(0.5, 5.5), (0.5, -5.5), (0.5, 10.5), (0.5, -10.5)])[:, None]
    plan = feet + 0.2 * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    z = rng.uniform(0.0, 12.0, (4, num, 1))
    return np.concatenate((plan, z), axis=-1).reshape(-1, 3)


def fill(points, place=None):
    cells = NormalCells()
    for part, own in enumerate(points):
        cells.add(own, part, place)
    return cells


@pytest.mark.parametrize('seed', range(4))
def test_along_wires_nothing_is_told(seed):
    rng = np.random.default_rng(seed)
    cells = fill([look_at_wires(rng) for _ in range(2 * LEAST_LOOKS)], PLACE)
    fit = fit_points(cells, look_at_wires(rng), START, KNOWN, LATER)
    assert fit.matched > 700
    along, across = np.sqrt(np.diag(fit.covariance)[:2])
    assert along > 0.9  # of 1 m that was known
    assert across < 0.02
    assert abs(fit.move.shift[0]) < 0.2


def test_poles_beside_wires_tell_how_far_along():
    rng = np.random.default_rng(1)
    both = [
        np.concatenate((look_at_wires(rng), look_at_poles(rng, behind=False)))
        for _ in range(2 * LEAST_LOOKS)
    ]
    cells = fill(both[:-1], np.array([-20.0, 0.0, 15.0]))
    moved = RigidMove(np.array([0.2, 0.1, 0.0]), 0.0, PLACE)
    start = RigidMove(centre=np.array([-20.0, 0.0, 15.0]))
    fit = fit_points(cells, moved.apply(both[-1]), start, KNOWN, LATER)
    np.testing.assert_allclose(fit.move.shift, -moved.shift, atol=0.05)
    assert np.sqrt(fit.covariance[0, 0]) < 0.1


def test_the_other_side_of_what_was_passed_is_no_drift():
    rng = np.random.default_rng(2)
    looks = [look_at_poles(rng, behind=False) for _ in range(2 * LEAST_LOOKS)]
    before, behind = np.array([-20.0, 0.0, 15.0]), RigidMove(centre=np.array([20.0, 0.0, 15.0]))
    seen = look_at_poles(rng, behind=True)
    fit = fit_points(fill(looks, before), seen, behind, KNOWN, LATER)
    assert abs(fit.move.shift[0]) < 0.05
    # where nobody knows from where the first were seen, both sides are taken for one
    assert fit_points(fill(looks), seen, behind, KNOWN, LATER).move.shift[0] < -0.2


def test_what_is_predicted_wrongly_is_compared_as_held_too():
    rng = np.random.default_rng(3)
    both = [
        np.concatenate((look_at_wires(rng), look_at_poles(rng, behind=False)))
        for _ in range(2 * LEAST_LOOKS)
    ]
    cells = fill(both[:-1], PLACE - (20.0, 0.0, 0.0))
    predicted = RigidMove(np.array([-1.6, 0.0, 0.0]), 0.0, PLACE - (20.0, 0.0, 0.0))
    alone = fit_points(cells, both[-1], predicted, KNOWN, LATER)
    assert abs(alone.move.shift[0]) > 0.5
    fit = fit_points(cells, both[-1], predicted, KNOWN, LATER, held=RigidMove())
    assert abs(fit.move.shift[0]) < 0.05
    assert fit.fitting > alone.fitting
