# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Strays beside conductors, and leaves on them: whose the points close to a span are."""

import dataclasses
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import pack_curves
from plc_inspect.core.catenary.curve_row import to_local
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.catenary.profile import CROWD_LENGTH
from plc_inspect.core.clustering.segment_fit import SHELL_CHANCE, SHELL_RATIO, SHELL_SHARE
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.spans.span_fit import FREE_CHANCE, FREE_SHARE, STRAY_RADIUS
from plc_inspect.core.spans.span_model import tabulate
from plc_inspect.core.spans.spans import copy_labels, SpanResult
from plc_inspect.results import Bool, Float64

FREE_LENGTH = 2.0
"""
Length of the parts of a span that are free of other things or not [m].
Source: judgement; holds from 1 to 4 on bench/constants.py.
"""
FREE_RADIUS = 1.0
"""
Something else begins within this distance wherever it touches a conductor [m].
Source: judgement; holds from 0.7 to 2 on bench/constants.py.
"""
LEAST_FREE = 20
"""
Points in free parts from which a conductor's own scatter and density are known.
Source: judgement; holds from 10 to 40 on bench/constants.py.
"""
LEAST_SIGMA = 0.005
"""
Standard deviation of a conductor's points across it, at least [m].
Source: judgement; holds from 0.0025 to 0.01 on bench/constants.py.
"""
USUAL = 75
"""
Percentile of the points of free parts that tells how dense a conductor is.
Source: judgement; not measured.
"""
HELD_ODDS = 9.0
"""
A point is a support's where that is so many times as likely as that it is the conductor's.
Source: measured: with 1 to 4 conductors lose more points of their own than supports win, in
scenes of 288000 to 291039, any, that drift does not blur; with 50 a third of those remains.
"""
HELD_STEP, NUM_HELD = 0.2, 3
"""
Length of the parts of a span at its supports of which each may be crowded by them, and how many
they are, from the end on, either way along the line [m].
Source: judgement: arms and pins of poles reach 0.6 m along the line.
"""
OVERFULL = 1.5
"""
A part is crowded by a support with so many times the points of the fullest part elsewhere.
Source: judgement.
"""
UNHELD = 1.0
"""
How many points a part of a conductor has, it tells farther than this from its supports [m].
Source: judgement.
"""


def settle_strays(cloud: OffGround, spans: SpanResult) -> SpanResult:
    """
    Give conductors the stray points about them, and crowns the leaves that lie on conductors.

    Mixed returns and the drift of poses put points some decimetres beside a conductor.  What
    grows or stands there goes on away from it, so strays are claimed only in places where next
    to nothing lies between STRAY_RADIUS and FREE_RADIUS.  Where much does, see `find_intruders`.

    Parameters
    ----------
    cloud : OffGround
        Points off the ground.
    spans : SpanResult
        Spans so far, with labels of these points.

    Returns
    -------
    SpanResult
        With labels, residuals and numbers of points brought up to date.

    """
    if not spans.models:
        return spans
    spans = copy_labels(spans)
    near, distance, nearest = find_near(cloud.points, tabulate(spans.models), FREE_RADIUS)
    order = np.argsort(nearest, kind='stable')
    near, distance = near[order], distance[order]
    start = np.searchsorted(nearest[order], np.arange(len(spans.models) + 1))
    along, own, other, num_claimed = _claim(
        cloud.points, near, distance, start,
        pack_curves([model.curve for model in spans.models]),
        np.array([model.start_x for model in spans.models]),
        np.array([model.curve.tolerance for model in spans.models], dtype=np.float32),
        np.array([(model.span.line_id, model.span.span_id) for model in spans.models]),
        spans.support, spans.line_id, spans.span_id, spans.residual,
    )
    models, intruders, exact = [], [spans.intruders], distance.astype(np.float64)
    for number, model in enumerate(spans.models):
        mine = slice(start[number], start[number + 1])
        given = find_intruders(
            along[mine], exact[mine], own[mine], other[mine], model.curve.tolerance
        )
        held = find_held(
            along[mine], exact[mine], own[mine] & ~given, model.span.length,
            (not model.span.open_start, not model.span.open_end),
        )
        spans.support[near[mine][held]] = True
        intruders.append(near[mine][given])
        gone = near[mine][given | held]
        spans.line_id[gone], spans.span_id[gone], spans.residual[gone] = -1, -1, np.nan
        num_points = model.span.num_points + int(num_claimed[number]) - len(gone)
        models.append(dataclasses.replace(
            model, span=dataclasses.replace(model.span, num_points=num_points)
        ))
    return dataclasses.replace(
        spans, models=tuple(models), intruders=np.concatenate(intruders)
    )


