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

"""Decisions: the stage that settled each point."""

from numba import njit, prange
import numpy as np

from plc_inspect.core.alignment import AlignmentResult
from plc_inspect.core.clustering import ClusteringResult
from plc_inspect.core.height import HeightResult
from plc_inspect.core.linearity import LinearityResult
from plc_inspect.core.outliers import OutlierResult
from plc_inspect.core.voxels import hash_key, pack
from plc_inspect.results import Decision, Float64, Int64, UInt8

GROUND_BAND = 0.5
"""Points this near to the ground surface are ground [m]."""


def decide(
    points: Float64,
    height: HeightResult,
    high: Int64,
    candidates: LinearityResult,
    outliers: OutlierResult,
    alignment: AlignmentResult,
    clustering: ClusteringResult,
) -> UInt8:
    """
    Decide which stage dropped each point; wires and supports come on top of it.

    A high point shares the fate of the best candidate in its cell of a metre.

    Returns
    -------
    (N,) uint8
        Decision of each point.

    """
    decision = np.full(len(points), Decision.TOO_LOW, dtype=np.uint8)
    decision[height.height < GROUND_BAND] = Decision.GROUND
    if height.num_not_finite:
        decision[~np.isfinite(points).all(axis=1)] = Decision.NOT_FINITE
    state = np.full(len(candidates.position), Decision.OUTLIER, dtype=np.uint8)
    state[np.flatnonzero(outliers.keep)] = np.where(
        alignment.voted, Decision.NO_CLUSTER, Decision.NO_SECTION
    )
    if len(high):
        origin = np.floor(points[high].min(axis=0)) - 1.0
        decision[high] = _point_states(
            points, high, origin, candidates.position, state, np.uint8(Decision.NOT_LINEAR)
        )
    decision[clustering.beads.points] = Decision.NO_CATENARY
    return decision


@njit(cache=True, parallel=True, nogil=True)
def _point_states(points, high, origin, position, state, nothing):  # type: ignore[no-untyped-def]
    """Greatest state of the candidates in the 1 m cell of each high point."""
    size = 16
    while size < 2 * len(position) + 2:
        size *= 2
    keys = np.full(size, -1, dtype=np.int64)
    values = np.zeros(size, dtype=np.uint8)
    for k in range(len(position)):
        key = pack(
            int(position[k, 0] - origin[0]),
            int(position[k, 1] - origin[1]),
            int(position[k, 2] - origin[2]),
        )
        place = hash_key(key, size - 1)
        while keys[place] >= 0 and keys[place] != key:
            place = (place + 1) & (size - 1)
        keys[place] = key
        values[place] = max(values[place], state[k])
    result = np.full(len(high), nothing, dtype=np.uint8)
    for k in prange(len(high)):
        i = high[k]
        key = pack(
            int(points[i, 0] - origin[0]),
            int(points[i, 1] - origin[1]),
            int(points[i, 2] - origin[2]),
        )
        place = hash_key(key, size - 1)
        while keys[place] >= 0:
            if keys[place] == key:
                result[k] = values[place]
                break
            place = (place + 1) & (size - 1)
    return result
