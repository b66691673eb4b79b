# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Placement of supports: where they stand, and which points are theirs."""

from collections.abc import Sequence
import math

from numba import njit
import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.extraction.height import ground_at, HeightResult
from plc_inspect.core.numerics.plan_index import gather_strip, PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.core.spans.layout import Layout
from plc_inspect.core.spans.route import Route, SIDE_BY_SIDE
from plc_inspect.core.spans.structures import COLUMN, find_structure, Structure
from plc_inspect.core.spans.support_points import mark_structure, mark_stub
from plc_inspect.results import Bool, Float64, Support

TERMINAL_SPREAD = 2.5
"""Open ends this near along the line end at one support [m]."""
SAME_WAY = math.radians(45.0)
"""Ends at one support that point the same way differ by less in azimuth."""
END_SCATTER = 0.05
"""Standard deviation along the line of where conductors hang from one support [m]."""
ARM_SCATTER = 0.12
"""And of where the points of a conductor give way to those of the arm it ends at [m]."""
MAX_BELOW = 0.7
"""The top of a support lies at most this far below the lowest conductor it holds [m]."""
MIN_TOWER = 3.0
"""Three and more conductors that end within less than this hang on a pole [m]."""
HOLD_RADIUS = 3.0
HOLD_POINTS = 3
"""Insulators and arms leave this many points within HOLD_RADIUS of a conductor's end [m]."""
BEYOND = 5.0
"""The cloud must go on this far beyond a conductor that ends at a support [m]."""
SAME_PLACE, SAME_HEIGHT = 1.0, 3.0
"""Supports this near in plan and in height are one [m]."""

Standing = tuple[Float64, list[tuple[int, int, Float64]], Structure | None]
"""Plan position of a support, the ends that it holds, and what was found there."""


