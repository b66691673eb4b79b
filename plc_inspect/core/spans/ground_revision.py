# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground below conductors that were taken for ground, estimated anew once they are known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plc_inspect.config import HeightSettings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.free_length import find_sight
from plc_inspect.core.catenary.nearest_span import find_near, span_table
from plc_inspect.core.extraction.ground_surface import measure_surface
from plc_inspect.core.extraction.height import extract_high, ground_at, HeightResult
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.results import Float64

OWN_REACH = 0.5
"""
Points this near to the curve of a conductor may be its own, and are no ground [m].
Source: judgement; holds from 0.25 to 1 on bench/constants.py.
"""
BEYOND = 20.0
"""
A conductor is looked for this far beyond the points that its curve was fitted to [m].
Source: judgement; holds from 10 to 40 on bench/constants.py.
"""


def revise_ground(
    points: Float64,
    height: HeightResult,
    curves: Sequence[Curve],
    settings: HeightSettings,
    region: Float64 | None = None,
) -> HeightResult:
    """
    Estimate the ground anew where it reaches up to conductors, without their own points.

    Where wires are seen before the ground below them, their points are the lowest of their cells.
    Nothing is done where each curve keeps ``beta`` above the ground.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    height : HeightResult
        Of these points.
    curves : sequence of Curve
        Conductors that were found.
    settings : HeightSettings
        Settings of this stage.
    region : (2, 2) float64 or None
        As of `measure_surface`, where these points are a part of a cloud.

    Returns
    -------
    HeightResult
        That given, where no conductor is low.

    """
    low = _find_low(curves, height, settings.beta)
    if not low:
        return height
    table = span_table(
        low,
        np.array([curve.low - BEYOND for curve in low]),
        np.array([curve.high + BEYOND for curve in low]),
    )
    own, _, _ = find_near(points, table, OWN_REACH)
    airborne = np.zeros(len(points), dtype=np.bool_)
    airborne[own] = True
    if region is None:
        revised = extract_high(points, settings, airborne)
    else:
        surface = measure_surface(points, settings, airborne, region)
        revised = extract_high(
            points, settings, surface=surface, peak=height.threshold - settings.beta
        )
    # the ground below them is a guess where none was seen, and may be as high as they are
    high = revised.high.copy()
    high[own] |= ~find_sight(revised).tell(points[own])
    return replace(revised, high=high)


def _find_low(curves: Sequence[Curve], height: HeightResult, beta: float) -> list[Curve]:
    """Curves that come nearer to the ground than ``beta``."""
    if not curves:
        return []
    places = [
        curve.position(np.linspace(
            curve.low - BEYOND, curve.high + BEYOND,
            int((curve.length + 2 * BEYOND) / height.cell_size) + 2,
        ))
        for curve in curves
    ]
    at = np.concatenate(places)
    near = at[:, 2] - ground_at(height, at[:, :2]) < beta
    start = np.cumsum([0, *(len(place) for place in places[:-1])])
    low = np.logical_or.reduceat(near, start)
    return [curve for curve, is_low in zip(curves, low, strict=True) if is_low]


def renumber_points(
    curves: Sequence[Curve], before: OffGround, after: OffGround
) -> tuple[Curve, ...]:
    """
    Return curves whose points are indices into another choice of points off the ground.

    Parameters
    ----------
    curves : sequence of Curve
        Their points are indices into ``before``.
    before, after : OffGround
        Two choices of points of one cloud.

    Returns
    -------
    tuple[Curve, ...]
        The same curves with indices into ``after``; points that are not in it are left out.

    """
    number = np.full(after.num_total, -1, dtype=np.int64)
    number[after.place] = np.arange(len(after.place))
    renumbered = []
    for curve in curves:
        own = number[before.place[curve.points]]
        renumbered.append(replace(curve, points=np.sort(own[own >= 0])))
    return tuple(renumbered)
