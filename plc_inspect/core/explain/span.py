# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explains a stretch, a found or a missed span: what each stage found along it."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.explain.catenary_view import Curves, CurveView
from plc_inspect.core.explain.point import explain_point, MOST_RUNS
from plc_inspect.core.explain.proposals import apply, Proposal, rank
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.core.trace import Trace
from plc_inspect.errors import DataError
from plc_inspect.results import Bool, Float64

STAGES = ('points', 'high', 'candidates', 'inliers', 'in line', 'in segments', 'wire')
PART = 10.0
"""Approximate length of the parts of a stretch [m].  Source: judgement; not measured."""
MOST_PARTS = 16
"""Most parts of a stretch.  Source: judgement; not measured."""
SHARES = (0.5, 0.25, 0.75)
"""
Positions of the examples along a stretch, as shares of its length.
Source: judgement; not measured.
"""
LEAST_LENGTH = 1.0
"""Least length of a stretch in plan [m].  Source: judgement; not measured."""
NUM_STATIONS = 41
"""Positions at which a curve is compared with a course.  Source: judgement; not measured."""
MOST_OF = 0.5
"""
Least share of a curve along a course for it to count; share of wire points below which a span is
gone.
Source: judgement; not measured.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """Where a conductor hangs or should hang: a strip in a vertical plane."""

    origin: Float64
    """(2,) plan position of its start [m]."""
    azimuth: float
    length: float
    shape: Float64
    """(3,) its height [m] as a quadratic over the distance from the start, highest power first."""
    reach: float
    """Half its width, and how far it reaches upwards [m]."""
    depth: float
    """How far it reaches downwards [m]."""

    def locate(self, positions: Float64) -> tuple[Float64, Bool]:
        """Return (N,) distances from the start [m], and which (N, 3) positions lie in it."""
        dx, dy = positions[:, 0] - self.origin[0], positions[:, 1] - self.origin[1]
        ca, sa = math.cos(self.azimuth), math.sin(self.azimuth)
        x = ca * dx + sa * dy
        above = positions[:, 2] - np.polyval(self.shape, x)
        inside = (np.abs(ca * dy - sa * dx) <= self.reach) & (x >= 0.0) & (x <= self.length)
        inside &= (above <= self.reach) & (above >= -self.depth)
        return x, inside


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """What the stages found along a course."""

    course: Course
    edges: Float64
    """(P + 1,) ends of its parts, from the start [m]."""
    counts: dict[str, list[int]]
    """Counts in each part, for each of STAGES."""
    lost: str
    """The first of STAGES that covers less than a conductor needs, '' none."""
    curves: tuple[CurveView, ...]
    """Curves along it, the nearest to its middle line first."""
    examples: tuple[int, ...]
    """High points of it, not wire, with the most common decision of these."""
    proposals: tuple[Proposal, ...]
    found: bool
    """A span was found along it, and proposals remove it; otherwise they add one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StretchTrial:
    """A proposal, and the wire points along the course before and with it."""

    proposal: Proposal
    before: int
    after: int
    holds: bool


def make_course(places: Float64, settings: Settings, reach: float) -> Course:
    """
    Return the course through two places, or three of which the second is between the others.

    Two places do not give the sag, so the course reaches down as far as a conductor may hang.

    Raises
    ------
    DataError
        The first and the last place are less than a metre apart in plan.

    """
    run = places[-1, :2] - places[0, :2]
    length = float(np.hypot(*run))
    if length < LEAST_LENGTH:
        raise DataError(f'the ends of a stretch must be a metre apart, got {length:.2f} m')
    x = (places[:, :2] - places[0, :2]) @ (run / length)
    if len(places) > 2 and not 0.0 < x[1] < length:
        raise DataError('the second of three places must lie between the others')
    shape = np.zeros(3)
    shape[3 - len(places):] = np.polyfit(x, places[:, 2], len(places) - 1)
    sag = settings.catenary.max_sag_ratio * length if len(places) == 2 else 0.0
    return Course(
        origin=places[0, :2], azimuth=math.atan2(run[1], run[0]), length=length, shape=shape,
        reach=reach, depth=reach + sag,
    )


def follow_span(trace: Trace, line_id: int, span_id: int, reach: float) -> Course:
    """
    Return the course of a span that was found.

    Raises
    ------
    DataError
        There is no such span.

    """
    for model in trace.models:
        if (model.span.line_id, model.span.span_id) == (line_id, span_id):
            return _follow(model, reach)
    raise DataError(
        f'there is no span {span_id} of line {line_id}: {len(trace.models)} spans were found'
    )


