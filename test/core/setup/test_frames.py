# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixed and moving frames, and the mount that follows from them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plc_inspect.config import InputSettings
from plc_inspect.core.setup.mount import choose_mount
from plc_inspect.core.setup.moving_frames import MovingFrames
from plc_inspect.core.setup.transforms import (
    FrameTree,
    make_transform,
    measure_apart,
    split_transform,
    StampedTransform,
    to_matrix,
    to_quaternion,
)
from plc_inspect.errors import DataError


def edge(parent, child, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), stamp=0):
    """Return a transform by position [m] and angles [degrees]."""
    matrix = make_transform(xyz, rpy)
    return StampedTransform(stamp, parent, child, matrix[:3, 3], to_quaternion(matrix[:3, :3]))


def grow(*edges):
    """Return a tree of fixed frames."""
    tree = FrameTree()
    for item in edges:
        tree.add(item)
    return tree


def test_quaternions_there_and_back():
    rng = np.random.default_rng(1)
    for turn in (*Rotation.random(50, rng=rng), Rotation.from_euler('x', 180.0, degrees=True)):
        quaternion = to_quaternion(turn.as_matrix())
        assert (Rotation.from_quat(quaternion) * turn.inv()).magnitude() < 1e-7
        item = StampedTransform(0, 'a', 'b', np.zeros(3), quaternion)
        np.testing.assert_allclose(to_matrix(item)[:3, :3], turn.as_matrix(), atol=1e-12)


@pytest.mark.parametrize('rpy', [(0, 30, 0), (180, 0, 0), (10, -20, 170), (0, 90, 0), (0, -90, 9)])
def test_angles_there_and_back(rpy):
    matrix = make_transform((1.0, 2.0, 3.0), rpy)
    place, turn = split_transform(matrix)
    np.testing.assert_allclose(make_transform(place, turn), matrix, atol=1e-9)


def test_distance_and_angle_between_poses():
    one, other = make_transform((0, 0, 0), (0, 0, 0)), make_transform((3, 0, 4), (0, 0, 30))
    assert measure_apart(one, other) == pytest.approx((5.0, 30.0))


def test_a_frame_fixed_to_itself_is_refused():
    tree = grow(edge('base_link', 'velodyne', (0, 0, 1)))
    for _ in range(2):
        with pytest.raises(DataError, match="'velodyne' is fixed to itself"):
            tree.add(edge('velodyne', '/velodyne', (0, 0, 2)))
    assert tree.find('base_link', 'velodyne')[2, 3] == 1.0


def test_frames_fixed_to_each_other_are_refused_and_the_first_holds():
    tree = grow(edge('a', 'b', (1, 0, 0)), edge('b', 'c', (2, 0, 0)))
    for _ in range(2):
        for parent in ('b', 'c'):
            with pytest.raises(DataError, match=f"'a' is fixed to '{parent}', which is fixed to"):
                tree.add(edge(parent, 'a'))
    tree.add(edge('a', 'c', (5, 0, 0)))
    tree.add(edge('c', 'b', (1, 0, 0)))  # no circle any more
    assert tree.find('a', 'b')[0, 3] == 6.0


def test_ways_up_and_down_the_tree():
    tree = grow(
        edge('base', 'mast', (0, 0, 1)), edge('mast', 'lidar', (1, 0, 0), (0, 30, 0)),
        edge('/base', '/imu', (0, 0, -0.2), (0, 0, 90)),
    )
    expected = make_transform((1, 0, 1), (0, 30, 0))
    np.testing.assert_allclose(tree.find('base', 'lidar'), expected, atol=1e-12)
    np.testing.assert_allclose(tree.find('lidar', 'base'), np.linalg.inv(expected), atol=1e-12)
    imu = make_transform((0, 0, -0.2), (0, 0, 90))
    across = np.linalg.inv(imu) @ expected
    np.testing.assert_allclose(tree.find('imu', 'lidar'), across, atol=1e-12)
    assert tree.find('base', 'camera') is None
    np.testing.assert_array_equal(tree.find('nobody', 'nobody'), np.eye(4))


def test_a_newer_transform_replaces_that_of_its_child():
    tree = grow(edge('base', 'lidar', (1, 0, 0)), edge('mast', 'lidar', (2, 0, 0)))
    assert tree.find('base', 'lidar') is None
    assert tree.find('mast', 'lidar')[0, 3] == 2.0


