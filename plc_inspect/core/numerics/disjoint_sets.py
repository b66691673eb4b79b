# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Disjoint sets: each item points to another of its set, and the root to itself."""

from numba import njit
import numpy as np
from numpy.typing import ArrayLike

from plc_inspect.results import Int32, Int64


@njit(cache=True, nogil=True)
def find_root(parent, item):  # type: ignore[no-untyped-def]
    """Return the root of an item's set, and halve the path of (N,) int parents to it."""
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


def unite(pairs: ArrayLike, num: int, apart: ArrayLike = ()) -> Int64:
    """
    Unite items by pairs, in their order, and number the sets.

    Parameters
    ----------
    pairs : (P, 2) int32
        Items that belong to one set, from 0.
    num : int
        Number of items; one without a pair is a set of its own.
    apart : (A, 2) int32
        Items that must not share a set: pairs that would unite them are skipped.

    Returns
    -------
    (num,) int64
        Set of each item, numbered from 0 in the order of their first items.

    """
    result: Int64 = _unite(_as_pairs(pairs), num, _as_pairs(apart))
    return result


def _as_pairs(items: ArrayLike) -> Int32:
    return np.ascontiguousarray(items, dtype=np.int32).reshape(-1, 2)


@njit(cache=True, nogil=True)
def _unite(pairs, num, apart):  # type: ignore[no-untyped-def]
    # unite by pairs, unless that would join what must stay apart
    parent = np.arange(num)
    for k in range(len(pairs)):
        a, b = find_root(parent, pairs[k, 0]), find_root(parent, pairs[k, 1])
        clash = False
        for m in range(len(apart)):
            c, d = find_root(parent, apart[m, 0]), find_root(parent, apart[m, 1])
            clash |= (c == a and d == b) or (c == b and d == a)
        if not clash:
            parent[max(a, b)] = min(a, b)
    # number the roots in their order; each is the first item of its set
    label = np.empty(num, dtype=np.int64)
    used = 0
    for item in range(num):
        root = find_root(parent, item)
        if root == item:
            label[item] = used
            used += 1
        else:
            label[item] = label[root]
    return label
