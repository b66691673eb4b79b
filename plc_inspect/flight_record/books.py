# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The books of spans, supports and hazards in a record: changes, and books rebuilt from them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.live.session import Kept
from plc_inspect.core.setup.looks import Spread
from plc_inspect.core.setup.plumb import Leans, NO_LEANS
from plc_inspect.core.tracking.hazard_tracking import KeptHazards, TrackedHazard
from plc_inspect.core.tracking.support_tracking import KeptSupports
from plc_inspect.core.tracking.tracked_span import KeptSpans, TrackedSpan
from plc_inspect.errors import DataError
from plc_inspect.flight_record.plain_values import from_plain, to_plain
from plc_inspect.results import Span, Support

_NO_POINTS = np.empty((0, 3)), np.empty(0, dtype=np.float32)


class BookWriter:
    """Finds the changes of the books since they were last written; kept values are immutable."""

    def __init__(self) -> None:
        self._first = True
        self._spans: dict[Any, TrackedSpan] = {}
        self._hazards: dict[Any, TrackedHazard] = {}
        self._supports: dict[Any, Support] = {}
        self._spreads: tuple[Spread, ...] = ()
        self._leans: Leans = NO_LEANS

    def describe(self, kept: Kept) -> tuple[dict[str, Any], dict[str, NDArray[Any]] | None]:
        """
        Return what changed.

        Parameters
        ----------
        kept : Kept
            What the session keeps now.

        Returns
        -------
        dict
            For JSON.
        dict or None
            Wire points of spans whose points changed, None if none did.

        """
        spans = {item.key: item for item in kept.spans.spans}
        hazards = {item.hazard.hazard_id: item for item in kept.hazards.hazards}
        supports = {item.support_id: item for item in kept.supports.supports}
        news = {
            'all': self._first,
            'spans': [_describe_span(item) for item in _find_new(self._spans, spans)],
            'no_spans': [list(key) for key in self._spans.keys() - spans.keys()],
            'span_numbers': to_plain(replace(kept.spans, spans=())),
            'hazards': [to_plain(item) for item in _find_new(self._hazards, hazards)],
            'no_hazards': sorted(self._hazards.keys() - hazards.keys()),
            'hazard_numbers': to_plain(replace(kept.hazards, hazards=())),
            'supports': [to_plain(item) for item in _find_new(self._supports, supports)],
            'no_supports': sorted(self._supports.keys() - supports.keys()),
            'support_numbers': {'next_number': kept.supports.next_number},
            'misses': [
                [item.support_id, number] for item, number in zip(
                    kept.supports.supports, kept.supports.misses, strict=True
                ) if number
            ],
            'spreads': to_plain(_find_later(self._spreads, kept.spreads)),
            'num_spreads': len(kept.spreads),
        }
        if kept.leans is not self._leans:
            news['leans'] = to_plain(kept.leans)
        moved = [
            item for key, item in spans.items()
            if key not in self._spans or self._spans[key].points is not item.points
        ]
        self._first = False
        self._spans, self._hazards, self._supports = spans, hazards, supports
        self._spreads, self._leans = kept.spreads, kept.leans
        return news, _gather_wires(moved) if moved else None


def _find_new(before: Mapping[Any, Any], now: Mapping[Any, Any]) -> list[Any]:
    return [item for key, item in now.items() if before.get(key) is not item]


def _find_later(before: Sequence[Spread], now: Sequence[Spread]) -> Sequence[Spread]:
    """Return the entries added since; old entries are dropped in order of arrival."""
    known = {id(item) for item in before}
    return [item for item in now if id(item) not in known]


def _describe_span(item: TrackedSpan) -> dict[str, Any]:
    return {
        'span': to_plain(item.span), 'hits': item.hits, 'misses': item.misses,
        'confirmed': item.confirmed, 'finished': item.finished,
    }


