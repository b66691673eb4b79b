# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Transform results from the map frame to the present frame of the odometry."""

from dataclasses import replace
import itertools
import math

import numpy as np

from plc_inspect.core.alignment.rigid_move import RigidMove
from plc_inspect.results import Float64, Hazard, InspectionResult, Span, Support


def move_span(span: Span, move: RigidMove) -> Span:
    """Return the moved span."""
    start, end, lowest = (move.apply(place) for place in (span.start, span.end, span.lowest))
    up = float(move.shift[2])
    a2, a1, a0 = span.quadratic
    return replace(
        span, start=start, end=end, lowest=lowest, a=span.a + up, quadratic=(a2, a1, a0 + up),
        azimuth=math.remainder(span.azimuth + move.yaw, 2.0 * math.pi),
    )


def move_support(support: Support, move: RigidMove) -> Support:
    """Return the moved support."""
    return replace(support, position=move.apply(support.position))


def move_hazard(hazard: Hazard, move: RigidMove) -> Hazard:
    """Return the moved hazard; its box encloses the rotated one."""
    return replace(
        hazard, position=move.apply(hazard.position), extent=move_box(hazard.extent, move),
    )


def move_box(box: Float64, move: RigidMove) -> Float64:
    """Return the (2, 3) corners of a box around a moved one [m]."""
    corners = move.apply(np.array(list(itertools.product(*box.T))))
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def move_result(result: InspectionResult, move: RigidMove) -> InspectionResult:
    """Return the moved result; the same object if the move is trivial."""
    if move.trivial:
        return result
    return replace(
        result,
        spans=tuple(move_span(item, move) for item in result.spans),
        supports=tuple(move_support(item, move) for item in result.supports),
        hazards=tuple(move_hazard(item, move) for item in result.hazards),
    )
