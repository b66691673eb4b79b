# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Planes through the points of the ground about single places: more exact than its surface."""

import math

from numba import njit, prange
import numpy as np

from plc_inspect.core.numerics.arrays import take_rows
from plc_inspect.core.numerics.plan_index import build_plan_index, MAX_CELLS
from plc_inspect.results import Bool, Float32, Float64

ABOVE_LOWEST = 0.5
"""
Height above the lowest points about it up to which a point may be of the ground [m].
Source: derived: as labels.GROUND_BAND.
"""
BELOW_SURFACE = 1.0
"""
Depth below the surface of the lowest from which a return is from below the ground [m].
Source: derived: twice low_returns.PIT_DEPTH; the lower side of a crown scatters by 0.5 m.
"""
REACHES = (1.5, 3.0)
"""
Distance in plan within which points lie on the plane of the ground, the first that has enough [m].
Source: judgement; more than a cell of the ground surface, and less than its bends.
"""
LEAST_POINTS = 8
"""Points that a plane of the ground rests on at least.  Source: judgement; not measured."""
LEAST_FIXED = 4
"""Points that fix a plane and its scatter.  Source: derived: three have none."""
NUM_SECTORS = 6
"""
Sectors about the inner disc of the points of a plane, each of its area, whose lowest points begin.
Source: judgement: seven of a square metre; where dense shrub hides all but three returns a square
metre of the ground, one in twenty holds none of it.
"""
NOISE = 0.03
"""
Standard deviation of points about the ground, at least [m].
Source: Velodyne Puck Lite data sheet: 3 cm.
"""
ROUNDS = 16
"""Fits of a plane at most.  Source: numerical: few change after the eighth."""
ABOVE_PLANE = 2.5
"""
Standard deviations above the plane from which a point is of what grows on the ground.
Source: derived: 0.6 % of normal errors lie above.
"""
LEAST_SPREAD = 0.3
"""
Standard deviation in plan, along its narrower axis, of the points that fix a plane at least [m].
Source: judgement; one scan line shows no slope across it.
"""
BENT = 0.1
"""
Standard deviation of the points of the ground about their plane beyond which it may be bent at the
foot, and about the bent one at most [m].
Source: measured: 0.1 at most in bench/studies/planted_hazards.py; about the planes of heaps and
dykes of 37 degrees 0.26 and 0.3, about the bent ones their noise.
"""
LEAST_BENT, SURELY_BENT = 20, 0.5
"""
Points that tell of a bend, at least, and share of their scatter that it leaves at most.
Source: judgement: of points in the lower side of a crown one of thirteen shapes leaves two thirds.
"""
NUM_TURNS = 12
"""Directions in which a crest may run.  Source: numerical: each is met to 7.5 degrees."""
MOST_SPREAD = 0.3
"""
Standard deviation of the points of the ground about their plane at most [m].
Source: measured: 0.1 at most in bench/studies/planted_hazards.py, 0.24 at 99 % of the places below
conductors of real clouds (bench/hazards.py); 0.37 on the lower side of a crown (bags/demo).
"""


def find_planes(
    points: Float64, height: Float32, places: Float64
) -> tuple[Float64, Float64]:
    """
    Fit planes to the ground about some places.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float32
        Above the ground surface [m].
    places : (P, 3) float64
        Places about at the ground [m].

    Returns
    -------
    ground : (P,) float64
        Height of the ground [m], NaN where it was not seen; a crest is above its plane.
    sigma : (P,) float64
        Its standard deviation by the scatter of the points about the plane [m].

    """
    low = _choose_low(points, height, _mark_cells(places))
    index = build_plan_index(points, np.flatnonzero(low), REACHES[0])
    start, order, origin, edge, rows, columns = index.grid
    own = take_rows(points, order)  # neighbours in space are neighbours in memory
    ground, sigma = _fit_planes(
        own, places, start, origin, edge, rows, columns, np.array(REACHES)
    )
    return ground, sigma


def _mark_cells(places: Float64) -> tuple[Bool, float, float, float]:
    """Return the plan cells within reach of places, their lower corner and their edge [m]."""
    area = float(np.prod(np.ptp(places[:, :2], axis=0)))
    edge = max(REACHES[-1], math.sqrt(area / MAX_CELLS))  # exact as well
    x, y = (np.floor(places[:, :2].min(axis=0) / edge) * edge - edge).tolist()
    column, row = ((places[:, :2] - (x, y)) / edge).astype(np.int64).T
    marked = np.zeros((int(row.max()) + 2, int(column.max()) + 2), dtype=bool)
    for up in (-1, 0, 1):
        for right in (-1, 0, 1):
            marked[row + up, column + right] = True
    return marked, x, y, edge


