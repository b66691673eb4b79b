# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Returns of the beams in a random scene: ranges with errors, and the objects hit."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from plc_inspect.sim.random_scenes.surveys import Survey
from plc_inspect.sim.scenes.placement import PlacementSums
from plc_inspect.sim.scenes.scene import Scene
from plc_inspect.sim.surveys.airborne import LabelledCloud, snap
from plc_inspect.sim.surveys.ray_kernels import MISS
from plc_inspect.sim.surveys.raycast import build_world, cast, label_items, Labels, World

Float64 = NDArray[np.float64]

UNJUDGED = 0
"""Class of returns that mix two objects."""
_MIXING = 1.5
"""Distance along a beam below which two objects may give one return: half a pulse [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beams:
    """Beams of one strip."""

    origins: Float64
    """(N, 3) positions from which they are traced [m]."""
    directions: Float64
    """(N, 3) unit vectors."""
    reach: Float64
    """(N,) distances over which they are traced [m]."""
    skipped: Float64
    """(N,) distances from scanner to origin [m]."""
    offset: Float64
    """(3,) or (N, 3) displacement of their returns by errors of the survey [m]."""
    turn: Float64 | None = None
    """(N, 3, 3) rotation of their returns about the origins, by errors of the survey."""

    def put(self, points: Float64, beam: NDArray[np.int64]) -> Float64:
        """Return the mapped positions of returns (M, 3) of some beams (M,) [m]."""
        if self.turn is not None:
            eye = self.origins[beam]
            points = eye + np.einsum('nij,nj->ni', self.turn[beam], points - eye)
        return points + (self.offset if self.offset.ndim == 1 else self.offset[beam])


class Coverage:
    """The surveyed corridor as a grid of 1 m, for fast look-ups."""

    def __init__(self, scene: Scene) -> None:
        """Find the cells whose centre lies in the corridor, and the edge of the route there."""
        self.low = scene.route.min(axis=0) - scene.half_width
        high = scene.route.max(axis=0) + scene.half_width
        self.shape = np.ceil(high - self.low).astype(np.int64)
        x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in self.shape), indexing='ij')
        xy = self.low + np.column_stack([x.ravel(), y.ravel()])
        inside = np.flatnonzero(scene.covers(xy))
        gap = np.array([_measure_gap(xy[inside], *ends) for ends in pairwise(scene.route)])
        self.edge = np.full(len(xy), -1, dtype=np.int16)
        self.edge[inside] = gap.argmin(axis=0)

    def find(self, xy: Float64) -> NDArray[np.int16]:
        """Return the edge of the route at positions xy (N, 2), -1 outside."""
        cell = ((xy - self.low) // 1.0).astype(np.int64)
        good = ((cell >= 0) & (cell < self.shape)).all(axis=1)
        cell = np.where(good[:, None], cell, 0)
        return np.where(good, self.edge[cell[:, 0] * self.shape[1] + cell[:, 1]], -1)


def _measure_gap(xy: Float64, start: Float64, end: Float64) -> Float64:
    edge = end - start
    along = np.clip((xy - start) @ edge / (edge @ edge), 0.0, 1.0)
    return np.asarray(np.hypot(*(xy - start - along[:, None] * edge).T))


class Scanner:
    """Casts beams at one scene."""

    def __init__(self, scene: Scene, survey: Survey, rng: np.random.Generator) -> None:
        """Prepare the scene, and draw the visibility of each conductor."""
        self.scene, self.survey, self.rng = scene, survey, rng
        self.world: World = build_world(scene)
        self.labels: Labels = label_items(scene, self.world)
        weak = survey.dropout * rng.uniform(0.0, 1.0, scene.num_lines)
        self.kept = 1.0 - np.array([*(weak[item.line_id] for item in scene.conductors), 0.0])
        self.lines = np.array([*(item.line_id for item in scene.conductors), -1], dtype=np.int32)
        self.spans = np.array([*(item.span_id for item in scene.conductors), -1], dtype=np.int32)
        self.coverage = Coverage(scene)
        self.sums = [PlacementSums(item.lowest) for item in scene.conductors]
        self._key = int(rng.integers(2**61))

    @property
    def ceiling(self) -> float:
        """Height of the highest object [m]."""
        return max(float(self.world.top.max()), float(self.world.ground_top.max()))

    def measure(self, beams: Beams) -> LabelledCloud:
        """Return the points of beams, in the order of the beams."""
        survey, rng = self.survey, self.rng
        self._key += 1
        ranges, items = cast(
            self.world, beams.origins, beams.directions, beams.reach, survey.pattern.beam,
            self._key,
        )
        beam, order = np.nonzero(items != MISS)
        conductor = self.labels.conductor[items[beam, order]]
        seen = rng.random(len(beam)) < self.kept[conductor]
        beam, order, conductor = beam[seen], order[seen], conductor[seen]
        item, distance = items[beam, order], ranges[beam, order]
        direction = beams.directions[beam]
        exact = beams.origins[beam] + distance[:, None] * direction
        base, wire = exact.copy(), conductor >= 0
        exact[wire] = snap(exact[wire], self.world.curves[conductor[wire]])
        base[wire] = exact[wire] + survey.pattern.axis * (base[wire] - exact[wire])
        label = self.labels.label[item].copy()
        mixed = self._mix(beam, distance)
        base[mixed] += (rng.random(len(mixed)) * (distance[mixed + 1] - distance[mixed]))[
            :, None] * direction[mixed]
        exact[mixed], label[mixed], conductor[mixed] = base[mixed], UNJUDGED, -1
        total = distance + beams.skipped[beam]
        spread = survey.noise + survey.noise_growth * total
        points = base + (spread * rng.normal(size=len(total)))[:, None] * direction
        points += (survey.jitter * total)[:, None] * rng.normal(size=points.shape)
        cloud = LabelledCloud(
            points=beams.put(points, beam), exact=exact, label=label, conductor=conductor,
            line_id=self.lines[conductor], span_id=self.spans[conductor],
        )
        covered = self.coverage.find(exact[:, :2]) >= 0
        for number in np.unique(conductor[covered & (conductor >= 0)]):
            rows = covered & (conductor == number)
            self.sums[number].add(exact[rows], beams.put(exact[rows], beam[rows]))
        return cloud.take(covered)

    def _mix(self, beam: NDArray[np.int64], distance: Float64) -> NDArray[np.int64]:
        """Return the indices of returns (M,) that mix with the next one of their beam."""
        near = (beam[1:] == beam[:-1]) & (np.diff(distance) < _MIXING)
        near &= self.rng.random(len(near)) < self.survey.mixed
        return np.flatnonzero(near)
