# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Routes: which curves are one line, and the numbers of lines and spans."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.numerics.assignment import assign
from plc_inspect.core.numerics.disjoint_sets import find_root, unite
from plc_inspect.core.spans.layout import Layout
from plc_inspect.results import Float64

PARALLEL = math.radians(6.0)
"""
Conductors side by side, where no support is known, differ by less in azimuth.
Source: judgement; holds from 3 to 12 degrees on bench/constants.py.
"""
SAME_WAY = math.radians(20.0)
"""
Conductors of one span leave a support the same way: their azimuths differ by less.
Source: judgement; not measured.
"""
MIN_BESIDE = 0.5
"""
Conductors run side by side over more than this share of the shorter one.
Source: judgement; not measured.
"""
SIDE_BY_SIDE = 16.0
"""
Conductors of one span are this near to the next one [m].
Source: judgement; holds from 11.2 to 32 on bench/constants.py.
"""
LAYER_GAP = 0.8
"""
Conductors that follow one another in height by more than this hang in two layers [m].
Source: judgement; holds from 0.4 to 1.6 on bench/constants.py.
"""
MAX_SHIFT = 2.5
"""
Ends of one line at a support are this near; insulators lie between [m].
Source: judgement; holds from 1.25 to 5 on bench/constants.py.
"""


EAST = np.array([1.0, 0.0])
"""Unit vector along x of the map frame (REP-103)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """Line, span and orientation of each of C curves."""

    line_id: tuple[int, ...]
    span_id: tuple[int, ...]
    reverse: tuple[bool, ...]
    """True where the route runs from the curve's high x to its low x."""


def trace_routes(layout: Layout, east: Float64 = EAST) -> Route:
    """
    Find the span and the line that each curve belongs to.

    Curves that hang between the same supports, or side by side where no support is known, are
    one span.  Curves that meet at a support are one line.  Routes are numbered by their place,
    from the west; the result does not depend on the order of the curves.

    Parameters
    ----------
    layout : Layout
        Curves, and what they hang between.
    east : (2,) float64
        Unit vector in plan.

    Returns
    -------
    Route

    """
    num = len(layout.curves)
    group = _group_spans(layout)
    line = _chain_lines(layout, group)
    order, entry = _order_groups(layout, group, east)
    rank = {number: place for place, number in enumerate(order)}
    span_id = [rank[number] for number in group]
    reverse = []
    for curve in range(num):
        start = entry[group[curve]]
        at = layout.curves[curve].position(
            np.array([layout.start_x[curve], layout.end_x[curve]])
        )[:, :2]
        reverse.append(
            bool(np.linalg.norm(at[1] - start) < np.linalg.norm(at[0] - start))
        )
    keys: dict[int, tuple[float, ...]] = {}
    for span in sorted(set(span_id)):
        members = [curve for curve in range(num) if span_id[curve] == span]
        for curve, key in _order_across(layout, members, reverse).items():
            whole = (float(span), *key)
            keys[line[curve]] = min(keys.get(line[curve], whole), whole)
    number = {old: new for new, old in enumerate(sorted(keys, key=lambda item: keys[item]))}
    return Route(
        line_id=tuple(number[item] for item in line),
        span_id=tuple(span_id),
        reverse=tuple(reverse),
    )


def _order_across(
    layout: Layout, members: list[int], reverse: list[bool]
) -> dict[int, tuple[float, float]]:
    """Layer from the top, and place from left to right, of each conductor of one span."""
    middles = np.array(
        [
            layout.curves[curve].position((layout.start_x[curve] + layout.end_x[curve]) / 2)[0]
            for curve in members
        ]
    )
    azimuths = np.array(
        [layout.curves[curve].azimuth + (math.pi if reverse[curve] else 0.0) for curve in members]
    )
    azimuth = math.atan2(float(np.sin(azimuths).sum()), float(np.cos(azimuths).sum()))
    left = (middles[:, :2] - middles[:, :2].mean(axis=0)) @ np.array(
        [-math.sin(azimuth), math.cos(azimuth)]
    )
    order = np.argsort(-middles[:, 2], kind='stable')
    layer = np.empty(len(members))
    layer[order] = np.concatenate(
        [[0.0], np.cumsum(np.diff(middles[order, 2]) < -LAYER_GAP).astype(np.float64)]
    )
    return {
        curve: (float(layer[place]), -round(float(left[place]), 3))
        for place, curve in enumerate(members)
    }


def _place(position: Float64, east: Float64) -> tuple[float, float]:
    """How far east and north a place is [m]."""
    x, y = position[:2].tolist()
    return x * east[0] + y * east[1], y * east[0] - x * east[1]


def _end(layout: Layout, curve: int, side: int) -> Float64:
    x = layout.end_x[curve] if side > 0 else layout.start_x[curve]
    result: Float64 = layout.curves[curve].position(x)[0]
    return result


def _outward(curve: Curve, side: int) -> Float64:
    return side * np.array([math.cos(curve.azimuth), math.sin(curve.azimuth)])


def _ends_at(layout: Layout, station: int) -> list[tuple[int, int]]:
    """Curves and sides that end at a station."""
    ends = [(curve, 1) for curve, at in enumerate(layout.end_station) if at == station]
    return ends + [(curve, -1) for curve, at in enumerate(layout.start_station) if at == station]


