# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings of stages at a point, and settings with which a stage would decide otherwise."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
import math

from plc_inspect.checks import Check
from plc_inspect.config import Settings
from plc_inspect.setting_names import describe, update

DIGITS = 3
"""Significant digits of a proposed value.  Source: judgement; not measured."""
DECIMALS = 12
"""Decimals of a proposed value.  Source: numerical: removes the rounding of a step."""
LEAST_VALUE = 1e-3
"""
Value of a setting below which moving it costs no more.
Source: numerical: bounds a logarithm.
"""
SLACK = 1e-9
"""Share by which a proposed value passes the figure.  Source: numerical: some rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What one stage found at a point."""

    stage: str
    outcome: str
    """'kept', 'dropped' or 'not asked'."""
    checks: tuple[Check, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """One setting at another value, with which a stage decides otherwise."""

    setting: str
    """Dotted name."""
    before: float
    after: float
    figure: str
    """The figure that crosses its limit."""
    value: float
    """Value of that figure."""
    also: 'Proposal | None' = None
    """Further change, if one setting is not enough."""

    @property
    def cost(self) -> float:
        """Cost of the moves: the sum of the logarithms of ratios."""
        own = abs(math.log(max(self.after, LEAST_VALUE) / max(self.before, LEAST_VALUE)))
        return own + (self.also.cost if self.also else 0.0)

    @property
    def moves(self) -> dict[str, float]:
        """Settings and their values."""
        return {self.setting: self.after} | (self.also.moves if self.also else {})


def propose(
    settings: Settings, setting: str, needed: float, is_least: bool, figure: str, value: float,
    *, away: bool = False,
) -> Iterator[Proposal]:
    """
    Yield the value of a setting at which a figure passes, if it lies within the setting's range.

    Parameters
    ----------
    settings : Settings
        Of the run.
    setting : str
        Dotted name of the limit.
    needed : float
        Value of the setting at which the figure just passes.
    is_least : bool
        The figure must not be less than the limit, else not greater.
    figure, value : str, float
        Its name and its value.
    away : bool
        Yield the value at which the figure just fails instead.

    """
    section, _, name = setting.partition('.')
    before = getattr(getattr(settings, section), name)
    default, meta = next((item, meta) for key, item, meta in describe() if key == setting)
    if not math.isfinite(needed):
        return
    upward = is_least == away
    after = _round(needed, upward, whole=isinstance(default, int))
    if away and after == needed:
        after = _step(after, upward, whole=isinstance(default, int))
    if meta['low'] <= after <= meta['high'] and after != before:
        yield Proposal(
            setting=setting, before=before, after=after, figure=figure, value=value
        )


def chain(moves: Sequence[Proposal]) -> Proposal:
    """Return one proposal that combines moves needed together."""
    result = moves[-1]
    for item in reversed(moves[:-1]):
        result = replace(item, also=result)
    return result


def rank(proposals: Iterable[Proposal]) -> list[Proposal]:
    """Return unique proposals, smallest move first."""
    unique = {tuple(sorted(item.moves.items())): item for item in proposals}
    return sorted(unique.values(), key=lambda item: (item.cost, item.setting))


def apply(proposals: Sequence[Proposal], settings: Settings) -> Settings:
    """Return settings with the proposals applied."""
    moves: dict[str, float] = {}
    for item in proposals:
        moves |= item.moves
    return update(settings, moves)


def _round(value: float, upward: bool, whole: bool) -> float:
    turn = math.ceil if upward else math.floor
    if whole:
        return int(turn(value))
    if value == 0.0:
        return 0.0
    step = _unit(value)
    rounded = round(turn(value / step) * step, DECIMALS)
    if (rounded < value) if upward else (rounded > value):
        rounded = round((turn(value / step) + (1 if upward else -1)) * step, DECIMALS)
    return rounded


def _step(value: float, upward: bool, whole: bool) -> float:
    move = (1 if upward else -1) * (1 if whole else _unit(value))
    return value + move if whole else round(value + move, DECIMALS)


def _unit(value: float) -> float:
    """Return one unit of the last digit that is kept."""
    return 10.0 ** (math.floor(math.log10(abs(value) or 1.0)) - DIGITS + 1)
