# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Taps: short pieces of conductor that branch off at a support, sideways of the line."""

from collections.abc import Iterator, Sequence
import dataclasses
from itertools import compress
import math

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import Curve, fit_curve
from plc_inspect.core.catenary.curve_row import derive_tolerance, MIN_TOLERANCE
from plc_inspect.core.catenary.duplicates import drop_duplicates, is_thick
from plc_inspect.core.catenary.growing import extend
from plc_inspect.core.catenary.profile import measure_distances, profile_curve
from plc_inspect.core.clustering.clusterers import KERNELS
from plc_inspect.core.clustering.cross_section import count_needed, thin_window
from plc_inspect.core.clustering.segment_fit import LEAST_POINTS, SHELL_CHANCE, SHELL_SHARE
from plc_inspect.core.clustering.segments import cluster_window
from plc_inspect.core.evidence.built import are_held, RAIL
from plc_inspect.core.evidence.free_length import measure_free_length
from plc_inspect.core.evidence.roof_rows import are_roof_rows
from plc_inspect.core.evidence.validation import add_up, is_scan_line
from plc_inspect.core.extraction.linearity import LinearityResult, STEEPEST_DEG
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.numerics.plan_index import build_plan_index, PlanIndex
from plc_inspect.core.spans.span_fit import CutCurve
from plc_inspect.core.spans.span_model import FittedSpan, model_span, SpanModel
from plc_inspect.core.spans.spans import copy_labels, measure_ground_below, SpanResult
from plc_inspect.errors import FitError
from plc_inspect.results import Bool, Float64, Int64, Support

REACH = 10.0
"""
Taps are looked for this far from a support [m].
Source: judgement; holds from 7 to 20 on bench/constants.py.
"""
MAX_ARM = 3.0
"""
Supports with conductors farther from their axis are towers of lines that have no taps [m].
Source: judgement; holds from 1.5 to 6 on bench/constants.py.
"""
AXIS_MISS = 1.5
"""
A tap passes this near to the axis of its support [m].
Source: judgement; holds up to 3, not down to 0.7 of it, on bench/constants.py.
"""
FIRST_SEEN = 3.0
"""
And is seen from this near to it on [m].
Source: judgement; holds up to 6, not down to 0.7 of it, on bench/constants.py.
"""
SIDEWAYS = math.radians(25.0)
"""
It leads away from the conductors of the line by more than this.
Source: judgement; holds from 12.5 to 50 degrees on bench/constants.py.
"""
SAME_WAY = math.radians(12.0)
"""
Candidates of one window follow each other in azimuth by less than this.
Source: judgement; holds from 6 to 24 degrees on bench/constants.py.
"""
LEAST_SEEDS = 3
"""Candidates that lead one way, at least.
Source: judgement; holds from 1 to 6 on bench/constants.py."""
LEAST_LENGTH = 3.5
"""Shorter pieces are arms and insulators [m].
Source: judgement; worse at 0.7 and 1.4 of it on bench/constants.py."""
MIN_COVERAGE = 0.5
"""
Share of its half metres that hold points.
Source: judgement; holds down to 0.25, not up to 1.4 of it, on bench/constants.py.
"""
END_ROOM = 0.5
"""A tap ends this far above what is not looked at, at least [m].
Source: derived: else it may be a stay, of which the points are so far apart."""
LEAST_HEIGHT = 0.4
"""
Taps leave a support above this share of its height.
Source: judgement; holds down to 0.28, not up to 1.4 of it, on bench/constants.py.
"""
ABOVE = 1.5
"""And at most this far above its top [m].
Source: judgement; holds from 0.75 to 3 on bench/constants.py."""
STEP = 0.5
"""Steps in which a tap is followed back to its support [m].
Source: judgement; holds from 0.25 to 1 on bench/constants.py."""
AT_AXIS = 0.5
"""What is nearer to the axis of a support is the support's [m].
Source: judgement; not measured."""
SIDE_ROOM, TOP_ROOM = 0.5, 1.0
"""
Points of a tap may lie this far beyond what its candidates keep, beside and above [m].
Source: judgement; not measured.
"""
MAST_ROOM, MAST_RISE = 1.5, 2.0
"""
The mast of an arm is so near to its end, and stands so far above and below it [m].
Source: judgement: poles end where taps meet them; bodies of towers are 1 to 3 m wide.
"""
THIN_SIGMAS = 2.0
"""A tap is judged within this many rms of its own.  Source: judgement; not measured."""


