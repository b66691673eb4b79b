# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Regularisation: finds the local direction of the lines, window by window."""

from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import AlignmentSettings
from plc_inspect.core.extraction.linearity import LinearityResult, SAME_WAY
from plc_inspect.core.numerics.arrays import count_bits
from plc_inspect.core.numerics.eigen import principal_axis_of
from plc_inspect.core.numerics.plan_index import build_plan_index, HALF_DIAGONAL
from plc_inspect.core.numerics.voxels import NUM_MOMENTS
from plc_inspect.results import Bool, Float64, Int32, Int64

VOTE_CELL = 2.0
"""
Edge of the plan cells of the index of candidates [m].
Source: numerical: no candidate depends on it, only time and the order of sums.
"""
NUM_BINS = 16
"""
Bins along a candidate's axis in which aligned candidates are counted, at most 32.
Source: judgement; not measured.
"""
MIN_SHARE = 0.1
"""
Least number of candidates of a window, as a share of the fullest window of its tile.
Source: judgement; not measured.
"""
LINE_RADIUS = 0.3
"""
Greatest distance of aligned candidates from the axis of a candidate, near it [m].
Source: judgement; not measured.
"""
LINE_SPREAD = 0.08
"""Growth of LINE_RADIUS along the axis [m/m].  Source: judgement; not measured."""
LEAST_SUPPORT = 3
"""
Occupied bins from which aligned candidates give the axis, not the candidate alone.
Source: judgement; not measured.
"""
ACROSS_ROWS = 1e-3
"""
Sine of the angle to the rows of cells below which an axis counts as parallel to them.
Source: numerical: searches more cells than needed, with the same result.
"""
LEAST_RUN = 1e-9
"""
Least horizontal part of a unit vector in a divisor.
Source: numerical: avoids a division by 0.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AlignmentResult:
    """Windows of the cloud in which lines run straight and in one direction."""

    voted: Bool
    """(M,) candidates with enough votes."""
    votes: Int64
    """(M,) occupied bins along the axis of each candidate, at most NUM_BINS."""
    center: Float64
    """(W, 3) mean of the candidates of each window [m]."""
    azimuth: Float64
    """(W,) direction of the lines in the window, from x, in (-pi/2, pi/2] [rad]."""
    slope: Float64
    """(W,) rise over run along the azimuth."""
    seed_start: Int32
    """(W + 1,) first of each window's candidates in ``seeds``."""
    seeds: Int32
    """Candidates, window by window."""
    half_length: float
    """Half the length of a window along the line [m]."""


def align(candidates: LinearityResult, settings: AlignmentSettings) -> AlignmentResult:
    """
    Turn oriented candidates into windows that each have one azimuth.

    A wire is long: the bins along a candidate's axis, within ``reach``, that hold aligned
    candidates are its votes, and candidates with fewer than ``min_votes`` are dropped.  The
    aligned positions also give the azimuth, far steadier than one neighbourhood does; it is the
    angle of the paper's rotation R_z.  Each plan tile gets one window for each azimuth found in
    it, so that lines may cross, and bend at supports.

    Parameters
    ----------
    candidates : LinearityResult
        M oriented places.
    settings : AlignmentSettings
        Settings of this stage.

    Returns
    -------
    AlignmentResult

    """
    num = len(candidates.position)
    if num == 0:
        return _no_windows(np.zeros(0, dtype=np.int64), settings)
    index = build_plan_index(candidates.position, np.arange(num), VOTE_CELL)
    votes, direction = _vote(
        candidates.position,
        candidates.direction,
        np.ascontiguousarray(candidates.position[index.order].T),
        np.ascontiguousarray(candidates.direction[index.order].T),
        index.start,
        index.origin,
        index.cell_size,
        index.shape[0],
        index.shape[1],
        settings.reach,
    )
    voted = votes >= settings.min_votes
    kept = np.flatnonzero(voted)
    if not len(kept):
        return _no_windows(votes, settings)
    azimuth = np.arctan2(direction[kept, 1], direction[kept, 0])
    run = np.hypot(direction[kept, 0], direction[kept, 1])
    slope = direction[kept, 2] / np.maximum(run, LEAST_RUN)
    azimuth, slope = _half_turn(azimuth, slope)
    position = candidates.position[kept]
    tile = np.floor(position[:, :2] / settings.tile_size).astype(np.int64)
    window = _split_azimuths(tile, azimuth, math.radians(settings.max_turn_deg))
    sure = _is_sure(tile, window)
    kept, azimuth, slope, position = kept[sure], azimuth[sure], slope[sure], position[sure]
    window = _close_numbers(window[sure])
    order = np.argsort(window, kind='stable')
    num_windows = int(window.max()) + 1
    start = np.searchsorted(window[order], np.arange(num_windows + 1)).astype(np.int32)
    center, mean_azimuth, mean_slope = _average(
        start, order, votes[kept], position, azimuth, slope
    )
    return AlignmentResult(
        voted=voted,
        votes=votes,
        center=center,
        azimuth=mean_azimuth,
        slope=mean_slope,
        seed_start=start,
        seeds=kept[order].astype(np.int32),
        half_length=settings.half_length,
    )


