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

NOT_FINITE = np.uint8(Decision.NOT_FINITE)
GROUND = np.uint8(Decision.GROUND)
TOO_LOW = np.uint8(Decision.TOO_LOW)
NOT_LINEAR = np.uint8(Decision.NOT_LINEAR)
"""Decisions as the kernels know them."""
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
    decision: UInt8 = _settle_heights(points, height.height)
    state = np.full(len(candidates.position), Decision.OUTLIER, dtype=np.uint8)
    state[np.flatnonzero(outliers.keep)] = np.where(
        alignment.voted, Decision.NO_CLUSTER, Decision.NO_SECTION
    )
    if len(high):
        _settle_high(points, high, candidates.position, state, decision)
    decision[clustering.beads.points] = Decision.NO_CATENARY
    return decision


@njit(cache=True, parallel=True, nogil=True)
def _settle_heights(points, height):  # type: ignore[no-untyped-def]
    """Decision of each point by its height alone; high ones are settled after."""
    result = np.empty(len(height), dtype=np.uint8)
    for i in prange(len(height)):
        if height[i] < GROUND_BAND:
            result[i] = GROUND
        elif np.isfinite(points[i, 0] + points[i, 1] + points[i, 2]):
            result[i] = TOO_LOW
        else:
            result[i] = NOT_FINITE
    return result


@njit(cache=True, parallel=True, nogil=True)
def _settle_high(points, high, position, state, decision):  # type: ignore[no-untyped-def]
    """Put the greatest state of the candidates in its 1 m cell into each high point's decision."""
    origin = np.full(3, np.inf)
    for i in high:
        for k in range(3):
            origin[k] = min(origin[k], points[i, k])
    origin = np.floor(origin) - 1.0
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
    for k in prange(len(high)):
        i = high[k]
        key = pack(
            int(points[i, 0] - origin[0]),
            int(points[i, 1] - origin[1]),
            int(points[i, 2] - origin[2]),
        )
        decision[i] = NOT_LINEAR
        place = hash_key(key, size - 1)
        while keys[place] >= 0:
            if keys[place] == key:
                decision[i] = values[place]
                break
            place = (place + 1) & (size - 1)
