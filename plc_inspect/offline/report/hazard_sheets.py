# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A sheet for each hazard of the printed report: profile, plan and a picture in 3D."""

from dataclasses import dataclass
import math

from markupsafe import Markup
import numpy as np

from plc_inspect.colors import line_color
from plc_inspect.offline.records.sentences import describe_place
from plc_inspect.offline.records.units import Record
from plc_inspect.offline.report.drawing import Plot
from plc_inspect.offline.report.figures import add_badge, rank, sample
from plc_inspect.offline.report.point_scene import PALETTE, Scene
from plc_inspect.offline.report.span_frame import find_frame
from plc_inspect.results import Float64, Int64

_SIZE, _VIEW_SIZE = (1060, 320), (1060, 430)
_MARGINS = (10, 12, 40, 56)
_VIEW_MARGINS = (4, 4, 4, 4)
_LEAST_HALF = 7.0
"""Least half height of the figures [m]."""
_MOST_BELOW = 30.0
"""Greatest height shown of a hazard below its nearest point [m]."""
_ROOM = 3.0
"""Margin above the conductor and below the object [m]."""
VIEW_TILT_DEG = 22.0
"""Elevation of the camera of the 3D picture [deg]."""
_TURN, _TILT = math.radians(50.0), math.radians(VIEW_TILT_DEG)
"""Direction of the camera: from the line, and above the horizontal [rad]."""
_CURVE_POINTS = 401


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Place:
    """A hazard and its surroundings, along the span, across and up; units of the input."""

    hazard: Record
    rows: Int64
    points: Float64
    """(N, 3) along, across, z."""
    curves: list[tuple[int, Float64]]
    """Line, and (K, 3) along, across, z, of each conductor that passes."""
    spot: Float64
    """(3,) the nearest point of the hazard."""
    wire: Float64
    """(3,) the point of the conductor nearest to it."""
    center: Float64
    """(3,) of the figures."""
    half: float
    """Half of their height."""


def list_sheets(scene: Scene) -> list[Record]:
    """
    Return the sheets of all hazards, the worst first.

    Parameters
    ----------
    scene : Scene
        What is shown.

    Returns
    -------
    list of dict
        Each hazard with ``text`` and the figures ``profile``, ``plan`` and ``view``.

    """
    sheets = []
    for hazard in sorted(scene.hazards, key=rank):
        place = _find_place(scene, hazard)
        sheets.append(hazard | {
            'text': describe_place(hazard, scene.unit, scene.metre),
            'profile': Markup(_draw_flat(scene, place, 2)),  # nosec B704
            'plan': Markup(_draw_flat(scene, place, 1)),  # nosec B704
            'view': Markup(_draw_view(scene, place)),  # nosec B704
        })
    return sheets


def _find_place(scene: Scene, hazard: Record) -> _Place:
    position = np.array(hazard['position'])
    known = any(span['span_id'] == hazard['span_id'] for span in scene.spans)
    origin, along = position[:2], np.array([1.0, 0.0])
    if known:
        frame = find_frame(scene, hazard['span_id'])
        origin, along = frame.origin, frame.along
    axes = np.array([along, [-along[1], along[0]]])

    def enter(points: Float64) -> Float64:
        return np.column_stack([(points[:, :2] - origin) @ axes.T, points[:, 2]])

    spot = enter(position[None, :])[0]
    curves = [(span['line_id'], enter(sample(span, _CURVE_POINTS))) for span in scene.spans]
    own = [curve for (line, curve), span in zip(curves, scene.spans, strict=True)
           if line == hazard['line_id'] and span['span_id'] == hazard['span_id']]
    wire = spot if not own else own[0][np.argmin(np.linalg.norm(own[0] - spot, axis=1))]
    below = min(hazard['height'] or 0.0, _MOST_BELOW * scene.metre)
    low = min(spot[2] - below, wire[2]) - _ROOM * scene.metre
    high = max(spot[2], wire[2]) + _ROOM * scene.metre
    half = max((high - low) / 2, _LEAST_HALF * scene.metre, float(np.abs(spot - wire)[1]))
    center = np.array([spot[0], (spot[1] + wire[1]) / 2, (low + high) / 2])
    reach = half * _SIZE[0] / _SIZE[1] + _ROOM * scene.metre
    points = scene.points
    rows = np.flatnonzero(
        (np.abs(points[:, 0] - position[0]) < 1.5 * reach)
        & (np.abs(points[:, 1] - position[1]) < 1.5 * reach)
    )
    return _Place(
        hazard=hazard, rows=rows, points=enter(points[rows]), curves=curves, spot=spot, wire=wire,
        center=center, half=half,
    )


