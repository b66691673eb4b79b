# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sections: the conductors between the same two supports, with an axis in their middle."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plc_inspect.core.coverage.seen_ground import CELL
from plc_inspect.results import Float64, Span

BEYOND = 25.0
"""
Assumed length of a conductor beyond an end that was not seen [m].
Source: judgement: seeing that much shows whether a support follows.
"""
MOST_BRIDGED, NEAR_LINE = 300.0, 5.0
"""
Greatest distance along and across of facing open ends of one conductor [m].
Source: judgement: half of a long span was hidden; conductors of a line are farther apart in wind.
"""
MOST_ACROSS = 40.0
"""
Greatest distance across between conductors of one section [m].
Source: judgement: twice a wide crossarm.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """The spans between two supports, and the axis in their middle."""

    spans: tuple[Span, ...]
    origin: Float64
    """(2,) plan position of x = 0 [m]."""
    unit: Float64
    """(2,) direction of x; y is to the left of it."""
    high: float
    """Greatest x, beyond open ends included; the least is 0 [m]."""
    right: float
    """Least and greatest y of conductors [m]."""
    left: float

    @property
    def span_id(self) -> int:
        """span_id of all its spans."""
        return self.spans[0].span_id

    def enter(self, places: Float64) -> Float64:
        """Return x and y (N, 2) of positions (N, 2+) [m]."""
        apart = places[:, :2] - self.origin
        x, y = apart @ self.unit, apart @ np.array([-self.unit[1], self.unit[0]])
        return np.column_stack([x, y])

    def leave(self, x: Float64, y: float | Float64) -> Float64:
        """Return the plan positions (N, 2) of x and y (N,) [m]."""
        across = np.array([-self.unit[1], self.unit[0]])
        y = np.broadcast_to(np.asarray(y, dtype=np.float64), x.shape)
        places: Float64 = self.origin + x[:, None] * self.unit + y[:, None] * across
        return places


def find_sections(spans: Sequence[Span]) -> list[Section]:
    """Group spans into sections: spans of one span_id that hang side by side."""
    groups: list[list[Span]] = []
    for span in spans:
        for group in groups:
            first = group[0]
            unit = (first.end - first.start)[:2] / max(first.length, CELL)
            middle = (span.start + span.end)[:2] / 2 - first.start[:2]
            across = abs(middle[1] * unit[0] - middle[0] * unit[1])
            if first.span_id == span.span_id and across <= MOST_ACROSS:
                group.append(span)
                break
        else:
            groups.append([span])
    return [_lay_section(group, spans) for group in groups]


def _lay_section(group: Sequence[Span], spans: Sequence[Span]) -> Section:
    first = (group[0].end - group[0].start)[:2]
    ways = np.array([(span.end - span.start)[:2] for span in group])
    ways *= np.where(ways @ first < 0.0, -1.0, 1.0)[:, None]
    unit = ways.sum(axis=0) / max(float(np.linalg.norm(ways.sum(axis=0))), 1e-9)
    ends = np.array([(span.start[:2], span.end[:2]) for span in group]).reshape(-1, 2)
    section = Section(
        spans=tuple(group), origin=ends.mean(axis=0), unit=unit, high=0.0, right=0.0, left=0.0,
    )
    known = section.enter(ends)
    far = [known]
    for span in group:
        reach = np.array(find_reach(span, spans))
        x = np.array([-reach[0], span.length + reach[1]])
        far.append(section.enter(span.positions(x)))
    low, high = np.concatenate(far)[:, 0].min(), np.concatenate(far)[:, 0].max()
    origin = section.leave(np.array([low]), 0.0)[0]
    return replace(
        section, origin=origin, high=float(high - low), right=float(known[:, 1].min()),
        left=float(known[:, 1].max()),
    )


def find_reach(span: Span, spans: Sequence[Span]) -> tuple[float, float]:
    """
    Return the unseen length of a conductor beyond its start and its end [m].

    Facing open ends get half of the distance between them each; at a support it is 0.
    """
    found = []
    for is_open, end, other in (
        (span.open_start, span.start, span.end), (span.open_end, span.end, span.start),
    ):
        if not is_open:
            found.append(0.0)
            continue
        unit = (end - other)[:2] / max(span.length, CELL)
        reach = BEYOND
        for item in spans:
            for faces, place, inner in (
                (item.open_start, item.start, item.end), (item.open_end, item.end, item.start),
            ):
                if not faces or (inner - place)[:2] @ unit <= 0.0:  # it does not go on from there
                    continue
                apart = (place - end)[:2]
                along = float(apart @ unit)
                across = abs(float(apart[1] * unit[0] - apart[0] * unit[1]))
                if 0.0 < along <= MOST_BRIDGED and across <= NEAR_LINE:
                    reach = along / 2 if reach == BEYOND else min(reach, along / 2)
        found.append(reach)
    return found[0], found[1]


def find_reach_of(section: Section, span: Span) -> tuple[float, float]:
    """Return the unseen length of a span beyond its open ends, within its section [m]."""
    ends = section.enter(np.array([span.start, span.end]))[:, 0]
    turned = ends[0] > ends[1]
    first, last = max(float(ends.min()), 0.0), max(section.high - float(ends.max()), 0.0)
    before, after = (last, first) if turned else (first, last)
    return before if span.open_start else 0.0, after if span.open_end else 0.0


def find_heights(section: Section, x: Float64) -> Float64:
    """Return the least and greatest height of the conductors at x (K,) of the axis, (K, 2) [m]."""
    heights = []
    for span in section.spans:
        unit = (span.end - span.start)[:2] / max(span.length, CELL)
        along = (section.leave(x, 0.0) - span.start[:2]) @ unit
        heights.append(span.heights(np.clip(along, -BEYOND, span.length + BEYOND)))
    return np.column_stack([np.min(heights, axis=0), np.max(heights, axis=0)])
