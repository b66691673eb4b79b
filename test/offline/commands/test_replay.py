# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""``plc_replay``: a recording in, the same folder out, every time."""

import json
from pathlib import Path
import sys
import types

from factories import make_empty_result, make_span
import laspy
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from plc_inspect.core.extraction.dust import LONE
from plc_inspect.core.setup.sharpness import ON_TRUST
from plc_inspect.offline.commands.replay import main
from plc_inspect.offline.export.file_names import FILES
from plc_inspect.offline.terminal.losses import describe_losses
from plc_inspect.results import StageReport

REAL = Path(__file__).parents[4] / 'shared/data/real'
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
START = 1_700_000_000_000_000_000
SCAN, ODOMETRY = 'sensor_msgs/msg/PointCloud2', 'nav_msgs/msg/Odometry'


@pytest.fixture
def pipeline(monkeypatch):
    """Put in the place of the pipeline one that finds a single span made from the points."""
    module = types.ModuleType('plc_inspect.core.pipeline')

    class Pipeline:
        given = None

        def __init__(self, settings, rules=None, way=None):
            pass

        def run(self, points, progress=None):
            type(self).given = points.copy()
            result = make_empty_result(len(points))
            if not len(points):
                return result
            low, high = points.min(axis=0), points.max(axis=0)
            span = make_span(0, 0, low, high + np.array([1.0, 0.0, 0.0]))
            return type(result)(
                **{name: getattr(result, name) for name in result.__slots__} | {'spans': (span,)}
            )

    module.Pipeline = Pipeline
    monkeypatch.setitem(sys.modules, 'plc_inspect.core.pipeline', module)
    return Pipeline


