# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Names as a field crew uses them: structures, the spans between them, and conductors."""

from collections.abc import Sequence

import numpy as np

from plc_inspect.monitor.picture.picture import Place, SpanItem, SupportItem
from plc_inspect.results import Float64

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
    return name_stretches([span], supports)[span.key]


def name_stretches(
    spans: Sequence[SpanItem], supports: Sequence[SupportItem]
) -> dict[tuple[int, int], str]:
    """Return the names of spans by line and span."""
    names = {}
    for span, found in zip(spans, find_structures(spans, supports), strict=True):
        ends = [
            '?' if unseen or item is None else str(item.support_id)
            for item, unseen in zip(found, (span.open_start, span.open_end), strict=True)
        ]
        names[span.key] = f'span {span.span_id}' if ends == ['?', '?'] else (
            f'structure {ends[0]} to {ends[1]}'
        )
    return names


def find_structures(
    spans: Sequence[SpanItem], supports: Sequence[SupportItem]
) -> list[tuple[SupportItem | None, SupportItem | None]]:
    """Return the structures at start and end of each span, None unknown."""
    if not supports:
        return [(None, None) for _ in spans]
    feet = np.array([item.position[:2] for item in supports])
    result = []
    for span in spans:
        first, last = (_find(place, feet) for place in (span.start, span.end))
        result.append((
            None if first is None else supports[first], None if last is None else supports[last]
        ))
    return result


def _find(place: Place, feet: Float64) -> int | None:
    apart = np.hypot(feet[:, 0] - place[0], feet[:, 1] - place[1])
    nearest = int(apart.argmin())
    return nearest if apart[nearest] <= REACH else None
