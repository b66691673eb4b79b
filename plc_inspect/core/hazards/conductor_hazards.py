# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazards of the conductors themselves: too close to each other, too much sag."""

from collections.abc import Sequence
import math
import statistics
from typing import Any

import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.hazards.clearance_rules import Limit, PLAIN_EDITION, RuleSet
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, HazardKind, Int32, Severity, Support

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
LEAST_EXCESS = 0.15
"""
Excess of sag over the peers that is tolerated in any case [m].
Source: judgement; not measured.
"""
LEAST_SIGMA = 0.01
"""Standard deviation of the sag of the peers, at least [m].  Source: judgement; not measured."""
SURE = 3.0
"""
Standard deviations beyond which a difference between conductors is not chance.
Source: derived: 0.3 % of normal errors lie beyond.
"""
LEAST_PEERS = 2
"""Peers that a sag is compared with at least.  Source: judgement; not measured."""
PEER_LENGTH = 0.7
"""A peer is longer than this share of the conductor.  Source: judgement; not measured."""
SIGMA_OF_MAD = 1.4826
"""
Standard deviation by the median absolute deviation.
Source: derived: 1 / 0.6745, the third quartile of the normal distribution.
"""
NUM_STATIONS = 41
"""
Places of a span at which its distance to another is measured.
Source: judgement; not measured.
"""
LEAST_STATIONS = 10
"""Of them, those that must lie beside the other span.  Source: judgement; not measured."""
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
SAG_NOTE = (
    'compared with the other conductors of the span, which are taken to be as warm: ice, a '
    'slipped clamp and broken strands look alike'
)

Records = list[dict[str, Any]]


def find_crossings(
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    rules: RuleSet,
    wires: Sequence[Curve] = (),
) -> Records:
    """
    Find the places where one line crosses another too closely.

    Conductors that cross at one place are one hazard, at the least distance; its position is on
    the lower conductor.

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

    Returns
    -------
    list of dict
        Values of Hazard without its number.

    """
    limits = rules.find('line')
    if not limits:
        return []
    limit = limits[0]
    worst: dict[tuple[int, int], dict[str, Any]] = {}
    start, end, span_id = _ends(models)
    for i, first in enumerate(models):
        crossed = _cross(start[i], end[i], start[:i], end[:i]) & (span_id[:i] != span_id[i])
        for second in (models[k] for k in np.flatnonzero(crossed).tolist()):
            upper, lower, x, other_x, clearance = _approach(first, second)
            severity = limit.judge(clearance)
            if severity is None:
                continue
            key = (upper.span.span_id, lower.span.span_id)
            if key in worst and worst[key]['clearance'] <= clearance:
                continue
            above = upper.curve.position(np.array(x))[0]
            below = lower.curve.position(np.array(other_x))[0]
            worst[key] = describe_hazard(
                upper, x, supports, rules, limit,
                kind=HazardKind.CROSSING,
                severity=severity,
                position=below,
                clearance=clearance,
                horizontal=math.dist(above[:2], below[:2]),
                vertical=float(above[2] - below[2]),
                sigma=math.hypot(upper.sigma(x), lower.sigma(other_x)),
                num_points=0,
                offending=below[None],
                other_line_id=lower.span.line_id,
            )
    kept: Records = []
    found = [*worst.values(), *_cross_wires(models, wires, supports, rules, limit)]
    for item in sorted(found, key=lambda item: float(item['clearance'])):
        if all(math.dist(item['position'], other['position']) > ONE_PLACE for other in kept):
            kept.append(item)
    return kept


def _cross_wires(
    models: Sequence[SpanModel], wires: Sequence[Curve], supports: Sequence[Support],
    rules: RuleSet, limit: Limit,
) -> Records:
    """Return where wires that are no spans cross conductors."""
    result = []
    for wire in wires:
        at = wire.position(np.linspace(
            wire.low, wire.high, max(NUM_STATIONS, math.ceil(wire.length / WIRE_STEP))
        ))
        for model in models:
            if abs(math.sin(wire.azimuth - model.curve.azimuth)) < math.sin(
                math.radians(CROSSING_ANGLE_DEG)
            ):
                continue
            x, horizontal, vertical = model.part(at)
            apart = np.hypot(horizontal, vertical)
            best = int(np.argmin(apart))
            severity = limit.judge(float(apart[best]))
            inside = model.low + AT_SUPPORT < x[best] < model.high - AT_SUPPORT
            if severity is None or not inside or best in (0, len(at) - 1):
                continue
            own = model.curve.position(x[best : best + 1])[0]
            position = at[best] if vertical[best] > 0 else own
            result.append(describe_hazard(
                model, float(x[best]), supports, rules, limit,
                kind=HazardKind.CROSSING,
                severity=severity,
                position=position,
                clearance=float(apart[best]),
                horizontal=float(horizontal[best]),
                vertical=abs(float(vertical[best])),
                sigma=math.hypot(model.sigma(float(x[best])), wire.fit.rmse),
                num_points=0,
                offending=position[None],
                note=WIRE_NOTE,
            ))
    return result


