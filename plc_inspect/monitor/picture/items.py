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


def list_items(rows: RowBook, known: Sequence[HazardItem] | None) -> Items:
    """
    Return spans, supports and hazards, each in the order of the tables.

    Parameters
    ----------
    rows : RowBook
        As received.
    known : sequence of HazardItem or None
        Hazards used instead of the received ones; None: the received ones.

    Returns
    -------
    tuple of tuple

    """
    if known is None:
        known = list(map(make_hazard, rows['hazards'].values()))
    worst: dict[tuple[int, int], int] = {}
    for item in known:
        key = item.line_id, item.span_id
        worst[key] = max(worst.get(key, 0), item.severity)
    spans = [
        make_span(row, worst.get((key[0], key[1]), 0)) for key, row in rows['spans'].items()
    ]
    supports = [make_support(row) for row in rows['supports'].values()]
    return (
        tuple(sorted(spans, key=lambda item: (-item.severity, item.key))),
        tuple(sorted(supports, key=lambda item: item.support_id)),
        tuple(sorted(known, key=lambda item: (-item.severity, item.clearance, item.hazard_id))),
    )
