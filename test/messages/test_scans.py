# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

from array import array
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from plc_inspect.config import InputSettings
from plc_inspect.core.setup.moving_frames import MovingFrames
from plc_inspect.core.setup.transforms import FrameTree
from plc_inspect.errors import DataError
from plc_inspect.messages.poses import pose_from_message, poses_from_transforms
from plc_inspect.messages.scans import scan_from_message

REAL = Path(__file__).parents[3] / 'shared' / 'data' / 'real'
CODES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}
DRIVER = {'x': (0, 'f4'), 'y': (4, 'f4'), 'z': (8, 'f4'), 'intensity': (12, 'f4'),
          'ring': (16, 'u2'), 'time': (18, 'f4')}


def make_points(num_points, seed=0):
    rng = np.random.default_rng(seed)
    xyz = rng.normal(0, 10, (num_points, 3)).astype(np.float32)
    return {
        'x': xyz[:, 0], 'y': xyz[:, 1], 'z': xyz[:, 2],
        'intensity': rng.random(num_points),
        'ring': np.arange(num_points) % 16,
        'time': -rng.random(num_points) * 0.1,
    }


def make_cloud(columns, layout=None, point_step=22, height=1, row_padding=0, bigendian=False):
    layout = layout or DRIVER
    num_points = len(columns['x'])
    width = num_points // height
    order = '>' if bigendian else '<'
    dtype = np.dtype({
        'names': list(layout),
        'formats': [order + kind for _, kind in layout.values()],
        'offsets': [offset for offset, _ in layout.values()],
        'itemsize': point_step,
    })
    points = np.zeros(num_points, dtype)
    for name in layout:
        points[name] = columns[name]
    rows = np.frombuffer(points.tobytes(), np.uint8).reshape(height, width * point_step)
    rows = np.pad(rows, ((0, 0), (0, row_padding)), constant_values=0xAB)
    return SimpleNamespace(
        header=make_header(),
        height=height,
        width=width,
        fields=[
            SimpleNamespace(name=name, offset=offset, datatype=CODES[kind], count=1)
            for name, (offset, kind) in layout.items()
        ],
        is_bigendian=bigendian,
        point_step=point_step,
        row_step=width * point_step + row_padding,
        data=array('B', rows.tobytes()),
        is_dense=False,
    )


def make_header():
    stamp = SimpleNamespace(sec=1_700_000_000, nanosec=123_456_789)
    return SimpleNamespace(stamp=stamp, frame_id='velodyne')


def check(scan, columns, num_points):
    assert scan.xyz.shape == (num_points, 3)
    assert (scan.xyz.dtype, scan.xyz.flags.c_contiguous) == (np.float32, True)
    for axis, name in enumerate('xyz'):
        np.testing.assert_array_equal(scan.xyz[:, axis], columns[name].astype(np.float32))


@pytest.mark.parametrize('bigendian', [False, True])
@pytest.mark.parametrize('height', [1, 16])
@pytest.mark.parametrize('row_padding', [0, 7])
@pytest.mark.parametrize('kind', [bytes, array, np.ndarray])
def test_layouts(bigendian, height, row_padding, kind):
    columns = make_points(160)
    message = make_cloud(columns, height=height, row_padding=row_padding, bigendian=bigendian)
    if kind is bytes:
        message.data = message.data.tobytes()
    elif kind is np.ndarray:
        message.data = np.array(message.data, np.uint8)
    scan = scan_from_message(message)
    check(scan, columns, 160)
    assert (scan.stamp_ns, scan.frame_id) == (1_700_000_000_123_456_789, 'velodyne')
    assert scan.ring.tolist() == columns['ring'].tolist()
    np.testing.assert_array_equal(scan.time, columns['time'].astype(np.float32))
    assert scan.num_not_finite == 0


