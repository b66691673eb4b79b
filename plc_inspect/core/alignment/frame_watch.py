# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames of the poses: those of the first pose, until for a while all poses have others."""

from dataclasses import dataclass

from plc_inspect.results import Float64

FOLLOW_NS = 500_000_000
"""
Time after which poses that all have other frames are accepted [ns].
Source: judgement: half of what scans wait for poses by default (input.max_wait).
"""
FOLLOW_POSES = 4
"""Least number of such poses.  Source: judgement: two odometries on a topic take turns."""
MOST_POSES = 1000
"""Most poses kept meanwhile.  Source: numerical: half a second at 1 kHz."""


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
    """Passes on poses whose frames are those of the poses before."""

    def __init__(self) -> None:
        self.frames: tuple[str, str] | None = None
        """Of the odometry, and of the base; None before the first pose."""
        self._others: list[FramedPose] = []

    def clear(self) -> None:
        """Reset; the next pose sets the frames."""
        self.frames = None
        self._others.clear()

    def judge(self, pose: FramedPose) -> list[FramedPose]:
        """Return the poses to use now, in order; a pose in ``frames`` is returned at once."""
        if self.frames is None or pose.frames == self.frames:
            self._others.clear()
            return [pose]
        if self._others and (
            self._others[-1].frames != pose.frames
            or pose.stamp_ns < self._others[0].stamp_ns  # time went back
        ):
            self._others.clear()
        self._others.append(pose)
        seconds = pose.stamp_ns - self._others[0].stamp_ns
        if seconds < FOLLOW_NS or len(self._others) < FOLLOW_POSES:
            del self._others[:-MOST_POSES]
            return []
        taken, self._others = self._others, []
        return taken
