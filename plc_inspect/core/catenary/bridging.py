# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of one conductor in one span become one curve, over the gaps between them."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.config import CatenarySettings
from plc_inspect.core.catenary.breaks import find_breaks
from plc_inspect.core.catenary.curve import Curve, fit_curve, pack_curves, PART_MISS
from plc_inspect.core.catenary.curve_row import (
    COS,
    height_of,
    HIGH,
    LOW,
    MEAN_X,
    ORIGIN_X,
    ORIGIN_Y,
    sigma_of,
    SIN,
    to_local,
)
from plc_inspect.core.catenary.duplicates import is_thick
from plc_inspect.core.numerics.arrays import merge_ascending
from plc_inspect.errors import FitError
from plc_inspect.results import Float64

MAX_MISS = 0.8
"""
Miss of a continuation, at most, however uncertain it is [m].
Source: judgement; not measured.
"""
LEAST_FIT = 0.8
"""
Share of the points of each of two parts that must lie on the curve through both.
Source: judgement; not measured.
"""


def bridge(
    points: Float64, curves: Sequence[Curve], settings: CatenarySettings
) -> tuple[Curve, ...]:
    """
    Join curves that are parts of one conductor in one span.

    Starting from the longest, the curve whose points lie nearest to the continuation is tried
    first; the union must be explained by one catenary about as well as the parts are.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Tried in their order.
    settings : CatenarySettings
        Settings of the stage.

    Returns
    -------
    tuple of Curve, longest first

    """
    alive = list(curves)
    rows = pack_curves(curves)
    result: list[Curve] = []
    while alive:
        base, row, rows = alive.pop(0), rows[0], rows[1:]
        while alive:
            miss = _measure_misses(row, rows, settings.max_bridge)
            for position in np.argsort(miss, kind='stable')[: np.isfinite(miss).sum()].tolist():
                union = _join(points, base, alive[position], settings)
                if union is not None:
                    base, row = union, union.row
                    del alive[position]
                    rows = np.delete(rows, position, axis=0)
                    break
            else:
                break
        result.append(base)
    result.sort(key=lambda curve: (-curve.length, *curve.origin))
    return tuple(result)


@njit(cache=True, nogil=True, error_model='numpy')
def _measure_misses(base, rows, max_bridge):  # type: ignore[no-untyped-def]
    """How far curves lie off the continuation of ``base`` [m], inf where they are none of it."""
    result = np.full(len(rows), np.inf)
    for k in range(len(rows)):
        row = rows[k]
        least, most, total = np.inf, -np.inf, 0.0
        for part in (1, 0, 2):  # the middle and both ends
            at = row[LOW] + 0.5 * part * (row[HIGH] - row[LOW])
            x, y = to_local(
                base, row[ORIGIN_X] + row[COS] * at, row[ORIGIN_Y] + row[SIN] * at
            )
            away = abs(x - base[MEAN_X])
            if part == 1 and (
                abs(y) >= MAX_MISS + 0.02 * away or away >= base[HIGH] - base[LOW] + max_bridge
            ):
                break
            miss = math.hypot(y, height_of(row, at) - height_of(base, x))
            if not miss <= min(PART_MISS + 3 * sigma_of(base, x), MAX_MISS):
                break
            least, most, total = min(least, x), max(most, x), total + miss
        else:
            gap = max(least - base[HIGH], base[LOW] - most, 0.0)
            if gap <= min(max(row[HIGH] - row[LOW], base[HIGH] - base[LOW]), max_bridge):
                result[k] = total / 3.0 + 0.01 * gap
    return result


def _join(
    points: Float64, first: Curve, second: Curve, settings: CatenarySettings
) -> Curve | None:
    """Return one curve through the points of both, or None if they are not of one span."""
    shorter = min(first.length, second.length)
    if is_thick(first) != is_thick(second) and shorter < settings.bundle_length:
        return None
    tolerance = max(first.tolerance, second.tolerance)
    try:
        union = fit_curve(
            points, merge_ascending(first.points, second.points), tolerance=tolerance
        )
    except FitError:
        return None
    for part in (first, second):
        x, y = union.local(points[part.points])
        miss = np.maximum(np.abs(y), np.abs(points[part.points, 2] - union.fit.height(x)))
        if (miss <= tolerance).mean() < LEAST_FIT:
            return None
    error = math.hypot(union.fit.rmse, union.lateral_rmse)
    own = max(math.hypot(part.fit.rmse, part.lateral_rmse) for part in (first, second))
    if error > max(1.4 * own, 0.05):
        return None
    own_points = points[union.points]
    x, y = union.local(own_points)
    if find_breaks(x, y, own_points[:, 2]):
        return None
    return union
