# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Looks at the surroundings: points of a scan, summed up by the cells that they lie in."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.core.numerics.cell_sums import pack_cells, sum_rows
from plc_inspect.core.setup.looks import CELL
from plc_inspect.results import Float64, Int64

REACHES = 30.0, 60.0
"""
Points farther from the lidar are not looked at, the second where little is nearer than the first
[m].
Source: as LONG and FAR of sharpness.
"""
SAMPLES = 1000
"""Points of a scan that are looked at.  Source: numerical: five a cell and scan within 30 m."""
LEAST_POINTS = 5
"""Of a look in a cell.  Source: as sharpness."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Points of a scan, all by the poses of the odometry."""

    points: Float64
    """(N, 3) [m]."""
    velocity: Float64
    """(N, 3) how they move as their times grow [m/s]."""
    lidar: Float64
    """(N, 3) where the lidar was [m]."""
    axes: Float64
    """(N, 3, 3) x, y and z of the vehicle then."""
    stamps: Int64
    """(N,) [ns]."""


@dataclass(frozen=True, slots=True, eq=False)
class LookCells:
    """A look by the cells in which it has enough points."""

    index: Int64
    """(K, 3) number of each cell along x, y and z."""
    count: Int64
    """(K,) points in it."""
    mean: Float64
    """
    (K, 23) their mean offset from its middle [m], velocity, lidar less the first, lever, axes,
    seconds since the first point, range.
    """
    scatter: Float64
    """(K, 9) sums of the squares and products of their offsets from the mean [m2]."""
    first_ns: int
    """Stamp of the first point [ns]."""
    lidar: tuple[Float64, Float64]
    """Where the lidar was at the first row and at the last [m]."""
    stamps: tuple[int, int]
    """Of the first row and of the last [ns]."""


def choose_points(apart: Float64) -> Int64:
    """Return the rows of SAMPLES points at most that are near enough (N,) [m], evenly."""
    for reach in REACHES:
        chosen = np.flatnonzero(apart < reach)
        if len(chosen) >= SAMPLES:
            break
    step = 1 + (len(chosen) - 1) // SAMPLES
    return chosen[:: step | 1]  # an odd step takes all beams of an interleaved scan


def gather_cells(look: Look) -> LookCells:
    """
    Sum a look up by the cells that it has points in.

    Done with each scan, so that no pose waits for a whole window of them.

    Parameters
    ----------
    look : Look
        At least one point.

    Returns
    -------
    LookCells
        Costs O(N log N), 1 ms for 1,000 points.

    """
    lever, first = look.points - look.lidar, int(look.stamps.min())
    index = np.floor(look.points / CELL).astype(np.int64)
    offsets = look.points - (index + 0.5) * CELL
    _, place, group, count = np.unique(
        pack_cells(index), return_index=True, return_inverse=True, return_counts=True
    )
    group = group.reshape(-1)
    seconds = (look.stamps - first) * 1e-9
    values: tuple[np.ndarray, ...] = (
        offsets, look.velocity, look.lidar - look.lidar[0], lever, look.axes.reshape(-1, 9),
        seconds[:, None], np.sqrt((lever**2).sum(axis=1))[:, None],
    )
    mean: Float64 = np.hstack([sum_rows(group, item, len(count)) for item in values])
    mean /= count[:, None]
    apart = offsets - mean[group, :3]
    scatter = sum_rows(group, (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9), len(count))
    good = count >= LEAST_POINTS
    return LookCells(
        index[place][good], count[good], mean[good], scatter[good], first,
        (look.lidar[0], look.lidar[-1]), (int(look.stamps[0]), int(look.stamps[-1])),
    )
