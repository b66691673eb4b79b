# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Requests for a resend: which topics to subscribe to anew, and when."""

import math

PATIENCE = 5.0
"""Least time between two requests for missing messages [s]."""
OVERTAKEN = 0.3
"""Time after which a missing message is requested [s]; until then it counts as reordered."""
CLOUD_PATIENCE = 10.0
"""
Least time between two requests for the corridor [s], as the node sends all of it again.
Source: derived: over 256 kbit/s the node learns of a new subscription after one to two seconds.
"""


class Wishes:
    """Pending requests; not thread-safe.  All times are steady [s]."""

    def __init__(self) -> None:
        self._due: dict[str, float] = {}
        self._asked, self._fresh = -math.inf, False

    def want_summary(self, due: float) -> None:
        """Request the summary at time ``due``, unless it is requested already."""
        self._due.setdefault('summary', due)

    def has_summary(self) -> None:
        """Cancel the request for the summary."""
        self._due.pop('summary', None)

    def want_cloud(self, due: float) -> bool:
        """Request the corridor at ``due``, or when next allowed; False if already requested."""
        if 'cloud' in self._due:
            return False
        self._due['cloud'] = max(due, self._asked + CLOUD_PATIENCE)
        return True

    def take(self, now: float) -> set[str]:
        """Return the requests due now, of 'summary' and 'cloud'."""
        due = {name for name, since in self._due.items() if now >= since}
        if 'summary' in due:
            self._due['summary'] = now + PATIENCE
        if 'cloud' in due:
            del self._due['cloud']
            self._asked, self._fresh = now, True
        return due

    def begin_cloud(self) -> bool:
        """Return whether this corridor message is the first since the request."""
        fresh, self._fresh = self._fresh, False
        return fresh
