# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from plc_inspect.config import InputSettings, Settings
from plc_inspect.core.mapping.accumulator import DropReason
from plc_inspect.errors import DataError
from plc_inspect.messages.poses import StampedPose
from plc_inspect.messages.scans import ScanArrays
from plc_inspect.offline.readers.bag_map import accumulate
from plc_inspect.offline.readers.bags import find_recordings, Recording

REAL = Path(__file__).parents[4] / 'shared' / 'data' / 'real'
START = 1_700_000_000_000_000_000
MS = 1_000_000
KINDS = ('mcap', 'sqlite3', 'bag')
STORES = {
    'mcap': get_typestore(Stores.ROS2_JAZZY),
    'sqlite3': get_typestore(Stores.ROS2_JAZZY),
    'bag': get_typestore(Stores.ROS1_NOETIC),
}
SCAN, ODOMETRY = 'sensor_msgs/msg/PointCloud2', 'nav_msgs/msg/Odometry'
TF = 'tf2_msgs/msg/TFMessage'


def make_header(types, stamp_ns, frame_id):
    stamp = types['builtin_interfaces/msg/Time'](
        sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
    )
    more = {'seq': 0} if 'seq' in types['std_msgs/msg/Header'].__annotations__ else {}
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id, **more)


def make_scan(types, stamp_ns, xyz, row_step=None):
    field = types['sensor_msgs/msg/PointField']
    fields = [field(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate('xyz')]
    data = np.frombuffer(xyz.astype('<f4').tobytes(), np.uint8)
    return types[SCAN](
        header=make_header(types, stamp_ns, 'velodyne'), height=1, width=len(xyz), fields=fields,
        is_bigendian=False, point_step=12, row_step=row_step or 12 * len(xyz), data=data,
        is_dense=True,
    )


def make_odometry(types, stamp_ns, x):
    vector, covariance = types['geometry_msgs/msg/Vector3'], np.zeros(36)
    pose = types['geometry_msgs/msg/Pose'](
        position=types['geometry_msgs/msg/Point'](x=x, y=0.0, z=0.0),
        orientation=types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    still = types['geometry_msgs/msg/Twist'](linear=vector(0, 0, 0), angular=vector(0, 0, 0))
    return types[ODOMETRY](
        header=make_header(types, stamp_ns, 'odom'), child_frame_id='base_link',
        pose=types['geometry_msgs/msg/PoseWithCovariance'](pose=pose, covariance=covariance),
        twist=types['geometry_msgs/msg/TwistWithCovariance'](twist=still, covariance=covariance),
    )


def write_bag(path, kind, messages):
    """Write (topic, type, log stamp, raw bytes) to a bag and return the bag's path."""
    store = STORES[kind]
    connections = {}
    if kind == 'bag':
        path = path.with_suffix('.bag')
        writer = Writer1(path)
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
    with writer:
        for topic, type_name, stamp, raw in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_name, typestore=store)
            writer.write(connections[topic], stamp, raw)
    return path


def make_flight(kind, num_scans=4, bad_scan=None):
    """Make the messages of a flight at 10 m/s that sees one point 20 m ahead of its start."""
    store = STORES[kind]
    types = store.types
    serialize = store.serialize_ros1 if kind == 'bag' else store.serialize_cdr
    messages = []
    for i in range(10 * (num_scans + 1)):
        stamp = START + 10 * i * MS
        raw = bytes(serialize(make_odometry(types, stamp, 0.1 * i), ODOMETRY))
        messages.append(('/odometry', ODOMETRY, stamp + MS, raw))
    for i in range(num_scans):
        stamp = START + (100 * i + 55) * MS
        xyz = np.array([[20 - 10 * (0.1 * i + 0.055), 0, 0]])
        message = make_scan(types, stamp, xyz, row_step=1 if i == bad_scan else None)
        messages.append(('/velodyne_points', SCAN, stamp + MS, bytes(serialize(message, SCAN))))
    return sorted(messages, key=lambda message: message[2])


def open_recording(path, scan_topic='velodyne_points', odometry_topic='/odometry'):
    return Recording(path, scan_topic, odometry_topic)


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_of_bag_gives_the_same(kind, tmp_path):
    path = write_bag(tmp_path / 'flight', kind, make_flight(kind))
    with open_recording(path) as recording:
        assert recording.num_messages == 54
        messages = list(recording)
        assert recording.progress == 1.0
        assert recording.duration == pytest.approx(0.49)
        accumulator = accumulate(recording, Settings())
    stamps = [message.log_stamp_ns for message in messages]
    assert stamps == sorted(stamps)
    scans = [m.content for m in messages if isinstance(m.content, ScanArrays)]
    poses = [m.content for m in messages if isinstance(m.content, StampedPose)]
    assert [scan.stamp_ns for scan in scans] == [START + (100 * i + 55) * MS for i in range(4)]
    assert poses[3].position.tolist() == [pytest.approx(0.3), 0, 0]
    assert {pose.frame_id for pose in poses} == {'odom'}
    assert accumulator.counters().num_scans_inserted == 4
    np.testing.assert_allclose(accumulator.map.centroids(), [[20, 0, 0]], atol=1e-5)
    assert accumulator.map.counts().tolist() == [4]


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3'])
def test_lone_file_and_folder_without_metadata(kind, tmp_path):
    folder = write_bag(tmp_path / 'flight', kind, make_flight(kind))
    (file,) = (path for path in folder.iterdir() if path.suffix in ('.mcap', '.db3'))
    with open_recording(file) as recording:
        assert len(list(recording)) == 54
    (folder / 'metadata.yaml').unlink()
    with open_recording(folder) as recording:
        assert len(list(recording)) == 54


def test_a_lone_bag_does_not_hide_the_recordings_beside_it(tmp_path):
    for name in ('flight_1/metadata.yaml', 'flight_2/a.mcap', 'out/a.mcap', 'out/run.json'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    flights = [tmp_path / 'flight_1', tmp_path / 'flight_2']
    assert find_recordings(tmp_path) == flights
    (tmp_path / 'test.mcap').touch()
    assert find_recordings(tmp_path) == [tmp_path / 'test.mcap', *flights]
    for name in ('flight_1/metadata.yaml', 'flight_2/a.mcap'):
        (tmp_path / name).unlink()
    assert find_recordings(tmp_path) == [tmp_path]  # alone but for results


@pytest.mark.parametrize(('names', 'message'), [
    (('flight_2026-05-01-10-00-00_0.bag', 'flight_2026-05-01-10-05-00_1.bag'),
     r'2 files flight_N: parts of one recording\? Then run rosbags-convert --src \*\.bag'),
    (('2026-05-01-10-00-00_0.bag', '2026-05-01-10-05-00_1.bag'), '2 files _N: parts of one'),
    (('flight_0.mcap', 'flight_1.mcap'), 'Then run ros2 bag reindex'),
    (('flight_2026-05-01-10-00-00_0.bag', 'flight_2026-05-02-10-05-00_0.bag'), ''),
    (('flight_2026-05-01-10-00-00.bag', 'flight_2026-05-01-10-05-00.bag'), ''),
])
def test_parts_of_one_recording_are_no_flights(names, message, tmp_path):
    for name in names:
        (tmp_path / name).touch()
    if message:
        with pytest.raises(DataError, match=message):
            find_recordings(tmp_path)
    else:
        assert find_recordings(tmp_path) == [tmp_path / name for name in names]


def test_a_channel_that_is_not_of_ros_is_named(tmp_path):
    folder = write_bag(tmp_path / 'flight', 'mcap', make_flight('mcap'))
    (file,) = folder.glob('*.mcap')
    file.write_bytes(file.read_bytes().replace(b'ros2msg', b'ros2box'))
    with (
        pytest.raises(DataError, match=r"schema in 'ros2box', not of ROS; leave it out"),
        open_recording(file),
    ):
        pass


def test_iterating_twice_gives_the_same(tmp_path):
    path = write_bag(tmp_path / 'flight', 'mcap', make_flight('mcap', bad_scan=1))
    with open_recording(path) as recording:
        first = accumulate(recording, Settings())
        second = accumulate(recording, Settings())
        assert recording.skipped.total() == 1
    assert first.map.centroids().tobytes() == second.map.centroids().tobytes()
    assert first.counters() == second.counters()


@pytest.mark.parametrize('kind', KINDS)
def test_missing_topic_lists_what_is_there(kind, tmp_path):
    path = write_bag(tmp_path / 'flight', kind, make_flight(kind))
    with pytest.raises(DataError) as error, open_recording(path, scan_topic='/scan'):
        pass
    text = str(error.value)
    assert 'has no /scan' in text
    assert '/velodyne_points (sensor_msgs/msg/PointCloud2)' in text
    assert '/odometry (nav_msgs/msg/Odometry)' in text
    assert '\n' not in text


def test_topic_of_another_type(tmp_path):
    path = write_bag(tmp_path / 'flight', 'mcap', make_flight('mcap'))
    with (
        pytest.raises(DataError, match=r'has /odometry as nav_msgs/msg/Odometry, wanted sensor'),
        open_recording(path, scan_topic='odometry', odometry_topic='other'),
    ):
        pass
    with pytest.raises(DataError, match='cannot share'):
        Recording(path, 'odometry', '/odometry')


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('share', [0.0, 0.01, 0.5, 0.95])
def test_truncated_file_is_one_clear_error(kind, share, tmp_path):
    path = write_bag(tmp_path / 'flight', kind, make_flight(kind, num_scans=40))
    if path.is_dir():
        (path,) = (file for file in path.iterdir() if file.suffix in ('.mcap', '.db3'))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DataError, match=path.name) as error, open_recording(path) as recording:
        list(recording)
    assert '\n' not in str(error.value)


def test_what_is_no_recording(tmp_path):
    (tmp_path / 'note.txt').write_text('hello')
    (tmp_path / 'empty').mkdir()
    for name, message in (
        ('missing.mcap', 'does not exist'),
        ('note.txt', 'must end in'),
        ('empty', 'no metadata.yaml and 0 bag files'),
    ):
        with pytest.raises(DataError, match=message), open_recording(tmp_path / name):
            pass
    with pytest.raises(DataError, match='not open'):
        list(open_recording(tmp_path / 'empty'))


@pytest.mark.parametrize('kind', KINDS)
def test_bad_messages_in_a_good_bag_are_skipped_and_counted(kind, tmp_path):
    messages = make_flight(kind, bad_scan=2)
    messages.insert(20, ('/odometry', ODOMETRY, messages[20][2], b'\x00\x01\x00\x00\xff\xff'))
    path = write_bag(tmp_path / 'flight', kind, messages)
    with open_recording(path) as recording:
        accumulator = accumulate(recording, Settings())
        assert recording.skipped == {
            '/odometry: not decodable': 1, '/velodyne_points: malformed': 1,
        }
        assert 'row_step 1' in recording.first_errors['/velodyne_points: malformed']
        assert set(recording.malformed) == {'scan', 'odometry'}
        assert 'row_step 1' in recording.malformed['scan']
    assert accumulator.counters().num_scans_inserted == 3


def make_fixed(store, *edges):
    """Make a message of /tf_static of (parent, child, w of the quaternion)."""
    types = store.types
    return types[TF](transforms=[
        types['geometry_msgs/msg/TransformStamped'](
            header=make_header(types, 0, parent), child_frame_id=child,
            transform=types['geometry_msgs/msg/Transform'](
                translation=types['geometry_msgs/msg/Vector3'](x=0.0, y=0.0, z=0.5),
                rotation=types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=w),
            ),
        ) for parent, child, w in edges
    ])


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3'])
def test_bad_fixed_transforms_cost_themselves_alone(kind, tmp_path):
    store = STORES[kind]
    serialize = store.serialize_cdr
    mixed = make_fixed(
        store, ('base_link', 'camera', 0.0), ('camera', 'camera', 1.0),
        ('base_link', 'velodyne', 1.0),
    )
    raws = [bytes(serialize(mixed, TF)), b'\x00\x01\x00\x00\xff\xff\xff\x7f']
    raws.append(bytes(serialize(make_fixed(store, ('base_link', 'imu', 1.0)), TF)))
    path = write_bag(tmp_path / 'flight', kind, [
        *(('/tf_static', TF, START, raw) for raw in raws), *make_flight(kind),
    ])
    with open_recording(path) as recording:
        assert [item.child for item in recording.fixed_transforms] == ['velodyne', 'imu']
        for _ in range(2):  # the counts of each pass have them
            assert len(list(recording)) == 54
            assert recording.skipped == {'/tf_static: malformed': 3}
        (text,) = recording.first_errors.values()
        assert 'from base_link to camera is none' in text
        assert recording.malformed == {}


