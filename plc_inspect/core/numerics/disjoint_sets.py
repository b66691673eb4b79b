# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Disjoint sets: each item points to another of its set, and the root to itself."""

from numba import njit
import numpy as np
from numpy.typing import ArrayLike

from plc_inspect.results import Int32, Int64


@njit(cache=True, nogil=True)
def find_root(parent, item):  # type: ignore[no-untyped-def]
    """Return the root of an item's set; (N,) int parents are followed, and halved on the way."""
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


def unite(pairs: ArrayLike, num: int, apart: ArrayLike = ()) -> Int64:
    """
    Unite items by pairs, one pair after the other, and number the sets.

    Parameters
    ----------
    pairs : (P, 2) int32
        Items that belong to one set, from 0.
    num : int
        Items; one that is in no pair is a set of its own.
    apart : (A, 2) int32
        Items that never share a set: a pair that would unite two such sets is passed over.

    Returns
    -------
    (num,) int64
        Set of each item, from 0 in the order of their first items.

    """
    result: Int64 = _unite(_as_pairs(pairs), num, _as_pairs(apart))
    return result


def _as_pairs(items: ArrayLike) -> Int32:
    return np.asarray(items, dtype=np.int32).reshape(-1, 2)


@njit(cache=True, nogil=True)
def _unite(pairs, num, apart):  # type: ignore[no-untyped-def]
    parent = np.arange(num)
    for k in range(len(pairs)):
        a, b = find_root(parent, pairs[k, 0]), find_root(parent, pairs[k, 1])
        clash = False
        for m in range(len(apart)):
            c, d = find_root(parent, apart[m, 0]), find_root(parent, apart[m, 1])
            clash |= (c == a and d == b) or (c == b and d == a)
        if not clash:
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