def place_supports(
    points: Float64,
    height: HeightResult,
    index: PlanIndex,
    wire: Bool,
    layout: Layout,
    route: Route,
    finals: Sequence[tuple[Curve, float, float]],
    end_sigma: Float64,
) -> tuple[tuple[Support, ...], Bool, dict[tuple[int, int], tuple[float, float]]]:
    """
    Place the supports of all stations and of the open ends at which a structure stands.

    Parameters
    ----------
    points : (N, 3) float64
        Points off the ground [m].
    height : HeightResult
        Of these points.
    index : PlanIndex
        Searched.
    wire : (N,) bool
        Points of conductors.
    layout, route : Layout, Route
        C curves, and what they belong to.
    finals : sequence of (Curve, float, float)
        For each curve of the layout the final one, and the x of its ends [m].
    end_sigma : (C, 2) float64
        Standard deviation of the place of the low and the high end along the curve [m], 0 where
        it is not at a station.

    Returns
    -------
    supports : tuple of Support
    mask : (N,) bool
        Their points.
    closed : dict
        For ends at a pole, and open ends that proved to be at a support, as curve and side: how
        far beyond its end so far it hangs, and the standard deviation of that [m].

    """
    mask = np.zeros(len(points), dtype=bool)
    found = []
    closed: dict[tuple[int, int], tuple[float, float]] = {}
    ends = [
        (number, side, curve.position(high if side > 0 else low)[0])
        for number, (curve, low, high) in enumerate(finals)
        for side in (-1, 1)
    ]
    stations = [layout.start_station, layout.end_station]
    for station, record in enumerate(layout.stations):
        members = [end for end in ends if stations[(end[1] + 1) // 2][end[0]] == station]
        if not members:
            continue
        found.append((record.position, members))
    opened = [end for end in ends if stations[(end[1] + 1) // 2][end[0]] < 0]
    for members in _group_ends(opened, finals):
        found.append((np.mean([end[2][:2] for end in members], axis=0), members))
    supports = []
    structures = call_each(
        lambda k: _find_structure(points, height, index, wire, *found[k], finals), len(found)
    )
    standing = [(*place, item) for place, item in zip(found, structures, strict=True)]
    for position, members, structure in _unite(standing):
        is_open = [stations[(side + 1) // 2][number] < 0 for number, side, _ in members]
        attachments = np.array([end[2] for end in members])
        is_pole = structure is not None and structure.kind == 'pole'
        held = len(members) > 1 and (
            structure is not None
            or _are_held(points, height, index, wire, members, finals)
        )
        if all(is_open) and not is_pole and not held:
            continue
        if structure is not None and is_pole:
            closed |= _reach_pole(members, structure, finals, end_sigma)
        else:
            own = [end for end, mine in zip(members, is_open, strict=True) if mine]
            closed |= _reach_support(own, finals)
        azimuth = _mean_azimuth(members, finals)
        place = _settle(position, structure, azimuth)
        foot = float(ground_at(height, place[None, :])[0])
        top = float(attachments[:, 2].max())
        if structure is not None:
            top = max(top, structure.top)
        mark_structure(
            points,
            index,
            place,
            azimuth,
            attachments,
            structure.kind == 'pole' if structure is not None else len(members) < 3,
            mask,
        )
        for end in members:
            mark_stub(points, index, end[2], _outward(end, finals), mask)
        if not math.isfinite(foot):
            foot = float(attachments[:, 2].min())
        supports.append(
            (
                min(route.span_id[end[0]] for end in members),
                max(route.span_id[end[0]] for end in members),
                tuple(sorted({route.line_id[end[0]] for end in members})),
                np.array([place[0], place[1], foot]),
                top - foot,
                structure.kind if structure is not None else 'unseen',
            )
        )
    supports.sort(key=lambda item: (item[0] + item[1], item[2], *item[3]))
    return (
        tuple(
            Support(support_id=number, position=place, height=tall, kind=kind, line_ids=lines)
            for number, (_, _, lines, place, tall, kind) in enumerate(supports)
        ),
        mask,
        closed,
    )


def _find_structure(
    points: Float64,
    height: HeightResult,
    index: PlanIndex,
    wire: Bool,
    position: Float64,
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> Structure | None:
    """Find what stands at the ends of conductors and reaches up to them."""
    base = float(ground_at(height, position[None, :])[0])
    if not math.isfinite(base):
        return None
    attachment = np.array([end[2][2] for end in members])
    azimuth = _mean_azimuth(members, finals)
    across = [end[2][:2] @ (-math.sin(azimuth), math.cos(azimuth)) for end in members]
    structure = find_structure(
        points,
        height.height,
        index,
        wire,
        position,
        azimuth,
        2.5 if len(members) < 3 else 4.0,
        float(attachment.min()) - base,
        float(attachment.max()) - base,
        len(members) < 3 or float(np.ptp(across)) > MIN_TOWER,
    )
    if structure is not None and structure.top < float(attachment.min()) - MAX_BELOW:
        return None  # a tree below does not hold them
    return structure


def _unite(standing: Sequence[Standing]) -> list[Standing]:
    """Make one support of all that hang on one pole, or at one place."""
    united: list[Standing] = []
    for item in standing:
        for number, other in enumerate(united):
            if _is_same(other, item):
                structure = item[2] if other[2] is None else other[2]
                united[number] = (other[0], other[1] + item[1], structure)
                break
        else:
            united.append(item)
    return united


def _is_same(first: Standing, second: Standing) -> bool:
    poles = [
        item.position for _, _, item in (first, second)
        if item is not None and item.kind == 'pole'
    ]
    if len(poles) == 2:
        return math.dist(*poles) <= COLUMN
    heights = [[end[2][2] for end in members] for _, members, _ in (first, second)]
    return (
        math.dist(first[0], second[0]) <= SAME_PLACE
        and max(map(min, heights)) - min(map(max, heights)) <= SAME_HEIGHT
    )


def _group_ends(
    ends: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> list[list[tuple[int, int, Float64]]]:
    """Open ends that lie side by side across their line."""
    groups: list[list[tuple[int, int, Float64]]] = []
    for end in ends:
        azimuth = finals[end[0]][0].azimuth
        unit = np.array([math.cos(azimuth), math.sin(azimuth)])
        for group in groups:
            apart = np.array([other[2][:2] - end[2][:2] for other in group])
            if (
                np.abs(apart @ unit).max() <= TERMINAL_SPREAD
                and np.linalg.norm(apart, axis=1).min() <= SIDE_BY_SIDE
            ):
                group.append(end)
                break
        else:
            groups.append([end])
    return groups


def _reach_pole(
    members: Sequence[tuple[int, int, Float64]],
    pole: Structure,
    finals: Sequence[tuple[Curve, float, float]],
    end_sigma: Float64,
) -> dict[tuple[int, int], tuple[float, float]]:
    """How far beyond, or before, their ends so far conductors hang that end at a pole."""
    closed = {}
    for number, side, end in members:
        beyond = float((pole.position - end[:2]) @ _outward((number, side, end), finals))
        _, low, high = finals[number]
        beyond = max(beyond, (low - high) / 4)  # a pole farther inside is not where it ends
        own = float(end_sigma[number, (side + 1) // 2])  # of the meeting of curves, 0 if none
        share = own**2 / (own**2 + ARM_SCATTER**2) if own > 0.0 else 1.0
        closed[number, side] = share * beyond, math.sqrt(share) * ARM_SCATTER
    return closed


def _reach_support(
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> dict[tuple[int, int], tuple[float, float]]:
    """
    How far beyond their last points conductors hang that end side by side.

    All are seen up to about a point's spacing before their support, so the farthest of those
    that leave it the same way tells most.
    """
    closed = {}
    for group in _group_ways(members, finals):
        units = np.array([_outward(end, finals) for end in group])
        outward = units.mean(axis=0)
        outward /= np.linalg.norm(outward)
        along = np.array([end[2][:2] for end in group]) @ outward
        curves = [finals[number][0] for number, _, _ in group]
        spacing = np.mean([curve.length / max(curve.num_points, 1) for curve in curves])
        gap = float(spacing) / len(group)
        beyond = (along.max() + gap - along) / (units @ outward)
        for (number, side, _), more in zip(group, beyond, strict=True):
            closed[number, side] = float(more), math.hypot(gap, ARM_SCATTER)
    return closed


def _group_ways(
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> list[list[tuple[int, int, Float64]]]:
    """Group the ends of one support by the way they point."""
    groups: list[list[tuple[int, int, Float64]]] = []
    for end in members:
        unit = _outward(end, finals)
        for group in groups:
            if float(unit @ _outward(group[0], finals)) >= math.cos(SAME_WAY):
                group.append(end)
                break
        else:
            groups.append([end])
    return groups


def _outward(
    end: tuple[int, int, Float64], finals: Sequence[tuple[Curve, float, float]]
) -> Float64:
    """Return the (2,) plan direction in which a conductor would go on beyond an end."""
    azimuth = finals[end[0]][0].azimuth
    return end[1] * np.array([math.cos(azimuth), math.sin(azimuth)])


def _are_held(
    points: Float64,
    height: HeightResult,
    index: PlanIndex,
    wire: Bool,
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> bool:
    """Tell conductors that end at arms or insulators from those that leave the cloud."""
    held = 0
    for number, side, end in members:
        ahead = (end[:2] + BEYOND * _outward((number, side, end), finals))[None, :]
        if not math.isfinite(float(ground_at(height, ahead, max_gap=BEYOND)[0])):
            return False
        found = gather_strip(
            index.start, index.order, index.origin, index.cell_size, index.shape[0],
            index.shape[1], end[0], end[1], end[0], end[1], HOLD_RADIUS,
        )
        held += _count_around(points, wire, found, end) >= HOLD_POINTS
    low = height.origin
    high = low + height.cell_size * np.array(height.ground.shape[::-1])
    inside = all(
        ((end[:2] > low + BEYOND) & (end[:2] < high - BEYOND)).all() for _, _, end in members
    )
    return inside and 2 * held >= len(members)


@njit(cache=True, nogil=True)
def _count_around(points, wire, found, end):  # type: ignore[no-untyped-def]
    """How many of the points found are within HOLD_RADIUS of the end and no conductor's."""
    count = 0
    for i in found:
        apart = (points[i, 0] - end[0]) ** 2 + (points[i, 1] - end[1]) ** 2
        apart += (points[i, 2] - end[2]) ** 2
        count += apart <= HOLD_RADIUS**2 and not wire[i]
    return count


def _mean_azimuth(
    members: Sequence[tuple[int, int, Float64]],
    finals: Sequence[tuple[Curve, float, float]],
) -> float:
    """Azimuth of the line at a support, half way between both sides of an angle."""
    doubled = np.array([2 * finals[number][0].azimuth for number, _, _ in members])
    return 0.5 * math.atan2(float(np.sin(doubled).sum()), float(np.cos(doubled).sum()))


def _settle(position: Float64, structure: Structure | None, azimuth: float) -> Float64:
    """Plan position of a support: its pole, or along the line its tower's points."""
    if structure is None:
        return position
    if structure.kind == 'pole':
        return structure.position
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    along = float((structure.position - position) @ unit)
    return position + unit * min(max(along, -1.5), 1.5)