def _ends(models: Sequence[SpanModel]) -> tuple[Float64, Float64, Int32]:
    """Return (C, 2) start and end in plan [m], and the number, of the span of each model."""
    return (
        np.array([model.span.start[:2] for model in models]).reshape(-1, 2),
        np.array([model.span.end[:2] for model in models]).reshape(-1, 2),
        np.array([model.span.span_id for model in models], dtype=np.int32),
    )


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
) -> tuple[SpanModel, SpanModel, float, float, float]:
    """Return upper and lower span, x of the closest places on both, and their distance [m]."""
    low, high = first.start_x, first.end_x
    for _ in range(NUM_ROUNDS):
        x = np.linspace(low, high, NUM_PROBES)
        at = first.strand_positions(x)
        other, horizontal, vertical = (
            part.reshape(at.shape[:2]) for part in second.part(at.reshape(-1, 3))
        )
        strand, best = divmod(int(np.argmin(np.hypot(horizontal, vertical))), NUM_PROBES)
        low, high = x[max(best - 1, 0)], x[min(best + 1, NUM_PROBES - 1)]
    distance = float(np.hypot(horizontal, vertical)[strand, best])
    pair = (first, second, float(x[best]), float(other[strand, best]))
    if vertical[strand, best] > 0:
        pair = (second, first, pair[3], pair[2])
    return *pair, distance


def find_interference(
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    rules: RuleSet,
    settings: HazardSettings,
) -> Records:
    """
    Find conductors of a span that come much closer within it than at its ends.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.
    settings : HazardSettings
        Thresholds.

    Returns
    -------
    list of dict
        Values of Hazard without its number.

    """
    result = []
    for i, first in enumerate(models):
        for second in models[:i]:
            if first.span.span_id != second.span.span_id:
                continue
            x = np.linspace(first.start_x, first.end_x, NUM_STATIONS)
            at = first.curve.position(x)
            other_x, across = second.curve.local(at)
            low, high = second.low, second.high
            inside = (other_x >= low) & (other_x <= high)
            if inside.sum() < LEAST_STATIONS:
                continue
            gap = at[:, 2] - second.curve.fit.height(other_x)
            apart = np.where(inside, np.hypot(across, gap), np.inf)
            held = [apart[k] for k in (np.flatnonzero(inside)[0], np.flatnonzero(inside)[-1])]
            required = settings.interference_ratio * float(min(held))
            worst = int(np.argmin(apart))
            if apart[worst] >= required:
                continue
            sigma = math.hypot(first.sigma(float(x[worst])), second.sigma(float(other_x[worst])))
            if min(held) - apart[worst] <= SURE * sigma:
                continue
            result.append(describe_hazard(
                first, float(x[worst]), supports, rules, _own_limit(required),
                kind=HazardKind.INTERFERENCE,
                severity=Severity.WARNING,
                position=at[worst],
                clearance=float(apart[worst]),
                horizontal=abs(float(across[worst])),
                vertical=float(gap[worst]),
                sigma=sigma,
                num_points=0,
                offending=at[worst][None],
                other_line_id=second.span.line_id,
                **_own_rule('distance to the next conductor'),
            ))
    return result


def find_abnormal_sag(
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    rules: RuleSet,
    settings: HazardSettings,
) -> Records:
    """
    Find conductors that sag much more than the others of their span.

    Compares the sag over the square of the length, where LEAST_PEERS others have at least
    PEER_LENGTH of the length.  Where these differ among themselves, as cables of different kinds
    on one row of poles do, nothing is abnormal.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.
    settings : HazardSettings
        Thresholds.

    Returns
    -------
    list of dict
        Values of Hazard without its number; the clearance is the excess of sag.

    """
    result = []
    for model in models:
        peers = [
            other.span.sag / max(other.span.length, 1.0) ** 2
            for other in models
            if other.span.span_id == model.span.span_id and other is not model
            and other.span.length > PEER_LENGTH * model.span.length
        ]
        if len(peers) < LEAST_PEERS:
            continue
        middle = statistics.median(peers)
        usual = middle * model.span.length**2
        excess = model.span.sag - usual
        tolerated = max(settings.sag_deviation * usual, LEAST_EXCESS)
        if excess <= tolerated:
            continue
        spread = SIGMA_OF_MAD * statistics.median(abs(peer - middle) for peer in peers)
        sigma = math.hypot(model.span.sigma['sag'], LEAST_SIGMA, spread * model.span.length**2)
        if excess <= SURE * sigma:
            continue
        lowest = model.span.lowest
        x, _ = model.curve.local_place(lowest)
        result.append(describe_hazard(
            model, x, supports, rules, _own_limit(tolerated),
            kind=HazardKind.SAG,
            severity=Severity.WARNING,
            position=lowest.copy(),
            clearance=excess,
            horizontal=0.0,
            vertical=excess,
            sigma=sigma,
            num_points=model.span.num_points,
            offending=lowest[None],
            **_own_rule('sag against the other conductors'),
            note=SAG_NOTE,
        ))
    return result


def _own_limit(required: float) -> Limit:
    return Limit(feature='line', distance=required, tiers=((Severity.WARNING, required),))


def _own_rule(title: str) -> dict[str, str]:
    """Name the rule of a check that comes from the settings, whatever rule set is used."""
    return {
        'rule': title,
        'edition': PLAIN_EDITION,
        'source': 'settings of section hazards; no authority',
    }
