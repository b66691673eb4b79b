# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Steady errors: positions that are too long or too short, a heading that turns, a wrong mount.

They show within seconds of flight, and the map made until then is too blurred to be a reference.
For a scale error of positions the map starts anew with corrected positions.  For a heading that
turns no results are reported, as the map bends by an unknown amount.  A wrong mount drifts aside
as the vehicle flies, so it must not be taken for drift: the map would be turned about each place.
"""

from collections import deque
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.alignment.drift_filter import DriftFilter, SCALE
from plc_inspect.core.alignment.registration import Fit
from plc_inspect.results import Bool, Float64

SHARE = 0.02
"""
Scale error of positions from which they are corrected.
Source: measured: bench/studies/odometry_faults.py: good odometry shows 0.01 at most.
"""
TURNED = 0.01
"""
Turn of the heading against the positions, within a pass, from which no results are reported [rad].
Source: derived: 0.3 m at 30 m; measured: bench/studies/odometry_faults.py: good odometry shows
0.002 at most.
"""
TURNING = 0.005
"""
Turn rate of the heading against the positions, by planes, from which no results are reported
[rad/s].
Source: derived: 0.3 m at 30 m within their two seconds; measured: bench/studies/input_faults.py:
good odometry shows less.
"""
MOUNTED = 0.01
"""
Turn of the lidar against its mount, or of the heading against the positions, by planes, from which
no results are reported [rad].
Source: as TURNED.
"""
MOST_DRIFT = 0.1
"""
Drift that such a turn looks like, up to which it is taken for one [m/s].
Source: as SMEAR: a drift of the odometry up to that is mended.
"""
NUM_TURNS = 4
"""Turns that planes tell.  Source: derived: of the heading, and three of the mount."""
AXES = 'roll', 'pitch', 'yaw'
"""Turns of the mount.  Source: their names."""
ASIDE = 0.2
"""
Drift across the path from which no results are reported [m/s].
Source: judgement: twice what is mended; measured: bench/studies/odometry_faults.py: a heading that
drifts bends the map, and what is corrected then grows without end.
"""
SMEAR = 0.1
"""
Drift from which the map is no longer a reference [m/s].
Source: derived: 0.2 m while a cell is open.
"""
EARLY = 100.0
"""
Distance flown up to which the map may start anew; later too much would be lost, and the drift is
followed [m].
Source: judgement: it shows after 20 to 40 m.
"""
LATE = 0.05
"""
Change of the share from which results are held back then.
Source: derived: a drift of 0.1 m/s along the way that turns at 6 m/s is 0.033.
"""
AGAIN = 10.0
"""
Mean age of cells from which the vehicle counts as having come back [s].  Within a pass the
correction sets in over the age of the cells, sooner for a large one.
Source: measured: bench/studies/odometry_faults.py: 7 s within a pass at 6 m/s.
"""
SURELY = 4.0
"""Number of standard deviations that counts as certain.  Source: as SURELY of follower."""
TWICE = 2
"""Consecutive batches that must agree.  Source: judgement."""
TURNS, SHARED = 3, 2.0
"""
Fits whose turns are averaged, and by how much the variance of their mean is greater, as they are
of the same cells.
Source: measured: bench/flights/drawn_flights.py, ten flights: with a right heading up to 0.65 of
what counts, also where the odometry drifts or steps; one that drifts by 1 degree/s is found with
the third fit in nine, where two in turn that are certain each take up to 22.
"""


BACK = 6
"""
Fits to cells left meanwhile within which a turn of the heading counts.
Source: derived: 3.6 s, in which a drift by 0.05 degrees/s, seen twice as fast on the way back, is
less than half of TURNED.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Steady:
    """Corrections of stamps, positions, heading and mount that bring planes together."""

    values: Float64
    """
    (6,) time [s], scale error of positions, turn rate of the heading [rad/s], turn of the lidar
    about x, y and z of the vehicle [rad].
    """
    sigma: Float64
    """(6,) their standard deviations."""
    least: Float64
    """(6,) number of standard deviations that counts as certain."""
    speed: float
    """Of the lidar [m/s]."""

    @property
    def sure(self) -> Bool:
        """(6,) whether each is certainly not 0."""
        return np.abs(self.values) > self.least * self.sigma


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """State at the start of the map."""

    place: Float64
    """(3,) of the vehicle [m]."""
    shift: Float64
    """(3,) shift of its position then [m]."""


