# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Conductors that are missing over one span: they may be down.

A conductor that ends at a support, goes on at the next one in the same place beside the others of
the line, and of which nothing lies in between where the others are seen well, is not there.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from plc_inspect.core.hazards.clearance_rules import Limit, PLAIN_EDITION, RuleSet
from plc_inspect.core.hazards.crossings import WIDEST
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Float64, HazardKind, Severity, Support

ALONG, ASIDE = 3.0, 0.7
"""
Distances along the line and across it from where it would hang beside another conductor, within
which one ends [m].
Source: judgement: dead ends are up to 2 m from the middle of a crossarm; sags and errors of ends.
"""
GOES_ON = 0.2
"""
A conductor goes on where another one ends within this of its end [m].
Source: derived: less than the distance between wires of a rack; joined spans end in one place.
"""
TURN = math.cos(math.radians(60.0))
"""Cosine of the turn of a line at a support, at least.  Source: as continuation.MAX_TURN."""
LEAST_DENSITY, LEAST_COVERAGE, LEAST_POINTS = 1.0, 0.8, 50
"""
Points a metre of those beside it, share of their length that is seen, and points that would be
seen of it, at least.
Source: judgement: of 50, chance leaves none; a wire far from the lidar has less of a metre.
"""
TUBE = 1.0
"""
Distance from where it would hang within which what is nearer to it than to a conductor is its own
[m].
Source: judgement: sags of conductors of a span differ by less.
"""
LEAST_APART = 0.4
"""
Distance to the next conductor, at least: one that is nearer may be that one, seen twice [m].
Source: derived: twice by what drift that is mended doubles a map (docs/ingest.md).
"""
MOST_SEEN = 0.1
"""
Share of the metres of its length that may be seen.
Source: judgement: ends of what hangs down, a crossing line.
"""
LEAST_FILLED = 0.2
"""
Share of the points of one metre of those beside it from which a metre is seen; one at least.
Source: judgement: strays of the conductors beside it are fewer.
"""
STEP = 1.0
"""Length of a piece of it in which something is seen or not [m].  Source: numerical."""
MISSING_NOTE = (
    'it may be down: both spans beside have it, and hardly anything was seen where it would hang'
)

Records = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """An end of a conductor at which it does not go on."""

    model: SpanModel
    place: Float64
    """(3,) [m]."""
    outward: Float64
    """(2,) unit vector in plan, away from the conductor."""


