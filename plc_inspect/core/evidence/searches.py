# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Further searches for conductors, where the first one leaves something to find."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from plc_inspect.config import AlignmentSettings, Settings
from plc_inspect.core.catenary.curve import Curve, pack_curves
from plc_inspect.core.catenary.profile import profile_curve
from plc_inspect.core.clustering.clustering import cluster, ClusteringResult
from plc_inspect.core.evidence.beside import find_nearest, ROOM, search_along, search_beside
from plc_inspect.core.extraction.alignment import align, AlignmentResult
from plc_inspect.core.extraction.linearity import LinearityResult, Scales
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.extraction.sparse_lines import find_sparse_lines, list_places
from plc_inspect.core.numerics.plan_index import build_plan_index, PlanIndex
from plc_inspect.results import Bool, Float64

SHORTER = 0.8
"""
Length of the windows of the second search, as a share of those of the first.
Source: bench/frames.py: with 0.7 to 0.8 oakland_part2_ah 0.57 to 0.62 in place of 0, part3_am 0.55
in place of 0.37; with 0.65 windows of these hold too few points.
"""
SPARSE = 3.0
"""
Points a metre below which a curve is sparse, and may be searched by all points about it.
Source: derived: a neighbourhood of 1.5 m then holds fewer than five, and those of 3 m and more
are as wide as what is beside it; bench/frames.py --noise: with 0 autzen_wires_north gave no line
in 11 of 16 frames; uav_chemical_plant_no_wires has false lines where dense things are searched so.
"""
GAP, MOST_BARE = 0.5, 0.25
"""
What lies farther from both of the points about it than half of this is bare [m], and the share of
a curve that is so at least where it has gaps.
Source: derived: of SPARSE points a metre that lie at random as much; measured: of wires in scan
lines 1 to 2 m apart, 2 to 12 points in each (test/core/extraction/test_sparse_lines.py).
"""
STRETCH = 3.0
"""
Windows for sparse lines, and how far their places vote, as a multiple of the first search's.
Source: measured: bench/frames.py --thin 0.12 0.06 --frames 8 --seed 1103 on both AHN tiles, with
trees and without, and uav_costarica_mv: mean of the median wire F1 0.57, 0.73, 0.78 and 0.78 with
1, 2, 3 and 4.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Searches:
    """Searches a cloud again, knowing what was found."""

    cloud: OffGround
    """Points off the ground; the high ones are searched."""
    inliers: LinearityResult
    """Places where points lie along a line."""
    steep: LinearityResult
    """Places where points lie along a steeper line."""
    scales: Scales
    """Neighbourhoods of the high points."""
    settings: Settings
    """Of all stages."""

    def look_again(self, curves: Sequence[Curve]) -> ClusteringResult:
        """
        Cluster the places about curves anew, in shorter windows.

        Conductors that bend, or run together at a pole, part in shorter windows; and windows that
        hold nothing else lie elsewhere.

        Parameters
        ----------
        curves : sequence of Curve
            With too little evidence.

        Returns
        -------
        ClusteringResult

        """
        half_length = self.settings.alignment.half_length
        near = self.inliers.select(self._find_about(
            self.inliers.position, curves, 2.0 * half_length
        ))
        windows = align(near, self.settings.alignment)
        return self._cluster(near, replace(windows, half_length=SHORTER * half_length))

    def look_along(self, curves: Sequence[Curve], known: Sequence[Curve]) -> ClusteringResult:
        """
        Cluster the points along sparse curves anew.

        Points too far apart make a line of no place by itself: what leads to the curve is a few
        that lie well by chance.

        Parameters
        ----------
        curves : sequence of Curve
            With too little evidence.
        known : sequence of Curve
            Conductors, whose points are left out.

        Returns
        -------
        ClusteringResult

        """
        return search_along(
            self.cloud, [curve for curve in curves if is_sparse(curve)], known, self.settings
        )

    def look_steeply(self, curves: Sequence[Curve]) -> ClusteringResult:
        """
        Cluster the places where points lie along something steep.

        On a slope a span may be as steep as the branches and gables that the first search leaves
        out.

        Parameters
        ----------
        curves : sequence of Curve
            Conductors that are known; what lies along them is not looked for.

        Returns
        -------
        ClusteringResult

        """
        rest = self.steep.select(~self._find_about(self.steep.position, curves, 0.0))
        return self._cluster(rest, align(rest, self.settings.alignment))

    def look_sparsely(self, curves: Sequence[Curve]) -> ClusteringResult:
        """Cluster the sparse places in line, away from known curves, in longer windows."""
        own = self.settings.alignment
        position, sparse = list_places(self.scales)
        sparse = sparse[~self._find_about(position[sparse], curves, 0.0)]
        places = find_sparse_lines(position, sparse, self.settings.linearity, own.min_votes)
        return self._cluster(places, align(places, _stretch(own)))

    def look_beside(
        self, curves: Sequence[Curve], others: Sequence[Curve]
    ) -> ClusteringResult:
        """Cluster the points about conductors, without those of others: `search_beside`."""
        return search_beside(self.cloud, curves, others, self.settings)

    def _find_about(
        self, position: Float64, curves: Sequence[Curve], past: float
    ) -> Bool:
        """Tell which places (M, 3) are within ROOM of curves, no farther past their ends [m]."""
        cell = self.settings.alignment.half_length
        if not curves or not len(position):
            return np.zeros(len(position), dtype=np.bool_)
        index = build_plan_index(position, np.arange(len(position)), cell)
        owner, _ = find_nearest(position, index, pack_curves(curves), len(curves), ROOM, past)
        result: Bool = owner >= 0
        return result

    def _cluster(self, places: LinearityResult, windows: AlignmentResult) -> ClusteringResult:
        """Cluster the points about places, window by window."""
        return cluster(
            self.cloud.points, self.cloud.index_high(), places.position, windows,
            self.settings.clustering,
        )


def is_sparse(curve: Curve) -> bool:
    """Tell whether a curve has few points a metre."""
    return len(curve.points) < SPARSE * curve.length


def has_gaps(points: Float64, index: PlanIndex, curve: Curve) -> bool:
    """Tell whether a curve has few points, or these lie in few places, as scan lines do."""
    if is_sparse(curve):
        return True
    profile = profile_curve(points, index, curve, curve.low, curve.high)
    x = np.sort(curve.local(points[profile.chosen])[0])
    steps = np.diff(x, prepend=curve.low, append=curve.high)
    return float(np.maximum(steps - GAP, 0.0).sum()) > MOST_BARE * curve.length


def _stretch(settings: AlignmentSettings) -> AlignmentSettings:
    """Return settings STRETCH times as long, or as long as they may be."""
    highest = {item.name: item.metadata['high'] for item in fields(settings)}
    return replace(settings, **{
        name: min(STRETCH * getattr(settings, name), highest[name])
        for name in ('reach', 'half_length')
    })
