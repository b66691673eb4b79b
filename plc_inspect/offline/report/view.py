# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Data of the report's three-dimensional view: quantised points, curves, hazards."""

import base64
import json
import math

import numpy as np

from plc_inspect.colors import line_color, SEVERITY_COLORS
from plc_inspect.offline.records.sentences import find_measured
from plc_inspect.offline.records.span_curve import TOLERANCE, trace_span
from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.point_scene import PALETTE, Scene
from plc_inspect.results import Float64

MOST_POINTS = 350_000
"""More points are thinned out; each takes nine characters of the page."""
_STEPS = 2**16 - 1


def encode_view(scene: Scene) -> str:
    """
    Return the content of the view as JSON that is safe within a script element.

    Coordinates are in the horizontal unit of the input, relative to the middle of the points, so
    that float32 keeps them; points are on a grid of 65,536 steps a side.

    Parameters
    ----------
    scene : Scene
        Thinned out points with colours, and records.

    Returns
    -------
    str
        '' where there are no points.

    """
    step = 1 + len(scene.points) // MOST_POINTS
    points, color = scene.points[::step], scene.color[::step]
    if not len(points):
        return ''
    low, high = points.min(axis=0), points.max(axis=0)
    middle = np.round((low + high) / 2)
    size = np.maximum(high - low, 1e-6)
    grid = np.rint((points - low) / size * _STEPS).astype('<u2')
    focus, extent, azimuth = _choose_view(scene, low, high)
    data = {
        'points': base64.b64encode(np.ascontiguousarray(grid).tobytes()).decode('ascii'),
        'colors': base64.b64encode(color.tobytes()).decode('ascii'),
        'palette': list(PALETTE),
        'low': _list(low - middle),
        'size': _list(size),
        'center': _list(focus - middle),
        'extent': round(extent, 3),
        'azimuth': round(azimuth, 4),
        'metre': scene.metre,
        'lines': [
            {'color': line_color(span['line_id']),
             'xyz': _list((trace_span(span, TOLERANCE * scene.metre) - middle).ravel())}
            for span in scene.spans
        ] + [
            {'color': '#1d2733', 'xyz': _list(_stand(item) - np.tile(middle, 2))}
            for item in scene.supports
        ],
        'hazards': [
            {'id': item['hazard_id'], 'xyz': _list(np.array(item['position']) - middle),
             'color': SEVERITY_COLORS[item['severity']],
             'title': f'{item["severity"]} {item["kind"]}, {find_measured(item)[0]:.2f}'
                      f' {scene.unit}'}
            for item in scene.hazards
        ],
    }
    return json.dumps(data, separators=(',', ':')).replace('<', '\\u003c')


def _choose_view(scene: Scene, low: Float64, high: Float64) -> tuple[Float64, float, float]:
    """Return target, extent and direction of the initial view."""
    if not scene.spans:
        return (low + high) / 2, float(np.hypot(*(high - low)[:2])), -math.pi / 2
    ends = np.array([span[name] for span in scene.spans for name in ('start', 'end')])
    extent = max(float(np.hypot(*(ends.max(axis=0) - ends.min(axis=0))[:2])), 20 * scene.metre)
    along = np.subtract(scene.spans[0]['end'], scene.spans[0]['start'])
    focus = (ends.min(axis=0) + ends.max(axis=0)) / 2
    return focus, extent, math.atan2(along[1], along[0]) - 1.1


def _stand(support: Record) -> Float64:
    """Return foot and top of a support, (6,)."""
    x, y, z = support['position']
    return np.array([x, y, z, x, y, z + (support['height'] or 0.0)])


def _list(values: Float64) -> list[float]:
    return [round(float(value), 3) for value in values]