@njit(cache=True, nogil=True)
def _average(start, order, votes, position, azimuth, slope):  # type: ignore[no-untyped-def]
    """Return each window's mean position, azimuth (of an axis) and slope, weighted by votes."""
    num = len(start) - 1
    center, mean_azimuth, mean_slope = np.zeros((num, 3)), np.empty(num), np.zeros(num)
    for window in range(num):
        own = order[start[window] : start[window + 1]]
        total = sine = cosine = 0.0
        for k in own:
            total += votes[k]
            for axis in range(3):
                center[window, axis] += votes[k] * position[k, axis]
            sine += votes[k] * math.sin(2.0 * azimuth[k])
            cosine += votes[k] * math.cos(2.0 * azimuth[k])
        mean_azimuth[window] = math.atan2(sine, cosine) / 2.0
        for k in own:
            back = math.cos(azimuth[k] - mean_azimuth[window]) < 0.0
            mean_slope[window] += votes[k] * (-slope[k] if back else slope[k])
        center[window] /= total
        mean_slope[window] /= total
    return center, mean_azimuth, mean_slope


def _no_windows(votes: Int64, settings: AlignmentSettings) -> AlignmentResult:
    return AlignmentResult(
        voted=np.zeros(len(votes), dtype=bool),
        votes=votes,
        center=np.zeros((0, 3)),
        azimuth=np.zeros(0),
        slope=np.zeros(0),
        seed_start=np.zeros(1, dtype=np.int32),
        seeds=np.zeros(0, dtype=np.int32),
        half_length=settings.half_length,
    )


def _half_turn(azimuth: Float64, slope: Float64) -> tuple[Float64, Float64]:
    """Bring azimuths into (-pi/2, pi/2], turning the slope with them."""
    back = (azimuth > math.pi / 2) | (azimuth <= -math.pi / 2)
    turned = np.where(back, azimuth - np.sign(azimuth) * math.pi, azimuth)
    return turned, np.where(back, -slope, slope)


def _split_azimuths(tile: Int64, azimuth: Float64, gap: float) -> Int64:
    """Split the sorted azimuths of each tile at wider gaps; return the group of each item."""
    column, row = (tile - tile.min(axis=0)).T
    number = column * (row.max() + 1) + row
    order = np.argsort(4.0 * number + azimuth)  # they span less than 4
    sorted_tile, sorted_azimuth = number[order], azimuth[order]
    new_tile = np.ones(len(order), dtype=bool)
    new_tile[1:] = sorted_tile[1:] != sorted_tile[:-1]
    new_group = new_tile.copy()
    new_group[1:] |= np.diff(sorted_azimuth) > gap
    group = np.cumsum(new_group) - 1
    # azimuths are cyclic: join the last group of a tile with its first across +-pi/2
    starts = np.flatnonzero(new_tile)
    ends = np.append(starts[1:], len(order)) - 1
    wraps = sorted_azimuth[starts] + math.pi - sorted_azimuth[ends] <= gap
    alias = np.arange(int(group[-1]) + 1)
    alias[group[ends[wraps]]] = group[starts[wraps]]
    group = alias[group]
    result = np.empty(len(order), dtype=np.int64)
    result[order] = _close_numbers(group)
    return result


def _close_numbers(number: Int64) -> Int64:
    """Renumber small numbers from 0 in their order, so that none is missing."""
    present = np.zeros(int(number.max(initial=-1)) + 1, dtype=np.int64)
    present[number] = 1
    result: Int64 = (np.cumsum(present) - 1)[number]
    return result


def _is_sure(tile: Int64, window: Int64) -> Bool:
    """Tell the items of windows that hold MIN_SHARE of their tile's fullest one or more."""
    count = np.bincount(window)
    any_of = np.empty(len(count), dtype=np.int64)
    any_of[window] = np.arange(len(window))
    home = np.unique(tile[any_of], axis=0, return_inverse=True)[1].ravel()
    fullest = np.zeros(len(count), dtype=np.int64)
    np.maximum.at(fullest, home, count)
    result: Bool = (count >= MIN_SHARE * fullest[home])[window]
    return result


