# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The picture as the parts of the page: plain values under the names that the page uses."""

from collections.abc import Container, Mapping, Sequence
import math
import time
from typing import Any

from plc_inspect.core.live.proximity import Level, Thing
from plc_inspect.monitor.picture.alarms import Alarm
from plc_inspect.monitor.picture.causes import describe_nearness, list_ground, locate, name_thing
from plc_inspect.monitor.picture.condition import Condition, judge
from plc_inspect.monitor.picture.names import find_structures, name_conductor, name_stretches
from plc_inspect.monitor.picture.picture import (
    format_age,
    HazardItem,
    Link,
    name_severity,
    Picture,
    SpanItem,
    STALE,
    SupportItem,
)
from plc_inspect.monitor.replay.replay import Replay

MOST_EVENTS, MOST_PAST, MOST_TRACK = 40, 30, 300
"""Most events, past alarms and track places on the page."""
Rows = dict[str, list[tuple[str, object]]]
"""Rows of tables by their names: key and value, worst first."""
TONES = {
    Level.UNKNOWN: 'notice', Level.CLEAR: 'ok', Level.WARNING: 'warning',
    Level.CRITICAL: 'critical',
}
"""Severity with which each proximity level is drawn."""
HEALTH = {
    'scan rate': ('scan_rate', '{:.1f} Hz'), 'scans': ('scans', '{:.0f}'),
    'scans lost': ('scans_lost', '{:.0f}'), 'scans dropped': ('scans_dropped', '{:.0f}'),
    'pose gaps': ('pose_gaps', '{:.0f}'), 'pose jumps': ('pose_jumps', '{:.0f}'),
    'last scan': ('scan_age', '{:.1f} s ago'), 'last pose': ('odometry_age', '{:.1f} s ago'),
    'sharpness of the map (0.5 at least)': ('sharpness', '{:.2f}'),
    'last result took': ('tick_ms', '{:.0f} ms'),
    'results postponed': ('ticks_postponed', '{:.0f}'), 'map': ('voxels', '{:.0f} voxels'),
    'memory': ('memory_mb', '{:.0f} MB'), 'callbacks, 99 of 100 within': ('callback_ms',
                                                                         '{:.1f} ms'),
}
"""Health figures: name on the page to name in the summary and format."""


def make_parts(picture: Picture, name: str, wall: float) -> dict[str, Any]:
    """
    Return all parts of the page but tables, track and corridor.

    Parameters
    ----------
    picture : Picture
        What is known.
    name : str
        Of the node.
    wall : float
        Time of day when the monitor's steady time was 0 [s since 1970].

    Returns
    -------
    dict
        JSON values by part; lengths in metres, None where there is no number.

    """
    condition = judge(picture, name)
    return {
        'state': _make_state(picture, condition, name) | {'wall': round(wall + picture.time, 1)},
        'alarms': [_make_alarm(item, wall) for item in picture.alarms],
        'past': [_make_alarm(item, wall) for item in picture.past_alarms[:MOST_PAST]],
        'health': _make_health(picture),
        'events': [
            {'time': round(wall + item.time, 1), 'level': item.level, 'text': item.text}
            for item in picture.events[: -MOST_EVENTS - 1 : -1]
        ],
    }


def make_rows(picture: Picture) -> Rows:
    """Return hazards, structures and spans, in the order in which they are sent."""
    stretches = name_stretches(picture.spans, picture.supports)
    known = {item.support_id for item in picture.supports}
    return {
        'hazards': [
            (str(item.hazard_id), _make_hazard(item, stretches, known))
            for item in picture.hazards
        ],
        'supports': [
            (str(item.support_id), {
                'id': item.support_id, 'kind': item.kind, 'height': _round(item.height),
                'position': _place(item.position),
            })
            for item in picture.supports
        ],
        'spans': [
            (f'{item.line_id}/{item.span_id}', _make_span(item, stretches, structures))
            for item, structures in zip(
                picture.spans, find_structures(picture.spans, picture.supports), strict=True
            )
        ],
    }


