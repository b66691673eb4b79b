# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Period of scan stamps, missing scans, clocks set back, and the time that scans have waited."""

from collections import deque
from statistics import median

WINDOW = 31
"""Periods over which the median is taken.  Source: judgement; not measured."""
MIN_PERIODS = 5
"""Least number of periods to judge a gap by.  Source: judgement; not measured."""
MAX_LOST_TIME = 5.0
"""
Longest gap that counts as lost scans; longer ones are interruptions or wrong stamps [s].
Source: judgement; not measured.
"""
GAP = 1.5
"""
Longest step between scans that is no gap, in median periods.
Source: derived: halfway between one period and two.
"""
MOST_ASLEEP = 0.5
"""
Longest time between two calls that counts in full, as a share of the longest wait.
Source: derived: at least two calls, with all that came in between them, before a scan is dropped.
"""

LEADS = 16
"""Scans over which the median lead is taken.  Source: judgement; not measured."""
RESTART_AFTER = 10
"""
Consecutive stamps, ascending but earlier than those before, that show a clock set back.
Source: judgement; not measured.
"""


class SetBack:
    """Tells messages that come late or twice from a clock that was set back."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Note a stamp that is not earlier than those before."""
        self._last = self.count = 0
        """Earlier stamps in a row, ascending."""

    def add(self, stamp_ns: int) -> bool:
        """Note an earlier stamp [ns]; return whether the clock was set back."""
        if stamp_ns != self._last:  # a message that comes again tells nothing
            self.count = self.count + 1 if stamp_ns > self._last else 1
            self._last = stamp_ns
        return self.count >= RESTART_AFTER


class WaitClock:
    """
    Counts the time during which the process listened.

    While the process itself stands still, in a compiler or for want of a core, poses lie unread
    in the middleware; a scan must not be dropped for that.

    Parameters
    ----------
    recorded : bool
        The clock is a recording's: all of its time counts.

    """

    def __init__(self, *, recorded: bool = False) -> None:
        self._recorded = recorded
        self.now = 0.0
        """Time during which the process listened [s]."""
        self._heard: float | None = None

    def hear(self, now: float, longest: float) -> float:
        """
        Advance to a time by a steady clock; return the time listened so far [s].

        Parameters
        ----------
        now : float
            Time by the other clock; one before that of the last call counts as equal [s].
        longest : float
            Longest wait of a scan [s].

        Returns
        -------
        float

        """
        if self._heard is not None:
            passed = max(now - self._heard, 0.0)
            self.now += passed if self._recorded else min(passed, MOST_ASLEEP * longest)
        self._heard = now
        return self.now


class ScanClock:
    """
    Counts the scans that are missing between header stamps, and how far they are ahead of poses.

    A step of more than GAP median periods lacks as many scans as fit into it.  Backward steps are
    ignored.
    """

    def __init__(self) -> None:
        self.num_lost = 0
        self.num_interruptions = 0
        self._periods: deque[float] = deque(maxlen=WINDOW)
        self._leads: deque[float] = deque(maxlen=LEADS)
        self._last: int | None = None

    @property
    def period(self) -> float | None:
        """Median time between scans [s], None while fewer than MIN_PERIODS are known."""
        return median(self._periods) if len(self._periods) >= MIN_PERIODS else None

    def restarted(self) -> 'ScanClock':
        """Return a clock without stamps that continues the counts."""
        clock = ScanClock()
        clock.num_lost = self.num_lost
        clock.num_interruptions = self.num_interruptions
        return clock

    def note_lead(self, last_ns: int, pose_ns: int | None) -> None:
        """Take the newest time of a scan and that of the newest pose, None without one [ns]."""
        if pose_ns is not None:
            self._leads.append((last_ns - pose_ns) * 1e-9)

    @property
    def lead(self) -> float | None:
        """By which scans are ahead of poses when they come, median [s]; None while unknown."""
        return median(self._leads) if self._leads else None

    def add(self, stamp_ns: int) -> int:
        """
        Add the stamp of the next scan.

        Parameters
        ----------
        stamp_ns : int
            Header stamp [ns].

        Returns
        -------
        int
            Scans missing before this one.

        """
        last, self._last = self._last, stamp_ns
        if last is None or stamp_ns <= last:
            return 0
        step = (stamp_ns - last) * 1e-9
        if step > MAX_LOST_TIME:
            self.num_interruptions += 1
            return 0
        period = self.period
        self._periods.append(step)
        missing = 0
        if period is not None and step > GAP * period:
            missing = round(step / period) - 1
        self.num_lost += missing
        return missing
