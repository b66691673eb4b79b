# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Approach: how near points are to a span in each load case, and which limit that breaks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plc_inspect.core.hazards.breaches import are_under, choose_limits
from plc_inspect.core.hazards.clearance_rules import Limit
from plc_inspect.core.loads.blowout import SwungSpan
from plc_inspect.core.loads.sag_tension import State
from plc_inspect.results import Float64, Int64, Span

KEPT = 1e6
"""
Rank from which on a point breaks no limit, plus its distance.
Source: numerical: above any share of a limit at which one is reported.
"""
SEVERER = 1e3
"""
What a severity outdoes in the share of a limit.
Source: numerical: above any share of a limit at which one is reported.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Approach:
    """How near K points are to the nearest sub-conductor of a span, blown to either side."""

    values: Float64
    """(4, K) distance, its horizontal part, its vertical part (positive where the conductor is
    above), and place along the span [m]."""

    @property
    def distance(self) -> Float64:
        """(K,) [m]."""
        return self.values[0]

    @property
    def along(self) -> Float64:
        """(K,) distance along the span [m]."""
        return self.values[3]

    def judge(self, limits: Sequence[Limit]) -> tuple[Float64, Int64]:
        """
        Judge each point by the limit that it breaks most, as hazards are.

        Parameters
        ----------
        limits : sequence of Limit
            Of one feature.

        Returns
        -------
        rank : (K,) float64
            The less, the worse: by severity, then the share of that limit that is left; KEPT plus
            the distance where none is broken.
        severity : (K,) int64
            Severity, 0 where no limit is broken.

        """
        distance, horizontal, vertical, _ = self.values
        limit, severity, share = choose_limits(
            {'distance': distance, 'horizontal': horizontal, 'vertical': np.abs(vertical)},
            are_under(horizontal, vertical), limits,
        )
        rank = np.where(limit >= 0, share - SEVERER * severity, KEPT + distance)
        return rank, severity


class MovedSpan:
    """A span, with its sub-conductors, as surveyed and in each case."""

    def __init__(self, span: Span, states: Sequence[State], strands: Float64) -> None:
        """
        Place a span in the planes of its loads.

        Parameters
        ----------
        span : Span
            Gives the ends.
        states : sequence of State
            As surveyed, and in each case.
        strands : (S, 3) float64
            Its sub-conductors, from its curve [m]; they keep their places in all cases.

        """
        self.span, self.strands = span, strands
        self.frames = [
            [SwungSpan(span, state, side) for side in ((1.0, -1.0) if state.swing else (1.0,))]
            for state in states
        ]

    def approach(self, points: Float64) -> list[Approach]:
        """Return how near points (K, 3) are [m], as surveyed and in each case."""
        return [
            Approach(values=_choose_nearer([self._measure(frame, points) for frame in frames]))
            for frames in self.frames
        ]

    def rise(self, share: Float64, ground: Float64, reach: float) -> list[Float64]:
        """
        Return how high the conductor hangs above the ground, as surveyed and in each case.

        Parameters
        ----------
        share : (M,) float64
            Places along the span, from 0 to 1.
        ground : (K, 3) float64
            Positions on the ground [m].
        reach : float
            Greatest distance in plan to the position used [m].

        Returns
        -------
        list of (M,) float64
            Least of both sides [m], infinite where no ground is near.

        """
        from scipy.spatial import cKDTree  # imported here, as it takes a moment

        result = [np.full(len(share), np.inf) for _ in self.frames]
        if not len(ground):
            return result
        tree = cKDTree(ground[:, :2])
        for frames, least in zip(self.frames, result, strict=True):
            for frame in frames:
                at = frame.position(share * frame.state.length)
                apart, nearest = tree.query(at[:, :2], distance_upper_bound=reach)
                near = np.flatnonzero(np.isfinite(apart))
                least[near] = np.minimum(least[near], at[near, 2] - ground[nearest[near], 2])
        return result

    def _measure(self, frame: SwungSpan, points: Float64) -> Float64:
        """Return the (4, K) values of an Approach, on one side."""
        _, x = frame.measure(points)
        up = frame.position(x) - points
        along = x * (self.span.length / frame.state.length)  # an inclined span is longer aslant
        return _choose_nearer([
            np.vstack([
                np.linalg.norm(up + strand, axis=1), np.hypot(*(up + strand)[:, :2].T),
                up[:, 2] + strand[2], along,
            ]) for strand in self.strands
        ])


def _choose_nearer(found: Sequence[Float64]) -> Float64:
    """Return for each point those (4, K) values with the least distance."""
    best = found[0]
    for other in found[1:]:
        best = np.where(other[0] < best[0], other, best)
    return best
