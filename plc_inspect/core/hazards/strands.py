# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Sub-conductors of bundles, and the scatter of points, from the cross-section of each span.

What hangs within a bundle is nearer to a tree than the curve through its middle.  Where the points
of a span tell two, three or four sub-conductors apart, clearances are from the nearest; where they
only show that it is wide, from both ends of the width that they show.
"""

from collections.abc import Sequence
import dataclasses
import math

from numba import njit
import numpy as np

from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.core.spans.spans import SpanResult
from plc_inspect.results import Float64, Int32, Int64, NO_STRANDS, Span

MOST_STRANDS = 4
"""
Sub-conductors of a bundle at most.
Source: judgement; bundles of six and more are of lines above 500 kV.
"""
LEAST_SPACING = 0.2
"""
Distance between sub-conductors at least [m].
Source: judgement; spacers hold them 0.2 to 0.6 m apart.
"""
RESOLVED = 3.0
"""
Distance between sub-conductors that are told apart, in standard deviations of their points.
Source: derived: below two the sum of two equal normal densities has one peak; half as much more.
"""
LEAST_WEIGHT = 0.1
"""Share of the points that a sub-conductor has at least.  Source: judgement; not measured."""
LEAST_RUN = 0.5
"""
Share of the span's points, by place along it, over which a sub-conductor's extend at least.
Source: judgement; not measured.
"""
LEAST_POINTS = 20
"""Points from which a cross-section is looked at.  Source: judgement; not measured."""
MOST_POINTS = 300
"""Points that a cross-section is drawn from at most.  Source: numerical: bounds the time."""
MOST_ROUNDS = 30
"""Rounds of expectation and maximisation at most.  Source: numerical: bounds the time."""
CONVERGED = 1e-4
"""Relative change of the variance at which the rounds end.  Source: numerical."""
CORE = 0.98
"""Share of the points, the nearest to the middle, that are looked at.  Source: judgement."""
LEAST_SCATTER = 0.01
"""
Standard deviation of the points of a cloud at least [m].
Source: judgement; scanners are no better.
"""


def find_strands(points: Float64, spans: SpanResult) -> tuple[SpanModel, ...]:
    """
    Give the spans their sub-conductors, and the scatter of the points of this cloud.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    spans : SpanResult
        Spans with their curves, and labels of the points.

    Returns
    -------
    tuple of SpanModel
        In the order of those given.

    """
    if not spans.models:
        return ()
    wide = _find_wide(spans)
    asked = [model.span for model, is_wide in zip(spans.models, wide, strict=True) if is_wide]
    wires = iter(list_points(spans.line_id, spans.span_id, asked))
    found = []
    for model, is_wide in zip(spans.models, wide, strict=True):
        own = next(wires) if is_wide else ()
        if len(own) < LEAST_POINTS:
            found.append((NO_STRANDS, (model.curve.lateral_rmse, model.curve.fit.rmse)))
            continue
        chosen = points[own[:: -(-len(own) // MOST_POINTS)]]
        x, y = model.curve.local(chosen)
        found.append(divide_section(x, np.column_stack([
            y, chosen[:, 2] - model.curve.fit.height(x)
        ])))
    scatter = max(
        float(np.median([math.hypot(*own) / math.sqrt(2.0) for _, own in found])), LEAST_SCATTER
    )
    noise = max(float(np.median([above for _, (_, above) in found])), LEAST_SCATTER)
    return tuple(
        dataclasses.replace(model, strands=strands, scatter=scatter, noise=max(noise, above))
        for model, (strands, (_, above)) in zip(spans.models, found, strict=True)
    )


def divide_section(x: Float64, section: Float64) -> tuple[Float64, tuple[float, float]]:
    """
    Tell the sub-conductors of one span apart.

    A mixture of two to four round normal densities of one width is fitted, and the best by the
    Bayesian information criterion is taken whose parts are resolved.

    Parameters
    ----------
    x : (K,) float64
        Places along the curve [m].
    section : (K, 2) float64
        Across it and above it [m].

    Returns
    -------
    strands : (S, 2) float64
        Across and above the curve [m]; one at (0, 0) where there is no bundle.
    scatter : (float, float)
        Standard deviations of the points about their sub-conductor, across and above [m].

    """
    middle = np.median(section, axis=0)
    away = np.hypot(*(section - middle).T)
    core = away <= np.quantile(away, CORE)
    x, section = x[core], section[core]
    variance, axes = np.linalg.eigh(np.cov(section.T))
    narrow, wide = np.sqrt(np.maximum(variance, 0.0)).tolist()
    single = _measure_scatter(section)
    if wide < LEAST_SPACING / 2:
        return NO_STRANDS, single
    extent = float(np.ptp(np.quantile(x, (1 - CORE, CORE))))
    best = (_score(_fit_mixture(section, 1), len(x), 1), NO_STRANDS, single)
    for num in range(2, MOST_STRANDS + 1):
        fit = _fit_mixture(section, num)
        centres, weight, part, deviation, _ = fit
        score = _score(fit, len(x), num)
        if score >= best[0] or weight.min() < LEAST_WEIGHT:
            continue
        apart = min(math.dist(one, two) for k, one in enumerate(centres) for two in centres[:k])
        runs = [np.ptp(np.quantile(x[part == k], (1 - CORE, CORE))) if (part == k).any() else 0.0
                for k in range(num)]
        if apart >= max(RESOLVED * deviation, LEAST_SPACING) and min(runs) >= LEAST_RUN * extent:
            best = (score, centres, _measure_scatter(section - centres[part]))
    if len(best[1]) == 1:  # not resolved: two at the ends of what is wider than the noise
        half = math.sqrt(wide**2 - narrow**2)
        if 2.0 * half < LEAST_SPACING:
            return NO_STRANDS, single
        return section.mean(axis=0) + np.outer((-half, half), axes[:, 1]), (narrow, narrow)
    return best[1], best[2]


def _measure_scatter(section: Float64) -> tuple[float, float]:
    """Return the standard deviations of (K, 2) places across and above [m]."""
    across, above = section.std(axis=0, ddof=1).tolist()
    return across, above


def _find_wide(spans: SpanResult) -> list[bool]:
    """
    Tell the spans whose points lie as far from their curve as those of a bundle do.

    A curve may be of one sub-conductor, or of one of two conductors, and have the points of both.
    """
    wire = np.flatnonzero(spans.line_id >= 0)
    members = [model.span for model in spans.models]
    key, wanted = _number_spans(spans.line_id[wire], spans.span_id[wire], members)
    size = int(max(key.max(initial=0), max(wanted))) + 1
    square = np.square(spans.residual[wire], dtype=np.float64)
    known = np.isfinite(square)
    count = np.bincount(key[known], minlength=size)
    apart = np.sqrt(np.bincount(key[known], square[known], size) / np.maximum(count, 1))
    return [
        bool(max(model.curve.lateral_rmse, model.curve.fit.rmse, apart[own]) >= LEAST_SPACING / 2)
        for model, own in zip(spans.models, wanted, strict=True)
    ]


def list_points(line_id: Int32, span_id: Int32, spans: Sequence[Span]) -> list[Int64]:
    """
    Return the points of the conductor of each span.

    Parameters
    ----------
    line_id, span_id : (N,) int32
        Of each point; no conductor's where line_id is -1.
    spans : sequence of Span
        Whose points are asked for.

    Returns
    -------
    list of (K,) int64
        Ascending.

    """
    wire = np.flatnonzero(line_id >= 0) if spans else np.zeros(0, dtype=np.int64)
    if not len(wire):
        return [wire[:0]] * len(spans)
    key, wanted = _number_spans(line_id[wire], span_id[wire], spans)
    order = np.argsort(key, kind='stable')
    wire, key = wire[order], key[order]
    first, last = (np.searchsorted(key, wanted, side=side) for side in ('left', 'right'))
    return [wire[low:high] for low, high in zip(first.tolist(), last.tolist(), strict=True)]


def _number_spans(
    line_id: Int32, span_id: Int32, spans: Sequence[Span]
) -> tuple[Int64, list[int]]:
    """Return the number of the span of each wire point (W,), and those of some spans."""
    width = 1 + max(span.span_id for span in spans)
    if len(span_id):
        width = max(width, int(span_id.max()) + 1)
    key = line_id.astype(np.int64) * width + span_id
    return key, [span.line_id * width + span.span_id for span in spans]


Fit = tuple[Float64, Float64, Int64, float, float]


def _score(fit: Fit, num_points: int, num: int) -> float:
    """Return the Bayesian information criterion: less is better."""
    return 3 * num * math.log(num_points) - 2.0 * fit[4]


@njit(cache=True, nogil=True, error_model='numpy')
def _fit_mixture(section, num):  # type: ignore[no-untyped-def]
    """
    Fit a mixture of round normal densities of one width.

    Returned are the centres, their shares of the points, which of them each point is most likely
    of, the standard deviation along each axis, and the logarithm of the likelihood.
    """
    count = len(section)
    centres, weight = np.empty((num, 2)), np.full(num, 1.0 / num)
    middle = np.array([section[:, 0].mean(), section[:, 1].mean()])
    nearest = np.empty(count)
    for i in range(count):
        nearest[i] = math.hypot(section[i, 0] - middle[0], section[i, 1] - middle[1])
    start = int((1.0 - LEAST_WEIGHT / 2.0) * (count - 1))  # what lies beyond may be strays
    for k in range(num):  # each begins far from the others
        centres[k] = middle if num == 1 else section[np.argsort(nearest)[start]]
        for i in range(count):
            apart = math.hypot(section[i, 0] - centres[k, 0], section[i, 1] - centres[k, 1])
            nearest[i] = apart if k == 0 else min(nearest[i], apart)
    variance = max((nearest**2).mean() / 2.0, 1e-8)
    share, part = np.empty((count, num)), np.zeros(count, dtype=np.int64)
    likelihood = 0.0
    for _ in range(MOST_ROUNDS):
        likelihood = 0.0
        for i in range(count):
            total, top = 0.0, -1.0
            for k in range(num):
                y, z = section[i, 0] - centres[k, 0], section[i, 1] - centres[k, 1]
                share[i, k] = weight[k] * math.exp(-(y * y + z * z) / (2.0 * variance)) + 1e-300
                total += share[i, k]
                if share[i, k] > top:
                    top, part[i] = share[i, k], k
            likelihood += math.log(total / (2.0 * math.pi * variance))
            for k in range(num):
                share[i, k] /= total
        spread = 0.0
        for k in range(num):
            total, y, z = 1e-12, 0.0, 0.0
            for i in range(count):
                total += share[i, k]
                y += share[i, k] * section[i, 0]
                z += share[i, k] * section[i, 1]
            centres[k, 0], centres[k, 1] = y / total, z / total
            weight[k] = total / count
            for i in range(count):
                y, z = section[i, 0] - centres[k, 0], section[i, 1] - centres[k, 1]
                spread += share[i, k] * (y * y + z * z)
        before, variance = variance, max(spread / (2.0 * count), 1e-8)
        if abs(variance - before) < CONVERGED * variance:
            break
    return centres, weight, part, math.sqrt(variance), likelihood


def measure_distances(
    points: Float64, distance: Float64, owner: Int64, models: Sequence[SpanModel], reach: float
) -> Float64:
    """
    Return the distances to the nearest sub-conductors, from those to the nearest curves.

    Parameters
    ----------
    points : (K, 3) float64
        Positions [m].
    distance : (K,) float64
        To the nearest curve [m].
    owner : (K,) int64
        Which that is.
    models : sequence of SpanModel
        Spans with their sub-conductors.
    reach : float
        Distances beyond this do not matter [m].

    Returns
    -------
    (K,) float64
        [m]

    """
    result = distance.copy()
    wide = np.array([len(model.strands) > 1 for model in models])
    if not wide.any():
        return result
    most = max(float(np.hypot(*model.strands.T).max()) for model in models)
    near = np.flatnonzero(wide[owner] & (distance < reach + most))
    for number in np.unique(owner[near]).tolist():
        mine, model = near[owner[near] == number], models[number]
        middle = dataclasses.replace(model, strands=NO_STRANDS)
        _, across, above = middle.part(points[mine])
        _, horizontal, vertical = model.part(points[mine])
        # the parts are at the foot in plan, which is not the nearest place of a steep curve
        steep = distance[mine] / np.maximum(np.hypot(across, above), LEAST_SCATTER)
        result[mine] = np.minimum(steep, 1.0) * np.hypot(horizontal, vertical)
    return result
