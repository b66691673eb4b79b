# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Conductors that hang too low above the ground, where that was seen."""

from collections.abc import Sequence
import math
from typing import Any

from numba import njit, prange
import numpy as np

from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.hazards.encroachments import describe_hazard
from plc_inspect.core.numerics.arrays import take_rows
from plc_inspect.core.numerics.plan_index import build_plan_index
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float32, Float64, HazardKind, Severity, Support

LEAST_GROUND = 0.5
"""
Height of a conductor above what may be ground, at least [m].
Source: derived: as labels.GROUND_BAND; what is nearer to a conductor is the conductor, seen before
the ground below it.
"""
STEEPEST = 1.0
"""
Slope of the ground along a span at most.
Source: judgement; a step up to a conductor is steeper.
"""
STEP = 1.0
"""Step of the ground along a span that may be steeper [m].  Source: judgement."""
GROUND_SIGMA = 0.05
"""
Standard deviation of the height of the ground below a conductor, beside that of its fit [m].
Source: judgement; not measured.
"""
ROUGH_SIGMA = 0.3
"""
The same where the lowest of the points about a place is all that is known [m].
Source: derived: the lowest point of a cell of 1 m lies that far below its middle on a slope of
31 degrees.
"""
ABOVE_LOWEST = 0.5
"""
Height above the lowest points about it up to which a point may be of the ground [m].
Source: derived: as labels.GROUND_BAND.
"""
REACHES = (1.5, 3.0)
"""
Distance in plan within which points lie on the plane of the ground, the first that has enough [m].
Source: judgement; more than a cell of the ground surface, and less than its bends.
"""
LEAST_POINTS = 8
"""Points that a plane of the ground rests on at least.  Source: judgement; not measured."""
ROUNDS = 4
"""Fits of a plane at most.  Source: numerical: few change after the third."""
ABOVE_PLANE = 2.5
"""
Standard deviations above the plane from which a point is of what grows on the ground.
Source: derived: 0.6 % of normal errors lie above.
"""
LEAST_SPREAD = 0.3
"""
Standard deviation in plan, along its narrower axis, of the points that fix a plane at least [m].
Source: judgement; one scan line shows no slope across it.
"""
MOST_SPREAD = 0.3
"""
Standard deviation of the points of the ground about their plane at most [m].
Source: measured: 0.1 at most in bench/studies/planted_hazards.py, 0.24 at 99 % of the places below
conductors of real clouds (bench/hazards.py); 0.37 on the lower side of a crown (bags/demo).
"""
MOST_ERROR = 0.1
"""
Standard deviation of the plane at a place at most; beyond, the ground there was not seen [m].
Source: measured: 0.02 at 99 % of the places below conductors of
bench/studies/planted_hazards.py, 0.3 on the lower side of a crown (bags/demo).
"""
DEEPER = 1.0
"""
Places that are this much higher above ground than the lowest of their span are not measured [m].
Source: derived: more than a plane differs from the lowest points about it.
"""

Records = list[dict[str, Any]]


def find_low_conductors(
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    supports: Sequence[Support],
    rules: RuleSet,
) -> Records:
    """
    Find the spans that hang too low above the ground: one hazard a span, at its lowest place.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : sequence
        For each model (S, 3): as `measure_ground` returns.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.

    Returns
    -------
    list of dict
        Values of Hazard without its number.

    """
    limits = rules.find('ground')
    if not limits:
        return []
    worst: dict[int, dict[str, Any]] = {}
    seen = [
        keep_seen(model, stations) for model, stations in zip(models, ground_below, strict=True)
    ]
    for limit in limits:
        for model, stations in zip(models, seen, strict=True):
            if not len(stations):
                continue
            clearance = float(stations[:, 1].min()) + model.lowest_strand
            severity = limit.judge(clearance)
            known = worst.get(model.span.span_id)
            if severity is None or (known and known['clearance'] <= clearance):
                continue
            worst[model.span.span_id] = _describe_low(
                model, stations, severity, limit, supports, rules
            )
    return list(worst.values())


