# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Alarms of messages that are ahead of what came in order.

A reliable link holds back all that follows a lost message until that has come again, which over a
slow link takes most of a second.  What tells of an alarm is taken as it comes, beside that: it
raises alarms and clears none, and stands until its message, or a later one, comes in order.
"""

from collections.abc import Mapping

from plc_inspect.monitor.picture.alarms import Cause


class Ahead:
    """What raises alarms by messages that are not in yet; for one thread."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[int, Cause]] = {}

    @property
    def causes(self) -> dict[str, Cause]:
        """What raises alarms, by key."""
        return {key: cause for key, (_, cause) in self._told.items()}

    def take(self, sequence: int, causes: Mapping[str, Cause]) -> None:
        """Take what a message raises; of what was told before, the newest counts."""
        for key, cause in causes.items():
            if key not in self._told or self._told[key][0] < sequence:
                self._told[key] = sequence, cause

    def reach(self, sequence: int) -> None:
        """Forget what messages up to a number told: they are in, or are known to be lost."""
        self._told = {key: told for key, told in self._told.items() if told[0] > sequence}

    def clear(self) -> None:
        """Forget all: the node began anew."""
        self._told.clear()
