# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A station: listener and model of one node, in one thread."""

from collections.abc import Callable, Iterable
from dataclasses import replace
import math
from operator import methodcaller
import time
from types import TracebackType
from typing import TYPE_CHECKING

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.listener import Listener
from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.picture.picture import Link, Picture
from plc_inspect.monitor.seen_runs import SeenRuns

if TYPE_CHECKING:
    from plc_inspect.monitor.record.recorder import Recorder

REJOIN_AFTER, MOST_REJOIN = 10.0, 60.0
"""
Over TCP, Fast DDS does not always connect again: after so long without news the graph is joined
anew, and each time that does not help twice as late [s].
"""
MOST_LEFT = 16
"""
Participants that may be abandoned at that rate.  Each costs threads and memory until the process
ends, so every further one doubles the least wait: some thirty in a day of silence.
"""
SEARCH_PERIOD = 2.0
"""Period of the search for other nodes while nothing is heard of this one [s]."""
RECORD_PERIOD = 1.0
"""Period of recorded pictures [s]."""


class Station:
    """
    A monitor of one node on the ROS graph.

    Parameters
    ----------
    node_name : str
        Name of the node with its namespace.
    arguments : list[str]
        For ROS.
    cloud : bool
        Subscribe to the thinned corridor too.
    recorder : Recorder or None
        Records the incoming messages and the pictures.

    Raises
    ------
    ConfigError
        ROS rejects the arguments or the name, or the keys cannot be read.

    """

    def __init__(
        self, node_name: str, arguments: list[str], *, cloud: bool = True,
        recorder: 'Recorder | None' = None,
    ) -> None:
        self._seen = SeenRuns()
        self.monitor = Monitor(cloud=cloud, admission=self._seen.admission)
        self._recorder = recorder
        self._recorded = self._heard = self._searched = 0.0
        self._others: tuple[str, ...] = ()
        take = {'summary': self._take_summary, 'ahead': self._take_ahead}
        if cloud:
            take['cloud'] = self._take_cloud
        self._join = lambda: Listener(node_name, take, arguments, over_tcp=self._seen.keys)
        self._listener = self._join()
        self._left: list[Listener] = []
        self._patience = self._least = REJOIN_AFTER
        self._joined = time.monotonic()

    def __enter__(self) -> 'Station':
        """Return the station."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the graph."""
        self._listener.close()

    def spin(self, seconds: float) -> bool:
        """Process messages for at most ``seconds``; return False after shutdown of ROS."""
        alive = self._listener.spin(seconds)
        for topic in self.monitor.take_wishes(time.monotonic()):
            self._listener.subscribe(topic)
        self._seen.save()
        now = time.monotonic()
        self._rejoin(now)
        if self._recorder is not None and now - self._recorded >= RECORD_PERIOD:
            self._recorded = now
            picture = self.monitor.look(now)
            self._record(methodcaller('show', picture, self.monitor.cloud))
        return alive

    def find_nodes(self) -> list[str]:
        """Return the names of nodes on the graph that a monitor can follow."""
        return self._listener.find_nodes()

    def look(self) -> Picture:
        """Return the current picture; while nothing was heard, with the nodes that are there."""
        now = time.monotonic()
        picture = self.monitor.look(now)
        if picture.link is not Link.WAITING:
            return picture
        if now - self._searched >= SEARCH_PERIOD:
            self._searched, self._others = now, tuple(self.find_nodes())
        return replace(picture, others=self._others)

    def measure_silence(self) -> float | None:
        """Return how long the node has been gone [s], None if it is not or left alarms unseen."""
        picture = self.monitor.look(time.monotonic())
        if picture.link is Link.WAITING:
            return math.inf
        gone = picture.link is Link.LOST and all(item.seen for item in picture.alarms)
        return picture.ages.link if gone else None

    def report(self, text: str) -> None:
        """Add a fault of the ground station to the events."""
        self.monitor.report(text, time.monotonic())

    def acknowledge(self, numbers: Iterable[int], who: str) -> None:
        """Acknowledge alarms, also in the record."""
        seen = self.monitor.acknowledge(numbers, who, time.monotonic())
        for alarm in seen:
            self._record(methodcaller('note', alarm))

    def _rejoin(self, now: float) -> None:
        """Join the graph anew if nothing comes; abandon the old place, as closing may hang."""
        if not self._seen.keys or now - self._joined < self._patience:
            return
        if now - self._heard < REJOIN_AFTER:
            self._joined, self._patience = now, self._least
            return
        try:
            listener = self._join()
        except ConfigError as error:  # as while files are replaced: it is tried again
            self._joined = now
            self.monitor.report(f'the graph cannot be joined anew: {error}', now)
            return
        self._left.append(self._listener)
        self._listener = listener
        self.monitor.rejoin()
        slower = 2.0 ** max(0, len(self._left) - MOST_LEFT)
        self._least = REJOIN_AFTER * slower
        self._joined = now
        self._patience = max(min(2.0 * self._patience, MOST_REJOIN), self._least)

    def _take_summary(self, data: bytes) -> None:
        self._record(methodcaller('take', 'summary', data))
        self._heard = time.monotonic()
        self.monitor.take_summary(data, time.monotonic())

    def _take_ahead(self, data: bytes) -> None:
        self.monitor.take_ahead(data, time.monotonic())

    def _take_cloud(self, data: bytes) -> None:
        self._record(methodcaller('take', 'cloud', data))
        self.monitor.take_cloud(data, time.monotonic())

    def _record(self, write: 'Callable[[Recorder], object]') -> None:
        """Write to the record; one that cannot be written ends, and the monitor goes on."""
        if self._recorder is None:
            return
        try:
            write(self._recorder)
        except OSError as error:
            self._recorder.abandon(error)
            self._recorder = None
            self.monitor.report(
                f'the record ended: {error.strerror or error}: free disk space, then start '
                'plc_monitor anew with another --record', time.monotonic(),
            )
