# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors that a second search finds."""

from dataclasses import replace

import numpy as np
import pytest

from plc_inspect.config import AlignmentSettings, Settings
from plc_inspect.core.catenary.curve import fit_curve
from plc_inspect.core.evidence.searches import ROOM, Searches
from plc_inspect.core.pipeline import Pipeline

GROUND = 12_000


def make_fan(rng, azimuth, num_wires, length, density):
    """Return ground, and wires of a fan from 0.05 m apart at a pole to 0.35 m, turned."""
    plan = rng.uniform((-15.0, -15.0), (length + 15.0, 15.0), (GROUND, 2))
    parts = [np.column_stack((plan, np.zeros(GROUND)))]
    for k in range(num_wires):
        x = rng.uniform(0.3, length, int(density * length))
        y = (k - (num_wires - 1) / 2) * (0.05 + 0.3 * x / length)
        parts.append(np.column_stack((x, y, 7.0 + 0.004 * x * (x - length))))
    points = np.concatenate(parts)
    points += rng.normal(0.0, 0.02, points.shape)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    points[:, :2] = points[:, :2] @ np.array(((ca, sa), (-sa, ca)))
    return points


def measure_share(points):
    result = Pipeline(Settings()).run(points)
    return (result.line_id[GROUND:] >= 0).mean()


def test_wires_of_a_fan_are_found_in_shorter_windows(monkeypatch):
    clouds = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        clouds.append(make_fan(rng, rng.uniform(0.0, np.pi), 5, 20.0, 25.0))
    with_it = np.array([measure_share(points) for points in clouds])
    monkeypatch.setattr(
        Searches, 'look_again', lambda self, curves: self.look_beside(curves[:0], curves)
    )
    without = np.array([measure_share(points) for points in clouds])
    assert (with_it >= without).all()
    assert with_it.mean() > max(0.75, without.mean() + 0.2)


@pytest.mark.parametrize('distance', [0.5 * ROOM, 4.0 * ROOM])
def test_only_places_about_the_curves_are_searched(distance):
    rng = np.random.default_rng(5)
    points = make_fan(rng, 0.3, 1, 60.0, 30.0)
    lines = Pipeline(Settings()).trace(points).lines
    searches = lines.searches
    curve = lines.conductors.curves[0]
    moved = lines.cloud.points + np.array([0.0, 0.0, distance])
    tracks = searches.look_again([fit_curve(moved, curve.points, tolerance=curve.tolerance)])
    assert (tracks.num_tracks > 0) == (distance < ROOM)


def test_the_shortest_windows_that_can_be_set_are_shortened_as_others_are():
    settings = Settings(alignment=AlignmentSettings(half_length=1.0))
    points = make_fan(np.random.default_rng(5), 0.3, 1, 60.0, 30.0)
    lines = Pipeline(Settings()).trace(points).lines
    searches = replace(lines.searches, settings=settings)
    assert searches.look_again(lines.conductors.curves).num_tracks > 0


def make_slope(rng, slope_deg, sag, num_wires=3, length=120.0):
    """Return a slope, and wires along it between points 12 m above it."""
    rise = np.tan(np.radians(slope_deg))
    plan = rng.uniform((-20.0, -20.0), (length + 20.0, 20.0), (GROUND, 2))
    parts = [np.column_stack((plan, rise * plan[:, 0]))]
    for k in range(num_wires):
        x = rng.uniform(0.0, length, int(4 * length))
        depth = 4.0 * sag * x * (length - x) / length**2
        parts.append(np.column_stack((x, np.full(len(x), 1.5 * k), 12.0 + rise * x - depth)))
    points = np.concatenate(parts)
    return points + rng.normal(0.0, 0.02, points.shape)


@pytest.mark.parametrize('slope_deg', [15.0, 22.0, 28.0, 34.0])
def test_conductors_of_a_steep_span_are_found(slope_deg):
    points = make_slope(np.random.default_rng(7), slope_deg, sag=2.5)
    result = Pipeline(Settings()).run(points)
    assert len(result.spans) == 3
    assert (result.line_id[GROUND:] >= 0).mean() > 0.98


@pytest.mark.parametrize('slope_deg', [22.0, 28.0, 34.0])
@pytest.mark.parametrize('num_wires', [1, 3])
def test_what_is_steep_and_straight_is_no_conductor(slope_deg, num_wires):
    points = make_slope(np.random.default_rng(7), slope_deg, sag=0.0, num_wires=num_wires)
    assert not Pipeline(Settings()).run(points).spans


def test_what_lies_along_known_conductors_is_not_searched_again():
    lines = Pipeline(Settings()).trace(make_slope(np.random.default_rng(7), 28.0, 2.5)).lines
    assert lines.searches.look_steeply([]).num_tracks >= 3
    assert not lines.searches.look_steeply(lines.conductors.curves).num_tracks


def make_sparse_line(rng, azimuth, density):
    """Return ground, and two spans of three conductors of few points a metre, turned."""
    plan = rng.uniform((-15.0, -25.0), (105.0, 25.0), (GROUND, 2))
    parts = [np.column_stack((plan, np.zeros(GROUND)))]
    for k in range(3):
        x = rng.uniform(0.0, 90.0, int(density * 90.0))
        along = np.where(x < 45.0, x, x - 45.0)
        parts.append(np.column_stack((
            x, np.full(len(x), 1.2 * (k - 1)), 9.0 + along * (along - 45.0) / 600.0
        )))
    points = np.concatenate(parts)
    points += rng.normal(0.0, 0.03, points.shape)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    points[:, :2] = points[:, :2] @ np.array(((ca, sa), (-sa, ca)))
    return points


def test_sparse_conductors_are_found_along_the_pieces_that_chance_leaves(monkeypatch):
    clouds = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        clouds.append(make_sparse_line(rng, rng.uniform(0.0, np.pi), 0.6))
    monkeypatch.setattr(  # which finds them as well
        Searches, 'look_sparsely', lambda self, curves: self.look_beside(curves[:0], curves)
    )
    with_it = np.array([measure_share(points) for points in clouds])
    monkeypatch.setattr(
        Searches, 'look_along', lambda self, curves, known: self.look_beside(curves[:0], curves)
    )
    without = np.array([measure_share(points) for points in clouds])
    assert (with_it >= without).all()
    assert (with_it > 0.5).sum() >= 3
    assert not (without > 0.5).any()
