# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
How many metres of a curve hang free in the air: the evidence that it is a conductor.

In each metre the points in the core of the curve, a few times its own scatter, are weighed
against those in a ring about it.  A conductor has air about it: nearly all points are in the core.
In a sheet that runs through the axis, such as a roof, a wall or a hedge, points lie in the core in
proportion to its width; about a chord of a truss, and whatever else is held, a fifth lies in the
ring.  The logarithm of the ratio of both likelihoods, capped so that a dense metre counts no more
than a sparse one, is 1 for a clean metre and -1 for a cluttered one.  Cluttered metres beside
which all lies in one place, as another conductor that nobody has found yet, are told apart.
"""

from dataclasses import dataclass, replace
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.catenary.curve_row import (
    COS,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    ROUNDING,
    see_above,
    see_beside,
    SIN,
    slope_of,
    TOLERANCE,
)
from plc_inspect.core.ground.ground_grid import GroundGrid, is_seen
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.results import Bool, Float64

STEP = 1.0
"""Length of the parts that are weighed [m].  Source: derived: evidence counts metres."""
CORE_SIGMAS = 3.5
"""
Radius of the core in standard deviations of the points across the curve.
Source: derived: 99.8 % of them lie in it.
"""
LEAST_CORE = 0.06
"""
Radius of the core, at least [m].
Source: derived: three standard deviations of the best ranges, 2 cm.
"""
RING = (0.3, 1.0)
"""
Inner and outer radius of the wide ring [m].
Source: judgement; on real clouds with and without wires: nearer, the mixed returns about a
conductor count against it, farther, the ground and crowns below it.
"""
RING_RATIO = 1.5
"""
The wide ring begins at this many radii of the core, at least.
Source: judgement; not measured.
"""
CLOSE_RING = (1.3, 2.2)
"""
Radii of the close ring in those of the core: what touches the conductor.
Source: judgement; not measured.
"""
CORE_SHARE = 0.9
"""
Share of the points about a conductor that lie in its core; mixed returns are the rest.
Source: judgement; not measured.
"""
HELD_SHARE = 0.2
"""
Share of the points about a chord of a truss, or anything else that is held, that lie in the ring.
Source: measured: 0.16 to 0.3 in the median metre of the chords of a crane's jib; of conductors
with as many points 0 to 0.05.
"""
HELD_SPREAD = 0.1
"""
Those of one metre spread over the wide ring by so much, in distance from the curve (standard
deviation) [m]; those of another conductor beside do not.
Source: derived: half of what rods across the whole ring have.
"""
HELD_CHANCE = 0.1
"""
Chance that what lies about a curve that is no conductor holds it, and is no sheet.
Source: judgement: with few points, where both look alike, a metre counts as before.
"""
BESIDE_SPREAD, LEAST_BESIDE = 0.15, 3
"""
What lies in the wide ring of one metre within so much of one place (standard deviation) [m], by
this many points at least, is another conductor or bundle beside, and no sheet.
Source: derived: telecom cables on one messenger spread by 0.1 to 0.17 m; a sheet that begins at
the curve and crosses the ring by 0.2 m, one on both sides by 0.6 m.
"""
NATS = 2.0
"""
Logarithm of the likelihood ratio that makes a clean metre.
Source: judgement; not measured: one metre in seven is clean by chance.
"""
DROP = 1.5
"""
Points this far below a curve are no part of what it could lie on [m].
Source: judgement; a roof's eaves, a truss and a pipe rack are less high.
"""
ALONE = 3.0
"""
A row of a scanner on a roof has another one within this distance [m].
Source: derived: two rows apart, where one was missed; sparse surveys lay them 1.5 m apart.
"""
RAYLEIGH_MEDIAN = 1.1774
"""
Median distance from the axis in standard deviations, of points that scatter both ways.
Source: derived: the square root of 2 ln 2.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeLength:
    """Metres of a curve that are free, less those that are cluttered; at most its length."""

    close: float
    """Of what touches the curve, where something was seen below it [m]."""
    wide: float
    """Of what lies within a metre of it [m]."""
    open: float
    """The same, where something was seen below it [m]."""
    alone: float
    """Free metres that are not open, with nothing within ALONE, not even a wire [m]."""
    cluttered: float
    """Metres with other things within a metre of it, not less free ones [m]."""
    company: float
    """Those of them beside which one other line lies and nothing else [m]."""

    def spare(self, share: float) -> 'FreeLength':
        """Return the same where a share of the company does not count against the curve."""
        spared = share * self.company
        return replace(
            self, wide=self.wide + spared, open=self.open + spared,
            cluttered=self.cluttered - spared,
        )


