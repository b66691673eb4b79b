# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Replay of a recorded flight: its pictures at any time."""

from dataclasses import dataclass

from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.model import LOST, Monitor
from plc_inspect.monitor.picture.picture import Picture
from plc_inspect.monitor.replay.tape import Entry, read_seen, Seen, Tape
from plc_inspect.stream.frame import read_number

SPEEDS = (1.0, 4.0, 16.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """An alarm on the timeline."""

    time: float
    """When it was raised [s]."""
    text: str


class Replay:
    """
    A tape and the current position in it.

    Parameters
    ----------
    tape : Tape
        All messages.

    """

    def __init__(self, tape: Tape) -> None:
        self.tape = tape
        self.cloud = CloudStore()
        """One store for the whole replay, as it reports what changes."""
        self._begin()
        self._feed(tape.length)
        self.marks = tuple(
            Mark(time=item.raised, text=item.cause.text)
            for item in sorted(
                (*self._monitor.alarms.open, *self._monitor.alarms.past),
                key=lambda item: item.raised,
            )
        )
        """Alarms of the flight, in order of time."""
        self.speed = SPEEDS[0]
        self.playing = tape.length > 0.0
        if self.playing:
            self._begin()
            self._feed(0.0)

    @property
    def time(self) -> float:
        """Current time of the replay [s]."""
        return self._time

    def seek(self, time: float) -> None:
        """Go to a time of the flight [s], clipped to its start and end."""
        time = min(max(time, 0.0), self.tape.length)
        if time < self._time:
            self._begin()
        self._feed(time)

    def steer(self, time: float | None, playing: bool | None, speed: float | None) -> None:
        """Set time, playing and speed; None leaves a value unchanged."""
        if speed is not None:
            self.speed = min(max(speed, SPEEDS[0]), SPEEDS[-1])
        if time is not None:
            self.seek(time)
        if playing is not None:
            if playing and self._time >= self.tape.length:
                self.seek(0.0)
            self.playing = playing

    def step(self, seconds: float) -> None:
        """Advance by ``seconds`` of wall time, and stop at the end."""
        if self.playing:
            self.seek(self._time + seconds * self.speed)
            self.playing = self._time < self.tape.length

    def look(self) -> Picture:
        """Return the picture at the current time."""
        return self._monitor.look(self._time)

    def _begin(self) -> None:
        self.cloud.clear()
        self._monitor = Monitor(cloud=any(entry.kind == 'cloud' for entry in self.tape.entries))
        self._monitor.cloud = self.cloud
        self._next, self._time, self._number = 0, 0.0, (-1, -1)
        self._early: list[tuple[float, Seen]] = []
        """Acknowledgements of alarms whose messages came ahead, and since when they wait [s]."""

    def _feed(self, time: float) -> None:
        entries = self.tape.entries
        while self._next < len(entries) and entries[self._next].time <= time:
            self._take(entries[self._next])
            self._next += 1
        self._time = time

    def _take(self, entry: Entry) -> None:
        if entry.kind == 'summary':
            before, self._number = self._number, read_number(entry.data)
            if self._number[0] != before[0] or self._number <= before:
                # the node began anew, or sends again what the monitor had requested
                self._monitor.take_wishes(entry.time)
            self._monitor.take_summary(entry.data, entry.time)
            self._early = [
                (since, seen) for since, seen in self._early
                if entry.time - since <= LOST and not self._see(seen, entry.time)
            ]
        elif entry.kind == 'cloud':
            self._monitor.take_cloud(entry.data, entry.time)
        elif (seen := read_seen(entry.data)) and not self._see(seen, entry.time):
            self._early.append((entry.time, seen))

    def _see(self, seen: Seen, time: float) -> bool:
        """Acknowledge the alarm of a key, as its number may be another here; return whether."""
        found = [
            item for item in self._monitor.alarms.open if not item.seen
            and (item.key == seen.key if seen.key else item.number == seen.number)
        ]
        if not found:
            return False
        alarm = max(found, key=lambda item: (
            item.stands == seen.stood, item.number == seen.number, item.number
        ))
        self._monitor.acknowledge([alarm.number], seen.who, time)
        return True
