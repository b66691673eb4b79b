# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Alarms: each stands until what raised it is gone and somebody has acknowledged it.

Nothing ends one by itself: what cleared without being seen is still told, and what somebody has
seen is told until it clears.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
import math

Place = tuple[float, float, float]

TELLING = 0.3
"""
It was nearer before where that is more than this [m].
Source: measured: bench/live/proximity.py: 95 of 100 distances are told within it.
"""
MOST_PAST = 200
"""Alarms that are over are remembered, the newest [count]."""
MOST_OPEN = 200
"""More open ones are counted, not listed: those that cleared first go first [count]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """What raises an alarm; of hazards and of the keep-out alike."""

    text: str
    """What is too near, in a line."""
    place: Place | None = None
    """Where [m]."""
    hazard_id: int = -1
    """-1: of the keep-out."""
    distance: float = math.nan
    """How near it is [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """One alarm; times are steady times of the monitor [s]."""

    number: int
    """Of this monitor, 1 the first; none comes twice."""
    key: str
    """What raised it, such as ``hazard 12`` or ``keep-out conductor``."""
    cause: Cause
    """As it was told last."""
    raised: float
    times: int = 1
    """How often it was raised before somebody saw it."""
    cleared: float = math.nan
    """NaN while it stands."""
    reason: str = ''
    """Why it is no more."""
    acknowledged: float = math.nan
    """NaN while nobody has seen it."""
    who: str = ''
    worst: Cause | None = None
    """The cause when it was nearest."""

    @property
    def text(self) -> str:
        """What is told of it: how near it is, and once it has cleared how near it was."""
        worst = self.cause if self.worst is None else self.worst
        if not self.stands:
            return worst.text
        nearer = self.cause.distance - worst.distance > TELLING
        return f'{self.cause.text}; nearest {worst.distance:.1f} m' if nearer else self.cause.text

    @property
    def stands(self) -> bool:
        """Whether what raised it is still there."""
        return math.isnan(self.cleared)

    @property
    def seen(self) -> bool:
        """Whether somebody has acknowledged it."""
        return bool(self.who)

    @property
    def state(self) -> str:
        """``new``, ``acknowledged`` or ``cleared``, which nobody has seen yet."""
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
        """How often alarms were raised, also once more."""

    @property
    def open(self) -> tuple[Alarm, ...]:
        """Those that stand or that nobody has seen: unseen first, then standing, then newest."""
        return tuple(sorted(
            self._open.values(), key=lambda item: (item.seen, not item.stands, -item.number)
        ))

    @property
    def past(self) -> tuple[Alarm, ...]:
        """Those that are over, the newest first."""
        return tuple(reversed(self._past))

    def update(
        self, causes: Mapping[str, Cause], now: float, reason: str = 'no longer there'
    ) -> None:
        """
        Take what is too near now; what is not among it has cleared.

        Parameters
        ----------
        causes : mapping of str to Cause
            By key.
        now : float
            Steady time [s].
        reason : str
            Why others are no more.

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
        Note that somebody has seen alarms.

        Parameters
        ----------
        numbers : iterable of int
            Of alarms; those that are not open, or seen already, are left as they are.
        who : str
            Name; not empty.
        now : float
            Steady time [s].

        Returns
        -------
        tuple of Alarm
            Those that were new.

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
        """Keep an alarm, or lay it aside where it is over."""
        if item.stands or not item.seen:
            self._open[item.key] = item
        else:
            del self._open[item.key]
            self._past.append(item)


def _find_worse(old: Alarm, cause: Cause) -> Cause:
    """Return the nearer one; where that is not known the newer."""
    farther = old.worst is not None and old.worst.distance < cause.distance
    return old.worst if farther and old.worst is not None else cause
