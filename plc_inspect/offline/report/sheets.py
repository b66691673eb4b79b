# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sheets of the report: each span in plan, at the scale of its profile."""

import numpy as np

from plc_inspect.colors import line_color
from plc_inspect.offline.report.drawing import Plot
from plc_inspect.offline.report.figures import add_badge, PROFILE_SIZE, sample
from plc_inspect.offline.report.point_scene import PALETTE, Scene
from plc_inspect.offline.report.span_frame import find_frame

_TOP, _RIGHT, _BOTTOM, _LEFT = 10, 12, 40, 56
_HEIGHTS = (110, 420)


def draw_plan(scene: Scene, span_id: int, required: float) -> str:
    """
    Return a span from above, its lines from left to right, as SVG.

    Parameters
    ----------
    scene : Scene
        What is shown.
    span_id : int
        Which span.
    required : float
        Clearance to vegetation, drawn beside the outer conductors [unit of the input].

    Returns
    -------
    str

    """
    frame = find_frame(scene, span_id)
    spans, origin, along, across = frame.spans, frame.origin, frame.along, frame.across
    stations, offsets, margin = frame.stations, frame.offsets, frame.margin
    half = max(required + 4.0 * scene.metre, 10.0 * scene.metre)
    low, high = stations.min() - margin, stations.max() + margin
    inner = PROFILE_SIZE[0] - _LEFT - _RIGHT
    height = float(np.clip(
        inner * (offsets.max() - offsets.min() + 2 * half) / (high - low), *_HEIGHTS
    ))
    middle = (offsets.min() + offsets.max()) / 2
    reach = height * (high - low) / inner / 2
    rows, s, t = frame.locate(scene, low, high, max(middle + reach, reach - middle))
    near = (s > low) & (s < high) & (np.abs(t - middle) < reach)
    rows, s, t = rows[near], s[near], t[near]
    plot = Plot(
        (low, high), (middle - reach, middle + reach),
        (PROFILE_SIZE[0], round(height) + _TOP + _BOTTOM), f'Plan of span {span_id}',
        margins=(_TOP, _RIGHT, _BOTTOM, _LEFT),
    )
    plot.add_points(s, t, scene.color[rows], PALETTE, fill=1)
    edges = []
    for span in spans:
        curve = sample(span, 3)
        x, y = ((curve[:, :2] - origin) @ axis for axis in (along, across))
        plot.add_line(x, y, 'wire ' + line_color(span['line_id']), f'line {span["line_id"]}')
        edges.append((x, y))
    for pick, sign in ((max, 1.0), (min, -1.0)):
        x, y = pick(edges, key=lambda edge: float(edge[1].mean()))
        plot.add_line(x, y + sign * required, 'zone warn', f'required {required:.2f} {scene.unit}')
    for support in scene.supports:
        x, y = ((np.array(support['position'][:2]) - origin) @ axis for axis in (along, across))
        if low < x < high and abs(y - middle) < reach:
            plot.add_square(float(x), float(y), 9.0, 'support',
                            f'support {support["support_id"]}: {support["kind"]}')
    for hazard in scene.hazards:
        if hazard['span_id'] == span_id:
            x, y = ((np.array(hazard['position'][:2]) - origin) @ axis for axis in (along, across))
            add_badge(plot, float(x), float(y), hazard)
    plot.add_axes(f'along the span [{scene.unit}]', f'across [{scene.unit}]')
    return plot.render(f'plan{span_id}')