def _choose_low(
    points: Float64, height: Float32, cells: tuple[Bool, float, float, float]
) -> Bool:
    """Tell the points in marked cells that may be of the ground."""
    result: Bool = _are_low(points.ravel(), height, *cells)
    return result


@njit(cache=True, parallel=True, nogil=True)
def _are_low(flat, height, marked, x0, y0, edge):  # type: ignore[no-untyped-def]
    result = np.zeros(len(height), dtype=np.bool_)
    rows, columns = marked.shape
    for i in prange(len(height)):
        is_low = -BELOW_SURFACE <= height[i] <= ABOVE_LOWEST
        if is_low and math.isfinite(flat[3 * i + 2]):
            column, row = (flat[3 * i] - x0) / edge, (flat[3 * i + 1] - y0) / edge
            if 0.0 <= column < columns and 0.0 <= row < rows:
                result[i] = marked[int(row), int(column)]
    return result


@njit(cache=True, parallel=True, nogil=True)
def _fit_planes(  # type: ignore[no-untyped-def]
    points, places, start, origin, edge, rows, columns, reaches
):
    """Return the (P,) heights of the ground at places, NaN where unknown, and their sigma [m]."""
    ground, sigma = np.full(len(places), np.nan), np.full(len(places), np.nan)
    for k in prange(len(places)):
        for reach in reaches:
            # the points about the foot, in its own frame
            first_row = max(math.floor((places[k, 1] - reach - origin[1]) / edge), 0)
            last_row = min(math.floor((places[k, 1] + reach - origin[1]) / edge), rows - 1)
            first = max(math.floor((places[k, 0] - reach - origin[0]) / edge), 0)
            last = min(math.floor((places[k, 0] + reach - origin[0]) / edge), columns - 1)
            most = 0
            for row in range(first_row, last_row + 1):
                if first <= last:
                    most += start[row * columns + last + 1] - start[row * columns + first]
            own, num = np.empty((most, 3)), 0
            for row in range(first_row, last_row + 1):
                if first > last:
                    break
                for i in range(start[row * columns + first], start[row * columns + last + 1]):
                    dx, dy = points[i, 0] - places[k, 0], points[i, 1] - places[k, 1]
                    if dx * dx + dy * dy <= reach * reach:
                        own[num, 0], own[num, 1] = dx, dy
                        own[num, 2] = points[i, 2] - places[k, 2]
                        num += 1
            rise, error = _fit_plane(own[:num], reach)
            if math.isfinite(rise):
                ground[k], sigma[k] = places[k, 2] + rise, error
                break
    return ground, sigma


@njit(cache=True, nogil=True)
def _fit_plane(own, reach):  # type: ignore[no-untyped-def]
    """
    Return the height at the origin of the ground below points, and its sigma; NaN if none.

    Crests are fitted to all points; hollows are not, as their bottom may be flat.  Elsewhere the
    lowest points of places all about show the ground below what grows on it.  From the plane
    through them, points are taken in from below as long as the plane rises to them.
    """
    kept = np.ones(len(own), dtype=np.bool_)
    num, a, b, c, spread, error = _fit_kept(own, kept)
    if num < LEAST_POINTS or not math.isfinite(a):
        return np.nan, np.nan
    if spread > BENT and num >= LEAST_BENT:
        crest, crest_error = _fit_crest(own, a, b, c, spread, error)
        if math.isfinite(crest):
            return crest, crest_error
    _keep_lowest(own, b, c, reach, kept)
    _, low_a, low_b, low_c, low_spread, _ = _fit_kept(own, kept)
    if math.isfinite(low_a):  # else they are too few, or in a row
        a, b, c, spread = low_a, low_b, low_c, low_spread
    before = -1
    for _ in range(ROUNDS):
        most = ABOVE_PLANE * max(spread, NOISE)
        for i in range(len(own)):
            kept[i] = own[i, 2] - (a + b * own[i, 0] + c * own[i, 1]) <= most
        num, a, b, c, spread, error = _fit_kept(own, kept)
        if num < LEAST_POINTS or not math.isfinite(a):
            return np.nan, np.nan
        if num == before:
            break  # as many as in the round before
        before = num
    return (a, error) if spread <= MOST_SPREAD else (np.nan, np.nan)


