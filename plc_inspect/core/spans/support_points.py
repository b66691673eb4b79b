# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Points that belong to a support: its structure, and what goes on beyond the conductors' ends."""

import math

from numba import njit
import numpy as np

from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.extraction.structures import COLUMN, MAX_BELOW
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.results import Bool, Float64, Int64

POLE_SLICE, TOWER_SLICE = (0.8, 0.8), (2.0, 2.0)
"""
Half thickness along the line, and reach beyond the attachments across it, of supports [m].
Source: judgement; holds at half and twice on bench/constants.py.
"""
UNSEEN_SLICE = (2.0, 0.8)
"""
The same where no structure was recognised: nothing shows arms that reach beyond the ends [m].
Source: chosen on bench/frames.py and bench/studies/planted_hazards.py; with 0.8 along the line
oakland_part3_ao falls by 0.004, with 2.0 across it a crown was taken for the support.
"""
SLICES = {'pole': POLE_SLICE, 'tower': TOWER_SLICE, None: UNSEEN_SLICE}
"""The three.  Source: derived: those above."""
HOLD_RADIUS = 5.0
"""
Within this of a conductor's end insulators and arms leave points [m].
Source: derived: a string of insulators for 400 kV is up to 5 m long, and of sparse surveys only
the arm above it has points; 6 m holds, 2.1 m does not, on bench/constants.py.
"""
HOLD_POINTS = 3
"""This many points within HOLD_RADIUS of a conductor's end hold it.
Source: judgement; 1 point holds, 5 points do not, on bench/constants.py."""
ARM_REACH, ARM_GAP = 12.0, 1.0
"""
How far beyond the conductors that were found the arms of a support may reach, and the gap at
which they end [m].
Source: judgement; the widest towers of one level are 20 to 25 m wide, sparse surveys meet an arm
each metre.
"""
BEYOND = 5.0
"""The cloud must go on this far beyond a conductor that ends at a support [m].
Source: judgement; holds from 2.5 to 10 on bench/constants.py."""
BODY_REACH, BODY_POINTS, BODY_ROOM = 4.0, 5, 0.3
"""
Distance from the middle of ends within which what holds them is looked for, its points beyond
them, at least, how far beside the outermost ones they may and beyond all they must be [m].
Source: derived: as supports.MANY_REACH, structures.LEAST_BODY and structures.COLUMN.
"""
MOST_ABOUT = 0.1
"""
Share of a tower's points that there may be farther along the line than its half thickness.
Source: judgement; a crown of 3 m that stands in the middle has 0.2.
"""
SURE_GAPS = 3.0
"""
Gaps between points of conductors by which what holds them must be seen beyond their ends.
Source: derived: of conductors that go on, a gap so long is left by a chance of 5 %.
"""
GUY_SPREAD, GUY_HALF, GUY_NEAR = 1.2, 0.5, 1.5
"""
A guy leans by at most this many metres a metre, ends at the upper half of a pole, and is looked
for within so much of its axis [m].
Source: judgement: guys lean by 30 to 45 degrees, seldom by 50.
"""
GUY_WIDTH, GUY_ROOM, GUY_SHARE = 0.15, 0.45, 0.6
"""
The points of a guy lie so near to one straight line, and are this share of those within GUY_ROOM
of it at least [m].
Source: judgement: five standard deviations of 3 cm; in a crown one point in nine is so near.
"""
GUY_FILLED, GUY_LEAST = 0.7, 3
"""
Share of the metres up to the pole that a guy fills, and their number, at least.
Source: judgement; no twigs lie on a straight line from the ground to a pole.
"""
GUY_STEP, MOST_SEEDS = 0.25, 200
"""
Step of where guys pass and end at a pole [m], and cells so wide about its axis that are filled at
most: in more nothing could be free.
Source: measured: poles with guys of 45 random scenes have 6 to 18, those of three real clouds 17
to 138, and such in crowns 278 and 440; time goes with their number.
"""
STUB_LENGTH, STUB_RADIUS = 2.5, 0.35
"""
What lies in line beyond the end of a conductor goes on with it: jumpers, the next span [m].
Source: judgement; STUB_LENGTH holds from 1.25 to 5, STUB_RADIUS holds from 0.175 to 0.7 on
bench/constants.py.
"""