class SteadyErrors:
    """Distinguishes steady errors from the drift of a good odometry; not thread-safe."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Reset, with the odometry uncorrected."""
        self._flown = 0.0
        self._share = 0.0
        """Scale error with which the map was started."""
        self.doubt = ''
        """Why no results may be reported, '' if they may."""
        self._doubts = [0, 0]
        self._headings: deque[tuple[float, float]] = deque(maxlen=TURNS)
        """Headings by the last fits [rad], and one over their variances."""
        self._back: deque[tuple[float, float]] = deque(maxlen=BACK)
        """Headings by the last fits to cells left meanwhile [rad], and their variances."""
        self._turned = self._turns = False
        """Whether the mount is in doubt, or the heading."""
        self._planes: Steady | None = None
        self._heard: Steady | None = None
        self._ways = np.zeros(NUM_TURNS)
        """The way in which each of heading and mount was certainly wrong by the last estimate."""
        self.step()

    def give_up(self) -> None:
        """Reset, as the map starts anew; a heading that turned is not known to have stopped."""
        doubt = self.doubt if self._turns else ''
        self.clear()
        self.doubt, self._turns = doubt, bool(doubt)

    def hear(self, planes: Steady | None) -> None:
        """
        Take the estimate by planes, or None; its scale is unusable if the heading turns.

        Heading and mount are doubted where consecutive estimates agree: over slopes and few
        planes one of a good flight may be certain of what the next one takes back.
        """
        if planes is self._heard:
            return
        self._planes = self._heard = planes
        before, self._ways = self._ways, np.zeros(NUM_TURNS)
        if planes is None:
            return
        if planes.sure[2] and abs(planes.values[2]) > TURNING:
            self._planes = None
            self._ways[0] = np.sign(planes.values[2])
            if self._ways[0] == before[0]:
                self._doubt_heading(f'{abs(np.degrees(planes.values[2])):.1f} degrees/s')
            return  # what it turned by is no mount
        turns = planes.values[3:]
        least = max(MOUNTED, MOST_DRIFT / max(planes.speed, 1e-3))
        self._ways[1:] = np.where(
            planes.sure[3:] & (np.abs(turns) > least), np.sign(turns), 0.0
        )
        wrong = (self._ways[1:] != 0.0) & (self._ways[1:] == before[1:])
        if wrong.any() and not self._turned:
            told = ', '.join(
                f'{np.degrees(turns[axis]):.1f} degrees of {AXES[axis]}'
                for axis in np.flatnonzero(wrong)
            )
            self._hold(
                f'planes lie together with the lidar turned by {told}: results are held back; '
                'check mount (input.lidar_rpy_deg, /tf_static), and what tells the heading'
            )
            self._turned = True

    def _hold(self, doubt: str) -> None:
        """Hold results back; what a wrong mount does to the rest tells nothing more."""
        if not self._turned:
            self.doubt = doubt

    def step(self) -> None:
        """Take position and heading of the vehicle anew, as after a step."""
        self._start: _Start | None = None
        self._yaw: tuple[float, float] | None = None
        """Heading that others are compared with [rad], and its variance."""
        self._headings.clear()
        self._back.clear()

    def begin(self, tracked: DriftFilter, place: Float64) -> None:
        """Store position (3,) and correction of the vehicle at the start of the map."""
        move = tracked.move.about(place)
        if self._start is None:
            self._start = _Start(np.array(place), move.shift)

    def judge_heading(self, fit: Fit, free: Fit) -> None:
        """Judge the heading by a fit, and by one for which nothing was known of it."""
        yaw, variance = free.move.yaw, float(free.covariance[3, 3])
        if self._yaw is None:
            self._yaw = fit.move.yaw, 0.0
        if (fit.age > AGAIN) != bool(self._back):
            self._headings.clear()
        if fit.age > AGAIN:  # cells left meanwhile show slow drift as well: seconds are judged
            self._back.append((yaw, variance))
            self._yaw = self._back[0]
        elif self._back:
            self._yaw = self._back[-1][0], 0.0
            self._back.clear()
        self._headings.append((yaw, 1.0 / variance))
        if len(self._headings) < TURNS:
            return
        headings, sure = np.array(self._headings).T
        turned = abs((headings - self._yaw[0]) @ sure) / sure.sum()
        sigma = math.sqrt(SHARED / sure.sum() + self._yaw[1])
        if turned > max(TURNED, SURELY * sigma):
            self._doubt_heading(f'{np.degrees(turned):.1f} degrees and more')

    def _doubt_heading(self, size: str) -> None:
        self._turns = True
        self._hold(
            f'the heading of the odometry drifts against its positions, by {size}: results are '
            'held back; check what tells the heading'
        )

    def judge_way(self, tracked: DriftFilter, way: float, place: Float64) -> str:
        """
        Correct the filter if positions are certainly too long or too short.

        Parameters
        ----------
        tracked : DriftFilter
            Set to its state with positions correct from the start.
        way : float
            Distance flown since the last call [m].
        place : Float64
            (3,) of the vehicle in the odometry's frame [m].

        Returns
        -------
        str
            The error, '' if the map can stay.

        """
        self._flown += way
        share, sigma, surely = self._measure_share(tracked)
        aside, aside_sigma = tracked.measure_aside()
        wrong = aside > max(ASIDE, SURELY * aside_sigma)
        self._doubts[1] = self._doubts[1] + 1 if wrong else 0
        if self._doubts[1] >= TWICE:
            self._hold(
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
            self._hold(
                f'{_tell_share(share - self._share)}, otherwise than before: results are held '
                'back; check the odometry'
            )
            return ''
        shift = self._start.shift + share * (place - self._start.place)
        tracked.begin_anew(shift, share, sigma)
        self._share, self._doubts[0] = share, 0
        return _tell_share(share)

    def _measure_share(self, tracked: DriftFilter) -> tuple[float, float, float]:
        """Return scale error, standard deviation and certainty limit of the better estimate."""
        share, sigma = tracked.measure_share()
        planes = self._planes
        if planes is None or planes.sigma[1] >= sigma:
            # it was found in a smeared map, so it may be off still
            return share, float(np.hypot(sigma, SCALE)), SURELY * sigma
        own = float(planes.sigma[1])
        return float(planes.values[1]), own, float(planes.least[1]) * own


def _tell_share(share: float) -> str:
    """Return a text of the scale error; ``share`` is the correction."""
    off = 100.0 * (1.0 / (1.0 + share) - 1.0)
    which = 'long' if off > 0 else 'short'
    return f'the positions of the odometry are about {abs(off):.0f} % too {which}'
