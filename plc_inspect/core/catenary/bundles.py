# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bundles: sub-conductors that the cloud cannot tell apart."""

from collections.abc import Sequence
import dataclasses
import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, find_near, fit_curve, pack_curves
from plc_inspect.core.catenary.curve_row import (
    AZIMUTH,
    COS,
    height_of,
    HIGH,
    LATERAL_RMSE,
    LOW,
    ORIGIN_X,
    ORIGIN_Y,
    RMSE,
    SIN,
    to_local,
    TOLERANCE,
)
from plc_inspect.core.catenary.profile import profile_curve
from plc_inspect.core.numerics.arrays import merge_ascending
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.errors import FitError
from plc_inspect.results import Float64

BUNDLE_SHARE = 0.75
"""
Tolerance of a bundle's curve as a share of the greatest width of a bundle.
Source: judgement; not measured.
"""
WIDENINGS = 3
"""Times that a curve is fitted to the points about it, which moves it.  Source: judgement."""
TURNED = 0.05
"""
Greatest sine of the angle between two curves of one bundle: 3 degrees.
Source: judgement; not measured.
"""
NUM_STATIONS = 9
"""Places along a curve at which it is compared.  Source: numerical."""
BEYOND = 1.0
"""A curve counts this far beyond its ends [m].  Source: judgement; not measured."""
NARROW = 0.2
"""
A bundle's curve may be wider by what its tolerance is above this [m].
Source: judgement: twice the least tolerance.
"""


def merge_bundles(
    points: Float64, curves: Sequence[Curve], settings: CatenarySettings
) -> tuple[Curve, ...]:
    """
    Make one curve of sub-conductors that the cloud cannot tell apart.

    Sub-conductors of a bundle run side by side within ``bundle_width`` over a long span.  They
    stay apart where their distance is ``bundle_separation`` times the spread of their points or
    more; below that, points go over from one to the other and neither curve is sure.
    """
    order = sorted(curves, key=lambda curve: (-curve.num_points, *curve.origin))
    around, rows = find_near(order, 1.0 + settings.bundle_width), pack_curves(order)
    is_alive = np.ones(len(order), dtype=bool)
    merged: list[Curve] = []
    for first, base in enumerate(order):
        if not is_alive[first]:
            continue
        is_alive[first] = False
        near = around.of(first)
        waiting = near[is_alive[near]]
        while len(waiting):
            place, apart = _find_candidate(
                base.row, rows, waiting, settings.bundle_length, settings.bundle_width,
                settings.bundle_separation,
            )
            if place == len(waiting):
                break
            number = int(waiting[place])
            waiting = waiting[place + 1 :]
            union = _unite(points, base, order[number], apart, settings.bundle_width)
            if union is not None:
                base, is_alive[number] = union, False
                near = merge_ascending(near, around.of(number))
                waiting = near[is_alive[near]]
        merged.append(base)
    merged.sort(key=lambda curve: (-curve.length, *curve.origin))
    return tuple(merged)


def widen(
    points: Float64, index: PlanIndex, curve: Curve, settings: CatenarySettings
) -> Curve:
    """
    Take a long curve that is crowded for a bundle, if the whole bundle is free in the air.

    A track that changes from one sub-conductor to the other lies between them.
    """
    if curve.length < settings.bundle_length:
        return curve
    profile = profile_curve(points, index, curve, curve.low, curve.high)
    if profile.crowding <= settings.max_crowding:
        return curve
    try:
        wide = widen_to(points, index, curve, BUNDLE_SHARE * settings.bundle_width)
    except FitError:
        return curve
    profile = profile_curve(points, index, wide, wide.low, wide.high)
    return wide if profile.crowding <= settings.max_crowding else curve


def widen_to(points: Float64, index: PlanIndex, curve: Curve, tolerance: float) -> Curve:
    """
    Fit a curve anew to all points within a greater tolerance of it [m].

    Raises
    ------
    FitError
        They agree on no curve.

    """
    wide = dataclasses.replace(curve, tolerance=tolerance)
    for _ in range(WIDENINGS):
        chosen = profile_curve(points, index, wide, curve.low, curve.high).chosen
        wide = fit_curve(points, chosen, tolerance=tolerance, azimuth=curve.azimuth)
    return wide


def _unite(
    points: Float64, first: Curve, second: Curve, apart: float, width: float
) -> Curve | None:
    spread = max(first.tolerance, second.tolerance)
    try:
        return fit_curve(
            points,
            merge_ascending(first.points, second.points),
            tolerance=min(apart / 2 + spread, width),
        )
    except FitError:
        return None


@njit(cache=True, nogil=True, error_model='numpy')
def _find_candidate(  # type: ignore[no-untyped-def]
    row, rows, numbers, least_length, width, separation
):
    """
    Find the first number whose row may be of one bundle with a row.

    Returned are its place, beyond the last one if there is none, and how far both are apart [m].
    """
    for place in range(len(numbers)):
        other = rows[numbers[place]]
        if max(row[HIGH] - row[LOW], other[HIGH] - other[LOW]) < least_length:
            continue
        if abs(math.sin(row[AZIMUTH] - other[AZIMUTH])) > TURNED:
            continue
        along, side = to_local(row, other[ORIGIN_X], other[ORIGIN_Y])
        if abs(side) > 1.0 + TURNED * abs(along):
            continue
        apart = _measure_apart(row, other, width, separation)
        if not math.isnan(apart):
            return place, apart
    return len(numbers), math.nan


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_apart(row, other, width, separation):  # type: ignore[no-untyped-def]
    """Distance of two rows' curves side by side [m], NaN where they are told apart or part."""
    across, above = np.empty(NUM_STATIONS), np.empty(NUM_STATIONS)
    num, worst = 0, 0.0
    for station in range(NUM_STATIONS):
        at = other[LOW] + (other[HIGH] - other[LOW]) * station / (NUM_STATIONS - 1)
        x, y = to_local(
            row, other[ORIGIN_X] + other[COS] * at, other[ORIGIN_Y] + other[SIN] * at
        )
        if row[LOW] - BEYOND < x < row[HIGH] + BEYOND:
            across[num], above[num] = y, height_of(other, at) - height_of(row, x)
            worst = max(worst, math.hypot(across[num], above[num]))
            num += 1
    if num < 0.5 * NUM_STATIONS or worst > width + max(0.0, row[TOLERANCE] - NARROW):
        return math.nan
    aside, rise = np.median(across[:num]), np.median(above[:num])
    apart = math.hypot(aside, rise)
    noise = math.hypot(
        aside * max(row[LATERAL_RMSE], other[LATERAL_RMSE]), rise * max(row[RMSE], other[RMSE])
    ) / max(apart, 1e-9)
    return math.nan if apart > separation * noise else apart