def test_what_is_no_transform_is_refused():
    with pytest.raises(DataError, match='from base to lidar is none'):
        FrameTree().add(StampedTransform(0, 'base', 'lidar', np.zeros(3), np.zeros(4)))


MOUNT = edge('base_link', 'velodyne', (0.1, 0.0, -0.15), (0.0, 30.0, 0.0))


@pytest.mark.parametrize(('settings', 'base', 'rpy', 'doubt'), [
    ({}, 'base_link', (0, 30, 0), ''),
    ({}, '', (0, 30, 0), ''),
    ({'use_tf': False}, 'base_link', (0, 0, 0), ''),
    ({'lidar_rpy_deg': (0.0, 20.0, 0.0)}, 'base_link', (0, 20, 0), '0.18 m and 10.0 degrees off'),
    ({'lidar_rpy_deg': (0.0, 30.05, 0.0), 'lidar_xyz': (0.1, 0.0, -0.15)}, 'base_link',
     (0, 30.05, 0), ''),
    ({}, 'odom_mapping', (0, 0, 0), 'no way leads from odom_mapping to velodyne'),
    ({'base_frame': 'velodyne'}, '', (0, 0, 0), ''),
])
def test_mount_by_settings_else_by_tf(settings, base, rpy, doubt):
    mount = choose_mount(InputSettings(**settings), grow(MOUNT), base, 'velodyne')
    np.testing.assert_allclose(split_transform(mount.transform)[1], rpy, atol=1e-9)
    assert (doubt in mount.doubt) if doubt else mount.doubt == ''
    assert 'degrees, from ' in mount.describe()


def test_without_tf_nothing_is_doubted():
    mount = choose_mount(InputSettings(), FrameTree(), 'base_link', 'velodyne')
    np.testing.assert_array_equal(mount.transform, np.eye(4))
    assert mount.doubt == ''


def test_pose_through_fixed_frames_on_both_sides():
    fixed = grow(edge('odom', 'start', (10, 0, 0)), edge('body', 'base_link', (0, 0, -1)))
    frames = MovingFrames(fixed, 'odom', 'base_link')
    assert frames.add(edge('elsewhere', 'other')) is None
    assert 'elsewhere -> other' in frames.explain()
    position, quaternion = frames.add(edge('start', 'body', (1, 2, 3), (0, 0, 90), stamp=5))
    np.testing.assert_allclose(position, (11, 2, 2), atol=1e-12)
    np.testing.assert_allclose(abs(quaternion), (0, 0, 0.5**0.5, 0.5**0.5), atol=1e-12)
    assert frames.explain() == ''


@pytest.mark.parametrize('fixed', [
    (edge('world', 'odom', (10, 0, 0)), edge('world', 'map', (4, 0, 0))),
    (edge('odom', 'map', (-6, 0, 0)),),
    (edge('earth', 'world'), edge('world', 'odom', (10, 0, 0)), edge('earth', 'region'),
     edge('region', 'map', (4, 0, 0))),
])
def test_pose_where_the_map_is_fixed_beside_or_below_the_odometry(fixed):
    frames = MovingFrames(grow(*fixed), 'map', 'base_link')
    assert frames.add(edge('base_link', 'gimbal')) is None
    assert not frames.complete
    position, _ = frames.add(edge('odom', 'base_link', (1, 2, 3)))
    np.testing.assert_allclose(position, (7, 2, 3), atol=1e-12)
    assert frames.complete
    assert frames.add(edge('base_link', 'gimbal')) is None
    assert frames.add(edge('body', 'base_link')) is None
    with pytest.raises(DataError, match='2 transforms move between map and base_link'):
        frames.add(edge('odom', 'body'))


def test_two_frames_that_move_beside_each_other_give_no_pose():
    frames = MovingFrames(FrameTree(), 'map', 'base_link')
    assert frames.add(edge('world', 'map')) is None
    assert frames.add(edge('world', 'base_link')) is None
    assert 'world -> base_link, world -> map' in frames.explain()


def test_two_moving_transforms_are_refused():
    frames = MovingFrames(FrameTree(), 'map', 'base_link')
    assert frames.add(edge('odom', 'base_link')) is None
    with pytest.raises(DataError, match='2 transforms move between map and base_link'):
        frames.add(edge('map', 'odom'))


def test_frames_in_a_circle_end():
    frames = MovingFrames(FrameTree(), 'map', 'a')
    frames.add(edge('b', 'a'))
    assert frames.add(edge('a', 'b')) is None
    assert not frames.complete
