# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The keeper of the flight record without a graph: what it resumes, and what it gives up."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rig import BASE, make_cloud

from plc_inspect.config import InputSettings, MapSettings, OutputSettings, Settings
from plc_inspect.core.live.session import Session
from plc_inspect.flight_record.reader import read_flight
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.offline.readers.catalogue import load_rules
from plc_inspect.ros.background.saving import Saved
from plc_inspect.ros.node.diagnostics import Health
from plc_inspect.ros.node.intake import Intake
from plc_inspect.ros.node.keeper import Keeper
from plc_inspect.ros.node.watch import InputWatch

POINTS = np.random.default_rng(0).uniform(3.0, 9.0, (500, 3))
INFO = {}


class Onboard:
    """What the node does with its intake and its keeper."""

    def __init__(self, folder, **settings):
        self.settings = Settings(
            input=InputSettings(**settings), map=MapSettings(max_voxels=100_000),
            output=OutputSettings(directory=str(folder / 'out'), record=True),
        )
        self.said, self.forgotten = [], []
        self.intake = Intake(self.settings, Health(), self.said.append)
        self.keeper = Keeper(
            self.settings, load_rules(self.settings.hazards), self.intake,
            SimpleNamespace(info=self.said.append, error=self.said.append), self.forget,
        )
        self.goes_on = self.keeper.resume(Session())

    def forget(self, reason):
        self.forgotten.append((reason, self.intake.first_stamp))

    def fly(self, start, seconds):
        """Take poses at 50 Hz and scans at 10 Hz, from a time after BASE on [s]."""
        for number in range(round(seconds * 50)):
            stamp = round((BASE + start + number * 0.02) * 1e9)
            self.intake.take_odometry(make_pose(stamp))
            if number % 5 == 4:
                cloud = make_cloud(POINTS, start + number * 0.02 - 0.01)
                self.intake.take_scan(cloud, INFO)
        self.keeper.step()

    def mount(self, height):
        """Take a mount of /tf_static [m]."""
        self.intake.take_fixed(make_fixed('base_link', 'velodyne', height))

    @property
    def counters(self):
        return self.intake.accumulator.counters()

    def crash(self):
        """End as a crash does, with all written that there is."""
        self.keeper.flush()
        self.keeper._recording.close()
        self.intake.leave_memory()


def make_pose(stamp_ns):
    maker = MessageMaker()
    return maker.make(
        'nav_msgs/msg/Odometry', header=maker.header(stamp_ns, 'odom'),
        child_frame_id='base_link', pose=maker.make(
            'geometry_msgs/msg/PoseWithCovariance', covariance=np.zeros(36),
            pose=maker.make(
                'geometry_msgs/msg/Pose', position=maker.vector('Point', np.zeros(3)),
                orientation=maker.make(
                    'geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0
                ),
            ),
        ), twist=maker.make('geometry_msgs/msg/TwistWithCovariance', twist=maker.make(
            'geometry_msgs/msg/Twist', linear=maker.vector('Vector3', np.zeros(3)),
            angular=maker.vector('Vector3', np.zeros(3)),
        ), covariance=np.zeros(36)),
    )


