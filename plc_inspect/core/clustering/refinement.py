# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The attempts on one window: all of it first, then finer what was too thick, then the rest."""

from collections.abc import Iterator
from dataclasses import dataclass

from numba import njit
import numpy as np

from plc_inspect.config import ClusteringSettings
from plc_inspect.core.clustering.clusterers import cluster_plane
from plc_inspect.core.clustering.cross_section import find_rest, find_skew
from plc_inspect.core.clustering.segment_fit import judge_clusters, LEAST_POINTS
from plc_inspect.results import Bool, Float64, Int64

NUM_EPS = 3
"""
Attempts that cluster: with eps, and what is too thick with half and a quarter of it.
Source: judgement; not measured.
"""
FINENESS = (0, 1, 2, 1, 2, 0)
"""
How often each attempt halves eps: after NUM_EPS attempts, what none divided is clustered along
its own direction; the last takes the clusters of the first.
Source: judgement; not measured.
"""
NUM_ATTEMPTS = len(FINENESS) - 1
"""
Attempts that cluster, and after which one takes as a bundle what none divided.
Source: derived: FINENESS has one more.
"""
BUNDLE_RATIO = 2.0
"""
Greatest rms of a bundle that no attempt divided, by that of one conductor.
Source: judgement; not measured.
"""

NUM_LOOKS = 2
"""
Looks at a window: after the first, at what lies in none of its clusters, at its own sampling.
Source: judgement; not measured.
"""
REST_REACH = 3.0
"""
Length that a segment of the second look needs, by that of the first; nor may it be crowded.
Source: measured: seed 121013, any, where the near conductors have forty times the points of the
far ones; with 1 clouds from UAVs lose up to 4 % of their wire.
"""

