# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
The status line: good only while scans and poses come in, the map is sharp and the link is alive.

The worst problem comes first.
"""

from dataclasses import dataclass
import math

from plc_inspect.monitor.picture.picture import format_age, Link, PAUSE, Picture, STALE
from plc_inspect.stream.summary import NOT_READY, STATUSES

LANDED_HEIGHT, LANDED_TIME = 3.0, 8.0
"""
Height above ground [m] below which, and time without motion [s] after which, the vehicle has
landed.
Source: judgement: a lidar under a vehicle stands about 0.5 m high; a hover at the start is higher.
"""
FLOWN = 20.0
"""Length of track from which the vehicle counts as flown [m]; before, it has not taken off."""
ERROR, WARNING = 2, 1


@dataclass(frozen=True, slots=True)
class Condition:
    """The overall condition, in one line."""

    tone: str
    """A severity of the table of colours: ok, notice, warning or critical."""
    text: str

    @property
    def good(self) -> bool:
        """Whether all is well."""
        return self.tone == 'ok'


def judge(picture: Picture, name: str = 'the node') -> Condition:
    """
    Return the overall condition.

    Parameters
    ----------
    picture : Picture
        What is known.
    name : str
        Of the node.

    Returns
    -------
    Condition

    """
    found = _judge_link(picture, name)
    if found is not None:
        return found
    if has_landed(picture):
        if picture.held:
            return Condition('critical', f'landed: {picture.held_back}')
        return Condition('notice', 'landed: the results stand, nothing new comes in')
    found = _judge_input(picture)
    unready = next((text for text in picture.texts if text.startswith(NOT_READY)), '')
    if unready:
        more = '' if found is None else f'; {found.text}'
        return Condition('critical' if found is None else found.tone, unready + more)
    if found is not None:
        return found
    for level, tone in ((ERROR, 'critical'), (WARNING, 'warning')):
        for name, told, text in zip(STATUSES, picture.levels, picture.texts, strict=False):
            if told == level:
                return Condition(tone, f'{name}: {text or "the node is in error"}')
        if picture.held:  # the node's health may tell of it a second later
            return Condition('critical', f'map: {picture.held_back}')
    return _judge_results(picture)


def has_landed(picture: Picture) -> bool:
    """Return whether the vehicle has flown and now stands low above the ground."""
    return (
        picture.flown >= FLOWN and picture.stood >= LANDED_TIME
        and picture.height <= LANDED_HEIGHT
    )


def _judge_link(picture: Picture, name: str) -> Condition | None:
    ages = picture.ages
    if picture.link is Link.WAITING:
        if not picture.others:
            return Condition('notice', f'waiting for {name}: nothing heard yet')
        return Condition(
            'warning', f'nothing heard of {name}; on the graph: {", ".join(picture.others)}'
        )
    preparing = any(text.startswith(NOT_READY) for text in picture.texts)
    busy = ', or the node is busy preparing' if preparing else ''
    if picture.link is Link.LOST:
        return Condition(
            'critical', f'LINK LOST {format_age(ages.link)} ago{busy}: all of this is old'
        )
    if picture.link is Link.LATE:
        return Condition('warning', f'link late{busy}: nothing for {format_age(ages.link)}')
    if not picture.complete:
        return Condition('warning', 'incomplete: part of the summary was lost, asked for anew')
    if math.isnan(ages.health):
        return Condition('notice', f'waiting for the health of {name}')
    if ages.health > STALE:
        return Condition('warning', f'no health from {name} for {format_age(ages.health)}')
    return None


def _judge_input(picture: Picture) -> Condition | None:
    hint = _find_hint(picture)
    rows = (('scan_age', 'the lidar', 'scans'), ('odometry_age', 'poses', 'poses'))
    stopped = []
    for name, source, things in rows:
        age = picture.health_now[name]
        if math.isnan(age):
            return Condition('critical', f'waiting for {source}{hint}')
        if age > PAUSE + 1.0 or (age > PAUSE and picture.levels and picture.levels[0] == ERROR):
            stopped.append((age, things))
    if stopped:
        words = ' and '.join(things for _, things in stopped)
        age = min(age for age, _ in stopped)
        return Condition('critical', f'{words} stopped {format_age(age)} ago{hint}')
    return None


def _find_hint(picture: Picture) -> str:
    """Return the node's reason why nothing comes in, without what the line says already."""
    text = picture.texts[0] if picture.texts else ''
    parts = [part.strip() for part in text.split(';')]
    left = '; '.join(part for part in parts[1:] if part)
    return f': {left}' if left else ''


def _judge_results(picture: Picture) -> Condition:
    ages, health = picture.ages, picture.health
    if math.isnan(ages.data):
        kept = ': shown is what was known before the restart' if picture.spans else ''
        return Condition('notice', f'scans and poses come in; no result yet{kept}')
    if ages.data > STALE:
        return Condition('warning', f'no new result for {format_age(ages.data)}')
    if picture.near and ages.near > STALE:
        return Condition('warning', f'keep-out not measured for {format_age(ages.near)}')
    rate = health.get('scan_rate', math.nan)
    speed = '' if math.isnan(rate) else f' at {rate:.1f} Hz'
    if math.isnan(health.get('sharpness', math.nan)):
        return Condition(
            'notice', f'scans{speed} and poses come in; sharpness of the map not known yet'
        )
    return Condition('ok', f'live: scans{speed} and poses come in, the map is sharp')
