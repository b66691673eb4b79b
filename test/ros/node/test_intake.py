# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What comes in goes on from a record, and begins anew where the record is of another flight."""

import json

import numpy as np
import pytest

from plc_inspect.config import Settings
from plc_inspect.core.voxel_buffer.voxel_changes import StoredMap
from plc_inspect.flight_record.plain_values import to_plain
from plc_inspect.flight_record.resumption import judge_pose
from plc_inspect.ros.node.diagnostics import Health
from plc_inspect.ros.node.intake import Intake

START, LATER = 10**12, 2 * 10**12
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def make_intake():
    intakes = []

    def make():
        intakes.append(Intake(Settings(), Health(), print))
        return intakes[-1]

    yield make
    for intake in intakes:
        intake.leave_memory()


def fly(intake, num, start=START):
    rng = np.random.default_rng(0)
    for number in range(num):
        stamp = start + 100_000_000 * number
        intake.accumulator.add_pose(
            stamp, (0.1 * number, 0.0, 20.0), UPRIGHT, frame_id='odom', child_frame_id='base'
        )
        intake.accumulator.add_scan(
            stamp, rng.uniform(-15, 15, (3000, 3)).astype(np.float32),
            np.linspace(-0.09, 0.0, 3000), frame_id='velodyne',
        )


def record(intake):
    """Return what a record tells of an intake."""
    voxels = intake.accumulator.map
    changes, _ = voxels.take_changes(0, 10**7, everything=True)
    keys, state = voxels.cells.copy_state()
    stored = StoredMap(
        keys=changes.keys, counts=changes.counts, means=changes.means, labels=changes.labels,
        origin=voxels.origin, sequence=voxels.sequence, moved=False, cell_keys=keys,
        cell_state=state,
    )
    return json.loads(json.dumps(to_plain(intake.remember()))), stored


def test_a_map_after_a_flight_that_was_another_is_judged_by_itself(make_intake):
    before, now = make_intake(), make_intake()
    fly(before, 20)
    now.resume(*record(before))
    assert now.accumulator.counters().num_points_inserted > 50_000
    now.disown()
    for number in range(3):
        assert now.doubt == ''
        fly(now, 10, LATER + number * 10**10)
    assert now.accumulator.counters().num_points_inserted > 50_000


def test_a_map_that_begins_anew_has_refused_nothing(make_intake):
    intake = make_intake()
    fly(intake, 5)
    intake.accumulator._counts['map full'] = 7
    assert intake.count_refused(intake.accumulator.counters()) == 7
    intake.reset()
    assert intake.count_refused(intake.accumulator.counters()) == 0
    assert intake.accumulator.counters().points_dropped['map full'] == 7


def test_a_doubt_and_the_offset_of_the_clock_go_on(make_intake):
    before, now = make_intake(), make_intake()
    fly(before, 20)
    before.accumulator.follower.steady.doubt = 'the heading drifts'
    before.accumulator.timing.resume(0.12, 0.0, START)
    now.resume(*record(before))
    assert now.doubt == 'the heading drifts'
    assert now.accumulator.timing.offset == 0.12


def test_a_pose_that_is_no_place_continues_no_flight(make_intake):
    intake = make_intake()
    fly(intake, 20)
    intake.told_vehicle = np.array([2.0, 0.0, 20.0])
    state, _ = record(intake)
    frames, stamp = ('odom', 'base'), state['pose_stamp_ns'] + 10**9
    assert judge_pose(state, frames, stamp, np.array([3.0, 0.0, 20.0])) == ''
    for place in (np.full(3, np.nan), np.array([5000.0, 0.0, 20.0])):
        assert 'from where it was' in judge_pose(state, frames, stamp, place)
