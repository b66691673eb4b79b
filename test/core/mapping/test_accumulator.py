# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import re

import numpy as np
import pytest

from plc_inspect.config import InputSettings, MapSettings, Settings
from plc_inspect.core.mapping.accumulator import Accumulator, DropReason, QUEUE_SIZE
from plc_inspect.core.setup.transforms import StampedTransform
from plc_inspect.errors import DataError

MS = 1_000_000
START = 1_700_000_000_000_000_000
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
SPEED = 20.0


def make_accumulator(max_voxels=100_000, voxel_size=0.1, **settings):
    return Accumulator(
        Settings(
            input=InputSettings(**settings),
            map=MapSettings(max_voxels=max_voxels, voxel_size=voxel_size),
        )
    )


def add_poses(accumulator, start_ms, stop_ms, step_ms=10, now=None, **frames):
    """Fly along x at SPEED."""
    for ms in range(start_ms, stop_ms + 1, step_ms):
        position = (SPEED * ms * 1e-3, 0, 0)
        accumulator.add_pose(START + ms * MS, position, UPRIGHT, now=now, **frames)


def look_at(targets, seconds):
    """Return what a lidar moving along x at SPEED sees of targets at given times."""
    seen = np.array(targets, dtype=np.float64)
    seen[:, 0] -= SPEED * np.asarray(seconds)
    return seen.astype(np.float32)


def add_plain_scan(accumulator, ms, num_points=3, **options):
    xyz = np.tile(np.array([[10, 0, 0]], np.float32), (num_points, 1))
    accumulator.add_scan(START + ms * MS, xyz, np.zeros(num_points), **options)


@pytest.mark.parametrize('stamp_ms', [100, 200])
def test_stamps_of_first_and_of_last_packet(stamp_ms):
    # Measured from 100 to 200 ms, whatever the header says: a wall across stays one wall.
    accumulator = make_accumulator()
    seconds = np.linspace(0.1, 0.2, 50)
    targets = np.column_stack((np.full(50, 30.05), np.linspace(0, 20, 50), np.full(50, 5.05)))
    add_poses(accumulator, 0, 300)
    accumulator.add_scan(
        START + stamp_ms * MS, look_at(targets, seconds), seconds - stamp_ms * 1e-3
    )
    assert accumulator.counters().num_scans_inserted == 1
    centroids = accumulator.map.centroids()
    assert accumulator.map.counts().sum() == 50
    np.testing.assert_allclose(centroids[:, 0], 30.05, atol=1e-5)


@pytest.mark.parametrize(('frame', 'doubt'), [
    ('odom', ''), ('velodyne', ''), ('camera', 'no way leads from base to camera'),
])
def test_mount_of_scans_that_are_placed_is_not_in_doubt(frame, doubt):
    accumulator = make_accumulator(min_range=0.0)
    accumulator.placer.add_frame(StampedTransform(
        0, 'base', 'velodyne', np.array([0.0, 0.0, 1.0]), np.array(UPRIGHT)
    ))
    add_poses(accumulator, 0, 100, frame_id='odom', child_frame_id='base')
    add_plain_scan(accumulator, 50, frame_id=frame)
    assert accumulator.counters().num_scans_inserted == 1
    assert accumulator.placer.mount.doubt.startswith(doubt)
    assert bool(accumulator.placer.mount.doubt) == bool(doubt)
    assert accumulator.placer.mount.transform[2, 3] == (frame == 'velodyne')


def test_without_times_the_stamp_serves_and_is_counted():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 300)
    accumulator.add_scan(START + 100 * MS, np.array([[10, 0, 0]], np.float32))
    np.testing.assert_allclose(accumulator.map.centroids(), [[12, 0, 0]], atol=1e-6)
    assert accumulator.counters().num_scans_without_time == 1


@pytest.mark.parametrize(('times', 'without'), [
    ([0.0, 0.0], True), ([2.4e-7, 2.4e-7], True), ([0.0, -0.05], False), ([0.0, 5e-5], False),
    ([np.nan, 0.0], True), ([], False),
])
def test_times_that_are_all_the_stamp_are_counted_as_none(times, without):
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 300)
    points = np.full((len(times), 3), 5, np.float32)
    accumulator.add_scan(START + 100 * MS, points, np.array(times))
    assert accumulator.counters().num_scans_without_time == without


