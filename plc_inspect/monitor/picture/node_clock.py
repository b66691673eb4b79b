# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's steady time, estimated from the quickest messages."""

import math

DRIFT = 1e-4
"""Greatest relative drift of two steady clocks."""


class NodeClock:
    """
    Estimates the node's time, for ages that include the transmission delay.

    Each message holds the node's time of sending.  The quickest message gives the best estimate of
    the node's present time, so that messages delayed in a queue do not make old data look new.
    """

    def __init__(self) -> None:
        self._offset = -math.inf
        self._at = 0.0
        self.delay = 0.0
        """Delay of the last message over the quickest one [s]."""

    def hear(self, uptime: float, now: float) -> None:
        """Note a message that the node sent at ``uptime`` and that arrived ``now`` [s]."""
        expected = self._offset - DRIFT * (now - self._at)
        self._offset, self._at = max(expected, uptime - now), now
        self.delay = self._offset - (uptime - now)

    def measure_age(self, uptime: float, now: float) -> float:
        """Return the age of a time of the node [s], NaN unknown."""
        if math.isinf(self._offset) or math.isnan(uptime):
            return math.nan
        return max(0.0, now + self._offset - uptime)
