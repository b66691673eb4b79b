# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Markers for RViz and Foxglove: catenaries, supports and hazards, each under a stable number."""

from collections.abc import Sequence
import colorsys

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
import numpy as np
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from plc_inspect.core.live.session import LiveState
from plc_inspect.core.tracking.span_registry import TrackedSpan
from plc_inspect.results import Hazard, Severity, Span, Support

MarkerKey = tuple[str, int]
"""Namespace and id."""

SPANS_PER_LINE = 100_000
"""The id of a catenary is line_id times this, plus span_id."""
MAX_SEGMENTS = 16

_SEVERITY_COLORS = {
    Severity.NOTICE: ColorRGBA(r=0.2, g=0.6, b=1.0, a=0.8),
    Severity.WARNING: ColorRGBA(r=1.0, g=0.65, b=0.0, a=0.8),
    Severity.CRITICAL: ColorRGBA(r=1.0, g=0.1, b=0.1, a=0.9),
}
_SUPPORT_COLOR = ColorRGBA(r=0.6, g=0.6, b=0.65, a=0.9)
_WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)


def make_markers(header: Header, state: LiveState) -> list[Marker]:
    """
    Draw everything that is confirmed.

    Parameters
    ----------
    header : Header
        Frame and stamp of the data.
    state : LiveState
        What is known.

    Returns
    -------
    list[Marker]
        All of action ADD, none with the same namespace and id.

    """
    markers = [_draw_span(header, item) for item in state.confirmed]
    for support in state.supports:
        markers.append(_draw_support(header, support))
    for hazard in state.hazards:
        markers += _draw_hazard(header, hazard)
    return markers


def add_deletions(
    header: Header, markers: Sequence[Marker], before: set[MarkerKey]
) -> tuple[MarkerArray, set[MarkerKey]]:
    """
    Complete markers with the deletion of those that were there before and are no more.

    Parameters
    ----------
    header : Header
        Frame and stamp of the data.
    markers : sequence of Marker
        Those that are to be seen.
    before : set[MarkerKey]
        Those that were.

    Returns
    -------
    tuple[MarkerArray, set[MarkerKey]]
        The message, and what is to be seen now.

    """
    now = {(marker.ns, marker.id) for marker in markers}
    gone = [
        Marker(header=header, ns=ns, id=number, action=Marker.DELETE)
        for ns, number in sorted(before - now)
    ]
    return MarkerArray(markers=[*gone, *markers]), now


def choose_color(line_id: int) -> ColorRGBA:
    """Return a colour that differs between neighbouring lines."""
    red, green, blue = colorsys.hsv_to_rgb((0.58 + 0.618034 * line_id) % 1.0, 0.75, 1.0)
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


def _draw_span(header: Header, item: TrackedSpan) -> Marker:
    span = item.span
    return Marker(
        header=header,
        ns='catenaries',
        id=span.line_id * SPANS_PER_LINE + span.span_id,
        type=Marker.LINE_STRIP,
        pose=_place(),
        scale=Vector3(x=0.12),
        color=choose_color(span.line_id),
        points=_trace(span),
    )


def _trace(span: Span) -> list[Point]:
    along = np.linspace(0.0, span.length, max(2, min(MAX_SEGMENTS, int(span.length / 5.0)) + 1))
    plan = span.start[:2] + (along / span.length)[:, None] * (span.end[:2] - span.start[:2])
    heights = span.heights(along)
    return [
        Point(x=x, y=y, z=z)
        for (x, y), z in zip(plan.tolist(), heights.tolist(), strict=True)
    ]


def _draw_support(header: Header, support: Support) -> Marker:
    x, y, z = support.position.tolist()
    height = max(float(support.height), 0.1)
    width = 1.2 if support.kind == 'tower' else 0.35
    return Marker(
        header=header,
        ns='supports',
        id=support.support_id,
        type=Marker.CYLINDER,
        pose=_place(x, y, z + height / 2),
        scale=Vector3(x=width, y=width, z=height),
        color=_SUPPORT_COLOR,
    )


def _draw_hazard(header: Header, hazard: Hazard) -> list[Marker]:
    x, y, z = hazard.position.tolist()
    name = hazard.kind.name.lower()
    text = f'{name} {hazard.clearance:.2f} m (of {hazard.required:.2f} m)'
    return [
        Marker(
            header=header,
            ns='hazards',
            id=hazard.hazard_id,
            type=Marker.SPHERE,
            pose=_place(x, y, z),
            scale=Vector3(x=1.2, y=1.2, z=1.2),
            color=_SEVERITY_COLORS[hazard.severity],
        ),
        Marker(
            header=header,
            ns='hazard_texts',
            id=hazard.hazard_id,
            type=Marker.TEXT_VIEW_FACING,
            pose=_place(x, y, z + 1.5),
            scale=Vector3(z=1.2),
            color=_WHITE,
            text=text,
        ),
    ]


def _place(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=1.0))