@njit(cache=True, parallel=True, nogil=True)
def _vote(  # type: ignore[no-untyped-def]
    position, direction, places, ways, start, origin, cell, rows, columns, reach
):
    """
    Count the occupied bins along each candidate's axis, and fit the axis to what is aligned.

    ``places`` and ``ways`` are (3, M) positions and directions, sorted by plan cell.
    """
    num = len(position)
    votes = np.zeros(num, dtype=np.int64)
    axis = direction.copy()
    x, y, z = places[0], places[1], places[2]
    wx, wy, wz = ways[0], ways[1], ways[2]
    for i in prange(num):
        occupied = np.uint32(0)
        total = np.zeros(NUM_MOMENTS)
        ux, uy = direction[i, 0], direction[i, 1]
        # find the rows of cells that the strip along the axis touches
        slack = LINE_RADIUS + LINE_SPREAD * reach + HALF_DIAGONAL * cell
        plan = math.sqrt(ux * ux + uy * uy) * reach
        ex, ey = 1.0, 0.0
        if plan > 0.0:
            ex, ey = ux * reach / plan, uy * reach / plan
        px, py = position[i, 0] - origin[0], position[i, 1] - origin[1]
        first_row = max(int((py - abs(ey) * plan - slack) / cell), 0)
        last_row = min(int((py + abs(ey) * plan + slack) / cell), rows - 1)
        for row in range(first_row, last_row + 1):
            off_row = (row + 0.5) * cell - py
            t0, t1 = -plan, plan
            # clip the axis to the part near this row
            if abs(ey) > ACROSS_ROWS:
                ta, tb = (off_row - slack) / ey, (off_row + slack) / ey
                t0, t1 = max(t0, min(ta, tb)), min(t1, max(ta, tb))
                if t0 > t1:
                    t0 = min(max(off_row / ey, -plan), plan)
                    t1 = t0
            # visit the candidates of the cells about it: they are contiguous within a row
            left = int((px + min(t0 * ex, t1 * ex) - slack) / cell)
            right = int((px + max(t0 * ex, t1 * ex) + slack) / cell)
            first = start[row * columns + min(max(left, 0), columns)]
            last = start[row * columns + min(max(right, -1), columns - 1) + 1]
            occupied |= _add_in_line(
                x[first:last], y[first:last], z[first:last],
                wx[first:last], wy[first:last], wz[first:last],
                position[i], direction[i], reach, total,
            )
        # fit the axis where enough bins are occupied
        votes[i] = count_bits(occupied)
        if votes[i] >= LEAST_SUPPORT:
            _, _, _, vx, vy, vz = principal_axis_of(total, 0, 1)
            axis[i, 0], axis[i, 1], axis[i, 2] = vx, vy, vz
    return votes, axis


@njit(cache=True, nogil=True, fastmath={'reassoc', 'nsz'})
def _add_in_line(x, y, z, wx, wy, wz, position, way, reach, total):  # type: ignore[no-untyped-def]
    """
    Add the moments of aligned candidates to ``total``; return their bins as bits.

    Has no branches, and sums in any order, so that the compiler makes vector instructions.
    """
    px, py, pz, ux, uy, uz = position[0], position[1], position[2], way[0], way[1], way[2]
    per_bin, last_bin, occupied = NUM_BINS / (2.0 * reach), np.int32(NUM_BINS - 1), np.uint32(0)
    n = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for k in range(len(x)):
        dx, dy, dz = x[k] - px, y[k] - py, z[k] - pz
        along = dx * ux + dy * uy + dz * uz
        off = LINE_RADIUS + LINE_SPREAD * abs(along)
        cosine = ux * wx[k] + uy * wy[k] + uz * wz[k]
        counts = (abs(along) < reach) & (abs(cosine) >= SAME_WAY)
        counts &= dx * dx + dy * dy + dz * dz - along * along <= off * off
        along = along if counts else 0.0
        place = np.int32((along + reach) * per_bin)
        place = place if place < last_bin else last_bin
        occupied |= np.uint32(counts) << np.uint32(place)
        dx, dy, dz = dx if counts else 0.0, dy if counts else 0.0, dz if counts else 0.0
        n += 1.0 if counts else 0.0
        sx, sy, sz = sx + dx, sy + dy, sz + dz
        xx, xy, xz = xx + dx * dx, xy + dx * dy, xz + dx * dz
        yy, yz, zz = yy + dy * dy, yz + dy * dz, zz + dz * dz
    for m, value in enumerate((n, sx, sy, sz, xx, xy, xz, yy, yz, zz)):
        total[m] += value
    return occupied
