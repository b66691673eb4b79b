# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How fast the vehicle moves, from its last positions."""

from collections import deque

import numpy as np

from plc_inspect.results import Float64

WINDOW_NS = 500_000_000
"""
Positions of this long give the velocity [ns].
Source: judgement: five poses of a slow odometry, and little of a turn.
"""
GAP_NS = 1_000_000_000
"""
After so long without a pose the velocity begins anew [ns].
Source: judgement: twice WINDOW_NS.
"""
LEAST_SPEED = 0.1
"""Slower than this the vehicle stands [m/s].  Source: judgement: the drift of an odometry."""


class Motion:
    """The vehicle's velocity, by least squares over half a second of positions."""

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Float64]] = deque()

    def add(self, stamp_ns: int, position: Float64) -> None:
        """
        Take a pose.

        Parameters
        ----------
        stamp_ns : int
            Of the pose; where it does not come after the last, or long after it, all begins anew.
        position : (3,) float64
            Map frame [m].

        """
        if self._poses and not 0 < stamp_ns - self._poses[-1][0] <= GAP_NS:
            self._poses.clear()
        self._poses.append((stamp_ns, np.array(position, dtype=np.float64)))
        while stamp_ns - self._poses[0][0] > WINDOW_NS:
            self._poses.popleft()

    @property
    def velocity(self) -> Float64:
        """(3,) in the map frame [m/s], NaN with less than two poses."""
        if len(self._poses) < 2:
            return np.full(3, np.nan)
        last = self._poses[-1][0]
        times = np.array([stamp - last for stamp, _ in self._poses]) * 1e-9
        places = np.array([position for _, position in self._poses])
        times -= times.mean()
        result: Float64 = times @ (places - places.mean(axis=0)) / (times @ times)
        return result
