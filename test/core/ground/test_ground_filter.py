# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.ground.ground_fill import fill_near, WIDER
from plc_inspect.core.ground.ground_filter import (
    _is_areal,
    _limit_sweeps,
    _lower_envelope,
    AREAL_REACH,
    AREAL_SHARE,
    estimate_ground,
    LEAST_RAISED,
)
from plc_inspect.core.ground.ground_grid import FINE

SHAPES = [(1, 1), (1, 5), (6, 1), (7, 8), (15, 16), (16, 33), (40, 31)]


@pytest.mark.parametrize('shape', [*SHAPES, (50, 60)])
def test_without_any_point_no_ground_is_known(shape):
    ground, seen = estimate_ground(np.full(shape, np.nan, dtype=np.float32), 1.0, 1.0)
    assert np.isnan(ground).all()
    assert not seen.any()


@pytest.mark.parametrize('shape', SHAPES)
@pytest.mark.parametrize('share', [0.0, 0.15, 0.25, 1.0])
def test_ground_has_ground_about_it(shape, share):
    seen = np.random.default_rng(1).uniform(size=shape) < share
    expected = np.empty(shape, dtype=bool)
    reach = AREAL_REACH
    for row in range(shape[0]):
        for column in range(shape[1]):
            about = seen[
                max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1
            ]
            least = AREAL_SHARE * max(about.size, (2 * reach + 1) ** 2 / 2)
            expected[row, column] = about.sum() >= least - 1e-4
    np.testing.assert_array_equal(_is_areal(seen, AREAL_SHARE), expected)


@pytest.mark.parametrize('shape', SHAPES)
def test_what_is_known_stays_and_all_else_is_filled_from_it(shape):
    rng = np.random.default_rng(2)
    values = rng.uniform(10.0, 20.0, shape).astype(np.float32)
    known = rng.uniform(size=shape) < 0.2
    known[-1, -1] = True
    filled = fill_near(np.where(known, values, np.float32(np.nan)))
    assert filled.dtype == np.float32
    np.testing.assert_array_equal(filled[known], values[known])
    assert filled.min() >= values[known].min() - 1e-5
    assert filled.max() <= values[known].max() + 1e-5


def test_a_hole_in_a_slope_is_filled_by_the_slope():
    slope = np.add.outer(np.arange(64.0), 0.5 * np.arange(64.0)).astype(np.float32)
    hole = slope.copy()
    hole[20:28, 30:38] = np.nan
    assert np.abs(fill_near(hole) - slope).max() < 3.0
    assert np.abs(fill_near(hole) - slope).mean() < 0.02


@pytest.mark.parametrize('seed', range(6))
def test_what_is_far_from_known_cells_does_not_matter_to_the_envelope(seed):
    rng = np.random.default_rng(seed)
    rows = columns = 300
    place = np.arange(5, rows - 5, 20)
    aside = rng.integers(-4, 5, len(place))
    surface = np.full((rows, columns), np.nan, dtype=np.float32)
    surface[place, place + aside] = rng.uniform(-930.0, -900.0, len(place))
    known = np.isfinite(surface)
    cell, slope = rng.uniform(0.8, 1.2), rng.uniform(0.8, 1.2)
    first, last = _limit_sweeps(surface, cell, slope)
    assert (last - first).sum() < 0.8 * rows * columns
    all_first, all_last = np.zeros(rows, dtype=np.int64), np.full(rows, columns)
    np.testing.assert_array_equal(
        _lower_envelope(surface, cell, slope, first, last)[known],
        _lower_envelope(surface, cell, slope, all_first, all_last)[known],
    )


def test_nothing_known_stays_unknown():
    assert np.isnan(fill_near(np.full((5, 4), np.nan, dtype=np.float32))).all()


def lay_rows(height, wide=3):
    """Return lowest points: ground on both sides of 30 empty cells with a thin row amid them."""
    lowest = np.full((75, 60), np.nan, dtype=np.float32)
    lowest[:20] = lowest[-20:] = 0.0
    lowest[36 : 36 + wide] = height
    return lowest