def _gather_wires(spans: Sequence[TrackedSpan]) -> dict[str, NDArray[Any]]:
    """Return wire points relative to the start of their span, as float32: exact to 0.02 mm."""
    return {
        'spans': np.array([item.key for item in spans], dtype=np.int32),
        'starts': np.array([item.span.start for item in spans]),
        'num_points': np.array([len(item.points) for item in spans], dtype=np.int64),
        'points': np.concatenate([
            (item.points - item.span.start).astype(np.float32) for item in spans
        ]),
        'residual': np.concatenate([item.residual for item in spans]),
    }


@dataclass(slots=True)
class BookReader:
    """Rebuilds the books from their changes."""

    _spans: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    _wires: dict[tuple[int, int], tuple[Any, Any]] = field(default_factory=dict)
    _hazards: dict[int, Any] = field(default_factory=dict)
    _supports: dict[int, Any] = field(default_factory=dict)
    _spreads: list[Any] = field(default_factory=list)
    _leans: Any = None
    _last: dict[str, Any] = field(default_factory=dict)

    def put(self, news: Mapping[str, Any]) -> None:
        """Apply changes from ``BookWriter``; DataError if they are inconsistent."""
        try:
            for key in news['no_spans']:
                self._spans.pop(tuple(key), None)
                self._wires.pop(tuple(key), None)
            for book, name, gone in (
                (self._hazards, 'hazard', 'no_hazards'), (self._supports, '', 'no_supports'),
            ):
                for number in news[gone]:
                    book.pop(number, None)
                for item in news['hazards' if name else 'supports']:
                    book[item[name]['hazard_id'] if name else item['support_id']] = item
            for item in news['spans']:
                self._spans[item['span']['line_id'], item['span']['span_id']] = item
            # a record of an earlier version has none
            self._spreads += news.get('spreads', [])
            del self._spreads[:max(len(self._spreads) - int(news.get('num_spreads', 0)), 0)]
            self._leans = news.get('leans', self._leans)
            self._last = {
                name: news[name] for name in
                ('span_numbers', 'hazard_numbers', 'support_numbers', 'misses')
            }
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f'these are not books: {type(error).__name__}: {error}') from error

    def put_wires(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Set the wire points of some spans; DataError if they are inconsistent."""
        try:
            ends = np.cumsum(arrays['num_points'])
            points = np.split(arrays['points'].astype(np.float64), ends[:-1])
            residuals = np.split(arrays['residual'], ends[:-1])
            for key, start, own, residual in zip(
                arrays['spans'].tolist(), arrays['starts'], points, residuals, strict=True
            ):
                self._wires[tuple(key)] = own + start, residual
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise DataError(f'these are not points: {type(error).__name__}: {error}') from error

    def build(self) -> Kept:
        """Return the books; DataError if they are inconsistent."""
        if not self._last:
            return Kept()
        spans = tuple(self._build_span(key) for key in sorted(self._spans))
        hazards = tuple(from_plain(TrackedHazard, self._hazards[n]) for n in sorted(self._hazards))
        supports = tuple(from_plain(Support, self._supports[n]) for n in sorted(self._supports))
        misses: dict[int, int] = dict(self._last['misses'])
        return Kept(
            spans=replace(from_plain(KeptSpans, self._last['span_numbers']), spans=spans),
            hazards=replace(
                from_plain(KeptHazards, self._last['hazard_numbers']), hazards=hazards
            ),
            supports=KeptSupports(
                supports=supports, next_number=int(self._last['support_numbers']['next_number']),
                misses=tuple(misses.get(item.support_id, 0) for item in supports),
            ),
            spreads=from_plain(tuple[Spread, ...], self._spreads),
            leans=from_plain(Leans, self._leans) if self._leans else NO_LEANS,
        )

    def _build_span(self, key: tuple[int, int]) -> TrackedSpan:
        item = self._spans[key]
        points, residual = self._wires.get(key, _NO_POINTS)
        return TrackedSpan(
            span=from_plain(Span, item['span']), points=points, residual=residual,
            hits=item['hits'], misses=item['misses'], confirmed=item['confirmed'],
            finished=item['finished'],
        )
