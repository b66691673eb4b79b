# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Results made by hand, for tests of what is written from them."""

import numpy as np
from toys import make_curve, make_wire

from plc_inspect.config import Settings
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.hazards.encroachments import Nearby
from plc_inspect.core.spans.span_model import SpanModel, tabulate
from plc_inspect.core.spans.spans import SpanResult
from plc_inspect.offline.records.inspection import Inspection
from plc_inspect.results import (
    Decision,
    Hazard,
    HazardKind,
    InspectionResult,
    PointClass,
    Severity,
    Span,
    StageReport,
    Support,
)

SPAN_LENGTH = 120.0
CONSTANT = 600.0
OFFSETS = (-4.0, 0.0, 4.0)


def make_span(line_id, span_id, start, end, c=CONSTANT, **changes):
    """Make a span from its two ends and the catenary constant, by the formula of physics."""
    start, end = np.array(start, float), np.array(end, float)
    delta = end - start
    length = float(np.hypot(delta[0], delta[1]))
    b = length / 2 - c * np.arcsinh(delta[2] / (2 * c * np.sinh(length / (2 * c))))
    a = start[2] - c * np.cosh(b / c)
    x = np.linspace(0.0, length, 1001)
    z = a + c * np.cosh((x - b) / c)
    chord = start[2] + x / length * delta[2]
    lowest = int(np.argmin(z))
    values = {
        'line_id': line_id,
        'span_id': span_id,
        'start': start,
        'end': end,
        'azimuth': float(np.arctan2(delta[1], delta[0])),
        'length': length,
        'a': float(a),
        'b': float(b),
        'c': float(c),
        'quadratic': tuple(np.polyfit(x, z, 2).tolist()),
        'sag': float(np.max(chord - z)),
        'lowest': start + np.array([*(delta[:2] * x[lowest] / length), z[lowest] - start[2]]),
        'open_start': False,
        'open_end': span_id == 1,
        'rmse': 0.025,
        'num_points': 240,
        'coverage': 0.95,
        'sigma': {'a': 1.5, 'b': 0.2, 'c': 1.5, 'sag': 0.012},
    }
    return Span(**(values | changes))


def make_model(start, end, line_id=0, span_id=0, *, c=800.0, points=None, tolerance=0.1,
               **changes):
    """Make a span with the curve of its points, by default exact ones; changes are its own."""
    if points is None:
        points = make_wire(start, end, c, noise=0.0, per_metre=20.0)
    curve = make_curve(points, tolerance=tolerance)
    (start_x, end_x), _ = curve.local(np.array([start, end], float))
    return SpanModel(span=make_span(line_id, span_id, start, end, c, **changes), curve=curve,
                     start_x=float(start_x), end_x=float(end_x))


def make_empty_result(num_points):
    """Make the result of a cloud without any line."""
    return InspectionResult(
        spans=(),
        supports=(),
        hazards=(),
        line_id=np.full(num_points, -1, np.int32),
        span_id=np.full(num_points, -1, np.int32),
        residual=np.full(num_points, np.nan, np.float32),
        clearance=np.full(num_points, np.nan, np.float32),
        classification=np.full(num_points, PointClass.GROUND, np.uint8),
        decision=np.full(num_points, Decision.GROUND, np.uint8),
        ground_height=np.zeros(num_points, np.float32),
        corridor=np.zeros(0, np.int64),
        corridor_line_id=np.zeros(0, np.int32),
        corridor_span_id=np.zeros(0, np.int32),
        stages=(StageReport(name='height', num_in=num_points, num_kept=0),),
    )


def make_inspection(origin=(0.0, 0.0, 0.0), num_ground=20_000, seed=1, **changes):
    """Make a run that found three lines in two spans, with one tree too near to line 0."""
    rng = np.random.default_rng(seed)
    origin = np.array(origin, float)
    spans, parts = [], []
    for line_id, offset in enumerate(OFFSETS):
        for span_id in range(2):
            span = make_span(
                line_id,
                span_id,
                origin + np.array([span_id * SPAN_LENGTH, offset, 15.0 + span_id]),
                origin + np.array([(span_id + 1) * SPAN_LENGTH, offset, 16.0 + span_id]),
            )
            spans.append(span)
            x = rng.uniform(0.0, SPAN_LENGTH, 240)
            z = span.a + span.c * np.cosh((x - span.b) / span.c)
            wire = np.column_stack((span.start[0] + x, np.full(240, span.start[1]), z))
            parts.append((wire + rng.normal(0, 0.02, wire.shape), PointClass.WIRE, line_id,
                          span_id))
    ground = rng.uniform((-20, -30, 0), (2 * SPAN_LENGTH + 20, 30, 0.05), (num_ground, 3))
    ground[:, 2] += 1.5 * np.sin(ground[:, 0] / 40.0)
    parts.append((origin + ground, PointClass.GROUND, -1, -1))
    tree = rng.normal(0, 1.0, (1500, 3))
    tree = tree / np.linalg.norm(tree, axis=1)[:, np.newaxis] * 2.5 * rng.random((1500, 1))**0.3
    spot = spans[0].lowest + np.array([10.0, -1.0, -4.0])
    parts.append((spot + tree, PointClass.VEGETATION, -1, -1))
    mast = rng.uniform((-0.2, -4.0, 0.0), (0.2, 4.0, 17.0), (900, 3))
    mast[:, 0] += SPAN_LENGTH
    parts.append((origin + mast, PointClass.TOWER, -1, -1))
    return _assemble(origin, spans, parts, changes)


