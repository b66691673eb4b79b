# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Beads: the first stage of clustering, across the line, window by window."""

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
    NUM_EPS,
    open_window,
)
from plc_inspect.core.clustering.segment_fit import judge_clusters, LEAST_POINTS
from plc_inspect.core.extraction.alignment import AlignmentResult
from plc_inspect.core.numerics.arrays import put
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.core.numerics.threads import call_each
from plc_inspect.results import Float64, Int32, Int64

WINDOWS_PER_CALL = 4
"""
Windows that one call of a kernel clusters; threads share the calls.
Source: numerical: time alone depends on it.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beads:
    """B short straight pieces of conductor, each one cluster across the line in a window."""

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
    """(B + 1,) first entry of each bead in ``points``."""
    points: Int32
    """Point indices, bead by bead."""

    def __len__(self) -> int:
        """Return the number of beads."""
        return len(self.center)


def find_beads(
    points: Float64,
    index: PlanIndex,
    seeds: Float64,
    alignment: AlignmentResult,
    settings: ClusteringSettings,
) -> tuple[Beads, int]:
    """
    Return the beads of all windows, and how many clusters the first attempts gave.

    Parameters are those of `cluster`.
    """
    num_windows = len(alignment.azimuth)
    rows, members, sizes, num_beads = [], [], [], []
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
        num_beads.append(len(of_window))
        if len(of_window):
            rows.append(of_window)
            members.append(own)
            sizes.append(count)
    table = np.concatenate(rows) if rows else np.zeros((0, 8))
    counts = np.concatenate(sizes) if sizes else np.zeros(0, dtype=np.int64)
    beads = Beads(
        window=np.repeat(np.arange(num_windows, dtype=np.int32), num_beads),
        center=table[:, 0:3],
        direction=table[:, 3:6],
        half_length=table[:, 6],
        rms=table[:, 7],
        point_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        points=np.concatenate(members) if members else np.zeros(0, dtype=np.int32),
    )
    return beads, num_clusters


@njit(cache=True, nogil=True)
def cluster_window(  # type: ignore[no-untyped-def]
    x, y, w, method, eps, min_points, half, max_thickness, max_crowding
):
    """
    Find the beads among the points of one window.

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
        Bead of each point, -1 none.
    num_clusters : int
        Clusters of the first attempt.

    """
    owner, first_label, too_thick, fits = open_window(len(x))
    found = 0
    for attempt in range(NUM_EPS + 1):
        chosen, label, limit = choose_points(
            attempt, owner, too_thick, first_label, max_thickness
        )
        if len(chosen) < LEAST_POINTS:
            break
        if attempt < NUM_EPS:
            label = label_plane(method, y[chosen], w[chosen], eps, min_points, attempt)
        if attempt == 0:
            put(label, first_label)
        found = judge_clusters(
            x, y, w, chosen, label, limit, half, max_crowding, owner, too_thick, fits, found
        )
    return fits[:found], owner, first_label.max() + 1


@njit(cache=True, nogil=True)
def _lift(fits, center, azimuth, rise):  # type: ignore[no-untyped-def]
    """Return the rows of Beads, centre, direction, half length and rms, of a window's fits."""
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    beads = np.empty((len(fits), 8))
    for b in range(len(fits)):
        mx, my, mw, ky, kw = fits[b, 0], fits[b, 1], fits[b, 2], fits[b, 3], fits[b, 4]
        beads[b, 0] = center[0] + ca * mx - sa * my
        beads[b, 1] = center[1] + sa * mx + ca * my
        beads[b, 2] = center[2] + rise * mx + mw
        ux, uy, uz = ca - sa * ky, sa + ca * ky, rise + kw
        norm = math.sqrt(ux * ux + uy * uy + uz * uz)
        beads[b, 3], beads[b, 4], beads[b, 5] = ux / norm, uy / norm, uz / norm
        beads[b, 6] = (fits[b, 7] - fits[b, 6]) / 2.0
        beads[b, 7] = fits[b, 5]
    return beads


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
        beads = _lift(fits, center[window], azimuth[window], slope[window])
        results[k] = (beads, *_collect(owner, chosen, len(beads)), num_clusters)
    return results


@njit(cache=True, nogil=True)
def _collect(owner, chosen, num):  # type: ignore[no-untyped-def]
    """How many points each of the beads of a window has, and these points bead by bead."""
    count = np.zeros(num, dtype=np.int64)
    for bead in owner:
        if bead >= 0:
            count[bead] += 1
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
    deque(attempt_window((x, y, w), state, needed, alignment.half_length, settings), maxlen=0)
    owner, first_label, _, fits = state
    beads = _lift(
        fits[: owner.max(initial=-1) + 1], alignment.center[window], alignment.azimuth[window],
        alignment.slope[window],
    )
    return beads, *_collect(owner, near, len(beads)), int(first_label.max(initial=-1)) + 1
