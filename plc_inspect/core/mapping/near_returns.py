# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Returns near the vehicle that no tick has looked at yet.

A thin wire gives returns from near by only, and a tick looks at them a second later, or more on a
busy computer.  Until then they are told of as they are.
"""

from collections import deque

from numba import njit
import numpy as np

from plc_inspect.core.alignment.parts import Seen
from plc_inspect.core.voxel_buffer.cell_index import CellIndex
from plc_inspect.results import Bool, Float64, Int64

REACH = 30.0
"""
Distance from the lidar up to which returns are kept [m].
Source: derived: the default distance that is critical, and two seconds at 10 m/s.
"""
MOST_KEPT = 500
"""
Most returns of one scan that are kept, and most that are judged at a pose, the nearest.
Source: numerical: a pose takes 1 ms at most, 0.1 ms where nothing is near.
"""
KEPT_NS = 3_000_000_000
"""Time for which they are kept [ns].  Source: judgement: a tick beside busy programs."""
CLOSE = 0.5
"""
Distance within which returns are of one thing [m].
Source: derived: columns of a Puck Lite are 0.03 m apart at 8 m, the lines of two scans are less
than this where it flies at 5 m/s.
"""
LEAST_RETURNS = 4
"""
Least number of returns of a thing, of two scans at least.
Source: judgement: insects and drops of rain give one or two.
"""
BELOW = 0.26
"""
Depth below the vehicle, as a share of the distance, down to which returns are no ground.
Source: derived: the field of view of a level Puck Lite, 15 degrees.
"""
STANDS = 1.5
"""
Height above the lowest place about the vehicle from which returns are no ground [m].
Source: as surroundings.OFF_GROUND; the ground about a vehicle that takes off is lower.
"""
ABOUT = 60.0
"""
Distance from the vehicle of the cells among which the lowest place is looked for [m].
Source: derived: a level Puck Lite sees the ground below at 60 m from 16 m above it.
"""


class NearReturns:
    """The last returns near the lidar; for one thread."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, int, Float64]] = deque()

    def clear(self) -> None:
        """Forget all returns."""
        self._kept.clear()

    def add(self, scan: Seen, sequence: int, cells: CellIndex) -> None:
        """
        Take the returns of a scan; where they are too many, those of the ground give way.

        Parameters
        ----------
        scan : Seen
            In the map frame.
        sequence : int
            Its insertion into the map.
        cells : CellIndex
            Of the map, for the lowest place.

        """
        near = np.flatnonzero(scan.apart <= REACH)
        if len(near) > MOST_KEPT:
            lowest = _find_lowest(cells, scan.points[np.argmin(scan.apart)])
            low = scan.points[near, 2] < lowest + STANDS  # the ground, or wires where none is seen
            order = np.argpartition(scan.apart[near] + REACH * low, MOST_KEPT)
            near = near[order[:MOST_KEPT]]
        while self._kept and not 0 <= scan.stamp_ns - self._kept[0][0] <= KEPT_NS:
            self._kept.popleft()
        if len(near):
            self._kept.append((scan.stamp_ns, sequence, scan.points[near]))

    def find(
        self, place: Float64, reach: float, cells: CellIndex, sequence: int,
        ground: bool = True,
    ) -> Float64:
        """
        Return what stands near a place and no tick has looked at.

        Parameters
        ----------
        place : (3,) float64
            Of the vehicle, map frame [m]; NaN where nobody knows.
        reach : float
            Distance from it [m].
        cells : CellIndex
            Of the map, for the lowest place.
        sequence : int
            Newest insertion that a tick has looked at.
        ground : bool
            What lies far below, or lowest, may be the ground; else nothing is.

        Returns
        -------
        (K, 3) float64
            Returns of things in the air or that stand off the ground, map frame [m].

        """
        fresh = [(number, points) for _, number, points in self._kept if number > sequence]
        if not fresh:
            return np.zeros((0, 3))
        points = np.concatenate([points for _, points in fresh])
        number = np.repeat([number for number, _ in fresh], [len(points) for _, points in fresh])
        ahead = _are_ahead(points, place, reach, BELOW if ground else 1.0)
        if not ahead.any():
            return np.zeros((0, 3))
        points, number = points[ahead], number[ahead]
        if ground:
            high = points[:, 2] >= _find_lowest(cells, place) + STANDS
            points, number = points[high], number[high]
        if len(points) > MOST_KEPT:
            apart = ((points - place) ** 2).sum(axis=1)
            nearest = np.argpartition(apart, MOST_KEPT)[:MOST_KEPT]
            points, number = points[nearest], number[nearest]
        result: Float64 = points[_are_many(points, number)]
        return result


def _find_lowest(cells: CellIndex, place: Float64) -> float:
    """Return the height of the lowest place of the map about the vehicle [m]."""
    found = cells.find_all(place, ABOUT)
    return float(cells.low[found[found >= 0]].min(initial=np.inf))


# These keep Python's lock: each return from a kernel without it would wait for a tick.
@njit(cache=True, error_model='numpy')
def _are_ahead(  # type: ignore[no-untyped-def]
    points: Float64, place: Float64, reach: float, below: float
) -> Bool:
    """Tell which points are within reach and, as a share of the distance, not deeper below."""
    result = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(points)):
        x, y, z = points[k, 0] - place[0], points[k, 1] - place[1], points[k, 2] - place[2]
        apart = np.sqrt(x * x + y * y + z * z)
        result[k] = apart <= reach and -z <= below * apart
    return result


@njit(cache=True, error_model='numpy')
def _are_many(points: Float64, number: Int64) -> Bool:  # type: ignore[no-untyped-def]
    """Tell about which points there are enough others, of another scan as well."""
    result = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(points)):
        count, other = 0, False
        for m in range(len(points)):
            x, y = points[m, 0] - points[k, 0], points[m, 1] - points[k, 1]
            z = points[m, 2] - points[k, 2]
            if x * x + y * y + z * z <= CLOSE * CLOSE:
                count += 1
                other = other or number[m] != number[k]
                if count >= LEAST_RETURNS and other:
                    result[k] = True
                    break
    return result
