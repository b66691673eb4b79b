# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazards by vegetation and structures close to a conductor: one object, one hazard."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.blur import choose_worst, measure_reach
from plc_inspect.core.hazards.breaches import Breaches, find_breaches
from plc_inspect.core.hazards.clearance_rules import Limit, RuleSet
from plc_inspect.core.hazards.columns import THICK
from plc_inspect.core.hazards.confidence import cap_severity, judge_confidence, list_doubts
from plc_inspect.core.hazards.trees import segment_trees, stand_near
from plc_inspect.core.numerics.grouping import group_cells, group_points
from plc_inspect.core.spans.span_model import find_kind, find_support, SpanModel
from plc_inspect.results import (
    Bool,
    Float64,
    HazardKind,
    Int64,
    MEASURE_NOTES,
    Severity,
    Support,
)

LEAFY = 0.15
"""
Share of surface points up to which an object is surely foliage.
Source: chosen on bench/hazards.py.
"""
FLAT = 0.5
"""
Share of surface points from which an object is surely a structure.
Source: chosen on bench/hazards.py.
"""
ROOM = {'pole': 1.5, 'tower': 5.0}
"""
Distance along the line within which an object may be part of a support [m].
Source: judgement; not measured.
"""
THIN_ROOM = 0.75
"""
The same at an end whose support was not seen, or not recognised [m].
Source: chosen on bench/hazards.py.
"""
TREE_MARGIN = 8.0
"""
Distance in plan around offending points within which trees are divided [m].
Source: judgement; not measured.
"""
TREE_LINK = 1.0
"""
Edge of the cells that touch within a tree: what hangs above one is not of it [m].
Source: chosen on bench/hazards.py.
"""
OF_GROUND = 0.8
"""
What rises by less above the ground is of it: bumps, furrows, herbs [m].
Source: measured: bench/studies/live_hazards.py, 9841: points of the ground seen at 8 degrees, in
20 scraps 0.50 to 0.56 m above its surface, which has the lowest point of each cell.
"""
MOST_OF = 0.5
"""
An object is a structure where more than this share of its offending points is surface.
Source: derived: the majority.
"""
SURE = 2.0
"""
Standard deviations within which a distance may be another.
Source: derived: 95 % of normal errors lie within.
"""
SPREAD_OF_ZERO = math.sqrt(3.0)
"""
What begins anywhere between two distances deviates from the farther by their difference over this.
Source: derived: the root mean square of what is evenly distributed, from one end.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nearby:
    """Points near a conductor: off the ground, neither wire nor support, and not on one."""

    index: Int64
    """(K,) which of the N points these are, ascending."""
    distance: Float64
    """(K,) distance to the nearest span [m]."""
    span: Int64
    """(K,) which span that is."""

    def take(self, chosen: Bool) -> 'Nearby':
        """Return some of the points."""
        if chosen.all():
            return self
        return Nearby(
            index=self.index[chosen], distance=self.distance[chosen], span=self.span[chosen]
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """Points close to the conductors, off the ground, neither wire nor support."""

    points: Float64
    """(K, 3) [m]."""
    height: Float64
    """(K,) above local ground [m]."""
    distance: Float64
    """(K,) to the nearest span [m]."""
    owner: Int64
    """(K,) index of its model."""
    surface: Bool
    """(K,) points of roofs and walls rather than of foliage."""

    def take(self, chosen: Int64 | Bool) -> 'Surroundings':
        """Return some of the points."""
        return Surroundings(
            points=self.points[chosen],
            height=self.height[chosen],
            distance=self.distance[chosen],
            owner=self.owner[chosen],
            surface=self.surface[chosen],
        )


def find_encroachments(
    around: Surroundings,
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    rules: RuleSet,
    settings: HazardSettings,
    *,
    over_ground: bool = True,
) -> tuple[list[dict[str, Any]], Bool]:
    """
    Find trees and structures that are closer to a conductor than a rule allows.

    Connected offending points are divided tree by tree.  A tree counts once, at its worst point,
    however many conductors it is close to.

    Parameters
    ----------
    around : Surroundings
        Of all conductors.
    models : sequence of SpanModel
        Spans with their curves.
    supports : sequence of Support
        Towers and poles.
    rules : RuleSet
        Limits that apply.
    settings : HazardSettings
        Growth, least number of points and distance that links points.
    over_ground : bool
        Heights are above the ground: what is of it is no object.

    Returns
    -------
    hazards : list of dict
        Values of Hazard without its number.
    explained : (K,) bool
        Points that are close enough to offend but belong to a support.

    """
    limits = {
        HazardKind.VEGETATION: rules.find('vegetation'),
        HazardKind.STRUCTURE: rules.find('building'),
    }
    offends = np.zeros(len(around.points), dtype=bool)
    for kind, asked in limits.items():
        if asked:
            own = _find_near(around, asked, around.surface == (kind == HazardKind.STRUCTURE))
            offends[own] |= _find_breaches(around.take(own), models, asked).limit >= 0
    explained = np.zeros(len(offends), dtype=bool)
    on_axis = np.flatnonzero(offends)
    on_axis = on_axis[_are_on_axis(around.points[on_axis], supports)]
    offends[on_axis], explained[on_axis] = False, True
    if not offends.any():
        return [], explained
    tree = _find_trees(around, offends)
    bad = np.flatnonzero(offends)
    near = around.take(bad)
    breaches = {kind: _find_breaches(near, models, asked) for kind, asked in limits.items()}
    cluster = group_points(near.points, settings.group_distance)
    lone = np.bincount(cluster)[cluster] < settings.min_points
    held = (np.bincount(cluster, weights=~_are_held(near, models, supports)) == 0)[cluster]
    explained[bad[held]] = True
    lone |= held
    tallest = _measure_trees(around, tree, models, supports)
    known = tree >= 0
    flat = np.bincount(tree[known], weights=around.surface[known]) / np.bincount(tree[known])
    result = []
    for own in _split(np.where(lone, -1, tree[bad])):
        number = tree[bad[own[0]]]
        share, height = float(flat[number]), float(tallest[number])
        if len(own) < settings.min_points or (over_ground and height < OF_GROUND):
            continue
        records = [
            record for kind in _list_kinds(near.surface[own], share)
            if (record := _describe(
                near.take(own), breaches[kind].take(own), models, supports, kind, rules, settings
            )) is not None and record['chance'] >= settings.min_confidence
        ]
        if records:
            worst = max(records, key=lambda record: record['severity'])  # the first of equals
            result.append(worst | {'height': height})
    return result, explained


def is_held(points: Float64, model: SpanModel, supports: Sequence[Support]) -> Bool:
    """
    Tell the points so close to an end of a span, along it, that its support explains them.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    model : SpanModel
        The span.
    supports : sequence of Support
        Towers and poles; an end without one is taken to hang on something thin.

    Returns
    -------
    (N,) bool

    """
    result = np.zeros(len(points), dtype=bool)
    x, _ = model.curve.local(points)
    for place, end in ((model.start_x, model.span.start), (model.end_x, model.span.end)):
        result |= np.abs(x - place) <= ROOM.get(find_kind(model.span, end, supports), THIN_ROOM)
    return result


def _are_on_axis(points: Float64, supports: Sequence[Support]) -> Bool:
    """Tell the points inside of poles: no search for supports looks at the lowest of them."""
    result = np.zeros(len(points), dtype=bool)
    order = np.argsort(points[:, 0], kind='stable')
    for support in supports:
        x, y = support.position[:2]
        bounds = x - THICK / 2.0, x + THICK / 2.0
        low, high = np.searchsorted(points[:, 0], bounds, sorter=order)
        near = order[low:high]
        result[near] |= np.hypot(*(points[near, :2] - (x, y)).T) <= THICK / 2.0
    return result


def _are_held(
    near: Surroundings, models: Sequence[SpanModel], supports: Sequence[Support]
) -> Bool:
    result = np.zeros(len(near.points), dtype=bool)
    for number in np.unique(near.owner).tolist():
        mine = np.flatnonzero(near.owner == number)
        result[mine] = is_held(near.points[mine], models[number], supports)
    return result


def _measure_trees(
    around: Surroundings, tree: Int64, models: Sequence[SpanModel], supports: Sequence[Support]
) -> Float64:
    """Return the height of each tree, without the support that it may stand at."""
    own = np.flatnonzero(tree >= 0)
    held = _are_held(around.take(own), models, supports)
    whole = np.bincount(tree[own], weights=~held) == 0
    own = own[~held | whole[tree[own]]]
    tallest = np.full(int(tree.max()) + 1, -np.inf)
    np.maximum.at(tallest, tree[own], around.height[own])
    return tallest


def _split(label: Int64) -> list[Int64]:
    """Return the indices of each label from 0, ascending within and between labels."""
    order = np.argsort(label, kind='stable')
    order = order[label[order] >= 0]
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [part for part in parts if len(part)]


def _list_kinds(surface: Bool, share: float) -> tuple[HazardKind, ...]:
    """Return what an object may be, by its share of surface, what most that offends is first."""
    if share <= LEAFY:
        return (HazardKind.VEGETATION,)
    if share >= FLAT:
        return (HazardKind.STRUCTURE,)
    if surface.mean() > MOST_OF:
        return HazardKind.STRUCTURE, HazardKind.VEGETATION
    return HazardKind.VEGETATION, HazardKind.STRUCTURE


def _find_trees(around: Surroundings, offends: Bool) -> Int64:
    """Return the tree of each point around the offending ones, -1 for those far from them."""
    near = np.flatnonzero(stand_near(around.points, offends, TREE_MARGIN))
    tree = np.full(len(around.points), -1, dtype=np.int64)
    body = group_cells(around.points[near], np.full(3, TREE_LINK))
    offending = np.zeros(int(body.max()) + 1, dtype=bool)
    offending[body[offends[near]]] = True
    near = near[offending[body]]
    tree[near] = segment_trees(around.points[near], around.height[near])
    return tree


def _find_near(around: Surroundings, limits: Sequence[Limit], chosen: Bool) -> Int64:
    """Return which of the chosen points may break a limit."""
    if all(item.measure == 'distance' for item in limits):
        chosen = chosen & (around.distance < max(item.reach for item in limits))
    return np.flatnonzero(chosen)


def _find_breaches(
    near: Surroundings, models: Sequence[SpanModel], limits: Sequence[Limit]
) -> Breaches:
    """Return what each of K points near conductors breaks of the limits of one kind."""
    return find_breaches(near.points, near.distance, near.owner, models, limits)


def _describe(
    near: Surroundings,
    found: Breaches,
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    kind: HazardKind,
    rules: RuleSet,
    settings: HazardSettings,
) -> dict[str, Any] | None:
    offends = found.limit >= 0
    if offends.sum() < settings.min_points:
        return None
    near, found = near.take(offends), found.take(offends)
    worst = choose_worst(near.points, found.rank(), near.distance, near.owner, models)
    limit, value = found.limits[int(found.limit[worst])], float(found.value[worst])
    model = models[int(found.owner[worst])]
    position = near.points[worst]
    x, horizontal, vertical = (float(part[0]) for part in model.part(position[None, :]))
    is_nearest = found.owner[worst] == near.owner[worst]
    clearance = float(near.distance[worst]) if is_nearest else math.hypot(horizontal, vertical)
    severity = limit.judge(value)
    years = math.nan
    if kind == HazardKind.VEGETATION and settings.growth > 0:
        years = max(value - limit.tiers[0][1], 0.0) / settings.growth
    sigma = model.sigma(x)
    reach = np.array([measure_reach(other) for other in models])
    touches = (near.distance <= reach[near.owner] + SURE * sigma).any()
    nearest = 0.0 if touches else float(near.distance.min())
    if touches or (limit.measure == 'distance' and nearest < clearance - SURE * sigma):
        # what is nearer is taken for the wire, or for strays
        sigma = math.hypot(sigma, (clearance - nearest) / SPREAD_OF_ZERO)
    return describe_hazard(
        model, x, supports, rules, limit,
        kind=kind,
        sigma=sigma,
        severity=severity or Severity.NOTICE,
        position=position.copy(),
        clearance=clearance,
        horizontal=horizontal,
        vertical=vertical,
        num_points=len(near.points),
        offending=near.points,
        years=years,
        note='; '.join(filter(None, (limit.note, MEASURE_NOTES.get(limit.measure)))),
    )


def describe_hazard(
    model: SpanModel,
    x: float,
    supports: Sequence[Support],
    rules: RuleSet,
    limit: Limit,
    **values: Any,
) -> dict[str, Any]:
    """
    Return the values of a Hazard: those given, those of the place, and those of the rule.

    Further ``chance`` is the probability that anything is to be reported.
    """
    along = float(model.along(np.array(x)))
    support, distance = find_support(model.span, along, supports)
    record: dict[str, Any] = {
        'line_id': model.span.line_id,
        'span_id': model.span.span_id,
        'required': limit.distance,
        'sigma': model.sigma(x),
        'along_span': along,
        'support_id': support,
        'from_support': distance,
        'rule': limit.title or rules.title,
        'edition': limit.edition or rules.edition,
        'source': limit.source or rules.source,
        'voltage': rules.voltage,
        'note': limit.note,
    } | values
    note = '; '.join(filter(None, [record['note'], *list_doubts(model, x, limit, record)]))
    record |= {'note': note, 'severity': cap_severity(record['severity'], note)}
    confidence = judge_confidence(limit, record)
    return record | {'confidence': confidence.severity, 'chance': confidence.hazard}
