# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A break of the odometry under examination, with breaks that follow meanwhile."""

from dataclasses import dataclass

import numpy as np

from plc_inspect.core.alignment.pose_watch import Break, Oddity
from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.results import Float64


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

    @classmethod
    def begin(cls, found: Break) -> 'PendingBreak':
        """Return a pending break that holds one break."""
        return cls(
            found.describe(), found.after_ns, found.oddity is Oddity.STEP, found.size,
            found.sigma, found.move,
        )

    def add(self, found: Break, place: Float64) -> None:
        """Add a break, after which the vehicle is at a position (3,) [m]."""
        self.total = self.total.after(found.move)
        self.sigma = float(np.hypot(self.sigma, found.sigma))
        self.quick = self.quick and found.oddity is Oddity.STEP
        self.size = float(np.linalg.norm(self.total.about(place).shift))
        self.begin_ns = found.after_ns