def _group_spans(layout: Layout) -> list[int]:
    pairs = []
    for station in range(len(layout.stations)):
        ends = _ends_at(layout, station)
        outward = [_outward(layout.curves[curve], side) for curve, side in ends]
        for i in range(len(ends)):
            for k in range(i):
                if outward[i] @ outward[k] > math.cos(SAME_WAY):
                    pairs.append((ends[i][0], ends[k][0]))
    num = len(layout.curves)
    places = [
        curve.position(np.array(x))
        for curve, *x in zip(layout.curves, layout.start_x, layout.end_x, strict=True)
    ]
    for first in range(num):
        for second in range(first):
            if _side_by_side(layout, first, second, places[second]):
                pairs.append((first, second))
    return unite(pairs, num, [joint.curves for joint in layout.joints]).tolist()


def _side_by_side(layout: Layout, first: int, second: int, ends: Float64) -> bool:
    """Whether two curves run beside each other; ``ends`` (2, 3) are those of the second."""
    a, b = layout.curves[first], layout.curves[second]
    if abs(math.sin(a.azimuth - b.azimuth)) > math.sin(PARALLEL):
        return False
    known = [
        {layout.start_station[c], layout.end_station[c]} - {-1} for c in (first, second)
    ]
    if all(known) and not known[0] & known[1]:
        return False
    (x0, y0), (x1, y1) = (a.local_place(end) for end in ends)
    overlap = min(max(x0, x1), layout.end_x[first]) - max(min(x0, x1), layout.start_x[first])
    shorter = min(abs(x1 - x0), layout.end_x[first] - layout.start_x[first])
    return bool(overlap > MIN_BESIDE * shorter and abs(y0 + y1) / 2 < SIDE_BY_SIDE)


def _chain_lines(layout: Layout, group: Sequence[int]) -> list[int]:
    """Line of each curve; a line passes each span once, so joints are followed best first."""
    pairs = [joint.curves for joint in sorted(layout.joints, key=lambda joint: joint.cost)]
    taken = {
        end for joint in layout.joints for end in zip(joint.curves, joint.sides, strict=True)
    }
    for station in range(len(layout.stations)):
        free = [end for end in _ends_at(layout, station) if end not in taken]
        if len(free) < 2:
            continue
        axis = _outward(layout.curves[free[0][0]], free[0][1])
        before = [end for end in free if _outward(layout.curves[end[0]], end[1]) @ axis > 0]
        after = [end for end in free if end not in before]
        if not before or not after:
            continue
        cost = np.array(
            [
                [float(np.linalg.norm(_end(layout, *a) - _end(layout, *b))) for b in after]
                for a in before
            ]
        )
        pairs += [(before[i][0], after[j][0]) for i, j in assign(cost, MAX_SHIFT)]
    num = len(layout.curves)
    parent = np.arange(num)
    passed = [{number} for number in group]
    for pair in pairs:
        first, second = sorted(int(find_root(parent, item)) for item in pair)
        if first != second and not passed[first] & passed[second]:
            parent[second] = first
            passed[first] |= passed[second]
    return [int(find_root(parent, item)) for item in range(num)]


def _order_groups(
    layout: Layout, group: list[int], east: Float64
) -> tuple[list[int], dict[int, Float64]]:
    """Order the groups along their routes, and where each route enters a group."""
    members: dict[int, list[int]] = {}
    for curve, number in enumerate(group):
        members.setdefault(number, []).append(curve)
    stations: dict[int, set[int]] = {
        number: {
            at
            for curve in own
            for at in (layout.start_station[curve], layout.end_station[curve])
            if at >= 0
        }
        for number, own in members.items()
    }
    centers = {
        number: np.mean(
            [
                layout.curves[curve].position(
                    (layout.start_x[curve] + layout.end_x[curve]) / 2
                )[0, :2]
                for curve in own
            ],
            axis=0,
        )
        for number, own in members.items()
    }
    at_station: dict[int, list[int]] = {}
    for number, own in stations.items():
        for station in own:
            at_station.setdefault(station, []).append(number)

    def place(number: int) -> tuple[float, float]:
        return _place(centers[number], east)

    def is_end(number: int) -> bool:
        return sum(len(at_station[station]) > 1 for station in stations[number]) <= 1

    waiting = sorted(members, key=lambda number: (not is_end(number), *place(number)))
    order: list[int] = []
    entry: dict[int, Float64] = {}
    for first in waiting:
        if first in entry:
            continue
        entry[first] = _far_end(
            layout, members[first], stations[first], at_station, east
        )
        queue = deque([first])
        while queue:
            number = queue.popleft()
            order.append(number)
            nexts = []
            for station in sorted(stations[number]):
                for other in at_station[station]:
                    if other not in entry:
                        entry[other] = layout.stations[station].position
                        nexts.append(other)
            queue.extend(sorted(nexts, key=place))
    return order, entry


def _far_end(
    layout: Layout,
    members: list[int],
    stations: set[int],
    at_station: dict[int, list[int]],
    east: Float64,
) -> Float64:
    """Where a route begins: the end of its first group away from the next one."""
    curve = min(members, key=lambda item: _place(_end(layout, item, -1), east))
    ends = [_end(layout, curve, -1)[:2], _end(layout, curve, 1)[:2]]
    shared = [station for station in sorted(stations) if len(at_station[station]) > 1]
    if shared:
        away = layout.stations[shared[0]].position
        return max(ends, key=lambda end: float(np.linalg.norm(end - away)))
    return min(ends, key=lambda end: _place(end, east))
