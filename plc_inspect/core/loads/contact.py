# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Contact: the temperature at which a conductor sags onto an object below it."""

from collections.abc import Sequence
import math

import numpy as np

from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.loads.approach import MovedSpan
from plc_inspect.core.loads.load_cases import change_span, tells_tension
from plc_inspect.core.loads.obstacles import gather_obstacles, survey_state
from plc_inspect.core.loads.sag_tension import Case, Conductor, height_at
from plc_inspect.core.loads.sections import group_sections
from plc_inspect.errors import DataError
from plc_inspect.results import Float64, InspectionResult, Span

HOTTEST = 120.0
"""
Greatest temperature of a conductor for which contact is computed [degrees Celsius].
Source: judgement; not measured.
"""
ASIDE = 0.25
"""
Greatest distance from a conductor's vertical plane of points below it [m].
Source: judgement; not measured.
"""
TOLERANCE = 0.01
"""
Tolerance of the temperature of contact [K].
Source: numerical: far below the error of the surveyed temperature.
"""


def find_contacts(
    points: Float64, result: InspectionResult, conductor: Conductor, temperature: float,
    rules: RuleSet,
) -> dict[int, float]:
    """
    Find the temperatures at which conductors touch the objects below them.

    In calm air, without ice; the spans of a section share their tension, as in `evaluate_cases`.
    A conductor touches only points that were below it when surveyed.

    Parameters
    ----------
    points : (N, 3) float64
        The pipeline's input [m].
    result : InspectionResult
        What it found.
    conductor : Conductor
        Of all spans.
    temperature : float
        Temperature of the conductors when surveyed [degrees Celsius].
    rules : RuleSet
        Those by which it judged.

    Returns
    -------
    dict
        hazard_id of vegetation and structures to the lowest temperature of contact up to HOTTEST
        [degrees Celsius]; hazards that are not touched are left out.

    """
    obstacles = gather_obstacles(points, result, rules)
    spans = {(span.line_id, span.span_id): span for span in result.spans}
    sections = {
        (result.spans[i].line_id, result.spans[i].span_id): [result.spans[k] for k in section]
        for section in group_sections(result.spans) for i in section
    }
    contacts: dict[int, float] = {}
    for item in obstacles.objects:
        hazard = item.hazard
        found = []
        for key, span in spans.items():
            if key[1] != hazard.span_id or not tells_tension(span):
                continue
            strands = obstacles.strands[key]
            _, own = item.approach(MovedSpan(span, [survey_state(span)], strands))
            # onto the lowest sub-conductor: as onto the curve, of what is as much higher
            raised = item.points[own] - np.array([0.0, 0.0, strands[:, 2].min()])
            found.append(_heat(raised, span, sections[key], conductor, temperature))
        if min(found, default=math.inf) <= HOTTEST:
            contacts[hazard.hazard_id] = min(found)
    return contacts


def _heat(
    points: Float64, span: Span, section: Sequence[Span], conductor: Conductor,
    temperature: float,
) -> float:
    """Return the temperature at which a span touches the first of the points, inf if never."""
    unit = (span.end - span.start)[:2] / span.length
    moved = points - span.start
    x, y = moved[:, :2] @ unit, moved[:, :2] @ np.array([-unit[1], unit[0]])
    under = (np.abs(y) <= ASIDE) & (x > 0.0) & (x < span.length)
    x, z = x[under], moved[under, 2]

    def sink(degrees: float) -> Float64:
        """Return the heights of the conductor above the points [m]."""
        case = Case(name='contact', temperature=degrees)
        state = change_span(span, section, temperature, conductor, case)
        return height_at(x, state.length, state.rise, state.c) - z

    if temperature >= HOTTEST:
        return math.inf
    below = sink(temperature) > 0.0
    x, z = x[below], z[below]
    try:
        if not len(x) or float(sink(HOTTEST).min()) > 0.0:
            return math.inf
        from scipy.optimize import brentq  # imported here, as it takes half a second

        return float(brentq(
            lambda degrees: sink(degrees).min(), temperature, HOTTEST, xtol=TOLERANCE
        ))
    except DataError:  # at some temperature the span hangs too deep to be solved for
        return math.inf
