# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Random scenes with clouds and truth, from a seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from plc_inspect.sim.random_scenes.airborne import fly_strips
from plc_inspect.sim.random_scenes.moving import drive, follow
from plc_inspect.sim.random_scenes.returns import Beams, Scanner
from plc_inspect.sim.random_scenes.scenes import Kind, KINDS, make_random_scene
from plc_inspect.sim.random_scenes.surveys import draw_survey, PuckFlight, PushBroom, Survey
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.placement import place_truth, Placement, solve_placements
from plc_inspect.sim.scenes.scene import Label, Scene
from plc_inspect.sim.surveys.airborne import join, LabelledCloud
from plc_inspect.sim.surveys.truth import collect_sightings, make_truth

Float64 = NDArray[np.float64]

CLEAN = 2.0
"""Least distance of foreign objects from a clean conductor-span [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RandomScene:
    """A surveyed random scene."""

    scene: Scene
    survey: Survey
    cloud: LabelledCloud
    truth: dict[str, Any]
    """Content of ``truth.json`` as mapped; each span also has 'clean' and 'covered'."""

    @property
    def text(self) -> str:
        """Short description."""
        return f'{self.scene.name}; {self.survey.pattern.text}'


def make_random(seed: int, kind: Kind = 'any') -> RandomScene:
    """
    Make a random scene, survey it and compute its truth.

    Parameters
    ----------
    seed : int
        Seed of all randomness; the same seed and kind give the same bytes.
    kind : str
        One of `plc_inspect.sim.random_scenes.scenes.KINDS`.

    Returns
    -------
    RandomScene

    Raises
    ------
    DataError
        The kind is unknown.

    """
    rng = np.random.default_rng([seed, len(KINDS)])
    survey = draw_survey(rng)
    return measure_scene(make_random_scene(seed, kind, survey), survey, rng)


def measure_scene(scene: Scene, survey: Survey, rng: np.random.Generator) -> RandomScene:
    """Survey a scene and compute its truth."""
    scanner = Scanner(scene, survey, rng)
    cloud = join([scanner.measure(beams) for beams in _move(scanner, rng)])
    truth = make_truth(
        scene, collect_sightings(scene, cloud.exact, cloud.label, cloud.conductor), kind='map',
        frame_id='map', bin_size=1.0, noise=survey.noise,
    )
    for row, gap in zip(truth['spans'], measure_gaps(scene, cloud), strict=True):
        row['clean'] = bool(gap >= CLEAN)
    for row, item in zip(truth['spans'], scene.conductors, strict=True):
        row['covered'] = float((scanner.coverage.find(item.sample(0.5)[:, :2]) >= 0).mean())
    placements = solve_placements(scene.conductors, scanner.sums)
    middle = Placement(centre=np.zeros(3), yaw=0.0, shift=np.zeros(3))
    return RandomScene(
        scene=scene, survey=survey, cloud=cloud, truth=place_truth(truth, placements, middle),
    )


def _move(scanner: Scanner, rng: np.random.Generator) -> Iterator[Beams]:
    """Yield the beams of the survey of a scanner."""
    pattern = scanner.survey.pattern
    if isinstance(pattern, PushBroom):
        return drive(scanner, pattern, rng)
    if isinstance(pattern, PuckFlight):
        return follow(scanner, pattern, rng)
    return fly_strips(scanner, pattern, rng)


def measure_gaps(scene: Scene, cloud: LabelledCloud) -> Float64:
    """
    Return the distances (C,) of foreign objects from conductor-spans, inf if there are none [m].

    Foreign objects are ground, vegetation, buildings and others that were seen, and conductors
    and supports of other lines; but not mixed returns, which the line causes itself.
    """
    gaps = np.full(len(scene.conductors), np.inf)
    if not len(gaps):
        return gaps
    group = group_conductors(scene)
    foreign = cloud.exact[np.isin(cloud.label, (
        Label.OTHER, Label.GROUND, Label.VEGETATION, Label.BUILDING,
    ))]
    curves = [item.sample(0.5) for item in scene.conductors]
    near, _ = cKDTree(np.vstack(curves)).query(foreign, distance_upper_bound=CLEAN + 0.5)
    foreign = foreign[np.isfinite(near)]
    towers = cloud.exact[cloud.label == Label.TOWER]
    feet = np.array([post.position[:2] for post in scene.posts])
    owner = np.array([post.line_ids[0] for post in scene.posts])
    _, nearest = cKDTree(feet).query(towers[:, :2])
    for number, item in enumerate(scene.conductors):
        other = [
            foreign, towers[owner[nearest] != group[number]],
            *(curves[k] for k in np.flatnonzero(group != group[number])),
        ]
        gaps[number] = measure_distances(np.vstack(other), item).min(initial=np.inf)
    return gaps


def group_conductors(scene: Scene) -> NDArray[np.int64]:
    """Return for each conductor (C,) the first line id of those on its supports."""
    owner = {}
    for post in scene.posts:
        for line_id in post.line_ids:
            owner[line_id] = post.line_ids[0]
    return np.array([owner.get(item.line_id, item.line_id) for item in scene.conductors])
