# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Numbers of the spans that one tick found, by those of the registry."""

from collections.abc import Callable, Sequence
import itertools
import math

from plc_inspect.core.tracking.span_matching import Overlap
from plc_inspect.core.tracking.tracked_span import TrackedSpan
from plc_inspect.results import Span, SpanKey

SAME = 0.6
"""Least common share of both spans that are the same.  Source: judgement; not measured."""


def number_spans(
    found: Sequence[Span], known: Sequence[TrackedSpan], pairs: Sequence[Overlap],
    take_provisional: Callable[[], int],
) -> list[SpanKey]:
    """
    Give a result's spans the registry's numbers, and new ones provisional numbers.

    Parameters
    ----------
    found : sequence of Span
        Of the result.
    known : sequence of TrackedSpan
        Of the registry.
    pairs : sequence of Overlap
        Of ``found`` and ``known``.
    take_provisional : callable
        Returns a number below -1 that is not in use.

    Returns
    -------
    list of SpanKey
        One for each of ``found``, all different.

    """
    lines = _number_lines(found, known, pairs, take_provisional)
    groups = _number_groups(found, known, pairs, take_provisional)
    same = {
        pair.first: known[pair.second].span.span_id for pair in pairs
        if pair.length >= SAME * max(
            found[pair.first].length, known[pair.second].span.length
        )
    }
    keys: list[SpanKey] = []
    for place, (span, line) in enumerate(zip(found, lines, strict=True)):
        group = same.get(place, -1)
        key = line, group if group >= 0 else groups[span.span_id]
        if key in keys:
            key = line, take_provisional()
        keys.append(key)
    return keys


def _number_lines(
    found: Sequence[Span], known: Sequence[TrackedSpan], pairs: Sequence[Overlap],
    take_provisional: Callable[[], int],
) -> list[int]:
    own: dict[int, int] = {}
    for pair in sorted(pairs, key=lambda item: (item.length, item.second)):
        number = known[pair.second].span.line_id
        before = own.get(pair.first, -1)
        if before < 0 or 0 <= number < before:
            own[pair.first] = number
    provisional: dict[int, int] = {}
    lines = []
    for place, span in enumerate(found):
        number = own.get(place, -1)
        if number < 0:
            siblings = [
                other for other, value in own.items()
                if value >= 0 and found[other].line_id == span.line_id
            ]
            if siblings:
                number = own[min(siblings, key=lambda item: _distance(found[item], span))]
            elif span.line_id in provisional:
                number = provisional[span.line_id]
            else:
                number = number if number < -1 else take_provisional()
                provisional[span.line_id] = number
        lines.append(number)
    return lines


def _number_groups(
    found: Sequence[Span], known: Sequence[TrackedSpan], pairs: Sequence[Overlap],
    take_provisional: Callable[[], int],
) -> dict[int, int]:
    """Map each span_id of the result to the one of the registry that it overlaps most."""
    common: dict[tuple[int, int], float] = {}
    for pair in pairs:
        both = found[pair.first].span_id, known[pair.second].span.span_id
        common[both] = common.get(both, 0.0) + pair.length
    numbers: dict[int, int] = {}
    order = sorted(common, key=lambda item: (item[1] < 0, -common[item], item))
    for group, number in order:
        if group not in numbers and number not in numbers.values():
            numbers[group] = number
    for span in found:
        if span.span_id not in numbers:
            numbers[span.span_id] = take_provisional()
    return numbers


def _distance(first: Span, second: Span) -> float:
    ends = itertools.product((first.start, first.end), (second.start, second.end))
    return min(math.dist(a, b) for a, b in ends)
