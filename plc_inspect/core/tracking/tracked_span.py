# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A tracked span, and the state of the registry."""

from dataclasses import dataclass

from plc_inspect.results import Float32, Float64, Span, SpanKey


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackedSpan:
    """A span with registry numbers, and its wire points."""

    span: Span
    points: Float64
    """(K, 3) wire points, map frame [m]."""
    residual: Float32
    """(K,) their distance to the curve [m]."""
    hits: int = 1
    """Ticks that found it."""
    misses: int = 0
    """Consecutive ticks that should have found it and did not."""
    confirmed: bool = False
    finished: bool = False
    """Left behind: replaced only by spans that cover as much of it or more."""

    @property
    def key(self) -> SpanKey:
        """line_id and span_id."""
        return self.span.line_id, self.span.span_id


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeptSpans:
    """State of the registry between ticks."""

    spans: tuple[TrackedSpan, ...] = ()
    """Ordered by line_id, then span_id."""
    next_line: int = 0
    next_span: int = 0
    next_provisional: int = -2
    agreed: tuple[tuple[str, int, int, int], ...] = ()
    """'line_id' or 'span_id', number kept, number merged into it, and ticks that agreed."""
    num_merges: int = 0