def test_a_driver_that_loses_the_times_in_flight_is_refused():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 3000)
    points = np.full((2, 3), 5, np.float32)
    for number in range(12):
        accumulator.add_scan(START + (100 + 100 * number) * MS, points, np.array([-0.05, 0.0]))
    inserted = accumulator.counters().num_scans_inserted
    for number in range(12, 20):
        accumulator.add_scan(START + (100 + 100 * number) * MS, points)
        accumulator.add_scan(START + (150 + 100 * number) * MS, points[:0])
    counters = accumulator.counters()
    assert counters.scans_dropped == {DropReason.NO_TIMES.value: 8}
    assert counters.num_scans_without_time == 0
    assert counters.num_scans_inserted >= inserted


def test_scans_that_are_placed_need_no_times():
    accumulator = make_accumulator(min_range=0.0)
    add_poses(accumulator, 0, 100, frame_id='odom', child_frame_id='base')
    points = np.full((2, 3), 5, np.float32)
    accumulator.add_scan(START + 50 * MS, points, frame_id='odom')
    counters = accumulator.counters()
    assert (counters.num_scans_inserted, counters.num_scans_without_time) == (1, 0)


def test_scan_waits_until_the_odometry_brackets_its_last_point():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 140)
    times = np.array([0.0, 0.05])
    accumulator.add_scan(START + 100 * MS, np.full((2, 3), 5, np.float32), times)
    add_poses(accumulator, 145, 149, 4)
    assert (accumulator.counters().num_scans_waiting, len(accumulator.map)) == (1, 0)
    add_poses(accumulator, 150, 150)
    counters = accumulator.counters()
    assert (counters.num_scans_waiting, counters.num_scans_inserted) == (0, 1)


def test_a_scan_from_the_future_does_not_hold_up_the_others():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100)
    add_plain_scan(accumulator, 10_000)
    add_plain_scan(accumulator, 50)
    counters = accumulator.counters()
    assert (counters.num_scans_inserted, counters.num_scans_waiting) == (1, 1)


@pytest.mark.parametrize(
    ('ms', 'reason'),
    [(-1, DropReason.NO_POSE_BEFORE), (400, DropReason.POSE_GAP), (1005, DropReason.POSE_JUMP)],
)
def test_scan_without_a_good_pose_is_dropped_with_the_reason(ms, reason):
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 300)
    add_poses(accumulator, 600, 1000)
    accumulator.add_pose(START + 1010 * MS, (500, 0, 0), UPRIGHT)
    add_plain_scan(accumulator, ms)
    counters = accumulator.counters()
    assert counters.scans_dropped == {reason.value: 1}
    assert (counters.num_scans_inserted, len(accumulator.map)) == (0, 0)
    assert (counters.num_pose_gaps, counters.num_pose_jumps) == (1, 1)


def test_end_of_recording_drops_what_waits():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100)
    add_plain_scan(accumulator, 150)
    accumulator.finish()
    counters = accumulator.counters()
    assert counters.scans_dropped == {DropReason.NO_POSE_AFTER.value: 1}
    assert counters.num_scans_waiting == 0


def test_waiting_is_bounded_in_time_by_the_clock_that_is_given():
    accumulator = make_accumulator(max_wait=0.5)
    add_plain_scan(accumulator, 50, now=100.0)
    add_plain_scan(accumulator, 60, now=100.3)
    accumulator.expire(100.5)
    assert accumulator.counters().num_scans_waiting == 2
    accumulator.expire(100.6)
    assert accumulator.counters().num_scans_waiting == 1
    add_poses(accumulator, 0, 100, now=100.7)
    counters = accumulator.counters()
    assert counters.scans_dropped == {DropReason.WAITED_TOO_LONG.value: 1}
    assert counters.num_scans_inserted == 1


