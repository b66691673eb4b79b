# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures of the report: the map, and a profile and a cross-section of each span."""

from itertools import pairwise
import math

import numpy as np

from plc_inspect.colors import line_color, SEVERITY_COLORS
from plc_inspect.core.hazards.confidence import find_doubts
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.drawing import Plot
from plc_inspect.offline.report.point_scene import FIRST_STRUCTURE, FIRST_TREE, PALETTE, Scene
from plc_inspect.offline.report.span_frame import find_frame
from plc_inspect.results import catenary_heights, Float64, UInt8

PROFILE_SIZE = (1060, 330)
_LABEL_ROOM, _NUMBER_ROOM = 60.0, 22.0
"""Distance between span labels below which they become numbers, and are omitted [px]."""
_SECTION_SIZE = (430, 330)
_MAP_WIDTH = 1060
_MAP_HEIGHTS = (300, 820)


def draw_map(scene: Scene) -> str:
    """Return the top view, north up, as SVG; empty without points."""
    if not len(scene.points):
        return ''
    if scene.spans:
        ends = np.array([span[name][:2] for span in scene.spans for name in ('start', 'end')])
        margin = 40.0 * scene.metre
        low, high = ends.min(axis=0) - margin, ends.max(axis=0) + margin
    else:
        low, high = scene.points[:, :2].min(axis=0), scene.points[:, :2].max(axis=0)
    extent = np.maximum(high - low, 2.0 * scene.metre)
    top, right, bottom, left = margins = (8, 8, 38, 62)
    inner = _MAP_WIDTH - left - right
    height = float(np.clip(inner * extent[1] / extent[0], *_MAP_HEIGHTS))
    scale = max(extent[0] / inner, extent[1] / height)
    half = np.array([inner, round(height)]) * scale / 2
    center = (low + high) / 2
    plot = Plot(
        (center[0] - half[0], center[0] + half[0]), (center[1] - half[1], center[1] + half[1]),
        (_MAP_WIDTH, round(height) + top + bottom), 'Top view', margins=margins,
    )
    order = np.argsort(scene.color >= FIRST_STRUCTURE, kind='stable')
    x, y = scene.points[order, :2].T
    plot.add_points(x, y, scene.color[order], PALETTE, size=1, fill=2)
    for span in scene.spans:
        (x0, y0, _), (x1, y1, _) = span['start'], span['end']
        label = f'line {span["line_id"]}, span {span["span_id"]}'
        plot.add_line(
            np.array([x0, x1]), np.array([y0, y1]), 'wire ' + line_color(span['line_id']), label
        )
    for support in scene.supports:
        x, y, _ = support['position']
        label = f'support {support["support_id"]}: {support["kind"]}'
        plot.add_square(x, y, 9.0, 'support', label)
    _label_spans(plot, scene)
    for hazard in scene.hazards:
        add_badge(plot, hazard['position'][0], hazard['position'][1], hazard)
    plot.add_axes(
        _axis_name('x', scene.origin[0], scene.unit), _axis_name('y', scene.origin[1], scene.unit),
        grid=False,
    )
    plot.add_scale_bar(scene.unit)
    return plot.render('map')


def draw_profile(scene: Scene, span_id: int, required: float = 0.0) -> str:
    """
    Return the side view of all lines of a span, as SVG.

    Parameters
    ----------
    scene : Scene
        What is shown.
    span_id : int
        Which span.
    required : float
        Clearance to vegetation, drawn as an envelope below the lowest conductor [unit of the
        input]; 0: none.

    Returns
    -------
    str

    """
    frame = find_frame(scene, span_id)
    spans, origin, along, across = frame.spans, frame.origin, frame.along, frame.across
    stations, offsets, margin = frame.stations, frame.offsets, frame.margin
    reach = 6.0 * scene.metre
    low, high = stations.min() - margin, stations.max() + margin
    rows, s, t = frame.locate(scene, low, high, reach)
    near = (s > low) & (s < high)
    near &= (t > offsets.min() - reach) & (t < offsets.max() + reach)
    rows, s = rows[near], s[near]
    z, color = scene.points[rows, 2], scene.color[rows]
    hazards = [hazard for hazard in scene.hazards if hazard['span_id'] == span_id]
    curves = {span['line_id']: sample(span, 161) for span in spans}
    heights = np.concatenate([curve[:, 2] for curve in curves.values()])
    heights = np.concatenate((heights, [hazard['position'][2] for hazard in hazards]))
    if len(z):
        heights = np.concatenate((heights, np.percentile(z, (0.2, 99.8))))
    room = max(0.06 * (heights.max() - heights.min()), 1.0 * scene.metre)
    plot = Plot(
        (low, high), (heights.min() - room, heights.max() + 2 * room), PROFILE_SIZE,
        f'Profile of span {span_id}',
    )
    order = np.argsort(color, kind='stable')
    plot.add_points(s[order], z[order], color[order], PALETTE)
    _add_supports(plot, scene, origin, along, across, (offsets.min(), offsets.max()))
    for span in spans:
        curve = curves[span['line_id']]
        label = f'line {span["line_id"]}: sag {span["sag"]:.2f} {scene.unit}'
        plot.add_line(
            (curve[:, :2] - origin) @ along, curve[:, 2],
            'wire ' + line_color(span['line_id']), label,
        )
    _add_ground(plot, s, z, color)
    if required > 0:
        _add_envelope(plot, [curves[span['line_id']] for span in spans], origin, along, required,
                      scene.unit)
    _add_sag(plot, max(spans, key=lambda span: span['sag']), origin, along, scene.unit)
    for hazard in hazards:
        position = np.array(hazard['position'])
        station = float((position[:2] - origin) @ along)
        if hazard['line_id'] in curves:
            curve = curves[hazard['line_id']]
            nearest = curve[np.argmin(np.linalg.norm(curve - position, axis=1))]
            plot.add_line(
                np.array([station, (nearest[:2] - origin) @ along]),
                np.array([position[2], nearest[2]]), 'leader',
            )
        add_badge(plot, station, position[2], hazard)
    plot.add_axes(f'along the span [{scene.unit}]', f'z [{scene.unit}]')
    return plot.render(f'profile{span_id}')