UNKNOWN = FreeLength(
    close=-math.inf, wide=-math.inf, open=-math.inf, alone=-math.inf,
    cluttered=math.inf, company=0.0,
)
"""As if all of a curve were cluttered."""


def measure_free_length(
    points: Float64, index: PlanIndex, curve: Curve, ignore: Bool, sight: GroundGrid
) -> FreeLength:
    """
    Measure how many metres of a curve hang free in the air.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Searched.
    curve : Curve
        The curve, between its own ends.
    ignore : (N,) bool
        Points of conductors; those in the ring do not count.
    sight : GroundGrid
        Where ground was seen.

    Returns
    -------
    FreeLength

    """
    close, wide, above, alone, cluttered, company = _measure(
        points, index.grid, curve.row, ignore, sight.seen, sight.blocks
    )
    return FreeLength(
        close=close, wide=wide, open=above, alone=alone, cluttered=cluttered, company=company
    )


@njit(cache=True, nogil=True, error_model='numpy')
def _measure(points, grid, row, ignore, seen, blocks):  # type: ignore[no-untyped-def]
    """Metres of evidence by the rings, above what was seen, and where it is alone; and against."""
    low, high = row[LOW], row[HIGH]
    num = max(int((high - low) / STEP), 1)
    is_open = _see_ground(row, num, seen, blocks)
    distance, across, part, core = place_about(points, grid, row, ignore, is_open)
    if core == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    inner, outer = ring_about(core)
    is_alone = ~is_open
    if is_alone.any():
        is_alone &= _see_alone(points, grid, row, outer, num)

    # evidence of each part in both rings; where nothing was seen below, only that against it
    scale = (high - low) / num / STEP
    close, _ = _weigh(
        distance, across, part, num, core, CLOSE_RING[0] * core, CLOSE_RING[1] * core, 0.0
    )
    wide, is_line = _weigh(distance, across, part, num, core, inner, outer, HELD_SPREAD)
    against = -scale * np.minimum(wide, 0.0)
    return (
        scale * np.where(is_open, close, np.minimum(close, 0.0)).sum(), scale * wide.sum(),
        scale * np.where(is_open, wide, np.minimum(wide, 0.0)).sum(),
        scale * np.where(is_alone, np.maximum(wide, 0.0), 0.0).sum(),
        against.sum(), against[is_line].sum(),
    )


@njit(cache=True, nogil=True, error_model='numpy')
def place_about(points, grid, row, ignore, is_open):  # type: ignore[no-untyped-def]
    """
    List what lies on a row's curve and within a metre of it.

    Returned are (K,) distances from the curve, (K, 2) places beside and above it [m], (K,) the
    part of it, as many as ``is_open`` has, and the radius of the core, 0 without a point in it
    [m].  Parts below which something lies are set open.
    """
    start, order, corner, cell, num_rows, num_columns = grid
    low, high, num = row[LOW], row[HIGH], len(is_open)
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, RING[1],
    )

    # distance from the curve of each point, and the part that it lies beside
    steepest = math.hypot(1.0, max(abs(slope_of(row, low)), abs(slope_of(row, high))))
    distance, across = np.empty(len(near)), np.empty((len(near), 2))
    part = np.empty(len(near), dtype=np.int64)
    own = np.empty(len(near))
    count = num_own = 0
    opened, tolerance, by_part = open_row(row), row[TOLERANCE], num / (high - low)
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if x < low - ROUNDING or x > high + ROUNDING or abs(y) > RING[1]:
            continue
        rise, slope = see_above(opened, x, points[i, 2])
        if rise > RING[1] * steepest:  # most of a strip's points are far off
            continue
        place = min(int((x - low + ROUNDING) * by_part), num - 1)
        if rise < -DROP * steepest:
            is_open[place] = True
            continue
        above = rise / math.sqrt(1.0 + slope * slope)
        is_open[place] = is_open[place] or above < -DROP
        radius = math.sqrt(y * y + above * above)
        if radius <= tolerance:
            own[num_own] = radius
            num_own += 1
        elif radius > RING[1] or ignore[i]:
            continue
        distance[count] = radius
        across[count, 0], across[count, 1] = y, above
        part[count] = place
        count += 1
    core = 0.0
    if num_own > 0:
        # the core is as thick as the points scatter
        scatter = np.median(own[:num_own]) / RAYLEIGH_MEDIAN
        core = min(max(CORE_SIGMAS * scatter, LEAST_CORE), max(tolerance, LEAST_CORE))
    return distance[:count], across[:count], part[:count], core


