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

"""Joints: where the curves of two neighbouring spans of a conductor meet at a support."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.curve import Curve
from plc_inspect.core.nearest import height_of, span_table
from plc_inspect.results import Float64

MAX_TURN = math.radians(65.0)
"""Sharpest angle of a line at a support."""
MAX_MISS = 0.5
"""Greatest distance of the two curves where they are nearest; insulators fill it [m]."""
MIN_RISE = 0.008
"""Least kink at a support: half the lengths of both spans over c is more [-]."""
STRETCH_COST = 0.02
OVERLAP_COST = 0.1
"""A metre of extrapolation, or of running on beyond the joint, weighs as this much miss."""
MAX_OVERLAP = 8.0
"""How far a curve may run on beyond its support [m]."""
COARSE_STEP, FINE_STEP = 0.25, 0.02
"""Steps in which the nearest places of two curves are looked for [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """Two ends of curves that meet at one attachment."""

    curves: tuple[int, int]
    sides: tuple[int, int]
    """+1 where the curve's high end meets, -1 its low end."""
    x: tuple[float, float]
    """Position of the joint along each of the curves [m]."""
    position: Float64
    """(3,) [m]"""
    direction: float
    """Azimuth of the line at the joint, half way between both curves, modulo pi [rad]."""
    kink: float
    """Sum of the two rises towards the joint."""
    miss: float
    """Distance of the curves at the joint [m]."""
    cost: float


def find_joints(curves: Sequence[Curve], max_reach: float) -> tuple[Joint, ...]:
    """
    Pair the ends of curves that meet at a support, each end at most once.

    Two ends meet where the extrapolated curves come within ``MAX_MISS`` of each other, both
    rising towards the place taken together, as conductors hanging from a support do.

    Parameters
    ----------
    curves : sequence of Curve
        Curves, each within one span.
    max_reach : float
        Longest extrapolation from either end [m].

    Returns
    -------
    tuple of Joint, in order of cost

    """
    if len(curves) < 2:
        return ()
    ends = [
        (
            number,
            side,
            curve.position(curve.high if side > 0 else curve.low)[0],
            _outward(curve, side),
        )
        for number, curve in enumerate(curves)
        for side in (-1, 1)
    ]
    position = np.array([end[2] for end in ends])
    outward = np.array([end[3] for end in ends])
    apart = position[None, :, :2] - position[:, None, :2]
    distance = np.linalg.norm(apart, axis=2)
    facing = outward @ outward.T < -math.cos(MAX_TURN)
    ahead = np.einsum('ijk,ik->ij', apart, outward)
    across = np.abs(apart[:, :, 0] * outward[:, None, 1] - apart[:, :, 1] * outward[:, None, 0])
    near = (distance < 2 * max_reach) & (ahead > -2 * MAX_OVERLAP)
    near &= across < 3.0 + np.abs(ahead) * math.tan(MAX_TURN / 2) + 0.5
    table = span_table(curves, *np.array([(curve.low, curve.high) for curve in curves]).T)
    candidates = []
    for i, j in np.argwhere(np.triu(near & facing & near.T, 1)):
        first, second = ends[i], ends[j]
        if first[0] == second[0]:
            continue
        joint = _meet(
            curves, table, (first[0], second[0]), (first[1], second[1]), max_reach
        )
        if joint is not None:
            candidates.append(joint)
    candidates.sort(key=lambda joint: (joint.cost, joint.curves, joint.sides))
    used: set[tuple[int, int]] = set()
    chosen = []
    for joint in candidates:
        keys = set(zip(joint.curves, joint.sides, strict=True))
        if not keys & used:
            used |= keys
            chosen.append(joint)
    return tuple(chosen)


def _outward(curve: Curve, side: int) -> Float64:
    return side * np.array([math.cos(curve.azimuth), math.sin(curve.azimuth)])


def _meet(
    curves: Sequence[Curve], table: Float64, pair: tuple[int, int], sides: tuple[int, int],
    max_reach: float,
) -> Joint | None:
    """Closest approach of two curves near their facing ends."""
    first, second = curves[pair[0]], curves[pair[1]]
    x, other_x, miss = _approach(
        table[pair[0]], table[pair[1]], sides[0], sides[1],
        min(max_reach, 0.7 * first.length + 2.0), min(max_reach, 0.7 * second.length + 2.0),
    )
    if miss > 2 * MAX_MISS:
        return None
    slack = 3 * max(
        float(first.prediction_sigma(np.array([x]))[0]),
        float(second.prediction_sigma(np.array([other_x]))[0]),
    )
    if miss > MAX_MISS + min(slack, MAX_MISS):
        return None
    rise = sides[0] * float(first.fit.slope(x)) + sides[1] * float(second.fit.slope(other_x))
    if rise < MIN_RISE:
        return None
    here = (first.position(x)[0] + second.position(other_x)[0]) / 2
    beyond = (x - (first.high if sides[0] > 0 else first.low)) * sides[0]
    other_beyond = (other_x - (second.high if sides[1] > 0 else second.low)) * sides[1]
    stretch = max(beyond, 0.0) + max(other_beyond, 0.0)
    overlap = max(-beyond, 0.0) + max(-other_beyond, 0.0)
    axis = _outward(second, sides[1]) - _outward(first, sides[0])
    return Joint(
        curves=pair,
        sides=sides,
        x=(x, other_x),
        position=here,
        direction=math.atan2(axis[1], axis[0]),
        kink=rise,
        miss=miss,
        cost=miss + STRETCH_COST * stretch + OVERLAP_COST * overlap,
    )


@njit(cache=True, nogil=True)
def _approach(row, other, side, other_side, reach, other_reach):  # type: ignore[no-untyped-def]
    """
    Where two curves, as rows of span_table, are nearest about their facing ends.

    Returned are the place along each of them and their distance there [m], inf where neither
    comes near the end of the other.
    """
    end = row[9] if side > 0 else row[8]
    other_end = other[9] if other_side > 0 else other[8]
    back = min(MAX_OVERLAP, (row[9] - row[8]) / 2)
    other_back = min(MAX_OVERLAP, (other[9] - other[8]) / 2)
    best_x, best_other_x, best = end, other_end, np.inf
    for fine in range(2):
        if fine == 0:
            first, step = end - side * back, COARSE_STEP * side
            num = math.ceil((reach + back) / COARSE_STEP)
        else:
            if best == np.inf:
                break
            first, step = best_x - COARSE_STEP, FINE_STEP
            num = math.ceil(2 * COARSE_STEP / FINE_STEP) + 1
            best = np.inf
        for k in range(num):
            x = first + k * step
            px, py = row[0] + row[2] * x, row[1] + row[3] * x
            dx, dy = px - other[0], py - other[1]
            other_x, across = other[2] * dx + other[3] * dy, other[2] * dy - other[3] * dx
            beyond = (other_x - other_end) * other_side
            if not -other_back < beyond < other_reach:
                continue
            miss = math.hypot(across, height_of(row, x) - height_of(other, other_x))
            if miss < best:
                best_x, best_other_x, best = x, other_x, miss
    return best_x, best_other_x, best
