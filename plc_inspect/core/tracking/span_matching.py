# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Matches spans of two lists that belong to the same conductors."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.results import Bool, Float64, Span

TOLERANCE = 0.5
"""
Greatest median distance between two fits of the same conductor [m].
Source: judgement; not measured.
"""
MAX_ANGLE = math.radians(8.0)
"""
Greatest angle in plan between two fits of the same conductor [rad].
Source: judgement; not measured.
"""
MIN_COMMON = 4.0
"""Least common length of a match [m].  Source: judgement; not measured."""
SHARED = 0.3
"""
Overlap of two spans along a third, as a share of the shorter, above which they compete for it.
Source: judgement; not measured.
"""
NUM_SAMPLES = 9
"""Positions at which two spans are compared.  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """A span of the first list that coincides with one of the second."""

    first: int
    second: int
    low: float
    high: float
    """Where the overlap begins and ends, along the second span [m]."""
    gap: float
    """Median distance between the two [m]."""

    @property
    def length(self) -> float:
        """Common length [m]."""
        return self.high - self.low


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A connected group of found and known spans."""

    found: list[int]
    """Indices into the first list."""
    known: list[int]
    """Indices into the second list."""
    pairs: list[Overlap]
    """Overlaps that connect them."""


def measure_overlap(first: Span, second: Span) -> tuple[float, float, float] | None:
    """
    Measure where the first span lies along the second, and how far from it.

    Parameters
    ----------
    first, second : Span
        In the same frame.

    Returns
    -------
    tuple[float, float, float] or None
        Low and high end along the second, and median distance [m]; None where they do not lie
        side by side, differ in direction or share less than MIN_COMMON.

    """
    if abs(math.sin(first.azimuth - second.azimuth)) > math.sin(MAX_ANGLE):
        return None
    unit = np.array([math.cos(second.azimuth), math.sin(second.azimuth)])
    u0, u1 = (float((end[:2] - second.start[:2]) @ unit) for end in (first.start, first.end))
    low, high = max(0.0, min(u0, u1)), min(second.length, max(u0, u1))
    if high - low < MIN_COMMON:
        return None
    at = np.linspace(low, high, NUM_SAMPLES)
    share = (at - u0) / (u1 - u0)
    plan = first.start[:2] + share[:, None] * (first.end[:2] - first.start[:2])
    apart = plan - second.start[:2]
    across = apart[:, 1] * unit[0] - apart[:, 0] * unit[1]
    vertical = first.heights(share * first.length) - second.heights(at)
    return low, high, float(np.median(np.hypot(across, vertical)))


def match_spans(first: Sequence[Span], second: Sequence[Span]) -> list[Overlap]:
    """
    Pair the spans of two lists that belong to the same conductors.

    A span pairs with several of the other list only if these lie on different parts of it.  The
    closest pairs are chosen first, so that neighbouring conductors are not confused.

    Parameters
    ----------
    first, second : sequence of Span
        In the same frame.

    Returns
    -------
    list[Overlap]
        Ordered by distance.

    """
    found = []
    for i, j in _candidates(first, second):
        measured = measure_overlap(first[i], second[j])
        if measured is not None and measured[2] <= TOLERANCE:
            low, high, gap = measured
            found.append(Overlap(first=i, second=j, low=low, high=high, gap=gap))
    found.sort(key=lambda item: (item.gap, item.first, item.second))
    taken: list[Overlap] = []
    for item in found:
        rivals_on_second = [o for o in taken if o.second == item.second]
        rivals_on_first = [o for o in taken if o.first == item.first]
        if any(_share(item, other) for other in rivals_on_second):
            continue
        if any(_same_part(second[item.second], second[o.second]) for o in rivals_on_first):
            continue
        taken.append(item)
    return taken


def connect(num_found: int, num_known: int, pairs: Sequence[Overlap]) -> list[Piece]:
    """
    Group found and known spans that are connected by pairs.

    Parameters
    ----------
    num_found, num_known : int
        Number of spans of the first and second list.
    pairs : sequence of Overlap
        Their pairs.

    Returns
    -------
    list[Piece]
        A span without pairs is a piece of its own.

    """
    links = [(item.first, num_found + item.second) for item in pairs]
    label = unite(links, num_found + num_known).tolist()
    pieces = [
        Piece(found=[], known=[], pairs=[]) for _ in range(max(label, default=-1) + 1)
    ]
    for place, number in enumerate(label):
        if place < num_found:
            pieces[number].found.append(place)
        else:
            pieces[number].known.append(place - num_found)
    for pair in pairs:
        pieces[label[pair.first]].pairs.append(pair)
    return pieces


def may_overlap(spans: Sequence[Span], others: Sequence[Span]) -> Bool:
    """
    Tell which spans may overlap any of the others, by the box in plan about all others.

    Parameters
    ----------
    spans, others : sequence of Span
        In the same frame.

    Returns
    -------
    (N,) bool

    """
    if not spans or not others:
        return np.zeros(len(spans), dtype=np.bool_)
    low, high = _find_boxes(spans)
    low_others, high_others = _find_boxes(others)
    near: Bool = (
        (low <= high_others.max(axis=0)) & (high >= low_others.min(axis=0))
    ).all(axis=1)
    return near


def _find_boxes(spans: Sequence[Span]) -> tuple[Float64, Float64]:
    ends = np.array([(span.start, span.end) for span in spans])[:, :, :2]
    return ends.min(axis=1) - TOLERANCE, ends.max(axis=1) + TOLERANCE


def _candidates(first: Sequence[Span], second: Sequence[Span]) -> list[tuple[int, int]]:
    """Return the pairs whose boxes in plan overlap."""
    if not first or not second:
        return []
    (low_a, high_a), (low_b, high_b) = _find_boxes(first), _find_boxes(second)
    near = (
        (low_a[:, None] <= high_b[None]) & (high_a[:, None] >= low_b[None])
    ).all(axis=2)
    return [(int(i), int(j)) for i, j in np.argwhere(near)]


def _share(one: Overlap, other: Overlap) -> bool:
    common = min(one.high, other.high) - max(one.low, other.low)
    return common > SHARED * min(one.length, other.length)


def _same_part(one: Span, other: Span) -> bool:
    unit = np.array([math.cos(other.azimuth), math.sin(other.azimuth)])
    ends = [float((end[:2] - other.start[:2]) @ unit) for end in (one.start, one.end)]
    common = min(other.length, max(ends)) - max(0.0, min(ends))
    return common > SHARED * min(one.length, other.length)
