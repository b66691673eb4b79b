# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the windows of the clustering saw of one point."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
import math

import numpy as np

from plc_inspect.config import ClusteringSettings, Settings
from plc_inspect.core.alignment import AlignmentResult
from plc_inspect.core.beads import (
    count_needed,
    find_beads,
    fit_trimmed,
    MAX_WINDOW_POINTS,
    measure_crowding,
    measure_filling,
    NUM_EPS,
)
from plc_inspect.core.checks import apply, Check, Finding, Proposal, propose, rank
from plc_inspect.core.dbscan import dbscan_plane
from plc_inspect.core.off_ground import CELL
from plc_inspect.core.place_story import Place
from plc_inspect.core.plan_index import build_plan_index, gather_strip
from plc_inspect.results import Float64, Int64

GRID = 0.5
"""Edge of the cells of a window's cross-section that its candidates open [m]."""
MIN_FILLING = 0.4
"""Share of its metres in which a bead holds points."""
MOST_WINDOWS = 4
MOST_TRIALS = 12
"""Windows that are told of, and proposals that are tried on them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusterView:
    """One attempt at the cluster that a point belongs to, in one window."""

    window: int
    outcome: str
    """'bead', or why it is none."""
    neighbors: int
    """Points within eps across the line, the point included."""
    needed: int
    """Points of a core neighbourhood in this window."""
    eps: float
    size: int = 0
    length: float = math.nan
    filling: float = math.nan
    rms: float = math.nan
    limit: float = math.nan
    """Of the rms in this attempt."""
    crowding: float = math.nan
    is_own: bool = True
    """It is of the point itself, else of the nearest that was not thinned out."""


class Windows:
    """The windows that hold one point, and how its clusters fared in them."""

    def __init__(self, place: Place) -> None:
        """Take the place of the point."""
        trace, self.place = place.trace, place
        self.settings: Settings = place.settings
        self.cloud, self.alignment = trace.cloud, trace.alignment
        self.index = build_plan_index(self.cloud.points, self.cloud.high, CELL)
        self.seeds = trace.inliers.position
        self.beads = _beads_of(trace.clustering.beads.points, place.slot)
        """Entries of the point in the points of beads."""
        near = self._list_near()
        self.numbers = near[: MOST_WINDOWS]
        """Windows that reach over the point, the nearest first."""
        self.num_near = len(near)
        self.views = [view for window in self.numbers for view in self._look(window)]

    def tell(self) -> Finding:
        """Return how the clusters of the point fared."""
        if not self.num_near and not len(self.beads):
            return Finding(stage='clustering', outcome='not asked', notes=(
                f'no window within {self.alignment.half_length:g} m along a line',))
        limits = self.settings.clustering
        checks: list[Check] = []
        notes = [f'{self.num_near} windows reach over it, {len(self.beads)} beads hold it']
        for view in self.views:
            name = f'window {view.window}, eps {view.eps:g} m'
            if view.limit > limits.max_thickness:
                name = f'window {view.window}, undivided'
            if view.needed:
                checks.append(Check(
                    name=f'{name}: points within eps', value=view.neighbors, limit=view.needed,
                    setting='clustering.min_points',
                ))
            if view.size:
                checks += [
                    Check(name=f'{name}: points of the cluster', value=view.size, limit=4),
                    Check(name=f'{name}: length', value=view.length,
                          limit=0.5 * self.alignment.half_length, unit='m',
                          setting='alignment.half_length'),
                    Check(name=f'{name}: share of metres filled', value=view.filling,
                          limit=MIN_FILLING),
                    Check(name=f'{name}: thickness (rms)', value=view.rms, limit=view.limit,
                          is_least=False, unit='m', setting='clustering.max_thickness'),
                    Check(name=f'{name}: crowding', value=view.crowding,
                          limit=limits.max_crowding, is_least=False,
                          setting='clustering.max_crowding'),
                ]
            notes.append(f'{name}: {view.outcome}')
        checks = [item for item in checks if not math.isnan(item.value)]
        outcome = 'kept' if len(self.beads) else 'dropped'
        return Finding(
            stage='clustering', outcome=outcome, checks=tuple(checks), notes=tuple(notes)
        )

    def join(self) -> Iterator[Proposal]:
        """Yield what would have put the point into a bead, tried on its windows."""
        found: list[Proposal] = []
        for view in self.views:
            if view.is_own:
                found += self._propose(view)
        for item in rank(found)[:MOST_TRIALS]:
            if self._is_in_bead(apply([item], self.settings).clustering):
                yield item

    def _propose(self, view: ClusterView) -> Iterator[Proposal]:
        settings, figure = self.settings, f'window {view.window}'
        if view.neighbors < view.needed:
            yield from propose(
                settings, 'clustering.min_points', max(view.neighbors, 4), True,
                f'{figure}: points within eps', view.neighbors,
            )
            for share in (1.25, 1.5, 2.0, 3.0):
                yield from propose(
                    settings, 'clustering.eps', settings.clustering.eps * share, False,
                    f'{figure}: points within eps', view.neighbors,
                )
        if view.rms > view.limit:
            for share in (0.5, 1.0):  # what is not divided may be twice as thick
                yield from propose(
                    settings, 'clustering.max_thickness', view.rms * share, False,
                    f'{figure}: thickness', view.rms,
                )
        if view.crowding > settings.clustering.max_crowding:
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
        near = np.flatnonzero(inside & (distance <= 60.0))
        order = near[np.argsort(distance[near], kind='stable')].tolist()
        return [window for window in order if self._select(window)[1] >= 0]

    def _select(self, window: int) -> tuple[Int64, int, Float64]:
        """Return the points of a window, which of them the point is, and x, y, w of all."""
        alignment, points = self.alignment, self.cloud.points
        ca, sa = math.cos(alignment.azimuth[window]), math.sin(alignment.azimuth[window])
        own = alignment.seeds[alignment.seed_start[window] : alignment.seed_start[window + 1]]
        center, rise = alignment.center[window], alignment.slope[window]

        def turn(positions: Float64) -> tuple[Float64, Float64, Float64]:
            dx, dy, dz = (positions - center).T
            x = ca * dx + sa * dy
            return x, ca * dy - sa * dx, dz - rise * x

        _, y, w = turn(self.seeds[own])
        low = np.array([y.min(), w.min()])
        high = np.array([y.max(), w.max()])
        shape = ((high - low) / GRID).astype(np.int64) + 7
        allowed = np.zeros(shape, dtype=bool)
        for iy, iw in ((np.stack([y, w], axis=1) - low) / GRID).astype(np.int64) + 3:
            allowed[iy - 2 : iy + 3, iw - 2 : iw + 3] = True
        half, reach = alignment.half_length, max(abs(low[0]), abs(high[0])) + 1.5
        index = self.index
        near = gather_strip(
            index.start, index.order, index.origin, index.cell_size, *index.shape,
            center[0] - half * ca, center[1] - half * sa,
            center[0] + half * ca, center[1] + half * sa, reach,
        )
        x, y, w = turn(points[near])
        cell = ((np.stack([y, w], axis=1) - low) / GRID + 3).astype(np.int64)
        inside = (np.abs(x) <= half) & (cell >= 0).all(axis=1) & (cell < shape).all(axis=1)
        inside[inside] = allowed[cell[inside, 0], cell[inside, 1]]
        chosen = near[inside]
        found = np.flatnonzero(chosen == self.place.slot)
        return chosen, int(found[0]) if len(found) else -1, np.stack([x, y, w])[:, inside]

    def _look(self, window: int) -> Iterator[ClusterView]:
        """Follow the point's cluster through the attempts of a window."""
        limits: ClusteringSettings = self.settings.clustering
        half = self.alignment.half_length
        chosen, own, (x, y, w) = self._select(window)
        is_own = True
        if len(chosen) > MAX_WINDOW_POINTS:
            step = -(-len(chosen) // MAX_WINDOW_POINTS)
            away = np.hypot(np.hypot(x - x[own], y - y[own]), w - w[own])[::step]
            x, y, w = (np.ascontiguousarray(values[::step]) for values in (x, y, w))
            if own % step:
                is_own = False
                yield ClusterView(
                    window=window, neighbors=0, needed=0, eps=limits.eps, is_own=False,
                    outcome=f'thinned out, as the window holds more than {MAX_WINDOW_POINTS}'
                            ' points; what follows is of the nearest that was kept',
                )
            own = int(np.argmin(away))
        needed = int(count_needed(y, w, limits.eps, limits.min_points))
        open_mask = np.ones(len(x), dtype=bool)
        first = np.full(len(x), -1)
        used = np.zeros(len(x), dtype=bool)
        for attempt in range(NUM_EPS + 1):
            eps, limit = limits.eps / 2**attempt, limits.max_thickness
            if attempt < NUM_EPS:
                rows = np.flatnonzero(open_mask)
                label = (
                    dbscan_plane(y[rows], w[rows], eps, needed) if len(rows) >= 4 else rows[:0]
                )
            else:
                divided = np.unique(first[used & (first >= 0)])
                rows = np.flatnonzero(~used & (first >= 0) & ~np.isin(first, divided))
                label, eps, limit = first[rows], limits.eps, 2.0 * limits.max_thickness
            if not len(label):
                if attempt < NUM_EPS:
                    continue
                return
            if attempt == 0:
                first[:] = label
            open_mask[:] = False
            for number in range(int(label.max()) + 1):
                member = np.zeros(len(x), dtype=bool)
                member[rows[label == number]] = True
                mine = bool(member[own])
                view = self._judge(window, x, y, w, member, own, eps, limit, needed, half)
                if view.outcome == 'too thick':
                    open_mask |= member
                elif view.outcome in ('bead', 'trimmed off a bead'):
                    used |= member
                if mine:
                    yield replace(view, is_own=is_own)
            at = np.flatnonzero(rows == own)
            if len(at) and label[at[0]] < 0:
                near = np.hypot(y[rows] - y[own], w[rows] - w[own]) <= eps
                yield ClusterView(window=window, outcome='noise across the line', eps=eps,
                                  neighbors=int(near.sum()), needed=needed, is_own=is_own)

    def _judge(
        self, window: int, x: Float64, y: Float64, w: Float64, member: np.ndarray, own: int,
        eps: float, limit: float, needed: int, half: float,
    ) -> ClusterView:
        limits = self.settings.clustering
        neighbors = int((np.hypot(y - y[own], w - w[own]) <= eps).sum())
        had = bool(member[own])
        mx, my, mw, ky, kw, rms, low, high = fit_trimmed(x, y, w, member)
        size, length = int(member.sum()), float(high - low)
        filling = float(measure_filling(x, member, low, high)) if size >= 4 else 0.0
        crowding = math.nan
        if size < 4:
            outcome = 'too few points'
        elif length < 0.5 * half:
            outcome = 'too short'
        elif filling < MIN_FILLING:
            outcome = 'with gaps'
        elif rms > limit:
            outcome = 'too thick'
        else:
            crowding = float(measure_crowding(x, y, w, member, mx, my, mw, ky, kw, rms))
            outcome = 'crowded' if crowding > limits.max_crowding else 'bead'
        if outcome == 'bead' and had and not member[own]:
            outcome = 'trimmed off a bead'
        return ClusterView(
            window=window, outcome=outcome, neighbors=neighbors, needed=needed, eps=eps,
            size=size, length=length, filling=filling, rms=float(rms), limit=limit,
            crowding=crowding,
        )

    def _is_in_bead(self, limits: ClusteringSettings) -> bool:
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
            beads, _ = find_beads(self.cloud.points, self.index, self.seeds, one, limits)
            if (beads.points == self.place.slot).any():
                return True
        return False


def _beads_of(points: np.ndarray, slot: int) -> Int64:
    result: Int64 = np.flatnonzero(points == slot) if slot >= 0 else np.zeros(0, dtype=np.int64)
    return result
