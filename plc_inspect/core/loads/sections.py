# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tension sections: groups of spans that share their tension."""

from collections.abc import Sequence
import math

from plc_inspect.core.hazards.conductor_hazards import SURE
from plc_inspect.results import Span

JOINT = 5.0
"""Greatest distance of span ends on one support [m].  Source: judgement; not measured."""
MAX_TURN_DEG = 3.0
"""Greatest turn between spans of a section [degrees].  Source: judgement; not measured."""
SAME_TENSION = 0.05
"""Greatest relative difference of c in a section.  Source: judgement; not measured."""
MOST_APART = 0.15
"""The same if c is uncertain.  Source: judgement; not measured."""


def group_sections(spans: Sequence[Span]) -> list[list[int]]:
    """
    Group the spans that share their tension.

    Parameters
    ----------
    spans : sequence of Span
        Of all lines.

    Returns
    -------
    list of list of int
        Indices of the spans of each section, along the line.

    """
    sections: list[list[int]] = []
    order = sorted(range(len(spans)), key=lambda i: (spans[i].line_id, spans[i].span_id))
    for i in order:
        if sections and _pull_alike(spans[sections[-1][-1]], spans[i]):
            sections[-1].append(i)
        else:
            sections.append([i])
    return sections


def _pull_alike(first: Span, second: Span) -> bool:
    if first.line_id != second.line_id or first.open_end or second.open_start:
        return False
    turn = math.remainder(second.azimuth - first.azimuth, 2 * math.pi)
    sigma = SURE * math.hypot(first.sigma.get('c', 0.0), second.sigma.get('c', 0.0))
    unsure = min(sigma, MOST_APART * first.c)
    return (
        math.dist(first.end, second.start) <= JOINT
        and abs(turn) <= math.radians(MAX_TURN_DEG)
        and abs(first.c - second.c) <= max(SAME_TENSION * first.c, unsure)
    )