def make_fixed(parent, child, height, stamp_ns=0):
    maker = MessageMaker()
    return maker.make('tf2_msgs/msg/TFMessage', transforms=[maker.make(
        'geometry_msgs/msg/TransformStamped', header=maker.header(stamp_ns, parent),
        child_frame_id=child, transform=maker.make(
            'geometry_msgs/msg/Transform', translation=maker.vector('Vector3', (0, 0, height)),
            rotation=maker.make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )])


@pytest.fixture
def flown(tmp_path, monkeypatch):
    """Leave the record of a flight with a lidar half a meter above the base."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'home'))
    first = Onboard(tmp_path)
    first.mount(0.5)
    first.fly(0.0, 1.0)
    first.crash()
    assert first.counters.num_scans_inserted >= 8
    return first


def test_scans_wait_for_the_mount_of_the_map_that_goes_on(flown, tmp_path):
    second = Onboard(tmp_path)
    assert second.goes_on
    points = second.intake.accumulator.map.centroids()
    before = second.counters
    second.fly(3.0, 1.0)
    assert second.counters.num_scans_inserted == before.num_scans_inserted
    reason = 'before the mount of the map that goes on was known'
    assert second.counters.scans_dropped == {**before.scans_dropped, reason: 10}
    second.mount(0.5)
    second.fly(4.0, 1.0)
    assert second.counters.num_scans_inserted >= before.num_scans_inserted + 8
    assert second.counters.num_map_restarts == 0
    assert not second.forgotten
    np.testing.assert_allclose(second.intake.accumulator.map.centroids(), points, atol=0.01)
    second.crash()


def test_another_mount_is_another_flight(flown, tmp_path):
    second = Onboard(tmp_path, max_wait=0.0)
    number = len(second.intake.accumulator.map)
    second.mount(0.7)
    second.fly(3.0, 1.0)
    (reason, first_stamp), = second.forgotten
    assert first_stamp == flown.intake.first_stamp  # what is saved then is named after it
    assert 'xyz 0.000 0.000 0.700 m' in reason
    assert 'and was xyz 0.000 0.000 0.500 m' in reason
    assert second.counters.num_map_restarts == 0
    heights = second.intake.accumulator.map.centroids()[:, 2]
    assert heights.min() == pytest.approx(POINTS[:, 2].min() + 0.7, abs=0.01)
    assert len(read_flight(tmp_path / 'out.lost_1.record').map.keys) == number
    second.crash()


def test_input_is_judged_by_itself_after_another_flight(flown, tmp_path):
    second = Onboard(tmp_path, max_wait=0.0)
    watch = InputWatch(None, (), 0.0)

    def look(now):
        return watch.look(second.counters, second.intake._health, second.settings.input, now)[0]

    assert look(1.0) == ''
    second.mount(0.7)
    for now in (10.0, 20.0):
        second.fly(now, 0.4)
        assert 0 < second.counters.num_points_inserted < flown.counters.num_points_inserted
        assert look(now) == ''
    assert look(23.0).startswith('nothing went into the map for 3 s')
    second.crash()


def test_bad_fixed_transforms_cost_themselves_alone(tmp_path):
    onboard = Onboard(tmp_path)
    message, bad = make_fixed('base_link', 'velodyne', 0.5), make_fixed('camera', 'camera', 0.1)
    message.transforms.insert(0, bad.transforms[0])
    for _ in range(2):
        onboard.intake.take_fixed(message)
    assert onboard.intake.describe()['skipped'] == {'tf_static': 2}
    assert onboard.said == [
        "transform of /tf_static dropped: the frame 'camera' is fixed to itself (1 so far)"
    ]
    assert onboard.intake.find_mount('velodyne').transform[2, 3] == 0.5
    onboard.intake.leave_memory()


def test_tf_that_gives_no_poses_is_the_cause(tmp_path):
    onboard = Onboard(tmp_path, odometry_type='tf', map_frame='map')
    for number in range(10):
        onboard.intake.take_scan(make_cloud(POINTS, 0.1 * number), INFO)
    onboard.intake.take_moving(make_fixed('odom', 'base_link', 1.0, BASE * 10**9))
    health = onboard.intake._health
    health.hints = {'scan': '', 'odometry': onboard.intake.tf_problem}
    text = '/tf does not lead from map to base_link'
    assert text in onboard.intake.explain_nothing()
    watch = InputWatch(None, (), 0.0)
    assert text in watch.look(onboard.counters, health, onboard.settings.input, 10.0)[0]
    health.malformed['odometry'], health.problems['odometry'] = 1, 'a quaternion of length 0'
    for told in (onboard.intake.explain_nothing(),
                 watch.look(onboard.counters, health, onboard.settings.input, 10.0)[0]):
        assert 'all poses are malformed: a quaternion of length 0' in told
    onboard.intake.leave_memory()


@pytest.mark.parametrize(('saved', 'hint'), [
    (None, True), (Saved(folder=Path('/out'), whole=False), True),
    (Saved(folder=Path('/out'), whole=True), False),
])
def test_what_was_not_saved_whole_can_be_had_from_the_record(tmp_path, saved, hint):
    onboard = Onboard(tmp_path)
    onboard.fly(0.0, 1.0)
    onboard.keeper.close(saved)
    told = f'"plc_recover {tmp_path / "out.record"} -o OUT" makes the results from the record'
    assert (told in onboard.said) == hint
    onboard.intake.leave_memory()


@pytest.mark.parametrize('change', [
    {'use_tf': False}, {'odometry_type': 'Odometry'}, {'map_frame': 'world'},
    {'base_frame': 'body'},
])
def test_other_frames_in_the_settings_are_another_flight(flown, tmp_path, change):
    second = Onboard(tmp_path, **change)
    assert not second.goes_on
    assert (tmp_path / 'out.lost_1.record').exists()
    second.crash()
