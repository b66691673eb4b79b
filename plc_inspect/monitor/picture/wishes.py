# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is to be subscribed to anew, so that the node sends it again, and when."""

import math

PATIENCE = 5.0
"""What is missing is asked for at most this often [s]."""
OVERTAKEN = 0.3
"""What was overtaken may come so much later [s], and counts as reordered; then it is asked for."""
CLOUD_PATIENCE = 10.0
"""
The corridor is asked for anew at most this often [s]: the node sends all of it once more.
Source: derived: over 256 kbit/s a new subscription takes one to two seconds to be known.
"""


class Wishes:
    """What is asked for; for one thread.  All times are steady [s]."""

    def __init__(self) -> None:
        self._due: dict[str, float] = {}
        self._asked, self._fresh = -math.inf, False

    def want_summary(self, due: float) -> None:
        """Ask for the summary then, if it is not asked for yet."""
        self._due.setdefault('summary', due)

    def has_summary(self) -> None:
        """Ask for the summary no more."""
        self._due.pop('summary', None)

    def want_cloud(self, due: float) -> bool:
        """Ask for the corridor then, or when it may be asked for again; False if it already is."""
        if 'cloud' in self._due:
            return False
        self._due['cloud'] = max(due, self._asked + CLOUD_PATIENCE)
        return True

    def take(self, now: float) -> set[str]:
        """Return what is to be asked for now, of 'summary' and 'cloud'."""
        due = {name for name, since in self._due.items() if now >= since}
        if 'summary' in due:
            self._due['summary'] = now + PATIENCE
        if 'cloud' in due:
            del self._due['cloud']
            self._asked, self._fresh = now, True
        return due

    def begin_cloud(self) -> bool:
        """Tell whether what comes of the corridor is the first since it was asked for."""
        fresh, self._fresh = self._fresh, False
        return fresh
