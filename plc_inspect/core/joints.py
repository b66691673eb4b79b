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

from plc_inspect.core.curve import Curve, pack_curves
from plc_inspect.core.curve_fit import (
    COS,
    height_of,
    HIGH,
    LOW,
    ORIGIN_X,
    ORIGIN_Y,
    sigma_of,
    SIN,
    slope_of,
    to_local,
)
from plc_inspect.results import Float64, Int64

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
    rows = pack_curves(curves)
    found = _meet_all(rows, _pair_ends(rows, max_reach), max_reach)
    candidates = [
        _describe(curves, pair, (x, other_x), miss, rise)
        for *pair, x, other_x, miss, rise in found.tolist()
    ]
    candidates.sort(key=lambda joint: (joint.cost, joint.curves, joint.sides))
    used: set[tuple[int, int]] = set()
    chosen = []
    for joint in candidates:
        keys = set(zip(joint.curves, joint.sides, strict=True))
        if not keys & used:
            used |= keys
            chosen.append(joint)
    return tuple(chosen)


def _pair_ends(rows: Float64, max_reach: float) -> Int64:
    """
    Pair the ends that face each other, in plan.

    Returns
    -------
    (P, 4) int64
        Curve and side of one end, curve and side of the other.

    """
    curve = np.repeat(np.arange(len(rows)), 2)
    side = np.tile([-1, 1], len(rows))
    unit = rows[curve][:, [COS, SIN]]
    x = rows[curve, np.where(side > 0, HIGH, LOW)]
    position = rows[curve][:, [ORIGIN_X, ORIGIN_Y]] + x[:, None] * unit
    outward = side[:, None] * unit
    apart = position[None, :] - position[:, None]
    distance = np.hypot(apart[:, :, 0], apart[:, :, 1])
    facing = outward @ outward.T < -math.cos(MAX_TURN)
    ahead = np.einsum('ijk,ik->ij', apart, outward)
    across = np.abs(apart[:, :, 0] * outward[:, None, 1] - apart[:, :, 1] * outward[:, None, 0])
    near = (distance < 2 * max_reach) & (ahead > -2 * MAX_OVERLAP)
    near &= across < 3.0 + np.abs(ahead) * math.tan(MAX_TURN / 2) + 0.5
    one, other = np.nonzero(np.triu(near & facing & near.T, 1) & (curve[:, None] != curve))
    return np.stack([curve[one], side[one], curve[other], side[other]], axis=1)


def _describe(
    curves: Sequence[Curve], pair: Sequence[float], x: tuple[float, float], miss: float,
    rise: float,
) -> Joint:
    """Return the joint of a (4,) pair of ends that meet at x of both curves."""
    numbers, sides = (int(pair[0]), int(pair[2])), (int(pair[1]), int(pair[3]))
    stretch = overlap = 0.0
    places, axis = [], np.zeros(2)
    for number, side, at, sign in zip(numbers, sides, x, (-1, 1), strict=True):
        curve = curves[number]
        beyond = (at - (curve.high if side > 0 else curve.low)) * side
        stretch += max(beyond, 0.0)
        overlap += max(-beyond, 0.0)
        places.append(curve.position(at)[0])
        axis += sign * side * np.array([math.cos(curve.azimuth), math.sin(curve.azimuth)])
    return Joint(
        curves=numbers,
        sides=sides,
        x=x,
        position=(places[0] + places[1]) / 2,
        direction=math.atan2(axis[1], axis[0]),
        kink=rise,
        miss=miss,
        cost=miss + STRETCH_COST * stretch + OVERLAP_COST * overlap,
    )


@njit(cache=True, nogil=True)
def _meet_all(rows, pairs, max_reach):  # type: ignore[no-untyped-def]
    """Pairs of ends that meet: (Q, 8) pair, x of both curves, their distance, and the kink."""
    result = np.empty((len(pairs), 8))
    num = 0
    for i, side, j, other_side in pairs:
        first, second = rows[i], rows[j]
        x, other_x, miss = _approach(
            first, second, side, other_side,
            min(max_reach, 0.7 * (first[HIGH] - first[LOW]) + 2.0),
            min(max_reach, 0.7 * (second[HIGH] - second[LOW]) + 2.0),
        )
        if miss > 2 * MAX_MISS:
            continue
        slack = 3.0 * max(sigma_of(first, x), sigma_of(second, other_x))
        if miss > MAX_MISS + min(slack, MAX_MISS):
            continue
        rise = side * slope_of(first, x) + other_side * slope_of(second, other_x)
        if rise < MIN_RISE:
            continue
        result[num, 0], result[num, 1], result[num, 2], result[num, 3] = i, side, j, other_side
        result[num, 4], result[num, 5], result[num, 6], result[num, 7] = x, other_x, miss, rise
        num += 1
    return result[:num]


@njit(cache=True, nogil=True)
def _approach(row, other, side, other_side, reach, other_reach):  # type: ignore[no-untyped-def]
    """
    Where two curves, as rows, are nearest about their facing ends.

    Returned are the place along each of them and their distance there [m], inf where neither
    comes near the end of the other.
    """
    end = row[HIGH] if side > 0 else row[LOW]
    other_end = other[HIGH] if other_side > 0 else other[LOW]
    back = min(MAX_OVERLAP, (row[HIGH] - row[LOW]) / 2)
    other_back = min(MAX_OVERLAP, (other[HIGH] - other[LOW]) / 2)
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
            px, py = row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
            other_x, across = to_local(other, px, py)
            beyond = (other_x - other_end) * other_side
            if not -other_back < beyond < other_reach:
                continue
            miss = math.hypot(across, height_of(row, x) - height_of(other, other_x))
            if miss < best:
                best_x, best_other_x, best = x, other_x, miss
    return best_x, best_other_x, best
