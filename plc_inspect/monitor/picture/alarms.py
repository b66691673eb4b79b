# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Alarms: each stays open until its cause is gone and somebody has acknowledged it.

A cleared alarm is shown until it is acknowledged, and an acknowledged one until it clears.
Numbers of hazards hold for one run of the node: after another began, an alarm goes on only where a
hazard of the same number is at the same place.
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
SAME_PLACE = 5.0
"""
A hazard of the same number this near to where it was is the same after a restart of the node, and
so is what stands that near to where the vehicle was too near before [m].
Source: judgement: the place of a hazard moves within a tree as more of it is seen.
"""
MOST_PLACES = 20
"""
Most places at which an acknowledged alarm is known to go on [count].
Source: judgement: more things than stand within a keep-out distance of some metres.
"""
BEGAN_ANEW = 'the node began anew: it may still be there'


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """The cause of an alarm: a hazard or the keep-out."""

    text: str
    """One line that says what is too near."""
    place: Place | None = None
    """Position [m]."""
    hazard_id: int = -1
    """-1 for the keep-out."""
    kind: str = ''
    """Kind of the hazard, '' for the keep-out."""
    distance: float = math.nan
    """Distance [m]."""
    fixed: bool = True
    """It is at its place; a conductor that is too near goes along with the vehicle."""


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
    places: tuple[Place, ...] = ()
    """Where other things stand that were too near since, and that somebody has acknowledged."""

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
        """Whether somebody has acknowledged it, as it is now."""
        return self.acknowledged >= self.cleared if self.unsure else bool(self.who)

    @property
    def unsure(self) -> bool:
        """Whether the node began anew, and has not told of its cause since."""
        return self.reason == BEGAN_ANEW

    @property
    def state(self) -> str:
        """``new``, ``acknowledged``, or not acknowledged: ``unsure`` or ``cleared``."""
        if self.seen:
            return 'acknowledged'
        return 'new' if self.stands else 'unsure' if self.unsure else 'cleared'


class AlarmBook:
    """All alarms of one node."""

    def __init__(self) -> None:
        self._open: dict[int, Alarm] = {}
        self._past: deque[Alarm] = deque(maxlen=MOST_PAST)
        self._numbers: dict[str, int] = {}
        """Numbers of open alarms of this run of the node, by key."""
        self._before: dict[str, Alarm] = {}
        """Alarms that stood when the run before ended, as they were, by key."""
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

    def begin_anew(self, now: float) -> None:
        """Note that another run of the node began, which knows other hazards or the same again."""
        standing = [item for item in self._open.values() if item.stands]
        self._before |= {item.key: item for item in standing if item.cause.hazard_id >= 0}
        for item in standing:
            gone = item.cause.hazard_id < 0  # how near the vehicle is, the node tells anew
            self._put(replace(
                item, cleared=now, reason='the node began anew' if gone else BEGAN_ANEW
            ))
        self._numbers.clear()

    def update(self, causes: Mapping[str, Cause], now: float) -> tuple[Alarm, ...]:
        """
        Set the present causes; alarms of this run whose cause is absent clear.

        Parameters
        ----------
        causes : mapping of str to Cause
            By key.
        now : float
            Steady time [s].

        Returns
        -------
        tuple of Alarm
            Those that were raised.

        """
        raised = []
        for key, cause in causes.items():
            old = self._open.get(self._numbers.get(key, 0)) or self._find_again(key, cause)
            places: tuple[Place, ...] = ()
            if old is not None and old.stands and old.seen:
                places = _list_others(old, cause)
                if len(places) > len(old.places):  # nobody has seen this one
                    self._put(replace(old, cleared=now, reason='another one is nearer'))
                    old = None
            if old is not None and not (old.stands or old.unsure or _is_one(old.cause, cause)):
                old = None
            if old is None:
                self._count += 1
                self._put(Alarm(
                    number=self._count, key=key, cause=cause, raised=now, worst=cause,
                    places=places[-MOST_PLACES:],
                ))
            elif old.stands or old.unsure:
                self._put(replace(
                    old, cause=cause, cleared=math.nan, reason='', worst=_find_worse(old, cause),
                    places=places or old.places,
                ))
            else:  # nobody had seen the one before: they are one
                self._put(replace(
                    old, cause=cause, cleared=math.nan, reason='', times=old.times + 1,
                    worst=_find_worse(old, cause),
                ))
            if old is None or not (old.stands or old.unsure):
                raised.append(self._open[self._numbers[key]])
        self.raises += len(raised)
        for key, number in list(self._numbers.items()):
            if key not in causes and self._open[number].stands:
                cause = self._open[number].cause
                reason = 'no longer near' if cause.hazard_id < 0 else 'no longer there'
                self._put(replace(self._open[number], cleared=now, reason=reason))
        gone = sorted(
            (item for item in self._open.values() if not item.stands),
            key=lambda item: item.cleared,
        )
        for item in gone[:max(0, len(self._open) - MOST_OPEN)]:
            self._close(item)
        return tuple(raised)

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

    def _find_again(self, key: str, cause: Cause) -> Alarm | None:
        """Return the alarm of the run before that a cause goes on with, and take it up again."""
        before = self._before.get(key)
        if before is None or before.cause.kind != cause.kind or not _is_near(before.cause, cause):
            return None
        del self._before[key]
        for item in self._open.values():
            if item.number == before.number:
                return item
        for item in self._past:  # it was acknowledged, before or after the restart
            if item.number == before.number:
                self._past.remove(item)
                return item
        return before

    def _put(self, item: Alarm) -> None:
        """Store an alarm among the open or the closed ones."""
        self._open[item.number] = item
        newest = item.stands or self._numbers.get(item.key) == item.number
        if newest and not item.unsure:  # an older one of its key may still wait to be seen
            self._numbers[item.key] = item.number
        if item.seen and not item.stands:
            self._close(item)

    def _close(self, item: Alarm) -> None:
        del self._open[item.number]
        if self._numbers.get(item.key) == item.number:
            del self._numbers[item.key]
        self._past.append(item)


def _is_one(before: Cause, now: Cause) -> bool:
    """Return whether a cause that comes back in the same run is the one that had cleared."""
    return now.hazard_id >= 0 or not now.fixed or _is_near(before, now)


def _list_others(alarm: Alarm, cause: Cause) -> tuple[Place, ...]:
    """
    Return the acknowledged places of an alarm that stands but that of its cause now.

    They are one more than before where that is another thing than all of them.
    """
    here, there = alarm.cause.place, cause.place
    if _is_one(alarm.cause, cause) or here is None or there is None:
        return alarm.places
    places = (*alarm.places, here)
    apart = [math.dist(place, there) for place in places]
    nearest = apart.index(min(apart))
    if apart[nearest] > SAME_PLACE:
        return places
    return (*places[:nearest], *places[nearest + 1:])


def _is_near(before: Cause, now: Cause) -> bool:
    if before.place is None or now.place is None:
        return False
    return math.dist(before.place, now.place) <= SAME_PLACE


def _find_worse(old: Alarm, cause: Cause) -> Cause:
    """Return the nearer cause, or the newer one if a distance is unknown."""
    farther = old.worst is not None and old.worst.distance < cause.distance
    return old.worst if farther and old.worst is not None else cause
