# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""By which limits the hazards of a survey were raised, and what those of another would raise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.breaches import are_under
from plc_inspect.core.hazards.clearance_rules import describe_rules, Limit, RuleSet
from plc_inspect.core.hazards.confidence import judge_confidence
from plc_inspect.errors import PlcInspectError
from plc_inspect.offline.readers.catalogue import load_rules
from plc_inspect.offline.records.units import Record
from plc_inspect.results import Hazard, HazardKind

FEATURES = {
    HazardKind.VEGETATION: 'vegetation', HazardKind.STRUCTURE: 'building',
    HazardKind.GROUND: 'ground', HazardKind.CROSSING: 'line', HazardKind.FALL_IN: 'fall_in',
}
"""What limits of rules refer to, by the kind of hazard that they raise."""
BY_POINTS = HazardKind.VEGETATION, HazardKind.STRUCTURE
"""Kinds of hazards that need a number of points."""
NO_LIMITS = frozenset({'growth'})
"""Settings of section hazards that do not decide what is raised."""
SURE = 0.95
"""
Probability that a hazard breaks a limit, at least, for that to be sure.
Source: judgement: as the intervals of all figures.
"""
_RULES = 'edition', 'limits'
"""What is compared of the rules as they are described."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limits:
    """What decided which hazards a survey raised."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    """Section hazards."""
    described: Record = field(default_factory=dict)
    """The rules in words; empty if the survey does not tell."""
    rules: RuleSet | None = None
    """The rules, None if they are not known any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitChange:
    """A limit that differs between two surveys."""

    name: str
    before: Any
    after: Any


def make_limits(settings: HazardSettings, rules: RuleSet | None) -> Limits:
    """Return the limits of a run; without rules, those that the settings name."""
    rules = rules or load_rules(settings)
    return Limits(settings=_list_settings(settings), described=describe_rules(rules), rules=rules)


def read_limits(run: Record) -> Limits:
    """
    Return the limits of an earlier run from its ``run.json``.

    Rules are read again by their name, and taken only if they say what they said then.
    """
    own, described = dict(run['settings']['hazards']), dict(run.get('rules') or {})
    try:
        settings = HazardSettings(**own)
        rules: RuleSet | None = load_rules(settings)
    except (PlcInspectError, TypeError):  # of another version, or a file that is gone
        return Limits(settings=own, described=described)
    if rules is not None and described and any(
        described.get(key) != describe_rules(rules)[key] for key in _RULES
    ):
        rules = None
    return Limits(settings=own, described=described, rules=rules)


def _list_settings(settings: HazardSettings) -> Record:
    return {name: getattr(settings, name) for name in HazardSettings.__dataclass_fields__}


def list_limit_changes(before: Limits, after: Limits) -> tuple[LimitChange, ...]:
    """Return the limits that differ, none if either survey does not tell its own."""
    if not before.settings or not after.settings:
        return ()
    pairs = [
        (f'hazards.{name}', before.settings.get(name), after.settings.get(name))
        for name in after.settings if name not in NO_LIMITS
    ]
    if before.described and after.described:
        pairs += [
            (f'{key} of the rules', before.described.get(key), after.described.get(key))
            for key in _RULES
        ]
    differing = [
        LimitChange(name=name, before=first, after=second)
        for name, first, second in pairs if first != second
    ]
    # limits in words only repeat settings, unless they are all that differs
    named = [item for item in differing if item.name != 'limits of the rules']
    return tuple(named or differing)


def describe_limit_changes(
    limits: Sequence[LimitChange], num_before: int, num_after: int
) -> str:
    """Say which limits differ and how many hazards are not judged for it, '' if none differ."""
    if not limits:
        return ''
    listed = ', '.join(
        f'{item.name} was {_show(item.before)} and is {_show(item.after)}' for item in limits
    )
    return (
        f'limits of hazards differ: {listed}; not compared, as the other limits may not raise'
        f' them: {num_before} hazards of the first survey, {num_after} of the second'
    )


def _show(value: Any) -> str:
    if isinstance(value, list):
        return f'[{"; ".join(map(str, value))}]'
    return str(value)


def would_raise(hazard: Hazard, own: Limits, other: Limits) -> bool:
    """
    Tell whether other limits would surely have raised a hazard as well.

    Parameters
    ----------
    hazard : Hazard
        The hazard.
    own : Limits
        Those that raised it.
    other : Limits
        Those in question.

    Returns
    -------
    bool

    """
    first, second = own.settings, other.settings
    least = second.get('min_confidence', 1.0)
    if hazard.kind in FEATURES:
        return _are_as_strict(hazard.kind, own, other) or any(
            _surely_breaks(hazard, limit, own, second) and _judge(hazard, limit) >= least
            for limit in _find_limits(other, hazard.kind)
        )
    if least > first.get('min_confidence', 0.0) and hazard.confidence < least:
        return False
    if hazard.kind == HazardKind.INTERFERENCE:
        ratios = [item.get('interference_ratio', 0.0) for item in (first, second)]
        return hazard.clearance * ratios[0] < hazard.required * ratios[1]
    if hazard.kind == HazardKind.SAG:
        shares = [item.get('sag_deviation', np.inf) for item in (first, second)]
        return shares[1] <= shares[0] or hazard.clearance * shares[0] > hazard.required * shares[1]
    return True


def _find_limits(limits: Limits, kind: HazardKind) -> tuple[Limit, ...]:
    """Return the limits that hazards of a kind break, none where they are not known any more."""
    return limits.rules.find(FEATURES[kind]) if limits.rules is not None else ()


def _are_as_strict(kind: HazardKind, own: Limits, other: Limits) -> bool:
    """Tell whether other limits raise all hazards of a kind that one's own do."""
    known = _find_limits(other, kind)
    limits = _find_limits(own, kind)
    return bool(limits) and all(limit in known for limit in limits) and all(
        other.settings.get(name, np.inf) <= own.settings.get(name, -np.inf)
        for name in ('min_points', 'min_confidence')
    )


def _surely_breaks(
    hazard: Hazard, limit: Limit, own: Limits, settings: Mapping[str, Any]
) -> bool:
    """Tell whether a hazard surely breaks a limit of others, with as many points as these need."""
    measured = {
        'distance': hazard.clearance, 'horizontal': hazard.horizontal,
        'vertical': abs(hazard.vertical),
    }[limit.measure]
    under = bool(are_under(np.array(hazard.horizontal), np.array(hazard.vertical)))
    is_within = measured < limit.reach and limit.where in ('any', 'under' if under else 'beside')
    if not is_within or _judge(replace(hazard, note=''), limit) < SURE:
        return False
    needed = settings.get('min_points', np.inf) if hazard.kind in BY_POINTS else 1
    if needed <= 1:
        return True
    # points were counted within the reach of one's own limits
    reach = max((item.radius for item in _find_limits(own, hazard.kind)), default=np.inf)
    return bool(hazard.num_points >= needed and limit.radius >= reach)


def _judge(hazard: Hazard, limit: Limit) -> float:
    """Return how sure it is that a hazard breaks a limit at all."""
    names = 'kind', 'severity', 'clearance', 'horizontal', 'vertical', 'sigma', 'note'
    return judge_confidence(limit, {name: getattr(hazard, name) for name in names}).hazard
