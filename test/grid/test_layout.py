# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tiles are as large as memory, and the cells of the ground, allow."""

import math

import numpy as np
import pytest

from plc_inspect.errors import DataError
from plc_inspect.grid.cells.layout import (
    CellGrid,
    lay_cells,
    lay_tiles,
    LEAST_EDGE,
    MOST_POINTS,
    MOST_REACH,
)

EDGE, HALO = 200.0, 500.0


def lay(counts, halo=HALO, **limits):
    """Divide cells, given as rows, with all the memory that may be."""
    rows, columns = counts.shape
    grid = CellGrid(origin=(0.0, 0.0), edge=EDGE, columns=columns, rows=rows)
    tiles = lay_tiles(grid, counts.ravel(), halo, limits.pop('allowed', 10**9), **limits)
    assert sum(tile.num_points for tile in tiles) == counts.sum()
    return grid, tiles


def find_reach(grid, counts, tile):
    """Return length and width of what is read for a tile, together [m]."""
    cells = np.array(tile.cells(grid, HALO))
    used = cells[counts.ravel()[cells] > 0]
    row, column = used // grid.columns, used % grid.columns
    return (np.ptp(row) + np.ptp(column) + 2) * EDGE


def test_a_corridor_is_cut_into_long_tiles():
    """What is read of a line is narrow: a tile of it may be longer than one of a plain."""
    corridor = np.zeros((160, 160), dtype=np.int64)
    corridor[80:82] = 1000
    grid, tiles = lay(corridor)
    longest = max((tile.last[0] - tile.first[0] + 1) * EDGE for tile in tiles)
    assert longest == 6400.0
    assert sum(tile.num_near for tile in tiles) < 1.2 * corridor.sum()
    plain = np.full((160, 160), 1000, dtype=np.int64)
    _, others = lay(plain)
    assert max((tile.last[0] - tile.first[0] + 1) * EDGE for tile in others) == 3200.0
    for counts, own in ((corridor, tiles), (plain, others)):
        assert max(find_reach(grid, counts, tile) for tile in own) <= MOST_REACH


@pytest.mark.parametrize('allowed', [20_000, 200_000])
def test_memory_bounds_what_is_read(allowed):
    corridor = np.zeros((80, 80), dtype=np.int64)
    corridor[40:42] = 1000
    _, tiles = lay(corridor, allowed=allowed)
    assert max(tile.num_near for tile in tiles) <= allowed


def test_a_halo_is_wide_from_the_first_where_few_points_are_more():
    corridor = np.zeros((80, 80), dtype=np.int64)
    corridor[40:42] = 1000
    grid, tiles = lay(corridor, halo=None)
    assert {tile.halo for tile in tiles} == {750.0}
    for tile in tiles:
        assert tile.num_near == corridor.ravel()[tile.cells(grid, 750.0)].sum()
    assert {tile.halo for tile in lay(corridor)[1]} == {HALO}
    _, plain = lay(np.full((80, 80), 1000), halo=None, most_edge=1600.0)
    inner = [tile for tile in plain if min(tile.first) > 3 and max(tile.last) < 76]
    assert {tile.halo for tile in inner} == {500.0}
    allowed = max(tile.num_near for tile in lay(corridor)[1])
    bounded = lay(corridor, halo=None, allowed=allowed)[1]
    assert {tile.halo for tile in bounded} == {500.0, 750.0}  # that at the end is nearer to it
    assert max(tile.num_near for tile in bounded) <= allowed


def test_cells_that_are_too_dense_are_refused_with_figures():
    dense = np.full((3, 3), 50_000, dtype=np.int64)
    with pytest.raises(DataError, match=(
        r'450000 points lie within 500 m of a tile of 200 m, 0\.8 GB of memory;'
        r' 100000 points are allowed: give more --memory, fewer --workers or a narrower --halo'
    )):
        lay(dense, allowed=100_000)
    with pytest.raises(DataError, match=(
        f' {MOST_POINTS} points are allowed: give a narrower --halo$'
    )):
        lay(dense * 100, allowed=MOST_POINTS)  # more memory would allow no more


@pytest.mark.parametrize(('most', 'edge'), [(math.inf, 1000.0), (90.0, 90.0), (3.0, LEAST_EDGE)])
def test_cells_are_no_larger_than_tiles_may_be(most, edge):
    grid = lay_cells([(0.0, 0.0, 9e3, 9e3)], 1_000_000, 10_000_000, most_edge=most)
    assert grid.edge == edge