@njit(cache=True, nogil=True, error_model='numpy')
def ring_about(core):  # type: ignore[no-untyped-def]
    """Inner and outer radius of the wide ring about a core [m]."""
    inner = max(RING_RATIO * core, RING[0])
    return inner, max(RING[1], inner + core)


@njit(cache=True, nogil=True, error_model='numpy')
def _see_ground(row, num, seen, blocks):  # type: ignore[no-untyped-def]
    """Tell the parts of a row's curve below whose middles the ground was seen."""
    result = np.zeros(num, dtype=np.bool_)
    for place in range(num):
        x = row[LOW] + (row[HIGH] - row[LOW]) * (place + 0.5) / num
        result[place] = is_seen(
            seen, blocks, row[ORIGIN_X] + row[COS] * x, row[ORIGIN_Y] + row[SIN] * x
        )
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _see_alone(points, grid, row, outer, num):  # type: ignore[no-untyped-def]
    """Tell the parts of a row's curve about which nothing lies between ``outer`` and ALONE [m]."""
    start, order, corner, cell, num_rows, num_columns = grid
    low, high = row[LOW], row[HIGH]
    near = gather_strip(
        start, order, corner, cell, num_rows, num_columns,
        row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
        row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, ALONE,
    )
    opened, by_part = open_row(row), num / (high - low)
    is_alone = np.ones(num, dtype=np.bool_)
    for i in near:
        x, y = see_beside(opened, points[i, 0], points[i, 1])
        if x < low - ROUNDING or x > high + ROUNDING or abs(y) > ALONE:
            continue
        part = min(int((x - low + ROUNDING) * by_part), num - 1)
        if is_alone[part]:
            rise, slope = see_above(opened, x, points[i, 2])
            is_alone[part] = not outer < math.hypot(
                y, rise / math.sqrt(1.0 + slope * slope)
            ) <= ALONE
    return is_alone


@njit(cache=True, nogil=True, error_model='numpy')
def _weigh(  # type: ignore[no-untyped-def]
    distance, across, part, num, core, inner, outer, spread
):
    """
    Logarithm of the ratio of both likelihoods of each part, capped; and where a line is beside.

    ``across`` are places beside and above the curve [m].  What holds a curve spreads over the
    ring, by ``spread`` at least (standard deviation) [m].
    """
    in_core, in_ring, sums = np.zeros(num), np.zeros(num), np.zeros((num, 4))
    for k in range(len(distance)):
        if distance[k] <= core:
            in_core[part[k]] += 1.0
        elif inner < distance[k] <= outer:
            own = sums[part[k]]
            in_ring[part[k]] += 1.0
            own[0] += distance[k]
            own[1] += across[k, 0]
            own[2] += across[k, 1]
            own[3] += distance[k] * distance[k]
    sheet = core / (core + outer - inner)
    weight, is_line = np.empty(num), np.zeros(num, dtype=np.bool_)
    for place in range(num):
        most = max(in_ring[place], 1.0)
        mean, aside, above, square = sums[place] / most
        ratio = _compare(in_core[place], in_ring[place], 1.0 - sheet)
        if in_ring[place] > 0.0 and square - mean * mean >= spread * spread:
            held = _compare(in_core[place], in_ring[place], HELD_SHARE)
            # the greater likelihood taken out, so that none is beyond what a number holds
            least = min(ratio, held)
            others = (1.0 - HELD_CHANCE) * math.exp(least - ratio)
            ratio = least - math.log(others + HELD_CHANCE * math.exp(least - held))
        weight[place] = min(max(ratio / NATS, -1.0), 1.0)
        if in_core[place] > 0.0 and in_ring[place] >= LEAST_BESIDE:
            variance = (square - aside * aside - above * above) * most / (most - 1.0)
            is_line[place] = variance < BESIDE_SPREAD * BESIDE_SPREAD
    return weight, is_line


@njit(cache=True, nogil=True, error_model='numpy')
def _compare(in_core, in_ring, share):  # type: ignore[no-untyped-def]
    """Logarithm of the likelihood of a conductor by that of what has a share in the ring."""
    mixed = 1.0 - CORE_SHARE
    return in_core * math.log(CORE_SHARE / (1.0 - share)) + in_ring * math.log(mixed / share)
