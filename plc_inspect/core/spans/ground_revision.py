# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground below conductors that were taken for ground, estimated anew once they are known."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plc_inspect.config import HeightSettings
from plc_inspect.core.catenary.curve import Curve, span_table
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.extraction.height import extract_high, HeightResult
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.ground.ground_surface import measure_surface
from plc_inspect.results import Bool, Float64

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
LEAST_FREED = 36
"""
Points that turn out to be high near one place, at least, for which it is searched again.
Source: derived: 12 m, which prove a straight conductor, at three points a metre.
"""
BLOCK = 16.0
"""
Edge of the blocks in which they are counted, each with the eight about it [m].
Source: judgement: 12 m of a conductor lie within nine of them, and no edge of a grid's part.
"""
NEAR_BLOCKS = 2
"""Blocks about such a place that are searched again with it.  Source: derived: BEYOND."""


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
    Nothing is done where each curve keeps ``beta`` above the ground.  What was left out of the
    ground before stays out of it, as its own conductors need not be low any more.

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
    region : (2, 3) float64 or None
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
    if height.airborne is not None:
        airborne |= height.airborne
    return _measure_without(points, airborne, height, settings, region)


def raise_ground(
    points: Float64,
    before: HeightResult,
    after: HeightResult,
    settings: HeightSettings,
    region: Float64 | None = None,
) -> HeightResult | None:
    """
    Return the ground above which a cloud is to be searched again, None where it need not be.

    It is the revised one wherever enough points rose above it, and that before elsewhere.  What
    is far away decides nothing, so that a part of a cloud is searched again as the whole is.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    before : HeightResult
        Of these points, above which conductors were found.
    after : HeightResult
        That of `revise_ground` with these.
    settings, region
        As of `revise_ground`.

    Returns
    -------
    HeightResult or None

    """
    freed = np.flatnonzero(after.high & ~before.high)
    if after.airborne is None or len(freed) < LEAST_FREED:
        return None
    risen = _find_risen(points[freed])
    if not risen:
        return None
    airborne = after.airborne.copy()
    fresh = airborne if before.airborne is None else airborne & ~before.airborne
    own = np.flatnonzero(fresh)
    stays = [block not in risen for block in _number_blocks(points[own])]
    if not any(stays):
        return after
    airborne[own[stays]] = False
    return _measure_without(points, airborne, before, settings, region)


def _number_blocks(points: Float64) -> list[tuple[int, int]]:
    """Return the block of each point, in plan."""
    blocks: list[list[int]] = np.floor(points[:, :2] / BLOCK).astype(np.int64).tolist()
    return [(column, row) for column, row in blocks]


def _find_risen(freed: Float64) -> set[tuple[int, int]]:
    """Return the blocks in which, and in those about them, enough points rose, and near ones."""
    counts = Counter(_number_blocks(freed))
    about = Counter[tuple[int, int]]()
    for block, count in counts.items():
        for near in _list_near(block, 1):
            about[near] += count
    return {
        near for block, count in about.items() if count >= LEAST_FREED
        for near in _list_near(block, NEAR_BLOCKS)
    }


def _list_near(block: tuple[int, int], reach: int) -> list[tuple[int, int]]:
    """Return a block and those about it."""
    steps = range(-reach, reach + 1)
    return [(block[0] + right, block[1] + up) for right in steps for up in steps]


def _measure_without(
    points: Float64, airborne: Bool, before: HeightResult, settings: HeightSettings,
    region: Float64 | None,
) -> HeightResult:
    """Return the heights above the ground that all points but the airborne ones make."""
    surface = measure_surface(points, settings, airborne, region)
    # the peak is that of before: a part of a cloud cannot tell it, and few points do not move it
    found = extract_high(
        points, settings, airborne, surface=surface, peak=before.threshold - settings.beta
    )
    # the ground below them is a guess where none was seen, and may be as high as they are
    own = np.flatnonzero(airborne)
    high = found.high.copy()
    high[own] |= ~found.ground.tell_seen(points[own])
    return replace(found, high=high)


def _find_low(curves: Sequence[Curve], height: HeightResult, beta: float) -> list[Curve]:
    """Curves that come nearer to the ground than ``beta``."""
    if not curves:
        return []
    places = [
        curve.position(np.linspace(
            curve.low - BEYOND, curve.high + BEYOND,
            int((curve.length + 2 * BEYOND) / height.ground.cell_size) + 2,
        ))
        for curve in curves
    ]
    at = np.concatenate(places)
    near = at[:, 2] - height.ground.at(at[:, :2]) < beta
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
