# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The points about a conductor that are its own by their scatter, also where it is blurred."""

from collections.abc import Sequence
import math

import numpy as np

from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, Int64

BLURRED = 2.0
"""
Scatter of a conductor's points about its curve, in that of the cloud, beyond which it is blurred.
Source: judgement; four times the variance.
"""
TALL, WIDE = 4.0, 5.0
"""
How far above and below a blurred conductor points are of it, and about any they may be, in its
scatter.
Source: chosen on bench/hazards.py and bench/studies/planted_hazards.py; it is not normal.
"""
ACROSS = 0.3
"""
How far beside a blurred conductor they are [m].
Source: derived: as wires.TUBE; what blurs a conductor is mostly its height.
"""
CLOSE = 0.3
"""
Distance from a conductor within which its points may stray, and the gap behind them [m].
Source: derived: as wires.TUBE.
"""
FEW = 5
"""
Points fewer than which, so close to a conductor, may be its own.
Source: judgement; as hazards.min_points.
"""
CARRIED_ROOM, CARRIED = 1.0, 0.03
"""
What has so much less of an object's points about it [m] than these have of each other is a stray.
Source: measured: the outermost points of nine objects of uav_jujuy_street_trees and
uav_mexico_street have at most 0.022 of it and are strays; those of 50 others at least 0.052.
"""
NUM_SAMPLES, MOST_STRAYS, MOST_COUNTED = 25, 50, 20_000
"""
Points of an object that tell how many are usual, strays beyond which none is, and points that are
counted.
Source: numerical: bounds of time, 10 ms an object.
"""


def is_blurred(model: SpanModel) -> bool:
    """Tell whether the points of a conductor scatter more than those of the others."""
    return len(model.strands) == 1 and model.curve.fit.rmse > BLURRED * model.scatter


def measure_reach(model: SpanModel) -> float:
    """Return how far from a conductor's curve points may be taken for its own [m]."""
    if len(model.strands) > 1:
        return model.curve.tolerance
    times = TALL if is_blurred(model) else WIDE
    return max(times * model.curve.fit.rmse, model.curve.tolerance)


def find_blur(points: Float64, owner: Int64, models: Sequence[SpanModel]) -> Bool:
    """
    Tell the points that lie about a blurred conductor as its own do.

    Parameters
    ----------
    points : (K, 3) float64
        Off the ground, neither wire nor support [m].
    owner : (K,) int64
        The nearest conductor.
    models : sequence of SpanModel
        Spans with their curves.

    Returns
    -------
    (K,) bool

    """
    result = np.zeros(len(points), dtype=bool)
    for number, model in enumerate(models):
        if is_blurred(model):
            mine = np.flatnonzero(owner == number)
            x, y = model.curve.local(points[mine])
            above = points[mine, 2] - model.curve.fit.height(x)
            result[mine] = (
                (np.abs(y) <= ACROSS) & (np.abs(above) <= measure_reach(model))
                & (x >= model.low) & (x <= model.high)
            )
    return result


def choose_worst(
    points: Float64, share: Float64, distance: Float64, owner: Int64, models: Sequence[SpanModel]
) -> int:
    """
    Choose the point that a hazard rests on: the worst that cannot be a conductor's own.

    Nor is it one of a few close to a conductor, with a gap behind them, or a stray.

    Parameters
    ----------
    points : (K, 3) float64
        Of one object [m].
    share : (K,) float64
        Of the required distance that is kept.
    distance : (K,) float64
        To the nearest conductor [m].
    owner : (K,) int64
        Which that is.
    models : sequence of SpanModel
        Spans with their curves.

    Returns
    -------
    int
        The worst of all where each may be the conductor's own.

    """
    reach = np.array([measure_reach(model) for model in models])
    beyond = distance > reach[owner]
    close = beyond & (distance <= CLOSE)
    farther = np.where(beyond & ~close, distance, np.inf).min()
    if 0 < close.sum() < FEW and CLOSE < farther - distance[close].max() < np.inf:
        beyond &= ~close
    if not beyond.any():
        return int(np.argmin(share))
    order = np.argsort(np.where(beyond, share, np.inf), kind='stable')[: beyond.sum()]
    return int(order[_count_strays(points[order])])


def _count_strays(own: Float64) -> int:
    """Return how many of the first points of an object are strays."""
    counted = own[:: math.ceil(len(own) / MOST_COUNTED)]
    sample = np.linspace(0, len(own) - 1, min(NUM_SAMPLES, len(own))).astype(np.int64)
    least = CARRIED * float(np.median([_count_about(counted, own[k]) for k in sample]))
    for count, place in enumerate(own[:MOST_STRAYS]):
        if max(_count_about(counted, place), 1) >= least:  # itself may not be counted
            return count
    return 0


def _count_about(points: Float64, place: Float64) -> int:
    apart = points - place
    return int((np.einsum('ij,ij->i', apart, apart) <= CARRIED_ROOM**2).sum())
