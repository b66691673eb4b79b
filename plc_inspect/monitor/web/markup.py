# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The texts, tables and profiles of the page, as HTML."""

from collections.abc import Sequence
import html
import math
from typing import Any

import numpy as np

from plc_inspect.colors import OK_COLOR, SEVERITY_COLORS
from plc_inspect.monitor.picture.cloud_store import CellArrays
from plc_inspect.monitor.picture.picture import HazardItem, Link, name_severity, Picture, SpanItem
from plc_inspect.monitor.terminal.text import format_age, STALE
from plc_inspect.results import PointClass

COLORS = {'ok': OK_COLOR, **SEVERITY_COLORS}
LINK_COLORS = {
    Link.WAITING: '#8d6e00', Link.LIVE: '#2e7d32', Link.LATE: '#b36b00', Link.LOST: '#c62828',
}
PROFILE_WIDTH = 6.0
"""Cells this near to the conductor in plan are in the profile [m]."""
STYLE = """<style>
.plc{font:13px/1.45 system-ui,sans-serif;margin:0 .5em}.plc table{border-collapse:collapse;
width:100%}.plc td,.plc th{padding:1px 4px;text-align:right;white-space:nowrap}
.plc td:first-child,.plc th:first-child{text-align:left}.plc th{font-weight:500;opacity:.65}
.plc .bar{color:#fff;padding:.4em .6em;border-radius:4px;font-weight:600}
.plc .alarm{background:#c62828;color:#fff;padding:.35em .6em;border-radius:4px;margin:.3em 0}
.plc .old{color:#c62828;font-weight:600}.plc .dot{display:inline-block;width:.7em;height:.7em;
border-radius:50%;margin-right:.4em}.plc .scroll{max-height:16em;overflow:auto}
.plc .events{opacity:.85;white-space:normal}.plc .pairs td{white-space:normal}
.plc .frozen{background:#c62828;color:#fff;font-weight:600;overflow:hidden;max-height:0;
border-radius:4px;animation:plc-frozen 0s 3s forwards}
@keyframes plc-frozen{to{max-height:10em;padding:.4em .6em;margin-bottom:.3em}}
@media (max-width:600px){.mantine-Paper-root:has(#plc-link){left:0!important}
.mantine-Paper-root:has(#plc-link),.mantine-Paper-root div:not(.plc):has(#plc-link){
width:100%!important}
.plc .scroll{max-height:9em}}
</style>"""
"""For all fragments of the page; a browser gets it once."""


def draw_bar(picture: Picture) -> str:
    """Return the line that says how the link is, how old the data are, and any alarm."""
    ages = picture.ages
    word = {
        Link.WAITING: 'waiting for the node', Link.LIVE: 'live',
        Link.LATE: f'late: nothing for {format_age(ages.link)}',
        Link.LOST: f'LINK LOST for {format_age(ages.link)}: all of this is old',
    }[picture.link]
    color = LINK_COLORS[picture.link]
    if picture.link is Link.LIVE and ages.data > STALE:
        word, color = 'live, but nothing new', LINK_COLORS[Link.LATE]
    text = f'{word} &middot; data {format_age(ages.data)} old'
    if not picture.complete and picture.link is not Link.WAITING:
        text += ' &middot; incomplete'
    lost = picture.counts.lost_summary + picture.counts.lost_cloud
    text += f' &middot; {lost} lost &middot; {picture.counts.kbps:.0f} kbit/s'
    # The browser shows this by itself where nothing replaces it within three seconds.
    parts = [
        '<div class="frozen">FROZEN: the monitor no longer updates this page; all of it is old'
        '</div>',
        f'<div class="bar" id="plc-link" data-link="{picture.link.value}" '
        f'data-time="{picture.time:.2f}" '
        f'style="background:{color}">{text}</div>'
    ]
    for item in picture.alarms[:2]:
        parts.append(f'<div class="alarm">ALARM: {_describe(item)}</div>')
    return _wrap(''.join(parts))


def draw_hazards(picture: Picture) -> str:
    """Return the table of hazards, worst first."""
    rows = [
        f'<tr data-hazard="{item.hazard_id}"><td>{_dot(item.severity_name)}{item.kind} '
        f'#{item.hazard_id}</td><td>{item.clearance:.2f}</td><td>{item.required:.2f}</td>'
        f'<td>{item.line_id}/{item.span_id}</td></tr>'
        for item in picture.hazards
    ]
    return _wrap(
        f'{_age("hazards", len(picture.hazards), picture.ages.data)}<div class="scroll">'
        '<table id="plc-hazards"><tr><th>hazard</th><th>m</th><th>needs</th>'
        f'<th>span</th></tr>{"".join(rows)}</table></div>'
    )


