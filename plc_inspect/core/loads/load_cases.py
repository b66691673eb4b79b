# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Load cases: sag and clearances of every span at other temperatures, with ice and wind."""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass, field
import math

import numpy as np

from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.loads.approach import Approach, MovedSpan
from plc_inspect.core.loads.obstacles import (
    FEATURES,
    gather_obstacles,
    is_of,
    Obstacle,
    Obstacles,
    survey_state,
)
from plc_inspect.core.loads.sag_tension import (
    Case,
    change_state,
    Conductor,
    ruling_span,
    State,
)
from plc_inspect.core.loads.sections import group_sections
from plc_inspect.errors import DataError
from plc_inspect.results import (
    Float64,
    Hazard,
    HazardKind,
    InspectionResult,
    Severity,
    Span,
)

SURVEYED = 'as surveyed'
GROUND_REACH = 3.0
"""Greatest distance in plan to the ground point used [m].  Source: judgement; not measured."""
MARGIN = 2.0
"""Clearances are measured this far beyond the limits [m].  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Clearance to the nearest object of one kind."""

    clearance: float
    """[m], NaN if no object of this kind is near."""
    along: float
    """Horizontal distance from the start of the span [m], NaN if unknown."""
    severity: Severity | None
    """Severity by the rules, None if they are kept or have no limit."""


NOTHING = Reach(clearance=math.nan, along=math.nan, severity=None)
"""Where nothing is near, or known."""
UNTOLD = State(
    c=math.nan, tension=math.nan, load=math.nan, swing=math.nan, length=math.nan, rise=math.nan
)
"""Where the curve does not tell the tension."""
Nearness = tuple[float, Reach]
"""Rank, the worst the least (`Approach.judge`), and clearance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One span in one case."""

    case: str
    sag: float
    """Greatest distance from chord to curve along the load [m]."""
    c: float
    tension: float
    """Horizontal tension [N]."""
    swing: float
    """Blow-out angle [rad]."""
    vegetation: Reach
    building: Reach
    ground: Reach


