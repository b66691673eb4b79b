# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Extraction of the power line corridor (PLC), paper Eq. 9."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit, prange
import numpy as np

from plc_inspect.config import CorridorSettings
from plc_inspect.core.curve import Curve
from plc_inspect.core.nearest import find_near, span_table
from plc_inspect.core.picking import NUM_PARTS
from plc_inspect.results import Bool, Float32, Float64, Int32, Int64

MIN_RADIUS = 0.6
"""Least search radius, the initial value of Table 1 [m]."""
MAX_PROBES = 100_000
"""Points that are enough to choose the radii by."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CorridorResult:
    """The corridor of C spans among N points."""

    points: Int64
    """(K,) indices of the points of the corridor, ascending."""
    distance: Float32
    """(K,) distance to the nearest span [m]."""
    span: Int32
    """(K,) which span that is."""
    radius: Float64
    """(C,) search radius of each span [m]."""
    complex_case: Bool
    """(C,) True where the first case of Eq. 9 was used."""
    near: Int64
    """(J,) indices of all points within the search reach, ascending; the corridor among them."""
    near_distance: Float32
    """(J,) distance to the nearest span [m]."""
    near_span: Int32
    """(J,) which span that is."""


def extract_corridor(
    points: Float64,
    height: Float32,
    wire: Bool,
    curves: Sequence[Curve],
    start_x: Float64,
    end_x: Float64,
    settings: CorridorSettings,
    least_reach: float = 0.0,
) -> CorridorResult:
    """
    Find the points within the search radius of each span, and their distance to it.

    The radius of a span is the first case of Eq. 9 where something near it stands higher than
    its lowest point: the greatest distance, in the vertical plane or from it, of the points that
    are higher above ground than they are far from the plane and so could fall onto it.  In open
    country it is the height of the lowest point above ground.  Distances are to the curve itself,
    not to its points.  O(N) with a plan grid in place of the paper's Kd-tree.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    height : (N,) float32
        Above local ground [m].
    wire : (N,) bool
        Points of conductors.
    curves, start_x, end_x : sequence of Curve, (C,) float64, (C,) float64
        Curves and the x of their ends [m].
    settings : CorridorSettings
        Settings of this stage.
    least_reach : float
        Search at least this far, whatever the radius, for clearance rules [m].

    Returns
    -------
    CorridorResult

    """
    num = len(curves)
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
    table = span_table(curves, start_x, end_x)
    radius = np.full(num, settings.radius or settings.max_radius)
    complex_case = np.zeros(num, dtype=bool)
    if settings.radius == 0.0:
        probes = np.arange(0, len(points), max(len(points) // MAX_PROBES, 1))
        probes = probes[~wire[probes]]
        found, _, span = find_near(points[probes], table, radius)
        found = probes[found]
        order = np.argsort(span, kind='stable')
        bounds = np.searchsorted(span[order], np.arange(num + 1))
        for number in range(num):
            own = found[order[bounds[number] : bounds[number + 1]]]
            radius[number], complex_case[number] = _radius(
                points[own],
                height[own],
                curves[number],
                start_x[number],
                end_x[number],
                settings,
            )
    found, distance, span = find_near(points, table, np.maximum(radius, least_reach))
    inside = found, distance, span
    if least_reach > 0.0:
        inside = _keep_inside(found, distance, span, radius)
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


@njit(cache=True, parallel=True, nogil=True)
def _keep_inside(found, distance, span, radius):  # type: ignore[no-untyped-def]
    """Return the points within the radius of their span, with distance and span."""
    num = len(found)
    start = np.zeros(NUM_PARTS + 1, dtype=np.int64)
    for part in prange(NUM_PARTS):
        total = 0
        for k in range(part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS):
            total += distance[k] <= radius[span[k]]
        start[part + 1] = total
    for part in range(NUM_PARTS):
        start[part + 1] += start[part]
    own = np.empty(start[NUM_PARTS], dtype=np.int64)
    own_distance = np.empty(start[NUM_PARTS], dtype=np.float32)
    own_span = np.empty(start[NUM_PARTS], dtype=np.int32)
    for part in prange(NUM_PARTS):
        place = start[part]
        for k in range(part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS):
            if distance[k] <= radius[span[k]]:
                own[place], own_distance[place], own_span[place] = found[k], distance[k], span[k]
                place += 1
    return own, own_distance, own_span


def _radius(
    points: Float64,
    height: Float32,
    curve: Curve,
    start: float,
    end: float,
    settings: CorridorSettings,
) -> tuple[float, bool]:
    """Search radius by Eq. 9 from points near a span, and whether its first case was used."""
    lowest = float(curve.fit.height(curve.fit.lowest(start, end)))
    known = np.isfinite(height)
    ground = float(np.median(points[known, 2] - height[known])) if known.any() else -math.inf
    sag_height = lowest - ground
    open_radius = min(max(sag_height, MIN_RADIUS), settings.max_radius)
    overhead = (points[:, 2] > lowest) & (height > 2.0)
    is_complex = settings.environment == 'complex' or (
        settings.environment == 'auto' and int(overhead.sum()) >= 3
    )
    if not is_complex:
        return open_radius, False
    x, y = curve.local(points)
    across = np.abs(y)
    vertical = np.abs(points[:, 2] - curve.fit.height(x))
    falls = (height > across) & (height > 2.0)
    if not falls.any():
        return open_radius, True
    radius = float(np.maximum(vertical, across)[falls].max())
    return min(max(radius, MIN_RADIUS), settings.max_radius), True
