# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Writes ``tools/corpus``: one small input for each target of ``tools/fuzz_targets.py``."""

import json
from pathlib import Path
import sys
import tempfile

import laspy
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from plc_inspect.config import Settings
from plc_inspect.flight_record.recording import Recording
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.offline.export.files import render_json
from plc_inspect.setting_names import to_mapping

ROOT = Path(__file__).parents[1]
CORPUS = ROOT / 'tools' / 'corpus'
STAMP = 1_700_000_000_000_000_000
LAYOUT = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('time', '<f4')])


def make_messages() -> tuple[bytes, bytes]:
    """Return a PointCloud2 and an Odometry as CDR."""
    maker = MessageMaker()
    rows = np.zeros((1, 12), LAYOUT)
    for number, name in enumerate('xyz'):
        rows[name] = 3.0 + np.arange(12) * (number + 1)
    cloud = maker.cloud(maker.header(STAMP, 'velodyne'), rows)
    make, vector = maker.make, maker.vector
    zero = vector('Vector3', (0.0, 0.0, 0.0))
    odometry = make(
        'nav_msgs/msg/Odometry', header=maker.header(STAMP, 'odom'), child_frame_id='base',
        pose=make('geometry_msgs/msg/PoseWithCovariance', covariance=np.zeros(36), pose=make(
            'geometry_msgs/msg/Pose', position=vector('Point', (1.0, 2.0, 3.0)),
            orientation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
        )),
        twist=make('geometry_msgs/msg/TwistWithCovariance', covariance=np.zeros(36), twist=make(
            'geometry_msgs/msg/Twist', linear=zero, angular=zero,
        )),
    )
    return (bytes(maker.serialize(cloud, 'sensor_msgs/msg/PointCloud2')),
            bytes(maker.serialize(odometry, 'nav_msgs/msg/Odometry')))


def make_bag(folder: Path, scan: bytes, pose: bytes) -> bytes:
    """Return a recording of both."""
    store = MessageMaker().store
    with Writer(folder / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind, raw in (
            ('/velodyne_points', 'sensor_msgs/msg/PointCloud2', scan),
            ('/odometry', 'nav_msgs/msg/Odometry', pose),
        ):
            writer.write(writer.add_connection(topic, kind, typestore=store), STAMP, raw)
    return next((folder / 'bag').glob('*.mcap')).read_bytes()


def make_clouds(folder: Path) -> dict[str, bytes]:
    """Return a cloud of twenty points as LAS, LAZ and PCD."""
    points = np.random.default_rng(1).uniform(0, 50, (20, 3))
    header = laspy.LasHeader(point_format=3, version='1.2')
    header.scales = [0.01] * 3
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    found = {}
    for name in ('las', 'laz'):
        las.write(str(folder / f'a.{name}'))
        found[name] = (folder / f'a.{name}').read_bytes()
    head = ('VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20\nHEIGHT 1\n'
            'VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 20\nDATA binary\n')
    return found | {'pcd': head.encode() + points.astype('<f4').tobytes()}


def make_plain_clouds(folder: Path) -> dict[str, bytes]:
    """Return a cloud of twenty points as E57, PLY and text, and one of two hundred as COPC."""
    from grid.formats import write_copc, write_e57, write_ply, write_xyz

    points = np.random.default_rng(1).uniform(0, 50, (200, 3)).round(3)
    few = points[:20]
    paths = {
        'e57': write_e57(folder / 'a.e57', few, translation=np.array([1.0, 2.0, 3.0])),
        'ply': write_ply(folder / 'a.ply', few),
        'xyz': write_xyz(folder / 'a.xyz', few),
        'csv': write_xyz(folder / 'a.csv', few, mark=',', head='x,y,z'),
        'copc': write_copc(folder / 'a.copc.laz', points, capacity=40),
    }
    return {name: path.read_bytes() for name, path in paths.items()}


def make_record(folder: Path) -> bytes:
    """Return a segment of the record of a flight of one scan."""
    from plc_inspect.core.hazards.clearance_rules import RuleSet
    from plc_inspect.flight_record.plain_values import to_plain
    from plc_inspect.offline.readers.catalogue import load_rules
    from plc_inspect.ros.node.diagnostics import Health
    from plc_inspect.ros.node.intake import Intake

    settings = Settings()
    rules: RuleSet = load_rules(settings.hazards)
    intake = Intake(settings, Health(), print)
    intake.accumulator.resume(('odom', 'base'), None, STAMP)
    recording = Recording(intake.accumulator.map, intake.remember, print)
    recording.begin(
        folder / 'out.record',
        {'settings': to_mapping(settings), 'rules': to_plain(rules)}, fresh=True,
    )
    intake.accumulator.map.insert(np.random.default_rng(2).uniform(0, 9, (50, 3)))
    recording.flush()
    recording.close()
    return (folder / 'out.record' / '000001.mcap').read_bytes()


def make_tables() -> dict[str, bytes]:
    """Return tables of a results folder."""
    from factories import make_inspection

    from plc_inspect.offline.export.files import describe_run
    from plc_inspect.offline.records.inspection import describe_hazard, describe_span

    inspection = make_inspection(num_ground=50)
    head = {'frame_id': 'odom', 'crs': '', 'metres_per_unit': [1.0, 1.0]}
    units = inspection.units
    return {
        'spans': render_json(head | {
            'spans': [describe_span(item, units) for item in inspection.result.spans[:2]],
        }).encode(),
        'hazards': render_json(head | {
            'hazards': [describe_hazard(item, units) for item in inspection.result.hazards],
        }).encode(),
        'run': json.dumps(json.loads(render_json(describe_run(inspection, 0)))).encode(),
    }


def make_stream() -> bytes:
    """Return two messages of the thin link."""
    from stream_pieces import Source

    source = Source()
    parts = [source.summary(1.0, keyframe=True), source.summary(2.0)]
    return b''.join(len(part).to_bytes(2, 'little') + part for part in parts)


def main() -> None:
    """Write one input for each target."""
    sys.path.insert(0, str(ROOT / 'test'))
    scan, pose = make_messages()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inputs = {
            'scan': scan, 'pose': pose, 'mcap': make_bag(folder, scan, pose),
            'record': make_record(folder), **make_clouds(folder), **make_plain_clouds(folder),
            **make_tables(),
        }
    inputs['stream'] = make_stream()
    inputs['settings'] = b'map:\n  voxel_size: 0.2\nhazards:\n  warning_distance: 5.0\n'
    inputs['rules'] = (ROOT / 'config/rules/en50423_cz.yaml').read_bytes()
    for target, data in inputs.items():
        path = CORPUS / target / 'seed'
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


if __name__ == '__main__':
    main()
