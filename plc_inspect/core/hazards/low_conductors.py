# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors that hang too low above the ground, where that was seen."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from plc_inspect.core.ground.ground_planes import find_planes
from plc_inspect.core.hazards.breaches import judge_value
from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.hazards.confidence import IN_DOUBT
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import (
    Bool,
    Float32,
    Float64,
    HazardKind,
    Int64,
    Severity,
    Support,
)

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
Standard deviation of the height of the ground below a conductor, beside that of its fit [m].
Source: judgement; not measured.
"""
ROUGH_SIGMA = 0.3
"""
The same where the lowest of the points about a place is all that is known [m].
Source: derived: the lowest point of a cell of 1 m lies that far below its middle on a slope of
31 degrees.
"""
MOST_ERROR = 0.1
"""
Standard deviation of the plane at a place at most; beyond, the ground there was not seen [m].
Source: measured: 0.02 at 99 % of the places below conductors of
bench/studies/planted_hazards.py, 0.3 on the lower side of a crown (bags/demo).
"""
DEEPER = 1.0
"""
Places that are this much higher above ground than the lowest of their span are not measured [m].
Source: derived: more than a plane differs from the lowest points about it.
"""

FINE = np.array([-0.45, -0.3, -0.15, 0.15, 0.3, 0.45])
"""
Where the ground of a crest is measured about a place on it [m].
Source: derived: places are 1 m apart, and on a crest of 37 degrees 0.08 m is 0.06 m.
"""
CREST, BESIDE = 0.2, 2
"""
A place is on a crest where the ground falls by this to both sides [m] within so many places.
Source: derived: on one that falls less the next place is 0.05 m lower at most.
"""
HIGHER = 0.5
"""
Places so much higher above ground than the lowest of their span may lie beside a lower one [m].
Source: derived: half the way to the next place, at STEEPEST.
"""

HANGS = 2.0
"""
A wire hangs as a conductor does where it scatters about a straight line this many times as much
as about the sag of that, at least.
Source: judgement; a fence or rail does not.
"""
LEAST_BELOW = 0.3
"""
Distance below a conductor at which a wire is another one [m].
Source: derived: as wires.TUBE.
"""
BELOW = IN_DOUBT + 'a wire that was not modelled hangs below'
"""Note of a hazard by such a wire: its height is that of the conductor, less its distance."""

Records = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class LowWire:
    """A wire that was not modelled and hangs below a conductor, as that sags."""

    model: int
    """Number of the conductor."""
    below: float
    """How far it hangs below the conductor [m]."""
    sigma: float
    """Standard deviation of its points about that [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hanging:
    """A conductor, or a wire below it, and where it hangs above which ground."""

    model: SpanModel
    stations: Float64
    """(S, 3) distance from its start, height of the conductor above ground, and sigma [m]."""
    below: float
    """How far what is measured hangs below the conductor [m]."""
    note: str = ''

    @property
    def clearance(self) -> float:
        """The least [m]."""
        return float(self.stations[:, 1].min()) - self.below


def find_low_wires(wires: Sequence[Float64], models: Sequence[SpanModel]) -> list[LowWire]:
    """
    Find the wires below conductors that were not modelled, and hang as these do.

    Parameters
    ----------
    wires : sequence of (W, 3) float64
        Points of each [m].
    models : sequence of SpanModel
        Spans with their curves.

    Returns
    -------
    list of LowWire
        Each below the nearest conductor above it.

    """
    result = []
    for points in wires:
        found: list[LowWire] = []
        for number, model in enumerate(models):
            x, across = model.curve.local(points)
            if not model.low <= np.median(x) <= model.high:
                continue
            below = model.curve.fit.height(x) - points[:, 2]
            middle, aside = float(np.median(below)), float(np.median(np.abs(across)))
            if middle < max(aside, LEAST_BELOW):
                continue
            straight = points[:, 2] - np.polyval(np.polyfit(x, points[:, 2], 1), x)
            if HANGS * below.std() <= straight.std():
                found.append(LowWire(model=number, below=middle, sigma=float(below.std())))
        result += sorted(found, key=lambda wire: wire.below)[:1]
    return result


def find_low_conductors(
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    supports: Sequence[Support],
    rules: RuleSet,
    low_wires: Sequence[LowWire] = (),
    least_chance: float = 0.0,
) -> Records:
    """
    Find the spans that hang too low above the ground: one hazard a span, at its lowest place.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : sequence
        For each model (S, 3): as `measure_ground` returns.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.
    low_wires : sequence of LowWire
        Hang below conductors, and are not modelled.
    least_chance : float
        Probability that what hangs low breaks a limit, at least.

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
    hanging = [
        _Hanging(model=model, stations=stations, below=-model.lowest_strand)
        for model, stations in zip(models, seen, strict=True)
    ]
    hanging += [
        _Hanging(
            model=models[wire.model], stations=_blur(seen[wire.model], wire), below=wire.below,
            note=BELOW,
        ) for wire in low_wires
    ]
    for item in hanging:
        broken = judge_value(item.clearance, limits) if len(item.stations) else None
        known = worst.get(item.model.span.span_id)
        if broken is None or (known and known['clearance'] <= item.clearance):
            continue
        record = _describe_low(item, *broken, supports, rules)
        if record['chance'] >= least_chance:
            worst[item.model.span.span_id] = record
    return list(worst.values())


def _blur(stations: Float64, wire: LowWire) -> Float64:
    """Return the (T, 3) places of a span above whose ground a wire hangs, less sure by it."""
    result = stations[stations[:, 1] - wire.below >= LEAST_GROUND]
    return np.column_stack([result[:, :2], np.hypot(result[:, 2], wire.sigma)])


def measure_ground(
    points: Float64,
    height: Float32 | None,
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    reach: float,
) -> tuple[Float64, ...]:
    """
    Measure anew how high conductors hang above the ground, where that matters.

    The ground surface is of the lowest points of cells, which lie below their middles on slopes
    and by noise, and may be of a wire where the ground was not seen.  Here it is the plane
    through the points about the foot of each place, without what stands out of it upwards.  Places
    where that is not sure are left out: their ground was not seen.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float32 or None
        Above the ground surface [m].
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : sequence
        For each model (S, 2): distance from its start and height above the ground surface [m].
    reach : float
        Height above ground up to which places matter, beside the lowest of each span [m].

    Returns
    -------
    tuple of (T, 3) float64
        For each model the same with better heights, and the standard deviation of the ground [m].

    """
    result = [
        np.column_stack([own, np.full(len(own), ROUGH_SIGMA)]) for own in ground_below
    ]
    if height is None:
        return tuple(result)
    wanted = [
        own[:, 1] <= max(float(own[:, 1].min()) + DEEPER, reach) if len(own)
        else np.zeros(0, dtype=bool) for own in result
    ]
    while any(own.any() for own in wanted):
        _find_ground(points, height, models, result, wanted)
        wanted = [
            # where the lowest place is lost, the surface above the next ones may be no better
            (own[:, 2] == ROUGH_SIGMA) if (chosen & ~np.isfinite(own[:, 1])).any()
            else np.zeros(len(own), dtype=bool) for own, chosen in zip(result, wanted, strict=True)
        ]
    kept = [own[np.isfinite(own[:, 1])] for own in result]
    crests = [_find_crests(own) for own in kept]
    fine = [
        _list_fine(model, own, places)
        for model, own, places in zip(models, kept, crests, strict=True)
    ]
    if any(map(len, fine)):
        _find_ground(points, height, models, fine, [np.ones(len(own), bool) for own in fine])
    for own, places, more in zip(kept, crests, fine, strict=True):
        for place, about in zip(places, more.reshape(-1, len(FINE), 3), strict=True):
            known = np.vstack([own[place], about[np.isfinite(about[:, 1])]])
            own[place] = known[np.argmin(known[:, 1])]
    return tuple(kept)


def _find_crests(stations: Float64) -> Int64:
    """Return which of the (S, 3) places of a span lie on crests, and may be beside its lowest."""
    if not len(stations):
        return np.zeros(0, dtype=np.int64)
    height = stations[:, 1]
    padded = np.pad(height, BESIDE, constant_values=np.inf)
    num = len(height)
    before, after = (
        np.stack([padded[BESIDE + k * side :][:num] for k in range(1, BESIDE + 1)])
        for side in (-1, 1)
    )
    is_crest = (height <= before[0]) & (height <= after[0])
    for side in (before, after):
        is_crest &= np.where(np.isfinite(side), side, -np.inf).max(axis=0) >= height + CREST
    return np.flatnonzero(is_crest & (height <= height.min() + HIGHER))


def _list_fine(model: SpanModel, stations: Float64, places: Int64) -> Float64:
    """Return (F, 3) more places about some of a span, above ground as high as there."""
    along = (stations[places, :1] + FINE).ravel()
    height, sigma = (np.repeat(stations[places, k], len(FINE)) for k in (1, 2))
    ground = model.curve.fit.height(model.at(np.repeat(stations[places, 0], len(FINE)))) - height
    return np.column_stack([along, model.curve.fit.height(model.at(along)) - ground, sigma])


def _find_ground(
    points: Float64, height: Float32, models: Sequence[SpanModel], stations: Sequence[Float64],
    wanted: Sequence[Bool],
) -> None:
    """Measure the wanted ones of the (S, 3) places of each model, NaN where it is not sure."""
    places = np.vstack([
        model.curve.position(model.at(own[chosen, 0])) - np.column_stack(
            [np.zeros((int(chosen.sum()), 2)), own[chosen, 1]])
        for model, own, chosen in zip(models, stations, wanted, strict=True)
    ])
    ground, error = find_planes(points, height, places)
    sigma = np.hypot(error, GROUND_SIGMA)
    ground[~(error <= MOST_ERROR)] = np.nan
    at = 0
    for own, chosen in zip(stations, wanted, strict=True):
        part = slice(at, at := at + int(chosen.sum()))
        own[chosen, 1] += places[part, 2] - ground[part]
        own[chosen, 2] = sigma[part]


def keep_seen(model: SpanModel, stations: Float64) -> Float64:
    """
    Leave out the places of a span whose ground is not the ground.

    While the ground below is not seen yet, the lowest that was seen is the conductor itself, or
    what hangs below it: there the ground would touch the conductor, or step up to it.

    Parameters
    ----------
    model : SpanModel
        The span.
    stations : (S, 2+) float64
        Distance from its start, ascending, and height above ground [m].

    Returns
    -------
    (T, 2+) float64

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
    item: _Hanging, limit: Limit, severity: Severity, supports: Sequence[Support], rules: RuleSet
) -> dict[str, Any]:
    model, stations = item.model, item.stations
    along, height, ground_sigma = stations[int(np.argmin(stations[:, 1]))].tolist()
    x = float(model.at(np.array(along)))
    below = stations[:, 1] - item.below < limit.reach
    run = model.curve.position(model.at(stations[below, 0]))
    run[:, 2] -= stations[below, 1]
    return describe_hazard(
        model, x, supports, rules, limit,
        kind=HazardKind.GROUND,
        severity=severity,
        position=model.curve.position(np.array(x))[0] - np.array([0.0, 0.0, height]),
        clearance=item.clearance,
        horizontal=0.0,
        vertical=item.clearance,
        sigma=math.hypot(model.place_sigma(x), ground_sigma),
        num_points=int(below.sum()),
        offending=run,
        note='; '.join(filter(None, (limit.note, item.note))),
    )
