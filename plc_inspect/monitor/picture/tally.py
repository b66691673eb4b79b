# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What came in and what did not, counted."""

from collections import deque
from dataclasses import replace
import math

from plc_inspect.monitor.picture.admission import Judgement, REFUSAL_PERIOD, REFUSALS, Verdict
from plc_inspect.monitor.picture.picture import Counts

RATE_WINDOW = 10.0
"""Over which the rate of the stream is told [s]."""


class Tally:
    """Counts of messages; for one thread.  All times are steady [s]."""

    def __init__(self) -> None:
        self._counts = Counts()
        self._traffic: deque[tuple[float, int]] = deque()
        self._refused_at: dict[str, float] = {}

    def read(self, now: float) -> Counts:
        """Return the counts, with the rate of the last seconds."""
        while self._traffic and now - self._traffic[0][0] > RATE_WINDOW:
            self._traffic.popleft()
        return replace(
            self._counts, kbps=sum(size for _, size in self._traffic) * 8e-3 / RATE_WINDOW
        )

    def note(self, size: int, now: float) -> None:
        """Count a message of so many bytes, whatever becomes of it."""
        self._traffic.append((now, size))
        self.add('messages')
        self.add('bytes', size)

    def add(self, name: str, count: int = 1) -> None:
        """Count more of one of the Counts."""
        self._counts = replace(self._counts, **{name: getattr(self._counts, name) + count})

    def refuse(self, judgement: Judgement, now: float) -> str:
        """Count a message that is not used; return what is to be told of it, '' nothing now."""
        if judgement.verdict is Verdict.KEPT:
            return ''
        name = judgement.verdict.value
        self.add(name)
        if now - self._refused_at.get(name, -math.inf) < REFUSAL_PERIOD:
            return ''
        self._refused_at[name] = now
        return f'{REFUSALS[name]}: {getattr(self._counts, name)} so far'
