# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Labels that a tick gives to the voxels of the map, which later windows choose by."""

from collections.abc import Sequence

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.hazards.falling_trees import FALL_REACH
from plc_inspect.core.live.window import CLOSE, LEAST_CLOSE, WindowPlanner
from plc_inspect.core.spans.span_model import SpanModel, tabulate
from plc_inspect.results import Decision, Float64, InspectionResult, UInt8


def measure_reach(settings: Settings) -> float:
    """Return how far from a conductor the rules may raise anything, at least LEAST_CLOSE [m]."""
    own = settings.hazards
    reach = max(own.warning_distance, own.critical_distance) + settings.catenary.bundle_width
    return max(reach, LEAST_CLOSE, FALL_REACH if own.fall_distance > 0.0 else 0.0)


def make_planner(settings: Settings) -> WindowPlanner:
    """Return a planner of windows that hold whatever the rules may reach."""
    return WindowPlanner(settings.height.beta, measure_reach(settings))


def label_points(
    points: Float64, models: Sequence[SpanModel], result: InspectionResult, settings: Settings
) -> UInt8:
    """
    Return the (N,) labels for the map: Decision, or CLOSE where a rule may hold.

    That is within the reach of the distances from any conductor, whatever the radius of the
    corridor; and, where falling trees are looked for, what stands high enough to reach one.
    """
    labels = result.decision.astype(np.uint8)
    if not models:
        return labels
    reach = measure_reach(settings)
    found, distance, _ = find_near(points, tabulate(models), reach)
    near = settings.hazards.warning_distance + settings.catenary.bundle_width
    close = distance <= max(near, LEAST_CLOSE)
    close |= result.ground_height[found] + settings.hazards.fall_distance >= distance
    kept = (Decision.WIRE, Decision.SUPPORT, Decision.GROUND)
    close &= ~np.isin(labels[found], kept)
    labels[found[close]] = CLOSE
    return labels
