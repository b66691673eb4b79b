# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Spans, supports and hazards of the picture, from the rows of the summary."""

from collections.abc import Sequence

from plc_inspect.monitor.picture.picture import (
    HazardItem,
    make_hazard,
    make_span,
    make_support,
    SpanItem,
    SupportItem,
)
from plc_inspect.monitor.picture.rows import RowBook

Items = tuple[tuple[SpanItem, ...], tuple[SupportItem, ...], tuple[HazardItem, ...]]


def list_items(rows: RowBook, before: Sequence[HazardItem], *, held: bool) -> Items:
    """
    Return spans, supports and hazards, each in the order of the tables.

    Parameters
    ----------
    rows : RowBook
        As received.
    before : sequence of HazardItem
        Hazards as they were; those whose rows did not come stay until the rows are settled.
    held : bool
        Hazards are held back: those of before stay as they were.

    Returns
    -------
    tuple of tuple

    """
    told = {} if held else rows['hazards']
    hazards = list(map(make_hazard, told.values()))
    if held or not rows.settled:
        hazards += [item for item in before if (item.hazard_id,) not in told]
    worst: dict[tuple[int, int], int] = {}
    for item in hazards:
        key = item.line_id, item.span_id
        worst[key] = max(worst.get(key, 0), item.severity)
    spans = [
        make_span(row, worst.get((key[0], key[1]), 0)) for key, row in rows['spans'].items()
    ]
    supports = [make_support(row) for row in rows['supports'].values()]
    return (
        tuple(sorted(spans, key=lambda item: (-item.severity, item.key))),
        tuple(sorted(supports, key=lambda item: item.support_id)),
        tuple(sorted(hazards, key=lambda item: (-item.severity, item.clearance, item.hazard_id))),
    )
