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

"""DBSCAN in the plane."""

from numba import njit
import numpy as np


@njit(cache=True, nogil=True)
def dbscan_plane(u, v, eps, min_points):  # type: ignore[no-untyped-def]
    """
    DBSCAN (Ester et al. 1996) of n points in the plane; -1 is noise.

    Labels are those of scikit-learn's DBSCAN: clusters numbered by their first core point, a
    border point goes to the cluster that reaches it first.  O(n log n + pairs within eps in u).

    Parameters
    ----------
    u, v : (n,) float64
        See its class.
    eps : int
        Neighbours lie within this distance, inclusive.
    min_points : int
        Neighbours of a core point, itself included.

    Returns
    -------
    (n,) int64

    """
    n = len(u)
    label = np.full(n, -1, dtype=np.int64)
    order = np.argsort(u)
    rank = np.empty(n, dtype=np.int64)
    for k in range(n):
        rank[order[k]] = k
    limit = eps * eps
    core = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        a = order[k]
        count = 1
        m = k + 1
        while m < n and u[order[m]] - u[a] <= eps and count < min_points:
            dv = v[order[m]] - v[a]
            du = u[order[m]] - u[a]
            if du * du + dv * dv <= limit:
                count += 1
            m += 1
        m = k - 1
        while m >= 0 and u[a] - u[order[m]] <= eps and count < min_points:
            dv = v[order[m]] - v[a]
            du = u[order[m]] - u[a]
            if du * du + dv * dv <= limit:
                count += 1
            m -= 1
        core[a] = count >= min_points
    stack = np.empty(n, dtype=np.int64)
    cluster_number = 0
    for first in range(n):
        if label[first] >= 0 or not core[first]:
            continue
        label[first] = cluster_number
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            a = stack[top]
            if not core[a]:
                continue
            k = rank[a]
            for step in (1, -1):
                m = k + step
                while 0 <= m < n and abs(u[order[m]] - u[a]) <= eps:
                    b = order[m]
                    if label[b] < 0:
                        du, dv = u[b] - u[a], v[b] - v[a]
                        if du * du + dv * dv <= limit:
                            label[b] = cluster_number
                            stack[top] = b
                            top += 1
                    m += step
        cluster_number += 1
    return label
