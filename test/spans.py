# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Spans and results made by hand, for tests of what is known over ticks."""

import math

import numpy as np

from plc_inspect.results import (
    Hazard,
    HazardKind,
    InspectionResult,
    PointClass,
    Severity,
    Span,
    Support,
)


def make_span(start, end, line_id=0, span_id=0, *, c=800.0, is_open=(False, False)):
    """Return a span whose curve hangs between two points with the catenary constant ``c``."""
    start, end = (np.array(place, dtype=np.float64) for place in (start, end))
    along = (end - start)[:2]
    length = float(np.hypot(*along))
    rise = float(end[2] - start[2])
    b = length / 2 - c * math.asinh(rise / (2 * c * math.sinh(length / (2 * c))))
    a = float(start[2]) - c * math.cosh(b / c)
    low = min(max(b, 0.0), length)
    lowest = start + (end - start) * (low / length)
    lowest[2] = a + c * math.cosh((low - b) / c)
    return Span(
        line_id=line_id, span_id=span_id, start=start, end=end,
        azimuth=math.atan2(along[1], along[0]), length=length, a=a, b=b, c=c,
        quadratic=(0.0, 0.0, 0.0), sag=c * (math.cosh(length / (2 * c)) - 1), lowest=lowest,
        open_start=is_open[0], open_end=is_open[1], rmse=0.02, num_points=int(length),
        coverage=1.0, sigma={'a': 0.01, 'b': 0.1, 'c': 1.0, 'sag': 0.01},
    )


def sample_points(span, num=None):
    """Return (N, 3) points on the curve of a span, one a metre by default."""
    x = np.linspace(0.0, span.length, num or max(2, int(span.length)))
    points = span.start + (span.end - span.start) * (x / span.length)[:, None]
    points[:, 2] = span.a + span.c * np.cosh((x - span.b) / span.c)
    return points


def make_hazard(position, line_id=0, span_id=0, **changes):
    """Return a hazard; its box is 1 m wide."""
    position = np.array(position, dtype=np.float64)
    values = {
        'hazard_id': 0, 'line_id': line_id, 'span_id': span_id, 'kind': HazardKind.VEGETATION,
        'severity': Severity.WARNING, 'position': position, 'clearance': 3.0, 'required': 4.0,
        'horizontal': 2.0, 'vertical': 2.0, 'sigma': 0.05, 'along_span': 20.0, 'num_points': 5,
        'extent': np.stack([position - 0.5, position + 0.5]), 'rule': 'r', 'edition': 'e',
        'source': 's',
    }
    return Hazard(**(values | changes))


def make_support(position, line_ids=(0,), **changes):
    """Return a pole."""
    values = {
        'support_id': 0, 'position': np.array(position, dtype=np.float64), 'height': 10.0,
        'kind': 'pole', 'line_ids': tuple(line_ids),
    }
    return Support(**(values | changes))


def make_result(spans, hazards=(), supports=()):
    """Return a result whose points are those of its spans, and the points."""
    parts = [sample_points(span) for span in spans]
    points = np.concatenate([np.empty((0, 3)), *parts])
    repeat = [len(part) for part in parts]
    line_id = np.repeat(np.array([s.line_id for s in spans], dtype=np.int32), repeat)
    span_id = np.repeat(np.array([s.span_id for s in spans], dtype=np.int32), repeat)
    num = len(points)
    result = InspectionResult(
        spans=tuple(sorted(spans, key=lambda s: (s.line_id, s.span_id))),
        supports=tuple(supports), hazards=tuple(hazards), line_id=line_id, span_id=span_id,
        residual=np.zeros(num, dtype=np.float32), clearance=np.zeros(num, dtype=np.float32),
        classification=np.full(num, PointClass.WIRE, dtype=np.uint8),
        decision=np.full(num, 8, dtype=np.uint8), ground_height=np.full(num, 9, dtype=np.float32),
        corridor=np.arange(num, dtype=np.int64), corridor_line_id=line_id.copy(),
        corridor_span_id=span_id.copy(), stages=(),
    )
    return result, points
