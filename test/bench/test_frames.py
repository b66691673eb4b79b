# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The bench of real clouds in frames: what it cuts, and what it counts as lost."""

import importlib
from pathlib import Path
import sys

import numpy as np
import pytest

from plc_inspect.config import Settings

BENCH = Path(__file__).parents[2] / 'bench'


@pytest.fixture(scope='module')
def bench():
    """Import the bench as it is when it is run as a script."""
    sys.path.insert(0, str(BENCH))
    try:
        yield importlib.import_module('frames')
    finally:
        sys.path.remove(str(BENCH))


@pytest.fixture
def cloud(bench):
    """Return a conductor of 200 m over ground, as a labelled cloud."""
    rng = np.random.default_rng(1)
    x = np.linspace(0.0, 200.0, 1600)
    wire = np.column_stack([x, np.zeros(1600), 12.0 + (x - 100.0) ** 2 / 2000.0])
    ground = np.column_stack([rng.uniform((-5.0, -30.0), (205.0, 30.0), (40000, 2)),
                              np.zeros(40000)])
    points = np.vstack([wire, ground])
    points = points + rng.normal(0.0, 0.02, points.shape)
    label = np.repeat(np.array([14, 2], dtype=np.uint8), [1600, 40000])
    return bench.Cloud(name='line', points=points, label=label)


@pytest.mark.parametrize('seed', range(5))
def test_a_cut_is_so_long_and_holds_wire(bench, cloud, seed):
    inside = bench.cut(cloud, 0.4, np.random.default_rng(seed))
    plan = cloud.points[inside, :2]
    diagonal = 0.4 * 210.0 * np.hypot(1.0, bench.BREADTH)
    assert np.linalg.norm(np.ptp(plan, axis=0)) <= diagonal * np.sqrt(2.0)
    assert 3000 < inside.sum() < 0.6 * len(inside)
    assert (cloud.label[inside] == 14).any()


def test_what_the_whole_has_and_a_frame_has_not_is_lost(bench, cloud):
    change = bench.Change(thin=0.5, noise=0.01, cut=0.6)
    first, *moved = bench.run(cloud, Settings(), [change], 3, np.random.default_rng(0))
    assert (first.loss, first.num_spans) == (0.0, 1)
    assert first.recall > 0.99
    for item in moved:
        assert item.loss == pytest.approx(0.0, abs=0.02)
        assert 0 < item.num_spans < 3
    blind = bench.Change(thin=0.004, noise=0.0, cut=1.0)
    lost = list(bench.run(cloud, Settings(), [blind], 1, np.random.default_rng(0)))[1]
    assert (lost.num_spans, lost.recall) == (0, 0.0)
    assert lost.loss > 0.9
