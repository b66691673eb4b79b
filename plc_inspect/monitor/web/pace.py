# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How much may be on its way to a browser, so that what is urgent never waits behind it for long.

The browser answers each message of many bytes, and so tells the rate at which link and browser
take them.  As BBR does (Cardwell et al. 2016), as much is sent ahead as they take in the shortest
time of an answer, and a little more: a link that is full, and a browser that is busy, show alike.
"""

from collections import deque
import math

LEAST_WINDOW, MOST_WINDOW = 4_096, 1 << 20
"""
Bytes on their way, unanswered.
Source: derivation: the least is an eighth of a second at 256 kbit/s; the greatest keeps 100 Mbit/s
busy over 80 ms.
"""
AHEAD = 0.2
"""
What is urgent waits so long for what was sent ahead of it [s].
Source: derivation: an alarm has one second from the node's message to the screen, of which the
link, its losses and the period of the page take up to 0.7 s.
"""
RATE_FOR = 5.0
"""The greatest rate of so long counts [s].  Source: judgement: ten answers of a slow link."""


class Pace:
    """The pace at which one browser gets what is not urgent."""

    def __init__(self) -> None:
        self.window = LEAST_WINDOW
        self._waiting: deque[tuple[int, float, int]] = deque()
        self._on_way = self._answered = 0
        self._quickest = math.inf
        self._rates: deque[tuple[float, float]] = deque()

    @property
    def room(self) -> int:
        """Bytes that may be sent now."""
        return self.window - self._on_way

    def send(self, size: int, now: float) -> None:
        """Note that a message of so many bytes is sent."""
        self._waiting.append((size, now, self._answered))
        self._on_way += size

    def answer(self, now: float) -> None:
        """Note that the browser has the oldest message."""
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
