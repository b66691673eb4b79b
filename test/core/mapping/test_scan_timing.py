# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plc_inspect.config import Settings
from plc_inspect.core.mapping.accumulator import Accumulator
from plc_inspect.core.mapping.scan_timing import MOST_OFFSET, ScanTiming
from plc_inspect.setting_names import update

START = 1_700_000_000_000_000_000
SPEED = 5.0


def find_pose(when):
    """Return place and orientation of a vehicle that flies along x and sways."""
    turn = Rotation.from_euler('ZYX', [
        0.1 * np.sin(0.9 * when), 0.04 * np.sin(2.1 * when), 0.05 * np.cos(1.7 * when),
    ])
    return np.array([SPEED * when, 0.0, 15.0]), turn


def look(when, rng, num=1500):
    """Return points of ground and two walls as a lidar sees them at a moment."""
    place, turn = find_pose(when)
    x, y = place[0] + rng.uniform(-25.0, 25.0, num), rng.uniform(-20.0, 20.0, num)
    ground = np.column_stack((x, y, 0.1 * y))
    walls = np.column_stack((
        x[:600], np.where(np.arange(600) < 300, -18.0, 18.0), rng.uniform(0.0, 12.0, 600),
    ))
    world = np.concatenate((ground, walls)) + rng.normal(0.0, 0.02, (num + 600, 3))
    return turn.inv().apply(world - place)


def fly(late, seconds=12.0, rate=0.0, placed=False, mount=(0.0, 0.0, 0.0), told=None):
    """
    Fly with the lidar's clock ahead by some seconds, and more each second.

    Its mount is some roll, pitch and yaw [degrees], and may be told otherwise.
    """
    settings = update(Settings(), {'input.lidar_rpy_deg': list(told or mount)})
    accumulator = Accumulator(settings, recorded=True)
    mounted = Rotation.from_euler('xyz', mount, degrees=True)
    rng = np.random.default_rng(3)
    for tick in range(int(seconds * 50)):
        when = tick * 0.02
        place, turn = find_pose(when)
        accumulator.add_pose(
            START + round(when * 1e9), place, turn.as_quat(), frame_id='odom', now=when
        )
        if tick % 5 == 0:
            points = look(when, rng)
            points = turn.apply(points) + place if placed else mounted.inv().apply(points)
            ahead = late + rate * when
            accumulator.add_scan(
                START + round((when + ahead) * 1e9), points.astype(np.float32),
                np.zeros(len(points)), frame_id='odom' if placed else 'lidar', now=when,
            )
    accumulator.finish()
    return accumulator


@pytest.mark.parametrize('late', [0.2, 0.05, -0.1])
def test_scans_of_another_clock_are_taken_when_they_fit_best(late):
    accumulator = fly(late)
    timing = accumulator.timing
    assert timing.shift(START, np.zeros(1, dtype=np.int64))[0] * 1e-9 == pytest.approx(
        -late, abs=0.01
    )
    told = timing.describe().split()
    assert float(told[3]) == pytest.approx(abs(late), abs=0.011)
    assert told[5].startswith('earlier' if late > 0 else 'later')
    assert 1 <= accumulator.entry.num_restarts <= 2
    assert 'scans fit best' in accumulator.entry.cause
    assert not accumulator.doubt
    # the walls are thin again
    points = accumulator.map.centroids()
    wall = points[(points[:, 2] > 5.0) & (np.abs(points[:, 1] - 18.0) < 1.5)]
    assert len(wall) > 300
    assert np.abs(wall[:, 1] - 18.0).mean() < 0.06


def test_a_clock_that_runs_fast_is_followed():
    accumulator = fly(0.0, seconds=20.0, rate=0.01)
    shifted = accumulator.timing.shift(START + 20_000_000_000, np.zeros(1, dtype=np.int64))
    assert shifted[0] * 1e-9 == pytest.approx(-0.2, abs=0.05)


@pytest.mark.parametrize('options', [{'late': 0.0}, {'late': 0.2, 'placed': True}])
def test_right_clocks_and_placed_scans_are_left_alone(options):
    accumulator = fly(**options)
    stamps = np.arange(3)
    assert accumulator.timing.shift(START, stamps) is stamps
    assert not accumulator.timing.describe()
    assert accumulator.entry.num_restarts == 0


def test_a_reset_forgets_the_offset():
    accumulator = fly(0.1, seconds=8.0)
    assert accumulator.timing.describe()
    accumulator.reset()
    assert not accumulator.timing.describe()


@pytest.mark.parametrize(('mount', 'told', 'which'), [
    ((0.0, 30.0, 0.0), (0.0, 30.0, 2.0), '-2.0 degrees of yaw'),
    ((0.0, 0.0, 90.0), (0.0, -3.0, 90.0), '-3.0 degrees of roll'),
])
def test_a_mount_that_is_told_wrongly_is_doubted(mount, told, which):
    accumulator = fly(0.0, mount=mount, told=told)
    assert f'with the lidar turned by {which}: results are held back' in accumulator.doubt
    assert not accumulator.timing.describe()
    assert not fly(0.0, mount=mount).doubt


def test_what_was_seen_by_another_mount_is_forgotten():
    accumulator = fly(0.0, told=(0.0, 0.0, 3.0))
    assert accumulator.doubt
    accumulator.configure(Settings())
    place, turn = find_pose(12.0)
    for number in range(2):
        accumulator.add_pose(
            START + 12 * 10**9 + number * 10**7, place, turn.as_quat(), frame_id='odom', now=12.0
        )
        accumulator.add_scan(
            START + 12 * 10**9, look(12.0, np.random.default_rng(4)).astype(np.float32),
            frame_id='lidar', now=12.0,
        )
    assert accumulator.timing.steady is None
    assert not accumulator.doubt


def test_where_time_goes_back_the_drift_of_the_clock_is_forgotten():
    timing = ScanTiming()
    timing.resume(0.05, 0.002, START)
    later, before = (START + seconds * 10**9 for seconds in (10, -600))
    assert timing.shift(later, np.zeros(1, dtype=np.int64))[0] == 70_000_000
    timing.forget_times()
    assert timing.shift(before, np.zeros(1, dtype=np.int64))[0] == 70_000_000


def test_a_drift_of_the_clock_is_followed_only_so_far():
    timing = ScanTiming()
    timing.resume(0.05, 0.002, START)
    far = START + 10_000 * 10**9
    assert timing.shift(far, np.zeros(1, dtype=np.int64))[0] == round(MOST_OFFSET * 1e9)


def test_an_offset_survives_its_record():
    timing, other = ScanTiming(), ScanTiming()
    timing.resume(-0.2, 0.001, START)
    other.resume(*timing.remember())
    assert other.describe() == timing.describe() != ''