def test_time_in_which_nobody_listened_is_not_waited():
    accumulator = make_accumulator(max_wait=0.5)
    add_plain_scan(accumulator, 50, now=100.0)
    accumulator.expire(130.0)
    add_poses(accumulator, 0, 100, now=130.1)
    assert accumulator.counters().num_scans_inserted == 1
    add_plain_scan(accumulator, 150, now=131.0)
    accumulator.expire(161.0)
    accumulator.expire(161.2)
    assert accumulator.counters().num_scans_waiting == 1
    accumulator.expire(161.4)
    assert accumulator.counters().scans_dropped == {DropReason.WAITED_TOO_LONG.value: 1}


def test_waiting_is_bounded_in_number_and_the_newest_stay():
    accumulator = make_accumulator()
    for i in range(QUEUE_SIZE + 5):
        add_plain_scan(accumulator, 10 * i)
    assert accumulator.counters().num_scans_waiting == QUEUE_SIZE
    add_poses(accumulator, 0, 1000)
    counters = accumulator.counters()
    assert counters.scans_dropped == {DropReason.QUEUE_FULL.value: 5}
    assert counters.num_scans_inserted == QUEUE_SIZE


def test_points_are_judged_by_range_and_finiteness():
    accumulator = make_accumulator(min_range=2.0, max_range=50.0)
    add_poses(accumulator, 0, 100)
    nan, inf = np.nan, np.inf
    xyz = np.array(
        [[2, 0, 0], [1.99, 0, 0], [0, 50, 0], [0, 0, 50.1], [nan, 0, 9], [9, inf, 0], [9, 0, 0]],
        np.float32,
    )
    times = np.zeros(7)
    times[6] = nan
    accumulator.add_scan(START + 50 * MS, xyz, times, num_not_finite=4)
    counters = accumulator.counters()
    assert counters.points_dropped == {'not finite': 7, 'too near': 1, 'too far': 1}
    assert (counters.num_points, counters.num_points_inserted) == (11, 2)


def test_scan_without_a_believable_point_is_no_error():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100)
    accumulator.add_scan(START + 50 * MS, np.empty((0, 3), np.float32), np.empty(0))
    accumulator.add_scan(START + 60 * MS, np.zeros((5, 3), np.float32), np.zeros(5))
    assert accumulator.counters().num_scans_inserted == 2
    assert len(accumulator.map) == 0


@pytest.mark.parametrize('time', [1.5, -1.5, 1e9])
def test_impossible_times_are_an_error_with_the_number(time):
    accumulator = make_accumulator()
    with pytest.raises(DataError, match=re.escape(f'{abs(time):g} s away')):
        accumulator.add_scan(START, np.full((2, 3), 9, np.float32), np.array([0.0, time]))
    assert accumulator.counters().num_scans == 0


def test_arrays_that_do_not_belong_together():
    accumulator = make_accumulator()
    with pytest.raises(DataError, match='3 points'):
        accumulator.add_scan(START, np.zeros((3, 3), np.float32), np.zeros(2))
    with pytest.raises(DataError, match=r'\(3, 2\)'):
        accumulator.add_scan(START, np.zeros((3, 2), np.float32))


def test_other_frames_are_rejected():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100, frame_id='odom', child_frame_id='base')
    add_poses(accumulator, 110, 110, frame_id='map', child_frame_id='base')
    add_plain_scan(accumulator, 50, frame_id='velodyne')
    add_plain_scan(accumulator, 60, frame_id='camera')
    counters = accumulator.counters()
    assert accumulator.frame_id == 'odom'
    assert counters.poses_rejected == {'another frame': 1}
    assert counters.scans_dropped == {DropReason.WRONG_FRAME.value: 1}


def test_a_bad_pose_does_not_choose_the_frame():
    accumulator = make_accumulator()
    accumulator.add_pose(START, (np.nan, 0, 0), UPRIGHT, frame_id='wrong')
    add_poses(accumulator, 0, 10, frame_id='odom')
    assert accumulator.frame_id == 'odom'
    assert accumulator.counters().poses_rejected == {'not finite': 1}


