# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Warnings that do not fill the log."""

from collections.abc import Callable
import time

from plc_inspect.printable import make_printable

THROTTLE = 5.0
"""The same complaint is logged at most this often [s]."""


class Complaints:
    """
    Warnings, the same one not too often.

    Parameters
    ----------
    say : callable
        Takes a line of text.

    """

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self._last: dict[str, float] = {}

    def complain(self, topic: str, text: str) -> None:
        """Log a warning unless one of the same topic was logged within THROTTLE."""
        now = time.monotonic()
        if now - self._last.get(topic, -THROTTLE) >= THROTTLE:
            self._last[topic] = now
            self._say(make_printable(text))

    def forget(self) -> None:
        """Log the next complaint of every topic."""
        self._last.clear()