def add_taps(
    cloud: OffGround, seeds: Sequence[LinearityResult], spans: SpanResult, settings: Settings
) -> SpanResult:
    """
    Add the conductors that branch off at supports and are too short to be believed elsewhere.

    Service drops and the first metres of a line across the street point at a support from the
    side.  What does that, hangs free and is as thin as a wire needs no curvature as proof.  Each
    tap is a line of its own, open at its far end; taps of one support that lead the same way are
    one span.

    Parameters
    ----------
    cloud : OffGround
        Points off the ground.
    seeds : sequence of LinearityResult
        Places where points lie along a line: nearly level ones, then those that are steep, which
        are twigs and braces more often.
    spans : SpanResult
        Spans and supports so far, with labels of these points.
    settings : Settings
        Settings of all stages.

    Returns
    -------
    SpanResult

    """
    ends = [_find_ends(support, spans.models) for support in spans.supports]
    may_have = [len(own) > 0 and own[:, 0].max() <= MAX_ARM for own in ends]
    if not any(may_have):
        return spans
    spans = copy_labels(spans)
    places = [
        (build_plan_index(found.position, np.arange(len(found.position)), REACH / 2), found)
        for found in seeds if len(found.position)
    ]
    models, grounds = list(spans.models), list(spans.ground_below)
    supports = []
    line_id = max(model.span.line_id for model in models) + 1
    span_id = max(model.span.span_id for model in models) + 1
    for support, own, is_possible in zip(spans.supports, ends, may_have, strict=True):
        lines = []
        if not is_possible:
            supports.append(support)
            continue
        for azimuth, slope, middle in _list_ways(support, own[:, 1], places):
            curves = _find_curves(cloud, spans.line_id >= 0, support, azimuth, slope, middle,
                                  settings)
            for curve, low in curves:
                model = _claim(cloud, spans, curve, low, line_id, span_id)
                if model is not None:
                    models.append(model)
                    grounds.append(measure_ground_below(cloud.height, model))
                    lines.append(line_id)
                    line_id += 1
            if models[-1].span.span_id == span_id:
                span_id += 1
        supports.append(dataclasses.replace(support, line_ids=(*support.line_ids, *lines)))
    return dataclasses.replace(
        spans, models=tuple(models), ground_below=tuple(grounds), supports=tuple(supports),
        support=spans.support & (spans.line_id < 0),
    )


def _find_ends(support: Support, models: Sequence[SpanModel]) -> Float64:
    """
    Return the conductors that end at a support.

    Returns
    -------
    (E, 2) float64
        How far they pass from the axis of the support [m], and the azimuth in which they lead
        away from it [rad].

    """
    found = []
    for model in models:
        span = model.span
        if span.line_id not in support.line_ids:
            continue
        for end, azimuth, is_open in (
            (span.start, span.azimuth, span.open_start),
            (span.end, span.azimuth + math.pi, span.open_end),
        ):
            east, north = end[:2] - support.position[:2]
            if not is_open and math.hypot(east, north) <= REACH:
                across = north * math.cos(azimuth) - east * math.sin(azimuth)
                found.append((abs(across), azimuth))
    return np.array(found).reshape(-1, 2)


def _list_ways(
    support: Support, taken: Float64, seeds: Sequence[tuple[PlanIndex, LinearityResult]]
) -> Iterator[tuple[float, float, float]]:
    """Yield what `_find_ways` does, of the seeds of one kind after the other."""
    for places, own in seeds:
        near = places.strip(support.position, support.position, REACH)
        yield from _find_ways(support, taken, own.position[near], own.direction[near])


