# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The model of the ground station: messages of the stream in, a picture out; without ROS or clock.

Whatever happens to the link or the node, the next turns of the summary restore the full state.
"""

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
import math
from typing import TypeVar

from plc_inspect.errors import DataError
from plc_inspect.monitor.picture.admission import Admission, Judgement, Verdict
from plc_inspect.monitor.picture.ahead import Ahead
from plc_inspect.monitor.picture.alarms import Alarm, AlarmBook, Cause
from plc_inspect.monitor.picture.causes import find_height, list_causes
from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.hazard_news import list_news
from plc_inspect.monitor.picture.items import Items, list_items
from plc_inspect.monitor.picture.names import name_stretches
from plc_inspect.monitor.picture.node_clock import NodeClock
from plc_inspect.monitor.picture.picture import (
    Ages,
    Event,
    format_age,
    Link,
    make_hazard,
    Picture,
    Place,
)
from plc_inspect.monitor.picture.rows import RowBook
from plc_inspect.monitor.picture.tally import Tally
from plc_inspect.monitor.picture.wishes import OVERTAKEN, PATIENCE, Wishes
from plc_inspect.stream.blocks import CloudMessage, read_cloud
from plc_inspect.stream.frame import SUMMARY
from plc_inspect.stream.summary import read_summary, Status, STATUSES, SummaryMessage

Message = TypeVar('Message', SummaryMessage, CloudMessage)

LATE, LOST = 2.5, 6.0
"""Silence after which the link counts as late, and as lost [s]; the node speaks every second."""
MOST_EVENTS = 200
MOST_TRACK = 4000
TRACK_STEP = 1.0
"""Places of the track are this far apart [m]."""


class Monitor:
    """
    The state of one node; not thread-safe.

    Parameters
    ----------
    cloud : bool
        The thinned corridor is subscribed to.
    admission : Admission or None
        Decides which messages are the node's; None: without keys.

    """

    def __init__(self, *, cloud: bool = True, admission: Admission | None = None) -> None:
        self._listens = cloud
        self._admission = Admission() if admission is None else admission
        self.cloud = CloudStore()
        self._clock = NodeClock()
        self._tally = Tally()
        self._session: int | None = None
        self._cloud_session: int | None = None
        self._cloud_sequence = -1
        self._link = Link.WAITING
        self._last = self._last_cloud = math.nan
        self._behind: float | None = None
        self._rows = RowBook()
        self._status = Status()
        self._texts = ('', *('' for _ in STATUSES))
        self._track: deque[Place] = deque(maxlen=MOST_TRACK)
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self.alarms = AlarmBook()
        self._causes: dict[str, Cause] = {}
        self._former: set[tuple[int, int]] = set()
        """Spans of the run before, until the first tick: what is known by then was kept."""
        self._ahead = Ahead()
        self._moved, self._flown = math.nan, 0.0
        self._wishes = Wishes()
        self._items: Items = ((), (), ())
        self._stretches: dict[tuple[int, int], str] = {}
        self._outdated = False
        """Rows came again since the items were made of them."""

    def take_summary(self, data: bytes, now: float) -> bool:
        """
        Take a message of the summary.

        Parameters
        ----------
        data : bytes
            As it came in.
        now : float
            Steady time [s].

        Returns
        -------
        bool
            Whether it was used; damaged, old and foreign messages are counted.

        """
        message = self._open(read_summary, data, now)
        if message is None:
            return False
        resets = message.status.resets
        judgement = self._admission.judge(message.frame, data, now, resets)
        if not judgement.good:
            self._refuse(judgement, now)
            return False
        if message.frame.session != self._session:
            self._begin(message, now)
        missing = judgement.missing
        if missing:
            self._rows.miss()
            if self._outdated:  # the resend was cut off: rows are as of then
                self._rows.doubt()
            self._wishes.want_summary(now + OVERTAKEN)
            self._tally.add('lost_summary', missing)
            self._tell(now, 1, f'{missing} messages of the summary were lost')
        self._end_silence(now)
        self._last = now
        self._texts = message.texts or self._texts
        if judgement.resent:  # only its rows count: the rest is older than what is shown
            if not self._outdated:
                self._rows.doubt()
            self._outdated = True
            self._rows.take(message)
        else:
            self._clock.hear(message.frame.uptime, now)
            self._apply(message, now)
        if self._rows.complete:
            self._wishes.has_summary()
        self._compare_cloud(now)
        return True

    def take_ahead(self, data: bytes, now: float) -> None:
        """Raise the alarms of a summary message that may have overtaken earlier ones."""
        if not self._admission.is_signed(data):
            return  # what is refused is counted where it comes in order
        with suppress(DataError):
            message = read_summary(data)
            if self._admission.is_ahead(message.frame, data):
                hazards = list(map(make_hazard, message.tables.hazards))
                causes = list_causes(hazards, self._stretches, message.status)
                self._ahead.take(message.frame.sequence, causes)
                self._raise_alarms(now)

    def take_cloud(self, data: bytes, now: float) -> bool:
        """Take a message of the thinned corridor; as ``take_summary``."""
        message = self._open(read_cloud, data, now)
        if message is None:
            return False
        judgement = self._admission.judge(message.frame, data, now)
        if not judgement.good:
            self._refuse(judgement, now)
            return False
        if message.frame.session != self._cloud_session:
            self.cloud.clear()
            self._cloud_session = message.frame.session
        # what was sent before the node knew of a new subscription comes once more
        missing = 0 if self._wishes.begin_cloud() else judgement.missing
        if missing:
            self._tally.add('lost_cloud', missing)
            self._wish_cloud(
                f'{missing} messages of the corridor were lost: asked for anew', now, OVERTAKEN
            )
        self._cloud_sequence = message.frame.sequence
        self._last_cloud, self._behind = now, None
        self.cloud.put(message)
        return True

    def take_wishes(self, now: float) -> set[str]:
        """
        Return the topics to subscribe to anew, so that the node sends them again.

        Parameters
        ----------
        now : float
            Steady time [s].

        Returns
        -------
        set of 'summary' and 'cloud'

        """
        due = self._wishes.take(now)
        if 'summary' in due:
            # What the node kept comes from its beginning, and has all turns.
            self._admission.reopen(SUMMARY)
        return due

    def acknowledge(self, numbers: Iterable[int], who: str, now: float) -> tuple[Alarm, ...]:
        """Acknowledge alarms, and return those that were not yet acknowledged."""
        seen = self.alarms.acknowledge(numbers, who, now)
        for item in seen:
            self._tell(now, 0, f'{who} acknowledged: {item.text}')
        return seen

    def report(self, text: str, now: float) -> None:
        """Add a fault of the ground station [s] to the events."""
        self._tell(now, 2, text)

    def rejoin(self) -> None:
        """Expect the messages that the node keeps once more, as the graph was joined anew."""
        self._admission.reopen(SUMMARY)

    def look(self, now: float) -> Picture:
        """Return the current picture."""
        self._watch(now)
        spans, supports, hazards = self._items
        status = self._status
        return Picture(
            time=now, link=self._link, session=self._session, complete=self._rows.complete,
            ages=Ages(
                link=now - self._last,
                data=self._clock.measure_age(status.tick_uptime, now),
                vehicle=self._clock.measure_age(status.vehicle_uptime, now),
                near=self._clock.measure_age(status.near_uptime, now),
                health=self._clock.measure_age(status.health_uptime, now),
                cloud=now - self._last_cloud,
                delay=self._clock.delay,
            ),
            counts=self._tally.read(now), frame_id=self._texts[0],
            stamp_ns=status.stamp_ns, spans=spans, supports=supports, hazards=hazards,
            held=status.held, vehicle=status.vehicle, heading=status.heading,
            height=find_height(status.vehicle, self.cloud, spans, supports), flown=self._flown,
            stood=now - self._moved, near=status.near,
            track=tuple(self._track), levels=status.levels,
            texts=self._texts[1:], health=status.health, cloud_blocks=len(self.cloud),
            cloud_total=self.cloud.total, cloud_cells=self.cloud.num_cells,
            events=tuple(self._events), alarms=self.alarms.open,
            past_alarms=self.alarms.past,
        )

    def _open(
        self, read: Callable[[bytes], Message], data: bytes, now: float
    ) -> Message | None:
        """Read a message; return None, and count it, if it is damaged or not the node's."""
        self._tally.note(len(data), now)
        if not self._admission.is_signed(data):  # of who has no key nothing is even unpacked
            self._refuse(Judgement(Verdict.FORGED), now)
            return None
        try:
            return read(data)
        except DataError as error:
            self._complain(error, now)
            return None

    def _begin(self, message: SummaryMessage, now: float) -> None:
        """Discard the previous session, and report it."""
        session, resets = message.frame.session, message.status.resets
        taken_over = self._session is not None
        if self._session is None:
            self._tell(now, 0, 'the node is there')
        else:
            same = (session - resets) % (1 << 32) == (self._session - self._status.resets) % (
                1 << 32
            )
            self._tally.add('restarts')
            self._tell(now, 1, 'the node was told to forget everything: cleared' if same else
                       'the node was started anew: cleared until it tells what it kept')
            fresh = same or not math.isnan(message.status.tick_uptime)
            self._former = set() if fresh else {item.key for item in self._items[0]}
            if not same:
                self._clock = NodeClock()
        self._rows.clear()
        if self._cloud_session != session:
            self.cloud.clear()
            self._cloud_session, self._last_cloud, self._behind = None, math.nan, None
        self._session = session
        self._status = Status()
        self._items, self._stretches = ((), (), ()), {}
        self._track.clear()
        self._moved, self._flown = now, 0.0
        self._causes = {}
        self._ahead.clear()
        self.alarms.begin_anew(now)
        self._wishes.want_summary(now if taken_over else now + 1.0)

    def _apply(self, message: SummaryMessage, now: float) -> None:
        before = self._items[2]
        if self._former and not math.isnan(message.status.tick_uptime):
            self._tell_kept(now)
        settled = self._rows.settled
        changed = self._rows.take(message) or settled != self._rows.settled
        old, self._status = self._status, message.status
        if changed or self._outdated or old.held != self._status.held:
            self._rebuild()
        hazards = self._items[2]
        for level, text in list_news(
            before, hazards, self._stretches, was_held=old.held,
            held=self._status.held, kept=math.isnan(message.status.tick_uptime),
        ):
            self._tell(now, level, text)
        self._causes = list_causes(hazards, self._stretches, self._status)
        self._ahead.reach(message.frame.sequence)
        self._raise_alarms(now)
        self._tell_health(old, now)
        place = message.status.vehicle
        if place is not None and (
            not self._track or math.dist(place, self._track[-1]) >= TRACK_STEP
        ):
            self._flown += math.dist(place, self._track[-1]) if self._track else 0.0
            self._moved = now
            self._track.append(place)

    def _raise_alarms(self, now: float) -> None:
        for item in self.alarms.update(self._causes | self._ahead.causes, now):
            if item.cause.hazard_id < 0:  # hazards are told with the table
                self._tell(now, 2, item.cause.text)

    def _tell_kept(self, now: float) -> None:
        """Report how much the node knows again after it was started anew."""
        kept = len(self._former & {item.key for item in self._items[0]})
        self._tell(now, 0 if kept else 1,
                   f'the node went on with {kept} of the {len(self._former)} spans from before')
        self._former = set()

    def _compare_cloud(self, now: float) -> None:
        """Request the corridor anew if blocks are missing and none arrive."""
        known = self._cloud_sequence + 1 if self._cloud_session == self._session else 0
        if not self._listens or self._status.cloud_sent <= known:
            self._behind = None
        elif self._behind is None:
            self._behind = now
        elif now - self._behind > PATIENCE:
            self._behind = None
            self._wish_cloud('the newest of the corridor was lost: asked for anew', now)

    def _wish_cloud(self, why: str, now: float, wait: float = 0.0) -> None:
        """Request the corridor anew after a wait [s], not too often, and report it once."""
        if self._wishes.want_cloud(now + wait):
            self._tell(now, 1, why)

    def _rebuild(self) -> None:
        self._items = list_items(self._rows, self._items[2], held=self._status.held)
        self._stretches = name_stretches(*self._items[:2])
        self._outdated = False

    def _tell_health(self, old: Status, now: float) -> None:
        new = self._status
        for name, text, was, level in zip(
            STATUSES, self._texts[1:], old.levels, new.levels, strict=True
        ):
            if level != was:
                word = f'{name}: {text}' if level else f'{name}: good again'
                self._tell(now, 1 if level else 0, word)
        back = (old.stamp_ns - new.stamp_ns) * 1e-9
        if back > 0.0 and new.stamp_ns > 0 and old.stamp_ns > 0:
            self._tell(now, 1, f'the time of the data went back by {format_age(back)}')

    def _watch(self, now: float) -> None:
        """Check how long the link has been silent."""
        if self._link is Link.WAITING:
            return
        silence = now - self._last
        link = Link.LOST if silence > LOST else Link.LATE if silence > LATE else Link.LIVE
        if link is Link.LOST and self._link is not Link.LOST:
            self._tell(now, 2, f'link lost: nothing came in for {silence:.0f} s')
        self._link = link

    def _end_silence(self, now: float) -> None:
        if self._link is Link.LOST:
            self._tell(now, 1, f'link is back after {now - self._last:.0f} s')
        self._link = Link.LIVE

    def _refuse(self, judgement: Judgement, now: float) -> None:
        """Count a refused message, and report it from time to time."""
        text = self._tally.refuse(judgement, now)
        if text:
            self._tell(now, 1, text)

    def _complain(self, error: DataError, now: float) -> None:
        self._tally.add('malformed')
        self._tell(now, 1, f'message not understood: {error}')

    def _tell(self, now: float, level: int, text: str) -> None:
        self._events.append(Event(time=now, level=level, text=text))
