# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tracks supports over ticks, so that each keeps its number for the whole flight."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from plc_inspect.results import Bool, Float64, SpanKey, Support

SUPPORT_DISTANCE = 4.0
"""
Greatest distance in plan between the same support in two ticks [m].
Source: judgement; not measured.
"""
MAX_MISSES = 3
"""
Consecutive ticks that must miss a support or a hazard, or find it less severe, before it changes.
Source: judgement; not measured.
"""

Holds = Callable[[Float64], Bool]
"""Tells which of (N, 2+) points lie where the tick saw all there is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeptSupports:
    """State of the book of supports between ticks."""

    supports: tuple[Support, ...] = ()
    misses: tuple[int, ...] = ()
    """Consecutive ticks that did not find each support."""
    next_number: int = 0


@dataclass(slots=True)
class SupportBook:
    """Tracks supports over ticks; owned by one thread."""

    _known: dict[int, Support] = field(default_factory=dict)
    _misses: dict[int, int] = field(default_factory=dict)
    _next: int = 0

    @property
    def supports(self) -> tuple[Support, ...]:
        """All supports, ordered by number."""
        return tuple(self._known[number] for number in sorted(self._known))

    def remember(self) -> KeptSupports:
        """Return all that the book keeps from tick to tick."""
        return KeptSupports(
            supports=tuple(self._known.values()), next_number=self._next,
            misses=tuple(self._misses[number] for number in self._known),
        )

    def restore(self, kept: KeptSupports) -> None:
        """Go on from what a book kept."""
        self._known = {item.support_id: item for item in kept.supports}
        self._misses = dict(zip(self._known, kept.misses, strict=True))
        self._next = kept.next_number

    def follow(self, renamed: Callable[[SpanKey], SpanKey]) -> None:
        """Give all supports the numbers that their lines have now."""
        for number, item in self._known.items():
            lines = {renamed((line, -1))[0] for line in item.line_ids}
            self._known[number] = replace(item, line_ids=tuple(sorted(lines)))

    def update(
        self,
        supports: Sequence[Support],
        numbered: Mapping[SpanKey, SpanKey],
        holds: Holds,
        *,
        final: bool = False,
    ) -> dict[int, int]:
        """
        Update with the supports of one tick.

        Parameters
        ----------
        supports : sequence of Support
            With the tick's numbers of lines.
        numbered : mapping
            The tick's numbers of spans to the lasting ones.
        holds : callable
            Where the tick saw all there is; supports elsewhere are kept.
        final : bool
            Accept the tick at once.

        Returns
        -------
        dict of int to int
            The tick's numbers of supports to the lasting ones, of those that are kept.

        """
        lines = list_lines(numbered)
        told: dict[int, int] = {}
        taken: set[int] = set()
        carrying = [(support, own) for support in supports if (
            own := {number for line in support.line_ids for number in lines.get(line, ())}
        )]
        known = self._match([support for support, _ in carrying])
        for place, (support, carried) in enumerate(carrying):
            found = known.get(place)
            if found is None:
                number, self._next = self._next, self._next + 1
            else:
                number = found
            taken.add(number)
            told[support.support_id] = number
            if found is not None and not final and not holds(support.position[None])[0]:
                continue
            self._misses[number] = 0
            self._known[number] = replace(
                support, support_id=number, line_ids=tuple(sorted(carried))
            )
        for number in sorted(set(self._known) - taken):
            if not final and not holds(self._known[number].position[None])[0]:
                continue
            self._misses[number] += 1
            if final or self._misses[number] >= MAX_MISSES:
                del self._known[number], self._misses[number]
        return told

    def _match(self, supports: Sequence[Support]) -> dict[int, int]:
        """Return which known support those of a tick are, by their places in it."""
        pairs = []
        for place, support in enumerate(supports):
            for number, known in self._known.items():
                apart = float(np.linalg.norm(known.position[:2] - support.position[:2]))
                if apart <= SUPPORT_DISTANCE:
                    pairs.append((apart, number, place))
        return take_nearest(pairs)


def take_nearest(pairs: Sequence[tuple[Any, ...]]) -> dict[int, int]:
    """
    Return which known number each place in a tick has, the nearest first, each number once.

    Pairs are one or more distances, the number and the place.
    """
    result: dict[int, int] = {}
    used: set[int] = set()
    for *_, number, place in sorted(pairs):
        if place not in result and number not in used:
            result[place] = number
            used.add(number)
    return result


def list_lines(numbered: Mapping[SpanKey, SpanKey]) -> dict[int, set[int]]:
    """Return the lasting numbers of each line of a tick."""
    lines: dict[int, set[int]] = {}
    for (line, _), (number, _) in numbered.items():
        if number >= 0:
            lines.setdefault(line, set()).add(number)
    return lines
