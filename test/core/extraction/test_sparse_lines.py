# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Lines of points that lie too far apart for a neighbourhood."""

from dataclasses import replace

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.evidence.searches import Searches
from plc_inspect.core.extraction.alignment import LINE_RADIUS
from plc_inspect.core.extraction.linearity import anchor, measure_scales
from plc_inspect.core.extraction.sparse_lines import find_sparse_lines, list_places, MOST_NEAR
from plc_inspect.core.pipeline import Pipeline

LINEARITY = Settings().linearity
GROUND = 40_000


def look(points, settings=LINEARITY, min_votes=5):
    chosen = np.arange(len(points))
    scales = measure_scales(points, chosen, anchor(points, chosen, settings), settings)
    return find_sparse_lines(*list_places(scales), settings, min_votes)


def make_wire(rng, density, length=80.0, azimuth=0.7, slope=0.1, sag=1.0, aside=0.0):
    """Return points on a wire through (0, 0, 10), seen at random places."""
    x = np.sort(rng.uniform(-length / 2, length / 2, int(density * length)))
    z = 10.0 + slope * x + sag * (2.0 * x / length) ** 2
    points = np.column_stack((
        x * np.cos(azimuth) - aside * np.sin(azimuth),
        x * np.sin(azimuth) + aside * np.cos(azimuth), z,
    ))
    return points + rng.normal(0.0, 0.03, points.shape)


def make_scanned(rng, num, pitch, aside, above, azimuth, more=2, length=54.0):
    """Return points on a wire where lines a pitch apart cross it, fewer than ``more`` over num."""
    lines = np.arange(-length / 2, length / 2, pitch) + rng.uniform(0.0, pitch)
    x = np.repeat(lines, rng.integers(num, num + more, len(lines)))
    z = above + 0.26 * x + 0.35 * (2.0 * x / length) ** 2
    points = np.column_stack((
        x * np.cos(azimuth) - aside * np.sin(azimuth),
        x * np.sin(azimuth) + aside * np.cos(azimuth), z,
    ))
    return points + rng.normal(0.0, 0.02, points.shape)


@pytest.mark.parametrize('seed', range(4))
def test_places_on_a_sparse_wire_have_its_direction(seed):
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-1.5, 1.5)
    found = look(make_wire(rng, 0.7, azimuth=azimuth))
    assert len(found.position) > 30
    way = np.array([np.cos(azimuth), np.sin(azimuth)])
    plan = found.direction[:, :2] / np.linalg.norm(found.direction[:, :2], axis=1)[:, None]
    assert np.abs(plan @ way).min() > 0.998
    assert np.hypot(*found.direction.T[:2]).min() > 0.95


def test_wires_beside_each_other_keep_their_direction():
    rng = np.random.default_rng(3)
    wires = [make_wire(rng, 0.8, aside=aside) for aside in (-2.0, 0.0, 2.0)]
    found = look(np.concatenate(wires))
    plan = found.direction[:, :2] / np.linalg.norm(found.direction[:, :2], axis=1)[:, None]
    assert len(found.position) > 100
    assert (np.abs(plan @ np.array([np.cos(0.7), np.sin(0.7)])) > 0.995).mean() > 0.95


def test_scattered_points_and_steep_lines_are_none():
    rng = np.random.default_rng(4)
    assert len(look(rng.uniform(0.0, 40.0, (300, 3))).position) < 10
    assert len(look(make_wire(rng, 0.7, slope=0.6)).position) == 0


def test_few_scales_have_no_sparse_places():
    rng = np.random.default_rng(8)
    for num, least, most in ((1, 0, 0), (2, 0, 0), (3, 40, 80)):
        found = look(make_wire(rng, 0.7), replace(LINEARITY, num_scales=num))
        assert least <= len(found.position) <= most