def test_extrinsic_is_applied():
    accumulator = make_accumulator(lidar_xyz=(0.0, 0.0, -0.5), lidar_rpy_deg=(180.0, 0.0, 0.0))
    for ms in (0, 10):
        accumulator.add_pose(START + ms * MS, (0, 0, 100), UPRIGHT)
    accumulator.add_scan(START + 5 * MS, np.array([[10, 2, 3]], np.float32), np.zeros(1))
    np.testing.assert_allclose(accumulator.map.centroids(), [[10, -2, 96.5]], atol=1e-6)


def test_full_map_refuses_points_and_says_so():
    accumulator = make_accumulator(max_voxels=1000)
    add_poses(accumulator, 0, 100)
    xyz = np.column_stack((np.full(1200, 10.0), np.arange(1200) * 0.05, np.zeros(1200)))
    xyz[:, 1] -= 30
    xyz[:, 2] = np.arange(1200) % 7
    accumulator.add_scan(START + 50 * MS, xyz.astype(np.float32), np.zeros(1200))
    counters = accumulator.counters()
    assert len(accumulator.map) == 1000
    assert counters.points_dropped['map full'] == 1200 - counters.num_points_inserted > 0


def test_nothing_is_placed_by_the_first_poses_that_stand_still():
    accumulator = make_accumulator()
    place = 0.0
    for ms in range(0, 3000, 10):
        place = place if ms > 2000 else 0.006 * ms
        accumulator.add_pose(START + ms * MS, (place, 0.0, 0.0), UPRIGHT)
        if ms % 50 == 25 or ms % 50 == 20:
            add_plain_scan(accumulator, ms)
    counters = accumulator.counters()
    # the last that went in is of before 2 s: those after it were placed nowhere
    assert accumulator.last_inserted <= START + 2000 * MS
    assert counters.num_scans_inserted >= 39
    assert counters.scans_dropped['odometry stands still while the vehicle moves'] >= 15


def test_scans_go_in_where_each_pose_is_told_twice():
    accumulator = make_accumulator()
    for ms in range(0, 2000, 10):
        accumulator.add_pose(START + ms * MS, (0.006 * (ms // 20 * 20), 0.0, 0.0), UPRIGHT)
        if ms % 100 == 50:
            add_plain_scan(accumulator, ms)
    assert accumulator.counters().num_scans_inserted == 20


def test_odometry_that_steps_out_of_the_map_begins_another():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100)
    add_plain_scan(accumulator, 50)
    for ms in range(200, 1300, 10):
        place = 9e5 + SPEED * (ms - 205) * 1e-3
        accumulator.add_pose(START + ms * MS, (place, 0, 0), UPRIGHT)
    add_plain_scan(accumulator, 205)
    counters = accumulator.counters()
    assert counters.num_map_restarts == 1
    assert (counters.num_scans_inserted, counters.num_scans_waiting) == (2, 0)
    np.testing.assert_allclose(accumulator.map.centroids(), [[900_010.0, 0, 0]], atol=1e-3)


def test_frames_are_followed_once_all_poses_are_in_others():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 1000, frame_id='odom', child_frame_id='base')
    add_poses(accumulator, 1010, 1490, frame_id='map', child_frame_id='base')
    assert accumulator.frame_id == 'odom'
    add_poses(accumulator, 1500, 1600, frame_id='map', child_frame_id='base')
    assert accumulator.frame_id == 'map'
    assert accumulator.counters().poses_rejected['another frame'] < 60


def test_lost_scans_are_seen_in_the_stamps():
    accumulator = make_accumulator()
    for ms in [*range(0, 1000, 100), 1300]:
        add_plain_scan(accumulator, ms)
    counters = accumulator.counters()
    assert counters.num_scans_lost == 3
    assert counters.scan_period == pytest.approx(0.1)


@pytest.mark.parametrize('keep_map', [True, False])
def test_reset_after_a_jump_back_in_time(keep_map):
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 1000, frame_id='odom')
    add_plain_scan(accumulator, 500)
    add_plain_scan(accumulator, 1500)
    accumulator.reset(keep_map=keep_map)
    assert len(accumulator.map) == keep_map
    assert accumulator.frame_id == ('odom' if keep_map else '')
    add_poses(accumulator, 0, 100, frame_id='odom')
    add_plain_scan(accumulator, 50)
    counters = accumulator.counters()
    assert counters.scans_dropped == {DropReason.RESET.value: 1}
    assert counters.num_scans_inserted == 2


