# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Tells points of roofs and walls from those of foliage."""

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


def is_surface(points: Float64) -> Bool:
    """
    Tell points of roofs and walls from foliage by the planar likeness around them.

    Parameters
    ----------
    points : (N, 3) float64
        Finite positions [m].

    Returns
    -------
    (N,) bool

    """
    if not len(points):
        return np.zeros(0, dtype=bool)
    everything = np.arange(len(points))
    order = build_plan_index(points, everything, CELL).order
    own = take_rows(points, order)  # neighbours in space are neighbours in memory
    # at multiples of their edge, so that a part of a cloud has the voxels of the whole
    origin = np.floor((find_lowest(own, everything) - MARGIN) / SIZE) * SIZE
    voxels = build_voxels(own, everything, origin, SIZE)
    likeness = measure_likeness(voxels)
    flat = likeness.count >= MIN_POINTS
    flat &= (likeness.planar >= PLANAR) & (likeness.spherical <= SPHERICAL)
    result = np.empty(len(points), dtype=bool)
    result[order] = flat[find_voxels(own, everything, voxels)]
    return result
