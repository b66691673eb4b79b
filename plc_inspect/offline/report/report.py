# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Renders ``report.html``, one self-contained page."""

from collections import Counter
from collections.abc import Mapping
import math
import time
from typing import Any

import jinja2
from markupsafe import Markup
import numpy as np

from plc_inspect import __version__
from plc_inspect.colors import line_color, LOOKS, SEVERITY_COLORS
from plc_inspect.core.hazards.clearance_rules import describe_rules, plain_rules
from plc_inspect.core.tracking.wire_points import WirePoints
from plc_inspect.offline.records.coverage_record import describe_coverage, review_coverage, Sight
from plc_inspect.offline.records.georeference import find_height_datum, find_horizontal
from plc_inspect.offline.records.inspection import (
    describe_coarse_ground,
    Inspection,
    measure_clearances,
)
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.drawing import draw_bars
from plc_inspect.offline.report.figures import draw_map, draw_profile, draw_section
from plc_inspect.offline.report.findings import list_changes, list_what_if, list_worst
from plc_inspect.offline.report.hazard_sheets import list_sheets, VIEW_TILT_DEG
from plc_inspect.offline.report.paper import list_contents, Paper, quote_css
from plc_inspect.offline.report.point_scene import make_scene, Scene
from plc_inspect.offline.report.sheets import draw_plan
from plc_inspect.offline.report.stage_figures import draw_residuals, draw_stage
from plc_inspect.offline.report.view import encode_view
from plc_inspect.results import Decision, HazardKind, PointClass, Severity, SpanKey, StageReport
from plc_inspect.setting_names import describe, to_mapping
from plc_inspect.templates import open_templates

STAGES = {
    'height': 'Keeps what stands high above the local ground, by the histogram of heights.',
    'linearity': 'Keeps points whose neighbours lie along a nearly horizontal line.',
    'outliers': 'Drops lone points, by the mean distance to their neighbours.',
    'alignment': 'Finds straight sections and the azimuth of each.',
    'clustering': 'Separates the conductors: clusters across the line, then along it; the cut, '
                  'the profile and the plan of each span show them.',
    'catenary': 'Fits a catenary to each conductor in each span and collects its points; the '
                'residuals are shown with each span.',
    'supports': 'Finds towers and poles, where spans begin and end.',
    'corridor': 'Collects all points within the search radius of a conductor.',
    'hazards': 'Compares distances, spacing and sag with the clearance rules.',
}
_LONG_LIST = 8
"""Longest list of numbers shown as text; longer ones are drawn as bars."""


def render_report(
    inspection: Inspection, sight: Sight | None = None, paper: Paper | None = None,
    clearances: Mapping[SpanKey, float | None] | None = None,
) -> str:
    """
    Return the report of one run as HTML.

    The page holds its style and its figures; it loads nothing.  Lengths and coordinates are in
    the horizontal unit of the input, settings and thresholds in metres.

    Parameters
    ----------
    inspection : Inspection
        The run.
    sight : Sight or None
        Coverage; by default measured from its points.
    paper : Paper or None
        For a printed report, with contents and a sheet for each hazard.
    clearances : mapping or None
        Distances of `measure_clearances` [m], by default measured; given for a section of a grid,
        whose tables are shared.

    Returns
    -------
    The text of the page.

    """
    scene = make_scene(inspection)
    result = inspection.result
    sight = sight or review_coverage(inspection)
    worst, what_if, changes = (
        list_worst(scene, inspection), list_what_if(inspection), list_changes(inspection)
    )
    coverage = describe_coverage(sight, inspection.units)
    sheets = [] if paper is None else list_sheets(scene)
    return PAGE.render(
        paper='' if paper is None else paper.size,
        date=time.strftime('%Y-%m-%d'),
        pages={} if paper is None else paper.pages,
        sheets=sheets,
        view_tilt=VIEW_TILT_DEG,
        contents=list_contents(
            sheets, worst=bool(worst), coverage=bool(coverage['sections']),
            what_if=what_if is not None, changes=changes is not None,
        ),
        version=__version__,
        inspection=inspection,
        scene=scene,
        unit=scene.unit,
        summary=_summarise(inspection, scene),
        map=Markup(draw_map(scene)),  # nosec B704
        view=Markup(encode_view(scene)),  # nosec B704
        worst=worst,
        what_if=what_if,
        changes=changes,
        rules=describe_rules(inspection.rules or plain_rules(inspection.settings.hazards)),
        groups=_describe_groups(inspection, scene, clearances),
        supports=scene.supports,
        hazards=scene.hazards,
        coverage=coverage,
        coarse_ground=describe_coarse_ground(inspection),
        is_located=find_horizontal(inspection) is not None,
        height_datum=find_height_datum(inspection).name,
        stages=[_describe_stage(stage) for stage in result.stages],
        slowest=max((stage.seconds for stage in result.stages), default=0.0) or 1.0,
        decisions=_tally(result.decision, Decision),
        classes=_tally(result.classification, PointClass),
        settings=_list_settings(inspection),
        counts=_list_values(inspection.counts),
        looks=LOOKS,
        line_color=line_color,
        is_section=clearances is not None,
        is_sag=HazardKind.SAG.name.lower(),
    )


