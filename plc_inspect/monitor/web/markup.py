# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The texts, tables and profiles of the page, as HTML."""

from collections.abc import Sequence
import math

from plc_inspect.colors import severity_color
from plc_inspect.monitor.picture.cloud_store import CellArrays
from plc_inspect.monitor.picture.picture import HazardItem, Link, Picture, SpanItem
from plc_inspect.monitor.terminal.text import format_age, STALE
from plc_inspect.monitor.web.profile import FRAME, lay_out_profile
from plc_inspect.monitor.web.template import format_metres, render

LINK_COLORS = {
    Link.WAITING: '#8d6e00', Link.LIVE: '#2e7d32', Link.LATE: '#b36b00',
    Link.LOST: severity_color('critical'),
}
MOST_ALARMS, MOST_EVENTS = 2, 30
"""More are not on the page."""
_HEALTH = {
    'scan rate': ('scan_rate', '{:.1f} Hz'), 'scans': ('scans', '{:.0f}'),
    'scans lost': ('scans_lost', '{:.0f}'), 'scans dropped': ('scans_dropped', '{:.0f}'),
    'pose gaps': ('pose_gaps', '{:.0f}'), 'last tick': ('tick_ms', '{:.0f} ms'),
    'ticks postponed': ('ticks_postponed', '{:.0f}'), 'map': ('voxels', '{:.0f} voxels'),
    'memory': ('memory_mb', '{:.0f} MB'), 'callbacks p99': ('callback_ms', '{:.1f} ms'),
}
"""Names on the page, by name in the summary and form."""


def draw_style() -> str:
    """Return the style sheet of all that follows; a browser needs it once."""
    return render('style.html')


def draw_bar(picture: Picture) -> str:
    """Return the line that says how the link is, how old the data are, and any alarm."""
    ages = picture.ages
    state = {
        Link.WAITING: 'waiting for the node', Link.LIVE: 'live',
        Link.LATE: f'late: nothing for {format_age(ages.link)}',
        Link.LOST: f'LINK LOST for {format_age(ages.link)}: all of this is old',
    }[picture.link]
    color = LINK_COLORS[picture.link]
    if picture.link is Link.LIVE and ages.data > STALE:
        state, color = 'live, but nothing new', LINK_COLORS[Link.LATE]
    if picture.link is Link.LIVE and picture.problem:
        news = ', nothing new' if ages.data > STALE else ''
        state, color = f'live, but in error{news}: {picture.problem}', LINK_COLORS[Link.LOST]
    return render(
        'bar.html', picture=picture, state=state, color=color,
        incomplete=not picture.complete and picture.link is not Link.WAITING,
        lost=picture.counts.lost_summary + picture.counts.lost_cloud,
        refused=picture.counts.describe_refused(), alarms=picture.alarms[:MOST_ALARMS],
    )


def draw_hazards(picture: Picture) -> str:
    """Return the table of hazards, worst first."""
    return render('hazards.html', picture=picture)


def draw_hazard(item: HazardItem | None) -> str:
    """Return all numbers of a hazard."""
    return render('hazard.html', item=item, rows=[] if item is None else _list_hazard(item))


def draw_spans(picture: Picture) -> str:
    """Return the table of spans, worst first."""
    return render('spans.html', picture=picture)


def draw_health(picture: Picture) -> str:
    """Return how the node is, and what happened."""
    return render(
        'health.html', picture=picture, rows=_list_health(picture),
        notes=[
            text for text, level in zip(picture.texts, picture.levels, strict=True) if level
        ],
        events=picture.events[: -MOST_EVENTS - 1 : -1],
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
    profile = None if span is None else lay_out_profile(span, hazards, cells)
    return render('profile.html', span=span, profile=profile, frame=FRAME)


def _list_hazard(item: HazardItem) -> list[tuple[str, str]]:
    support = f' {item.support_id}' if item.support_id >= 0 else ''
    return [
        ('severity', item.severity_name),
        ('clearance', format_metres(item.clearance, item.sigma)),
        ('required', format_metres(item.required)),
        ('horizontal', format_metres(item.horizontal)),
        ('vertical', format_metres(item.vertical)),
        ('along the span', format_metres(item.along_span)),
        (f'from support{support}', format_metres(item.from_support)),
        ('height of the object', format_metres(item.height)),
        ('points', str(item.num_points)),
        ('line / span', f'{item.line_id} / {item.span_id}'),
        ('position', ' '.join(f'{value:.1f}' for value in item.position)),
    ]


def _list_health(picture: Picture) -> list[tuple[str, str]]:
    rows = []
    for title, (name, form) in _HEALTH.items():
        value = picture.health.get(name, math.nan)
        rows.append((title, '-' if math.isnan(value) else form.format(value)))
    place = '-' if picture.vehicle is None else ' '.join(f'{v:.1f}' for v in picture.vehicle)
    return [
        *rows,
        (f'vehicle, {format_age(picture.ages.vehicle)} old', place),
        ('corridor', f'{picture.cloud_blocks} of {picture.cloud_total} blocks, '
                     f'{picture.cloud_cells} cells'),
        ('last of the corridor', format_age(picture.ages.cloud)),
        ('delay on the way', format_age(picture.ages.delay)),
        ('restarts of the node', str(picture.counts.restarts)),
    ]
