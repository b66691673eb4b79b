# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from plc_inspect.config import InputSettings
from plc_inspect.core.mapping.deskew import deskew
from plc_inspect.core.mapping.pose_buffer import Bracket, PoseBuffer
from plc_inspect.core.setup.transforms import make_transform
from plc_inspect.errors import DataError

MS = 1_000_000
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def make_poses(stamps, positions, quaternions):
    poses = PoseBuffer(InputSettings())
    for stamp, position, quaternion in zip(stamps, positions, quaternions, strict=True):
        poses.insert(int(stamp), position, quaternion)
    return poses


def test_quarter_turn_by_hand():
    turn = Rotation.from_euler('z', [[0], [90]], degrees=True)
    poses = make_poses([0, 100 * MS], [(0, 0, 0), (1, 0, 0)], turn.as_quat())
    xyz = np.tile(np.array([[10, 0, 2]], np.float32), (3, 1))
    result = deskew(xyz, np.array([0, 50, 100]) * MS, poses, np.eye(4))
    half = 10 / np.sqrt(2)
    np.testing.assert_allclose(
        result.points, [[10, 0, 2], [0.5 + half, half, 2], [1, 10, 2]], atol=1e-12
    )
    assert result.complete


def test_every_point_has_the_pose_of_its_own_time():
    # 20 m/s and about 3 rad/s, seen at up to 100 m: scipy says where each point is.
    rng = np.random.default_rng(0)
    stamps = 1_700_000_000_000_000_000 + np.arange(30) * 10 * MS
    positions = [4e5, 5e6, 80] + np.arange(30)[:, None] * [0.2, 0.0, 0.01]
    rotations = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.02, (30, 3)), axis=0))
    quaternions = rotations.as_quat()
    quaternions[::3] *= -1.0  # the same rotations: the short way must still be taken
    mount = make_transform((0.1, -0.2, 0.3), (180, 5, -30))
    times = rng.integers(stamps[0], stamps[-1], 3000)
    xyz = rng.uniform(-60, 60, (3000, 3)).astype(np.float32)
    result = deskew(xyz, times, make_poses(stamps, positions, quaternions), mount)
    seconds, known = (times - stamps[0]) * 1e-9, (stamps - stamps[0]) * 1e-9
    base = xyz.astype(np.float64) @ mount[:3, :3].T + mount[:3, 3]
    expected = Slerp(known, rotations)(seconds).apply(base)
    for axis in range(3):
        expected[:, axis] += np.interp(seconds, known, positions[:, axis])
    np.testing.assert_allclose(result.points, expected, rtol=0, atol=1e-6)


def test_moving_sensor_sees_a_fixed_point_at_one_place():
    stamps = np.arange(12) * 10 * MS
    yaw = Rotation.from_euler('z', np.arange(12)[:, None] * 0.05)
    positions = np.arange(12)[:, None] * [0.2, 0.1, 0.0]
    times = np.linspace(0, stamps[-1], 500).astype(np.int64)
    target = np.array([30.0, 20.0, 12.0])
    where = np.stack([np.interp(times, stamps, positions[:, i]) for i in range(3)], axis=1)
    seen = Slerp(stamps, yaw)(times).inv().apply(target - where)
    result = deskew(
        seen.astype(np.float32), times, make_poses(stamps, positions, yaw.as_quat()), np.eye(4)
    )
    np.testing.assert_allclose(result.points, np.tile(target, (500, 1)), atol=1e-5)


def test_points_without_pose_are_nan_and_say_why():
    poses = make_poses([0, 100 * MS], np.zeros((2, 3)), [UPRIGHT] * 2)
    result = deskew(np.ones((3, 3), np.float32), np.array([-1, 50, 101]) * MS, poses, np.eye(4))
    assert result.bracket.tolist() == [Bracket.BEFORE, Bracket.OK, Bracket.AFTER]
    assert np.isnan(result.points[[0, 2]]).all()
    np.testing.assert_array_equal(result.points[1], [1, 1, 1])
    assert not result.complete


def test_empty_scan():
    result = deskew(
        np.empty((0, 3), np.float32), np.empty(0, np.int64), PoseBuffer(InputSettings()), np.eye(4)
    )
    assert (result.points.shape, result.points.dtype) == ((0, 3), np.float64)
    assert result.complete


def test_input_is_unchanged():
    poses = make_poses([0, 100 * MS], np.ones((2, 3)), [UPRIGHT] * 2)
    xyz, stamps, mount = np.ones((4, 3), np.float32), np.arange(4), np.eye(4)
    for array in (xyz, stamps, mount):
        array.flags.writeable = False
    first = deskew(xyz, stamps, poses, mount)
    np.testing.assert_array_equal(first.points, np.full((4, 3), 2.0))


@pytest.mark.parametrize(
    ('shape', 'mount', 'message'),
    [((3, 3), np.eye(4), '2 stamps'), ((2, 2), np.eye(4), r'\(2, 2\)'),
     ((2, 3), np.eye(3), r'\(4, 4\)')],
)
def test_arrays_that_do_not_belong_together(shape, mount, message):
    with pytest.raises(DataError, match=message):
        deskew(np.zeros(shape, np.float32), np.zeros(2, np.int64), PoseBuffer(InputSettings()),
               mount)


@pytest.mark.parametrize('rpy', [(0, 0, 0), (90, 0, 0), (10, -20, 30), (180, 45, -170)])
def test_transform_is_that_of_urdf(rpy):
    transform = make_transform((1, 2, 3), rpy)
    expected = Rotation.from_euler('xyz', rpy, degrees=True).as_matrix()
    np.testing.assert_allclose(transform[:3, :3], expected, atol=1e-15)
    np.testing.assert_array_equal(transform[:, 3], [1, 2, 3, 1])


def test_nose_down_lidar():
    # Pitch is positive nose down in REP-103: what lies ahead of the sensor lies below the base.
    ahead = make_transform((0, 0, 0), (0, 30, 0)) @ [10, 0, 0, 1]
    np.testing.assert_allclose(ahead[:3], [10 * np.cos(np.pi / 6), 0, -5], atol=1e-12)
