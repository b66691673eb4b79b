# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Corrects the times of scans if their clock surely differs from that of the odometry."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from plc_inspect.core.alignment.steady_errors import Steady
from plc_inspect.core.mapping.placement import PlacedScan, Placer, WaitingScan
from plc_inspect.core.mapping.pose_buffer import PoseBuffer
from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.core.setup.look_cells import choose_points, Look
from plc_inspect.core.setup.steady_fit import SteadyFit
from plc_inspect.results import Float64, Int64

STEP_NS = 20_000_000
"""Time over which velocities of points are taken [ns].  Source: judgement: two poses at 100 Hz."""
LEAST_OFFSET = 0.01
"""
Least offset that is corrected [s].
Source: measured: bench/studies/input_faults.py: sure offsets of right clocks reach 0.007; a great
offset is first found to 0.013.
"""
SMEARED = 0.03
"""
Greatest correction with which the map is kept; beyond, it is smeared and begins anew [s].
Source: measured: bench/studies/sharpness.py: 0.05 s holds hazards back.
"""
MOST_OFFSET = 0.5
"""Greatest offset corrected [s].  Source: as MOST_LEAD of standstill, which reports greater."""
MOST_RATE = 0.02
"""Greatest relative drift of two clocks.  Source: judgement: hundreds of times the usual."""
LARGE = 0.1
"""
Correction after which the next one removes its error, and does not show a drift [s].
Source: measured: the demo flight with 0.2 s: 0.17 s, then 0.03 s.
"""
LEAST_TOLD = 0.001
"""Least drift that is reported.  Source: judgement: 0.1 s in two minutes."""
LEARNING = 0.5
"""Share of a new offset that is attributed to drift.  Source: judgement."""


class ScanTiming:
    """Finds and corrects the offset of the scans' clock; owned by one thread."""

    def __init__(self) -> None:
        self._fit = SteadyFit()
        self.clear()

    def clear(self) -> None:
        """Use the stamps of scans as they are."""
        self._fit.clear()
        self._offset = self._rate = self._newest = 0.0
        self._since: int | None = None
        self._last = 0

    @property
    def offset(self) -> float:
        """Newest correction of the times of scans [s]."""
        return self._offset

    def forget_looks(self) -> None:
        """Forget the scans compared so far, as after a break in the odometry."""
        self._fit.clear()

    def forget_times(self) -> None:
        """Forget how the clocks drift, as after time went back; keep the last offset."""
        self._offset = self._find_offset(self._last)
        self._since, self._rate = None, 0.0
        self.forget_looks()

    def remember(self) -> list[float | int | None]:
        """Return offset [s], drift and when it was found [ns], for ``resume``."""
        return [self._offset, self._rate, self._since]

    def resume(self, offset: float, rate: float, since: int | None) -> None:
        """Go on with what another process remembered."""
        self._offset, self._rate, self._since = offset, rate, since
        self._last = since or 0

    @property
    def steady(self) -> Steady | None:
        """Steady errors that make planes coincide; None while unknown."""
        return self._fit.steady

    def shift(self, stamp_ns: int, stamps: Int64) -> Int64:
        """Return the point times of a scan by the clock of the odometry [ns]."""
        offset, self._last = self._find_offset(stamp_ns), stamp_ns
        return stamps if offset == 0.0 else stamps + round(offset * 1e9)

    def _find_offset(self, stamp_ns: int) -> float:
        if self._since is None:
            return self._offset
        offset = self._offset + self._rate * (stamp_ns - self._since) * 1e-9
        return min(max(offset, -MOST_OFFSET), MOST_OFFSET)

    def look(self, scan: WaitingScan, placer: Placer, poses: PoseBuffer) -> Iterator[str]:
        """
        Compare a scan with those before, and correct the offset; in pieces.

        Yields
        ------
        str
            Why the map must begin anew, '' between pieces.

        """
        seen = self._look(scan, placer, poses)
        if seen is None or not self._fit.see(seen, scan.stamp_ns):
            return
        yield ''
        for _ in self._fit.judge():
            yield ''
        yield self._correct(scan.stamp_ns)

    def _look(self, scan: WaitingScan, placer: Placer, poses: PoseBuffer) -> Look | None:
        """Return some points of a scan, and how each would move if the clock were off."""
        if scan.placed or not len(scan.xyz):
            return None
        chosen = choose_points(np.sqrt(np.einsum('ij,ij->i', scan.xyz, scan.xyz)))
        if not len(chosen):
            return None
        some = replace(scan, xyz=scan.xyz[chosen], stamps=scan.stamps[chosen])
        now = placer.place(some, poses)
        before = placer.place(replace(some, stamps=some.stamps - STEP_NS), poses)
        lidar = placer.place(replace(some, xyz=np.zeros_like(some.xyz)), poses)
        if not (
            isinstance(now, PlacedScan) and isinstance(before, PlacedScan)
            and isinstance(lidar, PlacedScan)
        ):
            return None
        if not (np.abs(now.points) < MOST_COORDINATE).all():  # poses at no place
            return None
        velocity = (now.points - before.points) / (STEP_NS * 1e-9)
        return Look(
            now.points, velocity, lidar.points, _find_axes(some, placer, poses, lidar), now.stamps
        )

    def _correct(self, stamp_ns: int) -> str:
        """Correct the offset at which planes coincide, if sure; learn drift from small ones."""
        steady = self._fit.steady
        if steady is None or not steady.sure[0] or abs(steady.values[0]) < LEAST_OFFSET:
            return ''
        found = float(steady.values[0])
        offset = self._find_offset(stamp_ns) + found
        if abs(offset) > MOST_OFFSET:
            return ''
        if self._since is not None and self._newest < LARGE:
            seconds = max((stamp_ns - self._since) * 1e-9, 1.0)
            self._rate += LEARNING * found / seconds
            self._rate = float(np.clip(self._rate, -MOST_RATE, MOST_RATE))
        self._offset, self._since, self._newest = offset, stamp_ns, abs(found)
        self._fit.clear()
        return self.describe() if abs(found) > SMEARED else ''

    def describe(self) -> str:
        """Describe the correction, '' if there is none."""
        if self._offset == 0.0:
            return ''
        side = 'earlier' if self._offset < 0.0 else 'later'
        drifts = f', and {100.0 * self._rate:+.1f} % more' if abs(self._rate) > LEAST_TOLD else ''
        return (
            f'scans fit best {abs(self._offset):.2f} s {side}{drifts}, and are taken so: '
            'set lidar and odometry by one clock'
        )


def _find_axes(
    scan: WaitingScan, placer: Placer, poses: PoseBuffer, lidar: PlacedScan
) -> Float64:
    """Return x, y and z of the vehicle when points were measured (N, 3, 3)."""
    result = np.zeros((len(scan.xyz), 3, 3))
    for number, axis in enumerate(placer.mount.transform[:3, :3].astype(np.float32)):
        tip = placer.place(replace(scan, xyz=np.tile(axis, (len(scan.xyz), 1))), poses)
        if isinstance(tip, PlacedScan):  # as the lidar, at the same times
            result[:, number] = tip.points - lidar.points
    return result
