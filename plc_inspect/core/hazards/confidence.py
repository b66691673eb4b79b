# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How sure a hazard is: by how much the limit is broken, and what speaks against it."""

from dataclasses import dataclass
import math
from typing import Any

from plc_inspect.core.hazards.blur import is_blurred, measure_reach
from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import HazardKind, Severity

END_ROOM = 5.0
"""
Distance from an end without a known support within which things may be of that support [m].
Source: judgement; as encroachments.ROOM of a tower.
"""
DOUBTED = 0.5
"""
Share of the confidence that each doubt leaves.
Source: judgement; as likely as not.
"""
LEAST_SIGMA = 1e-9
"""Standard deviation, at least, in a divisor [m].  Source: numerical: avoids a division by 0."""
IN_DOUBT = 'in doubt: '
"""A part of a hazard's note that begins so says what speaks against it."""
AT_END = 'near an end of the conductor whose support is not known'
NOT_SHARP = 'the points of the conductor scatter more than those of the others'
OF_CONDUCTOR = HazardKind.GROUND, HazardKind.SAG, HazardKind.MISSING
"""
Kinds of hazards that never rest on parts of a support.
Source: derived: they rest on the conductor and the ground below it.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Confidence:
    """How sure a hazard is: probabilities for normal errors of sigma, halved for each doubt."""

    severity: float
    """That the distance is less than that of its severity."""
    hazard: float
    """That it is less than the greatest at which anything is reported."""


def find_doubts(note: str) -> str:
    """Return the parts of a hazard's note that say what is in doubt, or an empty string."""
    return '; '.join(_split_doubts(note))


def cap_severity(severity: Severity, note: str) -> Severity:
    """Return what a hazard with a note may be at most: in doubt it is said, not cried."""
    return min(severity, Severity.WARNING) if _split_doubts(note) else severity


def judge_confidence(limit: Limit, values: dict[str, Any]) -> Confidence:
    """
    Tell how sure a hazard is.

    Parameters
    ----------
    limit : Limit
        What is broken.
    values : dict
        Kind, severity, clearance, its parts, sigma and note of the hazard.

    Returns
    -------
    Confidence

    """
    share = DOUBTED ** len(_split_doubts(values['note']))
    severity, hazard = (
        share * _judge_margin(margin, values['sigma']) for margin in _find_margins(limit, values)
    )
    return Confidence(severity=severity, hazard=hazard)


def _find_margins(limit: Limit, values: dict[str, Any]) -> tuple[float, float]:
    """Return by how much the limit of the severity is broken, and the greatest [m]."""
    measured = {
        'distance': values['clearance'], 'horizontal': values['horizontal'],
        'vertical': abs(values['vertical']),
    }[limit.measure]
    own = next(
        (reach for severity, reach in limit.tiers if severity == values['severity']), limit.reach
    )
    above = -1.0 if values['kind'] == HazardKind.SAG else 1.0
    return above * (own - measured), above * (limit.reach - measured)


def list_doubts(model: SpanModel, x: float, limit: Limit, values: dict[str, Any]) -> list[str]:
    """
    Return the notes of what speaks against a hazard at x of a curve [m].

    ``values`` are those of ``judge_confidence``.  A tree in contact blurs the conductor that it
    touches: that is a doubt only where the blur reaches the tree, or the limit.
    """
    doubts = []
    ends = (model.start_x, model.span.open_start), (model.end_x, model.span.open_end)
    near_end = any(is_open and abs(x - place) <= END_ROOM for place, is_open in ends)
    if near_end and values['kind'] not in OF_CONDUCTOR:
        doubts.append(IN_DOUBT + AT_END)
    room = min(values['clearance'], _find_margins(limit, values)[0])
    missing = values['kind'] == HazardKind.MISSING  # no distance to a conductor that is there
    if not missing and is_blurred(model) and room < measure_reach(model):
        doubts.append(IN_DOUBT + NOT_SHARP)
    return doubts


def _split_doubts(note: str) -> list[str]:
    """Return the parts of a note that say what is in doubt."""
    return [part for part in note.split('; ') if part.startswith(IN_DOUBT)]


def _judge_margin(margin: float, sigma: float) -> float:
    """Return the probability that a margin [m] with a normal error is greater than 0."""
    return 0.5 * (1.0 + math.erf(margin / max(sigma, LEAST_SIGMA) / math.sqrt(2.0)))
