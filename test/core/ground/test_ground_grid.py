# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from itertools import pairwise
import math
import tracemalloc

import numpy as np
import pytest
from toys import make_ground, make_wire, turn

from plc_inspect.config import HeightSettings
from plc_inspect.core.ground import ground_surface
from plc_inspect.core.ground.ground_grid import FINE, lay_blocks, SHIFT
from plc_inspect.core.ground.ground_surface import measure_surface

SETTINGS = HeightSettings()
SHIFTED = np.array([503.0, 71.0, 0.0])


def slope(x, y):
    return 12.0 * np.sin(x / 90.0) + 9.0 * np.cos(y / 70.0) + 0.05 * x


def make_corridor(length, angle=0.55, width=60.0):
    """Make ground and wires aslant to the axes."""
    ground = make_ground((0.0, 0.0), (length, width), per_square_metre=1.5)
    wires = [
        make_wire((begin, y, 25.0), (end, y, 25.0), c=900.0)
        for begin, end in pairwise(np.arange(0.0, length + 1.0, 250.0)) for y in (20.0, 40.0)
    ]
    points = turn(np.vstack([ground, *wires]), angle)
    points[:, 2] += slope(*points[:, :2].T)
    return points


@pytest.fixture
def wide(monkeypatch):
    """Keep cells only about points, however few there are."""
    monkeypatch.setattr(ground_surface, 'MAX_CELLS', 0)


@pytest.mark.parametrize('angle', [0.0, 0.55, 2.0])
def test_heights_are_those_above_a_grid_that_keeps_all(angle, monkeypatch):
    points = make_corridor(2600.0, angle)
    all_kept = measure_surface(points, SETTINGS)
    assert all_kept.ground.table.shape == (1, 1, 5)
    monkeypatch.setattr(ground_surface, 'MAX_CELLS', 0)
    few_kept = measure_surface(points, SETTINGS)
    assert few_kept.ground.table.size > 5
    assert len(few_kept.ground.height) < len(all_kept.ground.height) or angle == 0.0
    np.testing.assert_allclose(few_kept.height, all_kept.height, atol=1e-5)
    places = points[::7, :2] + np.random.default_rng(3).uniform(-9.0, 9.0, (len(points[::7]), 2))
    for max_gap in (0.0, 2.5, math.inf):
        np.testing.assert_allclose(
            few_kept.ground.at(places, max_gap), all_kept.ground.at(places, max_gap), atol=1e-5
        )
    np.testing.assert_array_equal(
        few_kept.ground.tell_seen(places), all_kept.ground.tell_seen(places)
    )
    assert few_kept.ground.tell_seen(places).any()
    assert few_kept.ground.holds(points[:, :2])
    assert not few_kept.ground.holds(points[:, :2] + 9.0)


def test_a_long_line_keeps_its_cell_size():
    """All cells within its bounds would be 40 million."""
    points = make_corridor(9500.0)
    surface = measure_surface(points, SETTINGS)
    assert surface.ground.cell_size == SETTINGS.cell_size
    assert np.prod(surface.ground.shape) > 30_000_000 > 6 * len(surface.ground.height)
    is_wire = np.arange(len(points)) >= int(1.5 * 9500.0 * 60.0)
    assert np.abs(surface.height[~is_wire]).max() < 2.0
    assert surface.height[is_wire].min() > 10.0


def test_two_sites_far_apart_keep_theirs():
    site = make_ground((0.0, 0.0), (150.0, 150.0), height=slope)
    surface = measure_surface(np.vstack([site, site + np.array([40e3, 30e3, 100.0])]), SETTINGS)
    assert surface.ground.cell_size == SETTINGS.cell_size
    assert np.abs(surface.height).max() < 2.0
    between = np.array([[20e3, 15e3], [math.nan, 0.0]])
    assert np.isnan(surface.ground.at(between)).all()
    assert not surface.ground.tell_seen(between).any()


def test_cells_grow_where_bounds_or_area_are_too_wide(monkeypatch):
    site = make_ground((0.0, 0.0), (150.0, 150.0))
    apart = measure_surface(np.vstack([site, site + np.array([3e6, 2e6, 0.0])]), SETTINGS)
    assert 15.0 < apart.ground.cell_size < 25.0
    monkeypatch.setattr(ground_surface, 'MOST_CELLS', 6000)
    dense = measure_surface(site, SETTINGS).ground
    assert 1.5 < dense.cell_size < 2.5
    assert len(dense.height) <= 6000


