# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Placement of supports: where they stand, and which points are theirs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.extraction.structures import (
    COLUMN,
    find_structure,
    MAX_BELOW,
    measure_from_lowest,
    Stand,
    Structure,
)
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.core.spans.attachments import (
    group_ends,
    mean_azimuth,
    measure_gap,
    SpanEnd,
)
from plc_inspect.core.spans.layout import Layout
from plc_inspect.core.spans.route import Route
from plc_inspect.core.spans.span_fit import CutCurve
from plc_inspect.core.spans.support_points import (
    are_held,
    find_mean_direction,
    goes_on,
    list_structure,
    mark_guys,
    mark_stub,
)
from plc_inspect.results import Bool, Float64, Support

SAME_WAY = math.radians(45.0)
"""Ends at one support that point the same way differ by less in azimuth.
Source: judgement; holds from 22.5 to 90 degrees on bench/constants.py."""
ARM_SCATTER = 0.12
"""Standard deviation of where a conductor's points give way to those of its arm [m].
Source: judgement; holds from 0.06 to 0.24 on bench/constants.py."""
MIN_TOWER = 3.0
"""Three and more conductors that end within less than this hang on a pole [m].
Source: judgement; holds from 1.5 to 6 on bench/constants.py."""
SAME_PLACE, SAME_HEIGHT = 1.0, 3.0
"""Supports this near in plan and in height are one [m].
Source: judgement; holds from 0.5 to 2 and from 1.5 to 6 on bench/constants.py."""
POLE_ENDS = 3
"""Fewer conductors may hang on a pole, and what is not seen there is taken for one.
Source: judgement; not measured."""
FEW_REACH, MANY_REACH = 2.5, 4.0
"""A structure is looked for this far from the middle of few, and of more ends [m].
Source: judgement; not measured."""
MAX_SHIFT = 1.5
"""A tower stands at most this far along the line from the middle of its ends [m].
Source: judgement; not measured."""
INWARD_PARTS = 4
"""A pole shortens a conductor by at most one of this many parts.
Source: judgement; not measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Standing:
    """A place where conductors end together."""

    position: Float64
    """(2,) plan position [m]."""
    ends: list[SpanEnd]
    is_open: bool = False
    """No conductor was found to go on from there."""
    structure: Structure | None = None
    """What was found there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Placed:
    """A support before it has its number."""

    span_ids: tuple[int, int]
    """Least and greatest span that ends there."""
    line_ids: tuple[int, ...]
    position: Float64
    """(3,) foot [m]."""
    height: float
    kind: str

    @property
    def order(self) -> tuple[Any, ...]:
        """Along the route, then by line and place."""
        return sum(self.span_ids), self.line_ids, *self.position


