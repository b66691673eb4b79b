# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of stages, kept for further runs over the same points with other settings."""

from collections import OrderedDict
from collections.abc import Hashable
import threading
from typing import Any


class StageMemory:
    """
    The newest results of each stage, by the settings they depend on.

    For one cloud only: the points are no part of a key.  May be shared by threads.
    """

    def __init__(self, room: int = 2) -> None:
        """Keep up to ``room`` results of each stage; the one unused for longest goes first."""
        self._room = room
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}
        self._lock = threading.Lock()
        self.num_found: dict[str, int] = {}
        """Results that were taken from here, by stage."""

    def find(self, stage: str, key: Hashable) -> Any:
        """Return what was kept, None if there is nothing."""
        with self._lock:
            kept = self._kept.get(stage, OrderedDict())
            if key not in kept:
                return None
            kept.move_to_end(key)
            self.num_found[stage] = self.num_found.get(stage, 0) + 1
            return kept[key]

    def keep(self, stage: str, key: Hashable, result: Any) -> None:
        """Keep a result."""
        with self._lock:
            kept = self._kept.setdefault(stage, OrderedDict())
            kept[key] = result
            kept.move_to_end(key)
            while len(kept) > self._room:
                kept.popitem(last=False)
