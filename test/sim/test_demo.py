# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The demo recording that is shipped: size, content and truth."""

import json
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

from plc_inspect.sim.scenes.catalogue import make_scene
from plc_inspect.sim.scenes.conductors import measure_distances
from plc_inspect.sim.surveys.flight import PLANS

DEMO = Path(__file__).parents[2] / 'bags' / 'demo'
SEED = 7


def test_demo_is_small_and_short():
    """At most 12 MB in all and a minute of flight at 10 Hz."""
    assert sum(file.stat().st_size for file in DEMO.iterdir()) <= 12_000_000
    with AnyReader([DEMO], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        assert 45.0 <= reader.duration * 1e-9 <= 60.0
        counts = {item.topic: item.msgcount for item in reader.connections}
    truth = json.loads((DEMO / 'truth.json').read_text())
    assert counts['/velodyne_points'] == truth['num_scans']
    assert counts['/odometry'] >= 45 * 50


def test_demo_shows_what_it_should():
    """Three spans or more with an angle, all seen, and three hazards that must be found."""
    truth = json.loads((DEMO / 'truth.json').read_text())
    spans = truth['spans']
    assert len({row['span_id'] for row in spans}) >= 3
    assert all(row['seen'] >= 0.6 for row in spans)
    azimuth = np.degrees([row['azimuth'] for row in spans if row['line_id'] == 0])
    assert np.abs(np.diff(azimuth)).max() > 15.0
    clearances = sorted(row['clearance'] for row in truth['hazards'] if row['required'])
    np.testing.assert_allclose(clearances, [1.0, 1.5, 3.0], atol=0.1)


def test_demo_truth_is_that_of_its_scene():
    """In the world the truth's conductors are those that the scene has today."""
    truth = json.loads((DEMO / 'truth.json').read_text())
    scene = make_scene('demo', SEED)
    assert truth['seed'] == SEED
    assert 'demo' in PLANS
    for row, item in zip(truth['spans'], scene.conductors, strict=True):
        ends = np.array([row['world']['start'], row['world']['end']])
        assert measure_distances(ends, item).max() < 1e-6
        assert row['c'] == item.c
