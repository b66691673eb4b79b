# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explains clustering at one point: its clusters in the windows that hold it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
import math

import numpy as np

from plc_inspect.checks import Check
from plc_inspect.config import ClusteringSettings, Settings
from plc_inspect.core.clustering.clusterers import count_neighbors
from plc_inspect.core.clustering.cross_section import (
    count_needed,
    gather_points,
    MAX_WINDOW_POINTS,
    thin_window,
)
from plc_inspect.core.clustering.refinement import (
    Attempt,
    attempt_window,
    FINENESS,
    NUM_ATTEMPTS,
    open_window,
)
from plc_inspect.core.clustering.segment_fit import (
    find_apart,
    find_pieces,
    fit_trimmed,
    LEAST_POINTS,
    measure_crowding,
    measure_filling,
    MIN_FILLING,
)
from plc_inspect.core.clustering.segments import find_segments
from plc_inspect.core.explain.extraction_view import Place
from plc_inspect.core.explain.proposals import apply, Finding, Proposal, propose, rank
from plc_inspect.core.extraction.alignment import AlignmentResult
from plc_inspect.results import Bool, Float64, Int32, Int64

MOST_WINDOWS = 4
"""Most windows described.  Source: judgement; not measured."""
MOST_TRIALS = 12
"""Most proposals tried on them.  Source: numerical: bounds the time."""
MOST_DISTANCE = 60.0
"""
Greatest distance of a point to the middle of a described window [m].
Source: judgement; not measured.
"""
LEAST_PROPOSED = 4
"""
Least number of points of a neighbourhood that is proposed.
Source: derived: the least in use.
"""
LEAST_SHARE = 0.5
"""
Least length of a cluster, as a share of half_length.
Source: derived: as `segment_fit` judges it.
"""
EPS_STEPS = (1.25, 1.5, 2.0, 3.0)
"""Factors on eps that are tried.  Source: judgement; not measured."""
THICKNESS_STEPS = (0.5, 1.0)
"""
Factors on a cluster's thickness that are tried as limits.
Source: derived: what is not divided may be twice as thick.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusterView:
    """One attempt at the cluster that a point belongs to, in one window."""

    window: int
    outcome: str
    """'segment', or why it is not one."""
    neighbors: int
    """Points within eps across the line, the point included; with RNN-DBSCAN its reverse ones."""
    needed: int
    """Points of a core neighbourhood in this window; 0 for clusterers without one."""
    eps: float
    size: int = 0
    length: float = math.nan
    filling: float = math.nan
    rms: float = math.nan
    limit: float = math.nan
    """Limit of the rms in this attempt [m]."""
    crowding: float = math.nan
    least_length: float = math.nan
    max_crowding: float = math.nan
    """Limits of length [m] and crowding; the second look at a window is stricter."""
    is_own: bool = True
    """The cluster is the point's own; else that of the nearest point that was not thinned out."""


