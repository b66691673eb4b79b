# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Points of the corridor around the vehicle, and their lasting numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plc_inspect.results import Bool, Float32, Float64, InspectionResult, Int32, SpanKey, UInt8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CorridorPoints:
    """Points of the corridor around the vehicle."""

    points: Float64
    """(K, 3) map frame [m]."""
    classification: UInt8
    """(K,) PointClass."""
    clearance: Float32
    """(K,) distance to the nearest conductor [m]."""
    line_id: Int32
    """(K,) nearest conductor."""
    span_id: Int32
    """(K,) nearest span."""

    def select(self, chosen: Bool) -> 'CorridorPoints':
        """Return some of the points."""
        return CorridorPoints(
            points=self.points[chosen],
            classification=self.classification[chosen],
            clearance=self.clearance[chosen],
            line_id=self.line_id[chosen],
            span_id=self.span_id[chosen],
        )


def no_corridor() -> CorridorPoints:
    return CorridorPoints(
        points=np.empty((0, 3)),
        classification=np.empty(0, dtype=np.uint8),
        clearance=np.empty(0, dtype=np.float32),
        line_id=np.empty(0, dtype=np.int32),
        span_id=np.empty(0, dtype=np.int32),
    )


def map_numbers(
    line_id: Int32, span_id: Int32, numbered: Mapping[SpanKey, SpanKey]
) -> tuple[Int32, Int32]:
    """
    Translate (N,) numbers of lines and spans.

    Parameters
    ----------
    line_id, span_id : Int32
        (N,) numbers, -1 none.
    numbered : mapping
        Old to new numbers of spans.

    Returns
    -------
    tuple[Int32, Int32]
        (N,) new numbers, -1 for those not in ``numbered``.

    """
    width = int(max((key[1] for key in numbered), default=0)) + 2
    tall = int(max((key[0] for key in numbered), default=0)) + 2
    table = np.full((tall, width, 2), -1, dtype=np.int32)
    for (line, span), new in numbered.items():
        table[line, span] = new
    bad = (line_id < 0) | (span_id < 0) | (line_id >= tall - 1) | (span_id >= width - 1)
    both = table[np.where(bad, tall - 1, line_id), np.where(bad, width - 1, span_id)]
    return both[:, 0], both[:, 1]


def renumber(result: InspectionResult, numbered: Mapping[SpanKey, SpanKey]) -> InspectionResult:
    """
    Return a result whose points carry other numbers of lines and spans.

    Parameters
    ----------
    result : InspectionResult
        With numbers of its own.
    numbered : mapping
        Its numbers of spans to the new ones.

    Returns
    -------
    InspectionResult
        Spans, supports and hazards are those of ``result``.

    """
    line_id, span_id = map_numbers(result.line_id, result.span_id, numbered)
    near_line, near_span = map_numbers(
        result.corridor_line_id, result.corridor_span_id, numbered
    )
    others = result.line_id[result.corridor] < 0
    span_id[result.corridor[others]] = near_span[others]
    return replace(
        result, line_id=line_id, span_id=span_id,
        corridor_line_id=near_line, corridor_span_id=near_span,
    )
