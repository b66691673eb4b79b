# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Where a crown surrounds a conductor: which of the points on it are the conductor's."""

import math

import numpy as np

from plc_inspect.core.catenary.profile import CROWD_LENGTH
from plc_inspect.core.clustering.segment_fit import SHELL_CHANCE, SHELL_RATIO, SHELL_SHARE
from plc_inspect.results import Bool, Float64

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
