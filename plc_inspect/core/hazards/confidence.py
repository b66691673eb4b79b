# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How sure a hazard is: by how much the limit is broken, and what speaks against it."""

import math
from typing import Any

from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import HazardKind

END_ROOM = 5.0
"""
Distance from an end without a known support within which things may be of that support [m].
Source: judgement; as encroachments.ROOM of a tower.
"""
BLURRED = 2.0
"""
Scatter of a conductor's points about its curve, in that of the cloud, beyond which it is blurred.
Source: judgement; four times the variance.
"""
DOUBTED = 0.5
"""
Share of the confidence that each doubt leaves.
Source: judgement; as likely as not.
"""
AT_END = 'near an end of the conductor whose support is not known'
NOT_SHARP = 'the points of the conductor scatter more than those of the others'


def judge_confidence(
    model: SpanModel, x: float, limit: Limit, values: dict[str, Any]
) -> tuple[float, tuple[str, ...]]:
    """
    Tell how sure a hazard is.

    Parameters
    ----------
    model : SpanModel
        Its span.
    x : float
        Where along the curve it is [m].
    limit : Limit
        What is broken.
    values : dict
        Kind, severity, clearance, its parts, and sigma of the hazard.

    Returns
    -------
    confidence : float
        Probability that the distance is less than that of the severity, for normal errors of
        sigma, and half of it for each doubt.
    doubts : tuple of str

    """
    measured = {
        'distance': values['clearance'], 'horizontal': values['horizontal'],
        'vertical': abs(values['vertical']),
    }[limit.measure]
    distance = next(
        (reach for severity, reach in limit.tiers if severity == values['severity']), limit.reach
    )
    margin = distance - measured
    if values['kind'] == HazardKind.SAG:
        margin = -margin
    confidence = 0.5 * (1.0 + math.erf(margin / max(values['sigma'], 1e-9) / math.sqrt(2.0)))
    doubts = []
    for place, is_open in (
        (model.start_x, model.span.open_start), (model.end_x, model.span.open_end),
    ):
        if is_open and abs(x - place) <= END_ROOM and AT_END not in doubts:
            doubts.append(AT_END)
    if len(model.strands) == 1 and model.curve.fit.rmse > BLURRED * model.scatter:
        doubts.append(NOT_SHARP)
    return confidence * DOUBTED ** len(doubts), tuple(doubts)
