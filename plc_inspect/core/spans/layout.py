# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Supports, and the spans and lines between them."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.config import SupportSettings
from plc_inspect.core.catenary.curve import Curve, find_near, pack_curves
from plc_inspect.core.catenary.curve_row import TOLERANCE
from plc_inspect.core.catenary.cutting import cut_together
from plc_inspect.core.catenary.duplicates import mark_course, NUM_STATIONS, SLACK
from plc_inspect.core.spans.joints import find_joints, Joint
from plc_inspect.core.spans.standing_poles import join_at_poles, StandingPole
from plc_inspect.core.spans.stations import (
    cut_at_poles,
    cut_at_stations,
    group_joints,
    hang_apart,
    PARALLEL,
    place_station,
    Station,
)
from plc_inspect.results import Float64

AHEAD_TURN = math.radians(35.0)
"""
An open end hangs on a support ahead if the line there turns by less than this.
Source: judgement; not measured.
"""
REACH_SHARE = 0.5
"""
And if it is no farther than this share of the curve's length.
Source: judgement; not measured.
"""
MOST_SHARED = 0.5
"""A curve of which another covers this share is a duplicate.  Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """Curves cut to their spans, and what they hang between."""

    curves: tuple[Curve, ...]
    start_x: Float64
    """(C,) x of the curve at its low end: at the support if known, else the last point [m]."""
    end_x: Float64
    """(C,) x of the curve at its high end [m]."""
    start_station: tuple[int, ...]
    """Support at the low end of each curve, -1 where the curve is open."""
    end_station: tuple[int, ...]
    joints: tuple[Joint, ...]
    stations: tuple[Station, ...]


def find_layout(
    points: Float64,
    curves: Sequence[Curve],
    adopted: Sequence[Curve],
    settings: SupportSettings,
    poles: Sequence[StandingPole] = (),
    attempts: int = 4,
) -> Layout:
    """
    Find the supports that curves meet at, and end every curve at its supports.

    Joints of neighbouring conductors that lie side by side are one support.  A conductor that
    passes a support of its neighbours, or a pole, unbroken is cut there; one that fades out
    before a support is extended to it.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    curves : sequence of Curve
        Curves, each within one span.
    adopted : sequence of Curve
        Curves of `adoption.adopt`, kept only if they continue one of the others.
    settings : SupportSettings
        Settings of this stage.
    poles : sequence of StandingPole
        What stands at curves.
    attempts : int
        How often the layout is made anew after curves were dropped as duplicates.

    Returns
    -------
    Layout

    """
    def meet() -> tuple[tuple[Joint, ...], tuple[tuple[Joint, ...], ...]]:
        joints = find_joints(curves, settings.max_reach)
        joints = join_at_poles(curves, joints, poles, settings.radius)
        return _drop_weak(curves, _drop_amid(curves, joints, poles, settings), settings)

    believed = cut_at_poles(points, curves, poles, settings.min_span / 2)
    believed = cut_together(points, believed, settings.width, settings.min_span / 2)
    num_believed = len(believed)
    curves = [*believed, *adopted]
    joints, stations = meet()
    held = {number for joint in joints for number in joint.curves}
    kept = [c for number, c in enumerate(curves) if number < num_believed or number in held]
    if len(kept) < len(curves):  # lost the place that they were adopted for to better ones
        curves = kept
        joints, stations = meet()
    cut = cut_at_stations(points, curves, stations, settings, poles)
    if [id(curve) for curve in cut] != [id(curve) for curve in curves]:
        curves = cut
        joints, stations = meet()
    placed = tuple(place_station(group, poles) for group in stations)
    x, support = _end_at_supports(curves, joints, stations, placed, poles, settings)
    keep = _find_originals(curves, x[-1], x[1], settings.max_reach)
    if len(keep) < len(curves) and attempts > 1:
        originals = [curves[number] for number in keep]
        return find_layout(points, originals, (), settings, poles, attempts - 1)
    return Layout(
        curves=tuple(curves),
        start_x=x[-1],
        end_x=x[1],
        start_station=tuple(support[-1]),
        end_station=tuple(support[1]),
        joints=joints,
        stations=placed,
    )


def _end_at_supports(
    curves: Sequence[Curve], joints: Sequence[Joint], stations: Sequence[Sequence[Joint]],
    placed: Sequence[Station], poles: Sequence[StandingPole], settings: SupportSettings,
) -> tuple[dict[int, Float64], dict[int, list[int]]]:
    """Return x of all curves' ends [m], by side -1 or 1, and their supports, -1 for none."""
    x = {
        -1: np.array([curve.low for curve in curves]),
        1: np.array([curve.high for curve in curves]),
    }
    support = {side: [-1] * len(curves) for side in x}
    # ends that meet others
    owner = {id(joint): number for number, group in enumerate(stations) for joint in group}
    for joint in joints:
        for own, side, place in zip(joint.curves, joint.sides, joint.x, strict=True):
            x[side][own], support[side][own] = place, owner[id(joint)]
    # ends that fade out before a support
    for number, curve in enumerate(curves):
        for side in (1, -1):
            if support[side][number] < 0:
                found = _station_ahead(
                    curve, side, placed, support[-side][number], poles, settings
                )
                if found is not None:
                    support[side][number], x[side][number] = found
    return x, support


