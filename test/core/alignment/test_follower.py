# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.alignment.cell_comparison import LEAST_LOOKS, OPEN_NS
from plc_inspect.core.alignment.follower import Follower
from plc_inspect.core.alignment.normal_cells import NormalCells
from plc_inspect.core.alignment.parts import BY_RATE, Part, Seen
from plc_inspect.core.alignment.registration import Fit, fit_heading, fit_points
from plc_inspect.core.alignment.rigid_move import RigidMove

START = 1_700_000_000_000_000_000
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
SPEED = 5.0


def look(place, rng, num=900):
    """Return points of ground, three wires, poles and a wall within 35 m, in the world."""
    ground = place[:2] + rng.uniform(-30.0, 30.0, (num, 2))
    z = 0.4 * np.sin(0.3 * ground[:, 0]) + 0.3 * np.cos(0.21 * ground[:, 1])
    parts = [np.column_stack((ground, z))]
    x = place[0] + rng.uniform(-30.0, 30.0, (3, num // 6))
    parts += [np.column_stack((x[n], np.full(num // 6, 2.0 * n), 10.0 + 1e-3 * x[n] ** 2 % 1.0))
              for n in range(3)]
    for foot in range(-40, 200, 20):
        if abs(foot - place[0]) < 30.0:
            parts.append(np.column_stack((
                np.full(40, float(foot)), np.full(40, 5.0), rng.uniform(0.0, 10.0, 40),
            )))
    points = np.concatenate(parts)
    return points + rng.normal(0.0, 0.02, points.shape)


def find_place(when, seconds):
    """Return where a vehicle is that flies along x and back."""
    far = SPEED * seconds / np.pi * (1.0 - np.cos(2.0 * np.pi * when / seconds)) / 2.0
    return np.array([far, 0.0, 15.0])


def turn_at_once(when, seconds):
    """Return where a vehicle is that flies along x and all at once flies back."""
    return np.array([1.6 * SPEED * (seconds / 2.0 - abs(when - seconds / 2.0)), 0.0, 15.0])


def fly(follower, error, seconds=12.0, heading=0.0, find=find_place):
    """
    Fly along x and back, with odometry that is off, or stands still where that is None.

    The heading that it tells drifts by some rad/s.

    Return the scans that came through, and the parts that begin the map anew.
    """
    rng = np.random.default_rng(5)
    entered, parts = [], []
    told = np.zeros(3)
    for tick in range(int(seconds * 50)):
        when = tick * 0.02
        place, off = find(when, seconds), error(when)
        turned = RigidMove(np.zeros(3), heading * when, place)
        stamp = START + round(when * 1e9)
        told = told if off is None else place + off
        half = heading * when / 2.0
        follower.see_pose(stamp, told, np.array([0.0, 0.0, np.sin(half), np.cos(half)]))
        if tick % 5 == 0 and off is not None:
            points = look(place, rng)
            found = list(follower.take(Seen(
                turned.apply(points) + off, np.full(len(points), stamp),
                np.linalg.norm(points - place, axis=1), stamp,
            )))
            parts += [item for item in found if isinstance(item, Part)]
            entered += [
                (item.stamp_ns, item.points) for item in found if isinstance(item, Seen)
            ]
    return entered, parts


def measure_errors(entered):
    """Return how far the wires at y = 0 and y = 2 lie off in any scan, in the median [m]."""
    errors = [
        (np.median(points[900:1050, 1]), np.median(points[1050:1200, 1]) - 2.0)
        for _, points in entered
    ]
    return np.abs(np.array(errors)).max()


def test_good_odometry_moves_nothing():
    follower = Follower()
    entered, parts = fly(follower, lambda when: np.zeros(3))
    assert follower.move.trivial
    assert not follower.parts
    assert not parts
    assert len(entered) == 120


@pytest.mark.parametrize('step', [(0.0, 0.3, 0.0), (0.2, -1.0, 0.5), (-4.0, 8.0, -3.1)])
def test_scans_after_a_step_lie_where_those_before_do(step):
    follower = Follower()
    entered, parts = fly(
        follower, lambda when: np.array(step) if when > 8.0 else np.zeros(3)
    )
    assert not parts
    assert len(entered) >= 117
    (part,) = follower.parts
    assert part.aligned
    assert part.by == 'what was seen twice'
    size = float(part.cause.split()[-2])
    assert size == pytest.approx(np.linalg.norm(step), abs=0.05)
    assert np.linalg.norm(follower.move.shift + step) < 0.1
    assert part.sigma < 0.1
    assert measure_errors(entered) < 0.1


def test_a_step_of_the_heading_alone_is_taken_back():
    follower, turn = Follower(), np.radians(5.0)
    rng = np.random.default_rng(6)
    for tick in range(600):
        place = find_place(tick * 0.02, 12.0)
        yaw = turn if tick > 400 else 0.0
        moved = RigidMove(np.zeros(3), yaw, find_place(8.01, 12.0))
        stamp, told = START + tick * 20_000_000, moved.apply(place)
        follower.see_pose(
            stamp, told, np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])
        )
        if tick % 5 == 0:
            points = moved.apply(look(place, rng))
            apart = np.linalg.norm(points - told, axis=1)
            list(follower.take(Seen(points, np.full(len(points), stamp), apart, stamp)))
    (part,) = follower.parts
    assert '5.0 degrees' in part.cause
    assert follower.move.yaw == pytest.approx(-turn, abs=2e-3)


def test_a_pose_that_is_off_alone_is_no_step():
    follower = Follower()
    entered, parts = fly(
        follower, lambda when: np.array([0.0, 50.0, 0.0]) if when == 8.02 else np.zeros(3)
    )
    assert follower.move.trivial
    assert not follower.parts
    assert not parts
    assert len(entered) >= 117


def test_a_turn_on_the_spot_is_no_step():
    follower = Follower()
    entered, parts = fly(follower, lambda when: np.zeros(3), seconds=12.02, find=turn_at_once)
    assert follower.move.trivial
    assert not follower.parts
    assert not parts
    assert len(entered) >= 119


def test_positions_that_stick_with_jitter_are_no_turn():
    follower, rng = Follower(), np.random.default_rng(4)

    def stick(when):
        if not 4.0 < when < 5.0:
            return np.zeros(3)
        stuck, place = (turn_at_once(at, 12.0) for at in (4.0, when))
        return stuck - place + rng.normal(0.0, 1e-3, 3)

    fly(follower, stick, find=turn_at_once)
    assert 'the odometry stepped by 0.1' in follower.parts[0].cause


def test_a_step_while_the_vehicle_brakes_hard_is_registered():
    """Poses at 5 Hz: between two of them the braking explains as much."""
    follower, rng = Follower(), np.random.default_rng(7)
    for tick in range(60):
        when = 0.2 * tick
        braked = max(when - 6.0, 0.0)
        place = np.array([8.0 * when - 3.0 * min(braked, 4.0 / 3.0) ** 2, 0.0, 15.0])
        told = place + np.array([-0.8, 0.0, 0.0]) * (when > 6.1)
        stamp = START + tick * 200_000_000
        follower.see_pose(stamp, told, UPRIGHT)
        points = look(place, rng) + told - place
        apart = np.linalg.norm(points - told, axis=1)
        list(follower.take(Seen(points, np.full(len(points), stamp), apart, stamp)))
    assert follower.move.shift[0] == pytest.approx(0.8, abs=0.15)


def test_a_step_where_the_vehicle_turns_on_the_spot_is_a_step():
    follower = Follower()
    step = np.array([0.0, 0.5, 0.0])
    entered, parts = fly(
        follower, lambda when: step if when > 6.01 else np.zeros(3), seconds=12.02,
        find=turn_at_once,
    )
    assert not parts
    assert len(follower.parts) == 1
    assert abs(follower.move.shift[1] + 0.5) < 0.1
    assert measure_errors(entered) < 0.1


@pytest.mark.parametrize(('age', 'deviations', 'follows'), [
    (5.0, 5.0, True), (5.0, 3.0, False), (20.0, 3.0, True), (20.0, 1.0, False),
])
def test_less_tells_of_drift_once_the_vehicle_has_come_back(
    monkeypatch, age, deviations, follows
):
    def fit(cells, points, start, before, stamp_ns, *, held):
        return Fit(
            move=RigidMove(np.array([0.0, 0.3, 0.0]), 0.0, start.centre),
            covariance=np.diag([(0.3 / deviations) ** 2] * 3 + [1e-4]),
            matched=len(points), fitting=len(points), age=age,
        )
    monkeypatch.setattr('plc_inspect.core.alignment.follower.fit_points', fit)
    follower = Follower()
    fly(follower, lambda when: np.zeros(3), seconds=4.0)
    assert follower.following is follows


def test_a_drift_is_followed():
    follower = Follower()
    rate = np.array([0.0, 0.08, 0.0])
    entered, parts = fly(follower, lambda when: rate * when, seconds=24.0)
    assert not parts
    assert follower.following
    assert follower.parts[0].cause == 'the odometry drifts'
    # On the way back everything lies where it was put on the way there.
    errors = [np.median(points[900:1050, 1]) for _, points in entered]
    assert abs(errors[-1] - errors[30]) < 0.2
    assert (rate * 21.0)[1] > 1.5  # by which it would lie elsewhere


@pytest.mark.parametrize('scale', [0.93, 0.96, 1.04, 1.08])
def test_positions_that_are_too_long_begin_the_map_anew_and_are_corrected(scale):
    follower, shifts = Follower(), []

    def error(when):
        place = find_place(when, 40.0)
        told = place + (off := (scale - 1.0) * place * (1.0, 1.0, 0.0))
        shifts.append(follower.move.apply(told) - place)
        return off

    _, parts = fly(follower, error, seconds=40.0)
    assert 1 <= len(parts) <= 2
    assert all(part.by == BY_RATE and not part.aligned for part in parts)
    assert f'% too {"long" if scale > 1.0 else "short"}' in parts[-1].describe()
    told = float(parts[-1].cause.split(' %')[0].split()[-1])
    assert told == pytest.approx(100.0 * abs(scale - 1.0), abs=3.0)
    # to the end and back the map neither slides nor doubles
    began = (parts[-1].begin_ns - START) // 20_000_000
    after = np.array(shifts[began + 50:])
    assert np.linalg.norm(after - np.median(after, axis=0), axis=1).max() < 0.4
    assert np.abs(np.median(after, axis=0)).max() < 0.6
    assert not follower.doubt


def test_a_drift_along_the_way_that_is_followed_is_no_scale():
    follower = Follower()
    _, parts = fly(follower, lambda when: np.array([0.05 * when, 0.0, 0.0]), seconds=24.0)
    assert not parts
    assert not follower.doubt


def test_a_heading_that_drifts_against_the_positions_is_doubted():
    follower = Follower()
    fly(follower, lambda when: np.zeros(3), seconds=20.0, heading=np.radians(0.4))
    assert 'heading' in follower.doubt
    assert 'held back' in follower.doubt


@pytest.mark.parametrize('rate', [1.0, -3.0])
def test_a_fast_drift_of_the_heading_is_no_drift_of_the_position(rate):
    follower = Follower()
    fly(follower, lambda when: np.zeros(3), seconds=6.0, heading=np.radians(rate))
    assert 'the heading' in follower.doubt


def test_a_drift_of_the_position_is_no_turn():
    follower = Follower()
    fly(follower, lambda when: np.array([0.05 * when, 0.1 * when, 0.0]), seconds=24.0)
    assert not follower.doubt


def test_nothing_known_of_the_turn_finds_it():
    rng, cells = np.random.default_rng(8), NormalCells()
    place = np.array([0.0, 0.0, 15.0])
    for number in range(5):
        cells.add(look(place, rng), START + number * 10**8)
    turned = RigidMove(np.zeros(3), np.radians(2.0), place)
    points, known = turned.apply(look(place, rng)), np.diag([0.02, 0.02, 0.02, 0.002]) ** 2
    arguments = cells, points, RigidMove(centre=place), known, START + 2 * OPEN_NS
    assert abs(np.degrees(fit_points(*arguments).move.yaw)) < 1.0
    assert np.degrees(fit_heading(*arguments).move.yaw) == pytest.approx(-2.0, abs=0.2)
    nothing = fit_heading(cells, np.zeros((0, 3)), *arguments[2:])
    assert nothing.matched == 0
    assert nothing.move.yaw == 0.0


def test_a_slow_drift_of_the_heading_is_no_doubt():
    follower = Follower()
    fly(follower, lambda when: np.zeros(3), seconds=20.0, heading=np.radians(0.01))
    assert not follower.doubt


def test_a_drift_aside_that_is_too_fast_is_doubted():
    follower = Follower()
    fly(follower, lambda when: np.array([0.0, 0.4 * when, 0.0]), seconds=24.0)
    assert 'drifts by' in follower.doubt


def test_a_doubt_ends_with_the_map():
    follower = Follower()
    fly(follower, lambda when: np.array([0.0, 0.4 * when, 0.0]), seconds=24.0)
    assert follower.doubt
    follower.clear()
    assert not follower.doubt


def test_a_drift_sets_in_without_a_step_in_the_map():
    follower, shifts, began = Follower(), [], []

    def error(when):
        shifts.append(follower.move.shift.copy())
        began.append(follower.following)
        return np.array([0.0, 0.08, 0.0]) * when

    fly(follower, error, seconds=24.0)
    assert any(began[:500])  # on the way there
    assert np.linalg.norm(np.diff(shifts[:550], axis=0), axis=1).max() < 0.05


def test_crowns_of_which_another_side_is_seen_carry_nothing_along():
    rng, cells = np.random.default_rng(2), NormalCells()
    crowns = rng.uniform((0.0, 0.0, 4.0), (20.0, 6.0, 5.0), (6000, 3))
    ground = rng.uniform((0.0, 0.0, 0.5), (20.0, 3.0, 0.5), (3000, 3))
    seen = np.concatenate((crowns, ground + rng.normal(0.0, 0.02, ground.shape)))
    for look in range(LEAST_LOOKS):
        cells.add(seen, START + look)
    above = crowns[crowns[:, 2] > 4.6][:1000]
    later = np.concatenate((above, ground[:50]))
    known = np.diag([0.1**2] * 3 + [1e-6])
    fit = fit_points(cells, later, RigidMove(), known, START + 2 * OPEN_NS)
    assert fit.matched > 1000
    assert abs(fit.move.shift[2]) < 0.03


def test_poses_that_stand_still_are_told_and_what_follows_fits():
    follower = Follower()
    entered, parts = fly(follower, lambda when: None if 4.0 < when < 5.0 else np.zeros(3))
    assert not parts
    (part,) = follower.parts
    assert 'stood still for 1.0 s' in part.cause
    assert np.linalg.norm(follower.move.shift) < 0.1
    assert measure_errors(entered) < 0.1


def see_poses(follower, places):
    """Tell of poses 50 times a second, and return where each is taken to be; None: unknown."""
    found = []
    for number, place in enumerate(places):
        follower.see_pose(START + number * 20_000_000, np.array(place), UPRIGHT)
        move = follower.likely_move
        found.append(None if move is None else move.apply(np.array(place)))
    return found


def test_while_a_step_is_looked_at_the_motion_tells_where_the_vehicle_is():
    true = [(0.1 * n, 0.0, 15.0) for n in range(40)]
    told = [(x, y + 5.0 * (x > 2.0), z) for x, y, z in true]
    found = see_poses(Follower(), told)
    assert np.linalg.norm(np.array(found) - true, axis=1).max() < 0.2


def test_where_the_poses_stand_still_nobody_knows_where_the_vehicle_is():
    told = [(0.1 * min(n, 20), 0.0, 15.0) for n in range(60)]
    found = see_poses(Follower(), told)
    assert all(item is not None for item in found[:21])
    assert all(item is None for item in found[31:])
    thawed = see_poses(follower := Follower(), [*told, (9.0, 0.0, 15.0), (9.1, 0.0, 15.0)])
    assert thawed[-2:] == [None, None]
    assert not follower.watch.frozen


def test_where_nothing_was_seen_twice_a_part_begins():
    follower = Follower()
    entered, parts = fly(
        follower, lambda when: np.array([3e3, 0.0, 0.0]) if when > 1.0 else np.zeros(3), 4.0
    )
    (part,) = parts
    assert not part.aligned
    assert 'cannot be brought together' in part.describe()
    assert follower.move.trivial
    assert entered[-1][1][:, 0].min() > 2900.0
    assert len(entered) >= 37


def test_a_part_survives_its_record():
    follower = Follower()
    fly(follower, lambda when: np.array([0.0, 1.0, 0.0]) if when > 8.0 else np.zeros(3))
    (part,) = follower.parts
    again = Part.from_record(part.record())
    assert again.describe() == part.describe()
    np.testing.assert_array_equal(again.move.shift, part.move.shift)


def test_a_resumed_map_is_a_landmark():
    first, second = Follower(), Follower()
    entered, _ = fly(first, lambda when: np.zeros(3), 6.0)
    points = np.concatenate([item for _, item in entered])
    second.resume(first.move, points, START - 10**9, np.array([0.0, 0.0, 15.0]), [])
    fly(second, lambda when: np.array([0.0, 1.5, 0.0]) if when > 1.0 else np.zeros(3), 4.0)
    assert abs(second.move.shift[1] + 1.5) < 0.1
    assert second.parts[0].aligned
