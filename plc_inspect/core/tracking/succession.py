# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What became of the numbers of spans in one update of the registry."""

from collections.abc import Mapping

import numpy as np

from plc_inspect.core.tracking.tracked_span import TrackedSpan
from plc_inspect.results import Float64, Span, SpanKey


class Succession:
    """Lines and groups that got other numbers, and spans that took the place of others."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all changes."""
        self._names: dict[tuple[str, int], int] = {}
        self._heirs: dict[SpanKey, list[SpanKey]] = {}

    def rename(self, attribute: str, old: int, new: int) -> None:
        """Note that all spans of a ``line_id`` or ``span_id`` have another one now."""
        self._names[attribute, old] = new

    def replace(self, old: SpanKey, new: SpanKey) -> None:
        """Note that a span has, at least in part, the place of another one that is gone."""
        self._heirs.setdefault(old, []).append(new)

    def find(self, key: SpanKey) -> SpanKey:
        """Return the numbers that those of a key were renamed to."""
        line, span = key
        now = self._names.get(('line_id', line), line), self._names.get(('span_id', span), span)
        return now if now == key else self.find(now)

    def list_heirs(self, key: SpanKey) -> set[SpanKey]:
        """Return the spans that have the place of another one, by the numbers they have now."""
        return {self.find(item) for item in self._heirs.get(key, ())}

    def find_heir(
        self, key: SpanKey, place: Float64, spans: Mapping[SpanKey, TrackedSpan]
    ) -> SpanKey:
        """
        Return the span that has the place of another one at a position.

        Parameters
        ----------
        key : SpanKey
            As before the update.
        place : (2+,) float64
            Near the span in plan [m].
        spans : mapping
            After the update.

        Returns
        -------
        SpanKey
            That of the nearest of its successors; its own, renamed, if it has none.

        """
        now = self.find(key)
        heirs = self.list_heirs(key) & spans.keys()
        return min(
            sorted(heirs), key=lambda item: _measure_gap(spans[item].span, place), default=now
        )


def _measure_gap(span: Span, place: Float64) -> float:
    """Return the distance of a position from a span in plan [m]."""
    way = span.end[:2] - span.start[:2]
    share = (place[:2] - span.start[:2]) @ way / max(float(way @ way), 1e-9)
    return float(np.linalg.norm(span.start[:2] + np.clip(share, 0.0, 1.0) * way - place[:2]))
