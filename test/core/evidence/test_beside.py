# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors beside those that are known, of points that do not lie along a line."""

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import fit_curve, pack_curves
from plc_inspect.core.evidence.beside import BEYOND, find_nearest, REACH
from plc_inspect.core.numerics.plan_index import build_plan_index
from plc_inspect.core.pipeline import Pipeline

LENGTH, HIGH, CONSTANT, GROUND = 70.0, 14.0, 600.0, 20_000


def hang(x, y):
    """Return points of a conductor at places along it."""
    middle = 0.5 * LENGTH
    z = HIGH + CONSTANT * (np.cosh((x - middle) / CONSTANT) - np.cosh(middle / CONSTANT))
    return np.column_stack((x, np.full(len(x), y), z))


def make_cloud(rng, azimuth, *wires):
    """Return ground and wires, turned."""
    plan = rng.uniform((-20.0, -30.0), (LENGTH + 20.0, 30.0), (GROUND, 2))
    ground = np.column_stack((plan, np.zeros(GROUND)))
    points = np.concatenate((ground, *wires))
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    points[:, :2] = points[:, :2] @ np.array(((ca, sa), (-sa, ca)))
    return points + rng.normal(0, 0.02, points.shape)


def bead(rng, y):
    """Return a conductor in scan lines 1.45 m apart, a footprint of 0.3 m across each."""
    x = np.repeat(np.arange(0.7, LENGTH, 1.45), 10)
    wire = hang(x + rng.uniform(-0.1, 0.1, len(x)), y)
    return wire + np.column_stack((
        np.zeros(len(x)), rng.uniform(-0.15, 0.15, len(x)), np.zeros(len(x))
    ))


@pytest.mark.parametrize('seed', range(3))
def test_blurred_beads_beside_a_conductor_are_one(seed):
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0.0, np.pi)
    known = hang(np.linspace(0.0, LENGTH, 700), 0.0)
    cloud = make_cloud(rng, azimuth, known, bead(rng, 1.3), bead(rng, -1.2))
    result = Pipeline(Settings()).run(cloud)
    assert len(result.spans) == 3
    assert (result.line_id[GROUND:] >= 0).mean() >= 0.97


@pytest.mark.parametrize('seed', range(3))
def test_a_row_of_crowns_beside_a_conductor_is_none(seed):
    rng = np.random.default_rng(seed)
    known = hang(np.linspace(0.0, LENGTH, 700), 0.0)
    middle = np.repeat([(x, 3.0, 11.0) for x in np.arange(3.0, LENGTH, 4.0)], 250, axis=0)
    away = rng.normal(size=middle.shape)
    away *= rng.uniform(0.5, 1.6, (len(middle), 1)) / np.linalg.norm(away, axis=1)[:, None]
    result = Pipeline(Settings()).run(
        make_cloud(rng, rng.uniform(0.0, np.pi), known, middle + away)
    )
    assert len(result.spans) == 1


@pytest.mark.parametrize('shift', [-1e-9, 0.0, 1e-9])
def test_the_outermost_points_of_a_curve_are_its_own_however_they_are_rounded(shift):
    points = hang(np.linspace(0.0, LENGTH, 700), 0.0)
    curve = fit_curve(points, np.arange(700), tolerance=0.1)
    index = build_plan_index(points, np.arange(700), 2.0)
    moved = points.copy()
    moved[:, 0] += shift
    _, is_own = find_nearest(moved, index, pack_curves([curve]), 1, REACH, BEYOND)
    assert is_own.all()
