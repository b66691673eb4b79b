# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Line segments: the first stage of clustering, across the line, window by window."""

from collections import deque
from dataclasses import dataclass
import math

from numba import njit
import numpy as np

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.clustering.clusterers import KERNELS, label_plane
from plc_inspect.core.clustering.cross_section import (
    count_needed,
    gather_points,
    gather_window,
    thin_window,
)
from plc_inspect.core.clustering.refinement import (
    attempt_window,
    choose_points,
    FINENESS,
    look_again,
    NUM_ATTEMPTS,
    NUM_EPS,
    NUM_LOOKS,
    open_window,
    straighten,
)
from plc_inspect.core.clustering.segment_fit import judge_clusters, LEAST_POINTS
from plc_inspect.core.extraction.alignment import AlignmentResult
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Float64, Int32, Int64

WINDOWS_PER_CALL = 4
"""
Windows that one call of a kernel clusters; threads share the calls.
Source: numerical: time alone depends on it.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segments:
    """B line segments: short straight pieces of conductor, each one cluster of one window."""

    window: Int32
    """(B,) window that each was found in."""
    center: Float64
    """(B, 3) [m]"""
    direction: Float64
    """(B, 3) unit vector, azimuth in (-pi/2, pi/2]."""
    half_length: Float64
    """(B,) [m]"""
    rms: Float64
    """(B,) root mean square distance of the points to the axis [m]."""
    point_start: Int64
    """(B + 1,) first entry of each segment in ``points``."""
    points: Int32
    """Point indices, segment by segment."""

    def __len__(self) -> int:
        """Return the number of segments."""
        return len(self.center)


def find_segments(
    points: Float64,
    index: PlanIndex,
    seeds: Float64,
    alignment: AlignmentResult,
    settings: ClusteringSettings,
) -> tuple[Segments, int]:
    """
    Return the segments of all windows, and how many clusters the first attempts gave.

    Parameters are those of `cluster`.
    """
    num_windows = len(alignment.azimuth)
    rows, members, sizes, num_segments = [], [], [], []
    num_clusters = 0
    found = []
    if settings.method not in KERNELS:
        found = [
            _cluster_window_by_tree(points, index, seeds, alignment, window, settings)
            for window in range(num_windows)
        ]
    else:
        parts = call_each(
            lambda part: _cluster_windows(
                part * WINDOWS_PER_CALL,
                points,
                *index.grid,
                seeds,
                alignment.seed_start,
                alignment.seeds,
                alignment.center,
                alignment.azimuth,
                alignment.slope,
                alignment.half_length,
                KERNELS[settings.method],
                settings.eps,
                settings.min_points,
                settings.max_thickness,
                settings.max_crowding,
            ),
            -(-num_windows // WINDOWS_PER_CALL),
        )
        found = [item for part in parts for item in part]
    for of_window, count, own, num in found:
        num_clusters += num
        num_segments.append(len(of_window))
        if len(of_window):
            rows.append(of_window)
            members.append(own)
            sizes.append(count)
    table = np.concatenate(rows) if rows else np.zeros((0, 8))
    counts = np.concatenate(sizes) if sizes else np.zeros(0, dtype=np.int64)
    segments = Segments(
        window=np.repeat(np.arange(num_windows, dtype=np.int32), num_segments),
        center=table[:, 0:3],
        direction=table[:, 3:6],
        half_length=table[:, 6],
        rms=table[:, 7],
        point_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        points=np.concatenate(members) if members else np.zeros(0, dtype=np.int32),
    )
    return segments, num_clusters


@njit(cache=True, nogil=True)
def cluster_window(  # type: ignore[no-untyped-def]
    x, y, w, method, eps, min_points, half, max_thickness, max_crowding
):
    """
    Find the segments among the points of one window.

    Parameters
    ----------
    x, y, w : (n,) float64
        Points along, across and up [m].
    method : int
        Of `clusterers.KERNELS`.
    eps, min_points, max_thickness, max_crowding
        As of ClusteringSettings; eps and thickness in m.
    half : float
        Half the length of the window [m].

    Returns
    -------
    fits : (B, 8) float64
        As of `judge_clusters`.
    owner : (n,) int64
        Segment of each point, -1 none.
    num_clusters : int
        Clusters of the first attempt.

    """
    owner, first_label, too_thick, fits = open_window(len(x))
    found, num_clusters = 0, 0
    for look in range(NUM_LOOKS):
        if look:
            num_clusters = first_label.max() + 1
            min_points, half, max_crowding = look_again(
                y, w, eps, min_points, half, first_label, too_thick
            )
        u, v = y, w
        for attempt in range(NUM_ATTEMPTS + 1):
            chosen, label, limit = choose_points(
                attempt, owner, too_thick, first_label, max_thickness
            )
            if attempt == NUM_EPS:
                u, v, chosen = straighten(x, y, w, chosen, too_thick)
            if len(chosen) < LEAST_POINTS:
                if attempt < NUM_EPS:
                    break
                continue
            if attempt < NUM_ATTEMPTS:
                label = label_plane(
                    method, u[chosen], v[chosen], eps, min_points, FINENESS[attempt]
                )
            if attempt == 0:
                first_label[chosen] = label
            found = judge_clusters(
                x, y, w, chosen, label, limit, half, max_crowding, owner, too_thick, fits, found
            )
    return fits[:found], owner, num_clusters


@njit(cache=True, nogil=True)
def _lift(fits, center, azimuth, rise):  # type: ignore[no-untyped-def]
    """Return the rows of Segments, centre, direction, half length and rms, of a window's fits."""
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    segments = np.empty((len(fits), 8))
    for b in range(len(fits)):
        mx, my, mw, ky, kw = fits[b, 0], fits[b, 1], fits[b, 2], fits[b, 3], fits[b, 4]
        segments[b, 0] = center[0] + ca * mx - sa * my
        segments[b, 1] = center[1] + sa * mx + ca * my
        segments[b, 2] = center[2] + rise * mx + mw
        ux, uy, uz = ca - sa * ky, sa + ca * ky, rise + kw
        norm = math.sqrt(ux * ux + uy * uy + uz * uz)
        segments[b, 3], segments[b, 4], segments[b, 5] = ux / norm, uy / norm, uz / norm
        segments[b, 6] = (fits[b, 7] - fits[b, 6]) / 2.0
        segments[b, 7] = fits[b, 5]
    return segments


