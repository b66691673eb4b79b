# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bundles: sub-conductors that the cloud cannot tell apart."""

from collections.abc import Sequence
import dataclasses
import math

import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.curve import Curve, find_far_apart, fit_curve
from plc_inspect.core.catenary.profile import profile_curve
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
    near = ~find_far_apart(order, 1.0 + settings.bundle_width)
    alive = list(range(len(order)))
    merged: list[Curve] = []
    while alive:
        first = alive.pop(0)
        base, beside = order[first], near[first]
        others = [number for number in alive if beside[number]]
        while others:
            number = others.pop(0)
            union = _merge_pair(points, base, order[number], settings)
            if union is not None:
                base, beside = union, beside | near[number]
                alive.remove(number)
                others = [number for number in alive if beside[number]]
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


def _merge_pair(
    points: Float64, first: Curve, second: Curve, settings: CatenarySettings
) -> Curve | None:
    if max(first.length, second.length) < settings.bundle_length:
        return None
    if abs(math.sin(first.azimuth - second.azimuth)) > TURNED:
        return None
    dx, dy = second.origin - first.origin
    side = dy * math.cos(first.azimuth) - dx * math.sin(first.azimuth)
    if abs(side) > 1.0 + 0.05 * abs(dx * math.cos(first.azimuth) + dy * math.sin(first.azimuth)):
        return None
    stations = second.position(np.linspace(second.low, second.high, 9))
    x, y = first.local(stations)
    inside = (x > first.low - 1.0) & (x < first.high + 1.0)
    if inside.mean() < 0.5:
        return None
    across = float(np.median(y[inside]))
    above = float(np.median((stations[:, 2] - first.fit.height(x))[inside]))
    apart = math.hypot(across, above)
    worst = float(np.hypot(y, stations[:, 2] - first.fit.height(x))[inside].max())
    if worst > settings.bundle_width + max(0.0, first.tolerance - 0.2):
        return None
    noise = math.hypot(
        across * max(first.lateral_rmse, second.lateral_rmse),
        above * max(first.fit.rmse, second.fit.rmse),
    ) / max(apart, 1e-9)
    if apart > settings.bundle_separation * noise:
        return None
    spread = max(first.tolerance, second.tolerance)
    try:
        return fit_curve(
            points,
            np.union1d(first.points, second.points),
            tolerance=min(apart / 2 + spread, settings.bundle_width),
        )
    except FitError:
        return None