def make_fleet_row(name: str, picture: Picture) -> dict[str, Any]:
    """Return the row of a vehicle in the list of all vehicles."""
    condition = judge(picture, name)
    return {
        'name': name, 'heard': picture.link is not Link.WAITING,
        'tone': condition.tone, 'text': condition.text.partition(':')[0],
        'critical': picture.count_severities()['critical'],
        'unseen': sum(not item.seen for item in picture.alarms),
        'new': sum(item.state == 'new' for item in picture.alarms),
    }


def make_replay(state: Mapping[str, Any], replay: Replay) -> dict[str, Any]:
    """Return the additional parts of a replay; its state differs from every live one."""
    now = time.monotonic()  # the page is not frozen when the flight stands still
    tape = replay.tape
    if not tape.start:
        text = '; '.join(filter(None, (f'results of {tape.name}', tape.note)))
        return {
            'state': {**state, 'time': now, 'tone': 'notice', 'text': text, 'link': 'live',
                      'old': dict.fromkeys(state['old'], False),
                      'age_texts': dict.fromkeys(state['age_texts'], 'as saved')},
            'alarms': [], 'past': [],  # when they were raised is not known
            'clock': None,
        }
    tone = 'notice' if state['tone'] == 'ok' else state['tone']
    text = f'replay: {state["text"].removeprefix("live: ")}'
    if tape.note and replay.time >= tape.length:
        text = f'replay: {tape.note}'
    return {
        'state': {**state, 'time': now, 'tone': tone, 'text': text},
        'clock': {
            'start': round(tape.start, 1), 'length': round(tape.length, 1),
            'time': round(replay.time, 1), 'playing': replay.playing, 'speed': replay.speed,
            'marks': [{'time': round(mark.time, 1), 'text': mark.text} for mark in replay.marks],
        },
    }


def _make_state(picture: Picture, condition: Condition, name: str) -> dict[str, Any]:
    ages = picture.ages
    lost = picture.link is Link.LOST
    late = lost or picture.link is Link.LATE  # the vehicle flies on
    return {
        'time': round(picture.time, 2), 'node': name,
        'tone': condition.tone, 'text': condition.text, 'link': picture.link.value,
        'counts': picture.count_severities(), 'held_back': picture.held_back,
        'ages': {
            'link': _round(ages.link, 1), 'data': _round(ages.data, 1),
            'vehicle': _round(ages.vehicle, 1), 'near': _round(ages.near, 1),
            'health': _round(ages.health, 1),
        },
        'old': {
            'data': lost or _is_old(ages.data, picture.spans),
            'vehicle': late or _is_old(ages.vehicle, picture.vehicle),
            'health': lost or ages.health > STALE, 'near': late or ages.near > STALE,
        },
        'age_texts': {
            'data': 'from before the restart of the node'
            if math.isnan(ages.data) and picture.spans else _say_age(ages.data),
            'health': _say_age(ages.health),
        },
        'vehicle': None if picture.vehicle is None else _place(picture.vehicle),
        'heading': _round(picture.heading, 3),
        'height': None if math.isnan(ages.vehicle) else _round(picture.height, 1),
        'near': [
            {
                'thing': name_thing(item.thing), 'tone': TONES[item.level],
                'level': item.level.name.lower(), 'distance': _round(item.distance, 1),
                'closest': _round(item.closest, 1), 'closest_in': _round(item.closest_in, 0),
                'sigma': _round(item.sigma, 2), 'text': describe_nearness(item),
                'place': _place(locate(item, picture.vehicle)),
                'limit': _round(item.limit, 1),
                'conductor': name_conductor(item.line_id)
                if item.thing == Thing.CONDUCTOR and item.line_id >= 0 else None,
            }
            for item in picture.near
        ],
        'rate': round(picture.counts.kbps),
        'lost': picture.counts.lost_summary + picture.counts.lost_cloud,
        'refused': picture.counts.describe_refused(),
        'corridor': [picture.cloud_blocks, picture.cloud_total],
    }


def _make_alarm(item: Alarm, wall: float) -> dict[str, Any]:
    return {
        'number': item.number, 'state': item.state, 'text': item.text,
        'hazard': item.cause.hazard_id, 'place': _place(item.cause.place),
        'stands': item.stands, 'raised': round(wall + item.raised, 1), 'times': item.times,
        'cleared': _time(wall, item.cleared), 'reason': item.reason, 'who': item.who,
        'acknowledged': _time(wall, item.acknowledged),
    }


