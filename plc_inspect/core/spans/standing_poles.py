# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Poles that stand at conductors: supports at which no conductor needs to be bent."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve, pack_curves
from plc_inspect.core.catenary.curve_row import (
    COS,
    HIGH,
    LOW,
    open_row,
    ORIGIN_X,
    ORIGIN_Y,
    see_above,
    see_beside,
    SIN,
)
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.extraction.structures import (
    COLUMN,
    FILLED,
    find_structure,
    LEAST_HEIGHT,
    LEAST_METRES,
    MAX_BELOW,
    MAX_BESIDE,
    Stand,
    TOP_METRES,
)
from plc_inspect.core.numerics.arrays import count_bits
from plc_inspect.core.numerics.plan_index import gather_strip
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.core.spans.joints import describe_joint, Joint, MAX_MISS, MAX_TURN
from plc_inspect.results import Bool, Float64

BESIDE = 1.0
"""
Distance in plan of a pole from the conductor that it holds, at most [m].
Source: judgement; arms of low-voltage poles are shorter, and one conductor of three on an arm
hangs near the pole.
"""
ARM = 3.0
"""
Distance in plan of the other conductors that a pole holds, at most [m].
Source: derived: half of `supports.MIN_TOWER`, twice over; medium-voltage arms are 1 to 2.5 m.
"""
SAME_POLE = 1.0
"""Poles nearer to each other are one [m].  Source: judgement; A-frames have two legs."""
CELL = 0.5
"""
Edge of the plan cells of which columns are looked for [m].
Source: derived: COLUMN to both sides.
"""
LOOK = 0.7
"""
Of the places in a cell of this edge one is looked at [m].
Source: derived: BESIDE reaches beyond the diagonal of a cell, which is 1.2 m, from most places.
"""
BARE_SHARE = 0.35
"""
Share of the points of four by four cells that the inner four hold where a pole may stand.
Source: derived: in clutter that leaves a column SURE_SHARE of its points it is 0.5, in a crown
0.25.
"""
HIGHEST = 62
"""Metres above ground that are told apart.  Source: numerical: bits of an integer."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StandingPole:
    """A pole that reaches up to a conductor and stands at it."""

    position: Float64
    """(2,) plan position [m]."""
    base: float
    """Height of the ground [m]."""
    top: float
    """Height of its highest point [m]."""
    around: float = -math.inf
    """Height of the highest point about it that is no conductor, -inf if not looked for [m]."""

    def holds(self, curve: Curve) -> bool:
        """Tell whether a curve passes it, between its ends or beyond, as a conductor does."""
        x, y = curve.local_place(self.position)
        z = float(curve.fit.height(x))
        return abs(y) <= ARM and self.base < z <= self.top + MAX_BELOW


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PoleEnd:
    """An end of a curve at a pole."""

    number: int
    side: int
    x: float
    """Of the pole along the curve [m]."""
    place: Float64
    """(3,) of the curve there [m]."""


def find_poles(
    cloud: OffGround, curves: Sequence[Curve], wire: Bool, arms: Sequence[StandingPole] = (),
    told: Sequence[tuple[Curve, float]] = (),
) -> tuple[StandingPole, ...]:
    """
    Find the poles along curves.

    Where conductors run straight over a pole, or hang there as if it were not, none of them tells
    of it: what stands there does.

    Parameters
    ----------
    cloud : OffGround
        K points.
    curves : sequence of Curve
        Conductors.
    wire : (K,) bool
        Points of conductors.
    arms : sequence of StandingPole
        Poles that their arms tell of.
    told : sequence of (Curve, float)
        Places along curves that tell of a support, as of `cutting.find_doubtful` [m].

    Returns
    -------
    tuple of StandingPole
        One of those that stand together.

    """
    if not curves:
        return ()
    places: list[tuple[Curve, float]] = []
    looked_at = set()
    columns = _list_columns(cloud, pack_curves(curves), wire)
    for curve, along in zip(curves, columns, strict=True):
        for x, place in zip(along.tolist(), curve.position(along), strict=True):
            cell = tuple(np.floor(place / LOOK).tolist())
            if cell not in looked_at:  # conductors side by side pass the same column
                looked_at.add(cell)
                places.append((curve, x))
    found = call_each(lambda k: _stand_at(cloud, wire, *places[k]), len(places))
    bent = call_each(lambda k: _stand_at(cloud, wire, *told[k], is_told=True), len(told))
    poles: list[StandingPole] = []
    for pole in sorted(
        (pole for pole in [*found, *bent, *arms] if pole is not None),
        key=lambda pole: (-pole.top, *pole.position),
    ):
        if all(math.dist(pole.position, other.position) > SAME_POLE for other in poles):
            poles.append(pole)
    return tuple(poles)


def join_at_poles(
    curves: Sequence[Curve], joints: Sequence[Joint], poles: Sequence[StandingPole], room: float
) -> tuple[Joint, ...]:
    """
    Pair the ends that meet at poles and have met nowhere else.

    Parameters
    ----------
    curves : sequence of Curve
        Conductors.
    joints : sequence of Joint
        As from `find_joints`.
    poles : sequence of StandingPole
        As from `find_poles`.
    room : float
        Distance from an end to its pole, at most [m].

    Returns
    -------
    tuple of Joint
        Those given, and the new ones.

    """
    result = list(joints)
    used = {
        end for joint in joints for end in zip(joint.curves, joint.sides, strict=True)
    }
    for pole in poles:
        ends = [
            end for number, curve in enumerate(curves) if pole.holds(curve)
            and (end := _find_end(number, curve, pole, room)) and (number, end.side) not in used
        ]
        pairs = sorted(
            (math.dist(first.place, second.place), k, m)
            for k, first in enumerate(ends) for m, second in enumerate(ends[:k])
            if first.number != second.number
        )
        for miss, k, m in pairs:
            first, second = ends[m], ends[k]
            keys = {(first.number, first.side), (second.number, second.side)}
            if miss <= MAX_MISS and not keys & used and _face(curves, first, second):
                used |= keys
                result.append(_join(curves, first, second, miss))
    return tuple(result)


def _find_end(number: int, curve: Curve, pole: StandingPole, room: float) -> _PoleEnd | None:
    """Return the end of a curve that is at a pole: the nearer one."""
    x, _ = curve.local_place(pole.position)
    side, end = min((-1, curve.low), (1, curve.high), key=lambda item: abs(item[1] - x))
    if abs(end - x) > room:
        return None
    return _PoleEnd(number=number, side=side, x=x, place=curve.position(x)[0])


def _face(curves: Sequence[Curve], first: _PoleEnd, second: _PoleEnd) -> bool:
    """Tell whether two ends point opposite ways."""
    turn = curves[first.number].azimuth - curves[second.number].azimuth
    return first.side * second.side * math.cos(turn) < -math.cos(MAX_TURN)


def _join(curves: Sequence[Curve], first: _PoleEnd, second: _PoleEnd, miss: float) -> Joint:
    rise = sum(
        end.side * float(curves[end.number].fit.slope(end.x)) for end in (first, second)
    )
    return describe_joint(
        curves, (first.number, second.number), (first.side, second.side), (first.x, second.x),
        kink=rise, miss=miss, cost=miss,
    )


def _stand_at(
    cloud: OffGround, wire: Bool, curve: Curve, x: float, *, is_told: bool = False
) -> StandingPole | None:
    """Find the pole at a place of a curve; the top of one that curves tell of may be unseen."""
    place = curve.position(x)[0]
    base = float(cloud.height.ground.at(place[None, :])[0])
    if not math.isfinite(base):
        return None
    above = float(place[2]) - base
    found = find_structure(cloud.points, cloud.height.height, cloud.index, wire, Stand(
        near=place[:2], azimuth=curve.azimuth, reach=MAX_BESIDE if is_told else BESIDE,
        attachment=above, top=above, lowest=cloud.least, may_be_tower=False, is_told=is_told,
    ))
    if found is None or found.top < float(place[2]) - (TOP_METRES if is_told else MAX_BELOW):
        return None
    top = max(found.top, float(place[2])) if is_told else found.top
    return StandingPole(position=found.position, base=base, top=top, around=found.around)


def _list_columns(cloud: OffGround, rows: Float64, wire: Bool) -> list[Float64]:
    """List for each row x along its curve where cells hold points in most metres below it."""
    first = math.ceil(max(cloud.least, LEAST_HEIGHT))
    marks = _mark_columns(
        cloud.points, cloud.height.height, *cloud.index.grid, rows, wire, first
    )
    return [
        row[LOW] + (np.flatnonzero(own) + 0.5) * 2 * CELL
        for row, own in zip(rows, marks, strict=True)
    ]


@njit(cache=True, nogil=True, error_model='numpy')
def _mark_columns(  # type: ignore[no-untyped-def]
    points, height, start, order, corner, cell, num_rows, num_columns, rows, wire,
    first,
):
    """Tell for each two cells along each row's curve whether a column may stand there."""
    marks = [np.zeros(0, dtype=np.bool_) for _ in range(len(rows))]
    across = int(2 * (BESIDE + COLUMN) / CELL) + 1
    for number in range(len(rows)):
        row = rows[number]
        low, high = row[LOW], row[HIGH]
        near = gather_strip(
            start, order, corner, cell, num_rows, num_columns,
            row[ORIGIN_X] + row[COS] * low, row[ORIGIN_Y] + row[SIN] * low,
            row[ORIGIN_X] + row[COS] * high, row[ORIGIN_Y] + row[SIN] * high, BESIDE + COLUMN,
        )

        # for each cell along and across: which metres above ground hold points, as bits, how many
        # points, and how many metres a pole that reaches the curve must fill
        num = 2 * (int((high - low) / (2 * CELL)) + 1)
        levels = np.zeros((num + 1, across + 1), dtype=np.int64)
        counts = np.zeros((num + 1, across + 1), dtype=np.int64)
        needed, opened = np.zeros(num, dtype=np.int64), open_row(row)
        for i in near:
            if wire[i]:
                continue
            x, y = see_beside(opened, points[i, 0], points[i, 1])
            if x < low or x > high or abs(y) >= BESIDE + COLUMN:
                continue
            rise, _ = see_above(opened, x, points[i, 2])
            above = height[i] - rise  # of the curve
            place = int((x - low) / CELL)
            last = max(int(above) - TOP_METRES, first + LEAST_METRES - 1)
            needed[place] = max(needed[place], last - first + 1)
            level = int(height[i])
            if first <= level <= min(last, HIGHEST):
                side = int((y + BESIDE + COLUMN) / CELL)
                levels[place, side] |= 1 << level
                counts[place, side] += 1

        # four cells that fill their metres, and hold more than what lies about them
        mark = np.zeros(num // 2, dtype=np.bool_)
        for place in range(num):
            for side in range(across):
                both = (
                    levels[place, side] | levels[place + 1, side]
                    | levels[place, side + 1] | levels[place + 1, side + 1]
                )
                filled = count_bits(both)
                if filled > 0 and filled >= FILLED * needed[place]:
                    own = counts[place : place + 2, side : side + 2].sum()
                    near_by = counts[
                        max(place - 1, 0) : place + 3, max(side - 1, 0) : side + 3
                    ].sum()
                    if own >= BARE_SHARE * near_by:
                        mark[place // 2] = True
        marks[number] = mark
    return marks
