# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Markers for RViz and Foxglove: catenaries, supports and hazards, each with a stable id.

ROS is not imported here; node, playback and recorder all make their messages from these marks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
import enum
from typing import TYPE_CHECKING

import numpy as np

from plc_inspect.colors import (
    line_color,
    OK_COLOR,
    parse_color,
    SEVERITY_COLORS,
    SUPPORT_COLOR,
    TEXT_COLOR,
)
from plc_inspect.messages.items import (
    HazardLike,
    name_kind,
    ORIGIN,
    Place,
    SpanLike,
    SupportLike,
)
from plc_inspect.results import Float64, Severity

if TYPE_CHECKING:
    from plc_inspect.core.live.proximity import Proximity

SPANS_PER_LINE = 100_000
"""The id of a catenary is line_id times this, plus span_id."""
MOST_SEGMENTS, SEGMENT = 16, 5.0
"""Most pieces of a drawn catenary, and least length of a piece [m]."""
WIRE_WIDTH = 0.12
"""Line width of a catenary [m]."""
TOWER_WIDTH, POLE_WIDTH = 1.2, 0.35
"""Widths of supports [m]."""
LEAST_HEIGHT = 0.1
"""Least height of a drawn support, as RViz draws no flat ones [m]."""
HAZARD_SIZE, TEXT_LIFT = 1.2, 1.5
"""Diameter of a hazard's sphere, and height of its text above the centre [m]."""
SUPPORT_ALPHA, HAZARD_ALPHA, CRITICAL_ALPHA = 0.9, 0.8, 0.9
"""Opacities; objects behind show through."""
_HAZARD_COLORS = {
    int(Severity[name.upper()]): color for name, color in SEVERITY_COLORS.items()
}


class MarkKind(enum.IntEnum):
    """Kind of a mark; codes of visualization_msgs/Marker."""

    SPHERE = 2
    CYLINDER = 3
    LINE_STRIP = 4
    TEXT = 9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mark:
    """One thing that is drawn."""

    namespace: str
    number: int
    """Id, stable as long as the object is drawn."""
    kind: MarkKind
    position: Place
    """(3,) centre, or the foot of a text [m]."""
    scale: Place
    """(3,) extent [m]; of a line strip x is the width, of a text z the height."""
    color: str
    """As ``#rrggbb``."""
    alpha: float = 1.0
    """Opacity from 0, invisible, to 1."""
    points: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    """(N, 3) of a line strip [m]."""
    text: str = ''

    @property
    def rgba(self) -> tuple[float, float, float, float]:
        """Red, green, blue and alpha, 0 to 1."""
        red, green, blue = parse_color(self.color)
        return red / 255.0, green / 255.0, blue / 255.0, self.alpha


def list_marks(
    spans: Sequence[SpanLike], supports: Sequence[SupportLike], hazards: Sequence[HazardLike],
    origin: Place = ORIGIN,
) -> list[Mark]:
    """
    List the marks of results.

    Parameters
    ----------
    spans, supports, hazards : sequence
        Results, or items of a monitor.
    origin : (3,) float
        Origin of the coordinates of the marks [m].

    Returns
    -------
    list of Mark
        Unique by namespace and number.

    """
    marks = [_mark_span(span, origin) for span in spans]
    marks += [_mark_support(support, origin) for support in supports]
    for hazard in hazards:
        marks += _mark_hazard(hazard, origin)
    return marks


def mark_proximity(found: 'Sequence[Proximity]', vehicle: Place) -> list[Mark]:
    """
    List the marks of near objects: a line to each one that is too near, and its distance.

    Parameters
    ----------
    found : sequence of Proximity
        As from ``measure_proximity``.
    vehicle : (3,) float
        Position of the vehicle in the map frame [m].

    Returns
    -------
    list of Mark
        Without objects that are clear or unknown.

    """
    marks = []
    for item in found:
        color = SEVERITY_COLORS.get(item.level.name.lower())
        if color is None:
            continue
        marks += [
            Mark(
                namespace='proximity', number=int(item.thing), kind=MarkKind.LINE_STRIP,
                position=ORIGIN, scale=(WIRE_WIDTH, 0.0, 0.0), color=color,
                points=np.array([vehicle, item.position]),
            ),
            Mark(
                namespace='proximity_text', number=int(item.thing), kind=MarkKind.TEXT,
                position=_move((item.position + vehicle) / 2, ORIGIN), color=color,
                scale=(0.0, 0.0, HAZARD_SIZE),
                text=f'{item.thing.name.lower()} {item.distance:.1f} m',
            ),
        ]
    return marks


def _mark_span(span: SpanLike, origin: Place) -> Mark:
    num_segments = max(1, min(MOST_SEGMENTS, int(span.length / SEGMENT)))
    curve = span.positions(np.linspace(0.0, span.length, num_segments + 1))
    return Mark(
        namespace='catenaries', number=span.line_id * SPANS_PER_LINE + span.span_id,
        kind=MarkKind.LINE_STRIP, position=ORIGIN, scale=(WIRE_WIDTH, 0.0, 0.0),
        color=line_color(span.line_id), points=curve - origin,
    )


def _mark_support(support: SupportLike, origin: Place) -> Mark:
    x, y, z = _move(support.position, origin)
    height = max(float(support.height), LEAST_HEIGHT)
    width = TOWER_WIDTH if support.kind == 'tower' else POLE_WIDTH
    return Mark(
        namespace='supports', number=support.support_id, kind=MarkKind.CYLINDER,
        position=(x, y, z + height / 2), scale=(width, width, height), color=SUPPORT_COLOR,
        alpha=SUPPORT_ALPHA,
    )


def _mark_hazard(hazard: HazardLike, origin: Place) -> list[Mark]:
    x, y, z = _move(hazard.position, origin)
    name = name_kind(hazard.kind)
    return [
        Mark(
            namespace='hazards', number=hazard.hazard_id, kind=MarkKind.SPHERE,
            position=(x, y, z), scale=(HAZARD_SIZE,) * 3,
            color=_HAZARD_COLORS.get(hazard.severity, OK_COLOR),
            alpha=CRITICAL_ALPHA if hazard.severity >= Severity.CRITICAL else HAZARD_ALPHA,
        ),
        Mark(
            namespace='hazard_texts', number=hazard.hazard_id, kind=MarkKind.TEXT,
            position=(x, y, z + TEXT_LIFT), scale=(0.0, 0.0, HAZARD_SIZE), color=TEXT_COLOR,
            text=f'{name} {hazard.measured:.2f} m (of {hazard.required:.2f} m),'
                 f' {round(100 * hazard.confidence)} % sure',
        ),
    ]


def _move(place: Place, origin: Place) -> tuple[float, float, float]:
    x, y, z = (float(value - shift) for value, shift in zip(place, origin, strict=True))
    return x, y, z
