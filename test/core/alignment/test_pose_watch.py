# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import math

import numpy as np
import pytest

from plc_inspect.core.alignment.pose_watch import Oddity, PoseWatch

MS = 1_000_000


def turn(yaw):
    return np.array([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])


def feed(poses):
    """Return what a watch says of (ms, x, y, yaw in degrees)."""
    watch = PoseWatch()
    found = [
        watch.see(ms * MS, np.array([x, y, 20.0]), turn(math.radians(yaw)))
        for ms, x, y, yaw in poses
    ]
    return watch, [item for item in found if item is not None]


def fly(end=1000, step=20, speed=5.0):
    return [(ms, speed * ms * 1e-3, 0.0, 0.0) for ms in range(0, end, step)]


def test_flying_and_braking_are_nothing():
    times = np.arange(0, 4000, 20) * 1e-3
    braking = np.where(times < 2.0, 8.0 * times, 16.0 + 8.0 * (times - 2) - 3 * (times - 2) ** 2)
    _, found = feed([(round(1e3 * t), x, 0.0, 10.0 * t) for t, x in zip(times, braking,
                                                                          strict=True)])
    assert not found


def test_noise_of_the_odometry_is_nothing():
    rng = np.random.default_rng(3)
    poses = [(ms, x + rng.normal(0, 0.02), rng.normal(0, 0.02), 0.0)
             for ms, x, *_ in fly(8000)]
    assert len(feed(poses)[1]) <= 1


@pytest.mark.parametrize('number', [2, 4, 6])
def test_poses_stamped_in_bursts_are_no_steps(number):
    rng = np.random.default_rng(4)
    watch = PoseWatch()
    for count in range(2400):  # 400 Hz, stamped as a handful of them is read
        stamp = (count // number * number) * 2_500_000 + (count % number) * 5_000
        place = np.array([3.0 * count / 400, 0.0, 20.0]) + rng.normal(0, 0.002, 3)
        assert watch.see(stamp, place, turn(0.0)) is None


@pytest.mark.parametrize('size', [0.15, 2.0, 1e4])
def test_a_step_is_measured(size):
    poses = fly() + [(ms, x, size, 0.0) for ms, x, *_ in fly(2000)[50:]]
    _, (found,) = feed(poses)
    assert found.oddity is Oddity.STEP
    assert found.size == pytest.approx(size, abs=0.02)
    np.testing.assert_allclose(found.move.shift, [0.0, -size, 0.0], atol=0.02)
    assert (found.before_ns, found.after_ns) == (980 * MS, 1000 * MS)
    assert found.sigma < 0.05


@pytest.mark.parametrize(('step', 'speed', 'left'), [
    (0.0, -8.0, 0.0), (0.05, -8.0, 0.05), (0.5, -8.0, 0.5), (0.2, 8.0, 0.2), (0.2, 6.0, 0.2),
])
def test_a_turn_on_the_spot_explains_only_what_lies_between(step, speed, left):
    poses = fly(speed=8.0)[:50]
    middle = 7.92  # at 0.99 s
    poses += [(ms, middle + speed * (ms * 1e-3 - 0.99), step, 0.0) for ms in range(1005, 1300, 20)]
    watch, (found,) = feed(poses)
    np.testing.assert_allclose(found.velocity, [8.0, 0.0, 0.0], atol=1e-6)
    judged = found.judge(watch.velocity_since)
    assert judged.size == pytest.approx(left, abs=1e-3)
    np.testing.assert_allclose(judged.move.shift, [0.0, -step, 0.0], atol=1e-3)
    change = abs(speed - 8.0) * 0.025
    assert judged.sigma == pytest.approx(np.hypot(found.sigma, change / 12**0.5))


def test_the_velocity_since_a_break_is_known_after_a_while():
    poses = fly() + [(ms, x, 1.0, 0.0) for ms, x, *_ in fly(1140)[50:]]
    assert feed(poses)[0].velocity_since is None
    watch, _ = feed([*poses, (1160, 5.8, 1.0, 0.0)])
    np.testing.assert_allclose(watch.velocity_since, [5.0, 0.0, 0.0], atol=1e-6)


def test_a_step_of_the_heading_is_measured():
    poses = fly() + [(ms, x, 0.0, 20.0) for ms, x, *_ in fly(2000)[50:]]
    _, (found,) = feed(poses)
    assert math.degrees(found.turn) == pytest.approx(20.0, abs=0.5)
    assert math.degrees(found.move.yaw) == pytest.approx(-20.0, abs=0.5)


def test_a_pose_that_is_off_comes_back():
    poses = fly(2000)
    poses[50] = (1000, 30.0, 0.0, 0.0)
    _, found = feed(poses)
    assert [item.oddity for item in found] == [Oddity.STEP, Oddity.STEP]
    back = found[0].move.after(found[1].move)
    np.testing.assert_allclose(back.shift, 0.0, atol=0.05)


def test_poses_stand_still():
    poses = fly() + [(ms, 4.9, 0.0, 0.01 * ms) for ms in range(1000, 3000, 20)]
    watch, (found,) = feed(poses)
    assert found.oddity is Oddity.FROZEN
    assert watch.frozen
    watch, found = feed(poses + [(ms, x, 0.0, 0.0) for ms, x, *_ in fly(5000)[150:]])
    assert [item.oddity for item in found][:2] == [Oddity.FROZEN, Oddity.THAWED]
    assert not watch.frozen
    assert (found[1].after_ns - found[1].before_ns) * 1e-9 == pytest.approx(2.02)


def test_a_vehicle_that_stands_may_stand():
    _, found = feed([(ms, 0.0, 0.0, 0.0) for ms in range(0, 3000, 20)])
    assert not found


def test_the_first_change_of_place_in_flight_is_no_step():
    poses = [(ms, 1.0, 0.0, 0.0) for ms in range(0, 200, 20)]
    poses += [(ms, 5e-3 * ms + 1.0, 0.0, 0.0) for ms in range(200, 1000, 20)]
    _, found = feed(poses)
    assert not found
    later = [(ms, 1.0, 0.0, 0.0) for ms in range(0, 600, 20)]
    later += [(ms, 5e-3 * ms + 1.0, 0.0, 0.0) for ms in range(600, 1000, 20)]
    _, (found,) = feed(later)
    assert found.oddity is Oddity.STEP


def test_poses_that_are_told_twice_are_fine():
    poses = [(ms, x - (0.1 if (ms // 20) % 2 else 0.0), 0.0, 0.0) for ms, x, *_ in fly(3000)]
    watch, found = feed(poses)
    assert not [item for item in found if item.oddity is not Oddity.STEP]
    assert not watch.frozen
