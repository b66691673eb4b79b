# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Levels that fall late: an alarm at its limit stands, where it would begin anew with each gust.

A level rises at once, whatever was before; only its fall waits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from plc_inspect.core.live.proximity import Level, Proximity, Thing
from plc_inspect.node_config import ProximitySettings
from plc_inspect.results import Float64

MARGIN = 1.0
"""
A level falls only where the distance is beyond its limit by more than this [m].
Source: derived: twice 0.3 m, within which 95 of 100 distances are to be told
(bench/live/proximity.py), once too short and once too long, and as much again for a vehicle that
hovers, rounded.
"""
HOLD_NS = 2_000_000_000
"""
And only after it was so all this time [ns].
Source: derived: two ticks of the node, so that a conductor which one of them does not find ends
no alarm.
"""


@dataclass(slots=True)
class _Held:
    """The level that a thing is told with."""

    level: Level
    last_ns: int
    """Stamp at which it was last within the margin of the level."""
    item: Proximity
    """As it was then."""


class HeldLevels:
    """The levels of all things as they are told; for one thread."""

    def __init__(self) -> None:
        self._held: dict[Thing, _Held] = {}
        self._stamp_ns = 0

    def hold(
        self, found: Sequence[Proximity], stamp_ns: int, vehicle: Float64,
        settings: ProximitySettings,
    ) -> tuple[Proximity, ...]:
        """
        Return what is near, with levels that fall late.

        Parameters
        ----------
        found : sequence of Proximity
            As measured now.
        stamp_ns : int
            Of the pose; where it goes back, what was held is forgotten [ns].
        vehicle : (3,) float64
            Where the vehicle is, in the frame of the positions [m]; NaN where nobody knows.
        settings : ProximitySettings
            Distances of the levels.

        Returns
        -------
        tuple of Proximity
            No level is lower than measured.  While a level waits to fall, the place at which it
            was last within the margin is told where that is nearer than what is known now.

        """
        if stamp_ns < self._stamp_ns:
            self._held.clear()
        self._stamp_ns = stamp_ns
        return tuple(self._hold_one(item, stamp_ns, vehicle, settings) for item in found)

    def _hold_one(
        self, item: Proximity, stamp_ns: int, vehicle: Float64, settings: ProximitySettings
    ) -> Proximity:
        held = self._held.get(item.thing)
        if item.level >= Level.WARNING and (held is None or item.level >= held.level):
            self._held[item.thing] = _Held(item.level, stamp_ns, item)
            return item
        if held is None:
            return item
        limits = {Level.CRITICAL: settings.critical, Level.WARNING: settings.warning}
        if item.distance <= limits[held.level] + MARGIN:  # not where it is NaN
            held.item, held.last_ns = item, stamp_ns
            return replace(item, level=held.level)
        if stamp_ns - held.last_ns >= HOLD_NS:
            return self._lower(item, stamp_ns, settings)
        apart = float(np.linalg.norm(held.item.position - vehicle))
        if item.distance <= apart or math.isnan(apart):
            return replace(item, level=held.level)
        return replace(
            held.item, level=held.level, distance=apart, closest=math.nan, closest_in=math.nan
        )

    def _lower(
        self, item: Proximity, stamp_ns: int, settings: ProximitySettings
    ) -> Proximity:
        """Let a level fall to the next that holds."""
        was = self._held.pop(item.thing).level
        if was == Level.CRITICAL and item.distance <= settings.warning + MARGIN:
            item = replace(item, level=Level.WARNING)
            self._held[item.thing] = _Held(Level.WARNING, stamp_ns, item)
        return item