def make_header(stamp_ns, frame_id):
    """Make a message header."""
    stamp = TYPES['builtin_interfaces/msg/Time'](
        sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
    )
    return TYPES['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)


def make_scan(stamp_ns, points):
    """Make a scan of x, y, z in float32."""
    make_field = TYPES['sensor_msgs/msg/PointField']
    data = np.ascontiguousarray(points, '<f4')
    return TYPES[SCAN](
        header=make_header(stamp_ns, 'velodyne'), height=1, width=len(points),
        fields=[
            make_field(name=name, offset=4 * index, datatype=7, count=1)
            for index, name in enumerate('xyz')
        ],
        is_bigendian=False, point_step=12, row_step=12 * len(points),
        data=data.view(np.uint8).ravel(), is_dense=True,
    )


def make_odometry(stamp_ns, x):
    """Make a pose on the x axis, looking along it."""
    kinds = {name.rpartition('/')[2]: kind for name, kind in TYPES.items()
             if name.startswith('geometry_msgs/')}
    zero = kinds['Vector3'](x=0.0, y=0.0, z=0.0)
    pose = kinds['Pose'](
        position=kinds['Point'](x=x, y=0.0, z=0.0),
        orientation=kinds['Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    return TYPES[ODOMETRY](
        header=make_header(stamp_ns, 'odom'), child_frame_id='base_link',
        pose=kinds['PoseWithCovariance'](pose=pose, covariance=np.zeros(36)),
        twist=kinds['TwistWithCovariance'](
            twist=kinds['Twist'](linear=zero, angular=zero), covariance=np.zeros(36)
        ),
    )


def write_bag(
    path, scan_topic='/velodyne_points', num_scans=5, storage=StoragePlugin.MCAP, *, lead=0.0,
    gap=False, away=None,
):
    """
    Write a flight at 10 m/s along x; each scan sees the same ten points of the lidar frame.

    From scan ``away`` on the odometry is 500 km away.
    """
    points = np.column_stack((np.full(10, 5.0), np.arange(10.0), np.full(10, 2.0)))
    with Writer(path, version=9, storage_plugin=storage) as writer:
        scans, poses = (
            writer.add_connection(topic, kind, typestore=STORE)
            for topic, kind in ((scan_topic, SCAN), ('/odometry', ODOMETRY))
        )
        for tick in range(5 * num_scans + 5):
            stamp = START + tick * 20_000_000
            far = 500_000.0 if away is not None and tick >= 5 * away else 0.0
            message = make_odometry(stamp, far + 0.2 * tick)
            if not (gap and 5 < tick < 21):
                writer.write(poses, stamp, STORE.serialize_cdr(message, ODOMETRY))
            if tick % 5 == 2 and tick < 5 * num_scans:
                message = make_scan(stamp + round(lead * 1e9), points)
                writer.write(scans, stamp + 1, STORE.serialize_cdr(message, SCAN))
    return path


def run(*argv):
    """Run the command in this process and return its exit code."""
    try:
        return main([str(item) for item in argv])
    except SystemExit as error:
        return error.code


def check_refusal(code, capfd, *words):
    """Check exit code 2 and one line on stderr that holds the words."""
    out, err = capfd.readouterr()
    assert code == 2
    assert out == ''
    assert err.count('\n') == 1, err
    for word in words:
        assert str(word) in err


@pytest.mark.parametrize('storage', list(StoragePlugin))
def test_map_in_the_frame_of_the_odometry(tmp_path, pipeline, capfd, storage):
    bag = write_bag(tmp_path / 'bag', storage=storage)
    assert run(bag, '-o', tmp_path / 'out') == 0
    out, err = capfd.readouterr()
    assert err == ''
    assert out.startswith('bag: 50 points, 1 line, 1 span')
    assert sorted(item.name for item in (tmp_path / 'out').iterdir()) == sorted(FILES)
    content = json.loads((tmp_path / 'out/spans.json').read_text(encoding='utf-8'))
    assert content['frame_id'] == 'odom'
    # Scan k was taken at x = 0.2 (5 k + 2) and sees a point 5 m ahead.
    expected = {(0.4 + k + 5.0, float(y), 2.0) for k in range(5) for y in range(10)}
    found = {tuple(np.round(point, 3).tolist()) for point in pipeline.given}
    assert found == {tuple(np.round(point, 3)) for point in expected}
    counts = json.loads((tmp_path / 'out/run.json').read_text(encoding='utf-8'))['input']['counts']
    assert (counts['num_scans'], counts['num_scans_inserted'], counts['num_poses']) == (5, 5, 30)
    assert len(laspy.read(tmp_path / 'out/points.laz').points) == 50


def test_replaying_twice_gives_the_same_bytes(tmp_path, pipeline):
    bag = write_bag(tmp_path / 'bag')
    for name in ('one', 'two'):
        assert run(bag, '-o', tmp_path / name, '--quiet') == 0
    for name in set(FILES) - {'run.json', 'report.html'}:
        one, two = ((tmp_path / folder / name).read_bytes() for folder in ('one', 'two'))
        assert one == two, name


def test_topics_by_option_and_by_setting(tmp_path, pipeline):
    bag = write_bag(tmp_path / 'bag', scan_topic='/front/points')
    assert run(bag, '-o', tmp_path / 'one', '--scan-topic', 'front/points', '--quiet') == 0
    assert run(bag, '-o', tmp_path / 'two', '--set', 'input.scan_topic=/front/points') == 0
    content = json.loads((tmp_path / 'one/run.json').read_text(encoding='utf-8'))
    assert content['settings']['input']['scan_topic'] == 'front/points'


def test_missing_topic_lists_what_is_there(tmp_path, pipeline, capfd):
    bag = write_bag(tmp_path / 'bag', scan_topic='/front/points')
    check_refusal(
        run(bag, '-o', tmp_path / 'out'), capfd, '/velodyne_points', f'/front/points ({SCAN})'
    )
    assert not (tmp_path / 'out').exists()


def test_missing_bag(tmp_path, pipeline, capfd):
    check_refusal(run(tmp_path / 'bag', '-o', tmp_path / 'out'), capfd, 'does not exist')


@pytest.mark.parametrize('share', [0.0, 0.3, 0.9])
def test_truncated_mcap(tmp_path, pipeline, capfd, share):
    bag = write_bag(tmp_path / 'bag', num_scans=50)
    file = next(bag.glob('*.mcap'))
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    check_refusal(run(bag, '-o', tmp_path / 'out'), capfd, 'bag')
    assert [item.name for item in tmp_path.iterdir()] == ['bag']


def test_losses_are_printed(tmp_path, pipeline, capfd):
    bag = write_bag(tmp_path / 'bag', gap=True)
    assert run(bag, '-o', tmp_path / 'out') == 0
    assert 'scans dropped: 3 gap in the odometry' in capfd.readouterr().out


@pytest.mark.parametrize(('options', 'arguments', 'cause'), [
    ({'num_scans': 0}, (), 'no scan came in'),
    ({}, ('--set', 'input.max_pose_gap=0.01'), 'over more than 0.01 s'),
    ({'lead': 18.0}, (), 'scan stamps are 18.0 s ahead of odometry'),
    ({}, ('--set', 'input.min_range=99'), 'no point of the scans lies between 99 and 100 m'),
])
def test_recording_of_which_no_scan_is_used_is_refused(
    tmp_path, pipeline, capfd, options, arguments, cause
):
    bag = write_bag(tmp_path / 'bag', **options)
    code = run(bag, '-o', tmp_path / 'out', '--quiet', *arguments)
    check_refusal(code, capfd, 'no scan could be used', cause)
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('layout', ['vlp16_indoor', 'vlp16_indoor_organized'])
@pytest.mark.skipif(not REAL.is_dir(), reason='no ../shared/data/real beside the repository')
def test_real_scans_of_a_room(tmp_path, capfd, layout):
    assert run(REAL / layout, '-o', tmp_path / 'out') == 0
    out, err = capfd.readouterr()
    assert err == ''
    assert 'no power line was found' in out
    counts = json.loads((tmp_path / 'out/run.json').read_text(encoding='utf-8'))['input']['counts']
    assert counts['num_scans'] == 4


@pytest.mark.parametrize(('number', 'told'), [(0, ''), (2, 'begun anew 2 times')])
def test_a_map_that_was_begun_anew_is_told(number, told):
    nothing = {'scans_dropped': {}, 'poses_rejected': {}, 'skipped': {}, 'num_scans_lost': 0}
    found = describe_losses(types.SimpleNamespace(
        counts=nothing | {'num_map_restarts': number}, earlier=(),
        result=types.SimpleNamespace(hazards=(), stages=()),
    ))
    assert told in found
    assert bool(found) == bool(number)


def test_what_was_found_before_the_map_began_anew_is_kept(tmp_path, pipeline, capfd):
    bag, out = write_bag(tmp_path / 'bag', num_scans=70, away=20), tmp_path / 'out'
    for options in ((), ('--force',)):
        assert run(bag, '-o', out, '--set', 'segment.min_points=100', *options) == 0
    told = capfd.readouterr().out
    assert 'begun anew 1 times: what was flown before is in before_1, in the results' in told
    before = out / 'before_1'
    assert sorted(item.name for item in out.iterdir()) == sorted([*FILES, 'before_1'])
    assert sorted(item.name for item in before.iterdir()) == sorted(FILES)
    cloud = laspy.read(before / 'points.laz').xyz
    assert cloud[:, 0].max() < 30.0
    assert laspy.read(out / 'points.laz').xyz[:, 0].min() > 500_000.0
    content = json.loads((before / 'run.json').read_text(encoding='utf-8'))
    assert 'cannot be brought together' in content['input']['counts']['ended']
    (before / 'mine.txt').touch()
    assert run(bag, '-o', out, '--force', '--set', 'segment.min_points=100') == 2
    assert 'such as before_1/mine.txt' in capfd.readouterr().err


def test_a_short_map_that_ended_is_left_out(tmp_path, pipeline, capfd):
    bag = write_bag(tmp_path / 'bag', num_scans=70, away=20)
    assert run(bag, '-o', tmp_path / 'out', '--set', 'segment.min_points=250') == 0
    assert 'what was flown before is not in the results' in capfd.readouterr().out
    assert not (tmp_path / 'out/before_1').exists()


@pytest.mark.parametrize(('known', 'num_hazards', 'told'), [
    (False, 2, True), (True, 2, False), (False, 0, False),
])
def test_hazards_of_a_map_of_unknown_sharpness_are_told_as_such(known, num_hazards, told):
    counts = {'scans_dropped': {}, 'poses_rejected': {}, 'skipped': {}, 'num_scans_lost': 0,
              'num_map_restarts': 0, 'sharpness': {'known': known}}
    found = describe_losses(types.SimpleNamespace(
        counts=counts, result=types.SimpleNamespace(hazards=[None] * num_hazards, stages=()),
    ))
    assert found == (ON_TRUST if told else '')


@pytest.mark.parametrize(('num_lone', 'told'), [(10, ''), (300, 'dusty air: 300 of 2000 points')])
def test_dusty_air_is_told(num_lone, told):
    counts = {'scans_dropped': {}, 'poses_rejected': {}, 'skipped': {}, 'num_scans_lost': 0,
              'num_map_restarts': 0, 'sharpness': {'known': True}}
    height = StageReport(name='height', num_in=2000, num_kept=50, dropped={LONE: num_lone})
    found = describe_losses(types.SimpleNamespace(
        counts=counts, result=types.SimpleNamespace(hazards=(), stages=(height,)),
    ))
    assert told in found
    assert bool(found) == bool(told)
