# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tracks hazards over ticks, so that each keeps its number for the whole flight."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math

import numpy as np

from plc_inspect.core.hazards.confidence import AT_END
from plc_inspect.core.hazards.missing_conductors import LEAST_APART
from plc_inspect.core.numerics.boxes import measure_box_gap
from plc_inspect.core.tracking.support_tracking import (
    Holds,
    list_lines,
    MAX_MISSES,
    take_nearest,
)
from plc_inspect.results import Float64, Hazard, HazardKind, Span, SpanKey

HAZARD_DISTANCE = 2.0
"""
Greatest distance between the boxes of the same hazard in two ticks [m].
Source: judgement; not measured.
"""
CONFIRMATIONS = 2
"""Views that must show a hazard before it is raised.  Source: judgement; not measured."""
END_CONFIRMATIONS = 4
"""
The same near a support, which may not be wholly seen yet, or an end where none is known.
Source: judgement; not measured.
"""
END = 4.0
"""
Distance along the span from a support within which hazards wait [m].
Source: judgement; not measured.
"""
NOT_SEEN = f'{MAX_MISSES} consecutive looks at its place did not find it'
NOT_FINAL = 'it is not in the final result'
SPAN_GONE = 'its conductor no longer exists'
FOUND = 'the conductor is there'
"""Why a hazard is taken back."""