class Windows:
    """The windows that hold one point, and its clusters in them."""

    def __init__(self, place: Place) -> None:
        """Find the windows that reach over a point."""
        trace, self.place = place.trace, place
        self.settings: Settings = place.settings
        self.cloud, self.alignment = trace.lines.cloud, trace.lines.alignment
        self.index = self.cloud.index_high()
        self.seeds = trace.lines.inliers.position
        self.segments = _segments_of(trace.lines.clustering.segments.points, place.slot)
        """Entries of the point in the points of segments."""
        near = self._list_near()
        self.numbers = near[: MOST_WINDOWS]
        """Windows that reach over the point, the nearest first."""
        self.num_near = len(near)
        self.views = [view for window in self.numbers for view in self._look(window)]

    def tell(self) -> Finding:
        """Return the outcome of the point's clusters."""
        if not self.num_near and not len(self.segments):
            return Finding(stage='clustering', outcome='not asked', notes=(
                f'no window within {self.alignment.half_length:g} m along a line',))
        limits = self.settings.clustering
        checks: list[Check] = []
        notes = [
            f'{self.num_near} windows reach over it, {len(self.segments)} line segments hold it',
        ]
        for view in self.views:
            name = f'window {view.window}, eps {view.eps:g} m'
            if limits.method != 'dbscan':
                name = f'window {view.window}, k {view.needed}'
            if view.limit > limits.max_thickness:
                name = f'window {view.window}, undivided'
            if view.needed:
                kind = 'points within eps' if limits.method == 'dbscan' else 'reverse neighbours'
                checks.append(Check(
                    name=f'{name}: {kind}', value=view.neighbors, limit=view.needed,
                    setting='clustering.min_points',
                ))
            if view.size:
                checks += [
                    Check(name=f'{name}: points of the cluster', value=view.size,
                          limit=LEAST_POINTS),
                    Check(name=f'{name}: length', value=view.length,
                          limit=view.least_length, unit='m',
                          setting='alignment.half_length'),
                    Check(name=f'{name}: share of its parts filled', value=view.filling,
                          limit=MIN_FILLING),
                    Check(name=f'{name}: thickness (rms)', value=view.rms, limit=view.limit,
                          is_least=False, unit='m', setting='clustering.max_thickness'),
                    Check(name=f'{name}: crowding', value=view.crowding,
                          limit=view.max_crowding, is_least=False,
                          setting='clustering.max_crowding'),
                ]
            notes.append(f'{name}: {view.outcome}')
        checks = [item for item in checks if not math.isnan(item.value)]
        outcome = 'kept' if len(self.segments) else 'dropped'
        return Finding(
            stage='clustering', outcome=outcome, checks=tuple(checks), notes=tuple(notes)
        )

    def join(self) -> Iterator[Proposal]:
        """Yield settings that would have put the point into a segment, tried on its windows."""
        found: list[Proposal] = []
        for view in self.views:
            if view.is_own:
                found += self._propose(view)
        for item in rank(found)[:MOST_TRIALS]:
            if self._is_in_segment(apply([item], self.settings).clustering):
                yield item

    def _propose(self, view: ClusterView) -> Iterator[Proposal]:
        settings, figure = self.settings, f'window {view.window}'
        if view.neighbors < view.needed:
            yield from propose(
                settings, 'clustering.min_points', max(view.neighbors, LEAST_PROPOSED),
                True,
                f'{figure}: neighbours', view.neighbors,
            )
            for share in EPS_STEPS if settings.clustering.method == 'dbscan' else ():
                yield from propose(
                    settings, 'clustering.eps', settings.clustering.eps * share, False,
                    f'{figure}: points within eps', view.neighbors,
                )
        if view.rms > view.limit:
            for share in THICKNESS_STEPS:
                yield from propose(
                    settings, 'clustering.max_thickness', view.rms * share, False,
                    f'{figure}: thickness', view.rms,
                )
        if view.crowding > view.max_crowding:
            yield from propose(
                settings, 'clustering.max_crowding', view.crowding, False,
                f'{figure}: crowding', view.crowding,
            )

    def _list_near(self) -> list[int]:
        alignment = self.alignment
        offset = self.place.position - alignment.center
        ca, sa = np.cos(alignment.azimuth), np.sin(alignment.azimuth)
        along = ca * offset[:, 0] + sa * offset[:, 1]
        inside = np.abs(along) <= alignment.half_length
        distance = np.linalg.norm(offset, axis=1)
        near = np.flatnonzero(inside & (distance <= MOST_DISTANCE))
        order = near[np.argsort(distance[near], kind='stable')].tolist()
        return [window for window in order if self._select(window)[2] >= 0]

    def _select(self, window: int) -> tuple[Int32, tuple[Float64, Float64, Float64], int]:
        """Return the points of a window, their x, y, w, and which one is the point, -1 none."""
        chosen, x, y, w = gather_points(
            self.cloud.points, self.index, self.seeds, self.alignment, window
        )
        found = np.flatnonzero(chosen == self.place.slot)
        return chosen, (x, y, w), int(found[0]) if len(found) else -1

    def _look(self, window: int) -> Iterator[ClusterView]:
        """Follow the point's cluster through the attempts of a window."""
        limits, half = self.settings.clustering, self.alignment.half_length
        every, (x, y, w), own = self._select(window)
        at = np.array([x[own], y[own], w[own]])
        chosen, x, y, w = thin_window(every, x, y, w)
        is_own = bool((chosen == self.place.slot).any())
        if not is_own:
            yield ClusterView(
                window=window, neighbors=0, needed=0, eps=limits.eps, is_own=False,
                outcome=f'thinned out, as the window holds more than {MAX_WINDOW_POINTS}'
                        ' points; what follows is of the nearest that was kept',
            )
        own = int(np.argmin(np.linalg.norm(np.column_stack((x, y, w)) - at, axis=1)))
        needed = int(count_needed(y, w, limits.eps, limits.min_points))
        state = open_window(len(x))
        for attempt in attempt_window((x, y, w), state, needed, half, limits):
            rows, label = attempt.chosen, attempt.label
            place = np.flatnonzero(rows == own)
            if not len(place):
                continue
            fineness = FINENESS[attempt.number]
            neighbors = count_neighbors(
                limits.method, attempt.across, attempt.up, int(place[0]), limits.eps,
                attempt.needed, fineness,
            )
            view = ClusterView(
                window=window, neighbors=neighbors[0], needed=neighbors[1], is_own=is_own,
                outcome='noise across the line', eps=limits.eps / 2**fineness,
            )
            number = label[place[0]]
            if number >= 0:
                member = np.zeros(len(x), dtype=bool)
                member[rows[label == number]] = True
                pieces, piece, _ = find_pieces(
                    x, y, w, rows, label, attempt.limit, attempt.half
                )
                apart = find_apart(len(pieces), piece, state[0])
                view = self._judge(view, (x, y, w), member, apart, own, attempt)
            if number >= 0 or attempt.number < NUM_ATTEMPTS:
                yield view

    def _judge(
        self, view: ClusterView, places: tuple[Float64, Float64, Float64], member: Bool,
        apart: Bool, own: int, attempt: Attempt,
    ) -> ClusterView:
        """Return the view with the figures of the point's cluster, where others lie ``apart``."""
        x, y, w = places
        half, limit, crowding = attempt.half, attempt.limit, math.nan
        mx, my, mw, ky, kw, rms, low, high = fit_trimmed(x, y, w, member)
        size, length = int(member.sum()), float(high - low)
        filling = (
            float(measure_filling(x, member, low, high, half)) if size >= LEAST_POINTS else 0.0
        )
        if size < LEAST_POINTS:
            outcome = 'too few points'
        elif length < LEAST_SHARE * half:
            outcome = 'too short'
        elif filling < MIN_FILLING:
            outcome = 'with gaps'
        elif rms > limit:
            outcome = 'too thick'
        else:
            crowding = float(measure_crowding(
                x, y, w, mx, my, mw, ky, kw, rms, low, high, apart
            ))
            outcome = 'crowded' if crowding > attempt.max_crowding else 'segment'
        if outcome == 'segment' and not member[own]:
            outcome = 'trimmed off a segment'
        return replace(
            view, outcome=outcome, size=size, length=length, filling=filling, rms=float(rms),
            limit=limit, crowding=crowding, least_length=LEAST_SHARE * half,
            max_crowding=attempt.max_crowding,
        )

    def _is_in_segment(self, limits: ClusteringSettings) -> bool:
        for window in self.numbers:
            start = self.alignment.seed_start
            one: AlignmentResult = replace(
                self.alignment,
                center=self.alignment.center[window : window + 1],
                azimuth=self.alignment.azimuth[window : window + 1],
                slope=self.alignment.slope[window : window + 1],
                seed_start=(start[window : window + 2] - start[window]).astype(np.int32),
                seeds=self.alignment.seeds[start[window] : start[window + 1]],
            )
            segments, _ = find_segments(self.cloud.points, self.index, self.seeds, one, limits)
            if (segments.points == self.place.slot).any():
                return True
        return False


def _segments_of(points: np.ndarray, slot: int) -> Int64:
    result: Int64 = np.flatnonzero(points == slot) if slot >= 0 else np.zeros(0, dtype=np.int64)
    return result