def _find_ways(
    support: Support, taken: Float64, position: Float64, direction: Float64
) -> Iterator[tuple[float, float, float]]:
    """Yield azimuth, slope and height at the axis of what points at a support from the side."""
    apart = position - support.position
    radius = np.hypot(apart[:, 0], apart[:, 1])
    inward = (direction[:, :2] * apart[:, :2]).sum(axis=1) < 0
    direction = np.where(inward[:, None], -direction, direction)
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    run = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-9)
    miss = np.abs(apart[:, 0] * direction[:, 1] - apart[:, 1] * direction[:, 0]) / run
    beside = np.abs(np.angle(np.exp(1j * (azimuth[:, None] - taken)))).min(axis=1) > SIDEWAYS
    chosen = beside & (radius > AT_AXIS) & (radius <= REACH) & (miss <= AXIS_MISS)
    chosen &= (apart[:, 2] > LEAST_HEIGHT * support.height) & (
        apart[:, 2] < support.height + ABOVE
    )
    order = np.flatnonzero(chosen)
    order = order[np.argsort(azimuth[order], kind='stable')]
    if len(order) < LEAST_SEEDS:
        return
    own = azimuth[order]
    gap = np.diff(own, append=own[0] + 2 * math.pi)
    order = np.roll(order, -int(np.argmax(gap)) - 1)
    own = np.unwrap(azimuth[order])
    for part in np.split(order, np.flatnonzero(np.diff(own) > SAME_WAY) + 1):
        if len(part) < LEAST_SEEDS:
            continue
        way = math.atan2(np.sin(azimuth[part]).mean(), np.cos(azimuth[part]).mean())
        slope = float(np.median(direction[part, 2] / run[part]))
        yield way, slope, float(np.median(apart[part, 2] - slope * radius[part]))


def _find_curves(
    cloud: OffGround, wire: Bool, support: Support, azimuth: float, slope: float, middle: float,
    settings: Settings,
) -> list[tuple[Curve, float]]:
    """Return the taps that leave a support one way, and the x at which each begins."""
    points, limits = cloud.points, settings.catenary
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    index, foot = cloud.index, support.position
    found = index.strip(foot, foot[:2] + REACH * unit, AXIS_MISS)
    found = found[~wire[found]]
    apart = points[found] - foot
    x, y = apart[:, :2] @ unit, apart[:, :2] @ np.array([-unit[1], unit[0]])
    w = apart[:, 2] - middle - slope * x
    inside = (x > AT_AXIS) & (x <= REACH) & (np.abs(y) <= AXIS_MISS + SIDE_ROOM)
    inside &= (apart[:, 2] > LEAST_HEIGHT * support.height) & (
        apart[:, 2] < support.height + ABOVE + TOP_ROOM
    )
    chosen, x, y, w = thin_window(found[inside], x[inside], y[inside], w[inside])
    if len(chosen) < LEAST_POINTS:
        return []
    clusters = settings.clustering
    fits, owner, _ = cluster_window(
        x, y, w, KERNELS['dbscan'], clusters.eps,
        count_needed(y, w, clusters.eps, clusters.min_points), LEAST_LENGTH,
        clusters.max_thickness, 1.0,
    )
    curves = []
    for number in range(len(fits)):
        own = np.sort(chosen[owner == number]).astype(np.int64)
        try:
            curve = fit_curve(
                points, own, tolerance=derive_tolerance(float(fits[number, 5])), azimuth=azimuth
            )
        except FitError:
            continue
        if not (is_thick(curve) or is_scan_line(curve)) and _leaves(curve, support):
            curves.append(curve)
    curves = list(drop_duplicates(points, extend(points, index, curves, limits), limits))
    curves = list(compress(curves, ~are_roof_rows(curves, cloud.height.ground)))
    known, wire = wire, wire.copy()
    for curve in curves:
        wire[profile_curve(points, index, curve, curve.low, curve.high).chosen] = True
    result, total = [], 0.0
    for curve in curves:
        low = _find_start(cloud, curve, support, wire)
        thin = _make_thin(curve, low)
        free = measure_free_length(points, index, thin, wire, cloud.height.ground)
        evidence = add_up(thin, free, limits)
        total += evidence
        if evidence > 0.0 and _is_tap(cloud, curve, thin, support, known, settings):
            result.append((curve, low))
    # of a crown, a roof or a truss some piece is free, and most are not
    if total <= 0.0:
        return []
    held = are_held(points, index, [curve for curve, _ in result], wire, limits, RAIL)
    return list(compress(result, ~held))