def test_padded_double_precision_fields_in_another_order():
    layout = {'z': (0, 'f8'), 'x': (16, 'f8'), 'y': (8, 'f8')}
    columns = make_points(20)
    scan = scan_from_message(make_cloud(columns, layout, point_step=40))
    check(scan, columns, 20)
    assert scan.time is None
    assert scan.ring is None


def test_points_that_are_not_finite_go_with_their_times_and_rings():
    columns = make_points(64)
    columns['x'] = columns['x'].copy()
    columns['x'][[3, 40]] = np.nan, np.inf
    scan = scan_from_message(make_cloud(columns, height=4))
    kept = np.delete(np.arange(64), [3, 40])
    check(scan, {name: column[kept] for name, column in columns.items()}, 62)
    assert scan.ring.tolist() == columns['ring'][kept].tolist()
    np.testing.assert_array_equal(scan.time, columns['time'][kept].astype(np.float32))
    assert scan.num_not_finite == 2


def test_zero_points():
    scan = scan_from_message(make_cloud(make_points(0)))
    assert (scan.xyz.shape, scan.xyz.dtype) == ((0, 3), np.float32)
    assert scan.num_not_finite == 0


def test_one_point():
    columns = make_points(1)
    check(scan_from_message(make_cloud(columns)), columns, 1)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'row_step': 219}, 'row_step 219 is too small for 10 points of 22'),
        ({'row_step': 230}, '1 rows of 230 bytes holds 220 bytes'),
        ({'point_step': 0}, 'points of 0 bytes'),
        ({'point_step': 10, 'row_step': 220}, "'z' ends at byte 12 of points of 10"),
        ({'data': b'123'}, 'holds 3 bytes, not 220'),
        ({'width': 0}, '0 x 1 points holds 220 bytes'),
        ({'height': 2}, 'not 440'),
    ],
)
def test_sizes_that_contradict_one_another(changes, message):
    cloud = make_cloud(make_points(10))
    vars(cloud).update(changes)
    with pytest.raises(DataError, match=message):
        scan_from_message(cloud)


def test_missing_field_and_wrong_types():
    cloud = make_cloud(make_points(4))
    del cloud.fields[1]
    with pytest.raises(DataError, match=r"no field 'y', only x, z, intensity"):
        scan_from_message(cloud)
    cloud = make_cloud(make_points(4), {**DRIVER, 'z': (8, 'i4')})
    with pytest.raises(DataError, match="'z' is int32"):
        scan_from_message(cloud)
    cloud = make_cloud(make_points(4))
    cloud.fields[0].datatype = 9
    with pytest.raises(DataError, match="'x' has datatype 9"):
        scan_from_message(cloud)
    cloud.fields[0].datatype, cloud.fields[0].count = 7, 3
    with pytest.raises(DataError, match='count 3'):
        scan_from_message(cloud)


@pytest.mark.parametrize(
    ('name', 'kind', 'raw'),
    [
        ('t', 'u4', 50_000_000),
        ('time', 'f8', 0.05),
        ('timestamp', 'f8', 1_700_000_000.173456789),
        ('timestamp', 'f8', 1_700_000_000_173_456_789.0),
        ('offset_time', 'u4', 50_000_000),
    ],
)
def test_times_of_other_drivers(name, kind, raw):
    layout = {'x': (0, 'f4'), 'y': (4, 'f4'), 'z': (8, 'f4'), name: (16, kind)}
    columns = make_points(3) | {name: np.full(3, raw)}
    scan = scan_from_message(make_cloud(columns, layout, point_step=24))
    np.testing.assert_allclose(scan.time, 0.05, rtol=0, atol=1e-6)


def test_absolute_time_in_float32_is_an_error():
    columns = make_points(3) | {'time': np.full(3, 1.7e9)}
    with pytest.raises(DataError, match=r'float32 and holds 1\.7e\+09'):
        scan_from_message(make_cloud(columns))


def test_message_is_unchanged():
    message = make_cloud(make_points(50))
    before = message.data.tobytes()
    scan_from_message(message).xyz[:] = 0
    assert message.data.tobytes() == before


