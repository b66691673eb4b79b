# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which limits points break, as each limit measures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plc_inspect.core.hazards.clearance_rules import HIGHEST, Limit
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, Int64, Severity

LEAST_DISTANCE = 1e-9
"""
Required distance at least, where a measured one is divided by it [m].
Source: numerical: avoids a division by 0.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Breaches:
    """What each of K points breaks: the most severe limit, and that of which least is kept."""

    limits: Sequence[Limit]
    limit: Int64
    """(K,) which of the limits, -1 none."""
    severity: Int64
    """(K,) by that limit, 0 where none of its tiers is broken."""
    share: Float64
    """(K,) of the required distance that is kept, inf none."""
    value: Float64
    """(K,) what is measured for that limit [m]."""
    owner: Int64
    """(K,) index of the model that it is measured to."""

    def take(self, chosen: Bool | Int64) -> 'Breaches':
        """Return those of some points."""
        return Breaches(
            limits=self.limits, limit=self.limit[chosen], severity=self.severity[chosen],
            share=self.share[chosen], value=self.value[chosen], owner=self.owner[chosen],
        )

    def rank(self) -> Float64:
        """Return (K,) the place of each point in order, the worst first."""
        result = np.empty(len(self.limit))
        result[np.lexsort((self.share, -self.severity))] = np.arange(len(self.limit))
        return result


def find_breaches(
    points: Float64, distance: Float64, owner: Int64, models: Sequence[SpanModel],
    limits: Sequence[Limit],
) -> Breaches:
    """
    Find the limit that each point breaks most.

    Parameters
    ----------
    points : (K, 3) float64
        Positions [m].
    distance : (K,) float64
        To the nearest conductor in space [m].
    owner : (K,) int64
        Index of its model.
    models : sequence of SpanModel
        Spans with their curves.
    limits : sequence of Limit
        Of one feature.

    Returns
    -------
    Breaches

    """
    num = len(points)
    horizontal, vertical = np.zeros(num), np.zeros(num)
    if any(item.measure == 'vertical' or item.where != 'any' for item in limits):
        for number in np.unique(owner).tolist():
            mine = np.flatnonzero(owner == number)
            _, horizontal[mine], vertical[mine] = models[number].part(points[mine])
    under = are_under(horizontal, vertical)
    reaches = [item.reach for item in limits if item.measure == 'horizontal']
    beside = owner
    if reaches:
        horizontal, beside = _measure_aside(points, models, max(reaches))
    values = {'distance': distance, 'horizontal': horizontal, 'vertical': np.abs(vertical)}
    limit, severity, share = choose_limits(values, under, limits)
    measure = np.array([*(item.measure for item in limits), ''])[limit]
    return Breaches(
        limits=limits, limit=limit, severity=severity, share=share,
        value=np.select([measure == name for name in values], list(values.values())),
        owner=np.where(measure == 'horizontal', beside, owner),
    )


def are_under(horizontal: Float64, vertical: Float64) -> Bool:
    """Tell which points are under a conductor rather than beside it, by parts of the distance."""
    result: Bool = (vertical > 0) & (vertical >= horizontal)
    return result


def choose_limits(
    values: Mapping[str, Float64], under: Bool, limits: Sequence[Limit]
) -> tuple[Int64, Int64, Float64]:
    """
    Choose the limit that each point breaks most.

    Parameters
    ----------
    values : mapping
        Measure to (K,) what it is [m].
    under : (K,) bool
        From `are_under`.
    limits : sequence of Limit
        Of one feature.

    Returns
    -------
    limit : (K,) int64
        Which limit, the most severe, then that of which least is kept; -1 none.
    severity : (K,) int64
        By that limit, 0 none.
    share : (K,) float64
        Of its distance that is kept, inf none.

    """
    num = len(under)
    places = {'any': np.ones(num, dtype=np.bool_), 'under': under, 'beside': ~under}
    which, worst = np.full(num, -1, dtype=np.int64), np.zeros(num, dtype=np.int64)
    least = np.full(num, np.inf)
    for number, item in enumerate(limits):
        value = values[item.measure]
        share = value / max(item.distance, LEAST_DISTANCE)
        tier = np.searchsorted([reach for _, reach in item.tiers], value, side='right')
        severity = np.array([*(int(step) for step, _ in item.tiers), 0])[tier]
        worse = (severity > worst) | ((severity == worst) & (share < least))
        worse &= places[item.where] & (value < item.reach)
        which[worse], worst[worse], least[worse] = number, severity[worse], share[worse]
    return which, worst, least


def judge_value(value: float, limits: Sequence[Limit]) -> tuple[Limit, Severity] | None:
    """Return the limit that a value [m] breaks most, as `choose_limits`, and how severely."""
    broken = [(item, severity) for item in limits if (severity := item.judge(value)) is not None]
    return min(broken, default=None, key=lambda one: (
        -one[1], value / max(one[0].distance, LEAST_DISTANCE)
    ))


def _measure_aside(
    points: Float64, models: Sequence[SpanModel], reach: float
) -> tuple[Float64, Int64]:
    """Return the horizontal distance of points to a conductor within reach, and to which."""
    least, owner = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    for number, model in enumerate(models):
        ends = np.stack((model.span.start[:2], model.span.end[:2]))
        room = reach + float(np.abs(model.strands[:, 0]).max())
        low, high = ends.min(axis=0) - room, ends.max(axis=0) + room
        mine = np.flatnonzero(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))
        _, horizontal, vertical = model.part(points[mine])
        nearer = (horizontal < least[mine]) & (vertical <= HIGHEST)
        least[mine[nearer]], owner[mine[nearer]] = horizontal[nearer], number
    return least, owner
