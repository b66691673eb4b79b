# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from plc_inspect.config import InputSettings
from plc_inspect.core.alignment.coarse_positions import CoarsePositions
from plc_inspect.core.alignment.frame_watch import FramedPose
from plc_inspect.core.mapping.pose_buffer import PoseBuffer, PoseStatus
from plc_inspect.core.mapping.pose_gate import PoseGate

START = 1_700_000_000_000_000_000
SPEED = 6.0
FRAMES = ('odom', 'base')


def make_pose(ms, x, y=0.0, turn=0.0, frames=FRAMES):
    return FramedPose(
        START + ms * 1_000_000, np.array([x, y, 10.0]),
        np.array([0.0, 0.0, np.sin(turn / 2.0), np.cos(turn / 2.0)]), frames,
    )


def fly(period, end=4000, step=20, lost=()):
    """Return poses 50 times a second along x, with positions new every ``period`` ms."""
    return [
        make_pose(ms, SPEED * 1e-3 * (ms - ms % period), turn=1e-4 * ms)
        for ms in range(0, end, step) if ms not in lost
    ]


def feed(poses, gate=None):
    gate = gate or PoseGate(InputSettings())
    taken = [item for pose in poses for item in gate.judge(pose)]
    return gate, [*taken, *gate.release()]


def find_errors(taken):
    """Return how far poses are from where the vehicle was [m]."""
    return np.array([
        item.position[0] - SPEED * (item.stamp_ns - START) * 1e-9 for item in taken
    ])


@pytest.mark.parametrize('period', [40, 100, 200])
def test_repeated_positions_are_interpolated(period):
    given = fly(period)
    gate, taken = feed(given)
    assert [item.stamp_ns for item in taken] == [item.stamp_ns for item in given]
    first = 2 * period // 20  # before the first change it may stand
    last = period // 20  # what waits for the next position at the end
    assert np.abs(find_errors(taken[first:-last])).max() < 1e-9
    turns = [item.quaternion[2] for item in taken]
    assert turns == [item.quaternion[2] for item in given]
    assert f'new {1000 / period:.0f} times a second, and told 50 times' in gate.describe()


@pytest.mark.parametrize('back', [20, 30])
def test_no_position_is_extrapolated_after_a_pose_out_of_order(back):
    given = fly(100)
    early = make_pose(1080 - back, SPEED * 1.1)  # the position that is new at 1,100 ms
    _, taken = feed([*given[:55], early, *given[55:]])
    kept = [pose for number, pose in enumerate(taken) if pose not in taken[:number]]
    assert len(kept) == len(given) == len(taken) - 1  # one that is refused
    assert np.abs(find_errors(kept[10:-5])).max() < 1e-9


def test_repeated_positions_are_interpolated_though_poses_come_twice_or_without_numbers():
    twice = [pose for pose in fly(100) for _ in range(2)]
    broken = [make_pose(ms + 5, np.nan) for ms in range(0, 4000, 220)]
    given = sorted([*twice, *broken], key=lambda pose: pose.stamp_ns)
    gate, buffer = PoseGate(InputSettings()), PoseBuffer(InputSettings())
    for pose in given:
        for item in gate.judge(pose):
            buffer.insert(item.stamp_ns, item.position, item.quaternion)
    known = buffer.arrays()
    assert len(known.stamps) == 196  # but those that wait at the end
    assert buffer.counts[PoseStatus.NOT_LATER] == 200
    assert buffer.counts[PoseStatus.NOT_FINITE] == len(broken)
    errors = known.positions[:, 0] - SPEED * (known.stamps - START) * 1e-9
    assert np.abs(errors[10:]).max() < 1e-9


def test_poses_that_are_new_each_time_pass_at_once():
    gate = PoseGate(InputSettings())
    for pose in fly(20):
        assert gate.judge(pose) == [pose]
    assert not gate.describe()


def test_a_driver_that_drops_out_now_and_then_is_interpolated_too():
    lost = {ms for ms in range(1000, 4000, 20) if ms % 340 in (0, 20, 40)}
    gate, taken = feed(fly(100, lost=lost))
    errors = np.abs(find_errors(taken[10:-5]))
    assert np.median(errors) < 1e-9
    # a position whose first pose was lost is told as late as it came
    assert errors.max() < SPEED * 0.065
    assert 'are interpolated' in gate.describe()