def draw_section(scene: Scene, span_id: int, distances: dict[str, float]) -> tuple[str, str]:
    """
    Return a view along the lines of a span, as SVG, and where it was cut.

    Parameters
    ----------
    scene : Scene
        What is shown.
    span_id : int
        Which span.
    distances : mapping
        CSS class to radius [units of the input] of circles around the conductors.

    Returns
    -------
    The drawing, and a sentence that says where it was cut and how thick the slice is.

    """
    frame = find_frame(scene, span_id)
    spans, origin, along, across = frame.spans, frame.origin, frame.along, frame.across
    hazards = [hazard for hazard in scene.hazards if hazard['span_id'] == span_id]
    if hazards:
        place = min(hazards, key=rank)
        station = float((np.array(place['position'][:2]) - origin) @ along)
        where = f'at hazard {place["hazard_id"]}'
    else:
        stations = [(np.array(span['lowest'][:2]) - origin) @ along for span in spans]
        station, where = float(np.median(stations)), 'at the lowest point'
    curves = [sample(span, 401) for span in spans]
    cuts = [curve[np.argmin(np.abs((curve[:, :2] - origin) @ along - station))]
            for curve in curves]
    offsets = np.array([(cut[:2] - origin) @ across for cut in cuts])
    heights = np.array([cut[2] for cut in cuts])
    half = 2.5 * scene.metre
    reach = max([8.0 * scene.metre, *distances.values()])
    low, high = offsets.min() - reach, offsets.max() + reach
    rows, s, t = frame.locate(scene, station - half, station + half, 2 * reach)
    near = (np.abs(s - station) < half) & (t > low - reach) & (t < high + reach)
    rows, t = rows[near], t[near]
    z, color = scene.points[rows, 2], scene.color[rows]
    bottom = float(np.percentile(z, 1.0)) if len(z) else heights.min() - reach
    top = heights.max() + reach / 2
    bottom = min(bottom, heights.min()) - 1.0 * scene.metre
    margins = (10, 12, 40, 56)
    inner = (_SECTION_SIZE[0] - 68, _SECTION_SIZE[1] - 50)
    scale = max((high - low) / inner[0], (top - bottom) / inner[1])
    middle, center = (low + high) / 2, (bottom + top) / 2
    plot = Plot(
        (middle - inner[0] * scale / 2, middle + inner[0] * scale / 2),
        (center - inner[1] * scale / 2, center + inner[1] * scale / 2),
        _SECTION_SIZE, f'Cross-section of span {span_id}', margins=margins,
    )
    order = np.argsort(color, kind='stable')
    plot.add_points(t[order], z[order], color[order], PALETTE)
    for style, radius in distances.items():
        for offset, height in zip(offsets, heights, strict=True):
            plot.add_circle(offset, height, radius, style, in_data=True)
    for span, offset, height in zip(spans, offsets, heights, strict=True):
        plot.add_circle(offset, height, 4.0, 'dot ' + line_color(span['line_id']),
                        f'line {span["line_id"]}')
    for hazard in hazards:
        position = np.array(hazard['position'])
        if abs((position[:2] - origin) @ along - station) < half:
            add_badge(plot, float((position[:2] - origin) @ across), position[2], hazard)
    plot.add_axes(f'across [{scene.unit}]', f'z [{scene.unit}]')
    thickness = f'{2 * half:.1f} {scene.unit}'
    return plot.render(f'section{span_id}'), f'{where}, points within a slice of {thickness}'


def sample(span: Record, count: int) -> Float64:
    """Return points (count, 3) of the curve, in units of the input."""
    share = np.linspace(0.0, 1.0, count)
    start, end = np.array(span['start']), np.array(span['end'])
    curve = start + share[:, np.newaxis] * (end - start)
    curve[:, 2] = catenary_heights(span['a'], span['b'], span['c'], share * span['length'])
    return curve


