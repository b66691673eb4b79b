# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Render the picture on a terminal of at least 80 x 24 characters."""

import math

from rich.console import Console, Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from plc_inspect.colors import LOOKS, parse_color, severity_color
from plc_inspect.core.live.proximity import Level
from plc_inspect.monitor.picture.causes import describe_nearness
from plc_inspect.monitor.picture.condition import judge
from plc_inspect.monitor.picture.picture import (
    format_age,
    HazardItem,
    Link,
    name_severity,
    Picture,
    SpanItem,
    STALE,
)

WIDE = 110
"""From this many columns on, spans and hazards stand side by side."""
LIFT = 0.4
"""Share of white mixed into colours for text on a dark terminal."""


def _light(name: str) -> str:
    red, green, blue = (
        round(value + LIFT * (255 - value)) for value in parse_color(severity_color(name))
    )
    return f'#{red:02x}{green:02x}{blue:02x}'


COLORS = {name: _light(name) for name in LOOKS} | {'critical': f'bold {_light("critical")}'}
FILLS = {name: f'{look.ink} on {look.color}' for name, look in LOOKS.items()}
"""Styles of rich, by severity: of text (COLORS), and of a filled line (FILLS)."""
_LEVELS = ('', COLORS['warning'], COLORS['critical'])


def draw(picture: Picture, width: int, height: int, name: str) -> RenderableType:
    """
    Lay the picture out for a screen.

    Parameters
    ----------
    picture : Picture
        What is known.
    width, height : int
        Of the screen, in characters.
    name : str
        Name of the node.

    Returns
    -------
    RenderableType
        Of rich; exactly as high as the screen.

    """
    layout = Layout()
    health = 7
    events = 4 if height < 40 else 10
    body = height - 2 - health - events
    layout.split_column(
        Layout(_draw_head(picture, name, width), name='head', size=1),
        Layout(_draw_alarm(picture), name='alarm', size=1),
        Layout(_draw_health(picture, width), name='health', size=health),
        Layout(name='body', size=max(body, 3)),
        Layout(_draw_events(picture, events - 2), name='events', size=events),
    )
    if width >= WIDE:
        layout['body'].split_row(
            Layout(_draw_hazards(picture, body, width - width // 2)),
            Layout(_draw_spans(picture, body, width // 2)),
        )
    else:
        upper = (body + 1) // 2
        layout['body'].split_column(
            Layout(_draw_hazards(picture, upper, width), size=upper),
            Layout(_draw_spans(picture, body - upper, width)),
        )
    return layout


def draw_once(picture: Picture, name: str) -> RenderableType:
    """Return the whole picture, of any height, to be printed once."""
    events = [Text(event.text, style=_LEVELS[event.level]) for event in picture.events[-10:]]
    return Group(
        _draw_head(picture, name, 200), _draw_alarm(picture), _draw_health(picture, 100),
        _draw_hazards(picture, len(picture.hazards) + 10, 100),
        _draw_spans(picture, len(picture.spans) + 10, 100), *events,
    )


def print_once(picture: Picture, name: str) -> None:
    """Print the picture as text."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=100)
    console.print(draw_once(picture, name))


def _draw_head(picture: Picture, name: str, width: int) -> Text:
    condition = judge(picture, name)
    words = condition.text if width >= WIDE or not condition.good else 'LIVE'
    text = Text(f' {words} ', style=FILLS[condition.tone], no_wrap=True,
                overflow='ellipsis')
    if picture.link is Link.WAITING:
        return text
    text.append(f' {format_age(picture.ages.link)} ', style='bold' if picture.link is Link.LIVE
                else COLORS['critical'])
    lost = picture.counts.lost_summary + picture.counts.lost_cloud
    text.append(f' {name}  data {format_age(picture.ages.data)}')
    if not picture.complete:
        text.append('  INCOMPLETE', style=COLORS['critical'])
    text.append(f'  lost {lost}', style=COLORS['warning'] if lost else '')
    if refused := picture.counts.describe_refused():
        text.append(f'  {refused}', style=COLORS['critical'])
    text.append(f'  {picture.counts.kbps:.0f} kbit/s')
    if width >= WIDE:
        text.append(f'  delay {format_age(picture.ages.delay)}  restarts {picture.counts.restarts}'
                    f'  corridor {picture.cloud_blocks} of {picture.cloud_total} blocks')
    return text


def _draw_alarm(picture: Picture) -> Text:
    if picture.link is Link.LOST:
        return Text(
            f'no news for {format_age(picture.ages.link)}: everything below is OLD',
            style='bold ' + FILLS['critical'], no_wrap=True, overflow='ellipsis',
        )
    counts = picture.count_severities()
    standing = [item for item in picture.alarms if item.stands]
    unsure = [item for item in picture.alarms if item.state == 'unsure']
    cleared = [item for item in picture.alarms if item.state == 'cleared']
    if unsure and all(item.seen for item in standing):
        more = f' (and {len(cleared)} cleared)' if cleared else ''
        return Text(f'{len(unsure)} {"alarm" if len(unsure) == 1 else "alarms"} may still be '
                    f'there, as the node began anew: {unsure[0].text}{more}',
                    no_wrap=True, overflow='ellipsis', style='bold ' + FILLS['critical'])
    if standing:
        first = standing[0]
        more = f' (and {len(standing) - 1} more)' if len(standing) > 1 else ''
        word = f'seen by {first.who}' if first.seen else 'ALARM'
        return Text(f'{word}: {first.text}{more}', no_wrap=True, overflow='ellipsis',
                    style='bold ' + FILLS['warning' if first.seen else 'critical'])
    if cleared:
        return Text(f'{len(cleared)} {"alarm" if len(cleared) == 1 else "alarms"} cleared that '
                    'nobody acknowledged (on the page of --web): the newest was '
                    + cleared[0].text,
                    no_wrap=True, overflow='ellipsis', style=FILLS['warning'])
    held = ' held back, as told last' if picture.held else ''
    return Text(f'{counts["critical"]} critical, {counts["warning"]} warnings, '
                f'{len(picture.hazards)} hazards{held}, {len(picture.spans)} spans')


def _draw_health(picture: Picture, width: int) -> RenderableType:
    health = picture.health_now

    def number(name: str, form: str = '.0f') -> str:
        return _number(health.get(name, math.nan), form)

    cells = (
        ('scan rate', f'{number("scan_rate", ".1f")} Hz'),
        ('scans lost', number('scans_lost')), ('scans dropped', number('scans_dropped')),
        ('pose gaps', number('pose_gaps')), ('last tick', f'{number("tick_ms")} ms'),
        ('postponed', number('ticks_postponed')),
        ('map', f'{_number(health.get("voxels", math.nan) / 1e6)} M voxels'),
        ('memory', f'{number("memory_mb")} MB'),
        ('callbacks', f'{number("callback_ms", ".1f")} ms'),
    )
    table = Table.grid(padding=(0, 2))
    columns = 3
    for start in range(0, len(cells), columns):
        row = []
        for title, value in cells[start:start + columns]:
            row += [Text(title, style='dim'), Text(value)]
        table.add_row(*row)
    place = '-' if picture.vehicle is None else ' '.join(f'{v:.1f}' for v in picture.vehicle)
    lines = Text(no_wrap=True, overflow='ellipsis')
    lines.append(f'vehicle {place} m, {format_age(picture.ages.vehicle)} old')
    for near in picture.near[:1]:
        lines.append(f'  {describe_nearness(near)}',
                     style=_LEVELS[max(near.level - Level.CLEAR, 0)])
    bad = max(range(len(picture.levels)), key=lambda k: picture.levels[k], default=0)
    if picture.levels and picture.levels[bad]:
        lines.append(f'  {picture.texts[bad]}', style=_LEVELS[min(picture.levels[bad], 2)])
    lines.append(f'  {picture.frame_id}', style='dim')
    return Panel(Group(table, lines), title=_title('health', picture.ages.health),
                 border_style=_border(picture.ages.health), height=7)


def _draw_hazards(picture: Picture, height: int, width: int) -> RenderableType:
    table = _make_table(('severity', 'kind', 'id', 'line', 'span', 'm', 'needs', 'sigma', 'along')
                        if width >= 76 else ('severity', 'kind', 'id', 'line', 'span', 'm'))
    room = height - 3
    shown = _fit(len(picture.hazards), room)
    for item in picture.hazards[:shown]:
        table.add_row(*_hazard_cells(item)[:len(table.columns)],
                      style=COLORS[item.severity_name])
    title = f'hazards: {len(picture.hazards)}' + (
        ' held back, as told last' if picture.held else ''
    )
    if shown < len(picture.hazards):
        title += f', {shown} shown'
    return Panel(table, title=_title(title, picture.ages.data),
                 border_style=_border(picture.ages.data), padding=(0, 1))


def _draw_spans(picture: Picture, height: int, width: int) -> RenderableType:
    table = _make_table(('state', 'line', 'span', 'length', 'sag', 'rmse', 'cover', 'ground'))
    room = height - 3
    shown = _fit(len(picture.spans), room)
    for item in picture.spans[:shown]:
        table.add_row(*_span_cells(item), style=COLORS[name_severity(item.severity)])
    title = f'spans: {len(picture.spans)}'
    if shown < len(picture.spans):
        title += f', {shown} shown'
    return Panel(table, title=_title(title, picture.ages.data),
                 border_style=_border(picture.ages.data), padding=(0, 1))


def _draw_events(picture: Picture, count: int) -> RenderableType:
    text = Text(no_wrap=True, overflow='ellipsis')
    for event in reversed(picture.events[-count:] if count > 0 else ()):
        ago = format_age(picture.time - event.time)
        text.append(f'{ago:>7} ago  {event.text}\n', style=_LEVELS[event.level])
    return Panel(text, title='events', border_style='dim', padding=(0, 1))


def _hazard_cells(item: HazardItem) -> list[str]:
    return [
        item.severity_name, item.kind, str(item.hazard_id), str(item.line_id),
        str(item.span_id), _number(item.clearance), _number(item.required),
        _number(item.sigma), _number(item.along_span, '.1f'),
    ]


def _number(value: float, form: str = '.2f') -> str:
    return '-' if math.isnan(value) else format(value, form)


def _span_cells(item: SpanItem) -> list[str]:
    ground = _number(item.ground_clearance, '.1f')
    state = name_severity(item.severity)
    if item.open_start or item.open_end:
        state += ' ...'
    return [
        state, str(item.line_id), str(item.span_id), f'{item.length:.1f}', f'{item.sag:.2f}',
        f'{item.rmse:.3f}', f'{item.coverage:.0%}', ground,
    ]


def _make_table(names: tuple[str, ...]) -> Table:
    table = Table(box=None, expand=True, padding=(0, 1), pad_edge=False, header_style='dim')
    for name in names:
        left = name in ('severity', 'kind', 'state')
        table.add_column(name, justify='left' if left else 'right', no_wrap=True,
                         overflow='ellipsis')
    return table


def _fit(count: int, room: int) -> int:
    return max(0, min(count, room))


def _title(text: str, age: float) -> Text:
    style = COLORS['critical'] if age > STALE else ''
    return Text(f'{text}, {format_age(age)} old' if not math.isnan(age) else f'{text}: none yet',
                style=style)


def _border(age: float) -> str:
    return _light('critical') if age > STALE else 'dim' if math.isnan(age) else _light('ok')
