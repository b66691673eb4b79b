# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Command line plc_simulate: what it writes, and what it refuses."""

import json

import laspy
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

from plc_inspect.sim.simulate import main
from plc_inspect.sim.surveys.puck import POINT_DTYPE

FLIGHT = ('rack', '--duration', '1.5', '--seed', '4')


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    """Simulate a short flight once."""
    folder = tmp_path_factory.mktemp('sim') / 'flight'
    assert main([*FLIGHT, '-o', str(folder)]) == 0
    return folder


def _read(folder):
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        return [
            (connection.topic, stamp, reader.deserialize(data, connection.msgtype))
            for connection, stamp, data in reader.messages()
        ]


def _get_stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_bag_has_the_layout_of_the_driver(flight):
    """Topics, fields, stamps and times are those of the Velodyne driver."""
    assert sorted(file.name for file in flight.iterdir()) == [
        'flight.mcap', 'metadata.yaml', 'truth.json']
    messages = _read(flight)
    stamps = [stamp for _, stamp, _ in messages]
    assert stamps == sorted(stamps)
    scans = [message for topic, _, message in messages if topic == '/velodyne_points']
    poses = [message for topic, _, message in messages if topic == '/odometry']
    assert len(scans) == 14
    assert len(poses) == 150
    for scan in scans:
        layout = [(item.name, item.offset, item.datatype) for item in scan.fields]
        assert layout == [('x', 0, 7), ('y', 4, 7), ('z', 8, 7), ('intensity', 12, 7),
                          ('ring', 16, 4), ('time', 18, 7)]
        assert (scan.header.frame_id, scan.point_step, scan.height) == ('velodyne', 22, 1)
        assert len(scan.data) == scan.row_step == 22 * scan.width
        points = np.frombuffer(scan.data.tobytes(), POINT_DTYPE)
        assert points['time'].max() <= 0.0
        assert points['time'].min() > -0.1
        assert points['ring'].max() <= 15
    assert np.diff([_get_stamp(scan) for scan in scans]) == pytest.approx(1e8, abs=10)
    assert {(pose.header.frame_id, pose.child_frame_id) for pose in poses} == {
        ('odom', 'base_link')}
    quaternion = poses[7].pose.pose.orientation
    assert np.linalg.norm([quaternion.x, quaternion.y, quaternion.z, quaternion.w]) == (
        pytest.approx(1.0))
    speed = poses[70].twist.twist.linear
    assert np.hypot(speed.x, speed.y) == pytest.approx(5.0, rel=0.3)


def test_chunks_are_compressed_with_zstd(flight):
    """The recording is a zstd-compressed MCAP file."""
    content = (flight / 'flight.mcap').read_bytes()
    assert content.startswith(b'\x89MCAP0\r\n')
    assert b'zstd' in content
    size = sum(len(message.data) for topic, _, message in _read(flight) if 'velo' in topic)
    assert len(content) < 0.9 * size


def test_same_seed_gives_the_same_bytes(flight, tmp_path):
    """Simulating again gives the same recording and truth, byte for byte."""
    assert main([*FLIGHT, '-o', str(tmp_path / 'again')]) == 0
    for name in ('flight.mcap', 'truth.json'):
        assert (tmp_path / 'again' / name).read_bytes() == (flight / name).read_bytes()


def test_truth_of_a_flight(flight):
    """The truth is complete JSON, and in the odometry's frame."""
    truth = json.loads((flight / 'truth.json').read_text())
    assert (truth['kind'], truth['frame_id'], truth['scene']) == ('flight', 'odom', 'rack')
    assert len(truth['spans']) == 20
    assert {'start', 'world', 'drift', 'seen', 'sag', 'quadratic'} <= set(truth['spans'][0])
    assert truth['num_scans'] == 14


def test_organized_first_stamp(tmp_path):
    """The other layout and the other stamp."""
    assert main([*FLIGHT, '-o', str(tmp_path / 'o'), '--organized', '--stamp-first']) == 0
    scan = next(item for topic, _, item in _read(tmp_path / 'o') if topic == '/velodyne_points')
    assert (scan.width, scan.height, scan.is_dense) == (16, 1875, False)
    points = np.frombuffer(scan.data.tobytes(), POINT_DTYPE)
    assert np.isnan(points['x']).any()
    assert points['time'].min() == 0.0


