# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Names as a field crew uses them: structures, the spans between them, and conductors."""

from collections.abc import Sequence
import math

from plc_inspect.monitor.picture.picture import Place, SpanItem, SupportItem

REACH = 12.0
"""
A span ends at the nearest structure within this in plan [m].
Source: judgement: half the width of the crossarms of a large tower.
"""


def name_conductor(line_id: int) -> str:
    """Return the name of a conductor; points do not show its phase."""
    return f'conductor {line_id + 1}'


def name_stretch(span: SpanItem, supports: Sequence[SupportItem]) -> str:
    """
    Return the name of a span by its two structures.

    Parameters
    ----------
    span : SpanItem
        The span.
    supports : sequence of SupportItem
        All known supports.

    Returns
    -------
    str
        Such as ``structure 13 to 14``; a question mark stands for an unknown structure or an end
        not seen yet, and if both ends are unknown, the number of the span is used.

    """
    ends = [
        '?' if unseen else _find_structure(place, supports)
        for place, unseen in ((span.start, span.open_start), (span.end, span.open_end))
    ]
    if ends == ['?', '?']:
        return f'span {span.span_id}'
    return f'structure {ends[0]} to {ends[1]}'


def name_stretches(
    spans: Sequence[SpanItem], supports: Sequence[SupportItem]
) -> dict[tuple[int, int], str]:
    """Return the names of spans by line and span."""
    return {item.key: name_stretch(item, supports) for item in spans}


def find_foot(place: Place, supports: Sequence[SupportItem]) -> Place | None:
    """Return the foot of the structure at a point of a conductor, None unknown."""
    found = _find(place, supports)
    return None if found is None else found.position


def _find_structure(place: Place, supports: Sequence[SupportItem]) -> str:
    found = _find(place, supports)
    return '?' if found is None else str(found.support_id)


def _find(place: Place, supports: Sequence[SupportItem]) -> SupportItem | None:
    nearest = min(supports, key=lambda item: math.dist(item.position[:2], place[:2]), default=None)
    if nearest is None or math.dist(nearest.position[:2], place[:2]) > REACH:
        return None
    return nearest