@njit(cache=True, nogil=True)
def _claim(  # type: ignore[no-untyped-def]
    points, near, distance, start, rows, start_x, tolerance, number,
    support, line_id, span_id, residual,
):
    """
    Label the strays of each span among the points near it, which come span by span.

    Returned are how far along its span each point lies [m], whether it was on this conductor
    before, whether it is of something else, and how many strays each span has got.
    """
    along = np.empty(len(near))
    own, other = np.zeros(len(near), dtype=np.bool_), np.zeros(len(near), dtype=np.bool_)
    num_claimed = np.zeros(len(rows), dtype=np.int64)
    for s in range(len(rows)):
        num = 1
        for k in range(start[s], start[s + 1]):
            x, _ = to_local(rows[s], points[near[k], 0], points[near[k], 1])
            along[k] = abs(x - start_x[s])
            num = max(num, int(along[k] / FREE_LENGTH) + 1)
        on, away = np.zeros(num, dtype=np.int64), np.zeros(num, dtype=np.int64)
        for k in range(start[s], start[s + 1]):
            i, place = near[k], int(along[k] / FREE_LENGTH)
            if line_id[i] >= 0:
                on[place] += 1
                own[k] = (
                    line_id[i] == number[s, 0] and span_id[i] == number[s, 1]
                    and residual[i] <= tolerance[s]
                )
            else:
                other[k] = True
                away[place] += distance[k] > STRAY_RADIUS and not support[i]
        for k in range(start[s], start[s + 1]):
            i, place = near[k], int(along[k] / FREE_LENGTH)
            if (
                other[k] and distance[k] <= STRAY_RADIUS and not support[i]
                and on[place] > 0 and away[place] <= FREE_SHARE * on[place] + FREE_CHANCE
            ):
                line_id[i], span_id[i] = number[s]
                residual[i] = distance[k]
                other[k] = False
                num_claimed[s] += 1
    return along, own, other, num_claimed


def find_intruders(
    along: Float64, distance: Float64, own: Bool, other: Bool, tolerance: float
) -> Bool:
    """
    Find the points on a conductor that more likely belong to what surrounds it.

    In each crowded part of the span the shell about the conductor tells how dense the crown is,
    and the free parts tell how dense the conductor's points are and how far they scatter.  Beyond
    the distance at which both densities are equal, a point is more likely the crown's.

    Parameters
    ----------
    along : (N,) float64
        Distance along the span of points close to it [m].
    distance : (N,) float64
        From the conductor [m].
    own : (N,) bool
        Points that were taken for the conductor's.
    other : (N,) bool
        Points of something else, not of a conductor.
    tolerance : float
        Distance within which they were taken [m].

    Returns
    -------
    (N,) bool
        Those of ``own`` that more likely belong to what surrounds the conductor.

    """
    part = (np.maximum(along, 0.0) / CROWD_LENGTH).astype(np.int64)
    num = int(part.max(initial=0)) + 1
    shell = other & (distance > tolerance) & (distance <= SHELL_RATIO * tolerance)
    on, about = (np.bincount(part[chosen], minlength=num) for chosen in (own, shell))
    crowded = about > SHELL_SHARE * on + SHELL_CHANCE
    free = own & ~crowded[part]
    if not crowded.any() or free.sum() < LEAST_FREE:
        return np.zeros(len(along), dtype=np.bool_)
    variance = max(float(np.mean(distance[free] ** 2)) / 2.0, LEAST_SIGMA**2)
    # a window of the node holds more points of some parts than of others
    usual = float(np.percentile(on[(on > 0) & ~crowded], USUAL)) / CROWD_LENGTH
    densest = usual / (2.0 * math.pi * variance)
    volume = math.pi * (SHELL_RATIO**2 - 1.0) * tolerance**2 * CROWD_LENGTH
    with np.errstate(divide='ignore'):
        limit = 2.0 * variance * np.log(densest * volume / about)
    result: Bool = own & crowded[part] & (distance**2 > limit[part])
    return result


def find_held(
    along: Float64, distance: Float64, own: Bool, length: float, closed: tuple[bool, bool]
) -> Bool:
    """
    Find the points on a conductor at its supports that more likely belong to what holds it.

    A conductor has as many points there as anywhere.  A part at a support with more than any
    other has those of a pin, an insulator or an arm too, which scatter wider than its own: beyond
    the distance at which their density is HELD_ODDS times the conductor's, a point is theirs.

    Parameters
    ----------
    along : (N,) float64
        Distance along the span of points close to it, either way from its start [m].
    distance : (N,) float64
        From the conductor [m].
    own : (N,) bool
        Points that were taken for the conductor's.
    length : float
        Of the span [m].
    closed : (bool, bool)
        Whether it hangs at a support at its start and end.

    Returns
    -------
    (N,) bool
        Those of ``own`` that more likely belong to its supports.

    """
    result: Bool = np.zeros(len(along), dtype=bool)
    free = own & (along > UNHELD) & (along < length - UNHELD)
    if free.sum() < LEAST_FREE:
        return result
    counts = np.bincount(((along[free] - UNHELD) / HELD_STEP).astype(np.int64))
    usual = counts.sum() * HELD_STEP / (length - 2.0 * UNHELD)
    variance = max(float(np.mean(distance[free] ** 2)) / 2.0, LEAST_SIGMA**2)
    for is_closed, ahead in zip(closed, (along, length - along), strict=True):
        part = np.floor(np.abs(ahead) / HELD_STEP)
        for number in range(NUM_HELD if is_closed else 0):
            inside = own & (part == number)
            num = int(inside.sum())
            if num <= OVERFULL * counts.max():
                continue
            spread = float(np.mean(distance[inside] ** 2)) / 2.0
            if spread <= variance:  # a conductor seen longer there
                continue
            # the support's fill the part as far as they lie
            ratio = 2.0 * spread / variance * usual / (num - usual)
            limit = 2.0 * variance * math.log(HELD_ODDS * ratio)
            result |= inside & (distance**2 > limit)
    return result
