# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazards: clearance rules, falling trees, crossings, interference and abnormal sag."""

from collections.abc import Sequence
import dataclasses

import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.hazards.clearance_rules import PLAIN, plain_rules, RuleSet
from plc_inspect.core.hazards.conductor_hazards import (
    find_abnormal_sag,
    find_crossings,
    find_interference,
    find_low_conductors,
)
from plc_inspect.core.hazards.encroachments import find_encroachments, Surroundings
from plc_inspect.core.hazards.falling_trees import find_fallible, find_falling_trees
from plc_inspect.core.hazards.surfaces import is_surface
from plc_inspect.core.numerics.arrays import take_rows
from plc_inspect.core.spans.span_model import SpanModel as SpanModel
from plc_inspect.errors import ConfigError
from plc_inspect.results import Bool, Float32, Float64, Hazard, Int32, Int64, Span, Support


def choose_rules(settings: HazardSettings, rules: RuleSet | None = None) -> RuleSet:
    """
    Return the rules that hold: those given, or the plain ones of the settings.

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
    near: Int64,
    distance: Float64,
    owner: Int64,
    models: Sequence[SpanModel],
    ground_below: Sequence[Float64],
    settings: HazardSettings,
    *,
    rules: RuleSet | None = None,
    height: Float32 | None = None,
    supports: Sequence[Support] = (),
    line_id: Int32 | None = None,
    support: Bool | None = None,
) -> tuple[tuple[Hazard, ...], Bool]:
    """
    Find the places where a rule is broken.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    near : (K,)
        Indices of points near a conductor, off the ground, neither wire nor support.
    distance : (K,)
        Distance to the nearest span [m].
    owner : (K,)
        Which of the models that is.
    models : sequence of SpanModel
        Spans with their curves.
    ground_below : for each model the (S, 2) stations: distance from its start and height of the
        conductor above ground [m]; empty where the ground is not known
    settings : HazardSettings
        Thresholds.
    rules : RuleSet
        What is asked for.
    height : (N,) height above local ground [m]; without it trees are as tall as they reach above
        the lowest point, and none is taken to fall
    supports : sequence of Support
        Towers and poles.
    line_id : (N,) int32
        Conductor of each point, -1 none; these do not fall.
    support : (N,) bool
        Points of towers and poles, which do not either.

    Returns
    -------
    hazards : tuple of Hazard, numbered in order of span, line and place
    foliage : (K,) bool, points that are neither of surfaces, such as roofs and walls, nor of what
        holds the conductors

    Raises
    ------
    ConfigError
        The settings contradict themselves, or name a rule set that is not given.

    """
    rules = choose_rules(settings, rules)
    own = take_rows(points, near)
    surface = is_surface(own)
    around = Surroundings(
        points=own,
        height=_heights(own, None if height is None else height[near]),
        distance=distance,
        owner=owner,
        surface=surface,
    )
    found, explained = find_encroachments(around, models, supports, rules, settings)
    if height is not None and rules.find('fall_in'):
        wide = find_fallible(points, height, models, line_id, support)
        trees = take_rows(points, wide)
        found += find_falling_trees(
            trees, np.asarray(height[wide], dtype=np.float64), is_surface(trees),
            models, supports, rules, settings, found,
        )
    found += find_low_conductors(models, ground_below, supports, rules)
    found += find_crossings(models, supports, rules)
    found += find_interference(models, supports, rules, settings)
    found += find_abnormal_sag(models, supports, rules, settings)
    order = ('span_id', 'line_id', 'along_span', 'kind')
    found.sort(key=lambda item: tuple(item[name] for name in order))
    hazards = tuple(Hazard(hazard_id=number, **item) for number, item in enumerate(found))
    return hazards, ~(surface | explained)


def add_ground_clearance(
    models: Sequence[SpanModel], ground_below: Sequence[Float64]
) -> tuple[Span, ...]:
    """Return the spans with their least height above ground and where that is."""
    result = []
    for model, stations in zip(models, ground_below, strict=True):
        span = model.span
        if len(stations):
            along, clearance = stations[int(np.argmin(stations[:, 1]))].tolist()
            span = dataclasses.replace(span, ground_clearance=clearance, ground_along=along)
        result.append(span)
    return tuple(result)


def _heights(own: Float64, height: Float32 | None) -> Float64:
    """Heights above ground; where that is unknown, above the lowest point."""
    if height is None or not np.isfinite(height).all():
        lowest = own[:, 2].min() if len(own) else 0.0
        above: Float64 = own[:, 2] - lowest
        return above if height is None else np.where(np.isfinite(height), height, above)
    return height.astype(np.float64)