def _find_start(cloud: OffGround, curve: Curve, support: Support, wire: Bool) -> float:
    """Follow a tap back towards the axis of its support as far as it is thin and free."""
    at, _ = curve.local_place(support.position)
    low = max(curve.low, at + FIRST_SEEN)
    profile = profile_curve(
        cloud.points, cloud.index, curve, low - STEP * math.ceil((low - at) / STEP), low,
        step=STEP, ignore=wire,
    )
    for core, shell in zip(profile.core[::-1], profile.shell[::-1], strict=True):
        if shell > SHELL_SHARE * core + SHELL_CHANCE:
            break
        low -= STEP
    return max(low, at)


def _leaves(curve: Curve, support: Support) -> bool:
    """Whether a curve, extrapolated, passes the axis of a support where conductors hang."""
    x, y = curve.local_place(support.position)
    slope = float(curve.fit.slope((max(curve.low, x) + curve.high) / 2))
    above = float(curve.fit.height(x)) - support.position[2]
    return (
        abs(y) <= AXIS_MISS
        and LEAST_HEIGHT * support.height < above < support.height + ABOVE
        and abs(slope) <= math.tan(math.radians(STEEPEST_DEG))
    )


def _make_thin(curve: Curve, low: float) -> Curve:
    """Return a curve from an x on, no thicker than the scatter of its points."""
    rms = max(curve.fit.rmse, curve.lateral_rmse)
    return dataclasses.replace(
        curve, low=low, tolerance=min(max(THIN_SIGMAS * rms, MIN_TOLERANCE), curve.tolerance)
    )


def _is_tap(
    cloud: OffGround, curve: Curve, thin: Curve, support: Support, known: Bool, settings: Settings
) -> bool:
    """
    Whether a curve begins at its support and, as thin as its points are, is free in the air.

    ``thin`` is the curve from its start on, ``known`` are points of the line.
    """
    limits = settings.catenary
    at, _ = curve.local_place(support.position)
    if (
        thin.length < LEAST_LENGTH
        or curve.fit.sag(curve.low, curve.high)[0] > limits.max_sag_ratio * curve.length
        or max(thin.low, curve.low) - at > FIRST_SEEN
        or not _leaves(curve, support)
        or _comes_to_ground(cloud, curve)
        or (support.kind == 'unseen' and _comes_to_mast(cloud, curve))
    ):
        return False
    # a roof can be cut into curves, each of which the others surround: they count as well here
    profile = profile_curve(
        cloud.points, cloud.index, thin, thin.low, thin.high, step=STEP, ignore=known
    )
    return (
        len(profile.chosen) >= limits.min_points
        and profile.coverage >= MIN_COVERAGE
        and profile.crowding <= limits.max_crowding
    )


def _comes_to_ground(cloud: OffGround, curve: Curve) -> bool:
    """Whether a curve ends near the ground: it is a stay."""
    tip = curve.position(curve.high)
    return float(tip[0, 2] - cloud.height.ground.at(tip[:, :2])[0]) < cloud.least + END_ROOM


def _comes_to_mast(cloud: OffGround, curve: Curve) -> bool:
    """Whether a curve ends at something that stands above it and below: it is an arm of that."""
    tip = curve.position(curve.high)[0]
    apart = cloud.points[cloud.index.strip(tip, tip, MAST_ROOM)] - tip
    above = apart[np.hypot(apart[:, 0], apart[:, 1]) <= MAST_ROOM, 2]
    return bool((above > MAST_RISE).any() and (above < -MAST_RISE).any())


def _claim(
    cloud: OffGround, spans: SpanResult, curve: Curve, low: float, line_id: int, span_id: int
) -> SpanModel | None:
    """Label the points of a tap and describe it."""
    profile = profile_curve(cloud.points, cloud.index, curve, low, curve.high)
    own: Int64 = profile.chosen[spans.line_id[profile.chosen] < 0]
    if len(own) < LEAST_POINTS:
        return None
    spans.line_id[own], spans.span_id[own] = line_id, span_id
    spans.residual[own] = measure_distances(cloud.points, curve, own)
    return model_span(cloud.points, FittedSpan(
        cut=CutCurve(curve=curve, low=low, high=curve.high),
        points=own,
        reverse=False,
        is_open=(False, True),
        line_id=line_id,
        span_id=span_id,
        coverage=profile.coverage,
        end_sigma=(0.0, 0.0),
    ))
