# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Finds the places where one line crosses another too closely."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.hazards.blur import is_blurred
from plc_inspect.core.hazards.breaches import judge_value
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, HazardKind, Int32, Support

CROSSING_ANGLE_DEG = 5.0
"""
Conductors that meet in plan at a smaller angle run along each other [degrees].
Source: judgement; not measured.
"""
ONE_PLACE = 15.0
"""
Distance within which crossings of conductors are one hazard [m].
Source: judgement; not measured.
"""
AT_SUPPORT = 5.0
"""
Spans that meet this close to an end of both hang on one support [m].
Source: judgement; not measured.
"""
NUM_ROUNDS = 4
"""
Rounds of the search for the closest approach of two spans.
Source: numerical: each narrows the range 40 times, to 0.1 mm of 500 m at last.
"""
NUM_PROBES = 81
"""Places of one such round.  Source: numerical: see NUM_ROUNDS."""
WIRE_STEP = 0.25
"""
Step along a wire that is no span at which its distance to conductors is measured [m].
Source: numerical: at a crossing the least distance is at most 0.02 m less at 1 m.
"""
WIRE_NOTE = 'the other line was seen, but not modelled'
NUM_STEPS = 4
"""Steps to the foot of a point on a curve.  Source: numerical: on sags of a tenth, 0.1 mm."""
SHORT = 0.01
"""Length over which the slope of a curve is taken [m].  Source: numerical: rounding is 1e-10."""
WIDEST = 25.0
"""
Distance in plan between ends of conductors that hang on one support [m].
Source: judgement; the widest towers of one level are 20 to 25 m wide.
"""

Records = list[dict[str, Any]]
"""Values of Hazards without their numbers."""


def find_crossings(
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    rules: RuleSet,
    wires: Sequence[Curve] = (),
    least_chance: float = 0.0,
) -> Records:
    """
    Find the places where one line crosses another too closely.

    Conductors that cross at one place are one hazard, at the least distance that is sure enough;
    its position is on the lower conductor.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.
    wires : sequence of Curve
        Curves of wires that were not modelled as spans.
    least_chance : float
        Probability that a crossing breaks a limit, at least.

    Returns
    -------
    list of dict
        Values of Hazard without its number.

    """
    limits = rules.find('line')
    if not limits:
        return []
    worst: dict[tuple[int, int], dict[str, Any]] = {}
    start, end, span_id = find_ends(models)
    for i, first in enumerate(models):
        beside = (span_id[:i] == span_id[i]) & hang_together(
            start[i], end[i], start[:i], end[:i]
        )
        crossed = _cross(start[i], end[i], start[:i], end[:i]) & ~beside
        for second in (models[k] for k in np.flatnonzero(crossed).tolist()):
            upper, lower, (x, other_x), (above, below) = _approach(first, second)
            clearance = math.dist(above, below)
            broken = judge_value(clearance, limits)
            if broken is None:
                continue
            key = (upper.span.span_id, lower.span.span_id)
            if key in worst and worst[key]['clearance'] <= clearance:
                continue
            record = describe_hazard(
                upper, x, supports, rules, broken[0],
                kind=HazardKind.CROSSING,
                severity=broken[1],
                position=below,
                clearance=clearance,
                horizontal=math.dist(above[:2], below[:2]),
                vertical=float(above[2] - below[2]),
                sigma=math.hypot(_find_sigma(upper, x), _find_sigma(lower, other_x)),
                num_points=0,
                offending=below[None],
                other_line_id=lower.span.line_id,
            )
            if record['chance'] >= least_chance:
                worst[key] = record
    kept: Records = []
    found = [*worst.values(), *(
        item for item in _cross_wires(models, wires, supports, rules)
        if item['chance'] >= least_chance
    )]
    for item in sorted(found, key=lambda item: float(item['clearance'])):
        if all(math.dist(item['position'], other['position']) > ONE_PLACE for other in kept):
            kept.append(item)
    return kept


def _cross_wires(
    models: Sequence[SpanModel], wires: Sequence[Curve], supports: Sequence[Support],
    rules: RuleSet,
) -> Records:
    """Return where wires that are no spans cross conductors."""
    result, limits = [], rules.find('line')
    for wire in wires:
        at = wire.position(np.linspace(
            wire.low, wire.high, max(NUM_PROBES, math.ceil(wire.length / WIRE_STEP))
        ))
        for model in models:
            if abs(math.sin(wire.azimuth - model.curve.azimuth)) < math.sin(
                math.radians(CROSSING_ANGLE_DEG)
            ):
                continue
            feet, away = _find_feet(model, at)
            apart = np.linalg.norm(away, axis=1)
            best = int(np.argmin(apart))
            x, clearance = float(feet[best]), float(apart[best])
            broken = judge_value(clearance, limits)
            inside = model.low + AT_SUPPORT < x < model.high - AT_SUPPORT
            if broken is None or not inside or best in (0, len(at) - 1):
                continue
            position = at[best] if away[best, 2] > 0 else at[best] + away[best]
            result.append(describe_hazard(
                model, x, supports, rules, broken[0],
                kind=HazardKind.CROSSING,
                severity=broken[1],
                position=position,
                clearance=clearance,
                horizontal=math.hypot(*away[best, :2]),
                vertical=float(away[best, 2]),
                sigma=math.hypot(_find_sigma(model, x), wire.fit.rmse),
                num_points=0,
                offending=position[None],
                note=WIRE_NOTE,
            ))
    return result


