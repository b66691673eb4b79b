# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Registry of the spans found so far, so that a conductor keeps its numbers for the whole flight.

Each tick numbers lines and spans anew.  The registry recognises its spans by their position, and
gives new spans the numbers of the lines that they continue.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from plc_inspect.core.tracking.continuation import continue_lines, find_ends
from plc_inspect.core.tracking.span_matching import (
    connect,
    match_spans,
    may_overlap,
    Overlap,
    Piece,
)
from plc_inspect.core.tracking.span_numbers import number_spans
from plc_inspect.core.tracking.succession import Succession
from plc_inspect.core.tracking.tracked_span import KeptSpans, TrackedSpan
from plc_inspect.core.tracking.wire_points import thin_points, WirePoints
from plc_inspect.results import Float64, InspectionResult, Span, SpanKey

CONFIRMATIONS = 2
"""Views that show a span before it is numbered and published.  Source: judgement; not measured."""
MAX_MISSES = 3
"""
Consecutive ticks that must miss a span, or find less of it, before the registry follows.
Source: judgement; not measured.
"""
NOT_LESS = 0.9
"""Least share of a span that its successor covers at once.  Source: judgement; not measured."""
FINISHED_SPACING = 0.5
"""Spacing of the wire points of finished spans [m].  Source: judgement; not measured."""
CORNER = 0.15
"""
Greatest share of a span that reaches into a known one of which the window holds a part.
Source: measured: random ticks with poles missed and moved: with 0 the registry follows no pole
that moves by more than MIN_COMMON, with 0.3 twice as much is there twice.
"""
MAX_WAIT = 6
"""
Views that a new line waits to be joined to a known one ahead of whose end it lies.
Source: judgement; not measured.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tick:
    """What one tick found, and the known spans nearby."""

    found: Sequence[Span]
    known: Sequence[TrackedSpan]
    keys: Sequence[SpanKey]
    """Registry numbers of the found spans."""
    expected: set[SpanKey]
    wires: WirePoints
    views: Sequence[int]
    """For how many views of each span that was found the tick counts."""
    final: bool
    complete: bool


class SpanRegistry:
    """
    Tracks spans over ticks; owned by one thread.

    Unconfirmed spans have provisional numbers below -1.
    """

    def __init__(self) -> None:
        self._spans: dict[SpanKey, TrackedSpan] = {}
        self._next_line = 0
        self._next_span = 0
        self._next_provisional = -2
        self._agreed: Counter[tuple[str, int, int]] = Counter()
        self._succession = Succession()
        self.num_merges = 0
        """Number of lines merged into older ones since the start."""

    @property
    def spans(self) -> tuple[TrackedSpan, ...]:
        """All spans, ordered by line_id, then span_id."""
        return tuple(self._spans[key] for key in sorted(self._spans))

    def remember(self) -> KeptSpans:
        """Return the state of the registry."""
        return KeptSpans(
            spans=self.spans, next_line=self._next_line, next_span=self._next_span,
            next_provisional=self._next_provisional, num_merges=self.num_merges,
            agreed=tuple((*key, count) for key, count in sorted(self._agreed.items())),
        )

    def restore(self, kept: KeptSpans) -> None:
        """Continue from the state of a registry."""
        self._spans = {item.key: item for item in kept.spans}
        self._next_line, self._next_span = kept.next_line, kept.next_span
        self._next_provisional, self.num_merges = kept.next_provisional, kept.num_merges
        self._agreed = Counter({item[:3]: item[3] for item in kept.agreed})

    def update(
        self,
        result: InspectionResult,
        points: Float64,
        expected: Collection[SpanKey],
        *,
        views: Sequence[int] | None = None,
        final: bool = False,
        complete: bool = False,
    ) -> dict[SpanKey, SpanKey]:
        """
        Update with what one tick found.

        Parameters
        ----------
        result : InspectionResult
            Result of the tick's window.
        points : Float64
            (N, 3) points of the window [m].
        expected : collection of SpanKey
            Spans of the registry that were in the window along their whole length.
        views : sequence of int or None
            For how many views of each span of the result the tick counts, by default for one.
        final : bool
            The window is the whole map: accept its result at once.
        complete : bool
            The map holds all that was ever seen: accept its result for finished spans too.

        Returns
        -------
        dict[SpanKey, SpanKey]
            Numbers of spans in the result to those in the registry.

        """
        self._succession.clear()
        found, expected = list(result.spans), set(expected)
        known = self._look_about(found, expected, final)
        pairs = match_spans(found, [item.span for item in known])
        if self._merge(found, known, pairs, final):
            expected = {self.find_renamed(key) for key in expected}
            known = self._look_about(found, expected, final)
            pairs = match_spans(found, [item.span for item in known])
        keys = number_spans(found, known, pairs, self._take_provisional)
        tick = _Tick(
            found=found, known=known, keys=keys, expected=expected,
            wires=WirePoints(result, points), final=final, complete=complete,
            views=[1] * len(found) if views is None else views,
        )
        pairs = [pair for pair in pairs if final or not _is_corner(pair, found, known, expected)]
        for piece in connect(len(found), len(known), pairs):
            self._put(piece, tick)
        self._confirm(final)
        numbered = {}
        for span, key in zip(found, keys, strict=True):
            numbered[span.line_id, span.span_id] = self.find_renamed(key)
        return numbered

    def _look_about(
        self, found: Sequence[Span], expected: Collection[SpanKey], final: bool
    ) -> list[TrackedSpan]:
        """Return the spans that a result may update: nearby and expected ones; finally, all."""
        spans = self.spans
        about = may_overlap([item.span for item in spans], found)
        return [
            item for item, near in zip(spans, about.tolist(), strict=True)
            if final or near or item.key in expected
        ]

    def finish(self, keys: Collection[SpanKey]) -> None:
        """Freeze spans left behind and thin their points; drop unconfirmed ones."""
        for key in keys:
            item = self._spans[key]
            if not item.confirmed:
                del self._spans[key]
            elif not item.finished:
                chosen = thin_points(item.points, FINISHED_SPACING)
                self._spans[key] = replace(
                    item, finished=True, points=item.points[chosen],
                    residual=item.residual[chosen],
                )

    def _merge(
        self, found: Sequence[Span], known: Sequence[TrackedSpan], pairs: Sequence[Overlap],
        final: bool,
    ) -> bool:
        """Merge lines, and spans, that results number as one, unless both have spans in common."""
        merged = False
        for attribute in ('line_id', 'span_id'):
            groups: dict[int, set[int]] = {}
            for pair in pairs:
                number = getattr(known[pair.second].span, attribute)
                if number >= 0:
                    groups.setdefault(getattr(found[pair.first], attribute), set()).add(number)
            for numbers in groups.values():
                kept, *others = sorted(numbers)
                for gone in others:
                    self._agreed[attribute, kept, gone] += 1
                    if final or self._agreed[attribute, kept, gone] >= CONFIRMATIONS:
                        united = self._unite(attribute, kept, gone)
                        self.num_merges += united and attribute == 'line_id'
                        merged |= united
        return merged

    def _unite(self, attribute: str, kept: int, gone: int) -> bool:
        other = 'span_id' if attribute == 'line_id' else 'line_id'
        places: dict[int, set[int]] = {kept: set(), gone: set()}
        for item in self._spans.values():
            number = getattr(item.span, attribute)
            if number in places:
                places[number].add(getattr(item.span, other))
        if not places[gone] or not places[kept] or places[kept] & places[gone]:
            return False
        self._rename(attribute, gone, kept)
        return True

    def _rename(self, attribute: str, old: int, new: int) -> None:
        for key, item in list(self._spans.items()):
            if getattr(item.span, attribute) == old:
                del self._spans[key]
                line, span = (new, key[1]) if attribute == 'line_id' else (key[0], new)
                item = replace(item, span=replace(item.span, line_id=line, span_id=span))
                self._spans[item.key] = item
        self._succession.rename(attribute, old, new)

    def _take_provisional(self) -> int:
        self._next_provisional -= 1
        return self._next_provisional

    def _put(self, piece: Piece, tick: _Tick) -> None:
        """Replace known spans by those found in their place, or keep them."""
        own, items = piece.found, [tick.known[j] for j in piece.known]
        less = [
            item for j, item in zip(piece.known, items, strict=True)
            if sum(p.length for p in piece.pairs if p.second == j) < NOT_LESS * item.span.length
        ]
        longer = sum(tick.found[i].length for i in own) >= sum(item.span.length for item in items)
        expected = any(item.key in tick.expected for item in items)
        if items and not tick.final and not expected:
            return
        stubborn = not tick.complete and any(
            item.finished or not (tick.final or item.key in tick.expected) for item in less
        )
        patient = less and not longer and not tick.final and (
            max(item.misses for item in less) + 1 < MAX_MISSES
        )
        if stubborn or patient:
            shown = max((tick.views[i] for i in own), default=0)
            for item in items:
                misses = item.misses + (item.key in tick.expected) if item in less else 0
                if own or item.key in tick.expected:
                    key = self.find_renamed(item.key)
                    self._spans[key] = replace(
                        self._spans[key], misses=misses, hits=item.hits + shown
                    )
            return
        for item in items:
            del self._spans[self.find_renamed(item.key)]
        for i in own:
            matched = [tick.known[p.second] for p in piece.pairs if p.first == i]
            self._insert(tick, i, matched)
        self._pass_on(items)

    def _insert(self, tick: _Tick, place: int, matched: Sequence[TrackedSpan]) -> None:
        span, key = tick.found[place], self.find_renamed(tick.keys[place])
        lines = {self.find_renamed(item.key)[0] for item in matched if item.confirmed}
        for other in sorted(lines - {key[0]}):
            self.num_merges += self._unite('line_id', key[0], other)
        if key in self._spans:
            key = key[0], self._take_provisional()
        points, residual = tick.wires.take(span)
        numbered = replace(span, line_id=key[0], span_id=key[1])
        self._spans[key] = TrackedSpan(
            span=numbered,
            points=points,
            residual=residual,
            hits=tick.views[place] + max((item.hits for item in matched), default=0),
            confirmed=any(item.confirmed for item in matched) and min(key) >= 0,
        )
        for item in matched:
            self._succession.replace(item.key, key)

    def _pass_on(self, items: Sequence[TrackedSpan]) -> None:
        """Rename lines of which nothing is left to the one that took the place of their spans."""
        left = {item.span.line_id for item in self._spans.values()}
        for item in items:
            line = self.find_renamed(item.key)[0]
            heirs = {key[0] for key in self._succession.list_heirs(item.key)}
            if line not in left and len(heirs) == 1:
                self._succession.rename('line_id', line, heirs.pop())
                self.num_merges += line >= 0

    def _confirm(self, final: bool) -> None:
        """Give lasting numbers to spans found often enough."""
        ready = [
            item for item in self.spans
            if not item.confirmed and (final or item.hits >= CONFIRMATIONS)
        ]
        new = {item.span.line_id for item in ready if item.span.line_id < 0}
        continued, ahead = self._continue(new)
        for line in sorted(new, reverse=True):
            own = [item for item in ready if item.span.line_id == line]
            if line in continued and self._fits(line, continued[line]):
                self._rename('line_id', line, continued[line])
            elif final or line not in ahead or max(item.hits for item in own) >= MAX_WAIT:
                self._rename('line_id', line, self._next_line)
                self._next_line += 1
        groups = {
            item.span.span_id for item in self.spans
            if item.span.line_id >= 0 and (final or item.hits >= CONFIRMATIONS)
        }
        for group in sorted((number for number in groups if number < 0), reverse=True):
            self._rename('span_id', group, self._next_span)
            self._next_span += 1
        for key, item in list(self._spans.items()):
            if min(key) >= 0 and not item.confirmed and (final or item.hits >= CONFIRMATIONS):
                self._spans[key] = replace(item, confirmed=True)

    def _continue(self, new: Collection[int]) -> tuple[Mapping[int, int], frozenset[int]]:
        """Return `continue_lines` for lines with lasting numbers and new ones."""
        if not new:
            return {}, frozenset()
        spans = [item.span for item in self._spans.values()]
        return continue_lines(
            find_ends([span for span in spans if span.line_id >= 0]),
            find_ends([span for span in spans if span.line_id in new]),
        )

    def _fits(self, line: int, other: int) -> bool:
        places = [
            {item.span.span_id for item in self._spans.values() if item.span.line_id == number}
            for number in (line, other)
        ]
        return not places[0] & places[1]

    def find_renamed(self, key: SpanKey) -> SpanKey:
        """Return the numbers that the last update has given those of a key."""
        return self._succession.find(key)

    def find_heir(self, key: SpanKey, place: Float64) -> SpanKey:
        """Return the span that has the place (2+,) of another one since the last update."""
        return self._succession.find_heir(key, place, self._spans)


def _is_corner(
    pair: Overlap, found: Sequence[Span], known: Sequence[TrackedSpan], expected: set[SpanKey]
) -> bool:
    """Tell whether a found span only reaches into a known one that the window does not hold."""
    item, length = known[pair.second], found[pair.first].length
    return item.key not in expected and pair.length < min(
        CORNER * length, NOT_LESS * item.span.length
    )
