# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Inserts placed scans into the map, and begins the map anew where it has to."""

from collections.abc import Callable

import numpy as np

from plc_inspect.config import MapSettings
from plc_inspect.core.alignment.parts import Seen
from plc_inspect.core.mapping.near_returns import NearReturns
from plc_inspect.core.numerics.arrays import MOST_COORDINATE
from plc_inspect.core.setup.looks import SharpnessMeter
from plc_inspect.core.voxel_buffer.voxel_map import Insertion, VoxelMap
from plc_inspect.errors import DataError

RESTART_AFTER_NS = 3_000_000_000
"""
Time for which all scans lie out of the map's reach before it begins anew there [ns].
Source: judgement; not measured.
"""


class MapEntry:
    """The map and how sharp it is; owned by one thread."""

    def __init__(self, settings: MapSettings) -> None:
        self.map = VoxelMap(settings)
        self.meter = SharpnessMeter()
        """Measures how sharp the map is."""
        self.near = NearReturns()
        """What came from near the vehicle last."""
        self.num_restarts = 0
        """Times the map began anew."""
        self.cause = ''
        """Why it last began anew."""
        self.on_end: Callable[[str], object] = lambda cause: None
        """Called with the cause before a map is forgotten that was right."""
        self._beyond_since: int | None = None

    def forget_times(self) -> None:
        """Forget how long scans have been out of reach."""
        self._beyond_since = None

    def clear(self) -> None:
        """Forget everything in the map."""
        self.map.clear()
        self.meter.clear()
        self.near.clear()
        self._beyond_since = None

    def begin_anew(self, cause: str, *, holds: bool) -> None:
        """Forget everything in the map, and count it; ``holds``: the map was right as it was."""
        if holds and len(self.map):
            self.on_end(cause)
        self.clear()
        self.num_restarts += 1
        self.cause = cause

    def enter(self, scan: Seen) -> Insertion | None:
        """Insert a scan in the map frame; return None if it lies out of reach."""
        try:
            found = self.map.insert(scan.points)
        except DataError:
            return None
        self._beyond_since = None
        self.meter.add(scan.points, scan.stamps, scan.apart)
        self.near.add(scan, found.sequence, self.map.cells)
        return found

    def is_away(self, scan: Seen) -> bool:
        """Tell whether scans have been out of reach long enough to begin the map anew."""
        if self._beyond_since is None or scan.stamp_ns < self._beyond_since:
            self._beyond_since = scan.stamp_ns
        reached = np.abs(scan.points).max(initial=0.0) < MOST_COORDINATE
        return bool(scan.stamp_ns - self._beyond_since >= RESTART_AFTER_NS and reached)