def measure_ground(
    points: Float64,
    height: Float32 | None,
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    reach: float,
) -> tuple[Float64, ...]:
    """
    Measure anew how high conductors hang above the ground, where that matters.

    The ground surface is of the lowest points of cells, which lie below their middles on slopes
    and by noise, and may be of a wire where the ground was not seen.  Here it is the plane
    through the points about the foot of each place, without what stands out of it upwards.  Places
    where that is not sure are left out: their ground was not seen.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float32 or None
        Above the ground surface [m].
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : sequence
        For each model (S, 2): distance from its start and height above the ground surface [m].
    reach : float
        Height above ground up to which places matter, beside the lowest of each span [m].

    Returns
    -------
    tuple of (T, 3) float64
        For each model the same with better heights, and the standard deviation of the ground [m].

    """
    result = [
        np.column_stack([own, np.full(len(own), ROUGH_SIGMA)]) for own in ground_below
    ]
    wanted = [
        own[:, 1] <= max(float(own[:, 1].min()) + DEEPER, reach) if len(own)
        else np.zeros(0, dtype=bool) for own in ground_below
    ]
    if height is None or not any(own.any() for own in wanted):
        return tuple(result)
    places = np.vstack([
        model.curve.position(model.at(own[chosen, 0])) - np.column_stack(
            [np.zeros((int(chosen.sum()), 2)), own[chosen, 1]])
        for model, own, chosen in zip(models, ground_below, wanted, strict=True)
    ])
    ground, error = find_planes(points, height, places)
    sigma = np.hypot(error, GROUND_SIGMA)
    ground[~(error <= MOST_ERROR)] = np.nan
    at = 0
    for k, chosen in enumerate(wanted):
        own = slice(at, at := at + int(chosen.sum()))
        result[k][chosen, 1] += places[own, 2] - ground[own]
        result[k][chosen, 2] = sigma[own]
        result[k] = result[k][np.isfinite(result[k][:, 1])]
    return tuple(result)


def find_planes(
    points: Float64, height: Float32, places: Float64
) -> tuple[Float64, Float64]:
    """
    Fit planes to the ground about some places.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float32
        Above the ground surface [m].
    places : (P, 3) float64
        Places about at the ground [m].

    Returns
    -------
    ground : (P,) float64
        Height of the ground [m], NaN where it was not seen.
    sigma : (P,) float64
        Its standard deviation by the scatter of the points about the plane [m].

    """
    low = _choose_low(points, height, _mark_cells(places))
    index = build_plan_index(points, np.flatnonzero(low), REACHES[0])
    start, order, origin, edge, rows, columns = index.grid
    own = take_rows(points, order)  # neighbours in space are neighbours in memory
    ground, sigma = _fit_planes(
        own, places, start, origin, edge, rows, columns, np.array(REACHES)
    )
    return ground, sigma


def keep_seen(model: SpanModel, stations: Float64) -> Float64:
    """
    Leave out the places of a span whose ground is not the ground.

    While the ground below is not seen yet, the lowest that was seen is the conductor itself, or
    what hangs below it: there the ground would touch the conductor, or step up to it.

    Parameters
    ----------
    model : SpanModel
        The span.
    stations : (S, 2+) float64
        Distance from its start, ascending, and height above ground [m].

    Returns
    -------
    (T, 2+) float64

    """
    stations = stations[stations[:, 1] + model.lowest_strand >= LEAST_GROUND]
    if not len(stations):
        return stations
    along = stations[:, 0]
    ground = model.curve.fit.height(model.at(along)) - stations[:, 1]
    # the lowest that the ground can be, coming from either side
    ahead = np.minimum.accumulate(ground - STEEPEST * along) + STEEPEST * along
    behind = np.minimum.accumulate((ground + STEEPEST * along)[::-1])[::-1] - STEEPEST * along
    result: Float64 = stations[ground <= np.minimum(ahead, behind) + STEP]
    return result


def _describe_low(
    model: SpanModel, stations: Float64, severity: Severity, limit: Limit,
    supports: Sequence[Support], rules: RuleSet,
) -> dict[str, Any]:
    along, height, ground_sigma = stations[int(np.argmin(stations[:, 1]))].tolist()
    clearance = height + model.lowest_strand
    x = float(model.at(np.array(along)))
    below = stations[:, 1] + model.lowest_strand < limit.reach
    run = model.curve.position(model.at(stations[below, 0]))
    run[:, 2] -= stations[below, 1]
    return describe_hazard(
        model, x, supports, rules, limit,
        kind=HazardKind.GROUND,
        severity=severity,
        position=model.curve.position(np.array(x))[0] - np.array([0.0, 0.0, height]),
        clearance=clearance,
        horizontal=0.0,
        vertical=clearance,
        sigma=math.hypot(model.sigma(x), ground_sigma),
        num_points=int(below.sum()),
        offending=run,
    )


def _mark_cells(places: Float64) -> tuple[Bool, float, float, float]:
    """Return the plan cells within reach of places, their lower corner and their edge [m]."""
    edge = REACHES[-1]
    x, y = (np.floor(places[:, :2].min(axis=0) / edge) * edge - edge).tolist()
    column, row = ((places[:, :2] - (x, y)) / edge).astype(np.int64).T
    marked = np.zeros((int(row.max()) + 2, int(column.max()) + 2), dtype=bool)
    for up in (-1, 0, 1):
        for right in (-1, 0, 1):
            marked[row + up, column + right] = True
    return marked, x, y, edge