def test_dense_wires_and_places_in_crowns_are_left_out():
    rng = np.random.default_rng(5)
    assert len(look(make_wire(rng, 8.0)).position) < 10
    wire = make_wire(rng, 0.7)
    middle = np.array([0.0, 0.0, 10.0])
    crown = rng.normal(middle, 3.0, (40 * MOST_NEAR, 3))
    far = np.linalg.norm(crown - middle, axis=1) < 8.0
    both = look(np.concatenate((wire, crown[far])))
    near = np.linalg.norm(both.position - middle, axis=1) < 4.0
    assert len(both.position) > 0
    assert not near.any()


def test_votes_are_asked_for():
    rng = np.random.default_rng(6)
    wire = make_wire(rng, 0.6)
    assert len(look(wire, min_votes=4).position) > len(look(wire, min_votes=8).position)
    assert len(look(wire, min_votes=16).position) == 0
    assert len(look(wire[:0]).position) == 0


def test_only_what_lies_in_the_tube_turns_it():
    rng = np.random.default_rng(7)
    wire = make_wire(rng, 0.7, azimuth=0.0, slope=0.0, sag=0.0)
    beside = wire[::4] + np.array([0.0, 2.0 * LINE_RADIUS, 0.0])
    found = look(np.concatenate((wire, beside)))
    own = np.abs(found.position[:, 1]) < LINE_RADIUS / 2
    assert own.sum() > 30
    assert np.abs(found.direction[own, 1]).max() < 0.05


@pytest.mark.parametrize('seed', range(3))
def test_sparse_conductors_are_found_in_longer_windows(monkeypatch, seed):
    rng = np.random.default_rng([11, seed])
    plan = rng.uniform((-60.0, -30.0), (60.0, 30.0), (GROUND, 2))
    wires = [
        make_wire(rng, 0.45, length=100.0, azimuth=0.2, slope=0.0, aside=aside, sag=1.5)
        for aside in (-2.0, 0.0, 2.0)
    ]
    points = np.concatenate((np.column_stack((plan, np.zeros(GROUND))), *wires))
    assert (Pipeline(Settings()).run(points).line_id[GROUND:] >= 0).mean() > 0.9
    monkeypatch.setattr(
        Searches, 'look_sparsely', lambda self, curves: self.look_beside(curves[:0], curves)
    )
    assert (Pipeline(Settings()).run(points).line_id[GROUND:] >= 0).mean() < 0.1


def find_scanned(seed, num, pitch, more):
    """Return which share of the points of three wires in scan lines a pitch apart are found."""
    rng = np.random.default_rng([seed, num])
    azimuth = rng.uniform(-1.5, 1.5)
    plan = rng.uniform((-60.0, -60.0), (60.0, 60.0), (GROUND, 2))
    wires = [
        make_scanned(rng, num, pitch, aside, above, azimuth, more)
        for aside, above in ((0.2, 1.4), (0.0, 0.0), (-0.2, -1.4))
    ]
    points = np.concatenate((np.column_stack((plan, np.full(GROUND, -24.0))), *wires))
    return (Pipeline(Settings()).run(points).line_id[GROUND:] >= 0).mean()


@pytest.mark.parametrize('pitch', [1.31, 1.6, 2.0])
@pytest.mark.parametrize('num', [2, 5, 12])
def test_wires_in_scan_lines_far_apart_are_found(num, pitch):
    assert find_scanned(14, num, pitch, 2) > 0.99


@pytest.mark.parametrize(('num', 'pitch'), [(1, 0.48), (1, 0.55), (1, 0.62), (2, 1.0), (12, 1.0)])
def test_wires_seen_at_even_steps_are_found(num, pitch):
    found = [find_scanned(seed, num, pitch, 1) for seed in (900, 901, 902)]
    assert min(found) > 0.99


def test_what_a_scan_line_has_of_a_wire_is_one_place():
    rng = np.random.default_rng(15)
    few, many = (
        look(make_scanned(rng, num, 1.6, 0.0, 0.0, 0.4)) for num in (2, 12)
    )
    assert abs(len(many.position) - len(few.position)) <= 4
    assert len(few.position) > 25
