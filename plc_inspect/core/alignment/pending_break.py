# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A break of the odometry under examination, with breaks that follow meanwhile."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.core.alignment.normal_cells import NormalCells
from plc_inspect.core.alignment.pose_watch import Break, LEAST_TURN, MOVING, Oddity
from plc_inspect.core.alignment.registration import Fit, fit_points
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.results import Float64

CLEARLY = 0.1
"""Least gain in the share that fits for a less likely position.  Source: judgement."""
LITTLE = 2.0
"""
Steps up to this are bridged by the motion alone if nothing is seen twice [m].
Source: judgement: a correction; what is greater may be another frame.
"""
SAME = 0.05
"""Steps that return to within this count as none [m].  Source: derived: the noise of a point."""
SAME_SIGMAS = 2.0
"""
Standard deviations by which what is seen must lie off where the odometry, which turned, has it.
Source: derived: as SURELY_AGAIN of the follower, to which a smaller error is left.
"""
UNSURE, STEADY = 0.5, 0.01
"""
Sigma of position after a break with unknown motion [m], of heading after any break [rad].
Source: judgement; not measured.
"""


@dataclass(slots=True, eq=False)
class PendingBreak:
    """A break under examination."""

    cause: str
    begin_ns: int
    quick: bool
    """The odometry stepped between two poses, so the motion predicts where the vehicle is."""
    size: float
    sigma: float
    total: RigidMove
    """From the newest odometry to that before the break."""
    first: Break | None
    """The break, until it was judged by the velocity after it, or another one follows."""

    @classmethod
    def begin(cls, found: Break) -> 'PendingBreak':
        """Return a pending break that holds one break."""
        return cls(
            found.describe(), found.after_ns, found.oddity is Oddity.STEP, found.size,
            found.sigma, found.move, found if found.oddity is Oddity.STEP else None,
        )

    def add(self, found: Break, place: Float64) -> None:
        """Add a break, after which the vehicle is at a position (3,) [m]."""
        self.total = self.total.after(found.move)
        self.sigma = float(np.hypot(self.sigma, found.sigma))
        self.quick = self.quick and found.oddity is Oddity.STEP
        self.size = float(np.linalg.norm(self.total.about(place).shift))
        self.begin_ns, self.first = found.after_ns, None

    def judge(self, velocity: Float64 | None) -> None:
        """
        Look at a step again, as the vehicle may have turned on the spot.

        Where it seems to stand at once it is as likely the odometry that does.

        Parameters
        ----------
        velocity : (3,) float64 or None
            Since the last break [m/s]; None as long as it is unknown.

        """
        if self.first is None or velocity is None:
            return
        if np.linalg.norm(velocity) >= MOVING:
            left = self.first.judge(velocity)
            self.total, self.size, self.sigma = left.move, left.size, left.sigma
            self.cause = left.describe()
        self.first = None

    @property
    def is_none(self) -> bool:
        """Whether the odometry has come back to where it was."""
        return self.quick and self.size < SAME

    def was_none(self, before: RigidMove, after: RigidMove, spread: Float64) -> bool:
        """
        Tell whether the vehicle turned, and what is seen agrees: the moves are the same.

        Given are those before and after it, and the (4, 4) covariance of the latter.
        """
        off = after.shift - before.about(after.centre).shift
        size = float(np.linalg.norm(off))
        way = off / max(size, 1e-9)
        sigma = float(np.sqrt(way @ spread[:3, :3] @ way))
        is_same = size < max(SAME, SAME_SIGMAS * sigma)
        return self.is_none and is_same and abs(after.yaw - before.yaw) <= LEAST_TURN

    @property
    def is_little(self) -> bool:
        """Whether the motion alone may bridge it."""
        return self.quick and self.size <= LITTLE

    @property
    def spread(self) -> Float64:
        """(4, 4) covariance of position [m2] and heading [rad2] by the motion."""
        return _spread(self.sigma)

    def register(
        self, cells: NormalCells, points: Float64, before: RigidMove, place: Float64, stamp: int
    ) -> Fit | None:
        """
        Register points that were seen after the break, from each place that is likely.

        Parameters
        ----------
        cells : NormalCells
            The reference.
        points : (N, 3) float64
            In the frame of the odometry as it is now [m].
        before : RigidMove
            Into the map, before the break.
        place : (3,) float64
            Of the vehicle, in the same frame [m].
        stamp : int
            Of the newest point [ns].

        Returns
        -------
        Fit or None
            None where no place is likely.

        """
        choices = [(before.after(self.total), self.sigma), (before, 2.0 * SAME)]
        if not self.quick:
            choices = [(before, UNSURE), *choices[:1]]
        best: Fit | None = None
        for move, sigma in choices:
            if sigma > LITTLE:
                continue
            fit = fit_points(
                cells, points, move.about(place), _spread(sigma), stamp, coarse=True
            )
            if best is None or fit.share > best.share + CLEARLY:
                best = fit
        return best


def _spread(sigma: float) -> Float64:
    result: Float64 = np.diag([sigma**2] * 3 + [STEADY**2])
    return result