def draw_hazard(item: HazardItem | None) -> str:
    """Return all numbers of a hazard."""
    if item is None:
        return _wrap('<p>Choose a hazard above, or tap one in the picture.</p>')
    rows = [
        ('severity', item.severity_name), ('clearance', _length(item.clearance, item.sigma)),
        ('required', _length(item.required)), ('horizontal', _length(item.horizontal)),
        ('vertical', _length(item.vertical)), ('along the span', _length(item.along_span)),
        (f'from support {item.support_id}' if item.support_id >= 0 else 'from support',
         _length(item.from_support)),
        ('height of the object', _length(item.height)), ('points', str(item.num_points)),
        ('line / span', f'{item.line_id} / {item.span_id}'),
        ('position', ' '.join(f'{value:.1f}' for value in item.position)),
    ]
    return _wrap(
        f'<b>{_dot(item.severity_name)}{item.kind} #{item.hazard_id}</b>'
        f'<table id="plc-hazard" class="pairs" data-hazard="{item.hazard_id}">'
        f'{_pairs(rows)}</table>'
    )


def draw_spans(picture: Picture) -> str:
    """Return the table of spans, worst first."""
    rows = [
        f'<tr data-span="{item.line_id}/{item.span_id}"><td>{_dot(name_severity(item.severity))}'
        f'{item.line_id}/{item.span_id}{" &hellip;" if item.open_start or item.open_end else ""}'
        f'</td><td>{item.length:.1f}</td><td>{item.sag:.2f}</td><td>{item.rmse:.3f}</td>'
        f'<td>{item.coverage:.0%}</td></tr>'
        for item in picture.spans
    ]
    return _wrap(
        f'{_age("spans", len(picture.spans), picture.ages.data)}<div class="scroll">'
        '<table id="plc-spans"><tr><th>line/span</th><th>length</th><th>sag</th><th>rmse</th>'
        f'<th>seen</th></tr>{"".join(rows)}</table></div>'
    )


def draw_health(picture: Picture) -> str:
    """Return how the node is, and what happened."""
    health = picture.health
    forms = {
        'scan rate': ('scan_rate', '{:.1f} Hz'), 'scans': ('scans', '{:.0f}'),
        'scans lost': ('scans_lost', '{:.0f}'), 'scans dropped': ('scans_dropped', '{:.0f}'),
        'pose gaps': ('pose_gaps', '{:.0f}'), 'last tick': ('tick_ms', '{:.0f} ms'),
        'ticks postponed': ('ticks_postponed', '{:.0f}'), 'map': ('voxels', '{:.0f} voxels'),
        'memory': ('memory_mb', '{:.0f} MB'), 'callbacks p99': ('callback_ms', '{:.1f} ms'),
    }
    rows = []
    for title, (name, form) in forms.items():
        value = health.get(name, math.nan)
        rows.append((title, '-' if math.isnan(value) else form.format(value)))
    place = '-' if picture.vehicle is None else ' '.join(f'{v:.1f}' for v in picture.vehicle)
    rows += [
        (f'vehicle, {format_age(picture.ages.vehicle)} old', place),
        ('corridor', f'{picture.cloud_blocks} of {picture.cloud_total} blocks, '
                     f'{picture.cloud_cells} cells'),
        ('last of the corridor', format_age(picture.ages.cloud)),
        ('delay on the way', format_age(picture.ages.delay)),
        ('restarts of the node', str(picture.counts.restarts)),
    ]
    notes = [
        f'<div class="old">{html.escape(text)}</div>'
        for text, level in zip(picture.texts, picture.levels, strict=True) if level
    ]
    events = [
        f'<div>{format_age(picture.time - event.time)} ago: {html.escape(event.text)}</div>'
        for event in reversed(picture.events[-30:])
    ]
    return _wrap(
        f'{_age("health", None, picture.ages.health)}{"".join(notes)}'
        f'<table id="plc-health" class="pairs">{_pairs(rows)}</table>'
        f'<div class="scroll events" id="plc-events">{"".join(events)}</div>'
    )


