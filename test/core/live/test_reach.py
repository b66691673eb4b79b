# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What a rule reaches is never thinned out, and its alarms live are those of the end."""

import numpy as np
from passage import fly
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.hazards.falling_trees import FALL_REACH
from plc_inspect.core.live.map_labels import label_points, measure_reach
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.live.window import CLOSE, LEAST_CLOSE
from plc_inspect.core.pipeline import Pipeline
from plc_inspect.offline.readers.catalogue import load_rules
from plc_inspect.results import Decision, HazardKind
from plc_inspect.setting_names import update

TREES = (10.5, 25.0)
"""Distances beside the outer conductor of the sample [m]."""


def make_settings(**changes):
    return update(Settings(), {name.replace('__', '.'): value for name, value in changes.items()})


def plant(distance, x, top=8.0):
    """Return a crown at a distance beside the sample's conductor at y = 1.2."""
    rng = np.random.default_rng(int(distance))
    crown = rng.normal(0.0, 1.0, (1500, 3))
    crown *= (rng.random(1500) ** (1 / 3) / np.linalg.norm(crown, axis=1))[:, None]
    return crown * [2.0, 2.0, 3.0] + [x, 1.2 + distance + 2.0, top]


@pytest.fixture(scope='module')
def cloud():
    """Return the made-up line over wide ground with two trees beside it."""
    x, y = (item.ravel() for item in np.mgrid[-5.0:125.0:0.8, -15.0:40.0:0.8])
    ground = np.column_stack([x, y, np.zeros(len(x))])
    trees = [plant(distance, x) for distance, x in zip(TREES, (30.0, 90.0), strict=True)]
    return np.vstack([make_sample(), ground, *trees])


@pytest.mark.parametrize(('distance', 'reached'), [(4.0, 0), (12.0, 1), (30.0, 2)])
@pytest.mark.parametrize('radius', [0.0, 0.6])
def test_what_a_rule_reaches_is_kept_whole(cloud, distance, reached, radius):
    settings = make_settings(hazards__warning_distance=distance, corridor__radius=radius)
    trace = Pipeline(settings).trace(cloud)
    labels = label_points(cloud, trace.models, trace.result, settings)
    for number, away in enumerate(TREES):
        crown = np.flatnonzero(
            (np.abs(cloud[:, 1] - 3.2 - away) < 2.0) & (cloud[:, 2] > 5.5) & (cloud[:, 2] < 8.0)
        )
        beside = cloud[crown, 1] - 1.2 < distance - 1.0
        if number < reached:
            assert beside.any()
            assert (labels[crown[beside]] == CLOSE).all()
        else:
            assert (labels[crown] != CLOSE).all()
    wire = trace.result.decision == Decision.WIRE
    assert (labels[wire] == Decision.WIRE).all()


def test_trees_that_can_fall_are_kept_whole(cloud):
    settings = make_settings(hazards__fall_distance=16.0)
    assert measure_reach(settings) == FALL_REACH
    assert measure_reach(Settings()) == LEAST_CLOSE
    trace = Pipeline(settings).trace(cloud)
    labels = label_points(cloud, trace.models, trace.result, settings)
    tall = (cloud[:, 1] > 9.0) & (cloud[:, 1] < 15.0) & (cloud[:, 2] > 9.0)
    assert tall.any()
    assert (labels[tall] == CLOSE).all()


@pytest.mark.parametrize(('rules', 'voltage', 'reach', 'name'), [
    ('nerc_fac_003_4', 765.0, 15.0, 'near'), ('sweden', 20.0, FALL_REACH, 'tall'),
])
def test_what_a_rule_set_reaches_is_kept_whole(cloud, rules, voltage, reach, name):
    settings = make_settings(
        hazards__rules=rules, hazards__voltage=voltage, hazards__elevation=100.0
    )
    limits = load_rules(settings.hazards)
    assert measure_reach(settings, limits) >= reach
    trace = Pipeline(settings, limits).trace(cloud)
    labels = label_points(cloud, trace.models, trace.result, settings, limits)
    crown = (cloud[:, 1] > 9.0) & (cloud[:, 1] < 15.0) & (cloud[:, 2] > 6.0)
    if name == 'tall':  # and high enough to fall on a conductor
        crown &= cloud[:, 2] > 10.5
    assert crown.any()
    assert (labels[crown] == CLOSE).all()


@pytest.mark.slow
@pytest.mark.parametrize(('distance', 'trees'), [(12.0, 1), (30.0, 2)])
def test_alarms_live_are_those_of_the_end(cloud, distance, trees):
    settings = make_settings(hazards__warning_distance=distance, corridor__radius=0.6)
    session, voxels, states = fly(cloud, 24, settings)
    _, result, _ = session.conclude(voxels.centroids(), settings, voxels.sequence, complete=True)
    planted = [item for item in result.hazards
               if item.kind == HazardKind.VEGETATION and item.position[1] > 8.0]
    assert len(planted) == trees
    live = {item.hazard_id for item in states[-1].hazards}
    assert {item.hazard_id for item in planted} <= live
    cleared = [item for state in states for item in state.news.cleared if item.position[1] > 8.0]
    assert not cleared
    reasons = [text for state in states for text in state.news.reasons]
    assert len(reasons) == sum(len(state.news.cleared) for state in states)
