# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Follows one point through the stages: figures, limits, and what would have changed them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.explain.catenary_view import Curves, tell_corridor, tell_span
from plc_inspect.core.explain.clustering_view import Windows
from plc_inspect.core.explain.extraction_view import Place
from plc_inspect.core.explain.proposals import apply, Finding, Proposal, rank
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.core.trace import Trace
from plc_inspect.errors import DataError
from plc_inspect.results import Decision, Float64

DECIDED_BY = {
    Decision.NOT_FINITE: 'height',
    Decision.GROUND: 'height',
    Decision.TOO_LOW: 'height',
    Decision.NOT_LINEAR: 'linearity',
    Decision.OUTLIER: 'outliers',
    Decision.NO_SECTION: 'alignment',
    Decision.NO_CLUSTER: 'clustering',
    Decision.NO_CATENARY: 'catenary',
    Decision.WIRE: 'catenary',
    Decision.SUPPORT: 'supports',
}
MOST_RUNS = 4
"""Most proposals with which the pipeline is run.  Source: numerical: bounds the time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A proposal, and the point's decision when the pipeline ran with it."""

    proposal: Proposal
    decision: Decision
    holds: bool
    """The point passed the stage or, if it was wire, is no longer."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explanation:
    """What each stage found at one point, which one decided, and what would have changed it."""

    index: int
    position: Float64
    """(3,) [m]."""
    decision: Decision
    stage: str
    """The stage that decided."""
    findings: tuple[Finding, ...]
    """Findings of the stages, in order."""
    proposals: tuple[Proposal, ...]
    """Settings with which that stage would decide otherwise, the smallest move first."""
    trials: tuple[Trial, ...] = ()
    """Proposals that were run, up to the first that holds."""

    @property
    def change(self) -> Trial | None:
        """The trial that holds, if one was found."""
        return next((trial for trial in self.trials if trial.holds), None)


def find_nearest(points: Float64, position: Float64) -> int:
    """
    Return the index of the point that is nearest to a position (3,).

    Raises
    ------
    DataError
        No point is finite.

    """
    distance = np.linalg.norm(points - position, axis=1)
    if not np.isfinite(distance).any():
        raise DataError(f'none of {len(points)} points is finite')
    return int(np.nanargmin(distance))


def explain_point(
    trace: Trace, points: Float64, settings: Settings, index: int
) -> Explanation:
    """
    Follow one point through the stages.

    The figures of all stages are measured anew at the point, from the stages' inputs and
    neighbourhoods, so this costs about as much as linearity and catenary do.

    Parameters
    ----------
    trace : Trace
        Of `Pipeline.trace` with these points and settings.
    points : (N, 3) float64
        The cloud [m].
    settings : Settings
        Of that run.
    index : int
        Which point.

    Returns
    -------
    Explanation
        Its proposals are not yet confirmed.

    Raises
    ------
    DataError
        There is no such point.

    """
    if not 0 <= index < len(points):
        raise DataError(f'there is no point {index}: the cloud has {len(points)}, from 0')
    place = Place(trace, settings, points[index], index)
    decision = place.decision
    findings = [
        place.tell_height(), place.tell_linearity(), place.tell_outliers(),
        place.tell_alignment(),
    ]
    proposals: Iterable[Proposal] = {
        Decision.TOO_LOW: place.lift,
        Decision.NOT_LINEAR: place.straighten,
        Decision.OUTLIER: place.gather,
        Decision.NO_SECTION: place.line_up,
    }.get(decision, tuple)()
    if decision >= Decision.NO_CLUSTER:
        windows, curves = Windows(place), Curves(trace, settings)
        findings += [windows.tell(), curves.tell(place.position, decision)]
        proposals = {
            Decision.NO_CLUSTER: windows.join,
            Decision.NO_CATENARY: lambda: curves.believe(place.position),
            Decision.WIRE: lambda: curves.doubt(place.position),
        }.get(decision, tuple)()
    else:
        findings += [
            Finding(stage=stage, outcome='not asked') for stage in ('clustering', 'catenary')
        ]
    findings += [tell_span(trace, index, decision), tell_corridor(trace, index)]
    return Explanation(
        index=index,
        position=points[index],
        decision=decision,
        stage=DECIDED_BY[decision],
        findings=tuple(findings),
        proposals=tuple(rank(proposals)),
    )


def confirm(
    explanation: Explanation,
    points: Float64,
    settings: Settings,
    rules: RuleSet | None = None,
    most: int = MOST_RUNS,
) -> Explanation:
    """
    Run the pipeline with each proposal until one holds.

    Parameters
    ----------
    explanation : Explanation
        Of one point.
    points, settings, rules : (N, 3) float64, Settings, RuleSet or None
        Of the run.
    most : int
        Runs at most.

    Returns
    -------
    Explanation
        With its trials.

    """
    trials = []
    for proposal in explanation.proposals[:most]:
        result = Pipeline(apply([proposal], settings), rules).run(points)
        decision = Decision(int(result.decision[explanation.index]))
        holds = (
            decision != Decision.WIRE if explanation.decision == Decision.WIRE
            else decision > explanation.decision
        )
        trials.append(Trial(proposal=proposal, decision=decision, holds=holds))
        if holds:
            break
    return replace(explanation, trials=tuple(trials))
