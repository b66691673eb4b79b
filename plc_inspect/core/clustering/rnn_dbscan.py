# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""RNN-DBSCAN in the plane."""

from numba import njit
import numpy as np


@njit(cache=True, nogil=True)
def rnn_dbscan_plane(u, v, k):  # type: ignore[no-untyped-def]
    """
    RNN-DBSCAN (Bryant and Cios 2018) of n points in the plane; -1 is noise.

    A point is core if at least k points have it among their k nearest neighbours.  A cluster
    grows from a core point over its k nearest neighbours, and over the core points that have it
    among theirs.  A point that no cluster reached joins that of its nearest core neighbour among
    the k, if it is no farther than the farthest two core neighbours of that cluster are apart.
    Neighbours at one distance are taken in their order.  O(n log n + points within the k-th
    distance in u), clusters numbered by their first core point.

    Parameters
    ----------
    u, v : (n,) float64
        Coordinates [m].
    k : int
        Neighbours, the point itself not counted.

    Returns
    -------
    (n,) int64

    """
    n = len(u)
    label = np.full(n, -1, dtype=np.int64)
    if n <= k:
        return label
    near, apart = find_neighbors(u, v, k)
    start = np.zeros(n + 1, dtype=np.int64)
    for i in range(n):
        for m in range(k):
            start[near[i, m] + 1] += 1
    core = start[1:] >= k
    start = np.cumsum(start)
    reverse = np.empty(n * k, dtype=np.int64)
    place = start[:-1].copy()
    for i in range(n):
        for m in range(k):
            reverse[place[near[i, m]]] = i
            place[near[i, m]] += 1
    stack = np.empty(n, dtype=np.int64)
    num_clusters = 0
    for first in range(n):
        if label[first] >= 0 or not core[first]:
            continue
        label[first] = num_clusters
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            i = stack[top]
            for m in range(k):
                j = near[i, m]
                if label[j] < 0:
                    label[j] = num_clusters
                    if core[j]:
                        stack[top] = j
                        top += 1
            for m in range(start[i], start[i + 1]):
                j = reverse[m]
                if core[j] and label[j] < 0:
                    label[j] = num_clusters
                    stack[top] = j
                    top += 1
        num_clusters += 1
    widest = np.zeros(num_clusters)  # squared distance of core neighbours in each cluster
    for i in range(n):
        for m in range(k):
            if core[i] and core[near[i, m]]:
                widest[label[i]] = max(widest[label[i]], apart[i, m])
    result = label.copy()
    for i in range(n):
        if label[i] < 0:
            for m in range(k):  # the nearest first
                j = near[i, m]
                if core[j] and apart[i, m] <= widest[label[j]]:
                    result[i] = label[j]
                    break
    return result


@njit(cache=True, nogil=True)
def find_neighbors(u, v, k):  # type: ignore[no-untyped-def]
    """Return the k nearest other points of each, nearest first, and squared distances; (n, k)."""
    n = len(u)
    order = np.argsort(u)
    a, b = u[order], v[order]
    near = np.empty((n, k), dtype=np.int64)
    apart = np.full((n, k), np.inf)
    for p in range(n):
        own = order[p]
        down, up = p - 1, p + 1
        while down >= 0 or up < n:
            below = a[p] - a[down] if down >= 0 else np.inf
            above = a[up] - a[p] if up < n else np.inf
            gap = min(below, above)
            if gap * gap > apart[own, k - 1]:
                break
            if below <= above:
                q = down
                down -= 1
            else:
                q = up
                up += 1
            distance = (a[q] - a[p]) ** 2 + (b[q] - b[p]) ** 2
            m = k
            while m > 0 and (distance < apart[own, m - 1] or (
                distance == apart[own, m - 1] and order[q] < near[own, m - 1]
            )):
                m -= 1
                if m + 1 < k:
                    apart[own, m + 1], near[own, m + 1] = apart[own, m], near[own, m]
            if m < k:
                apart[own, m], near[own, m] = distance, order[q]
    return near, apart
