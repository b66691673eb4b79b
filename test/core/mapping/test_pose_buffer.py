# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from plc_inspect.config import InputSettings
from plc_inspect.core.mapping.pose_buffer import Bracket, PoseBuffer, PoseStatus, RESTART_AFTER
from plc_inspect.errors import DataError

MS = 1_000_000
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
EPOCH = 1_700_000_000_123_456_789


def make_buffer(stamps, positions=None, quaternions=None, **settings):
    capacity = settings.pop('capacity', 100)
    buffer = PoseBuffer(InputSettings(**settings), capacity)
    for i, stamp in enumerate(stamps):
        position = (0.0, 0.0, 0.0) if positions is None else positions[i]
        buffer.insert(int(stamp), position, UPRIGHT if quaternions is None else quaternions[i])
    return buffer


def make_walk(num_poses, seed=0):
    rng = np.random.default_rng(seed)
    stamps = EPOCH + np.cumsum(rng.integers(5 * MS, 15 * MS, num_poses))
    positions = np.cumsum(rng.normal(0, 0.04, (num_poses, 3)), axis=0)
    positions += np.array([5e5, 6e6, 100.0])
    rotations = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.02, (num_poses, 3)), axis=0))
    return stamps, positions, rotations


def test_interpolation_is_that_of_scipy():
    stamps, positions, rotations = make_walk(200)
    quaternions = rotations.as_quat()
    quaternions[::3] *= -1.0  # the same rotations: the short way must still be taken
    buffer = make_buffer(stamps, positions, quaternions, capacity=200)
    wanted = np.random.default_rng(1).integers(stamps[0], stamps[-1], 5000)
    samples = buffer.interpolate(wanted)
    assert not samples.bracket.any()
    seconds, known = (wanted - EPOCH) * 1e-9, (stamps - EPOCH) * 1e-9
    for axis in range(3):
        expected = np.interp(seconds, known, positions[:, axis])
        np.testing.assert_allclose(samples.positions[:, axis], expected, atol=1e-6)
    expected = Slerp(known, rotations)(seconds)
    difference = (expected.inv() * Rotation.from_quat(samples.quaternions)).magnitude()
    assert difference.max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(samples.quaternions, axis=1), 1.0, rtol=1e-12)


def test_halfway_by_hand():
    quarter = (0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4))
    buffer = make_buffer([0, 100 * MS], [(0, 0, 0), (1, 2, 4)], [UPRIGHT, quarter])
    samples = buffer.interpolate(np.array([50 * MS]))
    np.testing.assert_allclose(samples.positions, [[0.5, 1.0, 2.0]])
    np.testing.assert_allclose(
        samples.quaternions, [[0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)]], atol=1e-15
    )


def test_nothing_is_extrapolated():
    buffer = make_buffer([100 * MS, 200 * MS])
    wanted = np.array([100 * MS - 1, 100 * MS, 150 * MS, 200 * MS, 200 * MS + 1])
    samples = buffer.interpolate(wanted)
    assert samples.bracket.tolist() == [
        Bracket.BEFORE, Bracket.OK, Bracket.OK, Bracket.OK, Bracket.AFTER,
    ]
    assert np.isnan(samples.positions[[0, 4]]).all()
    assert np.isnan(samples.quaternions[[0, 4]]).all()
    assert np.isfinite(samples.positions[1:4]).all()


@pytest.mark.parametrize('stamps', [[], [100 * MS]])
def test_fewer_than_two_poses_bracket_nothing(stamps):
    samples = make_buffer(stamps).interpolate(np.array([100 * MS]))
    assert samples.bracket.tolist() == [Bracket.AFTER]
    assert np.isnan(samples.positions).all()


def test_no_stamps():
    samples = make_buffer([0, MS]).interpolate(np.empty(0, np.int64))
    assert samples.positions.shape == (0, 3)
    assert samples.quaternions.shape == (0, 4)


def test_gap_is_not_bridged_and_its_limit_is_inclusive():
    buffer = make_buffer([0, 250 * MS, 501 * MS, 600 * MS])
    samples = buffer.interpolate(np.array([100, 300, 550, 250, 501]) * MS)
    assert samples.bracket.tolist() == [0, Bracket.GAP, 0, 0, 0]
    assert buffer.num_gaps == 1


def test_jump_is_not_bridged():
    positions = [(0, 0, 0), (0, 0, 0), (7, 0, 0), (7, 0, 0)]
    buffer = make_buffer(np.arange(4) * 100 * MS, positions)
    samples = buffer.interpolate(np.array([50, 150, 250]) * MS)
    assert samples.bracket.tolist() == [0, Bracket.JUMP, 0]
    assert buffer.num_jumps == 1
    assert make_buffer([0, 100 * MS], [(0, 0, 0), (5.9, 0, 0)]).num_jumps == 0


