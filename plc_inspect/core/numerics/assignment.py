# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""One-to-one assignment at the least total cost: rows to columns, or items among themselves."""

import math

import numpy as np

from plc_inspect.core.numerics.disjoint_sets import unite
from plc_inspect.results import Float64, Int64

FAR = 1e6
"""
Cost of a pair that is not allowed.
Source: numerical: more than all allowed pairs together, which cost metres.
"""


def assign(cost: Float64, most: float = math.inf) -> list[tuple[int, int]]:
    """
    Pair as many rows and columns as possible, at the least total cost.

    Parameters
    ----------
    cost : (M, N) float64
        Cost of each pair, far below FAR; inf where a pair is not allowed.
    most : float
        Greatest cost of an allowed pair.

    Returns
    -------
    list of tuple
        Row and column of each pair, in order of rows.

    """
    possible = np.isfinite(cost) & (cost <= most)
    rows, columns = (np.flatnonzero(possible.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return []
    within = np.where(possible, cost, FAR)[np.ix_(rows, columns)]
    cheapest = within.argmin(axis=1)
    if len(np.unique(cheapest)) == len(rows):  # the cheapest columns are all different
        first, second = np.arange(len(rows)), cheapest
    else:
        # Imported here, as it takes longer than a tick: the warm-up imports it.
        from scipy.optimize import linear_sum_assignment

        first, second = linear_sum_assignment(within)
    pairs = zip(rows[first].tolist(), columns[second].tolist(), strict=True)
    return [(i, j) for i, j in pairs if possible[i, j]]


def pair_up(pairs: Int64, cost: Float64, lone: float) -> list[int]:
    """
    Choose pairs of items of one kind, each item at most once, at the least total cost.

    Parameters
    ----------
    pairs : (P, 2) int64
        Items of each allowed pair, in order of cost.
    cost : (P,) float64
        Cost of each pair, not negative.
    lone : float
        Cost of leaving two items unpaired.  More costly pairs are made of the items left over, the
        cheapest first, and so are all pairs of items that cannot be divided into two sides, one
        item of each pair on each.

    Returns
    -------
    list of int
        Indices of the chosen pairs, in order of cost.

    """
    if not len(pairs):
        return []
    things, number = np.unique(pairs, return_inverse=True)
    number = number.reshape(-1, 2)
    chosen = [
        k for own in _group(number, len(things)) for k in _match(own, number[own], cost[own], lone)
    ]
    used = set(number[chosen].ravel().tolist())
    for k, both in enumerate(number.tolist()):
        if not used & set(both):
            used |= set(both)
            chosen.append(k)
    return sorted(chosen)


def _group(number: Int64, num: int) -> list[Int64]:
    """Return the pairs of each group of connected items."""
    group = unite(number, num)[number[:, 0]]
    return [np.flatnonzero(group == one) for one in np.unique(group)]


def _match(own: Int64, number: Int64, cost: Float64, lone: float) -> list[int]:
    """Choose pairs of a group that cost less than two lone items."""
    ahead = _part(number.tolist())
    if ahead is None:
        return []
    things = np.unique(number).tolist()
    rows = {thing: k for k, thing in enumerate(thing for thing in things if thing in ahead)}
    columns = {thing: k for k, thing in enumerate(thing for thing in things if thing not in ahead)}
    gain = np.zeros((len(rows), len(columns)))
    pair = np.full(gain.shape, -1)
    for k, (first, second), value in zip(
        own.tolist(), number.tolist(), cost.tolist(), strict=True
    ):
        row, column = (first, second) if first in ahead else (second, first)
        if value < lone:
            gain[rows[row], columns[column]] = lone - value
            pair[rows[row], columns[column]] = k
    return [int(pair[both]) for both in assign(-gain) if pair[both] >= 0]


def _part(pairs: list[list[int]]) -> set[int] | None:
    """Return one side of a group, so that each pair has one item on it; None if impossible."""
    side = {pairs[0][0]: True}
    before = 0
    while len(side) > before:
        before = len(side)
        for first, second in pairs:
            if first in side:
                side.setdefault(second, not side[first])
            elif second in side:
                side[first] = not side[second]
    if any(side[first] == side[second] for first, second in pairs):
        return None
    return {thing for thing, value in side.items() if value}
