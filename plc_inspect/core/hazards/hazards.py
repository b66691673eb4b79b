# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Finds all hazards: clearances, falling trees, crossings, interference and abnormal sag."""

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
from functools import partial

import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.extraction.surfaces import is_surface, tell_shapes
from plc_inspect.core.ground.ground_planes import find_planes
from plc_inspect.core.hazards.clearance_rules import PLAIN, plain_rules, RuleSet
from plc_inspect.core.hazards.conductor_hazards import find_abnormal_sag, find_interference
from plc_inspect.core.hazards.crossings import find_crossings
from plc_inspect.core.hazards.encroachments import find_encroachments, Nearby, Surroundings
from plc_inspect.core.hazards.falling_trees import Fallible, find_fallible, find_falling_trees
from plc_inspect.core.hazards.line_parts import DoubtfulCurves, find_line_parts
from plc_inspect.core.hazards.low_conductors import (
    find_low_conductors,
    find_low_wires,
    keep_seen,
    measure_ground,
)
from plc_inspect.core.hazards.missing_conductors import find_missing_conductors
from plc_inspect.core.hazards.strands import find_strands, measure_distances
from plc_inspect.core.numerics.arrays import take_rows
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.core.spans.spans import SpanResult
from plc_inspect.errors import ConfigError
from plc_inspect.results import Bool, Float32, Float64, Hazard, Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HazardResult:
    """The hazards of one cloud, and what else was learned of the K surroundings of conductors."""

    hazards: tuple[Hazard, ...]
    """Numbered in order of span, line and place."""
    offending: tuple[Float64, ...]
    """(K, 3) offending points of each, or the place of a conductor [m]."""
    foliage: Bool
    """(K,) neither of surfaces, such as roofs and walls, nor of lines and what holds them."""
    models: tuple[SpanModel, ...]
    """The spans with their sub-conductors."""
    num_unmodelled: int
    """Wires near conductors that were not modelled."""
    ground_below: tuple[Float64, ...]
    """For each span (S, 3): as `low_conductors.measure_ground` returns."""


def choose_rules(settings: HazardSettings, rules: RuleSet | None = None) -> RuleSet:
    """
    Return the rules that apply: those given, or the plain ones of the settings.

    Raises
    ------
    ConfigError
        The settings name a rule set and none is given.

    """
    if rules is not None:
        return rules
    if settings.rules != PLAIN:
        raise ConfigError(f'hazards.rules is {settings.rules!r}, but that rule set was not read')
    return plain_rules(settings)


def find_hazards(
    points: Float64,
    height: Float32 | None,
    nearby: Nearby,
    spans: SpanResult,
    settings: HazardSettings,
    rules: RuleSet | None = None,
    doubtful: DoubtfulCurves | None = None,
) -> HazardResult:
    """
    Find the places where a rule is broken.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float32 or None
        Above local ground [m]; without it trees are as tall as they reach above the lowest
        point, and none is taken to fall.
    nearby : Nearby
        K surroundings of the conductors.
    spans : SpanResult
        Spans with their curves, supports, and labels of the points.
    settings : HazardSettings
        Thresholds.
    rules : RuleSet or None
        What is asked for; by default the plain rules of the settings.
    doubtful : DoubtfulCurves or None
        Curves that may be conductors, and are no spans.

    Returns
    -------
    HazardResult

    Raises
    ------
    ConfigError
        The settings contradict themselves, or name a rule set that is not given.

    """
    rules = choose_rules(settings, rules)
    models, supports = find_strands(points, spans), spans.supports
    own = take_rows(points, nearby.index)
    surface, reach = is_surface(own), rules.reach('vegetation', 'building')
    distance = measure_distances(own, nearby.distance, nearby.span, models, reach)
    doubtful = doubtful or DoubtfulCurves()
    parts = find_line_parts(own, distance, nearby.span, models, doubtful, reach)
    other = np.flatnonzero(~(parts.own | parts.unmodelled))
    around = Surroundings(
        points=own,
        height=_heights(own, None if height is None else height[nearby.index]),
        distance=distance,
        owner=nearby.span,
        surface=surface | parts.column,
    ).take(other)
    found, explained = find_encroachments(
        around, models, supports, rules, settings, over_ground=height is not None
    )
    free = np.zeros(len(own), dtype=bool)
    free[other] = ~explained
    if height is not None and rules.find('fall_in'):
        wide = find_fallible(points, height, spans)
        no_tree = parts.own | parts.unmodelled | parts.column
        wide = np.setdiff1d(wide, nearby.index[no_tree], assume_unique=True)
        trees = take_rows(points, wide)
        flat, slender = tell_shapes(trees)
        fallible = Fallible(
            points=trees, height=np.asarray(height[wide], dtype=np.float64),
            surface=flat, slender=slender,
        )
        found += find_falling_trees(
            fallible, models, supports, rules, settings,
            [item for item in found if item['chance'] >= settings.min_confidence],
            partial(find_planes, points, height),
        )
    low_wires = find_low_wires([own[wire] for wire in parts.wires], models)
    lowest = max((limit.reach for limit in rules.find('ground')), default=0.0)
    lowest += max((wire.below for wire in low_wires), default=0.0)
    ground_below = measure_ground(points, height, models, spans.ground_below, lowest)
    sure = settings.min_confidence
    found += find_low_conductors(models, ground_below, supports, rules, low_wires, sure)
    wires = [doubtful.every[k] for k in parts.curves]
    found += find_crossings(models, supports, rules, wires, sure)
    found += find_interference(models, supports, rules, settings)
    found += find_abnormal_sag(models, supports, rules, settings)
    found += find_missing_conductors(points, models, supports, rules)
    found = [item for item in found if item.pop('chance') >= settings.min_confidence]
    order = ('span_id', 'line_id', 'along_span', 'kind')
    found.sort(key=lambda item: tuple(item[name] for name in order))
    offending = tuple(item.pop('offending') for item in found)
    return HazardResult(
        hazards=tuple(
            Hazard(hazard_id=number, extent=np.stack([own.min(axis=0), own.max(axis=0)]), **item)
            for number, (item, own) in enumerate(zip(found, offending, strict=True))
        ),
        offending=offending,
        foliage=free & ~surface,
        models=models,
        num_unmodelled=parts.num_wires,
        ground_below=ground_below,
    )


def complete_spans(
    models: Sequence[SpanModel], ground_below: Sequence[Float64]
) -> tuple[Span, ...]:
    """
    Return the spans with their sub-conductors, least height above seen ground and its place.

    Parameters
    ----------
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : sequence of (K, 2+) float64
        For each, distance from its start and height above ground [m].

    Returns
    -------
    tuple of Span

    """
    result = []
    for model, stations in zip(models, ground_below, strict=True):
        way = 1.0 if model.start_x <= model.end_x else -1.0
        span = dataclasses.replace(model.span, strands=model.strands * (way, 1.0))
        stations = keep_seen(model, stations)
        if len(stations):
            along, clearance = stations[int(np.argmin(stations[:, 1])), :2].tolist()
            span = dataclasses.replace(span, ground_clearance=clearance, ground_along=along)
        result.append(span)
    return tuple(result)


def _heights(own: Float64, height: Float32 | None) -> Float64:
    """Return heights above ground [m], above the lowest point where the ground is unknown."""
    if height is None or not np.isfinite(height).all():
        lowest = own[:, 2].min() if len(own) else 0.0
        above: Float64 = own[:, 2] - lowest
        return above if height is None else np.where(np.isfinite(height), height, above)
    return height.astype(np.float64)