def test_tf_of_ros1_becomes_that_of_ros2(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = 'tf/msg/tfMessage'
    store.register(get_types_from_msg('geometry_msgs/TransformStamped[] transforms', kind))
    types = store.types
    message = types[kind](transforms=[types['geometry_msgs/msg/TransformStamped'](
        header=make_header(types, START, 'odom'), child_frame_id='base_link',
        transform=types['geometry_msgs/msg/Transform'](
            translation=types['geometry_msgs/msg/Vector3'](x=1.0, y=2.0, z=3.0),
            rotation=types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )])
    flight = make_flight('bag')
    with Writer1(tmp_path / 'old.bag') as writer:
        scans = writer.add_connection('/velodyne_points', SCAN, typestore=STORES['bag'])
        poses = writer.add_connection('/tf', kind, typestore=store)
        for topic, _, stamp, raw in flight:
            if topic == '/velodyne_points':
                writer.write(scans, stamp, raw)
        writer.write(poses, START, bytes(store.serialize_ros1(message, kind)))
    with open_recording(tmp_path / 'old.bag') as recording:
        assert recording.pose_type == kind
        (raw,) = [item.raw for item in recording.raw_messages() if item.topic == '/tf']
    found = STORES['mcap'].deserialize_cdr(raw, TF).transforms[0]
    assert found.child_frame_id == 'base_link'
    assert found.header.frame_id == 'odom'
    assert found.transform.translation.z == 3.0


def test_late_odometry_drops_scans_as_in_flight(tmp_path):
    messages = [
        (topic, kind, stamp + (2000 * MS if topic == '/odometry' else 0), raw)
        for topic, kind, stamp, raw in make_flight('mcap')
    ]
    path = write_bag(tmp_path / 'flight', 'mcap', sorted(messages, key=lambda m: m[2]))
    patient = Settings(input=InputSettings(max_wait=5.0))
    with open_recording(path) as recording:
        dropped = accumulate(recording, Settings()).counters()
        waited = accumulate(recording, patient).counters()
    assert dropped.scans_dropped == {DropReason.WAITED_TOO_LONG.value: 4}
    assert waited.num_scans_inserted == 4


def test_progress_rises_to_one(tmp_path):
    path = write_bag(tmp_path / 'flight', 'mcap', make_flight('mcap', num_scans=10))
    shares = []
    with open_recording(path) as recording:
        accumulate(recording, Settings(), shares.append)
    assert shares == sorted(shares)
    assert (len(shares), shares[-1]) == (11, 1.0)


@pytest.mark.parametrize('name', ['vlp16_indoor', 'vlp16_indoor_organized'])
def test_real_recordings(name):
    if not (REAL / name).exists():
        pytest.skip(f'real data {name} is not there')
    with open_recording(REAL / name) as recording:
        accumulator = accumulate(recording, Settings())
        assert not recording.skipped
    counters = accumulator.counters()
    assert (counters.num_scans_inserted, counters.num_poses) == (4, 35)
    lost = sum(counters.points_dropped.values())
    assert counters.num_points == counters.num_points_inserted + lost
    room = np.ptp(accumulator.map.centroids(), axis=0)
    assert (room < 30).all()
    assert (room > 1).all()
