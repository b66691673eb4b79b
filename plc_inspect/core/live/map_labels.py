# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Labels that a tick gives to the voxels of the map, which later windows choose by."""

from collections.abc import Sequence

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.hazards.falling_trees import FALL_REACH
from plc_inspect.core.hazards.hazards import choose_rules
from plc_inspect.core.live.window import CLOSE, LEAST_CLOSE, WindowPlanner
from plc_inspect.core.spans.span_model import SpanModel, tabulate
from plc_inspect.results import Decision, Float64, InspectionResult, UInt8


def measure_near(settings: Settings, rules: RuleSet) -> float:
    """Return how far from a conductor clearance rules reach, at least LEAST_CLOSE [m]."""
    reach = rules.reach('vegetation', 'building')
    return max(reach + settings.catenary.bundle_width, LEAST_CLOSE)


def measure_reach(settings: Settings, rules: RuleSet | None = None) -> float:
    """
    Return how far from a conductor the rules may raise anything, at least LEAST_CLOSE [m].

    Without rules they are the plain ones of the settings.
    """
    rules = choose_rules(settings.hazards, rules)
    near = measure_near(settings, rules)
    return max(near, FALL_REACH) if rules.find('fall_in') else near


def make_planner(settings: Settings, rules: RuleSet | None = None) -> WindowPlanner:
    """Return a planner of windows that hold what the rules, and warnings, may reach."""
    return WindowPlanner(
        settings.height.beta, measure_reach(settings, rules), settings.proximity.critical
    )


def label_points(
    points: Float64,
    models: Sequence[SpanModel],
    result: InspectionResult,
    settings: Settings,
    rules: RuleSet | None = None,
) -> UInt8:
    """
    Return the (N,) labels for the map: Decision, or CLOSE where a rule may hold.

    That is within the reach of the rules from any conductor, whatever the radius of the
    corridor; and, where falling trees are looked for, what stands high enough to reach one.
    """
    labels = result.decision.astype(np.uint8)
    if not models:
        return labels
    rules = choose_rules(settings.hazards, rules)
    found, distance, _ = find_near(points, tabulate(models), measure_reach(settings, rules))
    close = distance <= measure_near(settings, rules)
    if rules.find('fall_in'):
        close |= result.ground_height[found] + rules.reach('fall_in') >= distance
    kept = (Decision.WIRE, Decision.SUPPORT, Decision.GROUND)
    close &= ~np.isin(labels[found], kept)
    labels[found[close]] = CLOSE
    return labels