def test_flipped_orientation_is_a_jump():
    buffer = make_buffer([0, 10 * MS], quaternions=[UPRIGHT, (1.0, 0.0, 0.0, 0.0)])
    assert buffer.interpolate(np.array([5 * MS])).bracket.tolist() == [Bracket.JUMP]


@pytest.mark.parametrize(
    ('position', 'quaternion', 'status'),
    [
        ((np.nan, 0, 0), UPRIGHT, PoseStatus.NOT_FINITE),
        ((0, 0, np.inf), UPRIGHT, PoseStatus.NOT_FINITE),
        ((0, 0, 0), (0, np.nan, 0, 1), PoseStatus.NOT_FINITE),
        ((0, 0, 0), (0, 0, 0, 0), PoseStatus.BAD_QUATERNION),
        ((0, 0, 0), (0, 0, 0, 1.02), PoseStatus.BAD_QUATERNION),
    ],
)
def test_bad_pose_is_rejected_and_counted(position, quaternion, status):
    buffer = make_buffer([0])
    assert buffer.insert(10 * MS, position, quaternion) is status
    assert len(buffer) == 1
    assert buffer.counts == {PoseStatus.ACCEPTED: 1, status: 1}


@pytest.mark.parametrize('stamp', [100, 99])
def test_repeated_and_backward_stamps_are_rejected(stamp):
    buffer = make_buffer([50, 100])
    assert buffer.insert(stamp, (0, 0, 0), UPRIGHT) is PoseStatus.NOT_LATER
    assert buffer.last_stamp == 100


def test_one_stamp_in_the_future_does_not_end_the_odometry():
    buffer = make_buffer([10, 20, 10**15])
    statuses = [buffer.insert(30 + i, (0, 0, 0), UPRIGHT) for i in range(RESTART_AFTER + 3)]
    assert set(statuses[: RESTART_AFTER - 1]) == {PoseStatus.NOT_LATER}
    assert statuses[RESTART_AFTER - 1] is PoseStatus.RESTARTED
    assert set(statuses[RESTART_AFTER:]) == {PoseStatus.ACCEPTED}
    assert (buffer.first_stamp, len(buffer)) == (30 + RESTART_AFTER - 1, 4)


def test_repetitions_of_old_poses_do_not_restart():
    buffer = make_buffer([10, 20])
    for _ in range(5 * RESTART_AFTER):
        assert buffer.insert(20, (0, 0, 0), UPRIGHT) is PoseStatus.NOT_LATER
    for i in range(5 * RESTART_AFTER):
        assert buffer.insert(30 + i, (0, 0, 0), UPRIGHT) is PoseStatus.ACCEPTED
        assert buffer.insert(15, (0, 0, 0), UPRIGHT) is PoseStatus.NOT_LATER


def test_the_oldest_make_room():
    stamps, positions, rotations = make_walk(95, seed=3)
    small = make_buffer(stamps, positions, rotations.as_quat(), capacity=10)
    large = make_buffer(stamps, positions, rotations.as_quat(), capacity=95)
    assert (len(small), small.first_stamp) == (10, stamps[-10])
    wanted = np.linspace(stamps[-10], stamps[-1], 50).astype(np.int64)[1:-1]
    np.testing.assert_array_equal(
        small.interpolate(wanted).positions, large.interpolate(wanted).positions
    )
    assert small.interpolate(stamps[-11:-10]).bracket.tolist() == [Bracket.BEFORE]


def test_order_of_stamps_does_not_matter():
    stamps, positions, rotations = make_walk(50, seed=4)
    buffer = make_buffer(stamps, positions, rotations.as_quat())
    rng = np.random.default_rng(5)
    wanted = np.sort(rng.integers(stamps[0] - 20 * MS, stamps[-1] + 20 * MS, 1000))
    order = rng.permutation(1000)
    whole, shuffled = buffer.interpolate(wanted), buffer.interpolate(wanted[order])
    np.testing.assert_array_equal(whole.bracket[order], shuffled.bracket)
    np.testing.assert_array_equal(whole.positions[order], shuffled.positions)


def test_input_is_unchanged_and_capacity_checked():
    quaternion = np.array([0.0, 0.0, 0.0, 1.005])
    make_buffer([0], [np.zeros(3)], [quaternion])
    assert quaternion[3] == 1.005
    with pytest.raises(DataError, match='capacity 1'):
        PoseBuffer(InputSettings(), capacity=1)
