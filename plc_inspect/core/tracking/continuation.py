# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Finds the known line that a new piece of conductor continues, if no joint was found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.numerics.assignment import assign
from plc_inspect.results import Float64, Span

MEETING = 5.0
"""Greatest distance of ends that meet at a support [m].  Source: judgement; not measured."""
MAX_GAP = 8.0
"""
Greatest distance along a line from its end to a piece that continues it [m].
Source: judgement; not measured.
"""
MAX_ACROSS = 1.0
"""Greatest offset of such a piece across the line [m].  Source: judgement; not measured."""
MAX_VERTICAL = 1.5
"""Greatest vertical offset of such a piece [m].  Source: judgement; not measured."""
MAX_TURN = math.radians(60.0)
"""Greatest turn of a line at a support [rad].  Source: judgement; not measured."""
REACH = 80.0
"""
Greatest distance ahead of the end of a line of a piece that may prove to be part of it [m].
Source: judgement; not measured.
"""
REACH_ACROSS = 3.0
"""
Greatest offset of such a piece across the extrapolated line [m].
Source: judgement; not measured.
"""
ALONG_WEIGHT = 0.1
"""Cost of a gap along the line, relative to an offset.  Source: judgement; not measured."""
LEAST_LENGTH = 1e-6
"""
Least length of the sum of two directions; if shorter, they are opposite.
Source: numerical: rounding of unit vectors.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineEnd:
    """A free end of a line."""

    line_id: int
    position: Float64
    """(3,) [m]."""
    outward: Float64
    """(2,) unit vector in plan that points away from the line."""


def find_ends(spans: Sequence[Span]) -> list[LineEnd]:
    """
    Find the ends of spans that no other span of the same line meets.

    Parameters
    ----------
    spans : sequence of Span
        All spans of all lines.

    Returns
    -------
    list[LineEnd]

    """
    by_line: dict[int, list[Span]] = {}
    for span in spans:
        by_line.setdefault(span.line_id, []).append(span)
    ends = []
    for line_id, own in by_line.items():
        for span in own:
            unit = np.array([math.cos(span.azimuth), math.sin(span.azimuth)])
            for position, outward in ((span.start, -unit), (span.end, unit)):
                met = any(
                    math.dist(position, end) <= MEETING
                    for other in own if other is not span for end in (other.start, other.end)
                )
                if not met:
                    ends.append(LineEnd(line_id=line_id, position=position, outward=outward))
    return ends


def continue_lines(
    known: Sequence[LineEnd], new: Sequence[LineEnd]
) -> tuple[Mapping[int, int], frozenset[int]]:
    """
    Find the known lines that new lines continue.

    Parameters
    ----------
    known, new : sequence of LineEnd
        Free ends of known and of new lines.

    Returns
    -------
    tuple[Mapping[int, int], frozenset[int]]
        New to known line_id, one to one at each end, and the new lines that may prove to continue
        a known one later, as they lie ahead of its end.

    """
    if not known or not new:
        return {}, frozenset()
    cost = np.full((len(new), len(known)), np.inf)
    ahead = set()
    for i, piece in enumerate(new):
        for j, end in enumerate(known):
            along, across, vertical = _compare(end, piece)
            if float(-piece.outward @ end.outward) < math.cos(MAX_TURN):
                continue
            if abs(along) <= MAX_GAP and across <= MAX_ACROSS and vertical <= MAX_VERTICAL:
                cost[i, j] = across + vertical + ALONG_WEIGHT * abs(along)
            elif 0 < along <= REACH and across <= REACH_ACROSS:
                ahead.add(piece.line_id)
    found: dict[int, int] = {}
    for i, j in assign(cost, MAX_ACROSS + MAX_VERTICAL + MAX_GAP):
        found.setdefault(new[i].line_id, known[j].line_id)
    return found, frozenset(ahead - set(found))


def _compare(end: LineEnd, piece: LineEnd) -> tuple[float, float, float]:
    """Return the offset of a piece's end from a line's end: along, across and vertical [m]."""
    mean = end.outward - piece.outward
    length = float(np.linalg.norm(mean))
    mean = mean / length if length > LEAST_LENGTH else end.outward
    apart = piece.position - end.position
    along = float(apart[:2] @ mean)
    across = abs(float(apart[1] * mean[0] - apart[0] * mean[1]))
    return along, across, abs(float(apart[2]))
