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

"""Structures: what stands where conductors are held."""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.plan_index import gather_strip, PlanIndex
from plc_inspect.results import Bool, Float32, Float64

FILLED = 0.6
"""Share of the metres from ground to conductor that a structure's points must fill."""
COLUMN = 0.5
"""Radius of a pole's column [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Structure:
    """A pole or tower."""

    position: Float64
    """(2,) plan position of its axis [m]."""
    top: float
    """Height of its highest point [m]."""
    kind: str
    """'pole' or 'tower'."""


def find_structure(
    points: Float64,
    height: Float32,
    index: PlanIndex,
    wire: Bool,
    near: Float64,
    reach: float,
    attachment: float,
) -> Structure | None:
    """
    Find the pole or tower at a place, if its points reach from the ground to the conductor.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    height : (N,) float32
        Above local ground [m].
    index : PlanIndex
        Of the points off the ground.
    wire : (N,) bool
        Points of conductors, which do not count.
    near : float
        (2,) plan position to look at [m].
    reach : float
        How far from there its axis may be [m].
    attachment : float
        Height of the lowest conductor there above the ground [m].

    """
    found = gather_strip(
        index.start,
        index.order,
        index.origin,
        index.cell_size,
        index.shape[0],
        index.shape[1],
        near[0],
        near[1],
        near[0],
        near[1],
        reach + COLUMN,
    )
    found = found[~wire[found] & (height[found] > 1.0)]
    apart = points[found, :2] - near
    inside = np.hypot(apart[:, 0], apart[:, 1]) <= reach + COLUMN
    found, apart = found[inside], apart[inside]
    needed = max(int(attachment) - 2, 3)
    if len(found) < needed:
        return None
    level = height[found].astype(np.int64)
    column = _best_column(apart, level, needed, reach)
    if column is not None:
        own = np.hypot(*(apart - column).T) <= COLUMN
        return Structure(
            position=near + column, top=float(points[found[own], 2].max()), kind='pole'
        )
    filled = len(np.unique(level[(level >= 1) & (level <= needed)])) / needed
    if filled < FILLED:
        return None
    body = level >= needed // 3
    if body.sum() < 5:
        return None
    low, high = np.percentile(apart[body], [5, 95], axis=0)
    return Structure(
        position=near + (low + high) / 2, top=float(points[found, 2].max()), kind='tower'
    )


def _best_column(
    apart: Float64, level: np.ndarray, needed: int, reach: float
) -> Float64 | None:
    """Axis of the column that fills most levels, if it stands free in most of them."""
    cells = np.floor(apart / COLUMN).astype(np.int64)
    low = cells.min(axis=0)
    cell = (cells[:, 0] - low[0]) * (np.ptp(cells[:, 1]) + 1) + cells[:, 1] - low[1]
    best, best_filled = _fullest(apart, level, cell, needed, reach)
    if best_filled < FILLED * needed:
        return None
    distance = np.hypot(*(apart - best).T)
    free = 0
    levels = range(1, needed + 1)
    for step in levels:
        at = level == step
        inner = int((at & (distance <= COLUMN)).sum())
        outer = int((at & (distance > COLUMN) & (distance <= 3 * COLUMN)).sum())
        free += inner > 0 and outer <= inner
    if free < 0.5 * needed:
        return None
    own = distance <= COLUMN
    axis: Float64 = np.median(apart[own], axis=0)
    return axis


@njit(cache=True, nogil=True)
def _fullest(apart, level, cell, needed, reach):  # type: ignore[no-untyped-def]
    """Centre of the points of the cell about which most levels hold some, and how many do."""
    best, best_filled = np.zeros(2), 0
    order = np.argsort(cell, kind='mergesort')
    first = 0
    while first < len(order):
        last = first
        while last < len(order) and cell[order[last]] == cell[order[first]]:
            last += 1
        own = apart[order[first:last]]
        x, y = np.median(own[:, 0]), np.median(own[:, 1])
        first = last
        if math.hypot(x, y) > reach:
            continue
        filled = np.zeros(needed + 1, dtype=np.bool_)
        for k in range(len(apart)):
            if level[k] <= needed and math.hypot(apart[k, 0] - x, apart[k, 1] - y) <= COLUMN:
                filled[level[k]] = True
        if filled.sum() > best_filled:
            best, best_filled = np.array([x, y]), filled.sum()
    return best, best_filled