def place_supports(
    cloud: OffGround,
    wire: Bool,
    layout: Layout,
    route: Route,
    finals: Sequence[CutCurve],
    end_sigma: Float64,
    kept: Sequence[int],
) -> tuple[tuple[Support, ...], Bool, dict[tuple[int, int], tuple[float, float]]]:
    """
    Place the supports of all stations and of the open ends at which a structure stands.

    Parameters
    ----------
    cloud : OffGround
        N points off the ground.
    wire : (N,) bool
        Points of conductors.
    layout, route, finals : Layout, Route, sequence of CutCurve
        C curves, what they belong to, and for each the final one.
    end_sigma : (C, 2) float64
        Standard deviation of the place of the low and the high end along the curve [m], 0 where
        it is not at a station.
    kept : sequence of int
        Curves that are spans; the others hang on nothing.

    Returns
    -------
    supports : tuple of Support
    mask : (N,) bool
        Their points.
    closed : dict
        For ends at a pole, and open ends that proved to be at a support, as curve and side: how
        far beyond its end so far it hangs, and the standard deviation of that [m].

    """
    mask = np.zeros(len(cloud.points), dtype=bool)
    closed: dict[tuple[int, int], tuple[float, float]] = {}
    ends = [
        SpanEnd(
            number=number, side=side, azimuth=finals[number].curve.azimuth,
            place=finals[number].curve.position(x)[0],
        )
        for number in kept for side, x in ((-1, finals[number].low), (1, finals[number].high))
    ]

    # Ends at one station hang together; open ends do where they lie side by side.
    stations = [layout.start_station, layout.end_station]
    at = [int(stations[(end.side + 1) // 2][end.number]) for end in ends]
    found = []
    for station, record in enumerate(layout.stations):
        members = [end for end, own in zip(ends, at, strict=True) if own == station]
        if members:
            found.append(Standing(position=record.position, ends=members))
    opened = [end for end, own in zip(ends, at, strict=True) if own < 0]
    for members in group_ends(opened):
        position = np.mean([end.place[:2] for end in members], axis=0)
        found.append(Standing(position=position, ends=members, is_open=True))

    # What stands there decides whether it is a support, and where the conductors end.
    structures = call_each(lambda k: _look_for_structure(cloud, wire, found[k]), len(found))
    standing = [
        replace(item, structure=own) for item, own in zip(found, structures, strict=True)
    ]
    placed = []
    for item in _unite(standing):
        is_open = [stations[(end.side + 1) // 2][end.number] < 0 for end in item.ends]
        if all(is_open) and not _is_held_up(cloud, wire, item, finals):
            continue
        if item.structure is not None and item.structure.kind == 'pole':
            closed |= _reach_pole(item.ends, item.structure, finals, end_sigma)
        else:
            own = [end for end, mine in zip(item.ends, is_open, strict=True) if mine]
            closed |= _reach_support(own, finals)
        placed.append(_place(cloud, wire, item, route, mask))
    placed.sort(key=lambda support: support.order)
    supports = tuple(
        Support(support_id=number, position=support.position, height=support.height,
                kind=support.kind, line_ids=support.line_ids)
        for number, support in enumerate(placed)
    )
    return supports, mask, closed


def _is_held_up(
    cloud: OffGround, wire: Bool, item: Standing, finals: Sequence[CutCurve]
) -> bool:
    """Tell whether open ends are at a support and did not just leave the cloud."""
    if item.structure is not None and item.structure.kind == 'pole':
        return True
    if len(item.ends) == 1:
        return False
    places = np.array([end.place for end in item.ends])
    outward = np.array([end.outward for end in item.ends])
    if not goes_on(cloud, wire, places, outward, measure_gap(item.ends, finals)):
        return False
    is_tower = item.structure is not None and item.structure.top > places[:, 2].max() - MAX_BELOW
    return is_tower or are_held(cloud.points, cloud.index, wire, places)


def _place(cloud: OffGround, wire: Bool, item: Standing, route: Route, mask: Bool) -> _Placed:
    """Describe one support, and mark its points in the mask."""
    azimuth, structure = mean_azimuth(item.ends), item.structure
    attachments = np.array([end.place for end in item.ends])
    place = _settle(item.position, structure, azimuth)
    foot = float(cloud.height.ground.at(place[None, :])[0])
    top = float(attachments[:, 2].max())
    kind = 'pole' if len(item.ends) < POLE_ENDS else None
    if structure is not None:
        top, kind = max(top, structure.top), structure.kind
    own = list_structure(cloud.points, cloud.index, wire, place, azimuth, attachments, kind)
    reached = cloud.points[own[~wire[own]], 2].max(initial=-math.inf)
    # a tree or a house below the ends holds nothing
    if structure is not None or reached >= float(attachments[:, 2].min()) - MAX_BELOW:
        mask[own] = True
    for end in item.ends:
        mark_stub(cloud.points, cloud.index, end.place, end.outward, mask)
    foot = foot if math.isfinite(foot) else float(attachments[:, 2].min())
    if kind == 'pole' and structure is not None:
        mark_guys(cloud, wire, np.array([*place, foot]), top, mask)
    span_ids = [route.span_id[end.number] for end in item.ends]
    return _Placed(
        span_ids=(min(span_ids), max(span_ids)),
        line_ids=tuple(sorted({route.line_id[end.number] for end in item.ends})),
        position=np.array([place[0], place[1], foot]),
        height=top - foot,
        kind=structure.kind if structure is not None else 'unseen',
    )


def _look_for_structure(cloud: OffGround, wire: Bool, item: Standing) -> Structure | None:
    """Find what stands at the ends of conductors, or a pole ahead of ends that are open."""
    reach = FEW_REACH if len(item.ends) < POLE_ENDS else MANY_REACH
    found = _find_structure(cloud, wire, item, item.position, reach) or _find_masts(
        cloud, wire, item
    )
    if found is None and item.is_open and len(_group_ways(item.ends)) == 1:
        ahead = reach * find_mean_direction(np.array([end.outward for end in item.ends]))
        found = _find_structure(cloud, wire, item, item.position + ahead, reach, ahead=True)
    return found


def _find_masts(cloud: OffGround, wire: Bool, item: Standing) -> Structure | None:
    """Find a tower on two masts, such as a portal, of which each holds a conductor."""
    found: list[Structure] = []
    for end in item.ends:
        mast = _find_structure(cloud, wire, replace(item, ends=[end]), end.place[:2], FEW_REACH)
        if mast is not None:
            found.append(mast)
    places = np.array([mast.position for mast in found]).reshape(-1, 2)
    if not len(places) or np.linalg.norm(places - places[0], axis=1).max() <= MIN_TOWER:
        return None
    return Structure(
        position=places.mean(axis=0), top=max(mast.top for mast in found), kind='tower'
    )


def _find_structure(
    cloud: OffGround, wire: Bool, item: Standing, near: Float64, reach: float, *,
    ahead: bool = False,
) -> Structure | None:
    """Find what reaches up to the ends of conductors."""
    base = float(cloud.height.ground.at(near[None, :], max_gap=reach)[0])
    height, lowest, is_whole = cloud.height.height, cloud.least, math.isfinite(base)
    if not is_whole:
        base, height = measure_from_lowest(cloud.points, cloud.index, wire, near, reach)
        lowest = 0.0
    if not math.isfinite(base):
        return None
    attachment = np.array([end.place[2] for end in item.ends])
    azimuth = mean_azimuth(item.ends)
    across = [end.place[:2] @ (-math.sin(azimuth), math.cos(azimuth)) for end in item.ends]
    few, is_wide = len(item.ends) < POLE_ENDS, float(np.ptp(across)) > MIN_TOWER
    structure = find_structure(cloud.points, height, cloud.index, wire, Stand(
        near=near,
        azimuth=azimuth,
        reach=reach,
        attachment=float(attachment.min()) - base,
        top=float(attachment.max()) - base,
        lowest=lowest,
        may_be_tower=not ahead and (few or is_wide), is_told=not ahead,
    ))
    if structure is not None and structure.top < float(attachment.min()) - MAX_BELOW:
        return None  # a tree below does not hold them
    if structure is not None and not is_whole and is_wide and not few:
        return replace(structure, kind='tower')  # of which the head alone was seen
    return structure


def _unite(standing: Sequence[Standing]) -> list[Standing]:
    """Make one support of all that hang on one pole, or at one place."""
    united: list[Standing] = []
    for item in standing:
        for number, other in enumerate(united):
            if _is_same(other, item):
                united[number] = replace(
                    other, ends=other.ends + item.ends,
                    structure=item.structure if other.structure is None else other.structure,
                )
                break
        else:
            united.append(item)
    return united


def _is_same(first: Standing, second: Standing) -> bool:
    poles = [
        item.structure.position for item in (first, second)
        if item.structure is not None and item.structure.kind == 'pole'
    ]
    if len(poles) == 2:
        return math.dist(*poles) <= COLUMN
    heights = [[end.place[2] for end in item.ends] for item in (first, second)]
    return (
        math.dist(first.position, second.position) <= SAME_PLACE
        and max(map(min, heights)) - min(map(max, heights)) <= SAME_HEIGHT
    )


def _reach_pole(
    ends: Sequence[SpanEnd], pole: Structure, finals: Sequence[CutCurve], end_sigma: Float64
) -> dict[tuple[int, int], tuple[float, float]]:
    """How far beyond, or before, their ends so far conductors hang that end at a pole."""
    closed = {}
    for end in ends:
        beyond = float((pole.position - end.place[:2]) @ end.outward)
        cut = finals[end.number]
        # a pole farther inside is not where it ends
        beyond = max(beyond, (cut.low - cut.high) / INWARD_PARTS)
        own = float(end_sigma[end.number, (end.side + 1) // 2])  # of the meeting of curves
        share = own**2 / (own**2 + ARM_SCATTER**2) if own > 0.0 else 1.0
        closed[end.number, end.side] = share * beyond, math.sqrt(share) * ARM_SCATTER
    return closed


def _reach_support(
    ends: Sequence[SpanEnd], finals: Sequence[CutCurve]
) -> dict[tuple[int, int], tuple[float, float]]:
    """
    How far beyond their last points conductors hang that end side by side.

    All are seen up to about a point's spacing before their support, so the farthest of those
    that leave it the same way tells most.
    """
    closed = {}
    for group in _group_ways(ends):
        units = np.array([end.outward for end in group])
        outward = find_mean_direction(units)
        along = np.array([end.place[:2] for end in group]) @ outward
        gap = measure_gap(group, finals)
        beyond = (along.max() + gap - along) / (units @ outward)
        for end, more in zip(group, beyond, strict=True):
            closed[end.number, end.side] = float(more), math.hypot(gap, ARM_SCATTER)
    return closed


def _group_ways(ends: Sequence[SpanEnd]) -> list[list[SpanEnd]]:
    """Group the ends of one support by the way they point."""
    groups: list[list[SpanEnd]] = []
    for end in ends:
        for group in groups:
            if float(end.outward @ group[0].outward) >= math.cos(SAME_WAY):
                group.append(end)
                break
        else:
            groups.append([end])
    return groups


def _settle(position: Float64, structure: Structure | None, azimuth: float) -> Float64:
    """Plan position of a support: its pole, or along the line its tower's points."""
    if structure is None:
        return position
    if structure.kind == 'pole':
        return structure.position
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    along = float((structure.position - position) @ unit)
    return position + unit * min(max(along, -MAX_SHIFT), MAX_SHIFT)
