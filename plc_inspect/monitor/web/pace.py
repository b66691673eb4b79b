# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Congestion control of one browser: limits the data in flight, so that alarms never queue for long.

A worker of the page acknowledges each large message, however long the page draws.  As in FAST TCP
(Jin et al. 2004), once per round trip the data in flight grow or shrink by the ratio of the wanted
time of an answer, the shortest ever and a little more, to the median seen.  After a lost packet
all that follows it is acknowledged at once, so messages are also spaced in time, or as many would
follow at once.
"""

from collections import deque
import math
import statistics

LEAST_WINDOW, MOST_WINDOW = 4_096, 1 << 20
"""
Least and greatest number of unacknowledged bytes.
Source: derivation: the least is an eighth of a second at 256 kbit/s; the greatest keeps 100 Mbit/s
busy over 80 ms.
"""
AHEAD, ANSWER = 0.15, 0.4
"""
Usual wait of an urgent message behind data in flight, and the time that an answer may take at
least, so that a near browser on a busy machine is not taken for a full link [s].
Source: derivation: with 2 % loss 9 of 10 wait less than 0.4 s (test_live.py); an alarm has a
second from the node's message to the screen, of which link and page take half.
"""
GROWTH = 2.0
"""
Greatest growth of the window in a round trip.
Source: derivation: as in the slow start of TCP.
"""
PIECES = 8
"""
Messages that fill the window.
Source: derivation: a message at 256 kbit/s is then less than 0.1 s of the link.
"""
HURRY = 1.25
"""
Rate at which messages may be sent, over the window in each wanted round trip.
Source: as the pacing of TCP in Linux beyond slow start: a little more, so that the window decides.
"""


class Pace:
    """Limits what one browser is sent that is not urgent."""

    def __init__(self) -> None:
        self.window = LEAST_WINDOW
        self._waiting: deque[tuple[int, float]] = deque()
        self._on_way = 0
        self._quickest, self._spent = math.inf, list[float]()
        self._since = self._next = -math.inf
        self._full = False

    @property
    def _wanted(self) -> float:
        """Time that an answer is to take [s]."""
        return max(self._quickest + AHEAD, ANSWER)

    @property
    def piece(self) -> int:
        """Number of bytes of a message."""
        return self.window // PIECES

    def wait(self, now: float) -> float:
        """Return the time until the next message may be sent [s], inf: not before an answer."""
        wait = max(self._next - now, 0.0) if self._on_way < self.window else math.inf
        self._full |= wait > 0.0
        return wait

    def send(self, size: int, now: float) -> None:
        """Note that a message of ``size`` bytes is sent."""
        self._waiting.append((size, now))
        self._on_way += size
        if math.isfinite(self._quickest):
            rate = HURRY * self.window / self._wanted
            self._next = max(self._next, now) + size / rate

    def answer(self, now: float) -> None:
        """Note that the browser acknowledged the oldest message."""
        if not self._waiting:
            return  # it says more than it was told
        size, sent = self._waiting.popleft()
        self._on_way -= size
        spent = max(now - sent, 1e-4)
        self._quickest = min(self._quickest, spent)
        if sent < self._since:
            return  # sent while the window was another
        self._spent.append(spent)
        if self._waiting and now - self._since < 2.0 * min(self._spent):
            return
        share = min(self._wanted / statistics.median(self._spent), GROWTH)
        if share < 1.0 or self._full:
            self.window = round(min(max(share * self.window, LEAST_WINDOW), MOST_WINDOW))
        self._since, self._full = now, False
        self._spent.clear()