@pytest.mark.parametrize('angle', [0.3, 2.8])
def test_heights_in_a_part_are_those_in_the_whole(wide, angle):
    """Stages decide at full metres, where another rounding is another decision."""
    points = make_corridor(3000.0, angle) + SHIFTED
    region = np.array([points.min(axis=0), points.max(axis=0)])
    along = turn(points - SHIFTED, -angle)[:, 0]
    own = (along > 700.0) & (along < 2300.0)
    inner = (along[own] > 1200.0) & (along[own] < 1800.0)
    whole = measure_surface(points, SETTINGS)
    part = measure_surface(points[own], SETTINGS, region=region)
    off = np.abs(part.height - whole.height[own])[inner]
    assert off.max() < 1e-4
    assert inner.sum() > 1000


@pytest.mark.parametrize(('density', 'share'), [(0.8, 1.0), (0.4, 1.0), (0.04, 0.0)])
def test_sparse_ground_is_ground_if_it_shows_a_surface(monkeypatch, density, share):
    """Conductors seen as rarely leave as many cells, in rows."""
    rng = np.random.default_rng(5)
    places = rng.uniform(0.0, (2000.0, 60.0), (int(density * 2000.0 * 60.0), 2))
    points = np.column_stack([places, slope(*places.T)])
    all_kept = measure_surface(points, SETTINGS).height
    monkeypatch.setattr(ground_surface, 'MAX_CELLS', 0)
    np.testing.assert_allclose(measure_surface(points, SETTINGS).height, all_kept, atol=1e-5)
    assert np.isfinite(all_kept).mean() == share


def test_wires_over_water_are_no_ground_of_their_block(wide):
    """Near the banks these tell that they are too high; farther out no ground is known."""
    banks = [make_ground((x, 0.0), (x + 300.0, 60.0)) for x in (0.0, 1500.0)]
    wires = [
        make_wire((300.0, 20.0 + side, 25.0), (1500.0, 20.0 + side, 25.0), c=30_000.0)
        for side in np.arange(0.0, 4.0, 1.0)
    ]
    points = np.vstack([*banks, *wires])
    surface = measure_surface(points, SETTINGS)
    height = surface.height[sum(map(len, banks)):]
    assert np.nanmin(height) > 15.0
    out = np.abs(points[sum(map(len, banks)):, 0] - 900.0)
    assert np.isfinite(height[out > 540.0]).all()
    assert np.isnan(height[out < 400.0]).all()


def test_points_that_are_no_numbers_hold_no_block(wide):
    points = make_corridor(1200.0)
    broken = np.vstack([points, [[math.nan, 0.0, 0.0], [5000.0, 5000.0, math.inf]]])
    surface = measure_surface(broken, SETTINGS)
    assert np.isnan(surface.height[-2:]).all()
    np.testing.assert_array_equal(surface.height[:-2], measure_surface(points, SETTINGS).height)


def test_blocks_hold_points_and_what_is_beside_them():
    place = np.array([[700.5, 2500.5, 0.0]])
    table, num_kept = lay_blocks(place, np.zeros(2), 1.0, (2520, 4000))
    assert table.shape == (10, 16, 5)
    assert np.argwhere(table[:, :, 3] > 0).tolist() == [[9, 2]]
    assert table[9, 2].tolist() == [0, 38 * FINE, 9 * FINE, 2520 - 38 * FINE, 3 * FINE]
    assert num_kept == (2520 - 38 * FINE + 1) * (3 * FINE + 1)
    assert 2**SHIFT % FINE == 0


def test_laying_blocks_takes_little_memory():
    """One point in each square of 64 cells, as in a thinned cloud of a whole county."""
    x, y = (value.ravel() for value in np.meshgrid(*[np.arange(700) * FINE + 0.5] * 2))
    points = np.column_stack([x, y, np.zeros(len(x))])
    tracemalloc.start()
    _, num_kept = lay_blocks(points, np.zeros(2), 1.0, (700 * FINE, 700 * FINE))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert num_kept > (700 * FINE) ** 2
    assert peak < 64e6