@dataclass(frozen=True, slots=True, kw_only=True)
class SpanOutcomes:
    """One span in all cases; the first outcome is as surveyed."""

    line_id: int
    span_id: int
    ruling_span: float
    """Ruling span of its section [m]; its own length if it is alone."""
    outcomes: tuple[Outcome, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WhatIf:
    """All spans in all cases."""

    conductor: Conductor
    temperature: float
    """Temperature of the conductors when surveyed, as stated by the user [degrees Celsius]."""
    cases: tuple[Case, ...]
    spans: tuple[SpanOutcomes, ...]
    hazards: dict[int, tuple[float, ...]]
    """Clearance [m] of the object of each vegetation and structure hazard, as surveyed and in
    each case, by hazard_id."""
    contacts: dict[int, float] = field(default_factory=dict)
    """Temperature of contact by hazard_id, for hazards that are touched [degrees Celsius]."""


def evaluate_cases(
    points: Float64,
    result: InspectionResult,
    conductor: Conductor,
    temperature: float,
    cases: Sequence[Case],
    rules: RuleSet,
    min_points: int,
) -> WhatIf:
    """
    Compute the sag of every span in each case, and measure its clearances.

    Consecutive spans in line with nearly the same constant form a section and share the tension
    of its ruling span.  Ends stay in place: insulators do not swing, supports do not bend.  Wind
    blows from either side; the lesser clearance counts.  Where the curve does not tell the
    tension, as it is too short for its noise, the figures of all cases are NaN.

    Parameters
    ----------
    points : (N, 3) float64
        The pipeline's input [m].
    result : InspectionResult
        What it found.
    conductor : Conductor
        Of all spans.
    temperature : float
        Of the conductor when it was surveyed, as the user states it [degrees Celsius].
    cases : sequence of Case
        What to evaluate.
    rules : RuleSet
        Distances to judge by.
    min_points : int
        Least number of points of an object.

    Returns
    -------
    WhatIf

    Raises
    ------
    DataError
        A case has no state, or two cases have the same name.

    """
    names = [SURVEYED, *(case.name for case in cases)]
    if len(set(names)) != len(names):
        raise DataError(f'names of cases must differ, got {", ".join(names[1:])}')
    obstacles = gather_obstacles(points, result, rules)
    nearest: dict[int, list[Nearness]] = {}
    rows = []
    for section in group_sections(result.spans):
        members = [result.spans[i] for i in section]
        ruling = ruling_span([span.length for span in members])
        for span in members:
            is_told = tells_tension(span)
            states = [survey_state(span, conductor.weight if is_told else math.nan)] + [
                change_span(span, members, temperature, conductor, case)
                for case in cases if is_told
            ]
            reaches, own = _measure_span(span, states, obstacles, rules, min_points)
            for _ in range(len(names) - len(states)):
                states.append(UNTOLD)
                reaches.append(dict.fromkeys(reaches[0], NOTHING))
                # nor is it known how near another conductor does not come
                own = {key: [*found, (-math.inf, NOTHING)] for key, found in own.items()}
            outcomes = tuple(
                Outcome(case=name, sag=state.sag, c=state.c, tension=state.tension,
                        swing=state.swing, **reach)
                for name, state, reach in zip(names, states, reaches, strict=True)
            )
            rows.append(SpanOutcomes(line_id=span.line_id, span_id=span.span_id,
                                     ruling_span=ruling, outcomes=outcomes))
            for key, found in own.items():
                known = zip(nearest.get(key, found), found, strict=True)
                nearest[key] = [min(pair, key=lambda item: item[0]) for pair in known]
    rows.sort(key=lambda row: (row.line_id, row.span_id))
    return WhatIf(
        conductor=conductor, temperature=temperature, cases=tuple(cases), spans=tuple(rows),
        hazards={key: tuple(reach.clearance for _, reach in found)
                 for key, found in nearest.items()},
    )


def tells_tension(span: Span) -> bool:
    """Tell whether the curve of a span tells its constant, and with it its tension, at all."""
    return span.sigma.get('c', 0.0) < span.c


def change_span(
    span: Span, section: Sequence[Span], temperature: float, conductor: Conductor, case: Case
) -> State:
    """Return the state of a span in a case: its own, or by the tension of its section."""
    rise = float(span.end[2] - span.start[2])
    own = change_state(span.length, rise, span.c, temperature, conductor, case)
    if len(section) == 1:
        return own
    ruling = ruling_span([item.length for item in section])
    constant = float(np.mean([item.c for item in section]))
    before = change_state(ruling, 0.0, constant, temperature, conductor,
                          Case(name=SURVEYED, temperature=temperature))
    after = change_state(ruling, 0.0, constant, temperature, conductor, case)
    tension = span.c * conductor.weight * after.tension / before.tension
    return State(c=tension / own.load, tension=tension, load=own.load, swing=own.swing,
                 length=own.length, rise=own.rise)


def _measure_span(
    span: Span, states: Sequence[State], obstacles: Obstacles, rules: RuleSet, min_points: int
) -> tuple[list[dict[str, Reach]], dict[int, list[Nearness]]]:
    """Return what is near a span in each case by feature, and the objects of its hazards."""
    swing = max(item.sag * math.sin(item.swing) for item in states)
    reach = rules.reach(*FEATURES.values()) + MARGIN + swing
    moved = MovedSpan(span, states, obstacles.strands[span.line_id, span.span_id])
    found: dict[str, list[list[Nearness]]] = {}
    objects = {}
    for kind, points in obstacles.find_others(span, reach).items():
        limits = rules.find(FEATURES[kind])
        found[FEATURES[kind]] = [_follow_others(moved.approach(points), limits, min_points)]
    for item in obstacles.find_objects(span, reach):
        own = _follow_object(item, moved)
        found[FEATURES[item.hazard.kind]].append(own)
        if item.hazard.span_id == span.span_id:
            objects[item.hazard.hazard_id] = own
    found['ground'] = [_follow_ground(
        moved, obstacles.find_ground(span, MARGIN + swing + GROUND_REACH),
        obstacles.result.hazards, rules.find('ground'),
    )]
    return [
        {feature: _find_worst([item[number] for item in items])
         for feature, items in found.items()}
        for number in range(len(states))
    ], objects


def _follow_object(item: Obstacle, moved: MovedSpan) -> list[Nearness]:
    """Return how near the object of a hazard is in each case."""
    found, own = item.approach(moved)
    result = []
    for near in found:
        rank, severity = near.judge(item.limits)
        rank[~own] = math.inf
        worst = int(np.argmin(rank))
        result.append(_describe(near, worst, rank[worst], severity[worst]))
    return result


def _follow_others(
    approaches: Sequence[Approach], limits: Sequence[Limit], min_points: int
) -> list[Nearness]:
    """
    Return how near points of no hazard are in each case.

    Those that broke a limit as surveyed were found to be none, and count in no case.
    """
    own = approaches[0].judge(limits)[1] == 0
    if own.sum() < min_points:
        return [(math.inf, NOTHING)] * len(approaches)
    result = []
    for near in approaches:
        rank, severity = near.judge(limits)
        rank[~own] = math.inf
        worst = int(np.argpartition(rank, min_points - 1)[min_points - 1])
        result.append(_describe(
            near, worst, rank[worst], np.sort(severity[own])[-min_points]
        ))
    return result


def _describe(near: Approach, place: int, rank: float, severity: int) -> Nearness:
    """Return the clearance at one of the points, none where its rank is infinite."""
    if not math.isfinite(rank):
        return math.inf, NOTHING
    return float(rank), Reach(
        clearance=float(near.distance[place]), along=float(near.along[place]),
        severity=Severity(severity) if severity else None,
    )


def _follow_ground(
    moved: MovedSpan, below: Float64, hazards: Sequence[Hazard], limits: Sequence[Limit]
) -> list[Nearness]:
    """
    Return the least height above ground in each case: that of the survey, less what it sinks.

    It is that of the conductor's hazard, if it has one.  Places that hung lower as surveyed were
    not above ground.  A height that broke a limit without a hazard is judged in no case.
    """
    span, strand = moved.span, float(moved.strands[:, 2].min())
    of_span = [item for item in hazards
               if item.kind == HazardKind.GROUND and item.span_id == span.span_id]
    along, told = span.ground_along, span.ground_clearance
    for item in of_span:
        if is_of(item, span):
            along, told, strand = item.along_span, item.clearance, 0.0
    if not math.isfinite(told):
        return [(math.inf, NOTHING)] * len(moved.frames)
    worst = max((item.severity for item in of_span), default=0)
    is_judged = (_judge(limits, told + strand) or 0) <= worst
    num = max(int(span.length), 2) + 1
    share = np.append(along / span.length, np.linspace(0.0, 1.0, num))
    gaps = moved.rise(share, below, GROUND_REACH)
    surveyed = gaps[0]
    own = np.append(0, 1 + np.flatnonzero(surveyed[1:] >= surveyed[0]))
    first = float(surveyed[0]) if np.isfinite(surveyed[0]) else math.nan
    result = []
    for gap in gaps:
        least = own[np.argmin(gap[own])]
        sunk = first - float(gap[least]) if gap is not surveyed else 0.0
        if math.isinf(sunk):  # no ground was seen where it swings to
            result.append((math.inf, NOTHING))
            continue
        result.append((told - sunk, Reach(
            clearance=told - sunk, along=float(share[least]) * span.length,
            severity=_judge(limits, told - sunk + strand) if is_judged else None,
        )))
    return result


def _find_worst(found: Sequence[Nearness]) -> Reach:
    """Return the worst of some things in one case, with the greatest severity of all."""
    _, worst = min(found, key=lambda item: item[0])
    severities = [reach.severity for _, reach in found if reach.severity is not None]
    return dataclasses.replace(worst, severity=max(severities, default=None))


def _judge(limits: Sequence[Limit], clearance: float) -> Severity | None:
    found = [severity for limit in limits if (severity := limit.judge(clearance)) is not None]
    return max(found, default=None)
