# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Causes of alarms: critical hazards and the keep-out; and the height of the vehicle."""

from collections.abc import Mapping, Sequence
import math
import statistics
from types import MappingProxyType

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.alarms import Cause
from plc_inspect.monitor.picture.cloud_store import CloudStore
from plc_inspect.monitor.picture.names import name_conductor
from plc_inspect.monitor.picture.picture import HazardItem, Place, SpanItem, SupportItem
from plc_inspect.results import Severity
from plc_inspect.stream.nearness import Nearness
from plc_inspect.stream.summary import Status

GROUND_REACH = 8.0
"""
Ground cells within this distance of the vehicle in plan give its height [m].
Source: judgement: half the height at which corridors are flown, as the lidar sees little of what
is straight below it.
"""


FEET_REACH = 120.0
"""
Feet of structures and ground below conductors within this distance give an estimate of it [m].
Source: judgement: half a span of high voltage.
"""
LEAST_WAY = 1.0
"""
Less than this to the side or in height is not named [m].
Source: judgement: the accuracy with which somebody looks.
"""
COMPASS = ('north', 'north-east', 'east', 'south-east', 'south', 'south-west', 'west',
           'north-west')
"""Directions by eighths of a turn from north, the y axis of the map."""
LEAST_FEET, MOST_FEET = 3, 7
"""
Least number of them needed, and most used.
Source: judgement: one that is wrong changes little.
"""


def list_causes(
    hazards: Sequence[HazardItem], stretches: Mapping[tuple[int, int], str], status: Status
) -> dict[str, Cause]:
    """Return the present causes of alarms, by key; with names of spans by line and span."""
    held = '; held back, as told last' if status.held else ''
    causes = {
        f'hazard {item.hazard_id}': Cause(
            text=describe_hazard(item, stretches) + held, place=item.position,
            hazard_id=item.hazard_id, kind=item.kind,
        )
        for item in hazards if item.severity >= Severity.CRITICAL
    }
    for near in status.near:
        if near.level == Level.CRITICAL:
            causes[f'keep-out {name_thing(near.thing)}'] = Cause(
                text=f'keep-out: {describe_nearness(near, stretches)}',
                place=locate(near, status.vehicle), distance=near.distance,
                fixed=near.thing != Thing.CONDUCTOR,
            )
    return causes


def describe_hazard(item: HazardItem, stretches: Mapping[tuple[int, int], str]) -> str:
    """Return a hazard in one line; with names of spans by line and span."""
    where = _name_span(item.line_id, item.span_id, stretches)
    needs = '' if math.isnan(item.required) else f', {item.required:.2f} m required'
    return (f'hazard {item.hazard_id}, {item.kind}: {item.clearance:.2f} m{needs}{where}')


def describe_nearness(
    near: Nearness, stretches: Mapping[tuple[int, int], str] = MappingProxyType({})
) -> str:
    """Return what is near in one line; with names of spans by line and span."""
    if math.isnan(near.distance):
        return f'{name_thing(near.thing)}: none known'
    text = f'{name_thing(near.thing)} {near.distance:.1f} m from the vehicle'
    if near.level == Level.CRITICAL and not math.isnan(near.limit):
        text += f', {near.limit:.1f} m required'
    text += _name_way(near.way)
    if near.thing == Thing.CONDUCTOR:
        text += _name_span(near.line_id, near.span_id, stretches)
    return text


def _name_way(way: Place) -> str:
    """Return the way from the vehicle by compass and height, '' where it is not known."""
    if not all(map(math.isfinite, way)):
        return ''
    east, north, up = way
    flat = math.hypot(east, north)
    words = []
    if flat >= LEAST_WAY:
        turn = round(math.degrees(math.atan2(east, north)) / 45.0) % 8
        words.append(COMPASS[turn])
    if abs(up) >= LEAST_WAY:
        words.append(f'{abs(up):.0f} m {"above" if up > 0.0 else "below"}')
    return ''.join(f', {word}' for word in words)


def _name_span(
    line_id: int, span_id: int, stretches: Mapping[tuple[int, int], str]
) -> str:
    """Return span and conductor; numbers below 0 are not confirmed yet."""
    names = []
    if (line_id, span_id) in stretches or span_id >= 0:
        names.append(stretches.get((line_id, span_id), f'span {span_id}'))
    if line_id >= 0:
        names.append(name_conductor(line_id))
    return f'; {", ".join(names)}' if names else ''


def locate(near: Nearness, vehicle: Place | None) -> Place | None:
    """Return where the nearest thing is [m], None where that is not known."""
    if vehicle is None or not all(map(math.isfinite, near.way)):
        return None
    return vehicle[0] + near.way[0], vehicle[1] + near.way[1], vehicle[2] + near.way[2]


def name_thing(thing: Thing) -> str:
    """Return the crew's word for a thing."""
    return {Thing.SUPPORT: 'structure'}.get(thing, thing.name.lower())


def list_ground(
    span: SpanItem, structures: Sequence[SupportItem | None] = (None, None)
) -> list[Place]:
    """Return known points of the ground below a span [m]: at its two structures, and below it."""
    places = [None if item is None else item.position for item in structures]
    x, y, z = span.lowest
    below = [] if math.isnan(span.ground_clearance) else [(x, y, z - span.ground_clearance)]
    first, last = ([place] if place else [] for place in places)
    return [*first, *below, *last]


def find_height(
    vehicle: Place | None, cloud: CloudStore, spans: Sequence[SpanItem],
    supports: Sequence[SupportItem],
) -> float:
    """
    Return the height of the vehicle above the ground [m], NaN unknown.

    If the corridor holds no ground below it, the height is estimated from the median of the
    nearest feet of structures and ground points below conductors, as plants may hide a foot.
    """
    if vehicle is None:
        return math.nan
    x, y, z = vehicle
    ground = cloud.find_ground(x, y, GROUND_REACH)
    if not math.isnan(ground):
        return z - ground
    known = [item.position for item in supports if item.kind != 'unseen']
    known += [place for span in spans for place in list_ground(span)]
    near = sorted((apart, place[2]) for place in known
                  if (apart := math.dist(place[:2], (x, y))) <= FEET_REACH)[:MOST_FEET]
    if len(near) < LEAST_FEET:
        return math.nan
    return z - statistics.median(height for _, height in near)
