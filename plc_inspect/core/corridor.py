# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Extracts the power line corridor (PLC), paper Eq. 9."""

from collections.abc import Sequence
from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.config import CorridorSettings
from plc_inspect.core.catenary.curve import pack_curves
from plc_inspect.core.catenary.curve_row import height_of, to_local
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.numerics.arrays import find_true, take_found, take_rows
from plc_inspect.core.spans.span_model import SpanModel, tabulate
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64

MIN_RADIUS = 0.6
"""Least search radius [m].  Source: paper, Table 1, the initial value of r."""
MAX_PROBES = 100_000
"""Points by which radii are chosen, at most about.  Source: numerical: bounds the time."""
LEAST_OVERHEAD = 3
"""
Points above a span's lowest place, and LEAST_FALL above ground, that call for Eq. 9's first case.
Source: judgement; not measured.
"""
LEAST_FALL = 2.0
"""
Height above ground up to which nothing falls onto a conductor [m].
Source: judgement; not measured.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CorridorResult:
    """The corridor of C spans among N points."""

    points: Int64
    """(K,) indices of the points of the corridor, ascending."""
    distance: Float32
    """(K,) distance to the nearest span [m]."""
    span: Int32
    """(K,) index of that span."""
    radius: Float64
    """(C,) search radius of each span [m]."""
    complex_case: Bool
    """(C,) True where the first case of Eq. 9 was used."""
    near: Int64
    """(J,) indices of all points within the search reach, ascending; the corridor among them."""
    near_distance: Float32
    """(J,) distance to the nearest span [m]."""
    near_span: Int32
    """(J,) index of that span."""


def extract_corridor(
    points: Float64,
    height: Float32,
    wire: Bool,
    models: Sequence[SpanModel],
    settings: CorridorSettings,
    least_reach: float = 0.0,
    probes: Int64 | None = None,
) -> CorridorResult:
    """
    Find the points within the search radius of each span, and their distance to it.

    Where something nearby stands higher than the span's lowest point, its radius is the first case
    of Eq. 9: the greatest distance, within the vertical plane or from it, of the points that are
    higher above ground than far from the plane and so could fall onto it.  In open country it is
    the height of the lowest point above ground.  Distances are to the curve, not to its points.
    O(N), with a plan grid in place of the paper's Kd-tree.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    height : (N,) float32
        Above local ground [m].
    wire : (N,) bool
        Points of conductors.
    models : sequence of SpanModel
        C spans with their curves.
    settings : CorridorSettings
        Settings of this stage.
    least_reach : float
        Search at least this far for clearance rules, whatever the radius [m].
    probes : (P,) int64 or None
        Points by which radii are chosen, by default evenly chosen.

    Returns
    -------
    CorridorResult

    """
    num = len(models)
    if num == 0 or len(points) == 0:
        return CorridorResult(
            points=np.zeros(0, dtype=np.int64),
            distance=np.zeros(0, dtype=np.float32),
            span=np.zeros(0, dtype=np.int32),
            radius=np.zeros(num),
            complex_case=np.zeros(num, dtype=bool),
            near=np.zeros(0, dtype=np.int64),
            near_distance=np.zeros(0, dtype=np.float32),
            near_span=np.zeros(0, dtype=np.int32),
        )
    table = tabulate(models)
    radius = np.full(num, float(settings.radius or settings.max_radius))
    complex_case = np.zeros(num, dtype=bool)
    if settings.radius == 0.0:
        if probes is None:
            probes = np.arange(0, len(points), choose_step(len(points)))
        probes = probes[~wire[probes]]
        at, above = take_rows(points, probes), height[probes]
        found, _, span = find_near(at, table, radius)
        lowest = np.array([
            model.curve.fit.height(model.curve.fit.lowest(model.low, model.high))
            for model in models
        ])
        ground, overhead, fall = _look_around(
            at, above, found, span, pack_curves([model.curve for model in models]), lowest
        )
        radius, complex_case = _choose_radii(lowest - ground, overhead, fall, settings)
    found, distance, span = find_near(points, table, np.maximum(radius, least_reach))
    inside = found, distance, span
    if least_reach > 0.0:
        inside = take_found(
            find_true(_are_inside(distance, span, radius)), found, distance, span
        )
    return CorridorResult(
        points=inside[0],
        distance=inside[1],
        span=inside[2],
        radius=radius,
        complex_case=complex_case,
        near=found,
        near_distance=distance,
        near_span=span,
    )


def choose_step(num_points: int) -> int:
    """Return the step from probe to probe in a cloud of so many points."""
    return max(num_points // MAX_PROBES, 1)


@njit(cache=True, nogil=True)
def _are_inside(distance, span, radius):  # type: ignore[no-untyped-def]
    """Tell the points within the radius of their span."""
    result = np.empty(len(distance), dtype=np.bool_)
    for k in range(len(distance)):
        result[k] = distance[k] <= radius[span[k]]
    return result


def _choose_radii(
    sag_height: Float64, overhead: Int64, fall: Float64, settings: CorridorSettings
) -> tuple[Float64, Bool]:
    """Return the search radii by Eq. 9, and where its first case was used."""
    is_complex = np.full(len(fall), settings.environment == 'complex')
    if settings.environment == 'auto':
        is_complex = overhead >= LEAST_OVERHEAD
    radius = np.where(is_complex & np.isfinite(fall), fall, sag_height)
    return np.clip(radius, MIN_RADIUS, settings.max_radius), is_complex


@njit(cache=True, nogil=True, error_model='numpy')
def _look_around(points, height, found, span, rows, lowest):  # type: ignore[no-untyped-def]
    """
    Measure the ground near each span, and the points that could fall onto it.

    Returns the median height of the ground, -inf where it is unknown; and of the points more than
    LEAST_FALL above ground, the number above the span's lowest point, and the greatest distance,
    within the vertical plane or from it, of those higher above ground than far from the plane,
    -inf without any.
    """
    num = len(rows)
    count = np.zeros(num, dtype=np.int64)
    overhead = np.zeros(num, dtype=np.int64)
    fall = np.full(num, -np.inf)
    below = np.empty(len(found))
    start = np.zeros(num + 1, dtype=np.int64)
    for k in range(len(found)):
        start[span[k] + 1] += np.isfinite(height[found[k]])
    for s in range(num):
        start[s + 1] += start[s]
    for k in range(len(found)):
        i, s = found[k], span[k]
        z, above = points[i, 2], height[i]
        if np.isfinite(above):
            below[start[s] + count[s]] = z - above
            count[s] += 1
        if above > LEAST_FALL:
            overhead[s] += z > lowest[s]
            x, y = to_local(rows[s], points[i, 0], points[i, 1])
            if above > abs(y):
                fall[s] = max(fall[s], abs(z - height_of(rows[s], x)), abs(y))
    ground = np.full(num, -np.inf)
    for s in range(num):
        if count[s]:
            ground[s] = np.median(below[start[s] : start[s + 1]])
    return ground, overhead, fall
