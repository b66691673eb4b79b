# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What is thin and straight by itself: pieces of service drops and stays."""

import numpy as np

from plc_inspect.results import Bool, Float64, Int64

THIN = 0.12
"""
Standard deviation of the points of a wire about its line at most [m].
Source: judgement; as line_parts.THIN.
"""
LENGTH = 1.5
"""
Length at least, by the scatter of the points along it [m].
Source: judgement; twigs that reach out of a crown are of the crown.
"""
LEAST_POINTS = 10
"""Points at least.  Source: judgement; a few may lie in line by chance."""
STEEPEST = 0.7
"""
Vertical part of its direction at most.
Source: derived: 45 degrees; what stands steeper is told by columns.
"""
LENGTH_OF_SIGMA = 3.46
"""
Length of what is even, in standard deviations of its places.
Source: derived: the square root of 12.
"""


def are_straight(points: Float64, thing: Int64) -> Bool:
    """
    Tell the things that are thin and straight.

    Parameters
    ----------
    points : (K, 3) float64
        Coordinates [m].
    thing : (K,) int64
        Which of T things each point is of, from 0.

    Returns
    -------
    (T,) bool

    """
    size = np.bincount(thing)
    mean = np.column_stack([np.bincount(thing, weights=axis) for axis in points.T]) / size[:, None]
    away = points - mean[thing]
    spread = np.empty((len(size), 3, 3))
    for row in range(3):
        for column in range(3):
            product = away[:, row] * away[:, column]
            spread[:, row, column] = np.bincount(thing, weights=product) / size
    variance, axes = np.linalg.eigh(spread)
    variance = np.maximum(variance, 0.0)
    result: Bool = (
        (size >= LEAST_POINTS) & (np.sqrt(variance[:, 1]) <= THIN)
        & (LENGTH_OF_SIGMA * np.sqrt(variance[:, 2]) >= LENGTH)
        & (np.abs(axes[:, 2, 2]) <= STEEPEST)
    )
    return result