def test_pose():
    message = SimpleNamespace(
        header=make_header(),
        child_frame_id='base_link',
        pose=SimpleNamespace(
            pose=SimpleNamespace(
                position=SimpleNamespace(x=1, y=2, z=3),
                orientation=SimpleNamespace(x=0.0, y=0.6, z=0.0, w=0.8),
            )
        ),
    )
    pose = pose_from_message(message)
    assert (pose.stamp_ns, pose.frame_id) == (1_700_000_000_123_456_789, 'velodyne')
    assert pose.child_frame_id == 'base_link'
    assert pose.position.tolist() == [1, 2, 3]
    assert pose.quaternion.tolist() == [0, 0.6, 0, 0.8]


def make_transforms(*items):
    """Return a TFMessage by parents, children and stamps [s]."""
    return SimpleNamespace(transforms=[
        SimpleNamespace(
            header=SimpleNamespace(
                stamp=SimpleNamespace(sec=sec, nanosec=0), frame_id=parent),
            child_frame_id=child,
            transform=SimpleNamespace(
                translation=SimpleNamespace(x=float(sec), y=0.0, z=0.0),
                rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)),
        ) for parent, child, sec in items
    ])


def test_a_transform_with_a_bad_stamp_costs_itself_alone():
    source = InputSettings(map_frame='map', base_frame='base')
    moving = MovingFrames(FrameTree(), 'map', 'base')
    other = make_transforms(('base', 'gimbal', 0), ('map', 'base', 5), ('base', 'arm', 0))
    assert [pose.stamp_ns for pose in poses_from_transforms(other, moving, source)] == [5 * 10**9]
    found = []
    message = make_transforms(('map', 'base', 6), ('map', 'base', 0), ('map', 'base', 7))
    with pytest.raises(DataError, match='stamp of 0 s and 0 ns is not a valid time'):
        found.extend(poses_from_transforms(message, moving, source))
    assert [pose.position[0] for pose in found] == [6.0, 7.0]


