# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Sums over rows by the cells that they lie in."""

from numba import njit
import numpy as np

from plc_inspect.results import Float64, Int64


def pack_cells(index: Int64) -> Int64:
    """
    Return one number (N,) int64 for each cell (N, 3) int64 along x, y and z.

    Equal for equal cells, and in their order; the cells of other arrays have other numbers.
    """
    index = index - index.min(axis=0)
    size = index.max(axis=0) + 1
    result: Int64 = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    return result


def sum_rows(group: Int64, values: Float64, num: int) -> Float64:
    """
    Sum rows by group.

    Parameters
    ----------
    group : (N,) int64
        Of each row, from 0 on.
    values : (N, K) float64
        The rows.
    num : int
        Number of groups.

    Returns
    -------
    (num, K) float64

    """
    result = np.zeros((num, values.shape[1]))
    _add_rows(group, np.ascontiguousarray(values), result)
    return result


@njit(cache=True, nogil=True)
def _add_rows(group, values, result):  # type: ignore[no-untyped-def]
    for n in range(len(group)):
        for k in range(values.shape[1]):
            result[group[n], k] += values[n, k]
