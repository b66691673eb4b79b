# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Clusterers of the plane, one beside the other."""

from numba import njit
import numpy as np

from plc_inspect.core.clustering.dbscan import dbscan_plane
from plc_inspect.core.clustering.rnn_dbscan import find_neighbors, rnn_dbscan_plane
from plc_inspect.results import Float64, Int64

KERNELS = {'dbscan': 0, 'rnn_dbscan': 1}
"""Methods that `label_plane` knows by a number.  Source: numerical: numbers of the kernels."""
LEAST_NEIGHBORS = 4
"""However sparse a window is, fewer neighbours make no core.  Source: judgement; not measured."""


@njit(cache=True, nogil=True)
def label_plane(method, u, v, eps, min_points, attempt):  # type: ignore[no-untyped-def]
    """
    Cluster points of a plane with one of KERNELS, finer with every attempt.

    Parameters
    ----------
    method : int
        Of KERNELS.
    u, v : (n,) float64
        Points [m].
    eps : float
        Radius of DBSCAN in attempt 0, halved with each one [m].
    min_points : int
        Points of a core neighbourhood of DBSCAN, the point included; k of RNN-DBSCAN in
        attempt 0, halved with each one.
    attempt : int
        From 0.

    Returns
    -------
    (n,) int64
        Cluster of each point, -1 noise.

    """
    if method == 1:
        return rnn_dbscan_plane(u, v, max(min_points >> attempt, LEAST_NEIGHBORS))
    return dbscan_plane(u, v, eps / 2**attempt, min_points)


def hdbscan_plane(u: Float64, v: Float64, min_points: int, attempt: int) -> Int64:
    """
    Cluster points of a plane with HDBSCAN (scikit-learn; Campello et al. 2013).

    ``min_points`` is its least cluster and its core neighbourhood, halved with each attempt;
    after attempt 0 the leaves of its tree are the clusters.  See `label_plane`.
    """
    from sklearn.cluster import HDBSCAN  # takes half a second that others need not wait for

    least = max(min_points >> attempt, LEAST_NEIGHBORS)
    if len(u) < least:
        return np.full(len(u), -1, dtype=np.int64)
    tree = HDBSCAN(
        min_cluster_size=least, min_samples=least, allow_single_cluster=True,
        cluster_selection_method='leaf' if attempt else 'eom', copy=True,
    )
    label: Int64 = tree.fit_predict(np.column_stack((u, v))).astype(np.int64)
    return label


def cluster_plane(
    method: str, u: Float64, v: Float64, eps: float, min_points: int, attempt: int
) -> Int64:
    """Cluster points of a plane with the method of that name; see `label_plane`."""
    if method in KERNELS:
        label: Int64 = label_plane(KERNELS[method], u, v, eps, min_points, attempt)
        return label
    return hdbscan_plane(u, v, min_points, attempt)


def count_neighbors(
    method: str, u: Float64, v: Float64, point: int, eps: float, min_points: int, attempt: int
) -> tuple[int, int]:
    """
    Return what makes a point core, and how much of it that takes.

    Parameters
    ----------
    method : str
        Name of the clusterer.
    u, v : (n,) float64
        Points [m].
    point : int
        Which of them.
    eps, min_points, attempt : float, int, int
        As for `label_plane`.

    Returns
    -------
    tuple[int, int]
        With DBSCAN the points within eps, the point included; with RNN-DBSCAN the points that have
        it among their nearest; 0 and 0 with HDBSCAN, which has no such limit.

    """
    if method == 'dbscan':
        near = (u - u[point]) ** 2 + (v - v[point]) ** 2 <= (eps / 2**attempt) ** 2
        return int(near.sum()), min_points
    k = max(min_points >> attempt, LEAST_NEIGHBORS)
    if method == 'rnn_dbscan' and k < len(u):
        return int((find_neighbors(u, v, k)[0] == point).sum()), k
    return 0, 0
