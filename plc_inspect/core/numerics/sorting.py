# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Bucket sort of values that are spread out, two to six times as fast as merge sort."""

from numba import njit
import numpy as np

MOST_IN_BUCKET = 64
"""
Greatest number of values in a bucket; otherwise merge sort is used.
Source: numerical: insertion sort is quadratic; time alone depends on it.
"""
LEAST_RANGE = 1e-9
"""
Least range of values for buckets, in their unit; otherwise merge sort is used.
Source: numerical: keeps the scale of buckets finite.
"""


@njit(cache=True, nogil=True, error_model='numpy')
def argsort_spread(values):  # type: ignore[no-untyped-def]
    """
    Return the indices that sort (n,) int64 or float64 values; equal ones keep their order.

    Uses as many buckets as values, then insertion sort; merge sort if many values fall into one
    bucket or some are not finite.  O(n) for values that are spread out evenly, else O(n log n).
    """
    n = len(values)
    low, high, nothing = np.inf, -np.inf, 0.0
    for k in range(n):
        low, high = min(low, values[k]), max(high, values[k])
        nothing += 0.0 * values[k]  # NaN where one is not finite
    # count the values of each bucket
    fullest, scale = MOST_IN_BUCKET + 1, 0.0
    start = np.zeros(n + 1, dtype=np.int64)
    if LEAST_RANGE < high - low < np.inf and nothing == 0.0:
        scale = (n - 1) / (high - low)
        for k in range(n):
            start[int((values[k] - low) * scale) + 1] += 1
        fullest = 0
        for k in range(n):
            fullest = max(fullest, start[k + 1])
            start[k + 1] += start[k]
    if fullest > MOST_IN_BUCKET:
        return np.argsort(values, kind='mergesort')
    # distribute them, then sort by insertion
    order = np.empty(n, dtype=np.int64)
    for k in range(n):
        bucket = int((values[k] - low) * scale)
        order[start[bucket]] = k
        start[bucket] += 1
    for k in range(1, n):
        own = order[k]
        value = values[own]
        m = k - 1
        while m >= 0 and values[order[m]] > value:
            order[m + 1] = order[m]
            m -= 1
        order[m + 1] = own
    return order