@pytest.mark.parametrize('back_ms', [40, 60, 90, 300, 700, 3000])
@pytest.mark.parametrize('waiting', [False, True])
@pytest.mark.parametrize('times', [1, 2])
def test_no_scan_is_placed_by_poses_from_before_clocks_were_set_back(back_ms, waiting, times):
    """Nor are many dropped, also where each pose is told twice."""
    accumulator = make_accumulator()
    for ms in range(0, 8001, 10):
        back = back_ms if ms >= 5000 else 0
        x, stamp = SPEED * ms * 1e-3, START + (ms - back) * MS
        for _ in range(times):
            accumulator.add_pose(stamp, (x, 0, 0), UPRIGHT, now=ms * 1e-3)
        if ms % 100 == 90 * waiting:  # seen just after this pose, at a y that tells when
            target = look_at([[x, ms * 1e-2, 0.0]], [ms * 1e-3])
            accumulator.add_scan(stamp + 5 * MS, target, np.array([-0.004]), now=ms * 1e-3)
    seen = accumulator.map.centroids()
    assert len(seen) > 70
    np.testing.assert_allclose(seen[:, 0], SPEED * seen[:, 1] * 0.1, atol=0.03)


def test_a_scan_stamped_too_late_is_refused_and_no_other():
    accumulator = make_accumulator()
    for ms in range(0, 5001, 10):
        x = SPEED * ms * 1e-3
        accumulator.add_pose(START + ms * MS, (x, 0, 0), UPRIGHT, now=ms * 1e-3)
        if ms % 100 == 90:
            target = look_at([[x, ms * 1e-2, 0.0]], [ms * 1e-3])
            late = 530 if ms == 2090 else 0
            accumulator.add_scan(
                START + (ms + 5 + late) * MS, target, np.array([-0.004]), now=ms * 1e-3
            )
    seen = accumulator.map.centroids()
    np.testing.assert_allclose(seen[:, 0], SPEED * seen[:, 1] * 0.1, atol=0.03)
    assert len(seen) == 48  # the last one waits
    assert accumulator.counters().scans_dropped == {DropReason.DISPROVED.value: 1}


def test_every_scan_is_accounted_for():
    rng = np.random.default_rng(0)
    accumulator = make_accumulator()
    events = [(ms, 'scan') for ms in range(0, 20_000, 100)]
    events += [(ms + rng.integers(0, 60), ms) for ms in range(1000, 18_000, 20) if ms % 3000 > 500]
    for arrival, kind in sorted(events, key=lambda event: event[0]):
        if kind == 'scan':
            add_plain_scan(accumulator, arrival, now=arrival * 1e-3)
        else:
            add_poses(accumulator, kind, kind, now=arrival * 1e-3)
    accumulator.finish()
    counters = accumulator.counters()
    assert counters.num_scans == 200
    assert counters.num_scans_inserted + sum(counters.scans_dropped.values()) == 200
    assert set(counters.scans_dropped) == {
        DropReason.NO_POSE_BEFORE.value, DropReason.POSE_GAP.value,
        DropReason.WAITED_TOO_LONG.value, DropReason.NO_POSE_AFTER.value,
    }
    assert counters.num_scans_inserted > 100


def test_input_is_unchanged():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100)
    xyz = np.random.default_rng(1).uniform(-9, 9, (100, 3)).astype(np.float32)
    times = np.linspace(0, 0.04, 100)
    copies = xyz.copy(), times.copy()
    accumulator.add_scan(START, xyz, times)
    np.testing.assert_array_equal(xyz, copies[0])
    np.testing.assert_array_equal(times, copies[1])


