# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Poses in other frames are followed once there are enough of them."""

import numpy as np
import pytest

from plc_inspect.core.alignment.frame_watch import FOLLOW_NS, FOLLOW_POSES, FramedPose, FrameWatch

SECOND = 10**9


def make_pose(stamp_ns, frame):
    return FramedPose(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), (frame, 'base'))


@pytest.mark.parametrize('back', [False, True])
def test_another_frame_is_followed_also_where_time_goes_back(back):
    watch = FrameWatch()
    start = 1000 * SECOND
    watch.frames = ('odom', 'base')
    assert len(watch.judge(make_pose(start, 'odom'))) == 1
    assert watch.judge(make_pose(start + 1, 'map')) == []
    if back:
        start = SECOND
    step = 2 * FOLLOW_NS // FOLLOW_POSES
    taken = [watch.judge(make_pose(start + number * step, 'map'))
             for number in range(1, FOLLOW_POSES + 2)]
    assert any(taken)
