# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Counters of received and refused messages, and the rate of the stream."""

from collections import deque
from dataclasses import replace
import math

from plc_inspect.monitor.picture.admission import Judgement, REFUSAL_PERIOD, REFUSALS, Verdict
from plc_inspect.monitor.picture.picture import Counts

RATE_WINDOW = 10.0
"""Window of the rate of the stream [s]."""


class Tally:
    """Counts of messages; not thread-safe.  All times are steady [s]."""

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
        """Count a message of ``size`` bytes, used or refused."""
        self._traffic.append((now, size))
        self.add('messages')
        self.add('bytes', size)

    def add(self, name: str, count: int = 1) -> None:
        """Add to one of the Counts."""
        self._counts = replace(self._counts, **{name: getattr(self._counts, name) + count})

    def refuse(self, judgement: Judgement, now: float) -> str:
        """Count a refused message; return the text to report now, '' none."""
        if judgement.verdict is Verdict.KEPT:
            return ''
        name = judgement.verdict.value
        self.add(name)
        if now - self._refused_at.get(name, -math.inf) < REFUSAL_PERIOD:
            return ''
        self._refused_at[name] = now
        return f'{REFUSALS[name]}: {getattr(self._counts, name)} so far'
