# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Steady errors of the odometry: positions that are too long or too short, a heading that turns.

They show within seconds of flight, and what was mapped until then is smeared too far to be a
landmark.  For positions the map begins anew, as if they had been right from the beginning.  Where
the heading turns nothing is told of the map: it bends, and nobody knows how far.
"""

from dataclasses import dataclass

import numpy as np

from plc_inspect.core.alignment.drift_filter import DriftFilter, SCALE
from plc_inspect.core.alignment.registration import Fit
from plc_inspect.results import Bool, Float64

SHARE = 0.02
"""
Share of the way by which positions are off, from which they are taken for wrong.
Source: measured: bench/studies/odometry_faults.py: good odometry shows 0.01 at most.
"""
TURNED = 0.01
"""
Turn of the heading against the positions, within a pass, from which nothing is told [rad].
Source: derived: 0.3 m at 30 m; measured: bench/studies/odometry_faults.py: good odometry shows
0.002 at most.
"""
TURNING = 0.005
"""
Turn of the heading against the positions, by planes, from which nothing is told [rad/s].
Source: derived: 0.3 m at 30 m within their two seconds; measured: bench/studies/input_faults.py:
good odometry shows less.
"""
ASIDE = 0.2
"""
Drift aside from which nothing is told [m/s].
Source: judgement: twice what is mended; measured: bench/studies/odometry_faults.py: a heading that
drifts bends the map, and what is corrected then grows without end.
"""
SMEAR = 0.1
"""
Speed at which the map slides away, from which it is no landmark [m/s].
Source: derived: 0.2 m while a cell is open.
"""
EARLY = 100.0
"""
Way since the beginning up to which the map begins anew; later too much would be lost, and the
drift is followed [m].  Source: judgement: it shows after 20 to 40 m.
"""
LATE = 0.05
"""
Change of the share from which results are held back then.
Source: derived: a drift of 0.1 m/s along the way that turns at 6 m/s is 0.033.
"""
SURELY = 4.0
"""So many standard deviations are sure.  Source: as SURELY of follower."""
TWICE = 2
"""Batches in a row that must say so.  Source: judgement."""


@dataclass(frozen=True, slots=True, eq=False)
class Steady:
    """What makes planes lie together: to be added to the stamps, the positions, the heading."""

    values: Float64
    """(3,) time [s], share of the way, turn of the heading [rad/s]."""
    sigma: Float64
    """(3,) their standard deviations."""
    least: float
    """So many of them are sure."""

    @property
    def sure(self) -> Bool:
        """Whether each (3,) is surely not 0."""
        return np.abs(self.values) > self.least * self.sigma


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """Where the map began."""

    place: Float64
    """(3,) of the vehicle [m]."""
    shift: Float64
    """(3,) by which its place was moved then [m]."""


class SteadyErrors:
    """Tells a steady error from the drift of a good odometry; owned by one thread."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew, with the odometry as it is."""
        self._flown = 0.0
        self._share = 0.0
        """Which the map was begun with."""
        self.doubt = ''
        """Why nothing may be told of the map, '' if nothing."""
        self._doubts = [0, 0, 0]
        self._planes: Steady | None = None
        self.step()

    def hear(self, planes: Steady | None) -> None:
        """Take what planes tell, None: nothing; where the heading turns they tell no scale."""
        turning = planes is not None and bool(planes.sure[2]) and abs(planes.values[2]) > TURNING
        self._planes = None if turning else planes
        if planes is not None and turning:
            self._doubt_heading(f'{abs(np.degrees(planes.values[2])):.1f} degrees/s')

    def step(self) -> None:
        """Take the place of the vehicle and its heading anew, as after a step."""
        self._start: _Start | None = None
        self._yaw: float | None = None

    def begin(self, tracked: DriftFilter, place: Float64) -> None:
        """Take where the vehicle (3,) is, and how it is moved, at the beginning."""
        move = tracked.move.about(place)
        if self._start is None:
            self._start = _Start(np.array(place), move.shift)

    def judge_heading(self, fit: Fit, again: bool) -> None:
        """Look at a fit, whether of what was left meanwhile: there drift shows, and is mended."""
        if self._yaw is None or again:
            self._yaw = fit.move.yaw
        turned = abs(fit.move.yaw - self._yaw)
        sigma = float(np.sqrt(fit.covariance[3, 3]))
        self._doubts[1] = self._doubts[1] + 1 if turned > max(TURNED, SURELY * sigma) else 0
        if self._doubts[1] >= TWICE:
            self._doubt_heading(f'{np.degrees(turned):.1f} degrees and more')

    def _doubt_heading(self, size: str) -> None:
        self.doubt = (
            f'the heading of the odometry drifts against its positions, by {size}: results are '
            'held back; check what tells the heading'
        )

    def judge_way(self, tracked: DriftFilter, way: float, place: Float64) -> str:
        """
        Correct the filter where positions are surely too long or too short.

        Parameters
        ----------
        tracked : DriftFilter
            Is set to what it had found with positions right from the beginning.
        way : float
            Flown since the last call [m].
        place : Float64
            (3,) of the vehicle in the odometry's frame [m].

        Returns
        -------
        str
            What is wrong, '' where the map may stay as it is.

        """
        self._flown += way
        share, sigma, surely = self._measure_share(tracked)
        aside, aside_sigma = tracked.measure_aside()
        wrong = aside > max(ASIDE, SURELY * aside_sigma)
        self._doubts[2] = self._doubts[2] + 1 if wrong else 0
        if self._doubts[2] >= TWICE:
            self.doubt = (
                f'the odometry drifts by {aside:.1f} m/s aside: results are held back; check '
                'position and heading'
            )
        off = abs(share - self._share)
        late = self._flown > EARLY
        least = LATE if late else SHARE
        wrong = off > max(least, surely) and off * tracked.speed > SMEAR
        self._doubts[0] = self._doubts[0] + 1 if wrong else 0
        if self._doubts[0] < TWICE or self._start is None:
            return ''
        if late:
            self.doubt = (
                f'{_tell_share(share - self._share)}, otherwise than before: results are held '
                'back; check the odometry'
            )
            return ''
        shift = self._start.shift + share * (place - self._start.place)
        tracked.begin_anew(shift, share, sigma)
        self._share, self._doubts[0] = share, 0
        return _tell_share(share)

    def _measure_share(self, tracked: DriftFilter) -> tuple[float, float, float]:
        """Return the share, its standard deviation, and what is sure, by whoever knows best."""
        share, sigma = tracked.measure_share()
        planes = self._planes
        if planes is None or planes.sigma[1] >= sigma:
            # it was found in a smeared map, so it may be off still
            return share, float(np.hypot(sigma, SCALE)), SURELY * sigma
        own = float(planes.sigma[1])
        return float(planes.values[1]), own, planes.least * own


def _tell_share(share: float) -> str:
    """Say how much too long or short positions are; ``share`` of the way is added."""
    off = 100.0 * (1.0 / (1.0 + share) - 1.0)
    which = 'long' if off > 0 else 'short'
    return f'the positions of the odometry are about {abs(off):.0f} % too {which}'
