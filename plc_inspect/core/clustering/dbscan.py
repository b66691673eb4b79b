# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""DBSCAN in the plane."""

from numba import njit
import numpy as np

from plc_inspect.core.numerics.disjoint_sets import find_root
from plc_inspect.core.numerics.sorting import argsort_spread

BLOCK = 32
"""
Points that are looked at together for neighbours.
Source: numerical: time alone depends on it.
"""


@njit(cache=True, nogil=True)
def dbscan_plane(u, v, eps, min_points):  # type: ignore[no-untyped-def]
    """
    DBSCAN (Ester et al. 1996) of n points in the plane; -1 is noise.

    Labels are those of scikit-learn's DBSCAN: clusters numbered by their first core point, a
    border point goes to the cluster that reaches it first.  O(n log n + pairs within eps in u).

    Parameters
    ----------
    u, v : (n,) float64
        Coordinates [m].
    eps : float
        Neighbours lie within this distance, inclusive [m].
    min_points : int
        Neighbours of a core point, itself included.

    Returns
    -------
    (n,) int64

    """
    n = len(u)
    order = argsort_spread(u)
    a, b = u[order], v[order]
    limit = eps * eps
    core = np.zeros(n, dtype=np.bool_)
    begin = np.empty(n, dtype=np.int64)  # the first within eps in u
    m = 0
    for k in range(n):
        while a[m] < a[k] - eps:
            m += 1
        begin[k] = m
    for k in range(n):
        count, m = 1, k + 1
        while m < n and count < min_points and a[m] - a[k] <= eps:
            count += _count_near(a[m : m + BLOCK], b[m : m + BLOCK], a[k], b[k], limit)
            m += BLOCK
        m = k
        while m > begin[k] and count < min_points:
            last, m = m, max(m - BLOCK, 0)
            count += _count_near(a[m:last], b[m:last], a[k], b[k], limit)
        core[k] = count >= min_points
    label = np.full(n, -1, dtype=np.int64)
    free = np.arange(n + 1)  # leads to the next point without a label
    stack = np.empty(n, dtype=np.int64)
    num_clusters = 0
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    for first in place:
        if label[first] >= 0 or not core[first]:
            continue
        label[first] = num_clusters
        free[first] = first + 1
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            k = stack[top]
            if not core[k]:
                continue
            m = find_root(free, begin[k])
            while m < n and a[m] - a[k] <= eps:
                if (a[m] - a[k]) ** 2 + (b[m] - b[k]) ** 2 <= limit:
                    label[m] = num_clusters
                    free[m] = m + 1
                    stack[top] = m
                    top += 1
                m = find_root(free, m + 1)
        num_clusters += 1
    result = np.empty(n, dtype=np.int64)
    for k in range(n):
        result[order[k]] = label[k]
    return result


@njit(cache=True, nogil=True)
def _count_near(a, b, a0, b0, limit):  # type: ignore[no-untyped-def]
    """How many points are within the square root of ``limit``; all are looked at, by vectors."""
    count = 0
    for m in range(len(a)):
        count += (a[m] - a0) ** 2 + (b[m] - b0) ** 2 <= limit
    return count
