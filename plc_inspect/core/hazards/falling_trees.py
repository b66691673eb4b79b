# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Finds trees that would come too close to a conductor if they fell."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any

from numba import njit, prange
import numpy as np

from plc_inspect.config import HazardSettings
from plc_inspect.core.catenary.nearest_span import find_near
from plc_inspect.core.hazards.breaches import judge_value
from plc_inspect.core.hazards.clearance_rules import RuleSet
from plc_inspect.core.hazards.columns import LEAST_SLENDER, THICK
from plc_inspect.core.hazards.encroachments import describe_hazard, is_held, ROOM
from plc_inspect.core.hazards.line_parts import POLE_WIDTH
from plc_inspect.core.hazards.low_conductors import ROUGH_SIGMA
from plc_inspect.core.hazards.strands import measure_distances
from plc_inspect.core.hazards.trees import segment_trees
from plc_inspect.core.hazards.wires import find_lines, FREE_LENGTH
from plc_inspect.core.numerics.grouping import group_cells
from plc_inspect.core.spans.point_claims import FREE_RADIUS
from plc_inspect.core.spans.span_model import SpanModel, tabulate
from plc_inspect.core.spans.spans import SpanResult
from plc_inspect.results import Bool, Float32, Float64, HazardKind, Int64, Support

FALL_REACH = 50.0
"""
Distance from the conductors within which points may be of a tree that falls on one [m].
Source: judgement; not measured.
"""
TREE_HEIGHT = 2.0
"""
Height above ground up to which points belong to no tree that can fall on a conductor [m].
Source: judgement; not measured.
"""
TREE_SIGMA = 0.15
"""
Standard deviation of the height of a tree above its foot [m].
Source: judgement; not measured.
"""
SURE_GROUND = 0.05
"""
Standard deviation of the ground below a tree at most, where it was seen [m].
Source: judgement; as low_conductors.GROUND_SIGMA.
"""
TALLEST = 60.0
"""
Added to FALL_REACH for the feet of trees, which lie this far below their tops at most [m].
Source: judgement; not measured.
"""
MOST_FLAT = 0.5
"""
What has more than this share of its points on surfaces is no tree.
Source: derived: the majority.
"""

TOUCH = 1.0
"""
Edge of the cells that touch within one thing: wires hang farther above crowns [m].
Source: judgement; as encroachments.TREE_LINK.
"""
HANGS = 3.0
"""
Empty height below a few points beyond which they hang above a tree, and are not of it [m].
Source: judgement; wires hang above crowns by the clearance that they need.
"""
FEW = 0.1
"""Share of the points of a tree that may hang above it at most.  Source: judgement."""
STANDING, FEW_STANDING = 0.1, 0.25
"""
Extent in height, in the height above ground, of what stands at least, and of few points: less is
a piece of wire or of an arm.
Source: chosen on bench/studies/planted_hazards.py: crowns have 0.4 of their trees' height and
more, one that was seen in part had 0.14.
"""
HELD = 0.95
"""
Share of the points of a tree at the end of a span from which on it is of the support; so it is
where those that are not at conductors have it.
Source: judgement; one of 35 on a pole's head lay beyond, where a service drop begins (random scene
272016, planted); five of 60, on wires, where drift doubled a pole (289004).
"""
FEW_POINTS = 10
"""Points fewer than which show no crown.  Source: judgement; not measured."""
MOST_SLENDER = 0.5
"""
What has more than this share of its points on slender things, at an end of a span, is of its
support.
Source: derived: the majority.
"""
LATTICE, LATTICE_POINTS = 0.7, 100
"""
Share of points on slender things, of so many, above which what is wider than a pole is a lattice:
a tower of another line, a crane.
Source: measured: 0.8 in towers of bench/studies/planted_hazards.py; at most 0.59 in 700 trees of
the forests of test_real_clouds, 0.45 in planted ones.
"""
ARM = 12.0
"""
Distance across from a conductor within which its tower stands, and the arms of that [m].
Source: judgement; the widest towers of one level are 20 to 25 m wide.
"""
WIDTH_OF_SIGMA = 4.0
"""
Width of what stands or hangs evenly, in standard deviations of its points' places.
Source: derived: 3.46 for a strip, 4 for a disc.
"""