@pytest.mark.parametrize(('height', 'seen'), [(8.0, False), (2.0, True)])
def test_a_row_of_wires_alone_is_no_ground_and_a_scan_line_on_it_is(height, seen):
    ground, found = estimate_ground(lay_rows(height), 1.0, 1.0)
    assert found[:20].all()
    assert found[-20:].all()
    assert found[36:39, 10:50].all() == seen
    assert (np.abs(ground[37]).max() < 0.5) != seen


@pytest.mark.parametrize('num', [1, 3, 4])
def test_rows_of_wires_are_no_ground_where_nothing_else_was_seen(num):
    row, column = np.mgrid[:80, :80]
    aslant = np.full((80, 80), np.nan, dtype=np.float32)
    for wire in range(num):
        aslant[np.isin(row - column, (3 * wire, 3 * wire + 1))] = 12.0  # two cells a row
    ground, found = estimate_ground(aslant, 1.0, 1.0)
    assert not found.any()
    assert np.isnan(ground).all()


def test_a_patch_of_ground_is_ground_among_rows_of_wires():
    lowest = lay_rows(8.0)
    lowest[-20:] = np.nan
    _, found = estimate_ground(lowest, 1.0, 1.0)
    assert found[:20].all()
    assert not found[36:39].any()


def test_five_rows_of_wires_are_no_ground_two_cells_by_two_either():
    row, column = np.mgrid[:80, :80]
    aslant = np.full((80, 80), np.nan, dtype=np.float32)
    for wire in range(5):
        aslant[np.isin(row - column, (8 * wire, 8 * wire + 1))] = 12.0  # two cells a row
    _, found = estimate_ground(aslant, 1.0, 1.0)
    assert not found.any()


def test_ground_is_known_near_what_was_seen_and_as_high_wherever_a_part_ends():
    rng = np.random.default_rng(7)
    lowest = rng.uniform(0.0, 0.3, (12 * FINE, 5 * FINE)).astype(np.float32)
    lowest += np.linspace(0.0, 90.0, len(lowest), dtype=np.float32)[:, None]
    lowest[5 * FINE :] = np.nan
    whole, _ = estimate_ground(lowest, 1.0, 1.0)
    part, _ = estimate_ground(lowest[2 * FINE :, FINE:], 1.0, 1.0)
    assert np.isfinite(whole[: 6 * FINE]).all()
    assert np.isnan(whole[(5 + WIDER) * FINE :]).all()
    inner = slice(4 * FINE, None), slice(3 * FINE, None)
    np.testing.assert_allclose(part[2 * FINE :, 2 * FINE :], whole[inner], atol=1e-4)


