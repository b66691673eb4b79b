# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Load cases: sag and clearances of every span at other temperatures, with ice and wind."""

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.hazards.encroachments import MOST_OF, ROOM, THIN_ROOM
from plc_inspect.core.hazards.surfaces import is_surface
from plc_inspect.core.loads.blowout import SwungSpan
from plc_inspect.core.loads.sag_tension import (
    Case,
    change_state,
    Conductor,
    LEAST_LENGTH,
    measure_sag,
    ruling_span,
    State,
)
from plc_inspect.core.loads.sections import group_sections
from plc_inspect.core.numerics.plan_index import build_plan_index, PlanIndex
from plc_inspect.core.spans.span_model import find_kind
from plc_inspect.errors import DataError
from plc_inspect.results import (
    Bool,
    Float64,
    Hazard,
    HazardKind,
    InspectionResult,
    Int32,
    PointClass,
    Severity,
    Span,
)

SURVEYED = 'as surveyed'
OFF_GROUND = 0.5
"""Greatest height of ground points [m].  Source: judgement; not measured."""
GROUND_REACH = 3.0
"""Greatest distance in plan to the ground point used [m].  Source: judgement; not measured."""
CELL = 4.0
"""
Edge of the plan cells of the index of points [m].
Source: numerical: the search is exact; time alone depends on it.
"""
BLOCK = 3.0
"""Edge of the blocks told as structure or vegetation [m].  Source: judgement; not measured."""
MOST_GROUND = 200_000
"""Greatest number of ground points below a span, about.  Source: numerical: bounds the time."""
MARGIN = 2.0
"""Clearances are measured this far beyond the limits [m].  Source: judgement; not measured."""
SLACK = 1e-6
"""
Margin of the box of a hazard's points [m].
Source: numerical: rounding of coordinates in files.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Clearance to the nearest object of one kind."""

    clearance: float
    """[m], NaN if no object of this kind is near."""
    along: float
    """Horizontal distance from the start of the span [m], NaN if unknown."""
    severity: Severity | None
    """Severity by the rules, None if they are kept or have no limit."""


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
    blows from either side; the lesser clearance counts.

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
    # points of objects, and of the ground
    height = result.ground_height
    finite = np.isfinite(points).all(axis=1)
    solid = finite & (height > OFF_GROUND) & ~np.isin(
        result.classification, (PointClass.WIRE, PointClass.TOWER)
    )
    chosen = np.flatnonzero(solid)
    objects = build_plan_index(points, chosen, CELL)
    ground = build_plan_index(points, np.flatnonzero(finite & np.isfinite(height)), CELL)
    kinds = (HazardKind.VEGETATION, HazardKind.STRUCTURE)
    moved = {
        item.hazard_id: [math.inf] * len(names) for item in result.hazards if item.kind in kinds
    }
    rows = []
    for section in group_sections(result.spans):
        ruling = ruling_span([result.spans[i].length for i in section])
        for i in section:
            span = result.spans[i]
            # the span as surveyed and in each case
            states = [_surveyed(span, conductor)] + [
                change_span(span, [result.spans[k] for k in section], temperature, conductor,
                            case)
                for case in cases
            ]
            # what is near it: objects, other than arms and insulators, and ground
            reach = rules.reach('vegetation', 'building') + MARGIN
            reach += max(item.sag * math.sin(item.swing) for item in states)
            near = _gather(objects, span, reach)
            near = near[~_is_held(points[near], span, result)]
            around = points[near]
            surface = _smooth(around, is_surface(around))
            floor = _gather(ground, span, reach + GROUND_REACH)
            floor = floor[:: 1 + len(floor) // MOST_GROUND]
            below = points[floor].copy()
            below[:, 2] -= height[floor]
            # clearances in each case, and those of the objects of its hazards
            own = [item for item in result.hazards if item.hazard_id in moved and
                   item.span_id == span.span_id]
            outcomes = []
            for number, (name, state) in enumerate(zip(names, states, strict=True)):
                frames = [SwungSpan(span, state, side) for side in
                          ((1.0, -1.0) if state.swing else (1.0,))]
                distance, x = _nearest(frames, points[near])
                nearest = _Nearest(distance=distance, x=x, surface=surface)
                outcomes.append(_describe(
                    name, state, frames, nearest, below, rules, min_points
                ))
                for item in own:
                    moved[item.hazard_id][number] = min(
                        moved[item.hazard_id][number], _of_hazard(item, points[near], distance)
                    )
            rows.append(SpanOutcomes(line_id=span.line_id, span_id=span.span_id,
                                     ruling_span=ruling, outcomes=tuple(outcomes)))
    rows.sort(key=lambda row: (row.line_id, row.span_id))
    return WhatIf(
        conductor=conductor, temperature=temperature, cases=tuple(cases), spans=tuple(rows),
        hazards={key: tuple(value if math.isfinite(value) else math.nan for value in values)
                 for key, values in moved.items()},
    )


def _surveyed(span: Span, conductor: Conductor) -> State:
    return State(
        c=span.c, tension=span.c * conductor.weight, load=conductor.weight, swing=0.0,
        length=span.length, rise=float(span.end[2] - span.start[2]),
    )


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


def _gather(index: PlanIndex, span: Span, reach: float) -> Int32:
    return np.sort(index.strip(span.start, span.end, reach))


def _is_held(points: Float64, span: Span, result: InspectionResult) -> Bool:
    """Tell the points that may be arms or insulators of a support."""
    held = np.zeros(len(points), dtype=bool)
    unit = (span.end - span.start)[:2] / max(span.length, LEAST_LENGTH)
    along = (points[:, :2] - span.start[:2]) @ unit
    for end, distance in ((span.start, along), (span.end, span.length - along)):
        held |= distance <= ROOM.get(find_kind(span, end, result.supports), THIN_ROOM)
    return held


def _smooth(points: Float64, surface: Bool) -> Bool:
    """Decide by the majority in each block, as crowns have flat patches."""
    if not len(points):
        return surface
    _, block = np.unique(
        np.floor(points / BLOCK).astype(np.int64), axis=0, return_inverse=True
    )
    block = block.ravel()
    share = np.bincount(block, weights=surface) / np.bincount(block)
    result: Bool = share[block] > MOST_OF
    return result


def _nearest(frames: Sequence[SwungSpan], points: Float64) -> tuple[Float64, Float64]:
    """Return the distance of each point to the nearest curve, and x there [m]."""
    distance, x = frames[0].measure(points)
    for frame in frames[1:]:
        other, at = frame.measure(points)
        x = np.where(other < distance, at, x)
        distance = np.minimum(other, distance)
    return distance, x


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Nearest:
    """Distances of K points to the conductor in one load case."""

    distance: Float64
    """(K,) [m]"""
    x: Float64
    """(K,) distance along the span [m]."""
    surface: Bool
    """(K,) points of roofs and walls."""


def _describe(
    name: str, state: State, frames: Sequence[SwungSpan], around: _Nearest, below: Float64,
    rules: RuleSet, min_points: int,
) -> Outcome:
    trees, buildings = rules.find('vegetation'), rules.find('building')
    return Outcome(
        case=name,
        sag=measure_sag(state.length, state.rise, state.c),
        c=state.c,
        tension=state.tension,
        swing=state.swing,
        vegetation=_reach(around, ~around.surface, trees, min_points),
        building=_reach(around, around.surface, buildings, min_points),
        ground=_over_ground(frames, below, rules.find('ground')),
    )


def _reach(
    around: _Nearest, chosen: Bool, limits: Sequence[Limit], min_points: int
) -> Reach:
    distance, x = around.distance, around.x
    own = np.flatnonzero(chosen)
    if len(own) < min_points:
        return Reach(clearance=math.nan, along=math.nan, severity=None)
    order = own[np.argpartition(distance[own], min_points - 1)[:min_points]]
    worst = int(order[np.argmax(distance[order])])
    clearance = float(distance[worst])
    return Reach(clearance=clearance, along=float(x[worst]), severity=_judge(limits, clearance))


def _over_ground(
    frames: Sequence[SwungSpan], below: Float64, limits: Sequence[Limit]
) -> Reach:
    """Return the least height above the ground, NaN where no ground was seen nearby."""
    best = Reach(clearance=math.nan, along=math.nan, severity=None)
    if not len(below):
        return best
    from scipy.spatial import cKDTree  # imported here, as it takes a moment

    tree = cKDTree(below[:, :2])
    for frame in frames:
        x = np.linspace(0.0, frame.state.length, max(int(frame.state.length), 2) + 1)
        at = frame.position(x)
        apart, nearest = tree.query(at[:, :2], distance_upper_bound=GROUND_REACH)
        known = np.isfinite(apart)
        if not known.any():
            continue
        gap = at[known, 2] - below[nearest[known], 2]
        worst = int(np.argmin(gap))
        if not gap[worst] >= best.clearance:
            clearance = float(gap[worst])
            best = Reach(clearance=clearance, along=float(x[known][worst]),
                         severity=_judge(limits, clearance))
    return best


def _judge(limits: Sequence[Limit], clearance: float) -> Severity | None:
    found = [severity for limit in limits if (severity := limit.judge(clearance)) is not None]
    return max(found, default=None)


def _of_hazard(hazard: Hazard, points: Float64, distance: Float64) -> float:
    """Return the least distance of the points of a hazard [m]."""
    low, high = hazard.extent
    inside = ((points >= low - SLACK) & (points <= high + SLACK)).all(axis=1)
    return float(distance[inside].min(initial=math.inf))