def list_structure(
    points: Float64,
    index: PlanIndex,
    wire: Bool,
    place: Float64,
    azimuth: float,
    attachments: Float64,
    kind: str | None,
) -> Int64:
    """
    List the points of a structure: a slice across the line as wide as the attachments.

    The slice is thin, so that a tree beside a support reaches out of it and stays a hazard.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Of the points off the ground.
    wire : (N,) bool
        Points of conductors.
    place : (2,) float64
        Where the support stands in plan [m].
    azimuth : float
        Direction of the line there [rad].
    attachments : (K, 3) float64
        Where conductors end at it [m].
    kind : str or None
        'tower', 'pole', or None where no structure was recognised.

    Returns
    -------
    (J,) int64
        With the points of conductors in it.

    """
    along_arm, beside = SLICES[kind]
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    left = np.array([-unit[1], unit[0]])
    half = float(np.abs((attachments[:, :2] - place) @ left).max()) + beside
    reach = math.hypot(half, along_arm)
    found = index.strip(place, place, reach if kind == 'pole' else half + ARM_REACH)
    apart = points[found, :2] - place
    along, across = apart @ unit, apart @ left
    inside = (np.abs(along) <= along_arm) & (np.abs(across) <= half)
    high = ~wire[found] & (points[found, 2] >= attachments[:, 2].min() - MAX_BELOW)
    high &= np.abs(along) <= BODY_REACH
    held = high & inside
    if kind != 'pole' and held.any():
        for side in (-1.0, 1.0):
            arm = high & (side * across > half)
            beyond = side * across[arm] - (side * across[held]).max()
            inside[arm] |= _are_of_arm(along[arm], beyond)
    result: Int64 = found[inside]
    return result


def _are_of_arm(along: Float64, beyond: Float64) -> Bool:
    """
    Tell the points of an arm that reaches beyond the conductors that were found.

    It goes on without gaps and is as thin along the line as a tower; a crown is not.  Given are
    points (N,) along the line from the middle of the support, and how far beyond its own [m].
    """
    order = np.argsort(beyond)
    gaps = np.flatnonzero(np.diff(beyond[order], prepend=0.0) > ARM_GAP)
    own = np.zeros(len(beyond), dtype=bool)
    own[order[: gaps[0] if len(gaps) else None]] = True
    thin = np.abs(along) <= TOWER_SLICE[0]
    if (own & ~thin).sum() > MOST_ABOUT * (own & thin).sum():
        return np.zeros(len(beyond), dtype=bool)
    return own & thin


def mark_stub(
    points: Float64, index: PlanIndex, end: Float64, outward: Float64, mask: Bool
) -> None:
    """
    Mark what goes on beyond the end of a conductor.

    Parameters
    ----------
    points, index
        As of `list_structure`.
    end : (3,) float64
        End of the conductor [m].
    outward : (2,) float64
        Unit vector in plan that leads away from it.
    mask : (N,) bool
        Points of supports; those found are set.

    """
    tip = end[:2] + STUB_LENGTH * outward
    _mark_stub(points, index.strip(end, tip, STUB_RADIUS), end, outward, mask)


@njit(cache=True, nogil=True)
def _mark_stub(points, found, end, outward, mask):  # type: ignore[no-untyped-def]
    for i in found:
        dx, dy, dz = points[i, 0] - end[0], points[i, 1] - end[1], points[i, 2] - end[2]
        along, across = dx * outward[0] + dy * outward[1], dy * outward[0] - dx * outward[1]
        if 0.0 < along <= STUB_LENGTH and math.hypot(across, dz) <= STUB_RADIUS:
            mask[i] = True


def mark_guys(cloud: OffGround, wire: Bool, foot: Float64, top: float, mask: Bool) -> None:
    """
    Mark the guys of a pole: straight thin lines from near the ground up to its upper half.

    Parameters
    ----------
    cloud, wire
        As of `goes_on`.
    foot : (3,) float64
        Of the pole [m].
    top : float
        Height of its top [m].
    mask : (N,) bool
        Points of supports; those found are set.

    """
    height = top - foot[2]
    found = cloud.index.strip(foot, foot, GUY_SPREAD * height)
    found = found[~wire[found]]
    apart = cloud.points[found] - foot
    far = np.hypot(apart[:, 0], apart[:, 1])
    beside = (far > COLUMN) & (far < GUY_SPREAD * (height - apart[:, 2]) + GUY_ROOM)
    found, apart, far = found[beside], apart[beside], far[beside]
    low = math.ceil(max(cloud.least, 0.0))
    seeds = apart[(far < GUY_NEAR) & (apart[:, 2] > low)]
    _, first = np.unique(np.floor(seeds / GUY_STEP), axis=0, return_index=True)
    if len(first) <= MOST_SEEDS:
        mask[found[_mark_guys(apart, seeds[first], height, low)]] = True