@njit(cache=True, nogil=True)
def _cluster_windows(  # type: ignore[no-untyped-def]
    first, points, start, order, origin, cell, rows, columns,
    seeds, seed_start, seed_list, center, azimuth, slope, half,
    method, eps, min_points, max_thickness, max_crowding,
):
    """Cluster the points of WINDOWS_PER_CALL windows from ``first`` on."""
    num = min(len(azimuth) - first, WINDOWS_PER_CALL)
    results = [
        (
            np.empty((0, 8)),
            np.empty(0, dtype=np.int64),
            np.empty(0, dtype=np.int32),
            0,
        )
        for _ in range(num)
    ]
    for k in range(num):
        window = first + k
        chosen, x, y, w = thin_window(*gather_window(
            points, start, order, origin, cell, rows, columns,
            seeds, seed_list[seed_start[window] : seed_start[window + 1]],
            center[window], azimuth[window], slope[window], half,
        ))
        if len(chosen) < LEAST_POINTS:
            continue
        needed = count_needed(y, w, eps, min_points)
        fits, owner, num_clusters = cluster_window(
            x, y, w, method, eps, needed, half, max_thickness, max_crowding
        )
        segments = _lift(fits, center[window], azimuth[window], slope[window])
        results[k] = (segments, *_collect(owner, chosen, len(segments)), num_clusters)
    return results


@njit(cache=True, nogil=True)
def _collect(owner, chosen, num):  # type: ignore[no-untyped-def]
    """Return the number of points of each segment of a window, and the points by segment."""
    count = np.zeros(num, dtype=np.int64)
    for segment in owner:
        if segment >= 0:
            count[segment] += 1
    place = np.cumsum(count) - count
    own = np.empty(count.sum(), dtype=np.int32)
    for k in range(len(owner)):
        if owner[k] >= 0:
            own[place[owner[k]]] = chosen[k]
            place[owner[k]] += 1
    return count, own


def _cluster_window_by_tree(
    points: Float64, index: PlanIndex, seeds: Float64, alignment: AlignmentResult, window: int,
    settings: ClusteringSettings,
) -> tuple[Float64, Int64, Int32, int]:
    """Return what `_cluster_windows` does of one window, by HDBSCAN, which no kernel can call."""
    near, x, y, w = thin_window(*gather_points(points, index, seeds, alignment, window))
    state = open_window(len(x))
    needed = int(count_needed(y, w, settings.eps, settings.min_points))
    attempts = attempt_window((x, y, w), state, needed, alignment.half_length, settings)
    first = next(attempts, None)
    num_clusters = 0 if first is None else int(first.label.max(initial=-1)) + 1
    deque(attempts, maxlen=0)
    owner, _, _, fits = state
    segments = _lift(
        fits[: owner.max(initial=-1) + 1], alignment.center[window], alignment.azimuth[window],
        alignment.slope[window],
    )
    return segments, *_collect(owner, near, len(segments)), num_clusters