def test_map_with_large_coordinates(tmp_path):
    """Labels, extra dimensions and UTM-sized coordinates come back; --force replaces."""
    folder = tmp_path / 'map'
    command = ['rack', '-o', str(folder), '--map', '--num-points', '20000', '--origin',
               '500000', '6000000', '50']
    assert main(command) == 0
    las = laspy.read(folder / 'map.laz')
    truth = json.loads((folder / 'truth.json').read_text())
    assert str(las.header.version) == '1.4'
    assert len(las.points) == 20000
    assert las.header.scales == pytest.approx([0.001] * 3)
    wire = np.array(las.classification) == 14
    assert (np.array(las['line_id'])[wire] >= 0).all()
    assert set(np.unique(las['line_id'])) == {-1, 0, 1, 2, 3}
    span = truth['spans'][0]
    rows = wire & (np.array(las['line_id']) == 0) & (np.array(las['span_id']) == 0)
    x = np.hypot(las.x[rows] - span['start'][0], las.y[rows] - span['start'][1])
    z = span['a'] + span['c'] * np.cosh((x - span['b']) / span['c'])
    assert np.abs(np.array(las.z[rows]) - z).max() < 0.15
    assert main(command) == 2
    assert main([*command, '--force']) == 0


@pytest.mark.parametrize('arguments', [
    ['moon', '-o', 'x'], ['rack'], ['rack', '-o', 'x', '--density', '-3'],
    ['rack', '-o', 'x', '--seed', 'one'], ['rack', '-o', 'x', '--seed', '-1'],
    ['rack', '-o', 'x', '--map', '--origin', 'nan', '0', '0'],
    ['rack', '-o', 'x', '--map', '--origin', '1e300', '0', '0'],
    ['rack', '-o', 'x', '--height', 'inf'], ['rack', '-o', 'x', '--drift', 'nan'],
])
def test_bad_usage_exits_2(arguments, capsys, tmp_path, monkeypatch):
    """Bad usage: status 2, something on stderr, nothing written."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert 'plc_simulate' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('options', [
    ['--view', '0', '400'], ['--scan-rate', '50'], ['--duration', '0.2'],
    ['--odometry-rate', '500'], ['--duration', '1', '--scan-rate', '1'],
])
def test_impossible_flight_is_one_line(options, capsys, tmp_path):
    """What cannot be flown: status 2, one line, nothing left behind."""
    assert main(['rack', '-o', str(tmp_path / 'x'), *options]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('name', [
    'notes.txt', 'rules.yaml', 'spans.json', 'rosbag2_2026_0.mcap', 'corridor.laz',
])
def test_only_surveys_are_replaced(capsys, tmp_path, name):
    """--force does not remove a folder that holds something else, nor a file."""
    (tmp_path / name).write_text('keep me')
    assert main([*FLIGHT, '-o', str(tmp_path), '--force']) == 2
    assert name in capsys.readouterr().err
    assert main([*FLIGHT, '-o', str(tmp_path / name), '--force']) == 2
    assert (tmp_path / name).read_text() == 'keep me'


def test_random_scenes_are_written_with_their_truth(tmp_path):
    """The seed and kind decide; map.laz holds the classes, truth.json the spans."""
    for name in ('one', 'two'):
        assert main(['random', '--seed', '6', '--kind', 'clean', '-o', str(tmp_path / name)]) == 0
    one, two = ((tmp_path / name / 'truth.json').read_text() for name in ('one', 'two'))
    assert one == two
    truth = json.loads(one)
    las = laspy.read(tmp_path / 'one' / 'map.laz')
    wires = sum(row['num_points'] for row in truth['spans'])
    assert wires == int((np.array(las.classification) == 14).sum()) > 0


@pytest.mark.parametrize(('arguments', 'refused'), [
    (('random', '--map', '--origin', '0', '0', '1'), 'the scene random takes no --map, --origin'),
    (('random', '--dual', '--speed', '3'), 'takes no --dual, --speed'),
    (('demo', '--kind', 'clean'), 'a flight takes no --kind'),
    (('demo', '--density', '5', '--origin', '0', '0', '1'), 'a flight takes no --density, --orig'),
    (('rack', '--map', '--dual', '--kind', 'clean'), 'a map takes no --dual, --kind'),
])
def test_options_that_a_scene_does_not_take_are_refused(tmp_path, capsys, arguments, refused):
    with pytest.raises(SystemExit, match='2'):
        main([*arguments, '-o', str(tmp_path / 'out')])
    assert refused in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
