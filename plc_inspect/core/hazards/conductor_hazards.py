# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazards of the conductors themselves: too close to each other, too much sag."""

from collections.abc import Sequence
import itertools
import math
import statistics
from typing import Any

import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import Limit, PLAIN_EDITION, RuleSet
from plc_inspect.core.hazards.crossings import find_ends, hang_together
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, HazardKind, Severity, Support

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
ALIKE = 1.0 / 3.0
"""
Share of the peers that sag as much, from which it is of their kind, or as warm as they are.
Source: derived: two of six conductors of a circuit may be wrong, not three.
"""
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
SAG_NOTE = (
    'compared with the other conductors of the span, which are taken to be as warm: ice, a '
    'slipped clamp and broken strands look alike'
)

Records = list[dict[str, Any]]


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
    beside = _find_beside(models)
    for i, first in enumerate(models):
        for second in itertools.compress(models[:i], beside[i]):
            x = np.linspace(first.start_x, first.end_x, NUM_STATIONS)
            other_x, _ = second.curve.local(first.curve.position(x))
            inside = (other_x >= second.low) & (other_x <= second.high)
            if inside.sum() < LEAST_STATIONS:
                continue
            at = first.strand_positions(x)
            _, horizontal, vertical = (
                part.reshape(at.shape[:2]) for part in second.part(at.reshape(-1, 3))
            )
            apart = np.hypot(horizontal, vertical)
            nearest = np.argmin(apart, axis=0), np.arange(NUM_STATIONS)  # sub-conductors
            at, horizontal, vertical, apart = (
                own[nearest] for own in (at, horizontal, vertical, apart)
            )
            apart[~inside] = np.inf
            held = [apart[k] for k in (np.flatnonzero(inside)[0], np.flatnonzero(inside)[-1])]
            required = settings.interference_ratio * float(min(held))
            worst = int(np.argmin(apart))
            if apart[worst] >= required:
                continue
            sigma = math.hypot(
                first.wire_sigma(float(x[worst])), second.wire_sigma(float(other_x[worst]))
            )
            if min(held) - apart[worst] <= SURE * sigma:
                continue
            result.append(describe_hazard(
                first, float(x[worst]), supports, rules, _own_limit(required),
                kind=HazardKind.INTERFERENCE,
                severity=Severity.WARNING,
                position=at[worst],
                clearance=float(apart[worst]),
                horizontal=float(horizontal[worst]),
                vertical=-float(vertical[worst]),
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
    on one row of poles do, or the share ALIKE of them sags as much, nothing is abnormal.

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
    for model, beside in zip(models, _find_beside(models), strict=True):
        peers = [
            other.span.sag / max(other.span.length, 1.0) ** 2
            for other in itertools.compress(models, beside)
            if other.span.length > PEER_LENGTH * model.span.length
        ]
        if len(peers) < LEAST_PEERS:
            continue
        middle = statistics.median(peers)
        usual = middle * model.span.length**2
        excess = model.span.sag - usual
        tolerated = max(settings.sag_deviation * usual, LEAST_EXCESS)
        alike = sum(excess - peer * model.span.length**2 + usual <= tolerated for peer in peers)
        if excess <= tolerated or alike >= ALIKE * len(peers):
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


def _find_beside(models: Sequence[SpanModel]) -> Bool:
    """Tell which (C, C) models are other conductors between the same supports."""
    start, end, span_id = find_ends(models)
    result: Bool = (span_id[:, None] == span_id) & ~np.eye(len(models), dtype=np.bool_)
    for number, own in enumerate(result):
        own[own] = hang_together(start[number], end[number], start[own], end[own])
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