def _draw_flat(scene: Scene, place: _Place, axis: int) -> str:
    """Draw the surroundings of a hazard along the span: z (axis 2) or across (axis 1)."""
    inner = (_SIZE[0] - _MARGINS[1] - _MARGINS[3], _SIZE[1] - _MARGINS[0] - _MARGINS[2])
    wide = place.half * inner[0] / inner[1]
    name = {2: 'profile', 1: 'plan'}[axis]
    number = place.hazard['hazard_id']
    plot = Plot(
        (place.center[0] - wide, place.center[0] + wide),
        (place.center[axis] - place.half, place.center[axis] + place.half),
        _SIZE, f'{name.capitalize()} at hazard {number}', margins=_MARGINS,
    )
    points, color = place.points, scene.color[place.rows]
    if axis == 2:  # points far to the side would hide it
        near = np.abs(points[:, 1] - place.center[1]) < place.half
        points, color = points[near], color[near]
    order = np.argsort(color if axis == 2 else points[:, 2], kind='stable')
    plot.add_points(points[order, 0], points[order, axis], color[order], PALETTE, size=3)
    for line, curve in place.curves:
        plot.add_line(curve[:, 0], curve[:, axis], 'wire ' + line_color(line), f'line {line}')
    ends = np.array([place.spot, place.wire])
    plot.add_line(ends[:, 0], ends[:, axis], 'leader')
    add_badge(plot, float(place.spot[0]), float(place.spot[axis]), place.hazard)
    unit = scene.unit
    plot.add_axes(f'along the span [{unit}]', f'z [{unit}]' if axis == 2 else f'across [{unit}]')
    return plot.render(f'{name}-of-{number}')


def _draw_view(scene: Scene, place: _Place) -> str:
    """Draw the surroundings of a hazard obliquely from above, in parallel projection."""
    half = 1.5 * place.half
    wide = half * _VIEW_SIZE[0] / _VIEW_SIZE[1]
    right = np.array([math.sin(_TURN), -math.cos(_TURN), 0.0])
    away = np.array([math.cos(_TURN) * math.cos(_TILT), math.sin(_TURN) * math.cos(_TILT),
                     -math.sin(_TILT)])
    up = np.cross(right, away)
    number = place.hazard['hazard_id']
    plot = Plot((-wide, wide), (-half, half), _VIEW_SIZE, f'View of hazard {number}',
                margins=_VIEW_MARGINS)
    moved = place.points - place.center
    near = np.linalg.norm(moved[:, :2], axis=1) < wide
    moved, color = moved[near], scene.color[place.rows[near]]
    order = np.argsort(-(moved @ away), kind='stable')  # near points are drawn last
    plot.add_points(
        moved[order] @ right, moved[order] @ up, color[order], PALETTE, size=3, fill=1
    )
    for line, curve in place.curves:
        own = curve - place.center
        plot.add_line(own @ right, own @ up, 'wire ' + line_color(line), f'line {line}')
    ends = np.array([place.spot, place.wire]) - place.center
    plot.add_line(ends @ right, ends @ up, 'leader')
    add_badge(plot, float(ends[0] @ right), float(ends[0] @ up), place.hazard)
    plot.add_scale_bar(scene.unit)
    return plot.render(f'view-of-{number}')