def format_number(value: float | None, decimals: int = 2) -> str:
    """Return a formatted number; an en dash for None."""
    if value is None or not math.isfinite(value):
        return '\u2013'
    text = f'{round(value, decimals) + 0.0:,.{decimals}f}'  # no minus before nothing
    return text.replace('-', '\u2212')


def _format_count(value: int) -> str:
    return f'{value:,d}'


def _format_percent(share: float | None) -> str:
    return '\u2013' if share is None else f'{100.0 * share:.0f} %'


def _place(position: list[float], scene: Scene) -> str:
    """Return the coordinates of a place in the frame of the input."""
    x, y, z = position
    x, y, z = x + scene.origin[0], y + scene.origin[1], z * scene.ratio
    return f'{x:.2f}, {y:.2f}, {z:.2f}'.replace('-', '\u2212')


def _summarise(inspection: Inspection, scene: Scene) -> list[tuple[str, str, str]]:
    """Return the figures at the top of the page: value, name and remark."""
    result = inspection.result
    severities = Counter(hazard['severity'] for hazard in scene.hazards)
    remark = ', '.join(f'{severities[name]} {name}' for name in SEVERITY_COLORS if
                       severities[name])
    lengths: dict[int, float] = {}
    for span in scene.spans:
        lengths[span['span_id']] = max(lengths.get(span['span_id'], 0.0), span['length'])
    sags = [span['sag'] for span in scene.spans]
    return [
        (_format_count(result.num_lines), 'lines', ''),
        (
            _format_count(len(lengths)),
            'spans',
            f'{format_number(sum(lengths.values()), 0)} {scene.unit} of route' if lengths else '',
        ),
        (
            format_number(max(sags, default=None)),
            f'greatest sag [{scene.unit}]',
            f'of {len(sags)} catenaries' if sags else '',
        ),
        (_format_count(len(result.supports)), 'supports', ''),
        (_format_count(len(result.hazards)), 'hazards', remark),
        (
            _format_count(result.num_points),
            'points',
            f'{_format_count(int((result.classification == PointClass.WIRE).sum()))} on wires',
        ),
    ]


def _describe_groups(
    inspection: Inspection, scene: Scene, clearances: Mapping[SpanKey, float | None] | None
) -> list[Record]:
    """Return what the page shows of each span: its lines, hazards and figures."""
    settings = inspection.settings.hazards
    rules = inspection.rules or plain_rules(settings)
    limits = [limit for limit in rules.find('vegetation') if limit.where != 'under']
    styles = {Severity.WARNING: 'zone warn', Severity.CRITICAL: 'zone crit'}
    distances = {
        styles[severity]: distance * scene.metre
        for limit in limits[:1] for severity, distance in limit.tiers if severity in styles
    }
    required = max((limit.distance for limit in limits), default=0.0) * scene.metre
    if clearances is None:
        clearances = measure_clearances(inspection.result, settings.min_points)
    wires = WirePoints(inspection.result, inspection.points)
    groups = []
    for span_id in sorted({span['span_id'] for span in scene.spans}):
        section, where = draw_section(scene, span_id, distances)
        spans = [span for span in scene.spans if span['span_id'] == span_id]
        groups.append({
            'span_id': span_id,
            'spans': spans,
            'length': max(span['length'] for span in spans),
            'profile': Markup(draw_profile(scene, span_id, required)),  # nosec B704
            'plan': Markup(draw_plan(scene, span_id, required)),  # nosec B704
            'section': Markup(section),  # nosec B704
            'residuals': Markup(draw_residuals(scene, inspection.result, wires, span_id)),  # nosec B704
            'where': where,
            'clearances': {
                line_id: None if distance is None else distance * scene.metre
                for (line_id, other), distance in clearances.items() if other == span_id
            },
            'hazards': [item for item in scene.hazards if item['span_id'] == span_id],
        })
    return groups