_ONE_PER_SPAN = (HazardKind.GROUND, HazardKind.INTERFERENCE, HazardKind.SAG)
_OF_SPAN = (HazardKind.INTERFERENCE, HazardKind.SAG, HazardKind.MISSING)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackedHazard:
    """A hazard with its lasting number."""

    hazard: Hazard
    hits: int = 1
    """Views that showed it."""
    misses: int = 0
    """Consecutive ticks that should have found it and did not."""
    softer: int = 0
    """Consecutive ticks that found it less severe."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HazardNews:
    """What one tick changed."""

    raised: tuple[Hazard, ...] = ()
    updated: tuple[Hazard, ...] = ()
    """Hazards whose severity changed."""
    cleared: tuple[Hazard, ...] = ()
    reasons: tuple[str, ...] = ()
    """Why each of the cleared ones was taken back."""

    def clear(self, hazards: Sequence[Hazard], reason: str) -> 'HazardNews':
        """Return these news with more cleared hazards."""
        return replace(
            self, cleared=(*self.cleared, *hazards),
            reasons=(*self.reasons, *[reason] * len(hazards)),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeptHazards:
    """State of the book of hazards between ticks."""

    hazards: tuple[TrackedHazard, ...] = ()
    """Hazards with negative numbers were not raised yet."""
    next_number: int = 0
    next_provisional: int = -1


@dataclass(slots=True)
class HazardBook:
    """Tracks hazards over ticks; owned by one thread."""

    _known: dict[int, TrackedHazard] = field(default_factory=dict)
    _next: int = 0
    _next_provisional: int = -1

    @property
    def hazards(self) -> tuple[Hazard, ...]:
        """All hazards that were raised and not cleared, ordered by number."""
        return tuple(
            self._known[number].hazard for number in sorted(self._known) if number >= 0
        )

    @property
    def awaited(self) -> Float64:
        """(W, 3) where hazards are that wait to be seen again before they are raised [m]."""
        places = [item.hazard.position for number, item in self._known.items() if number < 0]
        return np.array(places, dtype=np.float64).reshape(-1, 3)

    def remember(self) -> KeptHazards:
        """Return all that the book keeps from tick to tick."""
        return KeptHazards(
            hazards=tuple(self._known.values()), next_number=self._next,
            next_provisional=self._next_provisional,
        )

    def restore(self, kept: KeptHazards) -> None:
        """Go on from what a book kept."""
        self._known = {item.hazard.hazard_id: item for item in kept.hazards}
        self._next, self._next_provisional = kept.next_number, kept.next_provisional

    def update(
        self,
        hazards: Sequence[Hazard],
        numbered: Mapping[SpanKey, SpanKey],
        expected: Collection[SpanKey],
        holds: Holds,
        *,
        views: Sequence[int] | None = None,
        final: bool = False,
        complete: bool = True,
    ) -> HazardNews:
        """
        Update with the hazards of one tick.

        A hazard is raised when CONFIRMATIONS views of its place have shown it, or, near a
        support or an end where none is known, END_CONFIRMATIONS.  It becomes more severe at once;
        it becomes less severe, or is cleared, when MAX_MISSES ticks that saw its place agree.

        Parameters
        ----------
        hazards : sequence of Hazard
            With the tick's numbers of lines and spans.
        numbered : mapping
            The tick's numbers of spans to the lasting ones; hazards of spans with provisional
            numbers are left out.
        expected : collection of SpanKey
            Lasting numbers of the spans that the tick saw along their whole length.
        holds : callable
            Where the tick saw everything.
        views : sequence of int or None
            For how many views of each hazard the tick counts, by default for one.
        final : bool
            Accept the tick at once.
        complete : bool
            A final tick saw all there is; else a hazard that it found milder stays as it was.

        Returns
        -------
        HazardNews

        """
        # renumber, without spans that are not confirmed yet
        found = []
        for hazard, seen in zip(hazards, views or [1] * len(hazards), strict=True):
            key = numbered.get((hazard.line_id, hazard.span_id), (-1, -1))
            if min(key) >= 0:
                found.append((replace(hazard, line_id=key[0], span_id=key[1]), seen))
        raised, updated, cleared = [], [], []
        taken: set[int] = set()
        for (hazard, seen), number in zip(
            found, self._match([hazard for hazard, _ in found]), strict=True
        ):
            held = final or _is_expected(hazard, expected, holds)
            if number is None:
                if not held:
                    continue
                number = self._take_provisional()
                own = TrackedHazard(hazard=hazard, hits=seen)
            else:
                before = self._known.pop(number)
                # a tick that did not see what was nearest saw the rest of the object
                fair = held and (
                    (final and complete) or hazard.clearance <= before.hazard.clearance
                    or _is_expected(before.hazard, expected, holds)
                )
                own = _follow(before, hazard, seen if fair else 0, final)
                if number >= 0 and own.hazard.severity != before.hazard.severity:
                    updated.append(replace(own.hazard, hazard_id=number))
            enough = END_CONFIRMATIONS if _is_at_end(own.hazard) else CONFIRMATIONS
            if number < 0 and (final or own.hits >= enough):
                number, self._next = self._next, self._next + 1
                raised.append(replace(own.hazard, hazard_id=number))
            taken.add(number)
            self._known[number] = replace(own, hazard=replace(own.hazard, hazard_id=number))
        # count the misses of the others, where the tick should have found them
        for number in sorted(set(self._known) - taken):
            item = self._known[number]
            if not _is_expected(item.hazard, expected, holds):
                continue
            if not final and number >= 0 and item.hazard.kind == HazardKind.MISSING:
                continue  # a tick may hold the span, and not those beside it
            if not final and number >= 0 and item.misses + 1 < MAX_MISSES:
                self._known[number] = replace(item, misses=item.misses + 1)
                continue
            del self._known[number]
            if number >= 0:
                cleared.append(item.hazard)
        news = HazardNews(raised=tuple(raised), updated=tuple(updated))
        return news.clear(cleared, NOT_FINAL if final else NOT_SEEN)

    def follow(self, find_heir: Callable[[SpanKey, Float64], SpanKey]) -> None:
        """Give all hazards the numbers that the spans and lines of their places have now."""
        for number, item in self._known.items():
            own = item.hazard
            line, span = find_heir((own.line_id, own.span_id), own.position)
            other, _ = find_heir((own.other_line_id, -1), own.position)
            self._known[number] = replace(item, hazard=replace(
                own, line_id=line, span_id=span, other_line_id=other,
            ))

    def keep(self, keys: Collection[SpanKey]) -> tuple[Hazard, ...]:
        """Clear the hazards of all other spans, and return those that had been raised."""
        gone = [
            number for number, item in self._known.items()
            if (item.hazard.line_id, item.hazard.span_id) not in keys
        ]
        items = [self._known.pop(number) for number in gone]
        return tuple(item.hazard for item in items if item.hazard.hazard_id >= 0)

    def clear_gone(self, news: HazardNews, spans: Sequence[Span]) -> HazardNews:
        """Clear hazards of other spans, and conductors that are not missing; add them to news."""
        found = [
            number for number, item in self._known.items()
            if item.hazard.kind == HazardKind.MISSING
            and any(_passes(span, item.hazard.position) for span in spans)
        ]
        items = [self._known.pop(number).hazard for number in found]
        news = news.clear([item for item in items if item.hazard_id >= 0], FOUND)
        return news.clear(self.keep({(item.line_id, item.span_id) for item in spans}), SPAN_GONE)

    def _take_provisional(self) -> int:
        self._next_provisional -= 1
        return self._next_provisional

    def _match(self, hazards: Sequence[Hazard]) -> list[int | None]:
        """Return which known hazard each of a tick is, each at most once, the nearest first."""
        pairs = []
        for place, hazard in enumerate(hazards):
            for number, item in self._known.items():
                known = item.hazard
                if known.kind != hazard.kind:
                    continue
                same = (known.line_id, known.span_id) == (hazard.line_id, hazard.span_id)
                gap = measure_box_gap(known.extent, hazard.extent)
                if gap <= HAZARD_DISTANCE or (same and hazard.kind in _ONE_PER_SPAN):
                    apart = math.dist(known.position, hazard.position)
                    pairs.append((not same, gap, apart, number, place))
        result = take_nearest(pairs)
        return [result.get(place) for place in range(len(hazards))]


def carry_numbers(
    hazards: Sequence[Hazard], numbered: Mapping[SpanKey, SpanKey], supports: Mapping[int, int]
) -> list[Hazard]:
    """
    Return hazards that name supports and other lines by their lasting numbers.

    Parameters
    ----------
    hazards : sequence of Hazard
        With the tick's numbers.
    numbered, supports : mapping
        The tick's numbers of spans and of supports to the lasting ones; -1 where there is none.

    Returns
    -------
    list of Hazard
        Their own lines and spans have the tick's numbers still.

    """
    lines = list_lines(numbered)
    return [
        replace(
            item, support_id=supports.get(item.support_id, -1),
            other_line_id=min(lines.get(item.other_line_id, {-1})),
        )
        for item in hazards
    ]


def _follow(item: TrackedHazard, hazard: Hazard, seen: int, final: bool) -> TrackedHazard:
    """Return a known hazard as some views showed it, less severe only after several ticks."""
    known, hits = item.hazard, item.hits + seen
    if not seen:
        own = replace(known, line_id=hazard.line_id, span_id=hazard.span_id)
        return replace(item, hazard=own, misses=0)
    if hazard.severity < known.severity and not final and item.softer + 1 < MAX_MISSES:
        kept = replace(hazard, severity=known.severity)
        return TrackedHazard(hazard=kept, hits=hits, softer=item.softer + 1)
    return TrackedHazard(hazard=hazard, hits=hits)


def _passes(span: Span, place: Float64) -> bool:
    """Tell whether a span hangs at the place (3,) of a conductor that is missing [m]."""
    along = float((place - span.start)[:2] @ (span.end - span.start)[:2]) / span.length
    if not 0.0 <= along <= span.length:
        return False
    return math.dist(span.positions(np.array([along]))[0], place) < LEAST_APART


def _is_at_end(hazard: Hazard) -> bool:
    """Tell whether what raises a hazard may be a support, or a conductor that goes on."""
    return hazard.from_support <= END or AT_END in hazard.note


def _is_expected(hazard: Hazard, expected: Collection[SpanKey], holds: Holds) -> bool:
    if hazard.kind in _OF_SPAN:
        return (hazard.line_id, hazard.span_id) in expected
    return bool(holds(hazard.position[None])[0])
