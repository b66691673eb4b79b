# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sensitivity: the effect of changing each setting by a fifth."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from plc_inspect.config import Settings
from plc_inspect.core.tuning.objective import Score
from plc_inspect.core.tuning.parameters import get_value
from plc_inspect.offline.commands.command_line import Progress
from plc_inspect.offline.commands.workers import Workers
from plc_inspect.offline.terminal.result_table import format_number, format_table
from plc_inspect.results import Bool, Float64, Int64
from plc_inspect.setting_names import describe, update

CHANGE = 0.2
SECTIONS = (
    'height', 'linearity', 'outliers', 'alignment', 'clustering', 'catenary', 'supports',
)
"""Sections of settings that decide what a line is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """The effect of changing one setting."""

    name: str
    value: float
    to: float
    """The changed value, within the setting's range."""
    score: Score
    """The score with the changed value."""
    base: Score
    """The score of the unchanged settings."""
    changed: float
    """New and lost wire points, as a share of all wire points before or after."""


def measure_sensitivity(
    points: Float64,
    settings: Settings,
    seed: int = 0,
    truth: tuple[Bool, Bool] | None = None,
    progress: Progress | None = None,
    names: Sequence[str] | None = None,
    num_workers: int | None = None,
) -> list[Effect]:
    """
    Change each setting by 20 % down and up, alone, and look at the result.

    Settings of 0, which are derived from the data, and those that a fifth does not change are
    left out.

    Parameters
    ----------
    points : (N, 3) float64
        Map frame [m].
    settings : Settings
        Base settings.
    seed : int
        Chooses the half of the points for stability.
    truth : tuple of two (N,) bool or None
        Wire points, and those left out.
    progress : callable or None
        Called with the name of the step and its share.
    names : sequence of str or None
        Settings to change, by default all numbers that decide what a line is.
    num_workers : int or None
        Processes, by default as many as pay.

    Returns
    -------
    list of Effect
        Down before up, in the order of the settings.

    """
    told = progress or (lambda step, share: None)
    steps = [
        (name, to) for name in names or list_names() for to in change(settings, name)
    ]
    with Workers(points, seed, truth, num_workers, settings) as workers:
        results = workers.evaluate(
            [settings, *(update(settings, {name: to}) for name, to in steps)]
        )
        base, wire = next(results)
        effects = []
        for number, ((name, to), (score, other)) in enumerate(zip(steps, results, strict=True)):
            effects.append(Effect(
                name=name, value=get_value(settings, name), to=float(to), score=score,
                base=base, changed=measure_change(wire, other),
            ))
            told(f'{number + 1} of {len(steps)}', (number + 1) / len(steps))
    return effects


def list_names() -> list[str]:
    """Return the names of all numbers that decide what a line is."""
    return [
        name for name, default, _ in describe()
        if name.partition('.')[0] in SECTIONS and type(default) in (int, float)
    ]


def change(settings: Settings, name: str) -> list[float | int]:
    """Return a setting minus and plus a fifth, within its range; integers change by one."""
    value = get_value(settings, name)
    meta = next(meta for other, _, meta in describe() if other == name)
    section, _, key = name.partition('.')
    whole = type(getattr(getattr(settings, section), key)) is int
    results: list[float | int] = []
    for sign in (-1.0, 1.0):
        to = value * (1.0 + sign * CHANGE)
        if whole and value:
            to = value + sign * max(round(CHANGE * value), 1)
        to = min(max(to, meta['low']), meta['high'])
        if to != value:
            results.append(int(to) if whole else to)
    return results


def measure_change(wire: Int64, other: Int64) -> float:
    """Return the share of points that are in one of two sets of indices but not in both."""
    both = len(np.intersect1d(wire, other, assume_unique=True))
    union = len(wire) + len(other) - both
    return 1.0 - both / union if union else 0.0


def render_sensitivity(effects: Sequence[Effect]) -> str:
    """Return the effects as text, those that change most first."""
    by_name: dict[str, list[Effect]] = {}
    for effect in effects:
        by_name.setdefault(effect.name, []).append(effect)
    order = sorted(by_name.values(), key=lambda own: -max(item.changed for item in own))
    with_truth = any(math.isfinite(effect.score.f1) for effect in effects)
    head = ['setting', 'value', 'to', 'wire points changed', 'spans', 'score']
    rows = []
    for own in order:
        for item in own:
            row = [
                item.name, f'{item.value:g}', f'{item.to:g}', f'{100 * item.changed:.2f} %',
                f'{item.score.num_spans - item.base.num_spans:+d}',
                f'{item.score.value - item.base.value:+.4f}',
            ]
            rows.append(
                [*row, format_number(item.score.f1 - item.base.f1, 4)] if with_truth else row
            )
    return format_table([*head, 'F1'] if with_truth else head, rows)
