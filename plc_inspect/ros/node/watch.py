# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Watches what comes in: why nothing goes into the map, and who publishes."""

from collections import Counter
from collections.abc import Callable, Mapping

from rclpy.node import Node

from plc_inspect.config import InputSettings
from plc_inspect.core.mapping.scan_counters import Counters, DropReason
from plc_inspect.core.mapping.standstill import explain_standstill
from plc_inspect.ros.node.diagnostics import Health, SILENCE

PATIENCE = 3
"""Reports in a row with two publishers until they are told of; a driver may be restarting."""

MOST_JUMP = 50
"""Messages of one publisher in a row that may be lost."""
SILENT = 1.0
"""A publisher that was silent so long may be followed by another one [s]."""


class SourceWatch:
    """
    Lets through the messages of one publisher where there are several.

    Each publisher numbers its messages: those of another one do not go on where the last ended.
    (The middleware knows the publisher itself, but rclpy does not tell.)

    Parameters
    ----------
    count : callable
        Returns the number of publishers.

    """

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._last: int | None = None
        self._heard = 0.0

    @property
    def num_publishers(self) -> int:
        """Publishers there are now."""
        return self._count()

    def accepts(self, info: Mapping[str, int | None], now: float) -> bool:
        """
        Tell whether a message is of the publisher that is listened to.

        Parameters
        ----------
        info : mapping
            Of rclpy, with ``publication_sequence_number``.
        now : float
            Steady time [s].

        Returns
        -------
        bool

        """
        number = info.get('publication_sequence_number')
        if number is None:
            return True
        goes_on = self._last is not None and 0 < number - self._last <= MOST_JUMP
        known = self._last is not None and now - self._heard <= SILENT
        if known and not goes_on and self.num_publishers > 1:
            return False
        self._last, self._heard = number, now
        return True


class InputWatch:
    """
    Tells what is wrong with scans and odometry, once a second.

    Parameters
    ----------
    node : Node
        Knows who publishes.
    topics : tuple of str
        Of scans and of odometry.
    now : float
        Steady time [s].

    """

    def __init__(self, node: Node, topics: tuple[str, str], now: float) -> None:
        self._node, self._topics = node, topics
        self._since = now
        self._before: Counters | None = None
        self._malformed: Counter[str] = Counter()
        self._crowded: Counter[str] = Counter()
        self._overlaps: dict[str, int] = {}

    def look(
        self, counters: Counters, health: Health, settings: InputSettings, now: float
    ) -> tuple[str, str]:
        """
        Look at what came in since the last time.

        Parameters
        ----------
        counters : Counters
            Of the accumulator.
        health : Health
            Of the node.
        settings : InputSettings
            That hold now.
        now : float
            Steady time [s].

        Returns
        -------
        tuple[str, str]
            What makes the input useless, and what is doubtful; '' nothing.

        """
        problem = self._find_standstill(counters, health, settings, now)
        crowds = [text for topic in self._topics if (text := self._find_crowd(topic))]
        reasons = (DropReason.OVERLAP.value, DropReason.OTHER_DRIVER.value)
        overlaps = {reason: counters.scans_dropped.get(reason, 0) for reason in reasons}
        news = [reason for reason in reasons if overlaps[reason] > self._overlaps.get(reason, 0)]
        if news and not problem:
            problem = '; '.join([f'scans dropped: {news[-1]}', *crowds])
        self._overlaps = overlaps
        return problem, '; '.join(crowds)

    def _find_standstill(
        self, counters: Counters, health: Health, settings: InputSettings, now: float
    ) -> str:
        before = self._before
        # fewer where the record proved to be of another flight
        if counters.num_points_inserted != (before.num_points_inserted if before else 0):
            self._before, self._since = counters, now
            self._malformed = Counter(health.malformed)
        if now - self._since <= SILENCE:
            return ''
        malformed = {
            kind: health.problems[kind] for kind, count in health.malformed.items()
            if count > self._malformed[kind]
        }
        cause = explain_standstill(counters, before, health.find_causes(malformed), settings)
        return f'nothing went into the map for {now - self._since:.0f} s: {cause}'

    def _find_crowd(self, topic: str) -> str:
        publishers = self._node.get_publishers_info_by_topic(topic)
        crowded = len(publishers) > 1
        self._crowded[topic] = self._crowded[topic] + 1 if crowded else 0
        if self._crowded[topic] < PATIENCE:
            return ''
        names = sorted(
            f'{item.node_namespace.rstrip("/")}/{item.node_name}' for item in publishers
        )
        return f'{len(publishers)} publishers on {topic}: {", ".join(names)}'