def _make_hazard(
    item: HazardItem, stretches: dict[tuple[int, int], str], supports: Container[int]
) -> dict[str, Any]:
    key = item.line_id, item.span_id
    known = item.support_id in supports
    return {
        'id': item.hazard_id, 'kind': item.kind, 'severity': item.severity_name,
        'clearance': _round(item.clearance), 'required': _round(item.required),
        'span': f'{item.line_id}/{item.span_id}', 'stretch': stretches.get(key, '?'),
        'conductor': name_conductor(item.line_id), 'position': _place(item.position),
        'rows': [
            ['measured', format_metres(item.clearance, item.sigma)],
            ['required', format_metres(item.required)],
            ['confidence', f'{round(100 * item.confidence)} %'],
            ['position in the map', ', '.join(
                f'{axis} {value:.1f}' for axis, value in zip('xyz', item.position, strict=True)
            )],
            ['horizontal', format_metres(item.horizontal)],
            ['vertical', format_metres(item.vertical)],
            ['along the span', format_metres(item.along_span)],
            [f'from structure {item.support_id}' if known else 'from the nearest structure',
             format_metres(item.from_support)],
            ['height of the object', format_metres(item.height)],
            ['points', str(item.num_points)],
            ['line / span of the files', f'{item.line_id} / {item.span_id}'],
        ],
    }


def _make_span(
    item: SpanItem, stretches: dict[tuple[int, int], str],
    structures: Sequence[SupportItem | None],
) -> dict[str, Any]:
    ground = list_ground(item, structures)
    return {
        'key': f'{item.line_id}/{item.span_id}', 'stretch': stretches[item.key],
        'conductor': name_conductor(item.line_id), 'severity': name_severity(item.severity),
        'length': _round(item.length), 'sag': _round(item.sag), 'rmse': _round(item.rmse, 3),
        'sag_text': format_metres(item.sag, item.sigma_sag),
        'coverage': _round(item.coverage), 'ground': _round(item.ground_clearance),
        'open': item.open_start or item.open_end,
        'ground_line': [[round(value, 1) for value in place] for place in ground],
        'curve': [[round(value, 2) for value in row] for row in item.trace(8.0).tolist()],
    }


def _make_health(picture: Picture) -> dict[str, Any]:
    rows = []
    health = picture.health_now
    for title, (name, form) in HEALTH.items():
        value = health.get(name, math.nan)
        rows.append([title, '-' if math.isnan(value) else form.format(value)])
    place = '-' if picture.vehicle is None else ' '.join(f'{v:.1f}' for v in picture.vehicle)
    counts = picture.counts
    return {
        'rows': [
            *rows, ['vehicle', place],
            ['corridor', f'{picture.cloud_blocks} of {picture.cloud_total} blocks, '
                         f'{picture.cloud_cells} cells'],
            ['messages lost', str(counts.lost_summary + counts.lost_cloud)],
            ['restarts of the node', str(counts.restarts)],
        ],
        'notes': [
            text for text, level in zip(picture.texts, picture.levels, strict=False) if level
        ],
    }


def _is_old(age: float, thing: object) -> bool:
    """Return whether a thing that is known is old; where nobody knows its age, it is."""
    return bool(thing) and not age <= STALE


def _say_age(seconds: float) -> str:
    return 'none came yet' if math.isnan(seconds) else f'{format_age(seconds)} old'


def thin_track(picture: Picture) -> list[list[float]]:
    """Return where the vehicle has been, thinned."""
    step = 1 + len(picture.track) // MOST_TRACK
    places = list(picture.track[::-step][::-1])
    return [[round(value, 1) for value in place] for place in places]


def format_metres(value: float, sigma: float = math.nan) -> str:
    """Return a length with its standard deviation where known, ``-`` for NaN [m]."""
    if math.isnan(value):
        return '-'
    return f'{value:.2f} m' if math.isnan(sigma) else f'{value:.2f} \u00b1 {sigma:.2f} m'


def _place(place: tuple[float, float, float] | None) -> list[float] | None:
    return None if place is None else [round(value, 2) for value in place]


def _round(value: float, digits: int = 2) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _time(wall: float, when: float) -> float | None:
    return None if math.isnan(when) else round(wall + when, 1)
