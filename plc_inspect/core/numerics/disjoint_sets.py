# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Disjoint sets: each item points to another of its set, and the root to itself."""

from numba import njit
import numpy as np

from plc_inspect.results import Int32, Int64


@njit(cache=True, nogil=True)
def find_root(parent, item):  # type: ignore[no-untyped-def]
    """Return the root of an item's set; (N,) int parents are followed, and halved on the way."""
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


def unite(pairs: Int32, num: int) -> Int64:
    """
    Unite items by pairs, and number the sets.

    Parameters
    ----------
    pairs : (P, 2) int32
        Items that belong to one set, from 0.
    num : int
        Number of items; one without a pair is a set of its own.

    Returns
    -------
    (num,) int64
        Set of each item, from 0 in the order of their first items.

    """
    result: Int64 = _unite(pairs, num)
    return result


@njit(cache=True, nogil=True)
def _unite(pairs, num):  # type: ignore[no-untyped-def]
    parent = np.arange(num)
    for k in range(len(pairs)):
        a, b = find_root(parent, pairs[k, 0]), find_root(parent, pairs[k, 1])
        parent[max(a, b)] = min(a, b)
    label = np.empty(num, dtype=np.int64)
    used = 0
    for item in range(num):
        root = find_root(parent, item)
        if root == item:  # the first of its set
            label[item] = used
            used += 1
        else:
            label[item] = label[root]
    return label
