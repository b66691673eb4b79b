# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A token bucket: how much may be sent now, so that the stream stays within its rate."""

from collections.abc import Callable
import time

OVERHEAD = 220
"""What DDS, UDP and IP add to a message and its acknowledgement [bytes]; see docs/monitor.md."""


class Budget:
    """
    Bytes that may be sent.

    Parameters
    ----------
    rate : float
        Bytes a second.
    depth : float
        What may be saved up, in seconds of the rate.
    clock : callable
        Steady time [s].

    """

    def __init__(
        self, rate: float, depth: float = 1.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock = clock
        self._depth = depth
        self._last = clock()
        self.rate = rate
        self._balance = 0.0

    @property
    def balance(self) -> float:
        """Bytes that may be sent now; negative where too much was sent."""
        now = self._clock()
        self._balance += (now - self._last) * self.rate
        self._last = now
        self._balance = min(self._balance, self._depth * self.rate)
        return self._balance

    def spend(self, payload: int) -> None:
        """Take note of a message of so many bytes."""
        self._balance = self.balance - payload - OVERHEAD
