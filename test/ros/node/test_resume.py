# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""A node that is started again goes on with its flight, and with no other one."""

import shutil
import time

import pytest
from rig import Rig, wait_for

from plc_inspect.errors import DataError
from plc_inspect.flight_record.layout import list_segments
from plc_inspect.flight_record.reader import find_end, read_flight
from plc_inspect.ros.node.keeper import MOST_REFUSED

LONGEST_LAG = 1.5
"""All that changed is in the record after this [s]; docs/record.md says at most one."""


@pytest.fixture
def begin(tmp_path, monkeypatch, capfd):
    """Return a function that starts a node with a record; all are closed after the test."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'home'))
    rigs = []

    def run(**parameters):
        rigs.append(make_rig(tmp_path, **parameters))
        return rigs[-1]

    def end():
        rigs.pop().close()

    run.end = end
    yield run
    for rig in rigs:
        rig.close()


def make_rig(folder, **parameters):
    """Start a node that writes a record to a folder."""
    return Rig(**{
        'output.directory': str(folder / 'out'), 'output.record': True, **parameters
    })


@pytest.fixture(scope='module')
def template(tmp_path_factory):
    """Return a folder with the record of a node that ended without saving, and what it knew."""
    folder = tmp_path_factory.mktemp('flown')
    rig = make_rig(folder)
    rig.feed()
    rig.call('segment')
    rig.feed(2)
    rig.call('segment')
    wait_for(lambda: count_spans(folder / 'out.record') == 6, 'record')
    time.sleep(LONGEST_LAG)
    known = {
        'time': rig.robot.time, 'scans': rig.inserted(),
        'points': rig.node.intake.accumulator.map.centroids(),
        'keys': [item.key for item in rig.node.state.confirmed],
        'hazards': [item.hazard_id for item in rig.node.state.hazards],
    }
    rig.close()
    return folder, known


@pytest.fixture
def flown(template, tmp_path):
    """Put that record into the folder of the test, and return what is known in it."""
    shutil.copytree(template[0] / 'out.record', tmp_path / 'out.record')
    return template[1]


def count_spans(record):
    """Return the number of spans that a record tells of so far."""
    try:
        return len(read_flight(record).kept.spans.spans)
    except DataError:  # nothing was written yet
        return 0


def go_on(rig, known):
    """Fly on where the flight was interrupted, 3 s later."""
    rig.robot.time = known['time'] + 3.0
    rig.feed(4)
    rig.call('segment')


@pytest.mark.slow
def test_it_goes_on_with_map_numbers_and_hazards(begin, flown, tmp_path, capfd):
    rig = begin()
    assert rig.node.intake.accumulator.map.centroids().tobytes() == flown['points'].tobytes()
    assert [item.key for item in rig.node.state.confirmed] == flown['keys']
    assert rig.rows('catenaries')['line_id'].tolist() == [key[0] for key in flown['keys']]
    go_on(rig, flown)
    assert [item.key for item in rig.node.state.confirmed] == flown['keys']
    assert {*flown['hazards']} <= {item.hazard_id for item in rig.node.state.hazards}
    assert rig.inserted() == flown['scans'] + 4
    status, values = rig.status('record')
    assert status.level == b'\x00'
    assert values['record'] == str(tmp_path / 'out.record')
    assert rig.node.close()
    assert find_end(tmp_path / 'out.record') == str(tmp_path / 'out')
    assert 'goes on: ' in capfd.readouterr().err


@pytest.mark.parametrize(('change', 'text'), [
    ({'map.voxel_size': 0.2}, 'map.voxel_size was 0.1 and is 0.2'),
    ({'input.lidar_xyz': [0.0, 0.0, 1.0]}, 'input.lidar_xyz was'),
])
def test_other_settings_are_another_flight(begin, flown, tmp_path, change, text, capfd):
    rig = begin(**change)
    assert len(rig.node.intake.accumulator.map) == 0
    said = capfd.readouterr().err
    assert text in said
    assert f'plc_recover {tmp_path / "out.lost_1.record"}' in said
    assert count_spans(tmp_path / 'out.lost_1.record') == 6


@pytest.mark.parametrize(('pose', 'text'), [
    ({'frame_id': 'map'}, 'the frames are map and base_link'),
    ({'position': (500.0, 0.0, 0.0)}, 'the vehicle is 500 m from where it was'),
    ({'position': (-60.0, -9.0, -14.0)}, 'began anew at its origin'),
    ({'stamp': 0.5}, 's after the last one in the record'),
])
def test_other_odometry_is_another_flight(begin, flown, tmp_path, pose, text, capfd):
    rig = begin()
    rig.robot.time = flown['time'] + 10.0
    rig.robot.send_pose(stamp=0.2)  # one that went astray
    for _ in range(MOST_REFUSED):
        rig.robot.send_pose(**pose)
    wait_for(lambda: len(rig.node.intake.accumulator.map) == 0, 'empty map')
    wait_for(lambda: rig.node.state is None, 'nothing known')
    rig.wait_until(lambda counters: counters.num_scans == 0, 'counts that begin anew')
    wait_for(lambda: count_spans(tmp_path / 'out.lost_1.record') == 6, 'record put aside')
    assert text in capfd.readouterr().err
    rig.robot.time = round(rig.robot.time + 100.0, 6)
    rig.robot.step()
    wait_for(lambda: list_segments(tmp_path / 'out.record'), 'another record')


def test_flight_that_was_saved_does_not_go_on(begin, flown, tmp_path):
    rig = begin()
    go_on(rig, flown)
    assert rig.node.close()
    begin.end()
    rig = begin()
    assert len(rig.node.intake.accumulator.map) == 0
    assert not (tmp_path / 'out.lost_1.record').exists()


def test_record_is_found_without_a_name(begin, tmp_path):
    rig = begin(**{'output.directory': ''})
    rig.feed(4)
    home = tmp_path / 'home' / 'plc_inspect'
    (record,) = wait_for(lambda: list(home.glob('*.record')), 'record')
    wait_for(lambda: list_segments(record), 'segment')
    number = len(rig.node.intake.accumulator.map)
    rig.node._keeper.flush()
    begin.end()
    rig = begin(**{'output.directory': ''})
    assert len(rig.node.intake.accumulator.map) == number


def test_record_of_a_node_that_lives_is_left_alone(begin, tmp_path):
    rig = begin()
    rig.feed(4)
    wait_for(lambda: list_segments(tmp_path / 'out.record'), 'segment')
    other = begin()
    assert len(other.node.intake.accumulator.map) == 0
    status, _ = other.status('record')
    assert status.level == b'\x01'
    assert 'is written by another node' in status.message
    assert not (tmp_path / 'out.lost_1.record').exists()
    rig.feed(2)


def test_no_record_is_written_where_none_is_wanted(begin, tmp_path):
    rig = begin(**{'output.record': False})
    rig.feed(2)
    assert rig.status('record')[1] == {'record': 'none'}
    assert not list(tmp_path.glob('*.record'))