@njit(cache=True, nogil=True, error_model='numpy')
def _mark_guys(apart, seeds, height, low):  # type: ignore[no-untyped-def]
    """Tell which places about a foot are of a line from the pole past a seed down to a height."""
    result = np.zeros(len(apart), dtype=np.bool_)
    plane, place = np.empty((len(apart), 3)), np.empty(len(apart), dtype=np.int64)
    for seed in seeds:
        far = math.hypot(seed[0], seed[1])
        x, y, count = seed[0] / far, seed[1] / far, 0
        for i in range(len(apart)):
            across = apart[i, 1] * x - apart[i, 0] * y
            along = apart[i, 0] * x + apart[i, 1] * y
            if abs(across) <= GUY_ROOM and along > 0.0 and apart[i, 2] >= low:
                plane[count] = along, across, apart[i, 2]
                place[count] = i
                count += 1
        best, end = np.empty(0, dtype=np.int64), height
        while end > max(seed[2] + GUY_STEP, GUY_HALF * height):
            own = _list_guy(plane[:count], far / (end - seed[2]), end, low)
            if len(own) > len(best):
                best = own
            end -= GUY_STEP
        result[place[best]] = True
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _list_guy(plane, lean, end, low):  # type: ignore[no-untyped-def]
    """
    List the places of a guy with a lean, from its end down; none where there is none.

    Places (N, 3) are along and across the plane of the guy and above the foot of its pole [m].
    """
    own = np.empty(len(plane), dtype=np.int64)
    if lean > GUY_SPREAD:
        return own[:0]
    top = max(int(end - COLUMN / lean), low)
    filled = np.zeros(int(end) + 1, dtype=np.bool_)
    num = near = 0
    for k in range(len(plane)):
        along, across, up = plane[k]
        if up >= end:  # above the guy
            continue
        off = (along - lean * (end - up)) / math.sqrt(1.0 + lean**2)
        distance = math.hypot(off, across)
        near += distance <= GUY_ROOM
        if distance <= GUY_WIDTH:
            filled[int(up)] = True
            own[num] = k
            num += 1
    full = filled[low:top].sum()
    is_guy = full >= max(GUY_FILLED * (top - low), GUY_LEAST) and num >= GUY_SHARE * near
    return own[: num if is_guy else 0]


def are_held(points: Float64, index: PlanIndex, wire: Bool, ends: Float64) -> bool:
    """
    Tell whether arms or insulators left points about most ends of conductors.

    Parameters
    ----------
    points, index
        As of `list_structure`.
    wire : (N,) bool
        Points of conductors.
    ends : (K, 3) float64
        Ends of conductors [m].

    Returns
    -------
    bool

    """
    counts = [
        _count_around(points, wire, index.strip(end, end, HOLD_RADIUS), end) for end in ends
    ]
    return 2 * sum(count >= HOLD_POINTS for count in counts) >= len(ends)


def goes_on(
    cloud: OffGround, wire: Bool, places: Float64, outward: Float64, gap: float
) -> bool:
    """
    Tell whether a cloud goes on beyond ends of conductors, which thus do not just leave it.

    It does where ground was seen beyond all of them, or something that stands there.  A tower at
    the border of a cloud is seen from both sides, a crown that was cut with the conductors ends
    where they do.

    Parameters
    ----------
    cloud : OffGround
        Points off the ground.
    wire : (N,) bool
        Points of conductors.
    places : (K, 3) float64
        Ends of conductors [m].
    outward : (K, 2) float64
        Unit vectors in plan that lead away from them.
    gap : float
        How far the last points of the conductors are before their end, in the mean [m].

    Returns
    -------
    bool

    """
    ground = cloud.height.ground
    ahead = places[:, :2] + BEYOND * outward
    if ground.holds(ahead) and np.isfinite(ground.at(ahead, max_gap=0.5 * BEYOND)).all():
        return True
    return _stands_out(cloud, wire, places, outward, gap)


def _stands_out(
    cloud: OffGround, wire: Bool, places: Float64, outward: Float64, gap: float
) -> bool:
    """Tell whether something as thin along the line as a tower was seen beyond all ends."""
    unit = find_mean_direction(outward)
    left = np.array([-unit[1], unit[0]])
    middle, across = places[:, :2].mean(axis=0), places[:, :2] @ left
    found = cloud.index.strip(middle, middle, BODY_REACH)
    found = found[~wire[found] & (cloud.points[found, 2] >= places[:, 2].min() - HOLD_RADIUS)]
    stub = np.zeros(len(cloud.points), dtype=bool)
    for place, way in zip(places, outward, strict=True):
        mark_stub(cloud.points, cloud.index, place, way, stub)
    found = found[~stub[found]]
    beside = cloud.points[found, :2] @ left
    between = (beside >= across.min() - BODY_ROOM) & (beside <= across.max() + BODY_ROOM)
    along = (cloud.points[found[between], :2] - middle) @ unit
    body = np.abs(along) <= TOWER_SLICE[0]
    farthest = float(((places[:, :2] - middle) @ unit).max())
    beyond = along > farthest + max(SURE_GAPS * gap, BODY_ROOM)
    return bool(
        (body & beyond).sum() >= BODY_POINTS and (~body).sum() <= MOST_ABOUT * body.sum()
    )


def find_mean_direction(outward: Float64) -> Float64:
    """Return the (2,) mean of unit vectors (K, 2) in plan."""
    mean: Float64 = outward.mean(axis=0)
    return mean / np.linalg.norm(mean)


@njit(cache=True, nogil=True)
def _count_around(points, wire, found, end):  # type: ignore[no-untyped-def]
    """How many of the points found are within HOLD_RADIUS of the end and no conductor's."""
    count = 0
    for i in found:
        apart = (points[i, 0] - end[0]) ** 2 + (points[i, 1] - end[1]) ** 2
        apart += (points[i, 2] - end[2]) ** 2
        count += apart <= HOLD_RADIUS**2 and not wire[i]
    return count
