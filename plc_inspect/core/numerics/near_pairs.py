# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Finds all pairs of points within a distance of each other."""

from numba import njit
import numpy as np

from plc_inspect.errors import DataError
from plc_inspect.results import Float64, Int32

MAX_CELLS = 2.0**62
"""Greatest number of cells.  Source: numerical: their numbers are int64."""
SLACK = 1e-9
"""
Share by which cells are wider than the reach, so that rounding cannot put a cell between a pair.
Source: numerical: ten million roundings of a double.
"""


def find_pairs(points: Float64, reach: float) -> Int32:
    """
    Find all pairs of points within ``reach`` of each other.

    Parameters
    ----------
    points : (N, 3) float64
        Finite [m].
    reach : float
        Greatest distance, above 0 [m].

    Returns
    -------
    (P, 2) int32
        Indices of the points, the smaller first.

    Raises
    ------
    DataError
        The points lie too far apart for the reach.

    """
    if len(points) < 2:
        return np.zeros((0, 2), dtype=np.int32)
    place = np.floor((points - points.min(axis=0)) / (reach * (1.0 + SLACK))) + 1.0
    # an empty layer all around keeps the ends of rows and layers apart
    if np.prod(place.max(axis=0) + 2.0) >= MAX_CELLS:
        extent = np.ptp(points, axis=0).tolist()
        raise DataError(f'points over {extent} m lie too far apart to be paired within {reach} m')
    cell = place.astype(np.int64)
    _, rows, layers = cell.max(axis=0) + 2
    key = (cell[:, 0] * rows + cell[:, 1]) * layers + cell[:, 2]
    order = np.argsort(key, kind='stable')
    steps = np.array([0, layers, (rows - 1) * layers, rows * layers, (rows + 1) * layers])
    result: Int32 = _find_pairs(points[order], key[order], order, steps, reach)
    return result


@njit(cache=True, nogil=True)
def _find_pairs(points, key, order, steps, reach):  # type: ignore[no-untyped-def]
    """Compare each point with later ones in its own column of cells and the next four."""
    num = len(key)
    pairs = np.empty((0, 2), dtype=np.int32)
    for is_counted in (False, True):  # once to count, once to write
        first = np.zeros(len(steps), dtype=np.int64)
        used = 0
        for i in range(num):
            for side in range(len(steps)):
                low = key[i] + steps[side] - 1
                while first[side] < num and key[first[side]] < low:
                    first[side] += 1
                at = first[side] if side > 0 else i + 1
                while at < num and key[at] <= low + 2:
                    x = points[at, 0] - points[i, 0]
                    y = points[at, 1] - points[i, 1]
                    z = points[at, 2] - points[i, 2]
                    if x * x + y * y + z * z <= reach * reach:
                        if is_counted:
                            pairs[used, 0] = min(order[i], order[at])
                            pairs[used, 1] = max(order[i], order[at])
                        used += 1
                    at += 1
        if not is_counted:
            pairs = np.empty((used, 2), dtype=np.int32)
    return pairs
