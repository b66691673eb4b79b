# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tells points of roofs and walls, and of what is slender, from those of foliage."""

import numpy as np

from plc_inspect.core.extraction.linearity import find_lowest, measure_likeness
from plc_inspect.core.numerics.arrays import take_rows
from plc_inspect.core.numerics.plan_index import build_plan_index
from plc_inspect.core.numerics.voxels import build_voxels, find_voxels
from plc_inspect.results import Bool, Float64

PLANAR = 0.45
"""
Planar likeness of a surface at least; below, it is foliage.
Source: judgement; not measured.
"""
SPHERICAL = 0.08
"""Spherical likeness of a surface at most.  Source: judgement; not measured."""
LINEAR = 0.6
"""
Linear likeness of what is slender at least: wires, poles, bars of towers.
Source: chosen on bench/studies/planted_hazards.py: 0.8 of the points of towers, 0.2 of crowns.
"""
MIN_POINTS = 5
"""Points of a neighbourhood that can be a surface, at least.  Source: judgement; not measured."""
SIZE = 0.5
"""Edge of the voxels, of which a neighbourhood is 27 [m].  Source: judgement; not measured."""
CELL = 2.0
"""
Edge of the plan cells that points are ordered by [m].
Source: numerical: time and the order of sums depend on it.
"""
MARGIN = 2.0
"""
Distance from the origin of the voxels to the lowest point [m].
Source: numerical: any that leaves a voxel free.
"""


def tell_shapes(points: Float64) -> tuple[Bool, Bool]:
    """
    Tell points of surfaces and of slender things from foliage by the likeness around them.

    Parameters
    ----------
    points : (N, 3) float64
        Finite positions [m].

    Returns
    -------
    surface, slender : (N,) bool
        Of roofs and walls; of wires, poles and bars.

    """
    if not len(points):
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    everything = np.arange(len(points))
    order = build_plan_index(points, everything, CELL).order
    own = take_rows(points, order)  # neighbours in space are neighbours in memory
    # at multiples of their edge, so that a part of a cloud has the voxels of the whole
    origin = np.floor((find_lowest(own, everything) - MARGIN) / SIZE) * SIZE
    voxels = build_voxels(own, everything, origin, SIZE)
    likeness = measure_likeness(voxels)
    enough = likeness.count >= MIN_POINTS
    flat = enough & (likeness.planar >= PLANAR) & (likeness.spherical <= SPHERICAL)
    surface, slender = np.empty((2, len(points)), dtype=bool)
    voxel = find_voxels(own, everything, voxels)
    surface[order], slender[order] = flat[voxel], (enough & (likeness.linear >= LINEAR))[voxel]
    return surface, slender


def is_surface(points: Float64) -> Bool:
    """Tell which (N,) points are of roofs and walls, as `tell_shapes` does."""
    return tell_shapes(points)[0]