def explain_stretch(
    trace: Trace, points: Float64, settings: Settings, course: Course
) -> Stretch:
    """
    Return what each stage found along a course.

    Parameters
    ----------
    trace : Trace
        Of `Pipeline.trace` with these points and settings.
    points : (N, 3) float64
        The cloud [m].
    settings : Settings
        Of that run.
    course : Course
        Where to look.

    Returns
    -------
    Stretch

    """
    num = min(max(round(course.length / PART), 1), MOST_PARTS)
    edges = np.linspace(0.0, course.length, num + 1)
    result, cloud = trace.result, trace.lines.cloud
    along, inside = course.locate(points)
    kept = trace.lines.outliers.keep
    seen = {
        'points': points[inside],
        'high': points[inside & trace.lines.height.high],
        'candidates': trace.lines.candidates.position,
        'inliers': trace.lines.candidates.position[kept],
        'in line': trace.lines.inliers.position[trace.lines.alignment.voted],
        'in segments': cloud.points[np.unique(trace.lines.clustering.segments.points)],
        'wire': points[inside & (result.line_id >= 0)],
    }
    counts = {name: _count(course, positions, edges) for name, positions in seen.items()}
    least = settings.catenary.min_coverage
    shares = {name: float(np.mean([item > 0 for item in row])) for name, row in counts.items()}
    lost = next((name for name in STAGES if shares[name] < least), '')
    examples = _pick_examples(trace, along, inside, course)
    curves = Curves(trace, settings)
    views = sorted(
        (view for view in curves.views if _is_along(course, view)),
        key=lambda view: _measure_miss(course, view),
    )
    found = lost == ''
    proposals = list(_propose(curves, views, found))
    if not found and not proposals:
        proposals = _ask(trace, points, settings, examples)
    return Stretch(
        course=course, edges=edges, counts=counts, lost=lost, curves=tuple(views),
        examples=examples, found=found, proposals=tuple(rank(proposals)),
    )


def confirm_stretch(
    stretch: Stretch, points: Float64, settings: Settings, rules: RuleSet | None = None
) -> tuple[StretchTrial, ...]:
    """
    Run the pipeline with each proposal until one holds.

    For a found span a proposal holds if fewer than half of the wire points remain; for a missed
    one, if a span appears that covers enough parts.
    """
    trials: list[StretchTrial] = []
    before = sum(stretch.counts['wire'])
    least = settings.catenary.min_coverage
    for proposal in stretch.proposals[:MOST_RUNS]:
        result = Pipeline(apply([proposal], settings), rules).run(points)
        counts = _count(stretch.course, points[result.line_id >= 0], stretch.edges)
        after = sum(counts)
        share = float(np.mean([item > 0 for item in counts]))
        gone, come = after < MOST_OF * before, share >= least and after > before
        holds = gone if stretch.found else come
        trials.append(StretchTrial(proposal=proposal, before=before, after=after, holds=holds))
        if holds:
            break
    return tuple(trials)


def _follow(model: SpanModel, reach: float) -> Course:
    low, high = model.low, model.high
    curve = model.curve
    x = np.linspace(low, high, NUM_STATIONS)
    shape = np.polyfit(x - low, curve.fit.height(x), 2)
    return Course(
        origin=curve.position(low)[0, :2], azimuth=curve.azimuth, length=high - low, shape=shape,
        reach=reach, depth=reach,
    )


def _count(course: Course, positions: Float64, edges: Float64) -> list[int]:
    along, inside = course.locate(positions)
    result: list[int] = np.histogram(along[inside], edges)[0].tolist()
    return result


def _is_along(course: Course, view: CurveView) -> bool:
    """Return whether half of a curve or more lies in the course."""
    curve = view.curve
    at = curve.position(np.linspace(curve.low, curve.high, NUM_STATIONS))
    _, inside = course.locate(at)
    return bool(inside.mean() >= MOST_OF)


def _measure_miss(course: Course, view: CurveView) -> float:
    """Return the mean distance of a curve from the course [m]."""
    curve = view.curve
    at = curve.position(np.linspace(curve.low, curve.high, NUM_STATIONS))
    ca, sa = math.cos(course.azimuth), math.sin(course.azimuth)
    dx, dy = at[:, 0] - course.origin[0], at[:, 1] - course.origin[1]
    above = at[:, 2] - np.polyval(course.shape, ca * dx + sa * dy)
    return float(np.hypot(ca * dy - sa * dx, above).mean())


def _pick_examples(
    trace: Trace, along: Float64, inside: Bool, course: Course
) -> tuple[int, ...]:
    """Return points of the most common decision, at the middle and both quarters."""
    rows = np.flatnonzero(inside & trace.lines.height.high & (trace.result.line_id < 0))
    if not len(rows):
        rows = np.flatnonzero(inside & (trace.result.line_id < 0))
    if not len(rows):
        return ()
    decision = trace.result.decision[rows]
    rows = rows[decision == np.bincount(decision).argmax()]
    places = [int(np.argmin(np.abs(along[rows] - share * course.length))) for share in SHARES]
    return tuple(dict.fromkeys(int(rows[place]) for place in places))


def _ask(
    trace: Trace, points: Float64, settings: Settings, examples: tuple[int, ...]
) -> list[Proposal]:
    """Return the greatest move of each setting that any example needs."""
    farthest: dict[str, Proposal] = {}
    for index in examples:
        for item in explain_point(trace, points, settings, index).proposals:
            known = farthest.get(item.setting)
            if known is None or item.cost > known.cost:
                farthest[item.setting] = item
    return list(farthest.values())


def _propose(curves: Curves, views: list[CurveView], found: bool) -> Iterator[Proposal]:
    if found:
        for view in views[:1]:
            for item in view.evidence:
                if item.kept:
                    yield from curves.turn(item, away=True)
        return
    for view in views:
        yield from curves.admit(view)