FindGround = Callable[[Float64], tuple[Float64, Float64]]
"""Returns the height and the standard deviation of the ground at (P, 3) places [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fallible:
    """K points that may belong to trees which could fall on a conductor."""

    points: Float64
    """(K, 3) off the ground, neither wire nor support [m]."""
    height: Float64
    """(K,) above local ground [m]."""
    surface: Bool
    """(K,) points of roofs and walls."""
    slender: Bool
    """(K,) points of wires, poles and bars."""

    def take(self, chosen: Bool) -> 'Fallible':
        """Return some of the points."""
        return Fallible(points=self.points[chosen], height=self.height[chosen],
                        surface=self.surface[chosen], slender=self.slender[chosen])


def find_fallible(points: Float64, height: Float32, spans: SpanResult) -> Int64:
    """
    Find the points that may belong to a tree which could fall on a conductor.

    Parameters
    ----------
    points : (N, 3) float64
        Positions [m].
    height : (N,) float32
        Above local ground [m].
    spans : SpanResult
        Spans with their curves; points of conductors and supports do not fall.

    Returns
    -------
    (K,) int64, ascending indices

    """
    models = spans.models
    if not models:
        return np.zeros(0, dtype=np.int64)
    free = _choose_free(points, height, spans.line_id, spans.support)
    found, _, _ = find_near(points, tabulate(models), FALL_REACH)
    return found[free[found]]


def find_falling_trees(
    fallible: Fallible,
    models: Sequence[SpanModel],
    supports: Sequence[Support],
    rules: RuleSet,
    settings: HazardSettings,
    known: Sequence[dict[str, Any]],
    find_ground: FindGround | None = None,
) -> list[dict[str, Any]]:
    """
    Find trees that come too close to a conductor when they fall.

    A tree of height h, its foot at distance s from the conductor, reaches to s - h of it.

    Parameters
    ----------
    fallible : Fallible
        Points of trees, and what may be such.
    models, supports, rules, settings
        As in `encroachments.find_encroachments`.
    known : sequence
        Hazards found before; trees that are as severe by themselves are left out.
    find_ground : callable or None
        As `low_conductors.find_planes` of a cloud; by default the ground is where the heights
        say.

    Returns
    -------
    list of dict
        Values of Hazard; position and height are those of the tree's top.

    """
    limits = rules.find('fall_in')
    if not limits or not len(fallible.points) or not models:
        return []
    fallible = fallible.take(~_are_wires(fallible.points))
    tree = segment_trees(fallible.points, fallible.height)
    standing = _stand(fallible.points[:, 2], fallible.height, tree)
    if not standing.any():
        return []
    tree = np.unique(tree[standing], return_inverse=True)[1]
    fallible = fallible.take(standing)
    points, height, surface = fallible.points, fallible.height, fallible.surface
    size = np.bincount(tree)
    flat = np.bincount(tree, weights=surface.astype(np.float64))
    slender = np.bincount(tree, weights=fallible.slender.astype(np.float64)) / size
    top = np.full(len(size), -1, dtype=np.int64)
    order = np.argsort(height, kind='stable')
    top[tree[order]] = order
    feet = points[top].copy()
    feet[:, 2] -= height[top]
    table = tabulate(models)
    found, distance, owner = find_near(feet, table, FALL_REACH + TALLEST)
    gaps = measure_distances(
        feet[found], distance.astype(np.float64), owner.astype(np.int64), models,
        FALL_REACH + TALLEST,
    )
    near = gaps - height[top[found]] < max(item.reach for item in limits)
    found, gaps, owner = found[near], gaps[near], owner[near]
    sigma = np.full(len(found), TREE_SIGMA)
    if find_ground is not None and len(found):
        _, error = find_ground(feet[found])
        sigma[~(error <= SURE_GROUND)] = math.hypot(TREE_SIGMA, ROUGH_SIGMA)
    width, length = _measure_plan(points, tree)
    wire = (width <= POLE_WIDTH) & (length >= FREE_LENGTH)
    # so are, or of poles and stays, a few points on one straight line
    wire |= find_lines(points, tree, LEAST_SLENDER) & (size < FEW_POINTS)
    pole = (slender > MOST_SLENDER) | ((length <= THICK) & (size >= FEW_POINTS))
    lattice = (slender > LATTICE) & (size >= LATTICE_POINTS) & (length > POLE_WIDTH)
    taken = _find_known(points, tree, known)
    result = []
    for number, reach, span, error in zip(
        found.tolist(), gaps.tolist(), owner.tolist(), sigma.tolist(), strict=True
    ):
        tall = float(height[top[number]])
        clearance = reach - tall
        broken = judge_value(clearance, limits)
        solid = flat[number] > MOST_FLAT * size[number] or size[number] < settings.min_points
        if broken is None or solid or wire[number] or lattice[number]:
            continue
        limit, severity = broken
        if taken.get(number, 0) >= severity:
            continue
        model, own = models[span], points[tree == number]
        held = is_held(own, model, supports)
        away = np.delete(held, find_near(own, table, FREE_RADIUS)[0])  # from insulators and wires
        if held.mean() >= HELD or (len(away) and away.mean() >= HELD):
            continue
        if pole[number] and _is_at_end(points[top[number]], model):
            continue
        x, horizontal, vertical = (
            float(value[0]) for value in model.part(feet[number : number + 1])
        )
        result.append(describe_hazard(
            model, x, supports, rules, limit,
            kind=HazardKind.FALL_IN,
            severity=severity,
            position=points[top[number]].copy(),
            clearance=clearance,
            horizontal=horizontal,
            vertical=vertical,
            sigma=math.hypot(model.sigma(x), error),
            num_points=len(own),
            offending=own,
            height=tall,
            note='horizontal and vertical are from the foot, which is taken to be under the top',
        ))
    return result


def _are_wires(points: Float64) -> Bool:
    """Tell the points of what is narrow and long by itself: of conductors that were not found."""
    thing = group_cells(points, np.full(3, TOUCH))
    width, length = _measure_plan(points, thing)
    result: Bool = ((width <= POLE_WIDTH) & (length >= FREE_LENGTH))[thing]
    return result


def _stand(z: Float64, height: Float64, tree: Int64) -> Bool:
    """Tell the points that stand: all but a few that hang above a tree, or by themselves."""
    order = np.lexsort((-height, tree))  # each tree from its top down
    own, level = tree[order], height[order]
    first = np.flatnonzero(np.diff(own, prepend=-1))
    size = np.bincount(tree)
    rank = np.arange(len(own)) - first[own]
    below = np.append(level[1:], 0.0)
    hangs = (level - below > HANGS) & (rank + 1 <= FEW * size[own])
    lowest = np.full(len(size), np.inf)
    np.minimum.at(lowest, own, level)
    few = (rank + 1 < FEW_POINTS) & (level[first[own]] - level <= TOUCH)
    hangs |= few & (level - below > np.maximum(HANGS, below - lowest[own]))
    last = np.full(len(size), -1, dtype=np.int64)  # of those above the lowest such gap
    np.maximum.at(last, own[hangs], rank[hangs])
    kept = rank > last[own]
    low, high = np.full(len(size), np.inf), np.full(len(size), -np.inf)
    np.minimum.at(low, own[kept], z[order[kept]])
    np.maximum.at(high, own[kept], z[order[kept]])
    tall = np.zeros(len(size))
    np.maximum.at(tall, own[kept], level[kept])
    result = np.zeros(len(height), dtype=bool)
    share = np.where(np.bincount(own[kept], minlength=len(size)) < FEW_POINTS,
                     FEW_STANDING, STANDING)
    result[order] = kept & (high - low >= share * tall)[own]
    return result


def _is_at_end(place: Float64, model: SpanModel) -> bool:
    """Tell whether a (3,) place is where the tower at an end of a span would be."""
    x, across = (float(value[0]) for value in model.curve.local(place[None, :]))
    return min(abs(x - model.low), abs(x - model.high)) <= ROOM['tower'] and abs(across) <= ARM


def _measure_plan(points: Float64, tree: Int64) -> tuple[Float64, Float64]:
    """Return the least and the greatest width of each tree in plan [m]."""
    size = np.bincount(tree)
    x, y = (
        own - (np.bincount(tree, weights=own) / size)[tree]
        for own in (points[:, 0] - points[0, 0], points[:, 1] - points[0, 1])
    )
    xx, yy, xy = (
        np.bincount(tree, weights=product) / size for product in (x * x, y * y, x * y)
    )
    mean, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return (WIDTH_OF_SIGMA * np.sqrt(np.maximum(mean - apart, 0.0)),
            WIDTH_OF_SIGMA * np.sqrt(mean + apart))


def _find_known(
    points: Float64, tree: Int64, known: Sequence[dict[str, Any]]
) -> dict[int, int]:
    """Return the trees that are hazards by themselves, and how severe each is."""
    known = [item for item in known if item['kind'] == HazardKind.VEGETATION]
    if not known:
        return {}
    # Few rule sets need it, and its import takes longer than a tick.
    from scipy.spatial import cKDTree

    apart, nearest = cKDTree(points).query(
        np.array([item['position'] for item in known]), distance_upper_bound=TOUCH
    )
    found: dict[int, int] = {}
    for item, place in zip(known, np.where(np.isfinite(apart), nearest, -1), strict=True):
        if place >= 0:
            own = int(tree[place])
            found[own] = max(found.get(own, 0), int(item['severity']))
    return found


@njit(cache=True, parallel=True, nogil=True)
def _choose_free(points, height, line_id, support):  # type: ignore[no-untyped-def]
    """Tell points that may belong to a tree: finite, high enough, neither wire nor support."""
    result = np.zeros(len(points), dtype=np.bool_)
    for i in prange(len(points)):
        if height[i] > TREE_HEIGHT and np.isfinite(points[i, 0] + points[i, 1] + points[i, 2]):
            result[i] = line_id[i] < 0 and not support[i]
    return result
