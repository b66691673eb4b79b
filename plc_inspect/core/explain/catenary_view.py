# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explains catenary, supports and corridor at one point: nearby curves and their evidence."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from plc_inspect.checks import Check
from plc_inspect.config import Settings
from plc_inspect.core.catenary.curve import Curve
from plc_inspect.core.evidence.conductors import judge_curves
from plc_inspect.core.evidence.validation import BORNE, list_evidence
from plc_inspect.core.explain.proposals import chain, Finding, Proposal, propose, SLACK
from plc_inspect.core.trace import Trace
from plc_inspect.core.whole import make_draws
from plc_inspect.results import Decision, Float64

NEAR = 2.0
"""
Distance from a point within which curves are described [m].
Source: judgement; not measured.
"""
MOST_CURVES = 2
"""Most curves near a point that are described.  Source: judgement; not measured."""
REACH = 2.0
"""
Distance from a point, in tolerances of a curve, within which the curve may become its conductor.
Source: judgement; not measured.
"""
FIGURES = {
    'catenary.min_length': ('length', 'm'),
    'catenary.min_points': ('points', ''),
    'catenary.min_coverage': ('share of metres with points', ''),
    'catenary.min_significance': ('curvature in its standard deviations', ''),
    'catenary.max_constant': ('catenary constant', 'm'),
    'catenary.max_sag_ratio': ('sag as a share of the length', ''),
    'catenary.min_evidence': ('metres of evidence', 'm'),
    'catenary.max_crowding': ('share with other things at its surface', ''),
    'catenary.max_clutter': ('share by which cluttered metres outnumber free ones', ''),
}
"""Name and unit of the figure that each limit of `CatenarySettings` applies to."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveView:
    """A curve, its evidence and its outcome."""

    curve: Curve
    evidence: tuple[Check, ...]
    objection: str
    """Objection when all curves are judged together, '' for a conductor."""
    believed: bool
    """It is a conductor of the result."""
    adopted: bool = False
    """It is one only as it continues another at a support."""

    @property
    def fate(self) -> str:
        """Outcome of the curve."""
        against = [item.objection for item in self.evidence if not item.kept]
        if self.believed:
            return 'conductor'
        fate = ', '.join(against) or self.objection or 'dropped beside others'
        return f'conductor, as it continues one at a support; {fate}' if self.adopted else fate


class Curves:
    """All curves of one run whose evidence was examined."""

    def __init__(self, trace: Trace, settings: Settings) -> None:
        """Find the curves again, as the run did."""
        self.trace, self.settings = trace, settings
        lines, limits = trace.lines, settings.catenary
        found, judge = judge_curves(
            lines.cloud.points, lines.cloud.index, lines.clustering, lines.sight, limits,
            make_draws(settings), lines.searches,
        )
        borne = {_key(curve) for curve in trace.lines.borne}
        believed = {_key(curve) for curve in trace.lines.conductors.curves} - borne
        hung = {_key(curve) for curve in trace.lines.layout.curves}
        views = []
        for curve, verdict in zip(found, judge.verdicts, strict=True):
            evidence = list_evidence(
                curve, verdict.profile, verdict.free, limits, beside=verdict.beside
            )
            views.append(CurveView(
                curve=curve, evidence=tuple(evidence),
                objection=BORNE if _key(curve) in borne else verdict.objection,
                believed=_key(curve) in believed, adopted=_key(curve) in hung - believed,
            ))
        self.views = tuple(views)

    def find_near(self, position: Float64) -> list[tuple[float, CurveView]]:
        """Return distance [m] and curve within NEAR of a point, nearest first."""
        result = []
        for view in self.views:
            distance = measure_distance(view.curve, position)
            if distance <= NEAR:
                result.append((distance, view))
        return sorted(result, key=lambda item: item[0])

    def tell(self, position: Float64, decision: Decision) -> Finding:
        """Return the curves near a point with their evidence."""
        near = self.find_near(position)
        if not near:
            note = f'no curve passes within {NEAR:g} m'
            return Finding(stage='catenary', outcome='not asked', notes=(note,))
        checks: list[Check] = []
        notes = []
        for number, (distance, view) in enumerate(near[:MOST_CURVES]):
            name = f'curve {number + 1}'
            checks.append(Check(
                name=f'{name}: distance', value=distance, limit=view.curve.tolerance,
                is_least=False, setting='catenary.tolerance', unit='m',
            ))
            checks += list_checks(view, f'{name}: ')
            notes.append(f'{name}: {view.fate}')
        outcome = 'kept' if decision == Decision.WIRE else 'dropped'
        return Finding(
            stage='catenary', outcome=outcome, checks=tuple(checks), notes=tuple(notes)
        )

    def believe(self, position: Float64) -> Iterator[Proposal]:
        """Yield settings with which a curve at a point would have been a conductor."""
        for distance, view in self.find_near(position):
            if view.believed and distance > view.curve.tolerance:
                yield from propose(
                    self.settings, 'catenary.tolerance', distance, False, 'distance', distance
                )
            elif distance <= REACH * view.curve.tolerance:
                yield from self.admit(view)

    def doubt(self, position: Float64) -> Iterator[Proposal]:
        """Yield settings with which the conductor at a point would have been none."""
        believed = [view for _, view in self.find_near(position) if view.believed]
        for item in believed[0].evidence if believed else ():
            if item.kept:
                yield from self.turn(item, away=True)

    def admit(self, view: CurveView) -> Iterator[Proposal]:
        """Yield the limits at which a curve has no objections, if they are in range."""
        against = [item for item in view.evidence if not item.kept]
        moves = [move for item in against for move in self.turn(item)]
        if moves and len(moves) == len(against):
            yield chain(moves)

    def turn(self, item: Check, *, away: bool = False) -> Iterator[Proposal]:
        """Yield the limit at which one figure just passes, or just fails."""
        needed = value = item.scaled[0]
        if item.scale != 1.0:  # the limit is multiplied: leave room for the last bits
            needed *= 1 - SLACK if item.is_least != away else 1 + SLACK
        yield from propose(
            self.settings, item.setting, needed, item.is_least, FIGURES[item.setting][0], value,
            away=away,
        )


def list_checks(view: CurveView, prefix: str = '') -> Iterator[Check]:
    """Yield the evidence of a curve with the names and units of its figures."""
    for item in view.evidence:
        name, unit = FIGURES[item.setting]
        yield replace(item, name=f'{prefix}{name}', unit=unit)


def measure_distance(curve: Curve, position: Float64) -> float:
    """Return the distance of a point to a curve between its ends [m]."""
    x, y = curve.local(position[np.newaxis])
    at = np.clip(x, curve.low, curve.high)
    height, slope = curve.fit.height(at), curve.fit.slope(at)
    above = (position[2] - height) / np.hypot(1.0, slope)
    return float(np.sqrt((x - at) ** 2 + y**2 + above**2)[0])


def tell_span(trace: Trace, index: int, decision: Decision) -> Finding:
    """Return the span or support that a point belongs to."""
    result = trace.result
    if decision == Decision.SUPPORT:
        note = 'it stands within the structure of a support'
        return Finding(stage='supports', outcome='kept', notes=(note,))
    if decision != Decision.WIRE:
        return Finding(stage='supports', outcome='not asked')
    line, span = int(result.line_id[index]), int(result.span_id[index])
    check = Check(name='distance to the final curve', value=float(result.residual[index]),
                  unit='m')
    return Finding(
        stage='supports', outcome='kept', checks=(check,),
        notes=(f'line {line}, span {span}',),
    )


def tell_corridor(trace: Trace, index: int) -> Finding:
    """Return the distance of the nearest conductor to a point, against the search radius."""
    corridor = trace.corridor
    at = int(np.searchsorted(corridor.near, index))
    if at >= len(corridor.near) or int(corridor.near[at]) != index:
        far = 'no conductor was found' if not len(trace.models) else (
            'beyond the search radius of every span'
        )
        return Finding(stage='corridor', outcome='dropped', notes=(far,))
    number = int(corridor.near_span[at])
    check = Check(
        name='distance to the nearest conductor', value=float(corridor.near_distance[at]),
        limit=float(corridor.radius[number]), is_least=False, setting='corridor.radius', unit='m',
    )
    span = trace.models[number].span
    return Finding(
        stage='corridor', outcome='kept' if check.kept else 'dropped', checks=(check,),
        notes=(f'of line {span.line_id}, span {span.span_id}',),
    )


def _key(curve: Curve) -> tuple[float, ...]:
    return (*curve.origin.tolist(), curve.azimuth, curve.low, curve.high, *curve.fit.shape)
