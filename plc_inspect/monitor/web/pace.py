# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Congestion control of one browser: limits the data in flight, so that alarms never queue for long.

The browser acknowledges each large message, which measures the rate of link and browser together.
As in BBR (Cardwell et al. 2016), the data in flight are the greatest rate times the shortest round
trip, and a little more.  A full link and a busy browser have the same effect.
"""

from collections import deque
import math

LEAST_WINDOW, MOST_WINDOW = 4_096, 1 << 20
"""
Least and greatest number of unacknowledged bytes.
Source: derivation: the least is an eighth of a second at 256 kbit/s; the greatest keeps 100 Mbit/s
busy over 80 ms.
"""
AHEAD = 0.2
"""
Longest wait of an urgent message behind data in flight [s].
Source: derivation: an alarm has one second from the node's message to the screen, of which the
link, its losses and the period of the page take up to 0.7 s.
"""
RATE_FOR = 5.0
"""
Window over which the greatest rate is taken [s].
Source: judgement: ten answers of a slow link.
"""


class Pace:
    """Limits what one browser is sent that is not urgent."""

    def __init__(self) -> None:
        self.window = LEAST_WINDOW
        self._waiting: deque[tuple[int, float, int]] = deque()
        self._on_way = self._answered = 0
        self._quickest = math.inf
        self._rates: deque[tuple[float, float]] = deque()

    @property
    def room(self) -> int:
        """Number of bytes that may be sent now."""
        return self.window - self._on_way

    def send(self, size: int, now: float) -> None:
        """Note that a message of ``size`` bytes is sent."""
        self._waiting.append((size, now, self._answered))
        self._on_way += size

    def answer(self, now: float) -> None:
        """Note that the browser acknowledged the oldest message."""
        if not self._waiting:
            return  # it says more than it was told
        size, sent, before = self._waiting.popleft()
        self._on_way -= size
        self._answered += size
        spent = max(now - sent, 1e-4)
        self._quickest = min(self._quickest, spent)
        rate = (self._answered - before) / spent
        while self._rates and self._rates[-1][1] <= rate:
            self._rates.pop()  # what is older and smaller is never the greatest again
        self._rates.append((now, rate))
        while now - self._rates[0][0] > RATE_FOR:
            self._rates.popleft()
        wanted = self._rates[0][1] * (self._quickest + AHEAD)
        self.window = round(min(max(wanted, LEAST_WINDOW), MOST_WINDOW))
