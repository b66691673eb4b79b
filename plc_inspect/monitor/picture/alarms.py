# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Alarms: each stays open until its cause is gone and somebody has acknowledged it.

A cleared alarm is shown until it is acknowledged, and an acknowledged one until it clears.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
import math

Place = tuple[float, float, float]

TELLING = 0.3
"""
Difference from which an alarm also reports the earlier, nearer distance [m].
Source: measured: bench/live/proximity.py: 95 of 100 distances are accurate to this.
"""
MOST_PAST = 200
"""Most closed alarms that are remembered, the newest [count]."""
MOST_OPEN = 200
"""Most open alarms listed [count]; of more, those that cleared first are dropped from the list."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """The cause of an alarm: a hazard or the keep-out."""

    text: str
    """One line that says what is too near."""
    place: Place | None = None
    """Position [m]."""
    hazard_id: int = -1
    """-1 for the keep-out."""
    distance: float = math.nan
    """Distance [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """One alarm; times are steady times of the monitor [s]."""

    number: int
    """Number in this monitor, from 1; never used twice."""
    key: str
    """Key of its cause, such as ``hazard 12`` or ``keep-out conductor``."""
    cause: Cause
    """The newest one."""
    raised: float
    times: int = 1
    """How often it was raised before it was acknowledged."""
    cleared: float = math.nan
    """NaN while it stands."""
    reason: str = ''
    """Why it cleared."""
    acknowledged: float = math.nan
    """NaN until acknowledged."""
    who: str = ''
    worst: Cause | None = None
    """The cause when it was nearest."""

    @property
    def text(self) -> str:
        """Text of the alarm with its distance; once cleared, the least distance."""
        worst = self.cause if self.worst is None else self.worst
        if not self.stands:
            return worst.text
        nearer = self.cause.distance - worst.distance > TELLING
        return f'{self.cause.text}; nearest {worst.distance:.1f} m' if nearer else self.cause.text

    @property
    def stands(self) -> bool:
        """Whether its cause is still present."""
        return math.isnan(self.cleared)

    @property
    def seen(self) -> bool:
        """Whether somebody has acknowledged it."""
        return bool(self.who)

    @property
    def state(self) -> str:
        """``new``, ``acknowledged``, or ``cleared`` but not acknowledged."""
        if self.seen:
            return 'acknowledged'
        return 'new' if self.stands else 'cleared'


class AlarmBook:
    """All alarms of one node."""

    def __init__(self) -> None:
        self._open: dict[str, Alarm] = {}
        self._past: deque[Alarm] = deque(maxlen=MOST_PAST)
        self._count = 0
        self.raises = 0
        """How often alarms were raised, repetitions included."""

    @property
    def open(self) -> tuple[Alarm, ...]:
        """Open alarms: unacknowledged first, then those whose cause is present, then newest."""
        return tuple(sorted(
            self._open.values(), key=lambda item: (item.seen, not item.stands, -item.number)
        ))

    @property
    def past(self) -> tuple[Alarm, ...]:
        """Closed alarms, newest first."""
        return tuple(reversed(self._past))

    def update(
        self, causes: Mapping[str, Cause], now: float, reason: str = 'no longer there'
    ) -> None:
        """
        Set the present causes; alarms whose cause is absent clear.

        Parameters
        ----------
        causes : mapping of str to Cause
            By key.
        now : float
            Steady time [s].
        reason : str
            Why the other alarms clear.

        """
        for key, cause in causes.items():
            old = self._open.get(key)
            if old is None:
                self._count += 1
                self.raises += 1
                self._open[key] = Alarm(
                    number=self._count, key=key, cause=cause, raised=now, worst=cause
                )
            elif old.stands:
                self._open[key] = replace(old, cause=cause, worst=_find_worse(old, cause))
            else:  # nobody had seen the one before: they are one
                self.raises += 1
                self._open[key] = replace(
                    old, cause=cause, cleared=math.nan, reason='', times=old.times + 1,
                    worst=_find_worse(old, cause),
                )
        for key in [key for key, item in self._open.items() if item.stands]:
            if key not in causes:
                self._put(replace(self._open[key], cleared=now, reason=reason))
        gone = [item for item in self._open.values() if not item.stands]
        for item in gone[:max(0, len(self._open) - MOST_OPEN)]:
            self._past.append(self._open.pop(item.key))

    def acknowledge(self, numbers: Iterable[int], who: str, now: float) -> tuple[Alarm, ...]:
        """
        Acknowledge alarms.

        Parameters
        ----------
        numbers : iterable of int
            Numbers of alarms; closed and acknowledged ones do not change.
        who : str
            Name; not empty.
        now : float
            Steady time [s].

        Returns
        -------
        tuple of Alarm
            Alarms acknowledged by this call.

        """
        wanted = set(numbers)
        result = []
        for item in list(self._open.values()):
            if item.number in wanted and not item.seen:
                seen = replace(item, acknowledged=now, who=who)
                result.append(seen)
                self._put(seen)
        return tuple(result)

    def _put(self, item: Alarm) -> None:
        """Store an alarm among the open or the closed ones."""
        if item.stands or not item.seen:
            self._open[item.key] = item
        else:
            del self._open[item.key]
            self._past.append(item)


def _find_worse(old: Alarm, cause: Cause) -> Cause:
    """Return the nearer cause, or the newer one if a distance is unknown."""
    farther = old.worst is not None and old.worst.distance < cause.distance
    return old.worst if farther and old.worst is not None else cause