def draw_profile(
    span: SpanItem | None, hazards: Sequence[HazardItem], cells: CellArrays
) -> str:
    """
    Return the side view of a span, with what stands below it.

    Parameters
    ----------
    span : SpanItem or None
        The span.
    hazards : sequence of HazardItem
        All of them; those of the span are drawn.
    cells : CellArrays
        Of the thinned corridor beside the span.

    Returns
    -------
    str
        HTML with an SVG; heights are exaggerated where the span is long.

    """
    if span is None:
        return _wrap('<p>Choose a span above.</p>')
    curve = span.trace(max(span.length / 60.0, 0.5))
    along = np.linspace(0.0, span.length, len(curve))
    points, kind, _, _ = cells
    start = np.array(span.start)
    unit = (np.array(span.end) - start)[:2] / max(span.length, 1e-9)
    at = (points[:, :2] - start[:2]) @ unit
    heights = np.concatenate((curve[:, 2], points[:, 2]))
    low, high = float(heights.min()) - 1.0, float(heights.max()) + 1.0
    own = [
        item for item in hazards if (item.line_id, item.span_id) == span.key
    ]
    width, height, left, bottom = 360.0, 200.0, 34.0, 18.0

    def put(x: Any, z: Any) -> tuple[Any, Any]:
        return (
            left + x / max(span.length, 1e-9) * (width - left - 6.0),
            (height - bottom) - (z - low) / (high - low) * (height - bottom - 6.0),
        )

    dots = []
    for name, color in ((PointClass.GROUND, '#a1887f'), (PointClass.VEGETATION, '#4caf50'),
                        (PointClass.TOWER, '#546e7a'), (PointClass.OTHER, '#9e9e9e')):
        chosen = np.flatnonzero(kind == name)
        chosen = chosen[:: 1 + len(chosen) // 600]
        x, y = put(at[chosen], points[chosen, 2])
        path = ''.join(f'M{a:.0f} {b:.0f}h1' for a, b in zip(x, y, strict=True))
        dots.append(f'<path d="{path}" stroke="{color}" stroke-width="3"/>')
    x, y = put(along, curve[:, 2])
    line = ' '.join(f'{a:.1f},{b:.1f}' for a, b in zip(x, y, strict=True))
    marks = []
    for item in own:
        a, b = put(min(max(item.along_span, 0.0), span.length), item.position[2])
        color = COLORS[item.severity_name]
        marks.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="5" fill="none" stroke="{color}" '
                     f'stroke-width="2.5"/><text x="{a + 7:.1f}" y="{b - 4:.1f}" fill="{color}">'
                     f'{item.clearance:.2f} m</text>')
    ticks = _draw_ticks(span.length, low, high, put, height - bottom, left)
    title = f'line {span.line_id} span {span.span_id}'
    facts = (f'length {span.length:.2f} m, sag {_length(span.sag, span.sigma_sag)}, '
             f'rmse {span.rmse:.3f} m, ground {_length(span.ground_clearance)}')
    return _wrap(
        f'<b>{_dot(name_severity(span.severity))}{title}</b>'
        f'<div id="plc-span" data-span="{span.line_id}/{span.span_id}">{facts}</div>'
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" style="width:100%" role="img" '
        f'aria-label="profile of {title}" font-size="10">{ticks}{"".join(dots)}'
        f'<polyline points="{line}" fill="none" stroke="#1565c0" stroke-width="2"/>'
        f'{"".join(marks)}</svg>'
    )


def _draw_ticks(
    length: float, low: float, high: float, put: Any, floor: float, left: float
) -> str:
    parts = []
    for value in _choose_ticks(low, high, 5):
        _, y = put(0.0, value)
        parts.append(f'<path d="M{left:.0f} {y:.1f}H354" stroke="#8884"/><text x="{left - 3:.0f}" '
                     f'y="{y + 3:.1f}" text-anchor="end" fill="currentColor">{value:g}</text>')
    for value in _choose_ticks(0.0, length, 6):
        x, _ = put(value, low)
        parts.append(f'<text x="{x:.1f}" y="{floor + 13:.0f}" text-anchor="middle" '
                     f'fill="currentColor">{value:g}</text>')
    return ''.join(parts)


def _choose_ticks(low: float, high: float, count: int) -> list[float]:
    raw = max((high - low) / count, 1e-6)
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * k for k in (1, 2, 5, 10) if unit * k >= raw)
    first = math.ceil(low / step)
    return [k * step for k in range(first, math.floor(high / step) + 1)]


def _describe(item: HazardItem) -> str:
    return (f'{item.kind} {item.clearance:.2f} m of {item.required:.2f} m, '
            f'line {item.line_id} span {item.span_id}')


def _length(value: float, sigma: float = math.nan) -> str:
    if math.isnan(value):
        return '-'
    return f'{value:.2f} m' if math.isnan(sigma) else f'{value:.2f} &plusmn; {sigma:.2f} m'


def _pairs(rows: Sequence[tuple[str, str]]) -> str:
    return ''.join(f'<tr><td>{name}</td><td>{value}</td></tr>' for name, value in rows)


def _dot(severity: str) -> str:
    return f'<span class="dot" style="background:{COLORS[severity]}"></span>'


def _age(title: str, count: int | None, age: float) -> str:
    number = '' if count is None else f'{count} '
    style = ' class="old"' if age > STALE else ''
    return f'<div{style}>{number}{title}, {format_age(age)} old</div>'


def _wrap(text: str) -> str:
    return f'<div class="plc">{text}</div>'