def test_cloud_in_the_frame_of_the_odometry_is_taken_as_it_is():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 4000, frame_id='odom')
    # At 3 s the vehicle is at x = 60: 130 is within 100 m of it, 161 and 61 are not in range.
    xyz = np.array([[130.02, 0, 0], [161, 0, 0], [61, 0, 0]], np.float32)
    accumulator.add_scan(START + 3000 * MS, xyz, np.zeros(3), frame_id='odom')
    np.testing.assert_allclose(accumulator.map.centroids(), [[130.02, 0, 0]], atol=1e-4)
    assert accumulator.counters().points_dropped == {'too near': 1, 'too far': 1}


def test_cloud_in_the_frame_of_the_odometry_needs_a_pose_too():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 100, frame_id='odom')
    add_poses(accumulator, 600, 700, frame_id='odom')
    add_plain_scan(accumulator, 400, frame_id='odom')
    assert accumulator.counters().scans_dropped == {DropReason.POSE_GAP.value: 1}


def fly_away(accumulator, offset, seconds):
    """Fly from the origin, then at an offset, with a scan every 0.1 s."""
    for ms in range(0, seconds * 1000, 20):
        place = np.zeros(3) if ms < 1000 else np.asarray(offset)
        accumulator.add_pose(START + ms * MS, place, UPRIGHT)
        if ms % 100 == 40:
            add_plain_scan(accumulator, ms)


def test_map_follows_from_the_origin_to_utm():
    accumulator = make_accumulator()
    fly_away(accumulator, (500_000.0, 5_800_000.0, 40.0), 10)
    counters = accumulator.counters()
    assert counters.num_map_restarts == 1
    np.testing.assert_allclose(
        accumulator.map.centroids(), [[500_010.0, 5_800_000.0, 40.0]], atol=1e-3
    )
    assert counters.num_scans_inserted >= 65


@pytest.mark.parametrize('offset', [(1e300, 0, 0), (0, 1e12, 0)])
def test_map_does_not_follow_to_no_place(offset):
    accumulator = make_accumulator()
    fly_away(accumulator, offset, 10)
    assert accumulator.counters().num_map_restarts == 0
    np.testing.assert_allclose(accumulator.map.centroids(), [[10, 0, 0]], atol=1e-6)


@pytest.mark.parametrize('gap', [0, 1, 6])
def test_a_map_is_left_with_the_scan_in_hand(gap):
    """The vehicle is far away before its new place can be compared with the map."""
    accumulator = make_accumulator()
    fly_away(accumulator, (0.0, 0.0, 0.0), 3)
    for ms in range(3000 + 1000 * gap, 9000 + 1000 * gap, 20):
        accumulator.add_pose(START + ms * MS, (150_000.0, 0.0, 20.0), UPRIGHT)
        if ms % 100 == 40:
            add_plain_scan(accumulator, ms)
    counters = accumulator.counters()
    assert counters.num_map_restarts == 1
    assert np.abs(accumulator.map.centroids() - (150_010.0, 0.0, 20.0)).max() < 1e-3
    assert counters.num_scans_inserted + sum(counters.scans_dropped.values()) == 90


@pytest.mark.parametrize('seed', range(8))
def test_every_scan_is_accounted_for_whatever_the_odometry_does(seed):
    rng = np.random.default_rng(seed)
    accumulator = make_accumulator()
    cloud = rng.uniform(-15, 15, (400, 3)).astype(np.float32)
    start, place, offset = START, np.array([0.0, 0.0, 20.0]), np.zeros(3)
    for _ in range(100):
        fault = rng.random()
        if fault < 0.06:
            offset = offset + rng.normal(0.0, 1.0, 3) * rng.choice([0.3, 1.0, 5.0, 3e5])
        elif fault < 0.08:
            start -= int(rng.uniform(0.1, 30.0) * 1e9)
        elif fault < 0.10:
            start += int(rng.uniform(0.1, 12.0) * 1e9)
        elif fault < 0.12:
            accumulator.reset(keep_map=fault < 0.11)
        speed = 0.05 * (rng.random() > 0.05)
        for number in range(10):
            place[0] += speed
            accumulator.add_pose(start + 10 * number * MS, place + offset, UPRIGHT)
        stamp = start + int(rng.uniform(60, 100)) * MS
        accumulator.add_scan(stamp, cloud, np.linspace(-0.09, 0.0, 400))
        start += 100 * MS
        counters = accumulator.counters()
        assert counters.num_scans == (
            counters.num_scans_inserted + counters.num_scans_waiting
            + sum(counters.scans_dropped.values())
        )


