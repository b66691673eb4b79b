# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What seemed to be a step is none where the vehicle turned and what is seen agrees."""

import numpy as np
import pytest

from plc_inspect.core.alignment.pending_break import PendingBreak
from plc_inspect.core.alignment.pose_watch import Break, Oddity
from plc_inspect.core.alignment.rigid_move import RigidMove

TURN_NS = 20_000_000


def turn_at_once(step=0.0):
    """Fly one way at 8 m/s, then the other, with a step of the odometry [m] in between."""
    found = Break(
        oddity=Oddity.STEP, before_ns=0, after_ns=TURN_NS, size=0.2 + step, turn=0.0,
        move=RigidMove(np.array([0.2 + step, 0.0, 0.0])), sigma=0.02,
        velocity=np.array([8.0, 0.0, 0.0]),
    )
    pending = PendingBreak.begin(found)
    pending.judge(np.array([-8.0, 0.0, 0.0]))
    return pending


@pytest.mark.parametrize(('off', 'sigma', 'yaw', 'none'), [
    (0.04, 0.001, 0.0, True), (0.08, 0.07, 0.0, True), (0.08, 0.02, 0.0, False),
    (0.2, 0.07, 0.0, False), (0.04, 0.07, 0.02, False),
])
def test_what_is_seen_must_surely_lie_elsewhere(off, sigma, yaw, none):
    spread = np.diag([sigma**2, 1.0, 1.0, 1e-6])  # well known along the way alone
    after = RigidMove(np.array([off, 0.0, 0.0]), yaw)
    assert turn_at_once().was_none(RigidMove(), after, spread) is none


def test_a_step_that_the_turn_does_not_explain_is_one():
    spread = np.diag([0.07**2] * 3 + [1e-6])
    assert not turn_at_once(0.3).was_none(RigidMove(), RigidMove(), spread)
