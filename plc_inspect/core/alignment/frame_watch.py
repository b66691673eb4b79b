# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which frames poses are in: those of the first one, until all are in others for a while."""

from dataclasses import dataclass

from plc_inspect.results import Float64

FOLLOW_NS = 500_000_000
"""
Poses of other frames alone for this long are followed [ns].
Source: judgement: half of what scans wait for poses by default (input.max_wait).
"""
FOLLOW_POSES = 4
"""So many of them, at least.  Source: judgement: two odometries on a topic take turns."""
MOST_POSES = 1000
"""Poses that are kept meanwhile.  Source: numerical: half a second at 1 kHz."""


@dataclass(frozen=True, slots=True, eq=False)
class FramedPose:
    """A pose, and its frames."""

    stamp_ns: int
    position: Float64
    """(3,) [m]."""
    quaternion: Float64
    """(4,) x y z w."""
    frames: tuple[str, str]
    """Of the odometry, and of the base."""


class FrameWatch:
    """Lets poses through that are in the frames of those before."""

    def __init__(self) -> None:
        self.frames: tuple[str, str] | None = None
        """Of the odometry, and of the base; None before the first pose."""
        self._others: list[FramedPose] = []

    def clear(self) -> None:
        """Take the frames of the next pose."""
        self.frames = None
        self._others.clear()

    def judge(self, pose: FramedPose) -> list[FramedPose]:
        """Return the poses that are to be taken now, in order; those of ``frames`` at once."""
        if self.frames is None or pose.frames == self.frames:
            self._others.clear()
            return [pose]
        if self._others and self._others[-1].frames != pose.frames:
            self._others.clear()
        self._others.append(pose)
        seconds = pose.stamp_ns - self._others[0].stamp_ns
        if seconds < FOLLOW_NS or len(self._others) < FOLLOW_POSES:
            del self._others[:-MOST_POSES]
            return []
        taken, self._others = self._others, []
        return taken
