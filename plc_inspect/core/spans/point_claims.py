# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Strays beside conductors, and leaves on them: whose the points close to a span are."""

import dataclasses

from numba import njit, prange
import numpy as np

from plc_inspect.core.catenary.curve import pack_curves
from plc_inspect.core.catenary.curve_row import to_local
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.spans.crowding import find_intruders
from plc_inspect.core.spans.span_model import tabulate
from plc_inspect.core.spans.spans import copy_labels, SpanResult

FREE_LENGTH = 2.0
"""
Length of the parts of a span that are free of other things or not [m].
Source: judgement; holds from 1 to 4 on bench/constants.py.
"""
STRAY_RADIUS = 0.5
"""
A conductor's own points stray this far from it [m].
Source: judgement; holds up to 0.7, not down to 0.7 of it, on bench/constants.py.
"""
FREE_RADIUS = 1.0
"""
Something else begins within this distance wherever it touches a conductor [m].
Source: judgement; holds from 0.7 to 2 on bench/constants.py.
"""
FREE_SHARE, FREE_CHANCE = 0.1, 1.0
"""
A place is free where at most this share of its points, and this number, are that far away.
Source: judgement; FREE_SHARE holds from 0.05 to 0.2, FREE_CHANCE not measured on
bench/constants.py.
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
        gone = near[mine][given]
        intruders.append(gone)
        spans.line_id[gone], spans.span_id[gone], spans.residual[gone] = -1, -1, np.nan
        num_points = model.span.num_points + int(num_claimed[number]) - len(gone)
        models.append(dataclasses.replace(
            model, span=dataclasses.replace(model.span, num_points=num_points)
        ))
    return dataclasses.replace(
        spans, models=tuple(models), intruders=np.concatenate(intruders)
    )


@njit(cache=True, parallel=True, nogil=True)
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
    for s in prange(len(rows)):
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
