# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Selects the usable points of a scan, in numba."""

from numba import njit
import numpy as np
from numpy.typing import NDArray

from plc_inspect.errors import DataError
from plc_inspect.results import Float32, Float64, Int64

MAX_TIME_OFFSET = 1.0
"""
Greatest plausible time of a point relative to its scan's stamp [s].
Source: judgement; not measured.
"""

AT_STAMP = 1e-6
"""
Greatest time of the points of a scan that have no times of their own [s].
Source: derived: times since 1970 are rounded to 0.24 us in float64; sensors fire every 50 us.
"""


def judge_times(time: NDArray[np.float64] | None, num_kept: int, worst: float) -> bool:
    """
    Return whether points have times of their own, as far as those kept tell.

    Raises
    ------
    DataError
        A point is farther from its scan's stamp than MAX_TIME_OFFSET.

    """
    if worst > MAX_TIME_OFFSET:
        raise DataError(
            f'a point is {worst:g} s away from the stamp of its scan, '
            f'at most {MAX_TIME_OFFSET:g} s is believed'
        )
    return time is not None and (worst >= AT_STAMP or not num_kept)


@njit(cache=True, nogil=True)
def select_points(
    xyz: Float32, times: Float64, stamp_ns: int, min_range: float, max_range: float
) -> tuple[Float32, Int64, int, int, int, float]:
    """
    Keep finite points within range, count the others, and find the greatest time.

    Parameters
    ----------
    xyz : Float32
        (N, 3) points in the lidar frame [m].
    times : Float64
        (N,) time of each point relative to the stamp [s]; (0,) if all are at the stamp.
    stamp_ns : int
        Stamp of the scan [ns].
    min_range, max_range : float
        Range of the points to keep [m].

    Returns
    -------
    tuple[Float32, Int64, int, int, int, float]
        (M, 3) points, (M,) their times [ns], how many of the others are not finite, too near and
        too far, and the greatest time from the stamp among those kept [s].

    """
    kept = np.empty_like(xyz)
    stamps = np.empty(len(xyz), dtype=np.int64)
    count, not_finite, near, far = 0, 0, 0, 0
    worst = 0.0
    for i in range(len(xyz)):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        time = times[i] if len(times) else 0.0
        squared = x * x + y * y + z * z
        if not (np.isfinite(squared) and np.isfinite(time)):
            not_finite += 1
        elif squared < min_range * min_range:
            near += 1
        elif squared > max_range * max_range:
            far += 1
        else:
            worst = max(worst, abs(time))
            kept[count] = xyz[i]
            stamps[count] = stamp_ns + np.int64(np.rint(time * 1e9))
            count += 1
    return kept[:count], stamps[:count], not_finite, near, far, worst


def check_points(xyz: Float32, time: NDArray[np.float64] | None) -> tuple[Float32, Float64]:
    """
    Return points (N, 3) and times (N,), or (0,) without times, as kernels take them.

    Raises
    ------
    DataError
        Their shapes do not match.

    """
    points = np.ascontiguousarray(xyz, dtype=np.float32)
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(f'points must have shape (N, 3), got {points.shape}')
    times = np.zeros(0) if time is None else np.ascontiguousarray(time, dtype=np.float64)
    if time is not None and times.shape != (len(points),):
        raise DataError(f'times of shape {times.shape} for {len(points)} points')
    return points, times


def find_ends(stamps: Int64, stamp_ns: int) -> tuple[int, int]:
    """Return the first and last time of the points of a scan [ns]; its stamp where it has none."""
    return (int(stamps.min()), int(stamps.max())) if len(stamps) else (stamp_ns, stamp_ns)
