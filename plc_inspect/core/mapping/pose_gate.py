# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks poses before they are used: frames, repeated positions, coarse positions."""

import numpy as np

from plc_inspect.config import InputSettings
from plc_inspect.core.alignment.coarse_positions import CoarsePositions
from plc_inspect.core.alignment.follower import Follower
from plc_inspect.core.alignment.frame_watch import FramedPose, FrameWatch
from plc_inspect.core.alignment.repeated_positions import RepeatedPositions
from plc_inspect.core.mapping.pose_buffer import Bracket, PoseBuffer
from plc_inspect.core.numerics.arrays import MOST_COORDINATE

Z_DOWN = ('ned', 'frd')
"""
Last words of the names of frames whose z points down.
Source: REP-147 and MAVROS: north east down, front right down.
"""

LEAST_REFUSED = 2
"""
Poses refused for their stamps before one that jumps, which show a clock set back, and no step.
Source: derived: where each pose comes twice, it is one.
"""


class PoseGate:
    """
    Passes usable poses on, in order; owned by one thread.

    Parameters
    ----------
    settings : InputSettings
        As for ``RepeatedPositions``.

    """

    def __init__(self, settings: InputSettings) -> None:
        self._frames = FrameWatch()
        self._repeats = RepeatedPositions(settings)
        self._coarse = CoarsePositions()

    def configure(self, settings: InputSettings) -> None:
        """Use other settings from now on."""
        self._repeats.configure(settings)

    @property
    def frames(self) -> tuple[str, str] | None:
        """Frames of the odometry and of the base; None before the first pose."""
        return self._frames.frames

    @frames.setter
    def frames(self, frames: tuple[str, str] | None) -> None:
        self._frames.frames = frames

    @property
    def doubt(self) -> str:
        """Why no result may be reported, '' if one may."""
        return self._coarse.doubt or _doubt_axes(self.frames)

    def describe(self) -> str:
        """Describe what is odd about the poses, '' if nothing."""
        return self._repeats.describe()

    def forget_times(self) -> None:
        """Forget the poses seen, as after time went back; keep the frames."""
        self._repeats.clear()
        self._coarse.clear()

    def clear(self) -> None:
        """Forget poses and frames: accept any next pose."""
        self.forget_times()
        self._frames.clear()

    def judge(self, pose: FramedPose) -> list[FramedPose] | None:
        """Return the poses to use now, in order; None if this one is refused."""
        known = self._frames.judge(pose)
        for item in known:
            self._coarse.see(item.position)
        return [item for own in known for item in self._repeats.judge(own)] if known else None

    def release(self) -> list[FramedPose]:
        """Return the poses that are still held back."""
        return self._repeats.release()


def _doubt_axes(frames: tuple[str, str] | None) -> str:
    if frames is None:
        return ''
    words = ''.join(mark if mark.isalpha() else ' ' for mark in frames[0].lower()).split()
    if not words or words[-1] not in Z_DOWN:
        return ''
    return (
        f'the map frame {frames[0]} has z down by its name: results are held back; give poses in'
        ' a frame with z up (REP-103), as odom of MAVROS in place of odom_ned'
    )


def break_odd(poses: PoseBuffer, follower: Follower) -> bool:
    """
    Forbid interpolation up to the newest pose if it jumped or the odometry froze.

    Where poses were refused right before a jump, the clock was set back, by less than it takes to
    be sure by the stamps alone: the poses are forgotten, and True is returned.
    """
    known = poses.arrays()
    position = known.positions[-1]
    if np.abs(position).max() >= MOST_COORDINATE:
        return False
    found = follower.see_pose(int(known.stamps[-1]), position, known.quaternions[-1])
    frozen = follower.watch.frozen
    if not frozen and found is not None and poses.num_refused >= LEAST_REFUSED:
        poses.restart()
        return True
    if frozen or found is not None:
        after = None if found is None else found.before_ns
        poses.break_last(Bracket.FROZEN if frozen else Bracket.JUMP, after)
    return False
