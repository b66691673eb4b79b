# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Finds returns of the air: dust, rain and insects, which lie anywhere about the lidar.

An object is hit again, by the next beam or the next scan: its returns lie together.  Returns of
the air lie alone, evenly spread.  Where many returns lie alone, only those are kept that have far
more neighbours than air of that density gives by chance; where none do, all are kept.  Far from
the lidar all are kept, too: objects are seen sparsely there, and the air is not seen at all.
"""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.numerics.plan_index import build_plan_index
from plc_inspect.results import Bool, Float64, Int64, StageReport

RANGE = 12.0
"""
Greatest distance from the lidar at which the air is seen [m].
Source: judgement: returns of drops and grains fade faster with range than others, by its square.
"""
REACH = 0.2
"""
Distance within which returns lie together [m].
Source: derived: two voxels of the map; a lidar of 300,000 points a second sees a face of this size
at 60 m with three of them within a second.
"""
BALL = 4.0 / 3.0 * math.pi * REACH**3
"""Volume of which a return has neighbours [m3].  Source: derived: of a ball of REACH."""
FEW = 2
"""Others within REACH below which a return lies alone.  Source: derived: hazards.min_points."""
CELL, WIDE = 2.0, 2
"""
Edge of the cells in which lone returns are counted [m], and cells counted on each side of one.
Source: judgement: dust is seen up to 10 m away, and thins out over that.
"""
LEAST_AIR = 20
"""Least cells of air for a density.  Source: judgement: a sixth of those about a place."""
CLEAR = 0.01
"""
Greatest density of lone returns in clear air [1/m3].
Source: derived: at it, three are linked by chance (hazards.group_distance) at one place in a
million cubic metres; measured: bench/faults.py dust: clear air about a crown shows none.
"""
DUSTY = 0.1
"""
Density of lone returns from which they are left out of lines [1/m3].
Source: derived: ten wires of 2.5 returns a metre, the worst, leave less alone in ten metres of
air; measured: bench/studies/input_faults.py dust, seed 6000: in clear air none is left out; where
a tenth of the returns is dust, 90 % of it, and 20 % of those of the wires.
"""
LEFT = 0.6
"""
Greatest density of dust that stays where lines are looked for [1/m3].
Source: derived: of 27 cells of a metre it fills eleven, so that a line, which fills three, is not
in something bulky (linearity.max_occupied).
"""
CHANCE = 1e-5
"""
Least probability at which neighbours of a return of the air are put down to chance.
Source: derived: one in ten flights of 10,000 returns near conductors, and three must.
"""
THICK = 0.05
"""
Share of lone returns in the points of a map from which its air is told to be dusty.
Source: measured: bench/studies/input_faults.py dust: where it is less no span is lost.
"""
MOST = 30
"""Limit of the count of neighbours.  Source: numerical: CHANCE at 190 returns in a cubic metre."""
LONE = 'alone in dusty air'
"""Why returns are not in the first stage."""


def find_lone(points: Float64, way: Float64) -> Bool:
    """
    Tell the returns in dusty air that have no neighbour within REACH, or few in dense dust.

    Nearly all returns of the air have none, and few of a wire: lines are found without them.

    Parameters
    ----------
    points : (N, 3) float64
        The cloud; rows that are not finite give False [m].
    way : (W, 3) float64
        Where the lidar was, 10 m apart or nearer [m].

    Returns
    -------
    (N,) bool
        Costs O(N).

    """
    result = np.zeros(len(points), dtype=bool)
    if not len(way):
        return result
    near = np.flatnonzero(_count_near(points, way, RANGE, 1))
    dusty, together, density = _look_at_air(points[near], 1, DUSTY)
    result[near[dusty]] = together < _find_fewest(density, LEFT / density)
    return result


def find_dust(points: Float64, way: Float64, lone: Float64 | None = None) -> Bool:
    """
    Tell the returns that lie no closer together than the air's do by chance.

    Parameters
    ----------
    points : (K, 3) float64
        Points near the conductors that are neither ground, wire nor support [m].
    way : (W, 3) float64
        Where the lidar was, 10 m apart or nearer [m].
    lone : (L, 3) float64 or None
        Returns of the air that were left out before; they count for its density [m].

    Returns
    -------
    (K,) bool
        Costs O(K + L).

    """
    if lone is not None and len(lone):
        return find_dust(np.concatenate((points, lone)), way)[: len(points)]
    result = np.zeros(len(points), dtype=bool)
    if not len(way):
        return result
    near = np.flatnonzero(_count_near(points, way, RANGE, 1))
    dusty, together, density = _look_at_air(points[near], FEW, CLEAR)
    fewest = np.maximum(_find_fewest(density, CHANCE), FEW)
    result[near[dusty]] = together < fewest
    return result


def describe_air(stages: Sequence[StageReport]) -> str:
    """Say that the air was so dusty that lines in it may be lost, '' where it was not."""
    height = next((stage for stage in stages if LONE in stage.dropped), None)
    if height is None or height.dropped[LONE] < THICK * height.num_in:
        return ''
    return (
        f'dusty air: {height.dropped[LONE]} of {height.num_in} points '
        f'({height.dropped[LONE] / height.num_in:.0%}) lie alone about the path and are left out; '
        f'conductors within {RANGE:.0f} m of it may be lost'
    )


def _look_at_air(
    points: Float64, few: int, clear: float
) -> tuple[Int64, Int64, Float64]:
    """
    Choose the points in air where more than ``clear`` have fewer neighbours than ``few`` [1/m3].

    Returned are (D,) their numbers, their neighbours, and the density of all about each [1/m3].
    """
    together = _count_near(points, points, REACH, FEW + 1) - 1
    least = LEAST_AIR * CELL**3 * clear  # fewer make no air dusty
    if len(points) <= FEW or np.count_nonzero(together < few) <= least:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
    lone, density = _measure_air(points, together, few)
    dusty = np.flatnonzero(lone > clear)
    return dusty, _count_near(points[dusty], points, REACH, MOST + 1) - 1, density[dusty]


def _count_near(points: Float64, others: Float64, reach: float, most: int) -> Int64:
    """Return the (K,) number of others within reach of each point, up to ``most``."""
    index = build_plan_index(others, np.arange(len(others)), reach)
    result: Int64 = _count(points, others[index.order], index.grid, reach * reach, most)
    return result


@njit(cache=True, nogil=True)
def _count(points, others, grid, square, most):  # type: ignore[no-untyped-def]
    """Count the others, sorted by plan cell, within reach of each point."""
    start, _, origin, cell, rows, columns = grid
    found = np.zeros(len(points), dtype=np.int64)
    for i in range(len(points)):
        along, across = (points[i, 0] - origin[0]) / cell, (points[i, 1] - origin[1]) / cell
        if not (-1.0 <= along < columns + 1 and -1.0 <= across < rows + 1):  # nor is NaN
            continue
        column, row = math.floor(along), math.floor(across)
        left, right = max(column - 1, 0), min(column + 1, columns - 1)
        count = 0
        for line in range(max(row - 1, 0), min(row + 1, rows - 1) + 1):
            if count >= most:
                break
            # the cells of a row are contiguous, and so are their points
            for k in range(start[line * columns + left], start[line * columns + right + 1]):
                a = others[k, 0] - points[i, 0]
                b = others[k, 1] - points[i, 1]
                c = others[k, 2] - points[i, 2]
                if a * a + b * b + c * c <= square:
                    count += 1
                    if count >= most:
                        break
        found[i] = count
    return found


def _measure_air(points: Float64, together: Int64, few: int) -> tuple[Float64, Float64]:
    """
    Return the (N,) densities of the air about each point: of ``few``, and of all returns [1/m3].

    A cell where most returns lie together holds an object, whose edges give lone returns too: it
    and its neighbours do not count as air.  ``few`` are those with fewer others within REACH.
    """
    cell = np.floor(points / CELL).astype(np.int64)
    cell -= cell.min(axis=0) - WIDE
    _, rows, layers = (int(size) for size in cell.max(axis=0) + 1 + WIDE)
    keys, which = np.unique(
        (cell[:, 0] * rows + cell[:, 1]) * layers + cell[:, 2], return_inverse=True
    )
    which = which.reshape(-1)
    # count the lone returns of each cell, none in and beside solid ones
    total = np.bincount(which, minlength=len(keys))
    solid = keys[total > 2 * np.bincount(which[together < FEW], minlength=len(keys))]
    count = np.bincount(which[together < few], minlength=len(keys))
    solid = np.unique(solid[:, None] + _list_steps(1, rows, layers))
    is_air = ~np.isin(keys, solid)
    sums, air = np.zeros((2, len(keys))), np.full(len(keys), (2.0 * WIDE + 1.0) ** 3)
    for step in _list_steps(WIDE, rows, layers).tolist():
        slot = np.minimum(np.searchsorted(keys, keys + step), len(keys) - 1)
        there = (keys[slot] == keys + step) & is_air[slot]
        sums += np.where(there, (count[slot], total[slot]), 0)
        if len(solid):
            slot = np.minimum(np.searchsorted(solid, keys + step), len(solid) - 1)
            air -= solid[slot] == keys + step
    density = np.where(air >= LEAST_AIR, sums / (np.maximum(air, 1.0) * CELL**3), 0.0)
    return density[0][which], density[1][which]


def _list_steps(reach: int, rows: int, layers: int) -> Int64:
    """Return the steps from the number of a cell to those up to ``reach`` cells away."""
    along = np.arange(-reach, reach + 1)
    x, y, z = (item.ravel() for item in np.meshgrid(along, along, along, indexing='ij'))
    result: Int64 = (x * rows + y) * layers + z
    return result


def _find_fewest(density: Float64, chance: Float64 | float) -> Int64:
    """Return the least number of neighbours that air gives with no more than a chance."""
    fewest = np.ones(len(density), dtype=np.int64)
    # neighbours in the air follow a Poisson distribution
    mean = BALL * density
    term = np.exp(-mean)
    below = term.copy()  # probability of fewer than the count
    for count in range(1, MOST):
        wanted = 1.0 - below > chance
        if not wanted.any():
            break
        fewest[wanted] = count + 1
        term = term * mean / count
        below += term
    return fewest