def _find_originals(
    curves: Sequence[Curve], start_x: Float64, end_x: Float64, max_reach: float
) -> list[int]:
    """Curves that do not lie on a better seen one, now that all reach their supports."""
    order = np.argsort([-curve.num_points for curve in curves], kind='stable')
    near = find_near(curves, 1.0 + max_reach)
    kept = _choose_originals(pack_curves(curves), start_x, end_x, near, order)
    result: list[int] = np.flatnonzero(kept).tolist()
    return result


@njit(cache=True, nogil=True, error_model='numpy')
def _choose_originals(rows, start_x, end_x, near, order):  # type: ignore[no-untyped-def]
    kept = np.zeros(len(rows), dtype=np.bool_)
    for number in order:
        row = rows[number]
        on_other = np.zeros(NUM_STATIONS, dtype=np.bool_)
        for k in near.item[near.start[number] : near.start[number + 1]]:
            if kept[k]:
                reach = max(row[TOLERANCE], rows[k][TOLERANCE])
                mark_course(
                    row, rows[k], start_x[k] - SLACK, end_x[k] + SLACK, reach, on_other
                )
        kept[number] = on_other.mean() < MOST_SHARED
    return kept


def _drop_amid(
    curves: Sequence[Curve], joints: Sequence[Joint], poles: Sequence[StandingPole],
    settings: SupportSettings,
) -> tuple[Joint, ...]:
    """
    Drop the joints amid a span that was not seen.

    Any two curves in one plane meet somewhere; where supports are known on both sides of that
    place, between it and what was seen, each hangs on the nearer one.
    """
    stations = [(set(map(id, group)), place_station(group))
                for group in group_joints(joints, settings)]

    def is_known_before(joint: Joint, number: int, side: int, x: float) -> bool:
        curve = curves[number]
        end = curve.high if side > 0 else curve.low
        if (x - end) * side <= settings.min_span / 2 - settings.radius:
            return False  # no support fits between
        others = [place for own, place in stations if id(joint) not in own]
        known = [
            curve.local_place(station.position) for station in others
            if abs(math.sin(station.direction - curve.azimuth)) < math.sin(PARALLEL)
            and station.may_hold(float(joint.position[2]))
        ]
        known += [curve.local_place(pole.position) for pole in poles if pole.holds(curve)]
        return any(
            (at - end) * side > -settings.radius and (x - at) * side > settings.min_span / 2
            and abs(y) < settings.width / 2 for at, y in known
        )

    return tuple(
        joint for joint in joints if not all(
            is_known_before(joint, *end)
            for end in zip(joint.curves, joint.sides, joint.x, strict=True)
        )
    )


def _drop_weak(
    curves: Sequence[Curve], joints: Sequence[Joint], settings: SupportSettings
) -> tuple[tuple[Joint, ...], tuple[tuple[Joint, ...], ...]]:
    """
    Drop the joints of a support that a better proven one stands in place of.

    That is nearer than min_span, or more conductors meet at it in a gap of all that meet here.
    """
    groups = sorted(
        group_joints(joints, settings),
        key=lambda group: (-len(group), sum(joint.cost for joint in group)),
    )
    kept: list[tuple[Joint, ...]] = []
    stations: list[Station] = []
    for group in groups:
        own = place_station(group)
        for other in stations:
            apart = own.position - other.position
            along = apart[0] * math.cos(other.direction) + apart[1] * math.sin(other.direction)
            is_near = abs(along) < settings.min_span or (
                len(other.attachments) > len(group)
                and all(_is_in_gap(curves, joint, other.position) for joint in group)
            )
            if (
                is_near
                and float(np.linalg.norm(apart)) < settings.width
                and not hang_apart(own.attachments, other.attachments)
                and abs(math.sin(own.direction - other.direction)) < math.sin(PARALLEL)
            ):
                break
        else:
            kept.append(group)
            stations.append(own)
    believed = {id(joint) for group in kept for joint in group}
    return tuple(joint for joint in joints if id(joint) in believed), tuple(kept)


def _is_in_gap(curves: Sequence[Curve], joint: Joint, position: Float64) -> bool:
    """Tell whether a place (2,) lies between what was seen of the two curves of a joint."""
    beyond = [
        (curve.local_place(position)[0] - (curve.high if side > 0 else curve.low)) * side
        for curve, side in zip((curves[k] for k in joint.curves), joint.sides, strict=True)
    ]
    return min(beyond) > 0.0


def _station_ahead(
    curve: Curve,
    side: int,
    stations: Sequence[Station],
    taken: int,
    poles: Sequence[StandingPole],
    settings: SupportSettings,
) -> tuple[int, float] | None:
    """Find the support at which an open end would hang, if its neighbours tell of one."""
    end = curve.high if side > 0 else curve.low
    at_poles = [
        (curve.local_place(pole.position)[0] - end) * side for pole in poles if pole.holds(curve)
    ]
    if any(abs(ahead) <= settings.radius for ahead in at_poles):
        return None  # it ends there
    best = None
    for number, station in enumerate(stations):
        if number == taken:
            continue
        if abs(math.sin(station.direction - curve.azimuth)) > math.sin(AHEAD_TURN):
            continue
        x, y = curve.local_place(station.position)
        ahead = (x - end) * side
        reach = min(settings.max_reach, REACH_SHARE * curve.length)
        back = min(settings.min_span, curve.length) / 2  # the other end is nearer beyond
        if abs(y) > settings.width / 2 or not -back < ahead < reach:
            continue
        if not station.may_hold(float(curve.fit.height(x))):
            continue
        if best is None or abs(ahead) < best[0]:
            best = (abs(ahead), number, x)
    return None if best is None else (best[1], best[2])


