# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Which limits points break, as each limit measures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, Int64

LEAST_DISTANCE = 1e-9
"""
Required distance at least, where a measured one is divided by it [m].
Source: numerical: avoids a division by 0.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Breaches:
    """What each of K points breaks: the most severe limit, and that of which least is kept."""

    limit: Int64
    """(K,) which limit, -1 none."""
    severity: Int64
    """(K,) by that limit, 0 where none of its tiers is broken."""
    share: Float64
    """(K,) of the required distance that is kept, inf none."""
    value: Float64
    """(K,) what is measured for that limit [m]."""
    owner: Int64
    """(K,) index of the model that it is measured to."""

    def take(self, chosen: Bool) -> 'Breaches':
        """Return those of some points."""
        return Breaches(
            limit=self.limit[chosen], severity=self.severity[chosen], share=self.share[chosen],
            value=self.value[chosen], owner=self.owner[chosen],
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
    values = {'distance': (distance, owner), 'vertical': (np.abs(vertical), owner)}
    aside = [item.reach for item in limits if item.measure == 'horizontal']
    if aside:
        values['horizontal'] = _measure_aside(points, models, max(aside))
    under = (vertical > 0) & (vertical >= horizontal)
    places = {'any': np.ones(num, dtype=np.bool_), 'under': under, 'beside': ~under}
    result = Breaches(
        limit=np.full(num, -1, dtype=np.int64), severity=np.zeros(num, dtype=np.int64),
        share=np.full(num, np.inf), value=np.zeros(num), owner=owner.copy(),
    )
    for number, item in enumerate(limits):
        value, nearest = values[item.measure]
        share = value / max(item.distance, LEAST_DISTANCE)
        tier = np.searchsorted([reach for _, reach in item.tiers], value, side='right')
        severity = np.array([*(int(step) for step, _ in item.tiers), 0])[tier]
        worse = (severity > result.severity) | (
            (severity == result.severity) & (share < result.share)
        )
        worse &= places[item.where] & (value < item.reach)
        result.limit[worse], result.severity[worse] = number, severity[worse]
        result.share[worse], result.value[worse] = share[worse], value[worse]
        result.owner[worse] = nearest[worse]
    return result


def _measure_aside(
    points: Float64, models: Sequence[SpanModel], reach: float
) -> tuple[Float64, Int64]:
    """Return the horizontal distance of points to a conductor within reach, and to which."""
    least, owner = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    for number, model in enumerate(models):
        ends = np.stack((model.span.start[:2], model.span.end[:2]))
        low, high = ends.min(axis=0) - reach, ends.max(axis=0) + reach
        mine = np.flatnonzero(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))
        _, horizontal, _ = model.part(points[mine])
        nearer = horizontal < least[mine]
        least[mine[nearer]], owner[mine[nearer]] = horizontal[nearer], number
    return least, owner
