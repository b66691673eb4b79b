# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Assigns rows to columns one to one, at the least total cost."""

import numpy as np

from plc_inspect.results import Float64

FAR = 1e6
"""
Cost of a pair that is not allowed.
Source: numerical: more than all allowed pairs together, which cost metres.
"""


def assign(cost: Float64, most: float) -> list[tuple[int, int]]:
    """
    Pair as many rows with columns as possible, then at the least total cost.

    Parameters
    ----------
    cost : (M, N) float64
        Cost of each pair.
    most : float
        Greatest cost of an allowed pair; far below FAR.

    Returns
    -------
    list of tuple
        Row and column of each pair, in the order of rows.

    """
    rows, columns = (np.flatnonzero((cost <= most).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return []
    within = cost[np.ix_(rows, columns)]
    within = np.where(within <= most, within, FAR)
    cheapest = within.argmin(axis=1)
    if len(np.unique(cheapest)) == len(rows):  # the cheapest columns are all different
        first, second = np.arange(len(rows)), cheapest
    else:
        # Rarely needed, and its import takes longer than a tick: the warm-up imports it.
        from scipy.optimize import linear_sum_assignment

        first, second = linear_sum_assignment(within)
    pairs = zip(rows[first].tolist(), columns[second].tolist(), strict=True)
    return [(i, j) for i, j in pairs if cost[i, j] <= most]
