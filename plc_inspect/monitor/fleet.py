# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A fleet: one station for each vehicle, also for those that appear later."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
import time
from types import TracebackType

from plc_inspect.errors import ConfigError
from plc_inspect.monitor.station import Station

SEARCH_PERIOD = 2.0
"""Period of the search for more vehicles [s]."""
MOST_VEHICLES = 12
"""
Most vehicles followed, as each takes a participant on the graph and a share of the link; beyond,
one that is gone gives its place to one that is there.
"""
MOST_TOLD = 100
"""Most reports of nodes that are not followed, which bounds what is remembered of them."""
ROUND = 0.06
"""
Time in which all of several vehicles are waited for once while nothing comes [s].
Source: judgement: an alarm has a second to the page, and each wait costs a part of a millisecond.
"""


class Fleet:
    """
    The stations of all vehicles.

    Parameters
    ----------
    join : callable
        Returns the station of a node by its name.
    names : sequence of str
        Nodes followed from the start.
    search : bool
        Also follow nodes that appear later.

    """

    def __init__(
        self, join: Callable[[str], Station], names: Sequence[str], *, search: bool = False
    ) -> None:
        self._join, self._search = join, search
        self._places: dict[str, ExitStack] = {}
        self._told: set[str] = set()
        """Why nodes are not followed, as far as it was reported."""
        self._searched = time.monotonic()
        self.stations: dict[str, Station] = {}
        """By node name."""
        try:
            for name in names:
                self._follow(name)
        except BaseException:
            self._close()
            raise

    def __enter__(self) -> 'Fleet':
        """Return the fleet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the graph."""
        self._close()

    def spin(self, seconds: float) -> bool:
        """Process messages for about ``seconds``; return False after shutdown of ROS."""
        stations = list(self.stations.values())
        share = seconds if len(stations) == 1 else min(seconds, ROUND / len(stations))
        alive = [station.spin(share) for station in stations]
        if self._search and time.monotonic() - self._searched >= SEARCH_PERIOD:
            self._searched = time.monotonic()
            there = stations[0].find_nodes()
            for name in there:
                if name not in self.stations:
                    self._follow_late(name, there)
        return all(alive)

    @property
    def raises(self) -> int:
        """How often alarms were raised, over all vehicles."""
        return sum(station.monitor.alarms.raises for station in self.stations.values())

    def _follow(self, name: str) -> None:
        if name in self.stations:
            raise ConfigError(f'--node {name} is named twice')
        place = ExitStack()
        self.stations[name] = place.enter_context(self._join(name))
        self._places[name] = place

    def _follow_late(self, name: str, there: Sequence[str]) -> None:
        """Follow a node that appeared; where that is not possible, report why, once."""
        try:
            gone = self._find_gone(there) if len(self.stations) >= MOST_VEHICLES else ''
            self._follow(name)
            if gone:
                del self.stations[gone]
                self._places.pop(gone).close()
        except ConfigError as error:  # keys may be replaced just now: it is tried again
            text = f'{name} is not followed: {error}'
            if text not in self._told and len(self._told) < MOST_TOLD:
                self._told.add(text)
                next(iter(self.stations.values())).report(text)

    def _find_gone(self, there: Sequence[str]) -> str:
        """Return the node that is gone longest and has no alarm that nobody saw."""
        gone = {}
        for name, station in self.stations.items():
            silence = station.measure_silence()
            if name not in there and silence is not None:
                gone[name] = silence
        if not gone:
            raise ConfigError(f'{MOST_VEHICLES} vehicles are followed already')
        return max(gone, key=lambda name: gone[name])

    def _close(self) -> None:
        for place in self._places.values():
            place.close()