def _add_sag(plot: Plot, span: Record, origin: Float64, along: Float64, unit: str) -> None:
    """Draw chord and sag of one span."""
    curve = sample(span, 161)
    stations = (curve[:, :2] - origin) @ along
    chord = np.linspace(curve[0, 2], curve[-1, 2], len(curve))
    deepest = int(np.argmax(chord - curve[:, 2]))
    plot.add_line(stations[[0, -1]], chord[[0, -1]], 'chord')
    plot.add_line(
        stations[[deepest, deepest]], np.array([chord[deepest], curve[deepest, 2]]), 'chord'
    )
    text = f'sag {span["sag"]:.2f} {unit} (line {span["line_id"]})'
    plot.add_text(stations[deepest], chord[deepest], text, 'note mid', dy=-5.0)


def _add_ground(plot: Plot, s: Float64, z: Float64, color: UInt8) -> None:
    """Draw the ground as the median of its points in each step along the span."""
    ground = color < FIRST_TREE
    if ground.sum() < 10:
        return
    low, high = plot.x_range
    place = np.clip(((s[ground] - low) / (high - low) * 120).astype(np.int64), 0, 119)
    order = np.argsort(place, kind='stable')
    steps, first = np.unique(place[order], return_index=True)
    heights = [float(np.median(part)) for part in np.split(z[ground][order], first[1:])]
    plot.add_line(low + (steps + 0.5) * (high - low) / 120, np.array(heights), 'ground', 'ground')


def _add_envelope(
    plot: Plot, curves: list[Float64], origin: Float64, along: Float64, required: float, unit: str
) -> None:
    """Draw the lower edge of the required clearance around the conductors."""
    stations = np.linspace(*plot.x_range, 241)
    lowest = np.full(len(stations), np.inf)
    for curve in curves:
        x = (curve[:, :2] - origin) @ along
        order = np.argsort(x)
        for step in np.linspace(-required, required, 21):
            drop = math.sqrt(max(required**2 - step**2, 0.0))
            height = np.interp(stations + step, x[order], curve[order, 2] - drop,
                               left=np.inf, right=np.inf)
            lowest = np.minimum(lowest, height)
    known = np.isfinite(lowest)
    plot.add_line(stations[known], lowest[known], 'zone warn', f'required {required:.2f} {unit}')


def _add_supports(
    plot: Plot, scene: Scene, origin: Float64, along: Float64, across: Float64,
    offsets: tuple[float, float],
) -> None:
    for support in scene.supports:
        position = np.array(support['position'])
        station = float((position[:2] - origin) @ along)
        offset = float((position[:2] - origin) @ across)
        reach = 10.0 * scene.metre
        low, high = plot.x_range
        if low < station < high and offsets[0] - reach < offset < offsets[1] + reach:
            plot.add_line(
                np.array([station, station]),
                np.array([position[2], position[2] + support['height']]),
                'mast', f'support {support["support_id"]}: {support["kind"]}',
            )


def _label_spans(plot: Plot, scene: Scene) -> None:
    """Write the number of each span above the middle of its lines where space permits."""
    labels = []
    for span_id in sorted({span['span_id'] for span in scene.spans}):
        middles = np.array([
            np.add(span['start'][:2], span['end'][:2]) / 2
            for span in scene.spans if span['span_id'] == span_id
        ])
        x, y = middles[np.argmax(middles[:, 1])]
        labels.append((span_id, x, y, np.array(plot.to_pixels(np.array(x), np.array(y)))))
    gaps = [math.dist(first[3], second[3]) for first, second in pairwise(labels)]
    crowded = min(gaps, default=math.inf) < _LABEL_ROOM
    placed: list[Float64] = []
    for span_id, x, y, at in labels:
        if all(abs(at - other).max() > _NUMBER_ROOM for other in placed):
            text = str(span_id) if crowded else f'span {span_id}'
            plot.add_text(x, y, text, 'label mid', dy=-14.0)
            placed.append(at)


def add_badge(plot: Plot, x: float, y: float, hazard: Record) -> None:
    """Draw the number of a hazard in the colour of its severity."""
    label = f'hazard {hazard["hazard_id"]}: {hazard["severity"]} {hazard["kind"]}'
    plot.add_circle(x, y, 8.0, 'badge ' + SEVERITY_COLORS[hazard['severity']], label)
    plot.add_text(x, y, str(hazard['hazard_id']), 'number mid', dy=3.5)


def rank(hazard: Record) -> tuple[int, bool, bool, float]:
    """
    Sort key of hazards, worst first: severity, certainty, contact, kept share of the clearance.

    The excess of a sag is not a clearance: the greater, the worse.
    """
    doubtful = bool(find_doubts(hazard.get('note', '')))
    order = list(SEVERITY_COLORS).index(hazard['severity']), doubtful
    (clearance, _), required = find_measured(hazard), hazard['required']
    if clearance is None or not required:
        return *order, True, math.inf if clearance is None else clearance
    if hazard['kind'] == 'sag':
        return *order, True, required / max(clearance, required)
    return *order, clearance > 0.0, clearance if clearance < 0.0 else clearance / required


def _axis_name(name: str, origin: float, unit: str) -> str:
    return f'{name} \u2212 {origin:,.0f} [{unit}]' if origin else f'{name} [{unit}]'
