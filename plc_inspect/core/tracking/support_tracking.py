# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tracks supports over ticks, so that each keeps its number for the whole flight."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

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
        for support in supports:
            carried = {number for line in support.line_ids for number in lines.get(line, ())}
            if not carried:
                continue
            found = self._find(support, taken)
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

    def _find(self, support: Support, taken: Collection[int]) -> int | None:
        apart = {
            number: float(np.linalg.norm(known.position[:2] - support.position[:2]))
            for number, known in self._known.items() if number not in taken
        }
        near = min(apart, key=lambda number: (apart[number], number), default=None)
        return near if near is not None and apart[near] <= SUPPORT_DISTANCE else None


def list_lines(numbered: Mapping[SpanKey, SpanKey]) -> dict[int, set[int]]:
    """Return the lasting numbers of each line of a tick."""
    lines: dict[int, set[int]] = {}
    for (line, _), (number, _) in numbered.items():
        if number >= 0:
            lines.setdefault(line, set()).add(number)
    return lines
