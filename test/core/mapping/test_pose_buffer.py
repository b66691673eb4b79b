# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plc_inspect.config import InputSettings
from plc_inspect.core.mapping.pose_buffer import (
    Bracket,
    bracket_stamps,
    PoseBuffer,
    PoseStatus,
)
from plc_inspect.core.mapping.scan_clock import RESTART_AFTER
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


def bracket(buffer, wanted):
    """Return the later pose and the Bracket of each stamp."""
    known = buffer.arrays()
    return bracket_stamps(np.asarray(wanted), known.stamps, known.intervals)


def make_walk(num_poses, seed=0):
    rng = np.random.default_rng(seed)
    stamps = EPOCH + np.cumsum(rng.integers(5 * MS, 15 * MS, num_poses))
    positions = np.cumsum(rng.normal(0, 0.04, (num_poses, 3)), axis=0)
    positions += np.array([5e5, 6e6, 100.0])
    rotations = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.02, (num_poses, 3)), axis=0))
    return stamps, positions, rotations


def test_nothing_is_extrapolated():
    buffer = make_buffer([100 * MS, 200 * MS])
    wanted = np.array([100 * MS - 1, 100 * MS, 150 * MS, 200 * MS, 200 * MS + 1])
    upper, found = bracket(buffer, wanted)
    assert found.tolist() == [
        Bracket.BEFORE, Bracket.OK, Bracket.OK, Bracket.OK, Bracket.AFTER,
    ]
    assert upper[1:4].tolist() == [1, 1, 1]


@pytest.mark.parametrize('stamps', [[], [100 * MS]])
def test_fewer_than_two_poses_bracket_nothing(stamps):
    _, found = bracket(make_buffer(stamps), [100 * MS])
    assert found.tolist() == [Bracket.AFTER]


def test_no_stamps():
    upper, found = bracket(make_buffer([0, MS]), np.empty(0, np.int64))
    assert (len(upper), len(found)) == (0, 0)


def test_gap_is_not_bridged_and_its_limit_is_inclusive():
    buffer = make_buffer([0, 250 * MS, 501 * MS, 600 * MS])
    _, found = bracket(buffer, np.array([100, 300, 550, 250, 501]) * MS)
    assert found.tolist() == [0, Bracket.GAP, 0, 0, 0]
    assert buffer.num_gaps == 1


def test_jump_is_not_bridged():
    positions = [(0, 0, 0), (0, 0, 0), (7, 0, 0), (7, 0, 0)]
    buffer = make_buffer(np.arange(4) * 100 * MS, positions)
    _, found = bracket(buffer, np.array([50, 150, 250]) * MS)
    assert found.tolist() == [0, Bracket.JUMP, 0]
    assert buffer.num_jumps == 1
    assert make_buffer([0, 100 * MS], [(0, 0, 0), (5.9, 0, 0)]).num_jumps == 0


@pytest.mark.parametrize('gap_ns', [1, 5_000, MS])
def test_noise_between_close_stamps_is_no_jump(gap_ns):
    turned = Rotation.from_rotvec([0.0, 0.0, 0.005]).as_quat()
    positions = [(0, 0, 0), (0, 0.05, 0), (5, 0, 0)]
    buffer = make_buffer([0, gap_ns, 2 * gap_ns], positions, [UPRIGHT, turned, turned])
    assert buffer.arrays().intervals.tolist() == [0, 0, Bracket.JUMP]


def test_flipped_orientation_is_a_jump():
    buffer = make_buffer([0, 10 * MS], quaternions=[UPRIGHT, (1.0, 0.0, 0.0, 0.0)])
    assert bracket(buffer, [5 * MS])[1].tolist() == [Bracket.JUMP]


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
    assert (buffer.arrays().stamps[0], len(buffer)) == (30 + RESTART_AFTER - 1, 4)


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
    assert len(small) == 10
    kept, known = small.arrays(), large.arrays()
    for name in ('stamps', 'positions', 'quaternions', 'intervals'):
        np.testing.assert_array_equal(getattr(kept, name), getattr(known, name)[-10:])
    assert bracket(small, stamps[-11:-10])[1].tolist() == [Bracket.BEFORE]


def test_order_of_stamps_does_not_matter():
    stamps, positions, rotations = make_walk(50, seed=4)
    buffer = make_buffer(stamps, positions, rotations.as_quat())
    rng = np.random.default_rng(5)
    wanted = np.sort(rng.integers(stamps[0] - 20 * MS, stamps[-1] + 20 * MS, 1000))
    order = rng.permutation(1000)
    for whole, shuffled in zip(
        bracket(buffer, wanted), bracket(buffer, wanted[order]), strict=True
    ):
        np.testing.assert_array_equal(whole[order], shuffled)


def test_input_is_unchanged_and_capacity_checked():
    quaternion = np.array([0.0, 0.0, 0.0, 1.005])
    make_buffer([0], [np.zeros(3)], [quaternion])
    assert quaternion[3] == 1.005
    with pytest.raises(DataError, match='capacity 1'):
        PoseBuffer(InputSettings(), capacity=1)
