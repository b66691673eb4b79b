# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Obstacles: the objects of hazards, and what is near spans beside them, for load cases."""

from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.extraction.surfaces import is_surface
from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.hazards.encroachments import MOST_OF, ROOM
from plc_inspect.core.hazards.strands import divide_section, LEAST_POINTS, list_points, MOST_POINTS
from plc_inspect.core.labels import GROUND_BAND
from plc_inspect.core.loads.approach import Approach, MovedSpan
from plc_inspect.core.loads.sag_tension import State
from plc_inspect.core.numerics.plan_index import build_plan_index, PlanIndex
from plc_inspect.results import (
    Bool,
    Float64,
    Hazard,
    HazardKind,
    InspectionResult,
    Int32,
    Int64,
    NO_STRANDS,
    PointClass,
    Span,
)

FEATURES = {HazardKind.VEGETATION: 'vegetation', HazardKind.STRUCTURE: 'building'}
"""Kinds of hazards that are objects, and the feature of the limits that they break."""
CELL = 4.0
"""
Edge of the plan cells of the index of points [m].
Source: numerical: the search is exact; time alone depends on it.
"""
BLOCK = 3.0
"""Edge of the blocks told as structure or vegetation [m].  Source: judgement; not measured."""
MOST_GROUND = 200_000
"""Greatest number of ground points below a span, about.  Source: numerical: bounds the time."""
MOST_BLOCKS = 1_000_000
"""Blocks that are counted in a grid; more are sorted.  Source: numerical: 8 MB."""
SLACK = 1e-6
"""
Margin of the box of a hazard's points [m].
Source: numerical: rounding of coordinates in files.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle:
    """The object of a hazard."""

    hazard: Hazard
    limits: tuple[Limit, ...]
    """Of its kind."""
    points: Float64
    """(1 + K, 3) position of the hazard, and the points in its box [m]."""
    more: Float64
    """(4,) what the hazard says of its position, less what is measured here [m]."""
    rank: float
    """That of the position, as `Approach.judge` returns."""

    def approach(self, moved: MovedSpan) -> tuple[list[Approach], Bool]:
        """
        Return how near its points are as surveyed and in each case, and which count.

        Those nearer to a conductor than the hazard are not of its object: they are of the line,
        or too few.  What is beyond the ends of another span than that of the hazard is not of it.
        """
        found = [
            Approach(values=item.values + self.more[:, None])
            for item in moved.approach(self.points)
        ]
        own = found[0].judge(self.limits)[0] >= self.rank
        if self.hazard.span_id != moved.span.span_id:
            own &= (found[0].along > 0.0) & (found[0].along < moved.span.length)
        own[0] |= is_of(self.hazard, moved.span)
        return found, own


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacles:
    """What is near the spans of a survey of N points."""

    points: Float64
    """(N, 3) [m]."""
    result: InspectionResult
    solid: PlanIndex
    """Points off the ground that are neither wire nor support."""
    ground: PlanIndex
    """Points whose height above ground is known."""
    objects: tuple[Obstacle, ...]
    owner: Int32
    """(N,) number of the object of each point, -1 none."""
    strands: dict[tuple[int, int], Float64]
    """(S, 3) sub-conductors of each span, from its curve [m], by line_id and span_id."""

    def find_objects(self, span: Span, reach: float) -> list[Obstacle]:
        """Return the objects of hazards of a span, and of others that come near it."""
        numbers = set(self.owner[self._near(span, reach)].tolist())
        return [item for number, item in enumerate(self.objects)
                if number in numbers or is_of(item.hazard, span)]

    def find_others(self, span: Span, reach: float) -> dict[HazardKind, Float64]:
        """
        Find vegetation and structures near a span that are of no hazard.

        They are told by class, or by shape where that is not known; parts of lines and supports
        are neither.

        Parameters
        ----------
        span : Span
            The span.
        reach : float
            Distance in plan [m].

        Returns
        -------
        dict
            (K, 3) points for each of FEATURES [m].

        """
        near = self._near(span, reach)
        own, kind = self.points[near], self.result.classification[near]
        other = kind == PointClass.OTHER
        flat = other & is_surface(own)
        along, _ = _lay_out(own, span)
        unknown = other & np.isnan(self.result.clearance[near])  # beyond the corridor
        unknown &= np.minimum(along, span.length - along) > ROOM['tower']
        known = np.flatnonzero((kind == PointClass.VEGETATION) | unknown | flat)
        own, flat, free = own[known], flat[known], self.owner[near[known]] < 0
        flat = _smooth(own, flat)
        return {
            HazardKind.VEGETATION: own[free & ~flat], HazardKind.STRUCTURE: own[free & flat],
        }

    def find_ground(self, span: Span, reach: float) -> Float64:
        """Return positions (K, 3) on the ground near a span in plan [m]."""
        near = np.sort(self.ground.strip(span.start, span.end, reach))
        near = near[:: 1 + len(near) // MOST_GROUND]
        below = self.points[near].copy()
        below[:, 2] -= self.result.ground_height[near]
        return below

    def _near(self, span: Span, reach: float) -> Int32:
        return np.sort(self.solid.strip(span.start, span.end, reach))


def gather_obstacles(points: Float64, result: InspectionResult, rules: RuleSet) -> Obstacles:
    """
    Gather what is near the spans of a survey.

    Parameters
    ----------
    points : (N, 3) float64
        The pipeline's input [m].
    result : InspectionResult
        What it found.
    rules : RuleSet
        Those by which it judged.

    Returns
    -------
    Obstacles

    """
    finite, height = np.isfinite(points).all(axis=1), result.ground_height
    solid = finite & ~(height < GROUND_BAND)
    solid &= ~np.isin(result.classification, (PointClass.WIRE, PointClass.TOWER))
    index = build_plan_index(points, np.flatnonzero(solid), CELL)
    ground = build_plan_index(points, np.flatnonzero(finite & np.isfinite(height)), CELL)
    strands = _find_strands(points, result)
    spans = {(span.line_id, span.span_id): span for span in result.spans}
    owner = np.full(len(points), -1, dtype=np.int32)
    objects: list[Obstacle] = []
    for hazard in result.hazards:
        span = spans.get((hazard.line_id, hazard.span_id))
        if hazard.kind not in FEATURES or span is None:
            continue
        low, high = hazard.extent
        own = index.strip(low, high, math.dist(low[:2], high[:2]))
        own = own[((points[own] >= low - SLACK) & (points[own] <= high + SLACK)).all(axis=1)]
        owner[own] = len(objects)
        surveyed = MovedSpan(span, [survey_state(span)], strands[span.line_id, span.span_id])
        objects.append(_describe_object(
            hazard, points[own], surveyed, rules.find(FEATURES[hazard.kind])
        ))
    return Obstacles(points=points, result=result, solid=index, ground=ground,
                     objects=tuple(objects), owner=owner, strands=strands)


def survey_state(span: Span, weight: float = 1.0) -> State:
    """Return the state of a span as surveyed, of a conductor of some weight per length [N/m]."""
    return State(
        c=span.c, tension=span.c * weight, load=weight, swing=0.0,
        length=span.length, rise=float(span.end[2] - span.start[2]),
    )


def is_of(hazard: Hazard, span: Span) -> bool:
    """Tell whether a hazard is one of a conductor in a span."""
    return (hazard.line_id, hazard.span_id) == (span.line_id, span.span_id)


def _describe_object(
    hazard: Hazard, points: Float64, surveyed: MovedSpan, limits: tuple[Limit, ...]
) -> Obstacle:
    told = np.array([hazard.clearance, hazard.horizontal, hazard.vertical, hazard.along_span])
    more = told - surveyed.approach(hazard.position[None])[0].values[:, 0]
    rank, _ = Approach(values=told[:, None]).judge(limits)
    return Obstacle(hazard=hazard, limits=limits, more=more, rank=float(rank[0]),
                    points=np.vstack([hazard.position, points]))


def _find_strands(
    points: Float64, result: InspectionResult
) -> dict[tuple[int, int], Float64]:
    """Return the sub-conductors of each span, as for hazards."""
    wires = list_points(result.line_id, result.span_id, result.spans)
    return {
        (span.line_id, span.span_id): _divide(points, own, span)
        for span, own in zip(result.spans, wires, strict=True)
    }


def _divide(points: Float64, own: Int64, span: Span) -> Float64:
    section = NO_STRANDS
    if len(own) >= LEAST_POINTS:
        chosen = points[own[:: -(-len(own) // MOST_POINTS)]]
        x, y = _lay_out(chosen, span)
        section, _ = divide_section(x, np.column_stack([y, chosen[:, 2] - span.heights(x)]))
    turn = np.array([-math.sin(span.azimuth), math.cos(span.azimuth)])
    return np.column_stack([section[:, :1] * turn, section[:, 1]])


def _lay_out(points: Float64, span: Span) -> tuple[Float64, Float64]:
    """Return places (K,) along and to the left of a span [m]."""
    x, y = (points - span.start)[:, :2].T
    cosine, sine = math.cos(span.azimuth), math.sin(span.azimuth)
    return cosine * x + sine * y, cosine * y - sine * x


def _smooth(points: Float64, surface: Bool) -> Bool:
    """Decide by the majority in each block, as crowns have flat patches."""
    if not len(points):
        return surface
    block = np.floor(points / BLOCK).astype(np.int64)
    block -= block.min(axis=0)
    shape = (block.max(axis=0) + 1).tolist()
    if math.prod(shape) > MOST_BLOCKS:  # strays far away
        _, block = np.unique(block, axis=0, return_inverse=True)
    else:
        block = np.ravel_multi_index(tuple(block.T), shape)
    share = np.bincount(block, weights=surface) / np.maximum(np.bincount(block), 1)
    result: Bool = share[block] > MOST_OF
    return result
