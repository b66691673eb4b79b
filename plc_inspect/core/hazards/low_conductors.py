# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors that hang too low above the ground, where that was seen."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Float64, HazardKind, Severity, Support

LEAST_GROUND = 0.5
"""
Height of a conductor above what may be ground, at least [m].
Source: derived: as labels.GROUND_BAND; what is nearer to a conductor is the conductor, seen before
the ground below it.
"""
STEEPEST = 1.0
"""
Slope of the ground along a span at most.
Source: judgement; a step up to a conductor is steeper.
"""
STEP = 1.0
"""Step of the ground along a span that may be steeper [m].  Source: judgement."""
GROUND_SIGMA = 0.05
"""
Standard deviation of the height of the ground below a conductor [m].
Source: judgement; not measured.
"""

Records = list[dict[str, Any]]


def find_low_conductors(
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    supports: Sequence[Support],
    rules: RuleSet,
) -> Records:
    """
    Find the spans that hang too low above the ground: one hazard a span, at its lowest place.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : sequence
        For each model (S, 2): distance from its start and height above ground [m].
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.

    Returns
    -------
    list of dict
        Values of Hazard without its number.

    """
    limits = rules.find('ground')
    if not limits:
        return []
    worst: dict[int, dict[str, Any]] = {}
    seen = [
        keep_seen(model, stations) for model, stations in zip(models, ground_below, strict=True)
    ]
    for limit in limits:
        for model, stations in zip(models, seen, strict=True):
            if not len(stations):
                continue
            clearance = float(stations[:, 1].min()) + model.lowest_strand
            severity = limit.judge(clearance)
            known = worst.get(model.span.span_id)
            if severity is None or (known and known['clearance'] <= clearance):
                continue
            worst[model.span.span_id] = _describe_low(
                model, stations, severity, limit, supports, rules
            )
    return list(worst.values())


def keep_seen(model: SpanModel, stations: Float64) -> Float64:
    """
    Leave out the places of a span whose ground is not the ground.

    While the ground below is not seen yet, the lowest that was seen is the conductor itself, or
    what hangs below it: there the ground would touch the conductor, or step up to it.

    Parameters
    ----------
    model : SpanModel
        The span.
    stations : (S, 2) float64
        Distance from its start, ascending, and height above ground [m].

    Returns
    -------
    (T, 2) float64

    """
    stations = stations[stations[:, 1] + model.lowest_strand >= LEAST_GROUND]
    if not len(stations):
        return stations
    along = stations[:, 0]
    ground = model.curve.fit.height(model.at(along)) - stations[:, 1]
    # the lowest that the ground can be, coming from either side
    ahead = np.minimum.accumulate(ground - STEEPEST * along) + STEEPEST * along
    behind = np.minimum.accumulate((ground + STEEPEST * along)[::-1])[::-1] - STEEPEST * along
    result: Float64 = stations[ground <= np.minimum(ahead, behind) + STEP]
    return result


def _describe_low(
    model: SpanModel, stations: Float64, severity: Severity, limit: Limit,
    supports: Sequence[Support], rules: RuleSet,
) -> dict[str, Any]:
    along, height = stations[int(np.argmin(stations[:, 1]))].tolist()
    clearance = height + model.lowest_strand
    x = float(model.at(np.array(along)))
    below = stations[:, 1] + model.lowest_strand < limit.reach
    run = model.curve.position(model.at(stations[below, 0]))
    run[:, 2] -= stations[below, 1]
    return describe_hazard(
        model, x, supports, rules, limit,
        kind=HazardKind.GROUND,
        severity=severity,
        position=model.curve.position(np.array(x))[0] - np.array([0.0, 0.0, height]),
        clearance=clearance,
        horizontal=0.0,
        vertical=clearance,
        sigma=math.hypot(model.sigma(x), GROUND_SIGMA),
        num_points=int(below.sum()),
        offending=run,
    )
