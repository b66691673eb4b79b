# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Spans, supports and labels of points from the final curves."""

from collections import Counter
from dataclasses import dataclass, replace
import math

import numpy as np

from plc_inspect.config import CatenarySettings, Settings
from plc_inspect.core.evidence.free_length import measure_free_length
from plc_inspect.core.evidence.validation import add_up
from plc_inspect.core.extraction.height import HeightResult
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.ground.ground_grid import GroundGrid
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.core.spans.attachments import settle_ends
from plc_inspect.core.spans.layout import Layout
from plc_inspect.core.spans.route import Route
from plc_inspect.core.spans.span_fit import (
    collect_points,
    CutCurve,
    fit_spans,
    follow_strays,
    measure_coverage,
)
from plc_inspect.core.spans.span_model import FittedSpan, model_span, SpanModel
from plc_inspect.core.spans.supports import place_supports
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64, Support

END_SLACK = 0.3
"""
Wire points may lie this far beyond the end of a span [m].
Source: judgement; holds from 0.15 to 0.6 on bench/constants.py.
"""
MAX_GROUND_GAP = 8.0
"""
No clearance above ground is given farther than this from where ground was seen [m].
Source: judgement; not measured.
"""
LEAST_POINTS = 3
"""
Points of a span, at least: as many as a catenary has parameters.
Source: derived: a catenary has three parameters.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanResult:
    """Spans with their curves, supports, and labels of N points."""

    models: tuple[SpanModel, ...]
    """Ordered by line, then span."""
    supports: tuple[Support, ...]
    line_id: Int32
    """(N,) -1 where no wire."""
    span_id: Int32
    """(N,) -1 where no wire."""
    residual: Float32
    """(N,) distance to the curve [m], NaN where no wire."""
    support: Bool
    """(N,) points of towers and poles."""
    ground_below: tuple[Float64, ...]
    """For each model (S, 2): distance from its start and height above ground [m]."""
    intruders: Int64
    """Points on a conductor that more likely belong to what surrounds it; no wire, no obstacle."""


def build_spans(
    cloud: OffGround,
    layout: Layout,
    route: Route,
    settings: Settings,
    rng: np.random.Generator,
) -> SpanResult:
    """
    Fit each span once more to all its points, and say where it hangs.

    Points are collected along the curve between its supports, so those that earlier stages
    dropped come back; MSAC and least squares then give the final catenary and its covariance.

    Parameters
    ----------
    cloud : OffGround
        Points off the ground.
    layout, route : Layout, Route
        The curves, and what they belong to.
    settings : Settings
        Settings of this stage.
    rng : numpy.random.Generator
        For MSAC.

    Returns
    -------
    SpanResult
        Labels of the points of ``cloud``.

    """
    points, index = cloud.points, cloud.index
    num = len(points)
    line_id = np.full(num, -1, dtype=np.int32)
    span_id = np.full(num, -1, dtype=np.int32)
    residual = np.full(num, np.nan, dtype=np.float32)
    finals = fit_spans(points, index, layout, settings.catenary, rng)
    layout, finals, end_sigma = settle_ends(layout, finals)
    collected = []
    for number, (chosen, distance) in enumerate(collect_points(points, index, finals, END_SLACK)):
        collected.append(chosen)
        nearer = ~(distance >= residual[chosen])
        chosen = chosen[nearer]
        line_id[chosen] = route.line_id[number]
        span_id[chosen] = route.span_id[number]
        residual[chosen] = distance[nearer]
    own = [
        chosen[(line_id[chosen] == line) & (span_id[chosen] == span)]
        for chosen, line, span in zip(collected, route.line_id, route.span_id, strict=True)
    ]
    kept = []
    for number, cut in enumerate(finals):
        # its ends may have been drawn past each other
        if len(own[number]) >= LEAST_POINTS and cut.high > cut.low:
            kept.append(number)
        else:
            gone = own[number]
            line_id[gone], span_id[gone], residual[gone] = -1, -1, np.nan
    wire = line_id >= 0
    supports, support_mask, closed = place_supports(
        cloud, wire, layout, route, finals, end_sigma, kept
    )
    for (number, side), (beyond, deviation) in closed.items():
        finals[number] = _lengthen(finals[number], side, beyond)
        end_sigma[number, (side + 1) // 2] = deviation
    is_open = {
        (number, side): station[number] < 0 and (number, side) not in closed
        for number in kept
        for side, station in ((-1, layout.start_station), (1, layout.end_station))
    }
    for number, side in (key for key, value in is_open.items() if value):
        cut = finals[number]
        beyond, chosen, distance = follow_strays(
            points, index, cut, side, line_id, max(route.line_id) + 1,
            len(own[number]) / (cut.high - cut.low),
        )
        finals[number] = _lengthen(cut, side, beyond)
        line_id[chosen], span_id[chosen] = route.line_id[number], route.span_id[number]
        residual[chosen] = distance
        own[number] = np.union1d(own[number], chosen)
    coverage = measure_coverage(points, index, finals)
    found = []
    for number in kept:
        found.append(FittedSpan(
            cut=finals[number],
            points=own[number],
            reverse=route.reverse[number],
            is_open=(is_open[number, -1], is_open[number, 1]),
            line_id=route.line_id[number],
            span_id=route.span_id[number],
            coverage=float(coverage[number]),
            end_sigma=(float(end_sigma[number, 0]), float(end_sigma[number, 1])),
        ))
    models = [model_span(points, fitted) for fitted in found]
    models.sort(key=lambda model: (model.span.line_id, model.span.span_id))
    return SpanResult(
        models=tuple(models),
        supports=supports,
        line_id=line_id,
        span_id=span_id,
        residual=residual,
        support=support_mask & (line_id < 0),
        ground_below=tuple(measure_ground_below(cloud.height, model) for model in models),
        intruders=np.zeros(0, dtype=np.int64),
    )


def _lengthen(cut: CutCurve, side: int, beyond: float) -> CutCurve:
    if side > 0:
        return replace(cut, high=cut.high + beyond)
    return replace(cut, low=cut.low - beyond)


def copy_labels(spans: SpanResult) -> SpanResult:
    """Return spans whose labels may be changed without changing those given."""
    return replace(
        spans, line_id=spans.line_id.copy(), span_id=spans.span_id.copy(),
        residual=spans.residual.copy(), support=spans.support.copy(),
    )


def spread_spans(spans: SpanResult, cloud: OffGround) -> SpanResult:
    """Return spans with labels of all N points, from those of the points off the ground."""
    return replace(
        spans,
        line_id=cloud.scatter(spans.line_id, -1),
        span_id=cloud.scatter(spans.span_id, -1),
        residual=cloud.scatter(spans.residual, math.nan),
        support=cloud.scatter(spans.support, False),
        intruders=cloud.place[spans.intruders].astype(np.int64),
    )


def measure_ground_below(height: HeightResult, model: SpanModel) -> Float64:
    """Return (K, 2) distance from the start and height above ground, where it is known [m]."""
    num = max(int(model.span.length), 2) + 1
    x = np.linspace(model.start_x, model.end_x, num)
    at = model.curve.position(x)
    clearance = at[:, 2] - height.ground.at(at[:, :2], MAX_GROUND_GAP)
    known = np.isfinite(clearance)
    return np.stack([model.along(x[known]), clearance[known]], axis=1)


def tell_evidence(
    cloud: OffGround, spans: SpanResult, sight: GroundGrid, settings: CatenarySettings
) -> SpanResult:
    """
    Tell of each span how much evidence there is that it is a conductor.

    Parameters
    ----------
    cloud : OffGround
        K points.
    spans : SpanResult
        With labels of these points.
    sight : GroundGrid
        Ground that was seen.
    settings : CatenarySettings
        What evidence is worth.

    Returns
    -------
    SpanResult

    """
    wire = spans.line_id >= 0
    beside = Counter(model.span.span_id for model in spans.models)

    def measure(model: SpanModel) -> SpanModel:
        span = model.span
        low, high = sorted((model.start_x, model.end_x))
        curve = replace(model.curve, low=low, high=high)
        free = measure_free_length(cloud.points, cloud.index, curve, wire, sight)
        evidence = add_up(curve, free, settings, beside=beside[span.span_id] > 1)
        return replace(model, span=replace(span, evidence=evidence))

    models = spans.models
    return replace(
        spans, models=tuple(call_each(lambda k: measure(models[k]), len(models)))
    )
