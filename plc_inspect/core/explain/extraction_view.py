# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Explains height, linearity, outliers and alignment at one point."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
import math

import numpy as np
from scipy.spatial import cKDTree

from plc_inspect.checks import Check
from plc_inspect.config import LinearitySettings, Settings
from plc_inspect.core.explain.proposals import (
    apply,
    chain,
    Finding,
    Proposal,
    propose,
    rank,
    SLACK,
)
from plc_inspect.core.extraction.alignment import NUM_BINS
from plc_inspect.core.extraction.linearity import (
    anchor,
    find_candidates,
    measure_likeness,
    STEEPEST_DEG,
)
from plc_inspect.core.extraction.occupancy import BULK_CELL, drop_bulk
from plc_inspect.core.extraction.off_ground import OffGround
from plc_inspect.core.labels import GROUND_BAND
from plc_inspect.core.numerics.voxels import build_voxels, coarsen
from plc_inspect.core.trace import Trace
from plc_inspect.results import Bool, Decision, Float64

MOST_TRIALS = 8
"""Most proposals for linearity tried on the cloud.  Source: numerical: bounds the time."""
ALL_CELLS = 27
"""Cells of a metre around a point, its own included.  Source: derived: 3 x 3 x 3."""
_FIGURES = {
    'min_neighbors': 'points',
    'threshold': 'linear likeness',
    'max_inclination_deg': 'inclination',
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighborhood:
    """The block of 27 voxels about one voxel at or near a point."""

    size: float
    """Edge [m]."""
    count: int
    linear: float
    planar: float
    spherical: float
    inclination_deg: float
    """Angle of its first eigenvector to the horizontal [deg]."""
    is_here: bool
    """Its centroid lies in the point's cell, so the point shares its candidate."""
    is_candidate: bool
    """It is linear, and no finer block in it is."""


class Place:
    """
    One point and its cell of a metre, which shares its candidates.

    Parameters
    ----------
    trace : Trace
        One run.
    settings : Settings
        Of that run.
    position : (3,) float64
        The point [m].
    index : int
        Its index in the cloud.

    """

    def __init__(self, trace: Trace, settings: Settings, position: Float64, index: int) -> None:
        self.trace, self.settings, self.index = trace, settings, index
        self.position = position
        self.decision = Decision(int(trace.result.decision[index]))
        found = np.flatnonzero(trace.lines.cloud.place == index)
        self.slot = int(found[0]) if len(found) else -1
        high = trace.lines.cloud.high
        at = int(np.searchsorted(high, self.slot))
        self.searched = self.slot >= 0 and at < len(high) and int(high[at]) == self.slot
        """The point was among those searched for wires."""
        self.here = self.holds(trace.lines.candidates.position)
        """(M,) candidates of its cell."""

    def holds(self, positions: Float64) -> Bool:
        """Tell which positions (M, 3) lie in the cell."""
        result: Bool = (np.floor(positions) == np.floor(self.position)).all(axis=1)
        return result

    def tell_height(self) -> Finding:
        """Return the height of the point against the threshold."""
        height = float(self.trace.result.ground_height[self.index])
        threshold = self.trace.lines.height.threshold
        if self.decision == Decision.NOT_FINITE:
            note = 'not finite, or isolated far away'
            return Finding(stage='height', outcome='dropped', notes=(note,))
        checks, notes = [], ['no ground is known below, so it counts as high']
        if not math.isnan(height):
            checks = [Check(
                name='height above ground', value=height, limit=threshold,
                setting='height.beta', unit='m',
            )]
            peak = threshold - self.settings.height.beta
            notes = [f'beta is counted from the peak of the histogram, at {peak:.2f} m']
        if height < GROUND_BAND:
            notes.append(f'within {GROUND_BAND} m of the ground surface, or below it: ground')
        if self._is_high() and not self.searched:
            notes.append(self._say_unused())
        return Finding(
            stage='height', outcome='kept' if self.searched else 'dropped',
            checks=tuple(checks), notes=tuple(notes),
        )

    def lift(self) -> Iterator[Proposal]:
        """Yield settings with which the point would have been searched."""
        trace, height = self.trace, float(self.trace.result.ground_height[self.index])
        if not self._is_high():
            peak = trace.lines.height.threshold - self.settings.height.beta
            yield from propose(
                self.settings, 'height.beta', height - peak, True, 'height above ground', height
            )
        elif not len(trace.lines.cloud.high):
            num = trace.result.num_points - trace.lines.height.num_not_finite
            yield from propose(
                self.settings, 'segment.min_points', num, True, 'points of the cloud', num
            )

    def tell_linearity(self) -> Finding:
        """Return how full the space around the point is, and how linear its neighbourhoods are."""
        if not self.searched:
            return Finding(stage='linearity', outcome='not asked')
        limits = self.settings.linearity
        checks = [Check(
            name='occupied cells of 27 about it', value=self.occupied,
            limit=limits.max_occupied, is_least=False, setting='linearity.max_occupied',
        )]
        notes = [] if checks[0].kept else self._say_bulky()
        for item in self._pick():
            name = f'in {item.size:g} m'
            checks += [
                Check(name=f'{name}: points', value=item.count, limit=limits.min_neighbors,
                      setting='linearity.min_neighbors'),
                Check(name=f'{name}: linear likeness', value=item.linear, limit=limits.threshold,
                      setting='linearity.threshold'),
                Check(name=f'{name}: inclination', value=item.inclination_deg,
                      limit=limits.max_inclination_deg, is_least=False,
                      setting='linearity.max_inclination_deg', unit='deg'),
                Check(name=f'{name}: planar likeness', value=item.planar),
                Check(name=f'{name}: spherical likeness', value=item.spherical),
            ]
            failed = [name for _, name in _fails(item, limits)]
            if failed == ['max_inclination_deg'] and item.inclination_deg <= STEEPEST_DEG:
                notes.append(f'{name}: searched as steep, after all that is nearly level')
            if not item.is_here:
                notes.append(f'{name}: its centre lies in another cell of a metre')
            elif not item.is_candidate and not _fails(item, limits):
                notes.append(f'{name}: a finer one says it already')
        num = int(self.here.sum())
        notes.append(f'{num} candidates in its cell of a metre')
        return Finding(
            stage='linearity', outcome='kept' if num else 'dropped', checks=tuple(checks),
            notes=tuple(notes),
        )

    def straighten(self) -> Iterator[Proposal]:
        """Yield settings with a candidate in the point's cell, tried on the cloud."""
        single, double = [], []
        for moves in self._list_moves():
            if len(moves) == 1:
                single.append(moves[0])
            elif len(moves) == 2:
                double.append(chain(moves))
        for proposals in (single, double):  # two settings only where one is not enough
            enough = [
                item for item in rank(proposals)[:MOST_TRIALS]
                if self._has_candidate(apply([item], self.settings).linearity)
            ]
            yield from enough
            if enough:
                return

    def tell_outliers(self) -> Finding:
        """Return how far the candidates of the cell are from others."""
        found = self._distances()
        if not len(found):
            return Finding(stage='outliers', outcome='not asked')
        result = self.trace.lines.outliers
        check = Check(
            name='mean distance to others', value=float(found.min()), limit=result.threshold,
            is_least=False, setting='outliers.sigma', unit='m',
        )
        note = f'mean of all {result.mean:.2f} m, standard deviation {result.sigma:.2f} m'
        kept = bool(result.keep[self.here].any())
        return Finding(
            stage='outliers', outcome='kept' if kept else 'dropped', checks=(check,),
            notes=(note,),
        )

    def gather(self) -> Iterator[Proposal]:
        """Yield what would have kept a candidate of the cell from being an outlier."""
        found, result = self._distances(), self.trace.lines.outliers
        if len(found) and result.sigma > 0.0:
            nearest = float(found.min())
            needed = (nearest - result.mean) / result.sigma
            yield from propose(
                self.settings, 'outliers.sigma', needed * (1 + SLACK), False,
                'mean distance to others', nearest,
            )

    def tell_alignment(self) -> Finding:
        """Return how many others lie in line with the candidates of the cell."""
        votes = self._votes()
        if not len(votes):
            return Finding(stage='alignment', outcome='not asked')
        check = Check(
            name=f'bins of {NUM_BINS} along its axis with others', value=int(votes.max()),
            limit=self.settings.alignment.min_votes, setting='alignment.min_votes',
        )
        return Finding(
            stage='alignment', outcome='kept' if check.kept else 'dropped', checks=(check,)
        )

    def line_up(self) -> Iterator[Proposal]:
        """Yield settings with which enough others would have been in line with a candidate."""
        votes = self._votes()
        if len(votes):
            most = int(votes.max())
            yield from propose(
                self.settings, 'alignment.min_votes', most, True, 'bins with others', most
            )

    @property
    def occupied(self) -> int:
        """Occupied cells among the 27 of a metre about the point."""
        cloud = self.trace.lines.cloud
        origin = anchor(cloud.points, cloud.high, self.settings.linearity)
        cells = np.floor((cloud.points[cloud.high] - origin) / BULK_CELL)
        own = np.floor((self.position - origin) / BULK_CELL)
        near = cells[(np.abs(cells - own) <= 1).all(axis=1)]
        return len(np.unique(near, axis=0))

    def _is_high(self) -> bool:
        return bool(self.trace.lines.height.high[self.index])

    def _say_unused(self) -> str:
        trace = self.trace
        if len(trace.lines.cloud.high) == 0:
            return 'the cloud has fewer points than segment.min_points; nothing was looked for'
        return 'the ground was estimated anew after the conductors were found'

    def _say_bulky(self) -> list[str]:
        notes = ['inside something bulky, so left out; neighbourhoods are of points about it']
        whole = replace(self.settings.linearity, max_occupied=ALL_CELLS)
        own = [item for item in self._measure(whole) if item.is_here]
        if own:
            best = max(own, key=lambda item: item.linear)
            notes.append(
                f'with nothing left out, the most linear one in its cell of a metre is of'
                f' {best.size:g} m: likeness {best.linear:.3f}, inclination'
                f' {best.inclination_deg:.1f} deg, {best.count} points'
            )
        return notes

    def _measure(self, limits: LinearitySettings) -> list[Neighborhood]:
        """Return the blocks about all voxels of the cell, and about that of the point."""
        cloud: OffGround = self.trace.lines.cloud
        origin = anchor(cloud.points, cloud.high, limits)
        sparse = drop_bulk(cloud.points, cloud.high, origin, limits.max_occupied)
        voxels = build_voxels(cloud.points, sparse, origin, limits.voxel_size)
        result = []
        for scale in range(limits.num_scales):
            voxels = coarsen(voxels) if scale else voxels
            likeness = measure_likeness(voxels)
            centroids = voxels.centroids()
            here = self.holds(centroids)
            index = np.floor((self.position - origin) / voxels.size).astype(np.int64)
            own = (voxels.index == index).all(axis=1)
            known = self.trace.lines.candidates.position[self.here]
            for slot in np.flatnonzero(here | own).tolist():
                up = min(abs(float(likeness.direction[slot, 2])), 1.0)
                result.append(Neighborhood(
                    size=3 * voxels.size,
                    count=int(likeness.count[slot]),
                    linear=float(likeness.linear[slot]),
                    planar=float(likeness.planar[slot]),
                    spherical=float(likeness.spherical[slot]),
                    inclination_deg=math.degrees(math.asin(up)),
                    is_here=bool(here[slot]),
                    is_candidate=bool((known == centroids[slot]).all(axis=1).any()),
                ))
        return result

    def _pick(self) -> list[Neighborhood]:
        """Return the most promising block of each scale."""
        limits = self.settings.linearity
        blocks: dict[float, Neighborhood] = {}
        for item in self._measure(limits):
            best = blocks.get(item.size)
            if best is None or _promise(item, limits) > _promise(best, limits):
                blocks[item.size] = item
        return list(blocks.values())

    def _list_moves(self) -> Iterator[list[Proposal]]:
        """Yield for each block of the cell the moves that make it a candidate."""
        limits, occupied = self.settings.linearity, self.occupied
        levels = [limits.max_occupied]
        if occupied > limits.max_occupied:
            levels += range(occupied, ALL_CELLS + 1)
        for level in levels:
            opened = list(propose(
                self.settings, 'linearity.max_occupied', level, False, 'occupied cells', occupied
            ))
            for item in self._measure(replace(limits, max_occupied=level)):
                fails = _fails(item, limits)
                moves = [
                    move for value, name in fails for move in propose(
                        self.settings, f'linearity.{name}', value, name != 'max_inclination_deg',
                        f'{_FIGURES[name]} in {item.size:g} m', value,
                    )
                ]
                if item.is_here and len(moves) == len(fails):
                    yield opened + moves

    def _has_candidate(self, limits: LinearitySettings) -> bool:
        cloud = self.trace.lines.cloud
        origin = anchor(cloud.points, cloud.high, limits)
        found = find_candidates(cloud.points, cloud.high, origin, limits)
        return bool(self.holds(found.position).any())

    def _distances(self) -> Float64:
        """Return the mean distances to others of the candidates in the cell [m]."""
        positions, num = self.trace.lines.candidates.position, self.settings.outliers.num_neighbors
        if not self.here.any() or len(positions) <= num:
            return np.zeros(int(self.here.sum()))
        distance, _ = cKDTree(positions).query(positions[self.here], k=num + 1)
        result: Float64 = distance[:, 1:].mean(axis=1)
        return result

    def _votes(self) -> np.ndarray:
        return self.trace.lines.alignment.votes[self.here[self.trace.lines.outliers.keep]]


def _fails(item: Neighborhood, limits: LinearitySettings) -> list[tuple[float, str]]:
    """Return why a block is no candidate: figures and the names of their limits."""
    tests = (
        (float(item.count), 'min_neighbors', item.count < limits.min_neighbors),
        (item.linear, 'threshold', item.linear < limits.threshold),
        (
            item.inclination_deg, 'max_inclination_deg',
            item.inclination_deg > limits.max_inclination_deg,
        ),
    )
    return [(value, name) for value, name, failed in tests if failed]


def _promise(item: Neighborhood, limits: LinearitySettings) -> tuple[float, ...]:
    return (
        float(item.is_candidate), float(item.is_here), -float(len(_fails(item, limits))),
        item.linear,
    )
