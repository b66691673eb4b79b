# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How far looks at the same planes and lines lie apart.

In cells of 4 m the points of each moment (a look) give a plane or a line.  Related: Razlaw et al.
2015, Evaluation of registration methods for sparse 3D laser scans (mean plane variance); here
between looks, so that foliage and rough ground, which are thick in every look, do not count.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from plc_inspect.core.numerics.cell_sums import pack_cells, sum_rows
from plc_inspect.results import Float64, Int64

CELL = 4.0
"""
Edge of a cell [m].
Source: measured: on simulated flights: smaller ones hold too few points of a look, larger ones two
surfaces.
"""
MOST_POINTS = 3000
"""
Points of a scan that are looked at; of more, every so many.
Source: numerical: 16 a cell and scan where all 200 cells in reach are seen.
"""
MOST_WAITING = 14
"""
Windows that wait to be measured at most.
Source: numerical: 10 s of flight, 1.4 windows a second in the three scales.
"""
LEAST_LOOKS = 3
"""Looks that a cell needs.  Source: judgement; not measured."""
LINE, PLANE = 0.02, 0.02
"""
A look is a line, or a plane, where its variance across is less than this share of that along.
Source: derived: noise of 0.03 m on a piece of a metre, with room for curvature.
"""
ROUGH, ROUGH_SHARE = 0.1**2, 0.25
"""
A look is a rough plane where it is thinner than this [m2] and than this share of its width.
Source: derived: ground with grass of 0.1 m.
"""


@dataclass(frozen=True, slots=True)
class Scale:
    """How long looks last, and how long those are apart that are compared."""

    look_ns: int
    window_ns: int
    least_points: int
    """Of a look in a cell."""
    reach: float
    """Points farther from the lidar are not looked at [m]."""
    limit: float
    """Greatest distance between looks of a sharp map [m]."""


SHORT = Scale(100_000_000, 1_000_000_000, 5, 30.0, 0.035)
LONG = Scale(500_000_000, 5_000_000_000, 8, 30.0, 0.035)
FAR = Scale(500_000_000, 5_000_000_000, 8, 60.0, 0.05)
SCALES = SHORT, LONG, FAR
"""
Scans against a second, and half seconds against five.  The long one sees small errors; gross ones
smear its looks until they show no planes and lines, while the short one goes on.  Where little is
near, planes farther away count, with a greater limit, as the noise of the attitude grows with
range; lines there are arcs of the scan on the ground.
Source: measured: bench/studies/sharpness.py: with the right set-up 0.009 to 0.017 m near and
0.024 to 0.032 m far; 0.041 and more, and 0.046 and more, where the first hazard changes.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LookWindow:
    """Points of one window of one scale."""

    scale: int
    """Place in SCALES."""
    points: Float64
    """(N, 3) map frame [m]."""
    stamps: Int64
    """(N,) [ns]."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """How far looks lie apart in the cells of one window beyond their noise, as variances [m2]."""

    scale: int
    planes: Float64
    """(P,) across planes."""
    lines: Float64
    """(L,) across lines."""
    noise: Float64
    """(P,) across the planes of one look."""


class SharpnessMeter:
    """Gathers the points of scans in windows; owned by the thread that inserts them."""

    def __init__(self) -> None:
        self._waiting: deque[LookWindow] = deque(maxlen=MOST_WAITING)
        self.clear()

    def clear(self) -> None:
        """Forget all points."""
        self._waiting.clear()
        self._numbers = [-1] * len(SCALES)
        self._parts: list[list[tuple[Float64, Int64]]] = [[] for _ in SCALES]

    def add(self, points: Float64, stamps: Int64, apart: Float64) -> None:
        """
        Take the points of a scan.

        Parameters
        ----------
        points : Float64
            (N, 3) map frame [m].
        stamps : Int64
            (N,) [ns].
        apart : Float64
            (N,) distance from the lidar [m].

        """
        for index, scale in enumerate(SCALES):
            chosen = np.flatnonzero(apart < scale.reach)
            if not len(chosen):
                continue
            step = 1 + (len(chosen) - 1) // MOST_POINTS
            chosen = chosen[:: step | 1]  # an odd step takes all beams of an interleaved scan
            part = points[chosen], stamps[chosen]
            number = int(part[1][0]) // scale.window_ns
            if number != self._numbers[index]:
                self._close(index)
                self._numbers[index] = number
            self._parts[index].append(part)

    def _close(self, index: int) -> None:
        parts, self._parts[index] = self._parts[index], []
        if len(parts) >= LEAST_LOOKS:
            self._waiting.append(LookWindow(
                index, np.concatenate([item[0] for item in parts]),
                np.concatenate([item[1] for item in parts]),
            ))

    def take(self) -> list[LookWindow]:
        """Hand out the windows that are complete."""
        found = list(self._waiting)
        self._waiting.clear()
        return found


def measure_spread(window: LookWindow) -> Spread:
    """
    Measure how far the looks of a window lie apart.

    Parameters
    ----------
    window : LookWindow
        As from ``SharpnessMeter.take``.

    Returns
    -------
    Spread
        Costs O(N log N), 3 ms for 30,000 points.

    """
    scale = SCALES[window.scale]
    index = np.floor(window.points / CELL).astype(np.int64)
    offsets = window.points - (index + 0.5) * CELL
    look = (window.stamps - window.stamps.min()) // scale.look_ns
    num_looks = int(look.max()) + 1
    key, group, count = np.unique(
        pack_cells(index) * num_looks + look, return_inverse=True, return_counts=True
    )
    # means and scatter of each look in each cell
    mean = sum_rows(group, offsets, len(key)) / count[:, None]
    apart = offsets - mean[group]
    scatter = sum_rows(group, (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9), len(key))
    good = count >= scale.least_points
    key, count, mean, scatter = key[good], count[good], mean[good], scatter[good]
    # pooled over the looks of a cell, and between them
    _, home, looks = np.unique(key // num_looks, return_inverse=True, return_counts=True)
    total = sum_rows(home, count[:, None].astype(np.float64), len(looks))
    centre = sum_rows(home, mean * count[:, None], len(looks)) / np.maximum(total, 1.0)
    apart = (mean - centre[home]) * np.sqrt(count)[:, None]
    between = sum_rows(home, (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9), len(looks))
    kept = looks >= LEAST_LOOKS
    within = sum_rows(home, scatter, len(looks))[kept] / (total[kept] - looks[kept, None])
    # without what the noise of one look's mean is in any map
    expected = within * ((looks[kept] - 1) / total[kept, 0])[:, None]
    between = (between[kept] / total[kept] - expected).reshape(-1, 3, 3)
    values, axes = np.linalg.eigh(within.reshape(-1, 3, 3))
    line = (values[:, 1] < LINE * values[:, 2]) & (values[:, 1] < ROUGH)
    plane = (values[:, 0] < PLANE * values[:, 1]) | (
        (values[:, 0] < ROUGH) & (values[:, 0] < ROUGH_SHARE * values[:, 1])
    )
    plane &= ~line
    return Spread(
        scale=window.scale,
        planes=_project(between[plane], axes[plane, :, 0]),
        lines=_project(between[line], axes[line, :, 1]),
        noise=np.maximum(values[plane, 0], 0.0),
    )


def _project(variance: Float64, axis: Float64) -> Float64:
    """Return the variances along axes (N, 3), 0 at least."""
    result: Float64 = np.maximum(np.einsum('ni,nij,nj->n', axis, variance, axis), 0.0)
    return result
