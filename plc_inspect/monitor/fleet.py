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
"""Most vehicles followed, as each takes a participant on the graph and a share of the link."""
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
        self._stack = ExitStack()
        self._searched = time.monotonic()
        self.stations: dict[str, Station] = {}
        """By node name."""
        try:
            for name in names:
                self._follow(name)
        except BaseException:
            self._stack.close()
            raise

    def __enter__(self) -> 'Fleet':
        """Return the fleet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the graph."""
        self._stack.close()

    def spin(self, seconds: float) -> bool:
        """Process messages for about ``seconds``; return False after shutdown of ROS."""
        stations = list(self.stations.values())
        share = seconds if len(stations) == 1 else min(seconds, ROUND / len(stations))
        alive = [station.spin(share) for station in stations]
        if self._search and time.monotonic() - self._searched >= SEARCH_PERIOD:
            self._searched = time.monotonic()
            for name in stations[0].find_nodes():
                if name not in self.stations and len(self.stations) < MOST_VEHICLES:
                    self._follow(name)
        return all(alive)

    @property
    def raises(self) -> int:
        """How often alarms were raised, over all vehicles."""
        return sum(station.monitor.alarms.raises for station in self.stations.values())

    def _follow(self, name: str) -> None:
        if name in self.stations:
            raise ConfigError(f'--node {name} is named twice')
        self.stations[name] = self._stack.enter_context(self._join(name))
