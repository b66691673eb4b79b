# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Where a vehicle may fly: off conductors, above all else that was seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plc_inspect.core.coverage.coverage import LEAST_SHARE, PASS
from plc_inspect.core.coverage.sections import Section
from plc_inspect.core.coverage.seen_ground import CELL, SeenGround
from plc_inspect.results import Bool, Float64, Int64, Span

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SAFE = 18.0
"""
Least distance from all conductors, extrapolated beyond open ends [m].
Source: derived: the default warning distance of 15 m, and 3 m of wind and odometry.
"""
LEAD = 40.0
"""
Distance before and after a stretch at which its run begins and ends, and beyond open ends up to
which conductors are extrapolated [m].
Source: derived: 15 degrees below the horizon the ground 10 m below is met after 37 m.
"""
NUM_NEAR, MOST_NEAR = 4, PASS
"""
Seen cells nearest to a place that tell what stands there, up to this distance [m].
Source: judgement: a square of 5 m where all was seen; what stands out of what was not is seen.
"""
OBSTACLES, NEAR = 8.0, 10.0
"""
Least height above objects, and distance in plan from the path within which they count [m].
Source: derived: the default critical distance; sway and odometry.
"""
ROUNDING = 1e-6
"""Distances equal to it count as kept [m].  Source: numerical."""
SAMPLE = 2.0
"""Spacing of compared positions on conductors and paths [m].  Source: numerical: SAFE is nine."""


@dataclass(frozen=True, eq=False)
class Airspace:
    """Where a vehicle may fly."""

    wires: Float64
    """(N, 3) positions along all conductors [m]."""
    ground: SeenGround
    safe: float

    @cached_property
    def tree(self) -> 'cKDTree':
        """Kd-tree of these positions."""
        from scipy.spatial import cKDTree  # a moment that others need not wait for

        return cKDTree(self.wires)

    @cached_property
    def plan_tree(self) -> 'cKDTree':
        """Kd-tree of these positions in plan."""
        from scipy.spatial import cKDTree

        return cKDTree(self.wires[:, :2])

    @property
    def least(self) -> float:
        """Distance between samples from which all between them keeps the safe one [m]."""
        return float(np.hypot(self.safe, SAMPLE / np.sqrt(2.0)))

    def is_safe(self, places: Float64) -> Bool:
        """Return which positions (N, 3) are above all else and no conductor is near or above."""
        return self.is_above(places) & self.is_apart(places) & ~self.is_below(places)

    def is_above(self, places: Float64) -> Bool:
        """Return which positions (N, 3) are above all objects near them."""
        # as a waypoint may lie exactly that high, rounding is left to it
        high: Bool = places[:, 2] >= self.find_floor(places) - ROUNDING
        return high

    def find_floor(self, places: Float64) -> Float64:
        """Return the least safe height (N,) above the objects near positions (N, 2+) [m]."""
        # an object near a leg counts at the samples before and behind it
        return self.ground.find_top(places, NEAR + SAMPLE) + OBSTACLES

    @cached_property
    def seen(self) -> tuple['cKDTree', Float64]:
        """Kd-tree of the seen cells, and their heights and that of none, inf, (K + 1,) [m]."""
        from scipy.spatial import cKDTree

        middles, heights = self.ground.list_seen()
        return cKDTree(middles), np.append(heights, np.inf)

    def is_known(self, places: Float64) -> Bool:
        """Return near which positions (N, 2+) most was seen."""
        num = self.seen[0].query_ball_point(places[:, :2], NEAR, return_length=True)
        known: Bool = num >= LEAST_SHARE * np.pi * (NEAR / CELL) ** 2
        return known

    def find_low(self, places: Float64) -> Float64:
        """Return the least safe height (N,) above what is nearest to positions (N, 2+) [m]."""
        low: Float64 = self._find_nearest(places).max(axis=1) + OBSTACLES
        return low

    def find_ground(self, places: Float64) -> Float64:
        """Return the height (N,) of the lowest of what is nearest to positions (N, 2+) [m]."""
        low: Float64 = self._find_nearest(places).min(axis=1)
        return low

    def _find_nearest(self, places: Float64) -> Float64:
        tree, heights = self.seen
        _, at = tree.query(places[:, :2], k=NUM_NEAR, distance_upper_bound=MOST_NEAR)
        found: Float64 = heights[at]
        return found

    def is_apart(self, places: Float64) -> Bool:
        """Return which positions (N, 3) are far enough from conductors."""
        return self.measure(places) >= self.least - ROUNDING

    def measure(self, places: Float64) -> Float64:
        """Return the distance (N,) of positions (N, 3) from conductors, up to the least [m]."""
        if not len(self.wires):
            return np.full(len(places), self.least)
        apart: Float64 = np.minimum(self.tree.query(places)[0], self.least)
        return apart

    def is_below(self, places: Float64) -> Bool:
        """Return which positions (N, 3) cannot be left upwards: a conductor hangs above."""
        below: Bool = np.zeros(len(places), dtype=np.bool_)
        if not len(self.wires):
            return below
        (low,) = np.nonzero(places[:, 2] < self.wires[:, 2].max())
        near = self.plan_tree.query_ball_point(places[low, :2], self.least)
        for number, own in zip(low, near, strict=True):
            below[number] = bool((self.wires[own, 2] > places[number, 2]).any())
        return below


def sample_wires(sections: Sequence[Section]) -> Float64:
    """Return positions (N, 3) along all conductors, extrapolated beyond open ends [m]."""
    parts = [np.empty((0, 3))]
    for section in sections:
        for span in section.spans:
            low, high = _extend(section, span)
            parts.append(span.positions(np.linspace(low, high, 2 + int((high - low) / SAMPLE))))
    return np.concatenate(parts)


def _extend(section: Section, span: Span) -> tuple[float, float]:
    """Return least and greatest x of a span, beyond its open ends included [m]."""
    reach = LEAD + section.high - span.length
    return -reach if span.open_start else 0.0, span.length + (reach if span.open_end else 0.0)


def sample_path(places: Float64) -> tuple[Float64, Int64]:
    """Return positions (N, 3) along a path, and the number of the leg of each."""
    parts, owner = [places[:1]], [0]
    for number in range(len(places) - 1):
        apart = float(np.linalg.norm(places[number + 1] - places[number]))
        share = np.linspace(0.0, 1.0, 2 + int(apart / SAMPLE))[:, None]
        parts.append(places[number] + share * (places[number + 1] - places[number]))
        owner += [number] * len(share)
    return np.concatenate(parts), np.array(owner, dtype=np.int64)
