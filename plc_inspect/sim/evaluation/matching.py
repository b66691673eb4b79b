# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Assigns estimates to truth, one to one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plc_inspect.core.numerics.assignment import assign
from plc_inspect.sim.evaluation.curves import compare, Comparison, Curve
from plc_inspect.sim.evaluation.estimate import FoundSpan, Survey
from plc_inspect.sim.evaluation.reference import LEAST_STRETCH, TrueSpan, Truth

Float64 = NDArray[np.float64]

TOLERANCE = 0.3
"""Greatest lateral and vertical RMS distance of an estimate from its conductor [m]."""
MIN_COMMON = 0.5
"""Least share of the stretch seen that an estimate covers."""
MARGIN = 2.0
"""Margin of the boxes of curves that may match [m]."""
SUPPORT_DISTANCE = 5.0
"""Greatest distance of a found support from the true one in plan [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanMatch:
    """An estimated span and its conductor, by index."""

    truth: int
    found: int
    comparison: Comparison


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpanMatches:
    """The assignment of all spans."""

    matches: tuple[SpanMatch, ...]
    missed: tuple[int, ...]
    """Indices of the conductors without an estimate."""
    excused: tuple[int, ...]
    """Indices of sub-conductors whose bundle was found as one line."""
    false: tuple[int, ...]
    """Indices of the estimates that are no conductor or repeat one."""


def match_spans(truth: Truth, survey: Survey) -> SpanMatches:
    """
    Assign estimated spans to conductors, one to one.

    An estimate may match a conductor if, over the common length, it lies within `TOLERANCE`,
    laterally and vertically (RMS), and within half the distance to the conductor's nearest
    neighbour, and if it covers `MIN_COMMON` of the stretch seen.  The other sub-conductors of a
    bundle that was found as one line are excused.
    """
    spans, found = truth.spans, survey.spans
    reach = np.array([_measure_reach(item, spans) for item in spans])
    cost = np.full((len(spans), len(found)), np.inf)
    comparisons = {}
    for i, item in enumerate(spans):
        for j, other in enumerate(found):
            if not _may_touch(item.curve, other.curve):
                continue
            result = compare(item.curve, other.curve, item.stretch)
            lateral, vertical = result.lateral_rms, result.vertical_rms
            if (
                result.common >= MIN_COMMON and max(lateral, vertical) <= TOLERANCE
                and np.hypot(lateral, vertical) <= reach[i]
            ):
                cost[i, j] = np.hypot(lateral, vertical)
                comparisons[i, j] = result
    pairs = assign(cost)
    taken = {i for i, _ in pairs}
    bundles = {
        (spans[i].bundle_id, spans[i].curve.span_id) for i in taken if spans[i].bundle_id >= 0
    }
    excused = tuple(
        i for i, item in enumerate(spans)
        if i not in taken and (item.bundle_id, item.curve.span_id) in bundles
    )
    used = {j for _, j in pairs}
    return SpanMatches(
        matches=tuple(
            SpanMatch(truth=i, found=j, comparison=_refine(truth, survey, i, j, comparisons[i, j],
                                                           set(excused)))
            for i, j in pairs
        ),
        missed=tuple(i for i in range(len(spans)) if i not in taken and i not in excused),
        excused=excused, false=tuple(j for j in range(len(found)) if j not in used),
    )


def _refine(
    truth: Truth, survey: Survey, i: int, j: int, comparison: Comparison, excused: set[int],
) -> Comparison:
    """Compare a bundle that was found as one line with its middle, if that is nearer."""
    item = truth.spans[i]
    partners = [
        k for k in excused
        if (truth.spans[k].bundle_id, truth.spans[k].curve.span_id)
        == (item.bundle_id, item.curve.span_id)
    ]
    if item.bundle_id < 0 or not partners:
        return comparison
    group = [item.curve, *(truth.spans[k].curve for k in partners)]
    middle = Curve(
        line_id=item.curve.line_id, span_id=item.curve.span_id,
        start=np.mean([curve.start for curve in group], axis=0),
        end=np.mean([curve.end for curve in group], axis=0),
        a=float(np.mean([curve.a for curve in group])), b=item.curve.b, c=item.curve.c,
    )
    other = compare(middle, survey.spans[j].curve, item.stretch)
    return other if other.lateral_rms < comparison.lateral_rms else comparison


def _measure_reach(item: TrueSpan, spans: tuple[TrueSpan, ...]) -> float:
    """Return half the distance to the nearest other conductor, at most sqrt(2) TOLERANCE [m]."""
    reach = np.sqrt(2.0) * TOLERANCE
    for other in spans:
        if other is item or not _may_touch(item.curve, other.curve):
            continue
        same_bundle = item.bundle_id >= 0 and item.bundle_id == other.bundle_id
        if same_bundle or item.curve.span_id != other.curve.span_id:
            continue
        result = compare(item.curve, other.curve, (0.0, item.curve.length))
        if result.common >= MIN_COMMON:
            reach = min(reach, 0.5 * float(np.hypot(result.lateral_rms, result.vertical_rms)))
    return float(reach)


def _may_touch(first: Curve, second: Curve) -> bool:
    """Tell whether the boxes in plan of two curves, MARGIN wider, overlap."""
    low = np.maximum(np.minimum(first.start, first.end), np.minimum(second.start, second.end))
    high = np.minimum(np.maximum(first.start, first.end), np.maximum(second.start, second.end))
    return bool((low[:2] - MARGIN <= high[:2] + MARGIN).all())


def match_places(truth: Float64, found: Float64, limit: float) -> list[tuple[int, int]]:
    """Pair true and found positions (K, 3) within ``limit`` in plan, one to one [m]."""
    gap = np.hypot(
        truth[:, None, 0] - found[None, :, 0], truth[:, None, 1] - found[None, :, 1],
    )
    return assign(gap, limit)


def measure_sag_error(item: TrueSpan, other: FoundSpan) -> float:
    """
    Return the absolute error of the sag of an estimate [m].

    The truth for an open-ended estimate is the sag of the same part of the true curve.
    """
    if not other.open_ended:
        return abs(other.sag - item.sag)
    x, _ = item.curve.project(np.vstack([other.curve.start[:2], other.curve.end[:2]]))
    low, high = max(0.0, float(x.min())), min(item.curve.length, float(x.max()))
    if high - low < LEAST_STRETCH:
        return abs(other.sag - item.sag)
    return abs(other.sag - item.curve.measure_sag(low, high))
