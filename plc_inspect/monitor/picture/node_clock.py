# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's steady time, told from the messages that came quickest."""

import math

DRIFT = 1e-4
"""Two steady clocks run apart by less than this."""


class NodeClock:
    """
    Tells what time it is on the node, for ages that include the time on the way.

    Each message says the node's time when it was sent.  The quickest on the way says best what
    time it is there now; those that waited in a queue do not make old data look new.
    """

    def __init__(self) -> None:
        self._offset = -math.inf
        self._at = 0.0
        self.delay = 0.0
        """How much later than the quickest message the last one came [s]."""

    def hear(self, uptime: float, now: float) -> None:
        """Take note of a message that was sent at a time of the node and came in now [s]."""
        expected = self._offset - DRIFT * (now - self._at)
        self._offset, self._at = max(expected, uptime - now), now
        self.delay = self._offset - (uptime - now)

    def measure_age(self, uptime: float, now: float) -> float:
        """Return how long ago a time of the node was [s], NaN where that is not known."""
        if math.isinf(self._offset) or math.isnan(uptime):
            return math.nan
        return max(0.0, now + self._offset - uptime)
