# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench of planted random scenes: what it counts, on a scene of which nothing is raised."""

import importlib
from pathlib import Path
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from plc_inspect.results import HazardKind
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.scenes.scene import Label

pytestmark = pytest.mark.slow

STUDIES = Path(__file__).parents[2] / 'bench/studies'
SEED = 103


@pytest.fixture(scope='module')
def bench():
    """Import the bench as it is when it is run as a script."""
    before = list(sys.path)
    sys.path.insert(0, str(STUDIES))
    try:
        yield importlib.import_module('planted_hazards')
    finally:
        sys.path[:] = before


@pytest.fixture(scope='module')
def planted(bench):
    """Make one scene."""
    return bench.make_planted(SEED)


def test_things_are_planted_on_both_sides_and_the_rest_stays(bench, planted):
    judged = bench.judge(SEED, planted, SimpleNamespace(hazards=(), spans=()))
    margins = [item.margin for item in judged.items]
    assert len(margins) >= 5
    assert min(margins) < 0.0 < max(margins)
    assert len(planted.made.cloud.points) == len(planted.made.cloud.exact)


def test_what_is_not_raised_is_missed_for_want_of_a_conductor(bench, planted):
    judged = bench.judge(SEED, planted, SimpleNamespace(hazards=(), spans=()))
    missed = [item for item in judged.items if item.missed]
    assert missed
    assert not any(item.known or item.raised for item in missed)
    assert judged.num_faults == 0


def test_distances_are_to_the_surface_of_the_nearest_conductor(bench, planted):
    scene = planted.made.scene
    item = scene.conductors[0]
    points = item.locate(np.array([0.3, 0.6]) * item.length) + np.array([0.0, 0.0, 1.5])
    away, which = bench.measure_surfaces(points, scene, 60.0)
    every = [measure_distances(points, other) - other.radius for other in scene.conductors]
    assert away == pytest.approx(np.min(every, axis=0))
    assert which.tolist() == np.argmin(every, axis=0).tolist()


@pytest.mark.parametrize(('label', 'kind', 'distance', 'why'), [
    (Label.WIRE, HazardKind.VEGETATION, 1.0, 'on the line'),
    (Label.GROUND, HazardKind.STRUCTURE, 1.0, 'on the ground'),
    (0, HazardKind.VEGETATION, 1.0, 'on a mixed return'),
    (Label.VEGETATION, HazardKind.VEGETATION, 4.3, 'beyond the limit'),
    (Label.VEGETATION, HazardKind.VEGETATION, 4.05, ''),
    (Label.VEGETATION, HazardKind.FALL_IN, 12.0, ''),
])
def test_a_hazard_that_is_none_says_why(bench, label, kind, distance, why):
    hazard = SimpleNamespace(kind=kind, sigma=0.05)
    assert bench.find_fault(hazard, int(label), distance) == why
