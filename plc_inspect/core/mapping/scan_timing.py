# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Shifts the times of scans to where they fit best, where their clock is surely another."""

from dataclasses import replace

import numpy as np

from plc_inspect.core.alignment.steady_errors import Steady
from plc_inspect.core.mapping.placement import PlacedScan, Placer, WaitingScan
from plc_inspect.core.mapping.pose_buffer import PoseBuffer
from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.core.setup.steady_fit import choose_points, Look, SteadyFit
from plc_inspect.results import Int64

STEP_NS = 20_000_000
"""Time over which it is seen how points move [ns].  Source: judgement: two poses at 100 Hz."""
LEAST_OFFSET = 0.015
"""
Offset from which scans are shifted [s].
Source: measured: bench/studies/input_faults.py: right clocks show 0.007 where it is sure.
"""
SMEARED = 0.03
"""
Offset from which what was mapped is smeared, and the map begins anew, whenever that is [s].
Source: measured: bench/studies/sharpness.py: 0.05 s holds hazards back.
"""
MOST_OFFSET = 0.5
"""Greatest offset that is mended [s].  Source: as MOST_LEAD of standstill, which tells greater."""
MOST_RATE = 0.02
"""Greatest difference of the speeds of two clocks.  Source: judgement: hundreds of times usual."""
LARGE = 0.1
"""
After a correction by so much the next one makes up for its error, and tells no rate [s].
Source: measured: the demo flight with 0.2 s: 0.17 s, then 0.03 s.
"""
LEAST_TOLD = 0.001
"""A difference in speed from which it is told.  Source: judgement: 0.1 s in two minutes."""
LEARNING = 0.5
"""Share of a new offset that is taken for a difference in speed.  Source: judgement."""


class ScanTiming:
    """Owned by one thread."""

    def __init__(self) -> None:
        self._fit = SteadyFit()
        self.clear()

    def clear(self) -> None:
        """Take the stamps of scans as they are."""
        self._fit.clear()
        self._offset = self._rate = self._newest = 0.0
        self._since: int | None = None

    @property
    def offset(self) -> float:
        """By how much scans are shifted, found last [s]."""
        return self._offset

    def forget_looks(self) -> None:
        """Compare nothing with what was seen before, as where the odometry broke."""
        self._fit.clear()

    @property
    def steady(self) -> Steady | None:
        """What makes planes lie together; None: nobody knows."""
        return self._fit.steady

    def shift(self, stamp_ns: int, stamps: Int64) -> Int64:
        """Return the times of points of a scan [ns] by the clock of the odometry."""
        offset = self._find_offset(stamp_ns)
        return stamps if offset == 0.0 else stamps + round(offset * 1e9)

    def _find_offset(self, stamp_ns: int) -> float:
        if self._since is None:
            return self._offset
        return self._offset + self._rate * (stamp_ns - self._since) * 1e-9

    def look(self, scan: WaitingScan, placer: Placer, poses: PoseBuffer) -> str:
        """
        Look at a scan that was placed.

        Returns
        -------
        str
            Why the map is to begin anew, '' where it may stay.

        """
        if scan.placed or not len(scan.xyz):
            return ''
        chosen = choose_points(np.sqrt(np.einsum('ij,ij->i', scan.xyz, scan.xyz)))
        if not len(chosen):
            return ''
        some = replace(scan, xyz=scan.xyz[chosen], stamps=scan.stamps[chosen])
        now = placer.place(some, poses)
        before = placer.place(replace(some, stamps=some.stamps - STEP_NS), poses)
        lidar = placer.place(replace(some, xyz=np.zeros_like(some.xyz)), poses)
        if not (
            isinstance(now, PlacedScan) and isinstance(before, PlacedScan)
            and isinstance(lidar, PlacedScan)
        ):
            return ''
        if not (np.abs(now.points) < MOST_COORDINATE).all():  # poses at no place
            return ''
        velocity = (now.points - before.points) / (STEP_NS * 1e-9)
        seen = Look(now.points, velocity, lidar.points, now.stamps)
        new, steady = self._fit.see(seen, scan.stamp_ns), self._fit.steady
        if not new or steady is None or not steady.sure[0] or abs(steady.values[0]) < LEAST_OFFSET:
            return ''
        found = float(steady.values[0])
        offset = self._find_offset(scan.stamp_ns) + found
        if abs(offset) > MOST_OFFSET:
            return ''
        if self._since is not None and self._newest < LARGE:
            seconds = max((scan.stamp_ns - self._since) * 1e-9, 1.0)
            self._rate += LEARNING * found / seconds
            self._rate = float(np.clip(self._rate, -MOST_RATE, MOST_RATE))
        self._offset, self._since, self._newest = offset, scan.stamp_ns, abs(found)
        self._fit.clear()
        return self.describe() if abs(found) > SMEARED else ''

    def describe(self) -> str:
        """Say by how much scans are shifted, '' where they are not."""
        if self._offset == 0.0:
            return ''
        side = 'earlier' if self._offset < 0.0 else 'later'
        drifts = f', and {100.0 * self._rate:+.1f} % more' if abs(self._rate) > LEAST_TOLD else ''
        return (
            f'scans fit best {abs(self._offset):.2f} s {side}{drifts}, and are taken so: '
            'set lidar and odometry by one clock'
        )
