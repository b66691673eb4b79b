# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bars and pipes: wider than noise, and seen from one side, so their cross-section is an arc."""

import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import open_row, see_above, see_beside
from plc_inspect.results import Float64

ARC_SHARE = 0.25
"""
Share of the scatter across the flat of a cross-section that an arc explains, at least.
Source: measured: pipes of random racks 0.33 to 0.56; of 22 curves of six real clouds that lie on
conductors without a proven curvature, one has more than 0.15, of 12 points (ARC_SIGMAS: 2.6).
"""
ARC_SIGMAS = 5.0
"""
Standard deviations by which the arc's curvature differs from none, at least.
Source: judgement: three points of noise less than any pipe has; those of racks have 9 to 20.
"""
LEAST_POINTS, NUM_SHAPE = 8, 3
"""
Points of an arc, at least, and its parameters: height, slope and bend.
Source: derived: more than twice as many.
"""
LEAST_BEND = 1e-9
"""
Share of the squares of a parabola that neither a level nor a slope explains, at least.
Source: numerical: rounding, where all points lie at two places.
"""


def is_bar(points: Float64, curve: Curve) -> bool:
    """
    Tell whether the points of a curve lie on one side of a round bar.

    In the cross-section those of a conductor are noise about one place, or about a few, those of
    a bundle.  A bar or pipe is wider than the noise, and hides its own far side: across its flat
    they lie on an arc.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curve : Curve
        The curve, with its points.

    Returns
    -------
    bool

    """
    result: bool = _is_bar(points, curve.points, curve.row)
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _is_bar(points, chosen, row):  # type: ignore[no-untyped-def]
    num = len(chosen)
    if num < LEAST_POINTS:
        return False
    # places beside and above the curve, about their mean
    aside, above, opened = np.empty(num), np.empty(num), open_row(row)
    for k, i in enumerate(chosen):
        x, aside[k] = see_beside(opened, points[i, 0], points[i, 1])
        above[k], _ = see_above(opened, x, points[i, 2])
    aside -= aside.mean()
    above -= above.mean()
    # along the main axis, and across it: an arc is a parabola over it, and a slope is none
    turn = 0.5 * math.atan2(2.0 * (aside @ above), aside @ aside - above @ above)
    wide = math.cos(turn) * aside + math.sin(turn) * above
    across = math.cos(turn) * above - math.sin(turn) * aside
    square = wide * wide
    second, third, fourth = square.sum(), (square * wide).sum(), square @ square
    if not second > 0.0:
        return False
    # what of the parabola is neither level nor a slope, and across of it
    bend = square - second / num - third / second * wide
    weight, total = bend @ bend, across @ across
    if not weight > LEAST_BEND * fourth:
        return False
    shape = (bend @ across) / weight
    rest = total - shape * shape * weight
    sigma = math.sqrt(max(rest, 0.0) / (num - NUM_SHAPE) / weight)
    return rest <= (1.0 - ARC_SHARE) * total and abs(shape) >= ARC_SIGMAS * sigma and total > 0.0