@pytest.mark.parametrize('gap', [FINE // 4, 5 * FINE])
@pytest.mark.parametrize('height', [8.0, 2.0])
def test_a_strip_is_ground_if_it_lies_low_beside_the_next_ground(height, gap):
    """Glint below a line over a river; the line itself, where none is seen."""
    lowest = np.full((2 * FINE + gap, 60), np.nan, dtype=np.float32)
    lowest[:FINE] = 0.0
    lowest[FINE + gap : FINE + gap + 3] = height
    _, found = estimate_ground(lowest, 1.0, 1.0)
    strip = found[FINE + gap :][:3, 10:50]
    assert strip.all() == strip.any() == (height < LEAST_RAISED)


@pytest.mark.parametrize('seed', range(3))
def test_sparse_ground_near_counts_more_than_dense_ground_far_away(seed):
    """A tile of a hill, with the valley beyond its halo."""
    lowest = np.full((8 * FINE, 60), np.nan, dtype=np.float32)
    lowest[:FINE] = 0.0
    hill = np.random.default_rng(seed).uniform(size=(3 * FINE, 60)) < 0.3
    lowest[5 * FINE :][hill] = 40.0
    for part in (lowest, lowest[3 * FINE :]):
        _, found = estimate_ground(part, 1.0, 1.0)
        assert found[-2 * FINE :][hill[-2 * FINE :]].mean() > 0.99


def test_a_plateau_is_ground_however_high():
    lowest = lay_rows(8.0)
    lowest[30:46] = 8.0
    ground, found = estimate_ground(lowest, 1.0, 1.0)
    assert found[30:46, 10:50].all()
    assert np.abs(ground[38, 10:50] - 8.0).max() < 0.1


@pytest.mark.parametrize('depth', [5.0, 50.0, 180.0])
def test_a_lone_low_return_beside_the_cloud_hides_no_ground(depth):
    lowest = np.full((60, 90), np.nan, dtype=np.float32)
    lowest[:, :60] = 0.0
    known, known_seen = estimate_ground(lowest, 0.5, 1.0)
    lowest[30, 85] = -depth
    ground, seen = estimate_ground(lowest, 0.5, 1.0)
    assert (seen[:, :60] == known_seen[:, :60]).all()
    assert not seen[30, 85]
    assert np.abs(ground - known)[:, :60].max() < 1e-6


def lay_noise(share, slope, seed):
    """Return the lowest points of a meadow on a slope, and which lie far below it."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:80, :90]
    lowest = (slope * (0.8 * row - 0.6 * column) + rng.normal(0.0, 0.05, row.shape))
    noise = rng.random(row.shape) < share
    lowest[noise] -= rng.uniform(0.8, 6.0, noise.sum())
    return lowest.astype(np.float32), noise


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('slope', [0.0, 0.4])
@pytest.mark.parametrize(('share', 'seen'), [(0.01, 0.97), (0.06, 0.9)])
def test_returns_from_below_the_ground_hide_none_of_it(share, seen, slope, seed):
    lowest, noise = lay_noise(share, slope, seed)
    _, found = estimate_ground(lowest, 1.0, 1.0)
    inner = np.s_[3:-3, 3:-3]
    assert found[inner][~noise[inner]].mean() > seen
    assert found[inner][noise[inner]].mean() < 0.1


@pytest.mark.parametrize('wide', [1, 5])
def test_the_ground_of_a_lane_between_roofs_is_kept(wide):
    lowest = np.full((60, 60), 3.0, dtype=np.float32)
    lowest[:, 30 : 30 + wide] = 0.0
    lowest[:20] = lowest[-20:] = 0.0
    _, found = estimate_ground(lowest, 1.0, 1.0)
    assert found[20:40, 30 : 30 + wide].all()


@pytest.mark.parametrize(('wide', 'share'), [(1, 1.0), (2, 0.85)])
def test_a_lane_that_is_closed_is_kept(wide, share):
    lowest = np.random.default_rng(3).normal(0.0, 0.03, (60, 60)).astype(np.float32)
    lane = np.zeros(lowest.shape, dtype=bool)
    lane[16:44, 30 : 30 + wide] = True
    lowest[12:48, 12:48][~lane[12:48, 12:48]] += 3.0
    _, found = estimate_ground(lowest, 1.0, 1.0)
    assert found[lane].mean() >= share


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('share', [0.1, 0.15, 0.25])
@pytest.mark.parametrize('height', [0.8, 1.5])
def test_ground_in_gaps_of_a_crop_stays(height, share, seed):
    rng = np.random.default_rng(seed)
    lowest = rng.normal(0.0, 0.03, (100, 100)).astype(np.float32)
    gaps = rng.random(lowest.shape) < share
    field = np.zeros(lowest.shape, dtype=bool)
    field[20:80, 20:80] = True
    lowest[field & ~gaps] += height
    _, found = estimate_ground(lowest, 1.0, 1.0)
    assert found[field & gaps].mean() > 0.95


def test_hollows_as_wide_as_wide_cells_are_ground():
    row, column = np.mgrid[:60, :60]
    lowest = np.random.default_rng(5).normal(0.0, 0.03, row.shape).astype(np.float32)
    hollow = (row % 17 == 8) & (column % 19 == 9)
    lowest[hollow] -= 1.2
    _, found = estimate_ground(lowest, 4.0, 1.0)
    assert found[hollow].all()


def test_what_is_seen_through_a_crown_stays():
    rng = np.random.default_rng(4)
    lowest = rng.uniform(4.0, 7.0, (60, 60)).astype(np.float32)
    ground = rng.random(lowest.shape) < 0.08
    lowest[ground] = rng.normal(0.0, 0.05, ground.sum())
    lowest[:20] = lowest[-20:] = 0.0
    _, found = estimate_ground(lowest, 1.0, 1.0)
    assert found[20:40][ground[20:40]].mean() > 0.7