@njit(cache=True, nogil=True)
def _fit_crest(own, a, b, c, spread, error):  # type: ignore[no-untyped-def]
    """
    Return the height of a crest at the foot and its sigma, NaN where none explains the points.

    Given are the height of the plane through all points, its slopes, the scatter about it and the
    sigma of the height.  From the foot, or from a line through it, a crest falls on all sides as
    a roof does, beside the slopes of the plane.
    """
    best, best_rest, sigma = np.nan, min(BENT, SURELY_BENT * spread), np.nan
    num, kept = len(own), np.ones(len(own), dtype=np.bool_)
    away = own.copy()
    for turn in range(NUM_TURNS + 1):
        angle = math.pi * turn / NUM_TURNS
        for i in range(num):
            x, y = own[i, 0], own[i, 1]
            aside = y * math.cos(angle) - x * math.sin(angle)
            away[i, 2] = abs(aside) if turn < NUM_TURNS else math.hypot(x, y)
        _, mean, right, up, _, _ = _fit_kept(away, kept)
        square = product = 0.0
        for i in range(num):
            bend = away[i, 2] - (mean + right * own[i, 0] + up * own[i, 1])
            square += bend * bend
            product += bend * (own[i, 2] - (a + b * own[i, 0] + c * own[i, 1]))
        if square <= 0.0:
            continue
        rise = product / square
        rest = math.sqrt(max(spread * spread * (num - 3) - rise * product, 0.0) / (num - 4))
        if rise < 0.0 and rest < best_rest:
            best, best_rest = a - rise * mean, rest
            sigma = rest * math.hypot(error / spread, mean / math.sqrt(square))
    return best, sigma


@njit(cache=True, nogil=True)
def _keep_lowest(own, b, c, reach, kept):  # type: ignore[no-untyped-def]
    """Set which points are the lowest, against a slope, of a disc and the sectors about it."""
    lowest = np.full(1 + NUM_SECTORS, -1)
    height = np.full(1 + NUM_SECTORS, np.inf)
    inner = reach * reach / len(lowest)  # the square of the radius at which all have one area
    for i in range(len(own)):
        x, y = own[i, 0], own[i, 1]
        place = 0
        if x * x + y * y > inner:
            turns = (math.atan2(y, x) + math.pi) / (2.0 * math.pi)
            place = 1 + min(int(turns * NUM_SECTORS), NUM_SECTORS - 1)
        z = own[i, 2] - b * x - c * y
        if z < height[place]:
            lowest[place], height[place] = i, z
    kept[:] = False
    for i in lowest:
        if i >= 0:
            kept[i] = True


@njit(cache=True, nogil=True)
def _fit_kept(own, kept):  # type: ignore[no-untyped-def]
    """
    Fit a plane to the points that are kept.

    Returns their number, the height of the plane at the origin and its slopes in x and y, the
    standard deviation of the points about it and that of the height; NaN where they fix none.
    """
    # places are from the foot, so moments about it lose nothing against those about the mean
    num, mx, my, mz = 0, 0.0, 0.0, 0.0
    xx, xy, yy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(own)):
        if kept[i]:
            x, y, z = own[i, 0], own[i, 1], own[i, 2]
            num += 1
            mx, my, mz = mx + x, my + y, mz + z
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
            xz, yz, zz = xz + x * z, yz + y * z, zz + z * z
    if num < LEAST_FIXED:
        return num, np.nan, np.nan, np.nan, np.nan, np.nan
    mx, my, mz = mx / num, my / num, mz / num
    xx, xy, yy = xx - num * mx * mx, xy - num * mx * my, yy - num * my * my
    xz, yz, zz = xz - num * mx * mz, yz - num * my * mz, zz - num * mz * mz
    narrow = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
    if narrow <= LEAST_SPREAD * LEAST_SPREAD * num:
        return num, np.nan, np.nan, np.nan, np.nan, np.nan
    det = xx * yy - xy * xy
    b, c = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
    a = mz - b * mx - c * my
    spread = math.sqrt(max(zz - b * xz - c * yz, 0.0) / (num - 3))
    leverage = 1.0 / num + (mx * mx * yy - 2.0 * mx * my * xy + my * my * xx) / det
    return num, a, b, c, spread, spread * math.sqrt(leverage)
