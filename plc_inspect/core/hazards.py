# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Hazards: clearance rules, falling trees, crossings, interference and abnormal sag."""

from collections.abc import Sequence
import dataclasses

from numba import njit, prange
import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.clearance import PLAIN, plain_rules, RuleSet
from plc_inspect.core.conductor_hazards import (
    find_abnormal_sag,
    find_crossings,
    find_interference,
    find_low_conductors,
)
from plc_inspect.core.corridor import find_near, span_table
from plc_inspect.core.encroachments import (
    FALL_REACH,
    find_encroachments,
    find_falling_trees,
    Surroundings,
    TREE_HEIGHT,
)
from plc_inspect.core.linearity import measure_likeness
from plc_inspect.core.span_model import SpanModel as SpanModel
from plc_inspect.core.voxels import build_voxels, find_slot, pack
from plc_inspect.errors import ConfigError
from plc_inspect.results import Bool, Float32, Float64, Hazard, Int64, Span, Support

PLANAR = 0.45
"""Planar likeness from which a neighbourhood is a surface, not foliage."""


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
    others: Bool | None = None,
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
    others : (N,) bool
        Wire and support points, which do not fall.

    Returns
    -------
    hazards : tuple of Hazard, numbered in order of span, line and place
    surface : (K,) bool, points of surfaces such as roofs and walls rather than of foliage

    Raises
    ------
    ConfigError
        The settings contradict themselves, or name a rule set that is not given.

    """
    rules = choose_rules(settings, rules)
    surface = is_surface(points, near)
    own = points[near]
    around = Surroundings(
        points=own,
        height=_heights(own, None if height is None else height[near]),
        distance=distance,
        owner=owner,
        surface=surface,
    )
    found = find_encroachments(around, models, supports, rules, settings)
    if height is not None and rules.find('fall_in'):
        free = np.isfinite(points).all(axis=1) & (height > TREE_HEIGHT)
        free &= ~others if others is not None else True
        wide = _search_wide(points, free, models)
        found += find_falling_trees(
            points[wide], np.asarray(height[wide], dtype=np.float64), is_surface(points, wide),
            models, supports, rules, settings, found,
        )
    found += find_low_conductors(models, ground_below, supports, rules)
    found += find_crossings(models, supports, rules)
    found += find_interference(models, supports, rules, settings)
    found += find_abnormal_sag(models, supports, rules, settings)
    order = ('span_id', 'line_id', 'along_span', 'kind')
    found.sort(key=lambda item: tuple(item[name] for name in order))
    return tuple(Hazard(hazard_id=number, **item) for number, item in enumerate(found)), surface


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
    lowest = own[:, 2].min() if len(own) else 0.0
    above: Float64 = own[:, 2] - lowest
    if height is None:
        return above
    return np.where(np.isfinite(height), height, above).astype(np.float64)


def _search_wide(points: Float64, free: Bool, models: Sequence[SpanModel]) -> Int64:
    """Return the indices of the free points from which something could fall on a conductor."""
    if not models:
        return np.zeros(0, dtype=np.int64)
    ends = np.sort(np.array([[item.start_x, item.end_x] for item in models]), axis=1)
    table = span_table([item.curve for item in models], ends[:, 0], ends[:, 1])
    found, _, _ = find_near(points, table, FALL_REACH)
    return found[free[found]]


def is_surface(points: Float64, chosen: Int64) -> Bool:
    """
    Tell points of roofs and walls from foliage by the planar likeness about them.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    chosen : (K,)
        Indices.

    Returns
    -------
    (K,) bool

    """
    if not len(chosen):
        return np.zeros(0, dtype=bool)
    own = points[chosen]
    origin = own.min(axis=0) - 2.0
    voxels = build_voxels(own, np.arange(len(own)), origin, 0.5)
    likeness = measure_likeness(voxels)
    surface = (
        (likeness.planar >= PLANAR) & (likeness.spherical <= 0.08) & (likeness.count >= 5)
    )
    result: Bool = _look_up(
        own, origin, voxels.size, voxels.table_key, voxels.table_slot, surface
    )
    return result


@njit(cache=True, parallel=True, nogil=True)
def _look_up(points, origin, size, table_key, table_slot, values):  # type: ignore[no-untyped-def]
    """Value of the voxel that each point lies in."""
    result = np.empty(len(points), dtype=values.dtype)
    for i in prange(len(points)):
        key = pack(
            int((points[i, 0] - origin[0]) / size),
            int((points[i, 1] - origin[1]) / size),
            int((points[i, 2] - origin[2]) / size),
        )
        result[i] = values[find_slot(table_key, table_slot, key)]
    return result
