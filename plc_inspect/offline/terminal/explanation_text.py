# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explanations as text."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from plc_inspect.checks import Check
from plc_inspect.config import Settings
from plc_inspect.core.explain.catenary_view import CurveView, list_checks
from plc_inspect.core.explain.point import Explanation
from plc_inspect.core.explain.proposals import Finding, Proposal
from plc_inspect.core.explain.span import STAGES, Stretch, StretchTrial
from plc_inspect.offline.terminal.result_table import format_table
from plc_inspect.results import Decision, Float64
from plc_inspect.setting_names import to_mapping

MEANINGS = {
    Decision.NOT_FINITE: 'is not finite, or isolated far away',
    Decision.GROUND: 'is ground',
    Decision.TOO_LOW: 'is too low',
    Decision.NOT_LINEAR: 'does not lie on something linear',
    Decision.OUTLIER: 'is an outlier',
    Decision.NO_SECTION: 'belongs to no straight section',
    Decision.NO_CLUSTER: 'belongs to no cluster',
    Decision.NO_CATENARY: 'lies on no catenary',
    Decision.WIRE: 'is a wire point',
    Decision.SUPPORT: 'belongs to a support',
}
_NAMES = dict(zip(STAGES, (
    'points', 'high points', 'candidates', 'candidates that are no outliers',
    'candidates in line with others', 'points in line segments', 'wire points',
), strict=True))
NO_SETTING = {
    Decision.NOT_FINITE: 'nothing: it has no place, or is left out before the first stage',
    Decision.GROUND: 'no setting: what is within half a metre of the ground surface is ground',
    Decision.SUPPORT: 'no setting that is known',
}


def render_point(explanation: Explanation, settings: Settings, tried: bool) -> str:
    """
    Return the explanation of a point as text.

    Parameters
    ----------
    explanation : Explanation
        Of the point.
    settings : Settings
        Of the run.
    tried : bool
        Whether its proposals were confirmed.

    Returns
    -------
    str
        Lines without a line break at the end; lengths in metres.

    """
    decision = explanation.decision
    lines = [
        f'it {MEANINGS[decision]} ({decision.name}, {int(decision)});'
        f' decided by {explanation.stage}', '',
    ]
    for finding in explanation.findings:
        lines += _render_finding(finding, settings)
    lines += ['', *_render_change(explanation, tried)]
    return '\n'.join(lines)


def render_stretch(
    stretch: Stretch, trials: Sequence[StretchTrial] | None, settings: Settings,
    to_file: Callable[[Float64], Float64],
) -> str:
    """
    Return what the stages saw along a stretch as text.

    Parameters
    ----------
    stretch : Stretch
        What was seen.
    trials : sequence of StretchTrial or None
        Of its proposals, None where they were not tried.
    settings : Settings
        Of the run.
    to_file : callable
        Brings points of the stretch's frame into coordinates of the file.

    Returns
    -------
    str
        Lines without a line break at the end; lengths in metres.

    """
    rows = [
        [f'{low:.0f} to {high:.0f}', *(str(stretch.counts[name][part]) for name in STAGES)]
        for part, (low, high) in enumerate(
            zip(stretch.edges[:-1], stretch.edges[1:], strict=True))
    ]
    lines = [format_table(('along [m]', *STAGES), rows), '']
    if stretch.found:
        lines.append('a conductor was found along it')
    else:
        lines.append(
            f'{_NAMES[stretch.lost]} are seen in less than {settings.catenary.min_coverage:g} of'
            ' its parts (catenary.min_coverage): here it is lost'
        )
    for number, view in enumerate(stretch.curves):
        lines += ['', *_render_curve(number + 1, view, settings, to_file)]
    if not stretch.curves:
        lines.append('no curve was laid along it')
    lines += ['', *_render_trials(stretch, trials)]
    if stretch.examples and not stretch.found:
        lines.append(
            f'most of its points share the fate of this one: --point {stretch.examples[0]}'
        )
    return '\n'.join(lines)


def _render_finding(finding: Finding, settings: Settings) -> Iterator[str]:
    yield f'{finding.stage}: {finding.outcome}'
    for check in finding.checks:
        yield _render_check(check, settings)
    for note in finding.notes:
        yield f'      {note}'


def _render_check(check: Check, settings: Settings) -> str:
    mark = ' ' if check.kept else 'x'
    figure, limit = check.scaled
    text = f'    {mark} {check.name}: {_number(figure, check.unit)}'
    if limit != limit:
        return text
    text += f' {_sign(check)} {_number(limit, check.unit)}'
    if not check.setting:
        return text
    value = _value(check.setting, settings)
    same = _number(value) == _number(limit)
    return f'{text} ({check.setting}{"" if same else f" = {_number(value)}"})'


def _render_curve(
    number: int, view: CurveView, settings: Settings, to_file: Callable[[Float64], Float64]
) -> Iterator[str]:
    curve = view.curve
    ends = to_file(curve.position(np.array([curve.low, curve.high])))
    (x0, y0, z0), (x1, y1, z1) = ends.tolist()
    yield (
        f'curve {number}: {view.fate}; from {x0:.2f}, {y0:.2f}, {z0:.2f} to {x1:.2f}, {y1:.2f},'
        f' {z1:.2f}'
    )
    yield f'      residual (rms): {curve.fit.rmse:.3f} m, beside it {curve.lateral_rmse:.3f} m'
    for check in list_checks(view):
        yield _render_check(check, settings)


def _render_change(explanation: Explanation, tried: bool) -> Iterator[str]:
    head = 'what would have changed it: '
    decision = explanation.decision
    if not explanation.proposals:
        yield head + NO_SETTING.get(decision, 'no setting that is known')
        return
    if not tried:
        for proposal in explanation.proposals[:3]:
            yield f'{head}{_describe(proposal)} (not tried)'
        return
    for trial in explanation.trials:
        then = f'run with it, the point is {trial.decision.name}'
        if trial.holds:
            yield f'{head}{_describe(trial.proposal)}; {then}'
        else:
            yield f'not enough: {_describe(trial.proposal)}; {then}'
    if explanation.change is None:
        yield head + 'no setting that was tried'


def _render_trials(
    stretch: Stretch, trials: Sequence[StretchTrial] | None
) -> Iterator[str]:
    head = 'what would have changed it: '
    if not stretch.proposals:
        yield head + 'no setting that is known'
    elif trials is None:
        for proposal in stretch.proposals[:3]:
            yield f'{head}{_describe(proposal)} (not tried)'
    else:
        for trial in trials:
            start = head if trial.holds else 'not enough: '
            yield (
                f'{start}{_describe(trial.proposal)}; run with it, {trial.after} wire points lie'
                f' along it, {trial.before} before'
            )
        if not any(trial.holds for trial in trials):
            yield head + 'no setting that was tried'


def _describe(proposal: Proposal) -> str:
    text = (
        f'{proposal.setting} = {_number(proposal.after)} instead of {_number(proposal.before)}'
        f' ({proposal.figure}: {_number(proposal.value)})'
    )
    return f'{text} and {_describe(proposal.also)}' if proposal.also else text


def _sign(check: Check) -> str:
    if check.is_least:
        return '>=' if check.kept else '<'
    return '<=' if check.kept else '>'


def _number(value: float, unit: str = '') -> str:
    return f'{value:.6g} {unit}'.rstrip() if abs(value) >= 1000 else f'{value:.4g} {unit}'.rstrip()


def _value(setting: str, settings: Settings) -> float:
    section, _, name = setting.partition('.')
    value: float = to_mapping(settings)[section][name]
    return value
