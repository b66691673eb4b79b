# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The set-ups of the bench over the first seconds of the flight: one map, or the cause."""

import importlib
from pathlib import Path
import sys

import numpy as np
import pytest
from scipy.spatial import cKDTree

from plc_inspect.config import Settings
from plc_inspect.core.mapping.flown_way import FlownWay
from plc_inspect.core.setup.plumb import PlumbBook
from plc_inspect.core.setup.sharpness import Sharpness, SharpnessBook
from plc_inspect.errors import DataError
from plc_inspect.offline.commands.flight_run import replay
from plc_inspect.offline.readers.bag_map import accumulate, check_used
from plc_inspect.offline.readers.bags import Recording
from plc_inspect.setting_names import update

sys.path.insert(0, str(Path(__file__).parents[2] / 'bench'))
setups = importlib.import_module('common.setups')
sys.path.pop(0)
BLURRED = [item for item in setups.SETUPS if item.cause == setups.NOT_SHARP]
WHOLE = [item for item in setups.SETUPS if not item.cause]
ON_ITS_HEAD = [item for item in setups.SETUPS if item.cause == setups.ON_ITS_HEAD]
REFUSED = [
    item for item in setups.SETUPS if item.cause and item not in [*BLURRED, *ON_ITS_HEAD]
]


@pytest.fixture(scope='session')
def flight():
    """Return every second scan of three seconds of the demo flight."""
    return setups.read_flight(step=2, seconds=3.0)


@pytest.fixture(scope='session')
def expected(flight, tmp_path_factory):
    """Return the map of the flight as it was recorded."""
    return read_map(setups.SETUPS[0], flight, tmp_path_factory.mktemp('expected'))


def read_map(setup, flight, folder):
    """Record the flight as a vehicle does, and return the map that is made of it."""
    bag = setups.write_bag(folder / 'bag', flight, setup.layout)
    settings = update(Settings(), dict(setup.settings))
    topics = settings.input.scan_topic, settings.input.odometry_topic
    with Recording(bag, *topics, settings.input) as recording:
        accumulator = accumulate(recording, settings)
        check_used(recording, accumulator, settings)
    return accumulator


@pytest.mark.parametrize('setup', WHOLE, ids=lambda item: item.name)
def test_other_vehicles_make_the_same_map(setup, flight, expected, tmp_path):
    found = read_map(setup, flight, tmp_path)
    own, other = found.counters(), expected.counters()
    assert own.num_scans_inserted == other.num_scans_inserted >= len(flight.scans) - 2
    assert own.num_points_inserted == pytest.approx(other.num_points_inserted, rel=1e-3)
    apart, _ = cKDTree(expected.map.centroids()).query(found.map.centroids())
    assert np.quantile(apart, 0.9) < (0.02 if setup.layout.pose_step == 1 else 0.1)
    assert found.placer.mount.doubt == '' or setup.layout.fixed


@pytest.mark.parametrize('setup', REFUSED, ids=lambda item: item.name)
def test_what_cannot_be_is_refused_with_its_cause(setup, flight, tmp_path):
    with pytest.raises(DataError, match=setup.cause):
        read_map(setup, flight, tmp_path)


def test_settings_that_contradict_tf_are_said(flight, tmp_path):
    layout = setups.Layout(mount=setups.TILT, fixed=setups.ON_TF)
    given = {'input.lidar_rpy_deg': [0.0, 25.0, 0.0]}
    setup = setups.Setup(name='', layout=layout, settings=given)
    assert '5.0 degrees off' in read_map(setup, flight, tmp_path).placer.mount.doubt


@pytest.fixture(scope='session')
def longer_flight():
    """Return every second scan of as long as it takes to see that a map is not sharp."""
    return setups.read_flight(step=2, seconds=11.0)


@pytest.mark.parametrize('setup', [setups.SETUPS[0], *BLURRED], ids=lambda item: item.name)
def test_a_mount_that_nobody_told_is_not_sharp(setup, longer_flight, tmp_path):
    flight = longer_flight
    book = SharpnessBook()
    bag = setups.write_bag(tmp_path / 'bag', flight, setup.layout)
    with Recording(bag, 'velodyne_points', 'odometry') as recording:
        accumulate(recording, Settings(), book=book)
    found = book.judge()
    assert found.poor == bool(setup.cause)
    assert setup.cause in found.describe()


@pytest.mark.parametrize('setup', [*ON_ITS_HEAD, *WHOLE[-2:]], ids=lambda item: item.name)
def test_a_map_on_its_head_is_told_by_its_ground(setup, longer_flight, tmp_path):
    book, way = PlumbBook(), FlownWay()
    bag = setups.write_bag(tmp_path / 'bag', longer_flight, setup.layout)
    settings = update(Settings(), dict(setup.settings))
    topics = settings.input.scan_topic, settings.input.odometry_topic
    with Recording(bag, *topics, settings.input) as recording:
        found = accumulate(recording, settings, way=way)
    book.look(found.map.centroids(), way.places[:, 1:])
    assert book.leans.sides.known
    judged = book.judge(Sharpness(num_cells=100, blur=0.4))
    assert judged.hopeless == judged.poor == bool(setup.cause)
    assert setup.cause in judged.describe()


@pytest.mark.parametrize('setup', ON_ITS_HEAD, ids=lambda item: item.name)
def test_a_map_on_its_head_is_refused_for_that_and_nothing_else(setup, longer_flight, tmp_path):
    bag = setups.write_bag(tmp_path / 'bag', longer_flight, setup.layout)
    with pytest.raises(DataError, match=setup.cause):
        replay(bag, update(Settings(), dict(setup.settings)))
