# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures of the report for stages: histograms and residuals."""

from collections.abc import Callable, Sequence
import math

import numpy as np

from plc_inspect.colors import LINE_COLORS
from plc_inspect.core.tracking.wire_points import WirePoints
from plc_inspect.offline.report.drawing import Plot
from plc_inspect.offline.report.figures import PROFILE_SIZE
from plc_inspect.offline.report.point_scene import Scene
from plc_inspect.results import InspectionResult, StageReport

_STAGE_SIZE = (520, 190)
_RESIDUAL_SIZE = (PROFILE_SIZE[0], 190)
_COLOR = '#4f8fb8'
_MOST_POINTS = 20_000
"""Most points whose residuals are drawn; more are thinned."""


def draw_stage(stage: StageReport) -> tuple[str, str]:
    """
    Return the figure of a stage as SVG, and its caption.

    Parameters
    ----------
    stage : StageReport
        Of the run.

    Returns
    -------
    tuple of str
        Both empty for a stage that has no figure.

    """
    draw = _FIGURES.get(stage.name)
    return draw(stage) if draw else ('', '')


def draw_residuals(
    scene: Scene, result: InspectionResult, wires: WirePoints, span_id: int
) -> str:
    """
    Return the vertical residuals of the wire points of a span along it, as SVG.

    Parameters
    ----------
    scene : Scene
        Names the unit.
    result : InspectionResult
        Holds the spans.
    wires : WirePoints
        Of that result.
    span_id : int
        Which span, all of its lines.

    Returns
    -------
    str
        Empty without wire points.

    """
    parts = []
    for span in (item for item in result.spans if item.span_id == span_id):
        points, _ = wires.take(span)
        points = points[:: 1 + len(points) // _MOST_POINTS]
        run = np.array([math.cos(span.azimuth), math.sin(span.azimuth)])
        x = (points[:, :2] - span.start[:2]) @ run
        miss = points[:, 2] - span.heights(x)
        color = np.full(len(x), 1 + span.line_id % len(LINE_COLORS), np.uint8)
        parts.append((x, miss, color))
    if not sum(len(x) for x, _, _ in parts):
        return ''
    x, miss, color = (np.concatenate(column) for column in zip(*parts, strict=True))
    x, miss = x * scene.metre, miss * scene.metre
    reach = _round_up(max(float(np.percentile(np.abs(miss), 99.5)), 0.02 * scene.metre))
    length = float(x.max() - x.min()) or 1.0
    plot = Plot(
        (x.min() - 0.02 * length, x.max() + 0.02 * length), (-reach, reach), _RESIDUAL_SIZE,
        f'Residuals of span {span_id}',
    )
    plot.add_points(x, miss, color, ('#ffffff', *LINE_COLORS))
    plot.add_line(np.array(plot.x_range), np.zeros(2), 'chord')
    plot.add_axes(f'along each line [{scene.unit}]', f'residual [{scene.unit}]')
    return plot.render(f'residuals{span_id}')


def _round_up(value: float) -> float:
    """Round up to 1, 2, 5, 10 ..., so that the axis ends at a tick."""
    power: float = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value)


def _draw_heights(stage: StageReport) -> tuple[str, str]:
    values = stage.values
    if values.get('threshold') is None or not sum(values.get('histogram', ())):
        return '', ''
    low, high = values['edges']
    figure = _draw_histogram(
        stage.name, values['histogram'], (low, high), values['threshold'],
        'height above ground [m]', 'points',
    )
    return figure, 'Heights above local ground; dashed the threshold: points right of it are kept.'


def _draw_likeness(stage: StageReport) -> tuple[str, str]:
    values = stage.values
    if not sum(values.get('likeness_of_all', ())):
        return '', ''
    figure = _draw_histogram(
        stage.name, values['likeness_of_all'], (0.0, 1.0), values['threshold'],
        'linear likeness', 'neighbourhoods',
    )
    return figure, (
        'Linear likeness of all neighbourhoods with enough points, at all scales; dashed the'
        ' threshold: those right of it are candidates if they are near horizontal.'
    )


_FIGURES: dict[str, Callable[[StageReport], tuple[str, str]]] = {
    'height': _draw_heights,
    'linearity': _draw_likeness,
}


def _draw_histogram(
    name: str, counts: Sequence[int], ends: tuple[float, float], threshold: float, x_label: str,
    y_label: str,
) -> str:
    """Return counts on a logarithmic scale as steps, with a line at the threshold."""
    edges = np.linspace(*ends, len(counts) + 1)
    heights = np.log10(np.maximum(np.asarray(counts, np.float64), 0.5))
    top = max(float(heights.max()) * 1.08, 1.0)
    plot = Plot(ends, (math.log10(0.5), top), _STAGE_SIZE, f'{name}: {x_label}')
    plot.add_line(
        np.repeat(edges, 2), np.concatenate([[math.log10(0.5)], np.repeat(heights, 2),
                                             [math.log10(0.5)]]), 'wire ' + _COLOR)
    plot.add_line(
        np.full(2, threshold), np.array(plot.y_range), 'zone warn', f'threshold {threshold:.3g}'
    )
    plot.add_text(threshold, top, f'{threshold:.3g}', 'note', dx=4.0, dy=12.0)
    plot.add_axes(x_label, f'log\u2081\u2080 {y_label}')
    return plot.render(f'stage_{name}')
