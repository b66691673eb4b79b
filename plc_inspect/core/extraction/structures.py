# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Structures: what stands where conductors are held."""

from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.results import Bool, Float32, Float64, Int64

MAX_BELOW = 0.7
"""The top of a support lies at most this far below the lowest conductor it holds [m].
Source: judgement; holds from 0.35 to 1.4 on bench/constants.py."""
FILLED = 0.6
"""
Share of the metres from ground to conductor that a structure's points must fill.
Source: judgement; holds from 0.3 to 0.84 on bench/constants.py.
"""
COLUMN = 0.3
"""
Radius of a pole's column [m].
Source: judgement; holds from 0.15 to 0.42 on bench/constants.py.
"""
MAX_BESIDE = 2.0
"""
A pole stands this near to the middle of its conductors; farther off are legs of towers [m].
Source: judgement; holds from 1 to 4 on bench/constants.py.
"""
FREE, LEAST_FREE = 0.35, 3
"""
A pole stands free in at least this share, and this number, of its metres.
Source: judgement; FREE holds from 0.175 to 0.7, LEAST_FREE holds from 1 to 6 on
bench/constants.py.
"""
MAX_AROUND = 1.25
"""
It does where within 3 radii there are at most this many times the points in the column; a crown
has 8 times as many, a wall or its corner twice as many.
Source: judgement; holds from 0.625 to 2.5 on bench/constants.py.
"""
SURE_FILLED = 0.8
"""
Share of its metres that a pole fills where no conductor tells of it.
Source: measured: below crowns that touch a conductor bushes and trunks fill 0.6 to 0.75 (random
scenes, any 41009 and 41025), poles of sparse surveys 0.85 and more.
"""
SURE_SHARE, LEAST_SHARE, SHARE_SIGMAS, SURE_POINTS = 0.5, 0.28, 2.0, 4
"""
Share of the points within 3 radii that such a column holds; the share that it holds but for so
many standard deviations of chance; and its points, at least.  A crown has a share of one in nine.
Source: measured: poles of five real clouds and of random scenes have 0.51 to 1, crowns 0.14 to
0.42; derived: of 20 points 10 must be the column's, of 12 seven, of 5 four.
"""
LONE_POINTS, LONE_FILLED = 4, 0.35
"""
Points of a column about which there is nothing else at all, at least, and the share of its metres
that it fills, where few are seen of a pole.
Source: measured: poles of two sparse surveys have four and five points in 0.4 to 0.6 of their
metres (random scenes, clean 360004 and 363030); with it no other support in 66 random scenes (any
364000:364030, clean 365000:365036) and 20 real clouds.
"""
LEAST_HALF = 4
"""
Metres of its upper half in which alone a pole may show that it is none of a crown.
Source: derived: the top of a crown is as thin as a pole over a metre or two.
"""
CHANCE = 1
"""
Points that the ring may lack by chance.
Source: judgement; holds from 0 to 2 on bench/constants.py.
"""
RING = 3.0
"""
Outer radius of the ring about a column, in radii of the column.
Source: judgement; not measured.
"""
MOST_POINTS = 2000
"""
More points about a place are thinned evenly.
Source: numerical: 200 a metre of a pole of 10 m; time goes with the square.
"""
WALL_REACH = 3.0
"""
Distance within which other lines of a wall are looked for [m].
Source: derived: two more on one side of the last one, 1.5 m apart as the coarsest scan lines.
"""
WALL_COLUMNS = 1.5
"""
A wall holds this many times the points of the column beside it.
Source: derived: two more lines of it do, the other post of a portal does not.
"""
WALL_SHARE = 0.6
"""
Share of the points about the column that lie in the plane of a wall.
Source: judgement; of a crown a twelfth do.
"""
LEAST_HEIGHT = 1.0
"""Points lower than this are no structure's [m].  Source: judgement; not measured."""
TOP_METRES = 2
"""Metres below the conductor that need not be filled.  Source: judgement; not measured."""
TOP_GAP = 1.5
"""
The highest point of a pole has another one at most this far below it [m].
Source: judgement: poles of sparse surveys lack points for a metre.
"""
LEAST_METRES = 3
"""
Metres that must be filled are counted from at least this many.
Source: judgement; not measured.
"""
FOOT_PART = 3
"""
The body of a tower begins at this part of its height; below it are its legs and shrubs.
Source: judgement; not measured.
"""
LEAST_BODY = 5
"""Points of the body of a tower, at least.  Source: judgement; not measured."""
OUTER = (5, 95)
"""Percentiles between which the body of a tower lies in plan.  Source: judgement; not measured."""
NUM_ROUNDS = 3
"""A column moves to the middle of its points this often.  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Structure:
    """A pole or tower."""

    position: Float64
    """(2,) plan position of its axis [m]."""
    top: float
    """Height of its highest point [m]."""
    around: float = -math.inf
    """Height of the highest point about it that is no conductor, -inf if not looked for [m]."""
    kind: str
    """'pole' or 'tower'."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """A place at which conductors end and something may hold them."""

    near: Float64
    """(2,) plan position to look at [m]."""
    azimuth: float
    """Direction of the line [rad]."""
    reach: float
    """How far from there the axis may be; across the line at most MAX_BESIDE [m]."""
    attachment: float
    """Height of the lowest conductor there above the ground [m]."""
    top: float
    """Height of the highest one [m]; a pole reaches up to it."""
    lowest: float
    """Height above the ground below which no points are given [m]."""
    may_be_tower: bool
    """What fills the metres without being a pole is a tower; else nothing is."""
    is_told: bool = True
    """Conductors tell of a support here; else a pole must prove itself."""

    @property
    def levels(self) -> tuple[int, int]:
        """First and last of the metres above the ground that a structure fills."""
        return self._count_levels(self.attachment)

    @property
    def pole_levels(self) -> tuple[int, int]:
        """The same of a pole, which reaches up to the highest conductor."""
        return self._count_levels(self.top)

    def _count_levels(self, top: float) -> tuple[int, int]:
        first = math.ceil(max(self.lowest, LEAST_HEIGHT))
        return first, max(int(top) - TOP_METRES, first + LEAST_METRES - 1)


def measure_from_lowest(
    points: Float64, index: PlanIndex, wire: Bool, near: Float64, reach: float
) -> tuple[float, Float32]:
    """
    Measure heights from the lowest thing seen at a place, where the ground was not.

    From a vehicle beside a high line the feet of its towers are out of sight.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Of the points off the ground.
    wire : (N,) bool
        Points of conductors, which do not count.
    near : (2,) float64
        The place in plan [m].
    reach : float
        How far from it [m].

    Returns
    -------
    base : float
        What heights are measured from [m]; NaN where nothing was seen.
    height : (N,) float32
        Of the points that are looked at about the place, NaN elsewhere [m].

    """
    found = index.strip(near, near, reach + WALL_REACH)
    own = found[~wire[found] & (np.hypot(*(points[found, :2] - near).T) <= reach)]
    height = np.full(len(points), np.nan, dtype=np.float32)
    base = float(points[own, 2].min()) - LEAST_HEIGHT if len(own) else math.nan
    height[found] = points[found, 2] - base
    return base, height


def find_structure(
    points: Float64, height: Float32, index: PlanIndex, wire: Bool, stand: Stand
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
    stand : Stand
        Where to look.

    Returns
    -------
    Structure or None

    """
    near, reach = stand.near, stand.reach
    found = index.strip(near, near, reach + RING * COLUMN)
    found = found[~wire[found] & (height[found] > LEAST_HEIGHT)]
    found = found[:: len(found) // MOST_POINTS + 1]
    apart = points[found, :2] - near
    level = height[found].astype(np.int64)
    column = _best_column(apart, level, stand)
    if column is not None:
        around = index.strip(near + column, near + column, WALL_REACH)
        around = around[~wire[around]]
        beside = points[around, :2] - near - column
        if not stand.is_told and _is_of_wall(beside, height[around], stand):
            return None
        own = np.hypot(*(apart - column).T) <= COLUMN
        z = points[found[own], 2]
        top = float(z.max()) if stand.is_told else _find_top(z)
        around = around[np.hypot(*beside.T) <= WALL_REACH]
        return Structure(
            position=near + column, top=top, around=float(points[around, 2].max()), kind='pole'
        )
    first, last = stand.levels
    inside = np.hypot(apart[:, 0], apart[:, 1]) <= reach + COLUMN
    found, apart, level = found[inside], apart[inside], level[inside]
    filled = len(np.unique(level[(level >= first) & (level <= last)]))
    if filled < FILLED * (last - first + 1) or not stand.may_be_tower:
        return None
    body = level >= last // FOOT_PART
    if body.sum() < LEAST_BODY:
        return None
    low, high = np.percentile(apart[body], OUTER, axis=0)
    top = float(points[found, 2].max())
    return Structure(position=near + (low + high) / 2, top=top, around=top, kind='tower')


def _best_column(apart: Float64, level: Int64, stand: Stand) -> Float64 | None:
    """Axis of the column that stands free in most levels, if it fills enough of them."""
    first, last = stand.pole_levels
    chosen = (level >= first) & (level <= last)
    apart, level, needed = apart[chosen], level[chosen] - first + 1, last - first + 1
    best, filled, free = _freest(apart, level, needed, stand.azimuth, stand.reach)
    share = FILLED if stand.is_told else LONE_FILLED
    if filled < share * needed or free < max(FREE * needed, LEAST_FREE):
        return None
    axis: Float64 = np.median(apart[np.hypot(*(apart - best).T) <= COLUMN], axis=0)
    if stand.is_told:
        return axis
    distance = np.hypot(*(apart - axis).T)
    if filled < SURE_FILLED * needed:
        near = distance[distance <= RING * COLUMN]
        return axis if len(near) >= LONE_POINTS and near.max() <= COLUMN else None
    half = needed // 2
    upper = distance[level > needed - half]  # a pole stands out of the crowns about its foot
    parts = [distance] if half < LEAST_HALF else [distance, upper]
    return axis if any(map(_is_sure, parts)) else None


def _is_of_wall(apart: Float64, height: Float32, stand: Stand) -> bool:
    """
    Tell whether a column is one of the lines in which a survey scans a wall.

    Lines a metre apart on a wall stand as free as poles do, but in a row.  Given are points about
    the column, (N, 2) from its axis and (N,) above the ground [m].
    """
    first, last = stand.pole_levels
    level, distance = height.astype(np.int64), np.hypot(*apart.T)
    filling = (level >= first) & (level <= last)
    least = WALL_COLUMNS * (filling & (distance <= COLUMN)).sum()
    beside = filling & (distance > COLUMN) & (distance <= WALL_REACH)
    apart, level = apart[beside], level[beside]
    if len(level) < least:
        return False
    # the way in which most of them lie in a thin plane through the column
    doubled = 2.0 * np.arctan2(apart[:, 1], apart[:, 0])
    turn = 0.5 * math.atan2(float(np.sin(doubled).sum()), float(np.cos(doubled).sum()))
    across = apart[:, 1] * math.cos(turn) - apart[:, 0] * math.sin(turn)
    wall = level[np.abs(across) <= COLUMN / 2.0]
    is_full = len(np.unique(wall)) >= SURE_FILLED * (last - first + 1)
    return is_full and len(wall) >= max(least, WALL_SHARE * len(level))


def _find_top(z: Float64) -> float:
    """Return the height of the highest point that is no stray above the others [m]."""
    order = np.sort(z)
    close = np.flatnonzero(np.diff(order) <= TOP_GAP)
    return float(order[close[-1] + 1] if len(close) else order[0])


def _is_sure(distance: Float64) -> bool:
    """Whether a column has so many of the points about it, (N,) far off, that it is no crown's."""
    num_own, num_near = (int((distance <= reach).sum()) for reach in (COLUMN, RING * COLUMN))
    if num_own < max(SURE_POINTS, SURE_SHARE * num_near):
        return False
    # lower end of Wilson's interval of the share
    share, weight = num_own / num_near, SHARE_SIGMAS**2 / num_near
    half = SHARE_SIGMAS * math.sqrt(share * (1.0 - share) / num_near + weight / (4 * num_near))
    return (share + 0.5 * weight - half) / (1.0 + weight) >= LEAST_SHARE


@njit(cache=True, nogil=True)
def _freest(apart, level, needed, azimuth, reach):  # type: ignore[no-untyped-def]
    """Axis of the column about which the least lies, and in how many metres it is filled, free."""
    best, best_filled, best_free, most = np.zeros(2), 0, 0, 0.0
    num = len(apart)
    # strips across x as wide as a column, so that what is about a place is in nine of them
    strip, row = np.empty(num, dtype=np.int64), np.empty(num, dtype=np.int64)
    for k in range(num):
        strip[k] = math.floor((apart[k, 0] + 2 * reach) / COLUMN)
        row[k] = math.floor((apart[k, 1] + 2 * reach) / COLUMN)
    size = math.ceil(4 * reach / COLUMN) + 1
    order = np.argsort(strip * size + row, kind='mergesort')
    start = np.searchsorted(strip[order], np.arange(size + 6))
    inner, outer = np.empty(needed + 1), np.empty(needed + 1)
    own = np.empty(num, dtype=np.int64)
    first = 0
    while first < num:
        last = first
        here = strip[order[first]]
        while last < num and strip[order[last]] == here and row[order[last]] == row[order[first]]:
            last += 1
        # the points of one cell that is as wide as a column
        members = last - first
        put(order[first:last], own)
        first = last
        x = y = 0.0
        for _ in range(NUM_ROUNDS):  # to the middle of the cell's points, then of those about that
            x, y = np.median(apart[own[:members], 0]), np.median(apart[own[:members], 1])
            beside = abs(y * math.cos(azimuth) - x * math.sin(azimuth))
            members = 0
            if beside > MAX_BESIDE or math.hypot(x, y) > reach:
                break
            inner[:], outer[:] = 0.0, 0.0
            for place in range(start[max(here - 4, 0)], start[here + 5]):
                k = order[place]
                distance = math.hypot(apart[k, 0] - x, apart[k, 1] - y)
                if distance <= COLUMN:
                    own[members] = k
                    members += 1
                    inner[level[k]] += 1.0
                elif distance <= RING * COLUMN:
                    outer[level[k]] += 1.0
            if members == 0:
                break
        if members == 0:
            continue
        # metres in which it is filled, and in which little lies about it
        filled, free, score = 0, 0, 0.0
        for step in range(1, needed + 1):
            if inner[step] > 0.0:
                filled += 1
                free += outer[step] + CHANCE <= MAX_AROUND * inner[step]
                score += inner[step] / (inner[step] + outer[step])
        if score > most:
            best, best_filled, best_free, most = np.array([x, y]), filled, free, score
    return best, best_filled, best_free
