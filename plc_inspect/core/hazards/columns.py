# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Bare columns that stand at a conductor, and few points that lie on one straight line.

These are poles that no span was found to hang on, their stays, and service drops.

A column is what is thin in plan over metres of its height, with nothing about it; a crown is
wider.  Only what stands as high as a conductor that passes it closely is a pole of the line, so a
mast away from the line, or a trunk whose crown is above it, is left to the rules.
"""

from collections.abc import Sequence
import math

import numpy as np

from plc_inspect.core.hazards.wires import find_lines
from plc_inspect.core.numerics.grouping import group_cells
from plc_inspect.core.spans.span_model import SpanModel
from plc_inspect.results import Bool, Float64, Int64

CELL = 0.3
"""
Edge of the plan cells; three by three hold a pole [m].
Source: derived: poles are up to 0.5 m thick, and scatter by 0.1 m.
"""
LAYER = 0.5
"""Height of the layers that are looked at one by one [m].  Source: judgement; not measured."""
BARE = 0.25
"""
Points about a column at most, in the ring of cells around it, as a share of its own in a layer.
Source: judgement; as wires.CLUTTER.
"""
LEAST_EXTENT = 3.0
"""
Height over which a column is bare at least [m].
Source: chosen on bench/hazards.py; the tip of a crown is thin over a metre.
"""
FILLED = 0.6
"""Share of the layers of a column that hold points at least.  Source: judgement."""
LEAST_POINTS = 10
"""Points of a column at least.  Source: judgement; fewer may lie above each other by chance."""
WIDEST = 1.2
"""
Extent in plan of a column at most, with its lean [m].
Source: judgement; as line_parts.POLE_WIDTH.
"""
THICK = 0.6
"""
Least width of a column at most [m].
Source: chosen on bench/hazards.py: 0.5 of poles, 0.7 and more of what was taken for one in crowns.
"""
WIDTH_OF_SIGMA = 4.0
"""
Width of what stands evenly, in standard deviations of its points' places.
Source: derived: 3.46 for a strip, 4 for a disc.
"""
OVERLAP = 2.0
"""
Height within which bare layers are of one column [m].
Source: judgement; what hangs on a pole interrupts it for a metre.
"""
BESIDE = 2.5
"""
Distance in plan from a conductor at which its pole stands at most [m].
Source: judgement; as line_parts.JUMPER_REACH, arms of medium voltage are 1 to 2.5 m.
"""
BELOW = 1.5
"""
How far below the conductor a column may end, or stop being bare [m].
Source: judgement; insulators and arms hide the top of a pole.
"""
AXIS = 0.6
"""
Distance in plan from the middle of a column within which points are of it [m].
Source: derived: half of WIDEST.
"""
END_ROOM = 8.0
"""
Distance along a span from its end within which a column holds the conductor [m].
Source: judgement; as line_parts.JUMPER_ROOM.
"""
FARTHEST = 6.0
"""Distance from a conductor beyond which no column is looked for [m].  Source: judgement."""
APART = 1.5
"""
Edge of the cells that touch within what is not by itself [m].
Source: derived: scan lines of sparse surveys lie up to 1.5 m apart.
"""
LEAST_SLENDER, LEAST_DROP = 3, 5
"""
Points on a straight line at least, to be no foliage, and to be of the line whose end it leads to.
Source: derived: three of a crown lie so once in fifty times, five once in 10^5.
"""
HANGS_ON = 1.5
"""
Distance from an end of a conductor at which a drop or stay that hangs there points past it [m].
Source: judgement; the arm of a low-voltage pole is 1.5 m long.
"""


def find_columns(
    points: Float64, distance: Float64, owner: Int64, models: Sequence[SpanModel]
) -> tuple[Bool, Bool]:
    """
    Tell the points of bare columns that reach up to a conductor beside them.

    Parameters
    ----------
    points : (K, 3) float64
        Off the ground, neither wire nor support [m].
    distance : (K,) float64
        To the nearest conductor [m].
    owner : (K,) int64
        Which that is.
    models : sequence of SpanModel
        Spans with their curves.

    Returns
    -------
    held, lone : (K,) bool
        Those near an end of a conductor, which they hold, and those elsewhere.

    """
    held, lone = np.zeros((2, len(points)), dtype=bool)
    near = np.flatnonzero(distance < FARTHEST)
    from_end, beside, above = np.empty((3, len(near)))
    for number in np.unique(owner[near]).tolist():
        mine, model = np.flatnonzero(owner[near] == number), models[number]
        x, beside[mine], above[mine] = model.part(points[near[mine]])
        from_end[mine] = np.minimum(x - model.low, model.high - x)
    chosen = beside < BESIDE + 3.0 * CELL
    near = near[chosen]
    from_end, beside, above = (own[chosen] for own in (from_end, beside, above))
    if len(near) < LEAST_POINTS:
        return held, lone
    voxel, count = _count_voxels(points[near])
    bare = _find_bare(voxel, count)
    voxel, count = voxel[bare], count[bare]
    if not len(voxel):
        return held, lone
    column = group_cells(voxel * np.array([CELL, CELL, LAYER]), np.array([CELL, CELL, OVERLAP]))
    order = np.argsort(column, kind='stable')
    plan = points[near, :2]
    for own in np.split(order, np.flatnonzero(np.diff(column[order])) + 1):
        if len(own) * LAYER < FILLED * LEAST_EXTENT:
            continue
        low, high = voxel[own].min(axis=0), voxel[own].max(axis=0) + 1
        layers = high[2] - low[2]
        if (
            layers * LAYER < LEAST_EXTENT or ((high - low)[:2] * CELL > WIDEST).any()
            or len(np.unique(voxel[own, 2])) < FILLED * layers or count[own].sum() < LEAST_POINTS
        ):
            continue
        middle = np.average((voxel[own, :2] + 0.5) * CELL, axis=0, weights=count[own])
        within = np.hypot(*(plan - middle).T) <= AXIS
        bottom, top = low[2] * LAYER, high[2] * LAYER
        within &= points[near, 2] >= bottom
        if not within.any() or beside[within].min() > BESIDE:
            continue
        if _measure_width(plan[within & (points[near, 2] <= top)]) > THICK:
            continue
        # how far the conductor is above the top of the bare part
        rise = np.median(points[near[within], 2] + above[within]) - top
        if rise <= BELOW:
            at_end = float(np.median(from_end[within])) <= END_ROOM
            (held if at_end else lone)[near[within]] = True
    return held, lone


def find_straight(
    points: Float64, owner: Int64, models: Sequence[SpanModel]
) -> tuple[Bool, Bool]:
    """
    Tell the points of what lies by itself on one straight line: poles, stays and service drops.

    Parameters
    ----------
    points : (K, 3) float64
        Near conductors, of no wire [m].
    owner : (K,) int64
        The nearest conductor of each.
    models : sequence of SpanModel
        Spans with their curves.

    Returns
    -------
    held, lone : (K,) bool
        Those that lead past an end of a conductor and hang there, and the others.

    """
    held, lone = np.zeros((2, len(points)), dtype=bool)
    thing = group_cells(points, np.full(3, APART))
    for number in np.flatnonzero(find_lines(points, thing, LEAST_SLENDER)).tolist():
        own = np.flatnonzero(thing == number)
        at_end = len(own) >= LEAST_DROP and _lead_to_end(
            points[own], [models[k] for k in np.unique(owner[own])])
        (held if at_end else lone)[own] = True
    return held, lone


def _lead_to_end(line: Float64, models: Sequence[SpanModel]) -> bool:
    """Tell whether (J, 3) points on a line lead past an end of a conductor."""
    middle = line.mean(axis=0)
    along = np.linalg.svd(line - middle, full_matrices=False)[2][0]
    ends = np.array([end for model in models for end in (model.span.start, model.span.end)])
    beside = np.linalg.norm(np.cross(ends - middle, along), axis=1)
    nearest = np.abs((line[:, None] - ends) @ along).min(axis=0)
    return bool(((beside <= HANGS_ON) & (nearest <= END_ROOM)).any())


def _measure_width(plan: Float64) -> float:
    """Return the least width of (J, 2) places [m], inf of less than three."""
    if len(plan) < 3:
        return math.inf
    return WIDTH_OF_SIGMA * math.sqrt(max(float(np.linalg.eigvalsh(np.cov(plan.T))[0]), 0.0))


def _count_voxels(points: Float64) -> tuple[Int64, Int64]:
    """Return the (V, 3) voxels that hold points, in order, and how many each holds (V,)."""
    cell = np.floor(points / np.array([CELL, CELL, LAYER])).astype(np.int64)
    corner = cell.min(axis=0)
    size = cell.max(axis=0) + 1 - corner
    key, count = np.unique(
        (cell - corner) @ np.array([size[1] * size[2], size[2], 1]), return_counts=True
    )
    voxel = np.column_stack(np.unravel_index(key, tuple(size.tolist()))) + corner
    return voxel, count


def _find_bare(voxel: Int64, count: Int64) -> Bool:
    """Tell the voxels about which, with those that touch them in plan, hardly anything is."""
    corner = voxel.min(axis=0) - 2
    size = voxel.max(axis=0) + 3 - corner
    steps = np.array([size[1] * size[2], size[2], 1])
    key = (voxel - corner) @ steps  # ascending as the voxels are
    own, about = np.zeros(len(key)), np.zeros(len(key))
    for x in range(-2, 3):
        for y in range(-2, 3):
            wanted = key + x * steps[0] + y * steps[1]
            at = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
            there = np.where(key[at] == wanted, count[at], 0)
            if max(abs(x), abs(y)) <= 1:
                own += there
            else:
                about += there
    bare: Bool = about <= BARE * own
    return bare