def _assemble(origin, spans, parts, changes):
    points = np.concatenate([part[0] for part in parts])
    kind, line_id, span_id = (
        np.concatenate([np.full(len(part[0]), part[index], dtype) for part in parts])
        for index, dtype in ((1, np.uint8), (2, np.int32), (3, np.int32))
    )
    clearance = np.full(len(points), np.nan, np.float32)
    tree = np.flatnonzero(kind == PointClass.VEGETATION)
    x = np.linspace(0.0, SPAN_LENGTH, 600)
    curve = spans[0].start + np.column_stack((
        x, np.zeros(600), spans[0].a + spans[0].c * np.cosh((x - spans[0].b) / spans[0].c)
        - spans[0].start[2],
    ))
    distance = np.linalg.norm(points[tree, np.newaxis] - curve, axis=2)
    clearance[tree] = distance.min(axis=1)
    clearance[kind == PointClass.WIRE] = 0.0
    corridor = np.flatnonzero(np.isfinite(clearance))
    worst = tree[np.argmin(clearance[tree])]
    nearest = curve[np.argmin(np.linalg.norm(curve - points[worst], axis=1))]
    decision = np.select(
        [kind == PointClass.GROUND, kind == PointClass.WIRE, kind == PointClass.TOWER],
        [Decision.GROUND, Decision.WIRE, Decision.SUPPORT], Decision.NOT_LINEAR,
    ).astype(np.uint8)
    hazard = Hazard(
        hazard_id=0,
        line_id=0,
        span_id=0,
        kind=HazardKind.VEGETATION,
        severity=Severity.CRITICAL,
        position=points[worst],
        clearance=float(clearance[worst]),
        required=2.0,
        horizontal=float(np.hypot(*(points[worst] - nearest)[:2])),
        vertical=float(nearest[2] - points[worst, 2]),
        sigma=0.03,
        along_span=float(points[worst, 0] - spans[0].start[0]),
        num_points=40,
        extent=np.array([points[tree].min(axis=0), points[tree].max(axis=0)]),
        rule='vegetation, critical distance',
        edition='plc_inspect default',
        source='hazards.critical_distance',
    )
    result = InspectionResult(
        spans=tuple(spans),
        supports=tuple(
            Support(
                support_id=index, position=origin + np.array([index * SPAN_LENGTH, 0.0, 0.0]),
                height=17.0,
                kind='tower' if index == 1 else 'unseen', line_ids=(0, 1, 2),
            )
            for index in range(3)
        ),
        hazards=(hazard,),
        line_id=line_id,
        span_id=span_id,
        residual=np.where(kind == PointClass.WIRE, 0.02, np.nan).astype(np.float32),
        clearance=clearance,
        classification=kind,
        decision=decision,
        ground_height=(points[:, 2] - origin[2]).astype(np.float32),
        corridor=corridor,
        corridor_line_id=np.maximum(line_id[corridor], 0),
        corridor_span_id=np.maximum(span_id[corridor], 0),
        stages=(
            StageReport(
                name='height', num_in=len(points), num_kept=len(tree) + 1440, seconds=0.01,
                dropped={'ground': int((kind == PointClass.GROUND).sum()), 'too low': 12},
                values={'beta': 4.0, 'histogram': [1, 5, 9, 3, 2, 0, 0, 1, 4, 2], 'cells': 960},
            ),
            StageReport(
                name='linearity', num_in=len(tree) + 1440, num_kept=1440, seconds=0.2,
                dropped={'not linear': len(tree)},
                values={'voxel_sizes': [0.25, 0.5, 1.0, 2.0], 'by_scale': {'0.25': 3, '0.5': 9}},
            ),
            StageReport(name='catenary', num_in=1440, num_kept=1440, seconds=0.05),
        ),
    )
    values = {
        'result': result,
        'points': points,
        'settings': Settings(),
        'source': 'corridor.laz',
        'command': 'plc_survey',
    }
    return Inspection(**(values | changes))


def find_nearby(points, models, reach):
    """Return the points within reach of some spans, whatever they are."""
    if not models:
        return Nearby(index=np.zeros(0, int), distance=np.zeros(0), span=np.zeros(0, int))
    near, distance, owner = find_near(points, tabulate(models), np.full(len(models), reach))
    return Nearby(index=near, distance=distance.astype(float), span=owner.astype(np.int64))


def make_span_result(models, num_points, supports=(), ground=None):
    """Return spans among points none of which is wire or support."""
    return SpanResult(
        models=tuple(models),
        supports=tuple(supports),
        line_id=np.full(num_points, -1, dtype=np.int32),
        span_id=np.full(num_points, -1, dtype=np.int32),
        residual=np.full(num_points, np.nan, dtype=np.float32),
        support=np.zeros(num_points, dtype=bool),
        ground_below=tuple(ground or [np.zeros((0, 2))] * len(models)),
        intruders=np.zeros(0, dtype=np.int64),
    )