WindowState = tuple[Int64, Int64, Bool, Float64]
"""As from `open_window`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Attempt:
    """One attempt, before its clusters are judged."""

    number: int
    """From 0; NUM_ATTEMPTS is the one that takes as a bundle what was not divided."""
    chosen: Int64
    """(m,) points of the window that it clusters."""
    across: Float64
    up: Float64
    """(m,) where they lie as it clusters them [m]."""
    label: Int64
    """(m,) their clusters, -1 noise."""
    limit: float
    """Greatest rms of a segment [m]."""
    needed: int
    """Points of a core neighbourhood."""
    half: float
    """A segment is half as long as this at least [m]; at the first look, half a window."""
    max_crowding: float
    """Greatest share of its parts in which a segment may be crowded."""


@njit(cache=True, nogil=True)
def open_window(num):  # type: ignore[no-untyped-def]
    """
    Return the state of the attempts on a window of n points before the first one.

    Returns
    -------
    owner, first_label : (n,) int64
        Segment of each point and its cluster of the first attempt, -1 none.
    too_thick : (n,) bool
        Points that the next attempt clusters.
    fits : (n // 4 + 1, 8) float64
        Room for `judge_clusters`.

    """
    return (
        np.full(num, -1, dtype=np.int64), np.full(num, -1, dtype=np.int64),
        np.ones(num, dtype=np.bool_), np.empty((num // LEAST_POINTS + 1, 8)),
    )


@njit(cache=True, nogil=True)
def choose_points(  # type: ignore[no-untyped-def]
    attempt, owner, too_thick, first_label, max_thickness
):
    """
    Return the points of one attempt on a window.

    The attempts before the last one take what was too thick so far, to be clustered finer, and
    from attempt NUM_EPS on along its own direction; that one takes all that no attempt divided,
    and so does the last, as one, which may be a bundle.

    Parameters
    ----------
    attempt : int
        From 0 to NUM_ATTEMPTS.
    owner, too_thick, first_label
        State of `open_window`, as the attempts before left it.
    max_thickness : float
        Greatest rms of one conductor [m].

    Returns
    -------
    chosen : (m,) int64
        Points; fewer than LEAST_POINTS end the attempts before NUM_EPS.
    label : int64
        (m,) clusters in the last attempt; before it (0,), they are to be found.
    limit : float
        Greatest rms of a segment in this attempt [m].

    """
    if attempt < NUM_ATTEMPTS and attempt != NUM_EPS:
        chosen = np.flatnonzero(too_thick)
        return chosen, chosen[:0].copy(), max_thickness
    chosen = np.flatnonzero((owner < 0) & (first_label >= 0))
    label = first_label[chosen]
    divided = np.zeros(first_label.max() + 2, dtype=np.bool_)
    for k in range(len(owner)):
        if owner[k] >= 0 and first_label[k] >= 0:
            divided[first_label[k]] = True
    if attempt == NUM_EPS:
        return chosen[~divided[label] | too_thick[chosen]], label[:0], max_thickness
    label[divided[label]] = -1
    return chosen, label, BUNDLE_RATIO * max_thickness


@njit(cache=True, nogil=True)
def straighten(x, y, w, chosen, too_thick):  # type: ignore[no-untyped-def]
    """
    Turn a window into the direction of those of its points that no attempt divided.

    The azimuth of a window is the mean of its candidates', and those of conductors side by side
    see their neighbours too: dots that are smeared by more than they are apart are one.

    Parameters
    ----------
    x, y, w : (n,) float64
        Points along, across and up [m].
    chosen : (m,) int64
        Those that no attempt divided.
    too_thick : (n,) bool
        Cleared where they lie no sharper along another direction.

    Returns
    -------
    across, up : (n,) float64
        [m]
    chosen : (m,) int64
        Points to cluster anew; none where they lie no sharper.

    """
    skew_y = find_skew(x[chosen], y[chosen])
    skew_w = find_skew(x[chosen], w[chosen])
    if skew_y == 0.0 and skew_w == 0.0:
        too_thick[:] = False
        chosen = chosen[:0]
    return y - skew_y * x, w - skew_w * x, chosen


@njit(cache=True, nogil=True)
def look_again(y, w, eps, needed, half, first_label, too_thick):  # type: ignore[no-untyped-def]
    """
    Begin the second look at a window: at points in none of the clusters of the first.

    The core threshold is that of the fullest place, so conductors far from the lidar are noise
    beside one that is near.

    Parameters
    ----------
    y, w : (n,) float64
        Points across and up [m].
    eps : float
        Radius of DBSCAN in the first attempt [m].
    needed : int
        Points of a core neighbourhood at the first look.
    half : float
        Half the length of the window [m].
    first_label, too_thick
        State of `open_window`; set for the first attempt on those points, on none where they are
        sampled no worse.

    Returns
    -------
    needed : int
        Points of a core neighbourhood.
    half : float
        As segments are judged [m].
    max_crowding : float
        As segments are judged.

    """
    own = find_rest(y, w, eps, first_label, too_thick)
    if own >= needed:
        too_thick[:] = False
    first_label[:] = -1
    return own, REST_REACH * half, 0.0


def attempt_window(
    places: tuple[Float64, Float64, Float64], state: WindowState, needed: int, half: float,
    settings: ClusteringSettings,
) -> Iterator[Attempt]:
    """
    Make all attempts on a window, with any clusterer; the kernels of `segments` do the same.

    Parameters
    ----------
    places : tuple of (n,) float64
        Points along, across and up [m].
    state : tuple
        Of `open_window`; when all attempts are made it holds what was found.
    needed : int
        Points of a core neighbourhood at the first look.
    half : float
        Half the length of the window [m].
    settings : ClusteringSettings
        Settings of the stage.

    Yields
    ------
    Attempt

    """
    x, y, w = places
    owner, first_label, too_thick, fits = state
    found, max_crowding = 0, settings.max_crowding
    for look in range(NUM_LOOKS):
        if look:
            needed, half, max_crowding = look_again(
                y, w, settings.eps, needed, half, first_label, too_thick
            )
        u, v = y, w
        for number in range(NUM_ATTEMPTS + 1):
            chosen, label, limit = choose_points(
                number, owner, too_thick, first_label, settings.max_thickness
            )
            if number == NUM_EPS:
                u, v, chosen = straighten(x, y, w, chosen, too_thick)
            if len(chosen) < LEAST_POINTS:
                if number < NUM_EPS:
                    break
                continue
            if number < NUM_ATTEMPTS:
                label = cluster_plane(
                    settings.method, u[chosen], v[chosen], settings.eps, needed, FINENESS[number]
                )
            if number == 0:
                first_label[chosen] = label
            yield Attempt(
                number=number, chosen=chosen, across=u[chosen], up=v[chosen], label=label,
                limit=limit, needed=needed, half=half, max_crowding=max_crowding,
            )
            found = judge_clusters(
                x, y, w, chosen, label, limit, half, max_crowding, owner, too_thick, fits, found
            )
