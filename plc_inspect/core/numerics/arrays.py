# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""
Kernels that select, copy and merge array elements.

What may be large is made outside of them: numpy asks for large pages of memory, which are cleared
in a third of the time.
"""

from numba import njit, prange
import numpy as np

from plc_inspect.results import Bool, Float32, Float64, Int32, Int64

NUM_PARTS = 16
"""
Runs of points that kernels process independently.
Source: numerical: several for each core; no result depends on it.
"""

MOST_COORDINATE = 1e8
"""
Greatest coordinate of any place on Earth, in any projection [m].
Source: derived: zones of Gauss-Krueger put 60 million before an easting; 1e8 is beyond.
"""


@njit(cache=True, nogil=True, inline='always')
def is_on_earth(x, y, z):  # type: ignore[no-untyped-def]
    """Tell whether coordinates are finite and below MOST_COORDINATE."""
    return max(abs(x), abs(y), abs(z)) < MOST_COORDINATE and 0.0 * (x + y + z) == 0.0


@njit(cache=True, nogil=True, inline='always')
def count_bits(bits):  # type: ignore[no-untyped-def]
    """Count the bits of an integer of at most 64 that are set."""
    rest, num = np.int64(bits), 0
    while rest:
        rest &= rest - 1
        num += 1
    return num


@njit(cache=True, nogil=True)
def put(values, target):  # type: ignore[no-untyped-def]
    """
    Copy (N,) values to the start of ``target``, which has at least N elements.

    Replaces assignment to a slice in kernels: numba's check of its length is up to a third of the
    code that is compiled and loaded.  Lengths are not checked here.
    """
    for k in range(len(values)):
        target[k] = values[k]


@njit(cache=True, nogil=True)
def merge_ascending(first, second):  # type: ignore[no-untyped-def]
    """
    Merge two ascending arrays.

    Parameters
    ----------
    first, second : (N,), (M,) integer
        Strictly ascending.

    Returns
    -------
    (K,) integer
        The union, strictly ascending.

    """
    result = np.empty(len(first) + len(second), dtype=first.dtype)
    i = k = used = 0
    while i < len(first) or k < len(second):
        if k == len(second) or (i < len(first) and first[i] < second[k]):
            result[used] = first[i]
            i += 1
        else:
            i += i < len(first) and first[i] == second[k]
            result[used] = second[k]
            k += 1
        used += 1
    return result[:used]


def find_true(mask: Bool) -> Int64:
    """
    Return the indices at which a mask is true.

    Parameters
    ----------
    mask : (N,) bool
        The mask.

    Returns
    -------
    (K,) int64, ascending

    """
    start = _count_before(mask)
    result = np.empty(int(start[-1]), dtype=np.int64)
    _list_true(mask, start, result)
    return result


@njit(cache=True, parallel=True, nogil=True)
def _count_before(mask):  # type: ignore[no-untyped-def]
    """Count what is true before each part, so that it knows where to write, and in all."""
    num = len(mask)
    start = np.zeros(NUM_PARTS + 1, dtype=np.int64)
    for part in prange(NUM_PARTS):
        for i in range(part * num // NUM_PARTS, (part + 1) * num // NUM_PARTS):
            start[part + 1] += mask[i]
    for part in range(NUM_PARTS):
        start[part + 1] += start[part]
    return start


@njit(cache=True, parallel=True, nogil=True)
def _list_true(mask, start, result):  # type: ignore[no-untyped-def]
    num = len(mask)
    for part in prange(NUM_PARTS):
        i, place = part * num // NUM_PARTS, start[part]
        while place < start[part + 1]:  # no branch on the mask, which is hard to predict
            result[place] = i
            place += mask[i]
            i += 1


def take_rows(points: Float64, chosen: Int64 | Int32) -> Float64:
    """
    Copy some of the points.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    chosen : (K,) integer
        Their indices.

    Returns
    -------
    (K, 3) float64

    """
    result = np.empty((len(chosen), 3))
    _copy_rows(points, chosen, result)
    return result


@njit(cache=True, parallel=True, nogil=True)
def _copy_rows(points, chosen, result):  # type: ignore[no-untyped-def]
    for k in prange(len(chosen)):
        i = chosen[k]
        result[k, 0], result[k, 1], result[k, 2] = points[i, 0], points[i, 1], points[i, 2]


@njit(cache=True, parallel=True, nogil=True)
def put_rows(table, place, rows):  # type: ignore[no-untyped-def]
    """
    Copy rows to their places.

    Parameters
    ----------
    table : (N, M) array
        Of which some rows are set.
    place : (K,) int64
        Where, each place at most once.
    rows : (K, M) array
        What.

    """
    for k in prange(len(place)):
        for column in range(table.shape[1]):
            table[place[k], column] = rows[k, column]


def take_found(
    chosen: Int64, found: Int64, distance: Float32, span: Int32
) -> tuple[Int64, Float32, Int32]:
    """
    Copy a part of the results of `find_near`.

    Parameters
    ----------
    chosen : (J,) int64
        Indices of the results to copy.
    found, distance, span : (K,) int64, float32, int32
        As from `find_near`, distances in m.

    Returns
    -------
    found, distance, span : (J,) int64, float32, int32

    """
    num = len(chosen)
    own = np.empty(num, dtype=np.int64), np.empty(num, np.float32), np.empty(num, np.int32)
    _copy_found(chosen, found, distance, span, *own)
    return own


@njit(cache=True, parallel=True, nogil=True)
def _copy_found(  # type: ignore[no-untyped-def]
    chosen, found, distance, span, own, own_distance, own_span
):
    for k in prange(len(chosen)):
        m = chosen[k]
        own[k], own_distance[k], own_span[k] = found[m], distance[m], span[m]
