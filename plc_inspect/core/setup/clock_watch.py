# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How much earlier or later scans fit best: the clock of the lidar against that of the odometry.

With wrong times every point is put to where the vehicle was, and as it was turned, at another
time.  In flight straight on that moves all alike; but vehicles sway, and planes that are seen
within a second lie apart then, by as much as they move with time.  The least squares of that tell
the offset; what is wrong with mount, scale or heading does not lie apart so.
"""

from dataclasses import dataclass

import numpy as np

from plc_inspect.core.setup.sharpness import CELL, PLANE, ROUGH, ROUGH_SHARE
from plc_inspect.results import Float64, Int64

WINDOW_NS = 1_000_000_000
"""Time within which looks are compared [ns].  Source: as the short scale of sharpness."""
REACH = 30.0
"""Points farther from the lidar are not looked at [m].  Source: as WINDOW_NS."""
LEAST_POINTS, LEAST_LOOKS = 5, 3
"""Of a look in a cell, and of looks in a cell.  Source: as sharpness."""
MOST_APART = 0.6
"""
Looks that lie farther apart in a cell are of two things [m].
Source: judgement: a sixth of a cell.
"""
FADING = 0.8
"""Weight of what was known when a window is added.  Source: judgement: five seconds."""
LEAST_OFFSET = 0.015
"""
Offset from which scans are shifted [s].
Source: measured: the demo flight: right clocks show 0.009 at most.
"""
SURELY = 5.0
"""
So many standard deviations are sure.
Source: measured: the demo flight: right clocks show 2.5 at most, 0.05 s shows 10.
"""
TWICE = 2
"""Windows in a row that must say so.  Source: judgement."""


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    points: Float64
    """(N, 3) [m]."""
    velocity: Float64
    """(N, 3) how they move as their times grow [m/s]."""


class ClockWatch:
    """Gathers points of scans, and tells the offset; owned by one thread."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Expect nothing of the next scan."""
        self._window = -1
        self._looks: list[_Look] = []
        self._product = self._square = self._total = self._count = 0.0
        self._doubts = 0

    def see(
        self, points: Float64, velocity: Float64, apart: Float64, stamp_ns: int
    ) -> float | None:
        """
        Take some points of a scan.

        Parameters
        ----------
        points, velocity : (N, 3) float64
            In the map [m], and how they move as their times grow [m/s].
        apart : (N,) float64
            Distance from the lidar [m].
        stamp_ns : int
            Of the scan [ns].

        Returns
        -------
        float or None
            Time to be added to the stamps of scans, where it is surely another than 0 [s].

        """
        near = apart < REACH
        looks, window = self._looks, stamp_ns // WINDOW_NS
        found = None
        if window != self._window:
            self._window, self._looks = window, []
            found = self._close(looks)
        self._looks.append(_Look(points[near], velocity[near]))
        return found

    def _close(self, looks: list[_Look]) -> float | None:
        """Add what a window tells; return the offset where it is sure."""
        if len(looks) < LEAST_LOOKS:
            return None
        product, square, total, count = measure_offsets(
            np.concatenate([item.points for item in looks]),
            np.concatenate([item.velocity for item in looks]),
            np.repeat(np.arange(len(looks)), [len(item.points) for item in looks]),
        )
        self._product = FADING * self._product + product
        self._square = FADING * self._square + square
        self._total = FADING * self._total + total
        self._count = FADING * self._count + count
        if self._square <= 0.0 or self._count < 2.0:
            return None
        offset = -self._product / self._square
        rest = max(self._total - self._product**2 / self._square, 0.0)
        sigma = np.sqrt(rest / (self._count - 1.0) / self._square)
        sure = abs(offset) > max(LEAST_OFFSET, SURELY * sigma)
        self._doubts = self._doubts + 1 if sure else 0
        return float(offset) if self._doubts >= TWICE else None


def measure_offsets(
    points: Float64, velocity: Float64, look: Int64
) -> tuple[float, float, float, int]:
    """
    Compare the looks at planes within a window.

    Parameters
    ----------
    points, velocity : (N, 3) float64
        Of all looks [m], [m/s].
    look : (N,) int64
        Which look each is of.

    Returns
    -------
    product, square, total : float
        Sums over the looks of each plane of how far they lie off across it, times how fast they
        move so [m2/s], of the square of the latter [m2/s2] and of the former [m2].
    count : int
        Looks, less one for each plane.

    """
    if not len(points):
        return 0.0, 0.0, 0.0, 0
    index = np.floor(points / CELL).astype(np.int64)
    offsets = points - (index + 0.5) * CELL
    index -= index.min(axis=0)
    size = index.max(axis=0) + 1
    cell = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    num_looks = int(look.max()) + 1
    key, group, count = np.unique(
        cell * num_looks + look, return_inverse=True, return_counts=True
    )
    group = group.reshape(-1)
    mean = _sum(group, offsets, len(key)) / count[:, None]
    speed = _sum(group, velocity, len(key)) / count[:, None]
    apart = offsets - mean[group]
    scatter = _sum(group, (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9), len(key))
    good = count >= LEAST_POINTS
    key, count, mean, speed = key[good], count[good], mean[good], speed[good]
    scatter = scatter[good]
    # planes, as the looks of a cell show them
    _, home, looks = np.unique(key // num_looks, return_inverse=True, return_counts=True)
    home = home.reshape(-1)
    total: Float64 = np.bincount(home, count, minlength=len(looks)).astype(np.float64)
    within = _sum(home, scatter, len(looks)) / np.maximum(total - looks, 1.0)[:, None]
    values, axes = np.linalg.eigh(within.reshape(-1, 3, 3))
    plane = (values[:, 0] < PLANE * values[:, 1]) | (
        (values[:, 0] < ROUGH) & (values[:, 0] < ROUGH_SHARE * values[:, 1])
    )
    plane &= (values[:, 1] >= PLANE * values[:, 2]) & (looks >= LEAST_LOOKS)
    # across the plane, less what is the same in all looks
    normal = axes[home, :, 0]
    off, moves = _centre(
        np.column_stack([(mean * normal).sum(axis=1), (speed * normal).sum(axis=1)]),
        home, count, total,
    )
    wide = np.bincount(home, off**2, minlength=len(looks)) / np.maximum(looks, 1)
    plane &= wide < MOST_APART**2
    chosen = plane[home]
    off, moves = off[chosen], moves[chosen]
    return (
        float(off @ moves), float(moves @ moves), float(off @ off),
        int(chosen.sum() - plane.sum()),
    )


def _centre(
    values: Float64, home: Int64, count: Int64, total: Float64
) -> tuple[Float64, Float64]:
    """Return two columns less their mean over the points of each home."""
    mean = _sum(home, values * count[:, None], len(total)) / np.maximum(total, 1.0)[:, None]
    first, second = (values - mean[home]).T
    return first, second


def _sum(group: Int64, values: Float64, num: int) -> Float64:
    """Sum the rows of (N, K) values by group."""
    columns = [np.bincount(group, column, minlength=num) for column in values.T]
    return np.stack(columns, axis=1)