def test_a_position_that_stays_is_let_through_as_it_is():
    poses = fly(20, end=1000) + [make_pose(ms, 5.9) for ms in range(1000, 3000, 20)]
    gate, taken = feed(poses)
    assert [item.stamp_ns for item in taken] == [item.stamp_ns for item in poses]
    assert {item.position[0] for item in taken[51:]} == {5.9}
    # once it stands nothing waits
    standing = make_pose(3000, 5.9)
    assert gate.judge(standing) == [standing]


def test_a_vehicle_on_the_ground_is_let_through_at_once():
    gate = PoseGate(InputSettings())
    for ms in range(0, 1000, 20):
        pose = make_pose(ms, 0.0)
        assert gate.judge(pose) == [pose]


def test_what_no_vehicle_flies_is_not_smoothed():
    poses = [*fly(20, end=1000), make_pose(1000, 5.88), make_pose(1020, 500.0)]
    _, taken = feed(poses)
    assert taken[-2].position[0] == 5.88
    assert taken[-1].position[0] == 500.0


def test_poses_out_of_order_and_of_another_frame_keep_nothing_back():
    poses = fly(20, end=200)
    poses[4], poses[5] = poses[5], poses[4]
    _, taken = feed(poses)
    assert [item.stamp_ns for item in taken] == [item.stamp_ns for item in poses]
    gate, _ = feed(fly(100, end=1060))
    gate.frames = FRAMES
    other = [make_pose(ms, 1.0, frames=('map', 'base')) for ms in range(1060, 2000, 20)]
    assert gate.judge(other[0]) is None
    taken = [item for pose in other[1:] for item in gate.judge(pose) or []]
    assert [item.frames for item in taken][-1] == ('map', 'base')


def test_input_is_unchanged():
    given = fly(100, end=400)
    before = [item.position.copy() for item in given]
    feed(given)
    np.testing.assert_array_equal([item.position for item in given], before)


def see(positions):
    watch = CoarsePositions()
    for position in positions:
        watch.see(position)
    return watch.doubt


def make_utm(num=200):
    n = np.arange(num)
    return np.column_stack((5e5 + 0.1234567 * n, 5.8e6 + 0.0612345 * n, 40.0 + 1e-3 * n))


def test_utm_in_single_precision_is_doubted():
    rounded = make_utm().astype(np.float32).astype(np.float64)
    assert 'in steps of 0.5 m' in see(rounded)
    assert 'held back' in see(rounded)
    # within 2 s of flight
    assert see(rounded[:100])
    # whatever is refused between them
    assert see(np.insert(rounded, 200, np.nan, axis=0))
    assert see(np.insert(rounded, 200, np.inf, axis=0))


@pytest.mark.parametrize('positions', [
    make_utm(), (make_utm() - make_utm()[0]).astype(np.float32).astype(np.float64),
    np.tile([[5e5, 5.8e6, 40.0]], (200, 1)),
    np.column_stack((5e5 + 0.1 * np.arange(200), np.full(200, 5.8e6), np.full(200, 40.0))),
])
def test_positions_that_are_exact_enough_are_not(positions):
    assert not see(positions)


def test_a_doubt_goes_where_positions_are_right_again():
    rounded = make_utm().astype(np.float32).astype(np.float64)
    assert not see(np.concatenate((rounded, make_utm())))


def test_settings_of_the_gap_hold_at_once():
    gate = PoseGate(InputSettings())
    gate.configure(dataclasses.replace(InputSettings(), max_pose_gap=0.05))
    _, taken = feed(fly(100), gate)
    assert np.abs(find_errors(taken)).max() > 0.4  # 0.1 s is too long now


@pytest.mark.parametrize(('frame', 'doubted'), [
    ('odom', False), ('ned_odom', False), ('odom_ned', True), ('map/NED', True),
    ('local_frd', True), ('odom_combined', False), ('map_aligned', False), ('NED', True),
    ('', False),
])
def test_a_map_frame_that_points_down_by_its_name_is_doubted(frame, doubted):
    gate = PoseGate(InputSettings())
    assert not gate.doubt
    gate.frames = (frame, 'base_link_frd')
    assert ('z down' in gate.doubt) == doubted
