# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Assigns rows to columns one to one, at the least total cost."""

import math

import numpy as np

from plc_inspect.results import Float64

FAR = 1e6
"""
Cost of a pair that is not allowed.
Source: numerical: more than all allowed pairs together, which cost metres.
"""


def assign(cost: Float64, most: float = math.inf) -> list[tuple[int, int]]:
    """
    Pair as many rows with columns as possible, then at the least total cost.

    Parameters
    ----------
    cost : (M, N) float64
        Cost of each pair, far below FAR; inf where there can be none.
    most : float
        What costs more is no pair either.

    Returns
    -------
    list of tuple
        Row and column of each pair, in the order of rows.

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
        # Rarely needed, and its import takes longer than a tick: the warm-up imports it.
        from scipy.optimize import linear_sum_assignment

        first, second = linear_sum_assignment(within)
    pairs = zip(rows[first].tolist(), columns[second].tolist(), strict=True)
    return [(i, j) for i, j in pairs if possible[i, j]]