def _choose_low(
    points: Float64, height: Float32, cells: tuple[Bool, float, float, float]
) -> Bool:
    """Tell the points in marked cells that may be of the ground."""
    result: Bool = _are_low(points.ravel(), height, *cells)
    return result


@njit(cache=True, parallel=True, nogil=True)
def _are_low(flat, height, marked, x0, y0, edge):  # type: ignore[no-untyped-def]
    result = np.zeros(len(height), dtype=np.bool_)
    rows, columns = marked.shape
    for i in prange(len(height)):
        if height[i] <= ABOVE_LOWEST and math.isfinite(flat[3 * i + 2]):
            column, row = (flat[3 * i] - x0) / edge, (flat[3 * i + 1] - y0) / edge
            if 0.0 <= column < columns and 0.0 <= row < rows:
                result[i] = marked[int(row), int(column)]
    return result


@njit(cache=True, parallel=True, nogil=True)
def _fit_planes(  # type: ignore[no-untyped-def]
    points, places, start, origin, edge, rows, columns, reaches
):
    """Return the (P,) heights of the ground at places, NaN where unknown, and their sigma [m]."""
    ground, sigma = np.full(len(places), np.nan), np.full(len(places), np.nan)
    for k in prange(len(places)):
        for reach in reaches:
            # the points about the foot, in its own frame
            first_row = max(math.floor((places[k, 1] - reach - origin[1]) / edge), 0)
            last_row = min(math.floor((places[k, 1] + reach - origin[1]) / edge), rows - 1)
            first = max(math.floor((places[k, 0] - reach - origin[0]) / edge), 0)
            last = min(math.floor((places[k, 0] + reach - origin[0]) / edge), columns - 1)
            most = 0
            for row in range(first_row, last_row + 1):
                if first <= last:
                    most += start[row * columns + last + 1] - start[row * columns + first]
            own, num = np.empty((most, 3)), 0
            for row in range(first_row, last_row + 1):
                if first > last:
                    break
                for i in range(start[row * columns + first], start[row * columns + last + 1]):
                    dx, dy = points[i, 0] - places[k, 0], points[i, 1] - places[k, 1]
                    if dx * dx + dy * dy <= reach * reach:
                        own[num, 0], own[num, 1] = dx, dy
                        own[num, 2] = points[i, 2] - places[k, 2]
                        num += 1
            rise, error = _fit_plane(own[:num])
            if math.isfinite(rise):
                ground[k], sigma[k] = places[k, 2] + rise, error
                break
    return ground, sigma


@njit(cache=True, nogil=True)
def _fit_plane(own):  # type: ignore[no-untyped-def]
    """Return the height at the origin of the plane through points, and its sigma; NaN if none."""
    most = np.inf
    a, b, c, rise, error, spread, before = 0.0, 0.0, 0.0, np.nan, np.nan, np.nan, -1
    for _ in range(ROUNDS):
        # places are from the foot, so moments about it lose nothing against those about the mean
        num, mx, my, mz = 0, 0.0, 0.0, 0.0
        xx, xy, yy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(len(own)):
            x, y, z = own[i, 0], own[i, 1], own[i, 2]
            if z - (a + b * x + c * y) <= most:
                num += 1
                mx, my, mz = mx + x, my + y, mz + z
                xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
                xz, yz, zz = xz + x * z, yz + y * z, zz + z * z
        if num < LEAST_POINTS:
            return np.nan, np.nan
        if num == before:
            break  # none was left out since the round before
        before = num
        mx, my, mz = mx / num, my / num, mz / num
        xx, xy, yy = xx - num * mx * mx, xy - num * mx * my, yy - num * my * my
        xz, yz, zz = xz - num * mx * mz, yz - num * my * mz, zz - num * mz * mz
        narrow = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
        if narrow <= LEAST_SPREAD * LEAST_SPREAD * num:
            return np.nan, np.nan
        det = xx * yy - xy * xy
        b, c = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
        a = mz - b * mx - c * my
        spread = math.sqrt(max(zz - b * xz - c * yz, 0.0) / (num - 3))
        leverage = 1.0 / num + (mx * mx * yy - 2.0 * mx * my * xy + my * my * xx) / det
        rise, error = a, spread * math.sqrt(leverage)
        most = ABOVE_PLANE * spread
    return (rise, error) if spread <= MOST_SPREAD else (np.nan, np.nan)