def _describe_stage(stage: StageReport) -> Record:
    figure, caption = draw_stage(stage)
    return {
        'figure': Markup(figure),  # nosec B704
        'caption': caption,
        'name': stage.name,
        'about': STAGES.get(stage.name, ''),
        'num_in': stage.num_in,
        'num_kept': stage.num_kept,
        'share': stage.num_kept / stage.num_in if stage.num_in else 0.0,
        'dropped': stage.dropped,
        'values': _list_values(stage.values),
        'seconds': stage.seconds,
    }


def _list_values(values: Mapping[str, Any], prefix: str = '') -> list[tuple[str, str | Markup]]:
    """Return names and texts of a nested mapping; long lists of numbers become bars."""
    rows: list[tuple[str, str | Markup]] = []
    for name, value in values.items():
        value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        label = f'{prefix}{name}'.replace('_', ' ')
        if isinstance(value, Mapping):
            rows += _list_values(value, f'{prefix}{name}: ')
        elif isinstance(value, list | tuple) and len(value) > _LONG_LIST and all(
            isinstance(item, int | float) for item in value
        ):
            title = f'{len(value)} values, {min(value):g} to {max(value):g}'
            rows.append((label, Markup(draw_bars(value, title))))  # nosec B704
        elif isinstance(value, list | tuple):
            rows.append((label, _format_list(value)))
        else:
            rows.append((label, _format_value(value)))
    return rows


def _format_list(values: list[Any] | tuple[Any, ...]) -> str:
    shown = [
        '(' + ', '.join(f'{name} {_format_value(item)}' for name, item in value.items()) + ')'
        if isinstance(value, Mapping) else _format_value(value)
        for value in values[: 2 * _LONG_LIST]
    ]
    more = f' and {len(values) - len(shown)} more' if len(values) > len(shown) else ''
    return ', '.join(shown) + more


def _format_value(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: 'yes', False: 'no', None: '\u2013'}[value]
    if isinstance(value, int):
        return _format_count(value)
    if isinstance(value, float):
        return f'{value:.4g}'.replace('-', '\u2212')
    if isinstance(value, list | tuple):
        return '[' + ', '.join(_format_value(item) for item in value) + ']'
    return str(value)


def _tally(values: np.ndarray, names: type[Decision] | type[PointClass]) -> list[tuple[str, int]]:
    counts = {item: int(np.count_nonzero(values == item)) for item in names}
    return [
        (item.name.lower().replace('_', ' '), count) for item, count in counts.items() if count
    ]


def _list_settings(inspection: Inspection) -> list[Record]:
    """Return every setting with its value and whether it is the default."""
    values = to_mapping(inspection.settings)
    rows = []
    for name, default, meta in describe():
        section, _, key = name.partition('.')
        value = values[section][key]
        plain = list(default) if isinstance(default, tuple) else default
        rows.append({
            'name': name,
            'value': _format_value(value),
            'unit': meta['unit'],
            'about': meta['description'],
            'changed': value != plain,
        })
    return rows


def _load_page() -> jinja2.Template:
    environment = open_templates('offline/report/templates')
    environment.filters.update(
        number=format_number, count=_format_count, percent=_format_percent, coordinate=_place,
        css_text=quote_css, measured=lambda item: find_measured(item)[0],
    )
    return environment.get_template('report.html.j2')


PAGE = _load_page()