@pytest.mark.parametrize(
    ('name', 'num_not_finite'), [('vlp16_indoor', 0), ('vlp16_indoor_organized', 14_179)]
)
def test_real_scans(name, num_not_finite):
    if not (REAL / name).exists():
        pytest.skip(f'real data {name} is not there')
    with AnyReader([REAL / name]) as reader:
        scans = [
            scan_from_message(reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
            if connection.topic == '/velodyne_points'
        ]
    assert len(scans) == 4
    for scan in scans:
        assert 14_500 < len(scan.xyz) < 15_000
        assert set(range(1, 16)) <= set(scan.ring.tolist()) <= set(range(16))
        assert -0.1 < scan.time.min() < -0.09
        assert abs(scan.time.max()) < 0.001
        assert np.abs(scan.xyz).max() < 30
        assert scan.num_not_finite == pytest.approx(num_not_finite, rel=0.01)


def test_nothing_of_ros_is_imported():
    code = (
        'import sys, plc_inspect.messages.scans; '
        'sys.exit(any(name.split(".")[0] in ("rclpy", "sensor_msgs", "rosbags") '
        'for name in sys.modules))'
    )
    done = subprocess.run([sys.executable, '-c', code], cwd=Path(__file__).parents[2], check=False)
    assert done.returncode == 0


@pytest.mark.parametrize(('sec', 'nanosec'), [(0, 0), (-1, 5), (5, 1_000_000_000)])
def test_stamp_that_is_no_time_is_refused(sec, nanosec):
    message = make_cloud(make_points(4))
    message.header.stamp = SimpleNamespace(sec=sec, nanosec=nanosec)
    with pytest.raises(DataError, match=f'stamp of {sec} s and {nanosec} ns is not a valid time'):
        scan_from_message(message)
    with pytest.raises(DataError, match='is not a valid time'):
        pose_from_message(SimpleNamespace(header=message.header, pose=SimpleNamespace(
            pose=SimpleNamespace(position=None, orientation=None))))


def test_field_that_is_there_twice_is_refused():
    message = make_cloud(make_points(4))
    message.fields.append(SimpleNamespace(name='x', offset=4, datatype=7, count=1))
    with pytest.raises(DataError, match="field 'x' is there twice"):
        scan_from_message(message)


def test_returns_at_infinity_are_no_reason_to_refuse():
    columns = make_points(500)
    columns['x'][::2] = np.inf
    scan = scan_from_message(make_cloud(columns))
    assert (len(scan.xyz), scan.num_not_finite) == (250, 250)


def test_layout_tells_swapped_names():
    message = make_cloud(make_points(4))
    assert scan_from_message(message).layout == 'xyz'
    message.fields[0].name, message.fields[1].name = 'y', 'x'
    assert scan_from_message(message).layout == 'yxz'
    message.height = message.width = message.row_step = 0
    message.data = array('B')
    assert scan_from_message(message).layout == 'yxz'


def test_wrong_byte_order_is_refused():
    columns = make_points(500)
    message = make_cloud(columns)
    message.is_bigendian = True
    del message.fields[3:]
    with pytest.raises(DataError, match='is_bigendian'):
        scan_from_message(message)
    columns |= {axis: np.round(columns[axis] * 8) / 8 for axis in 'xyz'}  # few digits
    message = make_cloud(columns)
    message.is_bigendian = True
    del message.fields[3:]
    with pytest.raises(DataError, match='is_bigendian'):
        scan_from_message(message)
    columns['x'][7] = 3e30  # a stray value alone is no reason
    assert len(scan_from_message(make_cloud(columns)).xyz) == 500


@pytest.mark.parametrize('duration', [0.05, 0.1, 0.2])
@pytest.mark.parametrize(('kind', 'epoch', 'unit'), [
    *((kind, epoch, unit) for kind, epoch in (('f4', False), ('f8', False), ('f8', True))
      for unit in (1.0, 1e-3, 1e-6, 1e-9)),
    *((kind, False, unit) for kind in ('i4', 'u4') for unit in (1e-6, 1e-9)),  # whole numbers
])
def test_unit_of_times_is_recognised(kind, epoch, unit, duration):
    columns = make_points(10_000)
    seconds = np.linspace(0.0, duration, 10_000) * (-1 if kind == 'i4' else 1)
    start = 1_700_000_000.123456789 if epoch else 0.0
    columns['time'] = (seconds + start) / unit
    message = make_cloud(columns, DRIVER | {'time': (18, kind)}, point_step=26)
    np.testing.assert_allclose(scan_from_message(message).time, seconds, atol=2e-6)
    for stamp in () if epoch else (0, 1, 100, 3599, 5000):  # simulated time, or since the start
        message.header.stamp.sec = stamp
        np.testing.assert_allclose(scan_from_message(message).time, seconds, atol=2e-6)


def read_times(kind, raw, without_return=(), stamp=1_700_000_000):
    """Return the times of the finite points of a scan [s]."""
    raw = np.asarray(raw)
    columns = make_points(len(raw)) | {'time': raw}
    columns['x'] = columns['x'].copy()
    columns['x'][list(without_return)] = np.nan
    message = make_cloud(columns, DRIVER | {'time': (18, kind)}, point_step=26)
    message.header.stamp.sec = stamp
    return scan_from_message(message).time


@pytest.mark.parametrize(('kind', 'unit', 'garbage'), [
    ('f4', 1.0, 1e8), ('f4', 1.0, 3e38), ('f8', 1e-3, -1e12), ('u4', 1e-6, 0xFFFFFFFF),
    ('u4', 1e-9, 0xFFFFFFFF),
])
def test_times_of_points_without_return_do_not_decide_the_unit(kind, unit, garbage):
    seconds = np.linspace(0.0, 0.1, 3000)
    raw = seconds / unit
    raw[5] = garbage
    times = read_times(kind, raw, without_return=[5])
    np.testing.assert_allclose(times, np.delete(seconds, 5), atol=2e-6)


def test_few_returns_at_the_beginning_of_a_scan_keep_its_unit():
    raw = np.linspace(0, 1e8, 3000)
    times = read_times('u4', raw, without_return=range(12, 3000))
    np.testing.assert_allclose(times, raw[:12] * 1e-9, atol=1e-9)


@pytest.mark.parametrize('seed', range(300))
def test_unit_is_that_in_which_scans_last_as_long_as_they_do(seed):
    rng = np.random.default_rng(seed)
    kind = ('f4', 'f8', 'u4', 'i4')[seed % 4]
    unit = rng.choice((1.0, 1e-3, 1e-6, 1e-9) if kind[0] == 'f' else (1e-6, 1e-9))
    duration = rng.uniform(0.04, 0.25)
    first, last = np.sort(rng.uniform(0.0, 1.0, 2))
    if seed % 3 == 0 or last * duration < 0.011 or last - first < 0.05:
        first, last = 0.0, 1.0  # the whole turn
    num_points = int(10 ** rng.uniform(2.0, 4.78))
    seconds = np.linspace(first * duration, last * duration, num_points)
    if kind != 'u4' and rng.random() < 0.5:
        seconds = -seconds
    times = read_times(kind, seconds / unit)
    np.testing.assert_allclose(times, seconds, atol=2e-6)


def test_a_sector_of_a_scan_keeps_the_unit():
    for kind, low, high, unit in (
        ('f4', 90, 100, 1e-3), ('f4', 90_000, 100_000, 1e-6), ('u4', 99_000, 99_999, 1e-6),
        ('u4', 99_999, 99_999, 1e-6), ('u4', 90_000_000, 100_000_000, 1e-9), ('f4', 0.09, 0.1, 1),
    ):
        raw = np.linspace(low, high, 500)
        np.testing.assert_allclose(read_times(kind, raw), raw * unit, atol=2e-6)


@pytest.mark.parametrize('start', [90.0, 12_345.6])
def test_seconds_of_another_clock_are_no_milliseconds(start):
    times = read_times('f8', start + np.linspace(0.0, 0.1, 100))
    assert times.min() > 89.0


@pytest.mark.parametrize(('kind', 'stamp', 'unit'), [
    *(('f8', stamp, unit) for stamp in (2, 12, 1000, 5_000_000)
      for unit in (1.0, 1e-3, 1e-6, 1e-9)),
    ('u4', 12, 1e-6), ('u4', 4000, 1e-6), ('u4', 12, 1e-3), ('f4', 12, 1.0), ('u4', 3, 1e-9),
])
def test_times_since_a_start_as_the_stamp_is(kind, stamp, unit):
    for beginning in (-0.1, 0.0, 0.05):
        seconds = np.linspace(beginning, beginning + 0.1, 3000)
        times = read_times(kind, (stamp + 0.123456789 + seconds) / unit, stamp=stamp)
        np.testing.assert_allclose(times, seconds, atol=max(unit if kind == 'u4' else 0.0, 2e-6))


def test_relative_times_at_the_stamp_of_a_start_stay_relative():
    for stamp in (2, 3, 12, 90, 99, 100, 101, 1000, 100_000):
        for kind, unit in (('f4', 1.0), ('f4', 1e-3), ('u4', 1e-6), ('u4', 1e-9)):
            seconds = np.linspace(0.0, 0.1, 3000)
            times = read_times(kind, seconds / unit, stamp=stamp)
            np.testing.assert_allclose(times, seconds, atol=2e-6)


def test_times_since_a_start_in_coarse_numbers_are_refused():
    with pytest.raises(DataError, match=r'float32 and holds 100000, too large for a time'):
        read_times('f4', np.full(3, 1e5), stamp=100_000)
