# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Two-stage clustering: across the line in each window, then along the line."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.clustering.segments import find_segments, Segments
from plc_inspect.core.extraction.alignment import AlignmentResult
from plc_inspect.core.numerics.disjoint_sets import find_root
from plc_inspect.core.numerics.near_pairs import find_pairs
from plc_inspect.core.numerics.plan_index import PlanIndex
from plc_inspect.results import Float64, Int32

SLACK_RATE = 0.004
"""
Growth of the tolerance per metre between two segments.
Source: judgement; holds from 0.002 to 0.0056 on bench/constants.py.
"""
MAX_TURN = 0.04
"""
Greatest sine of the angle in plan between two segments of one track.
Source: judgement; worse at 0.7 and 1.4 of it on bench/constants.py.
"""
MAX_BEND = 0.04
"""
Greatest difference of the slopes of two touching segments of one track.
Source: judgement; holds up to 0.08, not down to 0.7 of it, on bench/constants.py.
"""
LEAST_CONSTANT = 200.0
"""
Least catenary constant, which limits the change of slope between two segments [m].
Source: judgement; holds down to 100, not up to 1.4 of it, on bench/constants.py.
"""
MAX_SLANT, SLANT_ROOM = 1.05, 0.3
"""
Greatest distance of two segments: MAX_SLANT times that along the line, or SLANT_ROOM more than
it, whichever is greater [m].
Source: judgement; MAX_SLANT holds from 0.525 to 2.1, SLANT_ROOM holds from 0.15 to 0.6 on
bench/constants.py.
"""
LENGTH_COST = 0.02
"""
Cost of a metre between two segments, as an equivalent miss [m].
Source: judgement; holds from 0.01 to 0.04 on bench/constants.py.
"""
COST_DECIMALS = 6
"""
Decimals of the costs by which links are ordered.
Source: numerical: costs that differ by rounding are ordered by their segments.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClusteringResult:
    """Segments, and the tracks that they join to."""

    segments: Segments
    track: Int32
    """(B,) track of each segment, -1 none; numbered by first segment."""
    num_tracks: int
    num_clusters: int
    """Clusters of the first stage, before the tests of a segment."""
    eps: float
    min_points: int


def cluster(
    points: Float64,
    index: PlanIndex,
    seeds: Float64,
    alignment: AlignmentResult,
    settings: ClusteringSettings,
) -> ClusteringResult:
    """
    Separate conductors across the line, window by window, and join them along it.

    First stage: in the regularised frame of a window (x along, y across, z up) the rise along
    the line is taken out, so every conductor is a dot in the orthogonal plane, and DBSCAN with
    ``eps`` and ``min_points`` finds the dots.  ``min_points`` holds where a window is well
    sampled and is lowered with the sampling.  A cluster too thick for one conductor is divided
    with a smaller eps, and if that fails, along the direction in which its points lie sharpest.
    What lies in no cluster is looked at once more, at its own sampling.
    Second stage: segments of different windows are joined if each, extended
    to half way, meets the other; the sag cancels there because both deviate by the same amount.

    Parameters
    ----------
    points : (N, 3) float64
        Coordinates [m].
    index : PlanIndex
        Of the high points.
    seeds : (M, 3) float64
        Positions of the candidates [m].
    alignment : AlignmentResult
        Windows and their azimuths.
    settings : ClusteringSettings
        Settings of this stage.

    Returns
    -------
    ClusteringResult

    """
    segments, num_clusters = find_segments(points, index, seeds, alignment, settings)
    track = _join(segments, settings)
    return ClusteringResult(
        segments=segments,
        track=track,
        num_tracks=int(track.max(initial=-1)) + 1,
        num_clusters=num_clusters,
        eps=settings.eps,
        min_points=settings.min_points,
    )


def _join(segments: Segments, settings: ClusteringSettings) -> Int32:
    """Second stage: tracks of segments that continue one another."""
    num = len(segments)
    if num == 0:
        return np.zeros(0, dtype=np.int32)
    i, j = find_pairs(segments.center, settings.max_gap).T
    apart = segments.center[j] - segments.center[i]
    ui, uj = segments.direction[i], segments.direction[j].copy()
    flip = np.einsum('ij,ij->i', ui, uj) < 0
    uj[flip] *= -1
    along_i = np.einsum('ij,ij->i', apart, ui)
    along_j = np.einsum('ij,ij->i', apart, uj)
    # both axes at the plane half way between the centres
    meet_i = ui * (along_i / 2)[:, None]
    meet_j = apart - uj * (along_j / 2)[:, None]
    offset = meet_j - meet_i
    mean = ui + uj
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    offset -= mean * np.einsum('ij,ij->i', offset, mean)[:, None]
    miss = np.linalg.norm(offset, axis=1)
    length = np.abs(along_i)
    tolerance = settings.join_tolerance + SLACK_RATE * length
    turn = np.abs(ui[:, 0] * uj[:, 1] - ui[:, 1] * uj[:, 0])
    bend = np.abs(ui[:, 2] - uj[:, 2])
    good = (miss <= tolerance) & (turn <= MAX_TURN) & (bend <= MAX_BEND + length / LEAST_CONSTANT)
    good &= np.linalg.norm(apart, axis=1) <= np.maximum(
        length * MAX_SLANT, length + SLANT_ROOM
    )
    good &= segments.window[i] != segments.window[j]
    i, j, miss = i[good], j[good], miss[good]
    # mutual best between any two windows
    best = _mutual_best(i, j, miss, segments.window)
    i, j = i[best], j[best]
    cost = miss[best] + LENGTH_COST * length[good][best]
    order = np.lexsort((j, i, np.round(cost, COST_DECIMALS)))
    label = _link(i[order], j[order], segments.window)
    _, first, track = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[track].astype(np.int32)


def _mutual_best(i: Int32, j: Int32, miss: Float64, window: Int32) -> np.ndarray:
    """Pairs in which each segment is the other's nearest among those of its window."""
    keep = np.ones(len(i), dtype=bool)
    for own, other in ((i, j), (j, i)):
        order = np.lexsort((miss, window[other], own))
        first = np.ones(len(order), dtype=bool)
        a, b = own[order], window[other][order]
        first[1:] = (a[1:] != a[:-1]) | (b[1:] != b[:-1])
        is_first = np.zeros(len(order), dtype=bool)
        is_first[order] = first
        keep &= is_first
    return keep


@njit(cache=True, nogil=True)
def _link(first, second, window):  # type: ignore[no-untyped-def]
    """
    Join segments along the links, best first, but never two of one window.

    Two segments of one window are two conductors, however well a third seems to continue both.
    """
    num = len(window)
    parent = np.arange(num)
    following = np.full(num, -1, dtype=np.int64)
    last = np.arange(num)
    seen = np.full(window.max() + 1, -1, dtype=np.int64)
    for link in range(len(first)):
        a, b = find_root(parent, first[link]), find_root(parent, second[link])
        if a == b:
            continue
        item = a
        while item >= 0:
            seen[window[item]] = link
            item = following[item]
        item = b
        clash = False
        while item >= 0 and not clash:
            clash = seen[window[item]] == link
            item = following[item]
        if clash:
            continue
        parent[b] = a
        following[last[a]] = b
        last[a] = last[b]
    for item in range(num):
        parent[item] = find_root(parent, item)
    return parent
