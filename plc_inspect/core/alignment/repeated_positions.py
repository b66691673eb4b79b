# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Positions repeated until the next one is known, such as GNSS at 10 Hz in poses at 50 Hz.

They must not look like a standstill followed by a step: poses between two changes wait for the
second one, and their positions are interpolated.  Orientations are kept.
"""

from collections import deque
from dataclasses import replace
import math

import numpy as np

from plc_inspect.config import InputSettings
from plc_inspect.core.alignment.frame_watch import FramedPose

REMEMBERED = 20
"""Position changes over which repetition is judged.  Source: judgement: 2 s at 10 Hz."""
LEAST_CHANGES = 8
"""Least number of changes to judge it.  Source: derived: 2 s at 5 Hz."""
LEAST_SHARE = 0.5
"""
Least share of changes after repetitions for positions to count as repeated.
Source: judgement.
"""


class RepeatedPositions:
    """
    Passes on poses; those with a repeated position wait until the next position is known.

    A position that lasts longer than ``max_pose_gap``, or is followed by a jump faster than
    ``max_speed``, is passed on unchanged.

    Parameters
    ----------
    settings : InputSettings
        ``max_pose_gap`` and ``max_speed`` are used.

    """

    def __init__(self, settings: InputSettings) -> None:
        self.configure(settings)
        self.clear()

    def configure(self, settings: InputSettings) -> None:
        """Set gap and speed."""
        self._most_ns = round(settings.max_pose_gap * 1e9)
        self._max_speed = settings.max_speed

    def clear(self) -> None:
        """Reset."""
        self._last: FramedPose | None = None
        """First pose with the present position."""
        self._held: list[FramedPose] = []
        self._stands = True  # as before take-off, until it moves
        self._runs: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)
        """Repetitions before each change, and time since the change before [s]."""

    def judge(self, pose: FramedPose) -> list[FramedPose]:
        """Return the poses to use now, in order."""
        last = self._last
        newest = self._held[-1] if self._held else last
        if not np.isfinite(pose.position).all():
            return [pose]  # whoever takes it refuses it
        if last is None or newest is None:
            self._last = pose
            return [pose]
        if pose.stamp_ns <= last.stamp_ns:
            return [pose]  # out of order, or time went back: whoever takes it judges that
        if pose.stamp_ns <= newest.stamp_ns:
            # taken now, it would make late what waits: one that is refused stands for it
            return [last]
        if pose.frames != last.frames:
            return self._go_on(pose)
        if (pose.position == last.position).all():
            if self._stands or pose.stamp_ns - last.stamp_ns > self._most_ns:
                self._stands = True
                return [*self.release(), pose]
            self._held.append(pose)
            return []
        seconds = (pose.stamp_ns - last.stamp_ns) * 1e-9
        if not self._stands:
            self._runs.append((len(self._held), seconds))
        if self._held and math.dist(pose.position, last.position) <= self._max_speed * seconds:
            self._held = [_place_between(last, item, pose) for item in self._held]
        return self._go_on(pose)

    def _go_on(self, pose: FramedPose) -> list[FramedPose]:
        self._last, self._stands = pose, False
        return [*self.release(), pose]

    def release(self) -> list[FramedPose]:
        """Return the waiting poses unchanged."""
        held, self._held = self._held, []
        return held

    def describe(self) -> str:
        """Return a text if positions are repeated, '' otherwise."""
        repeated = [run for run in self._runs if run[0]]
        if len(repeated) < max(LEAST_CHANGES, LEAST_SHARE * len(self._runs)):
            return ''
        seconds = float(np.median([run[1] for run in repeated]))
        number = float(np.median([run[0] for run in repeated]))
        return (
            f'positions of the odometry are new {1.0 / seconds:.0f} times a second, and told '
            f'{(number + 1.0) / seconds:.0f} times: those between are interpolated'
        )


def _place_between(first: FramedPose, pose: FramedPose, last: FramedPose) -> FramedPose:
    share = (pose.stamp_ns - first.stamp_ns) / (last.stamp_ns - first.stamp_ns)
    return replace(pose, position=first.position + share * (last.position - first.position))