def _find_sigma(model: SpanModel, x: float) -> float:
    """Return the standard deviation of the place of a conductor [m]; blurred, it is not sure."""
    return model.wire_sigma(x) if is_blurred(model) else model.place_sigma(x)


def find_ends(models: Sequence[SpanModel]) -> tuple[Float64, Float64, Int32]:
    """Return (C, 2) start and end in plan [m], and the number, of the span of each model."""
    return (
        np.array([model.span.start[:2] for model in models]).reshape(-1, 2),
        np.array([model.span.end[:2] for model in models]).reshape(-1, 2),
        np.array([model.span.span_id for model in models], dtype=np.int32),
    )


def hang_together(
    start: Float64, end: Float64, others: Float64, other_ends: Float64
) -> Bool:
    """
    Tell which spans hang on the supports of one, or on some beside those, at both ends.

    Parameters
    ----------
    start, end : (2,) float64
        Of the one in plan [m].
    others, other_ends : (C, 2) float64
        Of the others [m].

    Returns
    -------
    (C,) bool

    """
    def apart(a: Float64, b: Float64) -> Float64:
        return np.hypot(*np.moveaxis(a - b, -1, 0))

    same = np.maximum(apart(others, start), apart(other_ends, end))
    turned = np.maximum(apart(others, end), apart(other_ends, start))
    result: Bool = np.minimum(same, turned) <= WIDEST
    return result


def _cross(start: Float64, end: Float64, others: Float64, other_ends: Float64) -> Bool:
    """Tell which others a span crosses in plan, between the ends and not at a common support."""
    (rx, ry), (sx, sy), (wx, wy) = end - start, (other_ends - others).T, (others - start).T
    area = rx * sy - ry * sx
    length, lengths = math.hypot(rx, ry), np.hypot(sx, sy)
    steep = np.abs(area) >= math.sin(math.radians(CROSSING_ANGLE_DEG)) * length * lengths
    steep &= area != 0.0
    area = np.where(steep, area, 1.0)
    t, u = (wx * sy - wy * sx) / area, (wx * ry - wy * rx) / area
    inside = (t > 0.0) & (t < 1.0) & (u > 0.0) & (u < 1.0)
    away = np.maximum(np.minimum(t, 1.0 - t) * length, np.minimum(u, 1.0 - u) * lengths)
    result: Bool = steep & inside & (away > AT_SUPPORT)
    return result


def _approach(
    first: SpanModel, second: SpanModel
) -> tuple[SpanModel, SpanModel, tuple[float, float], tuple[Float64, Float64]]:
    """Return upper and lower span, x of the closest places on their curves, and the places [m]."""
    low, high = first.start_x, first.end_x
    for _ in range(NUM_ROUNDS):
        x = np.linspace(low, high, NUM_PROBES)
        at = first.strand_positions(x)
        other, away = (part.reshape(len(at), -1, *part.shape[1:]) for part in _find_feet(
            second, at.reshape(-1, 3)
        ))
        apart = np.linalg.norm(away, axis=2)
        strand, best = divmod(int(np.argmin(apart)), NUM_PROBES)
        low, high = x[max(best - 1, 0)], x[min(best + 1, NUM_PROBES - 1)]
    own_x, other_x = float(x[best]), float(other[strand, best])
    place = at[strand, best]
    reached = place + away[strand, best]
    if reached[2] > place[2]:
        return second, first, (other_x, own_x), (reached, place)
    return first, second, (own_x, other_x), (place, reached)


def _find_feet(model: SpanModel, points: Float64) -> tuple[Float64, Float64]:
    """
    Return the nearest places of a span to points (K, 3).

    They are (K,) x of its curve and (K, 3) the way there, of the nearest sub-conductor [m].
    """
    curve = model.curve
    level = np.array([math.cos(curve.azimuth), math.sin(curve.azimuth)])
    feet, ways = np.zeros(len(points)), np.full((len(points), 3), np.inf)
    middle = np.array([0.5 * (model.low + model.high)])
    for shift in model.strand_positions(middle)[:, 0] - curve.position(middle):
        x = np.clip(curve.local(points - shift)[0], model.low, model.high)
        for _ in range(NUM_STEPS):
            away = curve.position(x) + shift - points
            slope = (curve.fit.height(x + SHORT) - curve.fit.height(x - SHORT)) / (2.0 * SHORT)
            along = away[:, :2] @ level + away[:, 2] * slope
            x = np.clip(x - along / (1.0 + slope**2), model.low, model.high)
        away = curve.position(x) + shift - points
        nearer = (away**2).sum(axis=1) < (ways**2).sum(axis=1)
        feet[nearer], ways[nearer] = x[nearer], away[nearer]
    return feet, ways