def test_a_placed_cloud_that_comes_before_the_first_pose_is_not_moved():
    """Nobody knows then that it is in the map frame."""
    accumulator = make_accumulator()
    xyz = np.array([[130.02, 0, 0]], np.float32)
    for ms in (3000, 3100):
        accumulator.add_scan(START + ms * MS, xyz, np.zeros(1), frame_id='odom')
        if ms == 3000:
            add_poses(accumulator, 2900, 4000, frame_id='odom')
    np.testing.assert_allclose(accumulator.map.centroids(), [[130.02, 0, 0]], atol=1e-4)
    assert accumulator.counters().scans_dropped == {DropReason.NO_POSE_BEFORE.value: 1}


def test_a_leading_slash_makes_no_other_frame():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 4000, frame_id='odom', child_frame_id='base')
    xyz = np.array([[130.02, 0, 0]], np.float32)
    accumulator.add_scan(START + 3000 * MS, xyz, np.zeros(1), frame_id='/odom')
    np.testing.assert_allclose(accumulator.map.centroids(), [[130.02, 0, 0]], atol=1e-4)


def test_a_correction_of_the_clock_makes_no_second_driver():
    accumulator = make_accumulator()
    add_poses(accumulator, 0, 4000)
    for number in range(30):
        if number == 10:
            accumulator.timing.resume(-0.17, 0.0, None)
        xyz = np.tile(np.array([[10, 0, 0]], np.float32), (3, 1))
        stamp = START + 500 * MS + number * 100 * MS + (number % 3) * 4 * MS
        accumulator.add_scan(stamp, xyz, np.array([-0.09, -0.04, 0.0]))
    assert accumulator.counters().scans_dropped == {}


def test_a_pose_is_told_of_before_the_scans_that_it_brackets_are_inserted():
    """Inserting them takes tens of milliseconds, in which nobody knows how near things are."""
    accumulator = make_accumulator()
    inserted = []

    def tell():
        inserted.append(accumulator.counters().num_scans_inserted)

    add_poses(accumulator, 0, 100)
    add_plain_scan(accumulator, 105)
    for ms in (110, 120):
        accumulator.add_pose(START + ms * MS, (SPEED * ms * 1e-3, 0, 0), UPRIGHT, tell=tell)
    assert inserted == [0, 1]
    # one that is not accepted is not told of
    assert not accumulator.add_pose(START + 120 * MS, (np.nan, 0, 0), UPRIGHT, tell=tell)
    assert len(inserted) == 2


def test_what_cannot_be_told_keeps_no_scan_from_the_map():
    accumulator = make_accumulator()

    def fail():
        raise OSError('no room')

    add_poses(accumulator, 0, 100)
    add_plain_scan(accumulator, 105)
    with pytest.raises(OSError, match='no room'):
        accumulator.add_pose(START + 110 * MS, (SPEED * 0.11, 0, 0), UPRIGHT, tell=fail)
    assert accumulator.counters().num_scans_inserted == 1


def test_what_a_scan_leaves_to_compare_is_done_in_pieces_before_the_next_one():
    accumulator, done = make_accumulator(), []

    def look(scan, placer, poses):
        for number in range(6):
            done.append((scan.stamp_ns, number, accumulator.last_inserted))
            yield ''

    accumulator.timing.look = look
    add_poses(accumulator, 0, 100)
    add_plain_scan(accumulator, 95)
    add_plain_scan(accumulator, 125)
    assert [number for _, number, _ in done] == []
    for count, ms in enumerate((110, 120), start=1):
        add_poses(accumulator, ms, ms)
        assert len(done) == count  # one piece, with each pose
    add_poses(accumulator, 130, 130)
    first = [number for stamp, number, _ in done if stamp == START + 95 * MS]
    assert first == list(range(6))
    assert {last for _, number, last in done if number < 6} == {START + 95 * MS}
    accumulator.finish()
    assert len(done) == 12
