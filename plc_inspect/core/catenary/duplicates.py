# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Duplicates: curves that have their points from better seen ones."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    height_of,
    HIGH,
    LOW,
    ORIGIN_X,
    ORIGIN_Y,
    SIN,
    to_local,
    TOLERANCE,
)
from plc_inspect.results import Bool, Float64

THICK = 0.12
"""
Points of one conductor spread less than this about its curve (rms) [m].
Source: judgement; not measured: four times the noise of ranges of the Puck Lite.
"""
MAX_SHARED = 0.5
"""
A curve with a larger share of its points on better seen curves is dropped.
Source: judgement; not measured: most of it is theirs.
"""
NUM_STATIONS = 21
"""Places along a curve that tell its course.  Source: numerical: one in 5 % of its length."""
SLACK = 0.5
"""A curve counts this far beyond its ends [m].  Source: judgement; not measured."""
ALONG = 0.3
"""
A conductor beside runs along this share of a curve, at least.
Source: judgement; not measured.
"""
SPAN = 6.0
"""
Conductors of one span are so near to each other in plan [m].
Source: judgement: phases of high-voltage lines are 4 to 8 m apart, low-voltage ones 0.3 to 1 m.
"""
SLACKER = 0.5
"""
A slack conductor is farther below others of its span in its middle than at its ends, by this share
of its sag at least.
Source: derived: of one that sags twice as much as they do.
"""
PARALLEL = 0.1
"""
Greatest sine of the angle between curves that run beside each other: 6 degrees.
Source: judgement; not measured.
"""


def drop_duplicates(
    points: Float64, curves: Sequence[Curve], settings: CatenarySettings,
    sure: Sequence[Curve] = (),
) -> tuple[Curve, ...]:
    """
    Drop each curve that has most of its points from better seen ones.

    A line laid across several conductors at a small angle meets points of each, but has none
    of its own.  A bundle is no duplicate of one of its conductors, however wide it reaches.  What
    is sure goes before all others.
    """
    if not curves and not sure:
        return ()
    order = [
        curve for part in (sure, curves)
        for curve in sorted(part, key=lambda curve: _rank(curve, settings))
    ]
    start = np.cumsum([0, *(len(curve.points) for curve in order)])
    kept = _choose(
        points, pack_curves(order), np.concatenate([curve.points for curve in order]), start,
        find_near(order),
    )
    result = [curve for curve, is_kept in zip(order, kept, strict=True) if is_kept]
    result.sort(key=lambda curve: (-curve.length, *curve.origin))
    return tuple(result)


def _rank(curve: Curve, settings: CatenarySettings) -> tuple[float, ...]:
    """
    Order of belief: by points, but a thick curve in a short span comes after all thin ones.

    Bundles hang in long spans; in a short one a thick curve lies over several conductors.
    """
    return (
        float(is_thick(curve) and curve.length < settings.bundle_length),
        float(-curve.num_points),
        float(curve.origin[0]),
        float(curve.origin[1]),
    )


def is_thick(curve: Curve) -> bool:
    """Tell a curve over several conductors, or a bundle, from one over a single conductor."""
    return measure_thickness(curve) > THICK


def measure_thickness(curve: Curve) -> float:
    """Return the spread of a curve's points across it or in height, whichever is greater [m]."""
    return max(curve.lateral_rmse, curve.fit.rmse)


@njit(cache=True, nogil=True, error_model='numpy')
def _choose(points, rows, own, start, near):  # type: ignore[no-untyped-def]
    """Tell which curves, best seen first, have points of their own."""
    kept = np.zeros(len(rows), dtype=np.bool_)
    for number in range(len(rows)):
        mine = own[start[number] : start[number + 1]]
        shared = np.zeros(len(mine), dtype=np.bool_)
        for k in near.item[near.start[number] : near.start[number + 1]]:
            if not kept[k]:  # nor is what comes later
                continue
            other = rows[k]
            for m in range(len(mine)):
                i = mine[m]
                shared[m] = shared[m] or _lies_on(
                    points[i, 0], points[i, 1], points[i, 2], other, other[LOW] - SLACK,
                    other[HIGH] + SLACK, other[TOLERANCE],
                )
        kept[number] = len(mine) > 0 and shared.mean() <= MAX_SHARED
    return kept


@njit(cache=True, nogil=True, error_model='numpy')
def mark_course(row, other, low, high, reach, marks):  # type: ignore[no-untyped-def]
    """Mark the stations along a row's curve that lie on another one between two x of that."""
    for k in range(len(marks)):
        x = row[LOW] + (row[HIGH] - row[LOW]) * k / (len(marks) - 1)
        marks[k] = marks[k] or _lies_on(
            row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x, height_of(row, x),
            other, low, high, reach,
        )


@njit(cache=True, nogil=True, error_model='numpy')
def _lies_on(px, py, pz, row, low, high, reach):  # type: ignore[no-untyped-def]
    """Tell whether a place is within reach of a row's curve between two x."""
    x, y = to_local(row, px, py)
    if abs(y) > reach or x < low or x > high:
        return False
    return math.hypot(y, pz - height_of(row, x)) <= reach


def find_along(curves: Sequence[Curve], others: Sequence[Curve], reach: float) -> Bool:
    """
    Tell which curves have another one beside them.

    Parameters
    ----------
    curves, others : sequence of Curve
        C curves, and those that may run beside them.
    reach : float
        Greatest distance [m].

    Returns
    -------
    (C,) bool

    """
    near = find_near(curves, reach, others)
    result: Bool = _mark_along(pack_curves(curves), pack_curves(others), near, reach)
    return result


def find_slack(curves: Sequence[Curve], others: Sequence[Curve]) -> Bool:
    """
    Tell which curves sag far more than another one along them, as a conductor that slipped.

    The arguments are those of `find_along`.
    """
    near = find_near(curves, SPAN, others)
    result: Bool = _mark_slack(pack_curves(curves), pack_curves(others), near)
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _mark_along(rows, others, near, reach):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        for m in near.item[near.start[k] : near.start[k + 1]]:
            if abs(np.sin(rows[k, AZIMUTH] - others[m, AZIMUTH])) > PARALLEL:
                continue
            marks = np.zeros(NUM_STATIONS, dtype=np.bool_)
            mark_course(rows[k], others[m], others[m, LOW], others[m, HIGH], reach, marks)
            if marks.mean() >= ALONG:
                result[k] = True
                break
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _mark_slack(rows, others, near):  # type: ignore[no-untyped-def]
    result = np.zeros(len(rows), dtype=np.bool_)
    drop = np.empty(NUM_STATIONS)
    for k in range(len(rows)):
        row = rows[k]
        middle = height_of(row, 0.5 * (row[LOW] + row[HIGH]))
        sag = 0.5 * (height_of(row, row[LOW]) + height_of(row, row[HIGH])) - middle
        for m in near.item[near.start[k] : near.start[k + 1]]:
            if abs(np.sin(row[AZIMUTH] - others[m, AZIMUTH])) > PARALLEL:
                continue
            for step in range(NUM_STATIONS):
                x = row[LOW] + step / (NUM_STATIONS - 1) * (row[HIGH] - row[LOW])
                at, aside = to_local(
                    others[m], row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
                )
                if max(others[m, LOW] - at, at - others[m, HIGH], abs(aside)) > SPAN:
                    break
                drop[step] = height_of(others[m], at) - height_of(row, x)
            else:
                deeper = drop[NUM_STATIONS // 2] - max(drop[0], drop[-1])
                result[k] |= deeper >= SLACKER * sag
    return result
