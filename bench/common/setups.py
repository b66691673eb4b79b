# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The demo flight as other vehicles would have recorded it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation, Slerp

from plc_inspect.core.setup.transforms import make_transform, to_quaternion
from plc_inspect.messages.poses import POSE_TYPES, StampedPose
from plc_inspect.messages.typestore import MessageMaker
from plc_inspect.offline.readers.bags import Recording

DEMO = Path(__file__).resolve().parents[2] / 'bags' / 'demo'
SCAN = 'sensor_msgs/msg/PointCloud2'
TF = 'tf2_msgs/msg/TFMessage'


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """One scan."""

    log_ns: int
    stamp_ns: int
    xyz: np.ndarray
    """(N, 3) lidar frame [m]."""
    time: np.ndarray
    """(N,) relative to the stamp [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Scans and poses of a recording."""

    scans: list[Turn]
    pose_ns: np.ndarray
    """(M,) stamps [ns], which the poses are recorded at, too."""
    position: np.ndarray
    """(M, 3) [m]."""
    quaternion: np.ndarray
    """(M, 4) x y z w."""

    def at(self, stamps: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Return positions (N, 3) and rotations at some stamps [ns]."""
        own = (self.pose_ns - self.pose_ns[0]) * 1e-9
        when = np.clip((stamps - self.pose_ns[0]) * 1e-9, own[0], own[-1])
        places = np.column_stack([np.interp(when, own, column) for column in self.position.T])
        return places, Slerp(own, Rotation.from_quat(self.quaternion))(when)


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """How a vehicle records."""

    scan_topic: str = '/velodyne_points'
    scan_frame: str = 'velodyne'
    time_field: tuple[str, str, float] | None = ('time', '<f4', 1.0)
    """Name, type and unit [s] of the times of points, None: none."""
    pose_topic: str = '/odometry'
    pose_type: str = 'Odometry'
    """Of POSE_TYPES, 'tf' or '' for none."""
    map_frame: str = 'odom'
    base_frame: str = 'base_link'
    mount: tuple[tuple[float, ...], tuple[float, ...]] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    """Position [m] and roll, pitch and yaw [degrees] of the lidar on the base."""
    fixed: tuple[tuple[str, str, tuple[float, ...], tuple[float, ...]], ...] = ()
    """Of /tf_static: parent, child, position [m], roll pitch yaw [degrees]."""
    lead: float = 0.0
    """Scan stamps are ahead of the odometry by so much [s]."""
    pose_step: int = 1
    """Every so many poses are recorded."""
    deskewed: bool = False
    """Scans are in the frame of the odometry."""
    world: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the world in the frame of the odometry [degrees]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """A vehicle, what its user sets, and what is to come of it."""

    name: str
    layout: Layout = field(default_factory=Layout)
    settings: Mapping[str, Any] = field(default_factory=dict)
    cause: str = ''
    """Words that name why nothing can come of it, '' where all is found."""


def read_flight(path: Path = DEMO, *, step: int = 1, seconds: float = 1e9) -> Flight:
    """Return every step-th scan and all poses of the first part of a recording."""
    scans: list[Turn] = []
    stamps, places, turns = [], [], []
    count, first = 0, None
    with Recording(path, 'velodyne_points', 'odometry') as recording:
        for message in recording:
            first = message.log_stamp_ns if first is None else first
            if (message.log_stamp_ns - first) * 1e-9 > seconds:
                break
            content = message.content
            if isinstance(content, StampedPose):
                stamps.append(content.stamp_ns)
                places.append(content.position)
                turns.append(content.quaternion)
                continue
            count += 1
            if count % step == 0:
                scans.append(Turn(
                    message.log_stamp_ns, content.stamp_ns, content.xyz, content.time,
                ))
    return Flight(scans, np.array(stamps), np.array(places), np.array(turns))


def remount(flight: Flight, layout: Layout) -> Flight:
    """Return the flight with its points in the frame of a lidar mounted otherwise."""
    back = np.linalg.inv(make_transform(*layout.mount))
    if np.array_equal(back, np.eye(4)):
        return flight
    return replace(flight, scans=[
        replace(scan, xyz=(scan.xyz @ back[:3, :3].T + back[:3, 3]).astype(np.float32))
        for scan in flight.scans
    ])


def turn_world(flight: Flight, layout: Layout) -> Flight:
    """Return the flight with poses in a frame that stands otherwise."""
    turn = Rotation.from_euler('xyz', layout.world, degrees=True)
    return replace(
        flight, position=turn.apply(flight.position),
        quaternion=(turn * Rotation.from_quat(flight.quaternion)).as_quat(),
    )


def write_bag(folder: Path, flight: Flight, layout: Layout) -> Path:
    """Write the flight as a vehicle of some layout records it, and return the folder."""
    maker = MessageMaker()
    flight = turn_world(remount(flight, layout), layout)
    messages: list[tuple[int, str, str, Any]] = []
    for scan in flight.scans:
        messages.append((scan.log_ns, layout.scan_topic, SCAN, _make_scan(
            maker, flight, scan, layout,
        )))
    if layout.pose_type:
        for index in range(0, len(flight.pose_ns), layout.pose_step):
            messages.append((int(flight.pose_ns[index]), *_make_pose(
                maker, flight, index, layout,
            )))
    messages.sort(key=lambda item: item[0])
    begin = messages[0][0]
    fixed = [
        _make_transform(maker, 0, parent, child, make_transform(place, turn))
        for parent, child, place, turn in layout.fixed
    ]
    if fixed:
        messages.insert(0, (begin, '/tf_static', TF, maker.make(TF, transforms=fixed)))
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for log, topic, kind, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=maker.store)
            writer.write(connections[topic], log, maker.serialize(message, kind))
    return folder


def _make_scan(maker: MessageMaker, flight: Flight, scan: Turn, layout: Layout) -> Any:
    xyz, frame = scan.xyz, layout.scan_frame
    if layout.deskewed:
        places, turns = flight.at(scan.stamp_ns + np.rint(scan.time * 1e9).astype(np.int64))
        xyz, frame = (turns.apply(xyz) + places).astype(np.float32), layout.map_frame
    kinds = [(axis, '<f4') for axis in 'xyz'] + [('intensity', '<f4')]
    stamp, times = scan.stamp_ns, scan.time
    if layout.time_field:
        name, kind, unit = layout.time_field
        kinds.append((name, kind))
        if np.dtype(kind).kind == 'u':  # counts from the first point, which the stamp is of
            stamp += round(float(times.min()) * 1e9)
            times = times - times.min()
    rows = np.zeros(len(xyz), kinds)
    for axis, column in zip('xyz', xyz.T, strict=True):
        rows[axis] = column
    if layout.time_field:
        rows[name] = np.rint(times / unit) if np.dtype(kind).kind == 'u' else times / unit
    return maker.cloud(maker.header(stamp + round(layout.lead * 1e9), frame), rows)


def _make_pose(
    maker: MessageMaker, flight: Flight, index: int, layout: Layout
) -> tuple[str, str, Any]:
    stamp, place = int(flight.pose_ns[index]), flight.position[index]
    x, y, z, w = (float(value) for value in flight.quaternion[index])
    make, vector = maker.make, maker.vector
    if layout.pose_type == 'tf':
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
        matrix[:3, 3] = place
        item = _make_transform(maker, stamp, layout.map_frame, layout.base_frame, matrix)
        return '/tf', TF, make(TF, transforms=[item])
    header = maker.header(stamp, layout.map_frame)
    turn = make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)
    pose = make(
        'geometry_msgs/msg/Pose', position=vector('Point', place), orientation=turn
    )
    kind = POSE_TYPES[layout.pose_type]
    if layout.pose_type == 'PoseStamped':
        return layout.pose_topic, kind, make(kind, header=header, pose=pose)
    both = make('geometry_msgs/msg/PoseWithCovariance', pose=pose, covariance=np.zeros(36))
    if layout.pose_type == 'PoseWithCovarianceStamped':
        return layout.pose_topic, kind, make(kind, header=header, pose=both)
    still = make('geometry_msgs/msg/Twist', linear=vector('Vector3', (0.0, 0.0, 0.0)),
                 angular=vector('Vector3', (0.0, 0.0, 0.0)))
    twist = make('geometry_msgs/msg/TwistWithCovariance', twist=still, covariance=np.zeros(36))
    return layout.pose_topic, kind, make(
        kind, header=header, child_frame_id=layout.base_frame, pose=both, twist=twist
    )


def _make_transform(
    maker: MessageMaker, stamp: int, parent: str, child: str, matrix: np.ndarray
) -> Any:
    x, y, z, w = (float(value) for value in to_quaternion(matrix[:3, :3]))
    return maker.make(
        'geometry_msgs/msg/TransformStamped', header=maker.header(stamp, parent),
        child_frame_id=child,
        transform=maker.make(
            'geometry_msgs/msg/Transform', translation=maker.vector('Vector3', matrix[:3, 3]),
            rotation=maker.make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w),
        ),
    )


TILT = (0.1, 0.0, -0.15), (0.0, 30.0, 0.0)
ON_TF = (('base_link', 'velodyne', *TILT),)
MAVROS = {'map_frame': 'map', 'base_frame': 'base_link'}
TOPICS = {'scan': 'input.scan_topic', 'pose': 'input.odometry_topic'}


def _named(name: str, scan: str, pose: str, cause: str = '', **layout: Any) -> Setup:
    """Return a vehicle whose topics are called otherwise, and set so."""
    return Setup(
        name=name, cause=cause, layout=Layout(scan_topic=scan, pose_topic=pose, **layout),
        settings={TOPICS['scan']: scan, TOPICS['pose']: pose},
    )


def _mounted(name: str, turn: tuple[float, ...]) -> list[Setup]:
    """Return a vehicle with a mount that the settings tell, and one with it in /tf_static."""
    mount = ((0.1, 0.0, -0.2), turn)
    told = {'input.lidar_xyz': list(mount[0]), 'input.lidar_rpy_deg': list(turn)}
    return [
        Setup(name=f'{name}, by settings', layout=Layout(mount=mount), settings=told),
        Setup(name=f'{name}, by /tf_static', layout=Layout(
            mount=mount, fixed=(('base_link', 'velodyne', *mount),),
        )),
    ]


NOT_SHARP = 'check mount'
"""In what is said where the map is not sharp, and where planes tell the mount."""
ON_ITS_HEAD = 'the ground lies above the vehicle'
"""In what is said where z of the map points down."""

SETUPS = [
    Setup(name='as recorded'),
    Setup(name='Ouster (t, uint32 ns)', layout=Layout(time_field=('t', '<u4', 1e-9))),
    Setup(name='Livox (offset_time, uint32 ns)',
          layout=Layout(time_field=('offset_time', '<u4', 1e-9))),
    Setup(name='time in microseconds (uint32)',
          layout=Layout(time_field=('time', '<u4', 1e-6))),
    Setup(name='odometry at 5 Hz', layout=Layout(pose_step=10)),
    Setup(name='odometry at 3 Hz', layout=Layout(pose_step=17),
          cause='odometry comes every 0.34 s'),
    Setup(name='lidar clock 18 s ahead', layout=Layout(lead=18.0),
          cause='scan stamps are 18.0 s ahead of odometry'),
    Setup(name='lidar clock from power-on', layout=Layout(lead=-1_767_225_500.0),
          cause='count from a start'),
    Setup(name='no poses', layout=Layout(pose_type=''), cause='has no /odometry'),
    _named('FAST-LIO, deskewed', '/cloud_registered', '/Odometry', map_frame='camera_init',
           base_frame='body', deskewed=True),
    _named('FAST-LIO, /velodyne_points', '/velodyne_points', '/Odometry',
           map_frame='camera_init', base_frame='body'),
    _named('Point-LIO, deskewed', '/cloud_registered', '/aft_mapped_to_init',
           map_frame='camera_init', base_frame='aft_mapped', deskewed=True),
    _named('LIO-SAM', '/points_raw', '/lio_sam/mapping/odometry', base_frame='odom_mapping'),
    _named('KISS-ICP', '/velodyne_points', '/kiss/odometry', map_frame='odom_lidar',
           base_frame='velodyne'),
    _named('DLIO, deskewed', '/dlio/odom_node/pointcloud/deskewed', '/dlio/odom_node/odom',
           deskewed=True),
    _named('MAVROS, Odometry', '/velodyne_points', '/mavros/local_position/odom', **MAVROS),
    _named('MAVROS, PoseStamped', '/velodyne_points', '/mavros/local_position/pose',
           pose_type='PoseStamped', **MAVROS),
    _named('PoseWithCovarianceStamped', '/velodyne_points', '/pose',
           pose_type='PoseWithCovarianceStamped'),
    Setup(name='poses on tf only', layout=Layout(pose_type='tf')),
    Setup(name='poses on tf, other frames', layout=Layout(
        pose_type='tf', map_frame='camera_init', base_frame='body',
    ), cause='does not lead from odom to base_link'),
    Setup(name='poses on tf, other frames, set', layout=Layout(
        pose_type='tf', map_frame='camera_init', base_frame='body',
    ), settings={'input.map_frame': 'camera_init', 'input.base_frame': 'body'}),
    Setup(name='PoseStamped, mount on /tf_static', layout=Layout(
        pose_type='PoseStamped', mount=TILT, fixed=ON_TF,
    )),
    *_mounted('tilted by 30 degrees', (0.0, 30.0, 0.0)),
    *_mounted('turned by 40 degrees', (0.0, 0.0, 40.0)),
    *_mounted('upside down', (180.0, 0.0, 0.0)),
    *_mounted('on its side', (90.0, 0.0, 0.0)),
    *_mounted('looking down', (0.0, 90.0, 0.0)),
    Setup(name='upside down, not told', layout=Layout(
        mount=((0.1, 0.0, -0.2), (180.0, 0.0, 0.0)),
    ), cause=ON_ITS_HEAD),
    Setup(name='z of the odometry down', layout=Layout(world=(180.0, 0.0, 0.0)),
          cause=ON_ITS_HEAD),
    Setup(name='north, east, down', layout=Layout(world=(180.0, 0.0, 90.0)), cause=ON_ITS_HEAD),
    _named('FAST-LIO, begun upside down', '/cloud_registered', '/Odometry',
           map_frame='camera_init', base_frame='body', deskewed=True,
           world=(180.0, 0.0, 0.0), cause=ON_ITS_HEAD),
    Setup(name='tilted by 30 degrees, not told', layout=Layout(mount=TILT), cause=NOT_SHARP),
    Setup(name='tilted, /tf_static of other frames', layout=Layout(
        mount=TILT, fixed=(('imu', 'camera', *TILT),),
    ), cause=NOT_SHARP),
]
"""The rows of the table."""