def find_missing_conductors(
    points: Float64, models: Sequence[SpanModel], supports: Sequence[Support], rules: RuleSet,
) -> Records:
    """
    Find conductors that are missing over one span between two in which they are.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    models : sequence of SpanModel
        Spans with their curves.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.

    Returns
    -------
    list of dict
        Values of Hazard without its number, of the conductor beside; the clearance is the length
        of which anything was seen, ``required`` that of the span.

    """
    ends = _list_ends(models)
    groups: dict[int, list[SpanModel]] = {}
    for model in models:
        groups.setdefault(model.span.span_id, []).append(model)
    result = []
    for group in groups.values():
        pairs = _pair_ends(group, ends)
        if len(pairs) >= len(group):  # a line that ends, and another one that begins
            continue
        for first, last in pairs:
            nearest = min(group, key=lambda model: math.dist(model.span.start, first.place))
            expected = _hang(nearest, first.place, last.place)
            length = math.dist(first.place[:2], last.place[:2])
            beside = (first.model, last.model, nearest)
            density = min(item.span.num_points / item.span.length for item in beside)
            middle = expected[len(expected) // 2]
            apart = min(
                math.hypot(*(part[0] for part in model.part(middle[None])[1:])) for model in group
            )
            if density * length < LEAST_POINTS or apart < LEAST_APART:
                continue
            seen = _measure_seen(points, expected, group, LEAST_FILLED * density)
            if seen > MOST_SEEN * length:
                continue
            x = 0.5 * (nearest.start_x + nearest.end_x)
            result.append(describe_hazard(
                nearest, x, supports, rules, _limit(length),
                kind=HazardKind.MISSING,
                severity=Severity.WARNING,
                position=middle,
                clearance=seen,
                horizontal=math.dist(middle[:2], nearest.curve.position(np.array(x))[0, :2]),
                vertical=0.0,
                sigma=STEP,
                num_points=0,
                offending=expected,
                other_line_id=first.model.span.line_id,
                rule='conductor that is missing over one span',
                edition=PLAIN_EDITION,
                source='the conductors of the line; no authority',
                note=MISSING_NOTE,
            ))
    return result


def _list_ends(models: Sequence[SpanModel]) -> list[_End]:
    """List the ends at known supports of well seen conductors that do not go on there."""
    if not models:
        return []
    places = np.array([(model.span.start, model.span.end) for model in models]).reshape(-1, 3)
    ends = []
    for number, model in enumerate(models):
        span = model.span
        if not _is_well_seen(model):
            continue
        unit = (span.end - span.start)[:2] / max(span.length, STEP)
        for side, is_open, outward in ((0, span.open_start, -unit), (1, span.open_end, unit)):
            place = places[2 * number + side]
            near = (np.abs(places - place) <= GOES_ON).all(axis=1)
            if not is_open and near.sum() == 1:
                ends.append(_End(model, place, outward))
    return ends


def _is_well_seen(model: SpanModel) -> bool:
    span = model.span
    dense = span.num_points >= LEAST_DENSITY * span.length
    return dense and span.coverage >= LEAST_COVERAGE


def _pair_ends(group: Sequence[SpanModel], ends: Sequence[_End]) -> list[tuple[_End, _End]]:
    """Return the ends between which a conductor of the span of a group would hang."""
    alone = Counter(id(end.model) for end in ends)
    if not all(_is_well_seen(model) and alone[id(model)] < 2 for model in group):
        return []  # those that go on at neither end are rearranged here
    starts = np.array([model.span.start for model in group])
    lasts = np.array([model.span.end for model in group])
    way = (lasts - starts)[:, :2].mean(axis=0)
    unit = way / max(float(np.hypot(*way)), STEP)
    firsts = [(end, at) for end in ends
              if end.outward @ unit >= TURN and (at := _place(end, starts, unit)) is not None]
    others = [(end, at) for end in ends
              if end.outward @ unit <= -TURN and (at := _place(end, lasts, unit)) is not None]
    pairs = []
    for end, at in firsts:
        fits = [(float(np.abs(at - other_at).max()), k) for k, (_, other_at) in enumerate(others)]
        off, k = min(fits, default=(math.inf, -1))
        if off <= ASIDE and others[k][0].model is not end.model:
            pairs.append((end, others.pop(k)[0]))
    return pairs


def _place(end: _End, places: Float64, unit: Float64) -> Float64 | None:
    """Return how far aside and above the mean of (J, 3) places an end is; None: elsewhere."""
    apart = end.place - places
    along = np.abs(apart[:, :2] @ unit)
    if along.min() > ALONG or np.hypot(*apart[:, :2].T).min() > WIDEST:
        return None
    middle = apart.mean(axis=0)
    return np.array([unit[0] * middle[1] - unit[1] * middle[0], middle[2]])


def _hang(model: SpanModel, first: Float64, last: Float64) -> Float64:
    """Return (K, 3) places at which a conductor would hang between two as another one does [m]."""
    length = math.dist(first[:2], last[:2])
    share = np.linspace(0.0, 1.0, max(math.ceil(length / STEP), 2) + 1)
    at = model.curve.position(model.start_x + share * (model.end_x - model.start_x))
    sag = at[:, 2] - at[0, 2] - share * (at[-1, 2] - at[0, 2])
    sag *= (length / max(model.span.length, STEP)) ** 2
    result = first + share[:, None] * (last - first)
    result[:, 2] += sag
    return result


def _measure_seen(
    points: Float64, expected: Float64, group: Sequence[SpanModel], density: float
) -> float:
    """Return the length of (K, 3) places of a conductor with so many points a metre [m]."""
    low, high = expected.min(axis=0) - TUBE, expected.max(axis=0) + TUBE
    own = points[((points >= low) & (points <= high)).all(axis=1)]
    way = (expected[-1] - expected[0])[:2]
    length = float(np.hypot(*way))
    x, y = ((own - expected[0])[:, :2] @ np.array([way, [-way[1], way[0]]]).T / length).T
    place = np.interp(x, np.linspace(0.0, length, len(expected)), expected[:, 2])
    away = np.hypot(y, own[:, 2] - place)
    is_own = (away <= TUBE) & (x >= 0.0) & (x < length)
    for model in group:
        is_own &= away < np.hypot(*model.part(own)[1:])
    step = length / (len(expected) - 1)
    count = np.bincount((x[is_own] / step).astype(np.int64))
    return step * np.count_nonzero(count >= max(density * step, 1.0))


def _limit(length: float) -> Limit:
    return Limit(feature='line', distance=length, tiers=((Severity.WARNING, length),))
