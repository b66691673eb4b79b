# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Alarms of messages that arrived before earlier ones.

A reliable link holds back all that follows a lost message until it is resent, which over a slow
link takes most of a second.  Messages are therefore also read as they arrive: these raise alarms
and clear none, until the same message, or a later one, arrives in order.
"""

from collections.abc import Mapping

from plc_inspect.monitor.picture.alarms import Cause


class Ahead:
    """Causes of alarms from messages that have not yet come in order; not thread-safe."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[int, Cause]] = {}

    @property
    def causes(self) -> dict[str, Cause]:
        """Causes of alarms, by key."""
        return {key: cause for key, (_, cause) in self._told.items()}

    def take(self, sequence: int, causes: Mapping[str, Cause]) -> None:
        """Add the causes of a message; the newest of each key counts."""
        for key, cause in causes.items():
            if key not in self._told or self._told[key][0] < sequence:
                self._told[key] = sequence, cause

    def reach(self, sequence: int) -> None:
        """Discard the causes of messages up to a number, which arrived in order or are lost."""
        self._told = {key: told for key, told in self._told.items() if told[0] > sequence}

    def clear(self) -> None:
        """Discard all, as the node restarted."""
        self._told.clear()
