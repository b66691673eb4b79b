# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from plc_inspect.core.mapping.scan_clock import RESTART_AFTER
from plc_inspect.core.mapping.scan_counters import DropReason
from plc_inspect.core.mapping.scan_gate import (
    LEAST_CONFLICTS,
    LEAST_TIMED,
    REMEMBERED,
    ScanGate,
)

MS = 1_000_000


def judge(
    gate, stamp_ms, duration_ms=100, *, period=0.1, frame='lidar', layout='xyz', timed=True
):
    stamp = round(stamp_ms * MS)
    times = stamp - round(duration_ms * MS), stamp
    return gate.judge(frame, layout, stamp, times, period, timed)


@pytest.mark.parametrize('duration', [0, 60, 100, 105])
def test_scans_of_one_driver_pass(duration):
    gate = ScanGate()
    stamps = [100, 201, 299, 404, 500, 900, 1000]
    assert [judge(gate, stamp, duration) for stamp in stamps] == [None] * 7


def test_an_empty_scan_of_no_fields_tells_no_layout():
    gate = ScanGate()
    assert judge(gate, 100, layout='') is None
    assert judge(gate, 200, layout='yxz') is None
    assert judge(gate, 300, layout='') is None
    assert judge(gate, 400) == DropReason.OTHER_LAYOUT


@pytest.mark.parametrize(('num', 'reason'), [
    (0, None), (LEAST_TIMED - 1, None), (LEAST_TIMED, DropReason.NO_TIMES),
])
def test_scans_without_times_are_refused_after_those_with(num, reason):
    gate = ScanGate()
    assert [judge(gate, 100 * k) for k in range(1, num + 1)] == [None] * num
    gate.forget_times()  # as the clock was set back, not the driver changed
    untimed = [judge(gate, 100 * k, 0, timed=False) for k in range(50, 50 + 2 * LEAST_TIMED)]
    assert untimed == [reason] * len(untimed)
    assert judge(gate, 9900) is None


def test_a_scan_without_a_frame_tells_no_frame():
    gate = ScanGate()
    assert judge(gate, 0, frame='', layout='') is None
    assert judge(gate, 100) is None
    assert judge(gate, 200, frame='') is DropReason.WRONG_FRAME
    assert judge(gate, 300) is None


def test_scans_out_of_order_pass():
    gate = ScanGate()
    assert [judge(gate, stamp) for stamp in (100, 300, 200, 500, 400)] == [None] * 5


def test_scans_that_come_later_from_before_disprove_a_stamp():
    gate = ScanGate()
    assert judge(gate, 610) is None  # should be 100
    assert judge(gate, 200) is None
    assert not gate.is_disproved(610 * MS)  # the two may have come in the wrong order
    assert [judge(gate, stamp) for stamp in range(300, 900, 100)] == [None] * 6
    assert gate.is_disproved(610 * MS)
    assert not gate.is_disproved(500 * MS)
    assert not gate.is_disproved(123 * MS)


def test_scans_from_before_all_others_pass_once_many_show_a_clock_set_back():
    gate = ScanGate()
    for number in range(REMEMBERED):
        assert judge(gate, 5000 + 100 * number) is None
    assert judge(gate, 2000) is DropReason.SET_BACK  # one stamp that is wrong
    assert judge(gate, 6600) is None
    back = [judge(gate, 2000 + 100 * number) for number in range(RESTART_AFTER + 2)]
    assert back == [*[DropReason.SET_BACK] * (RESTART_AFTER - 1), None, None, None]


@pytest.mark.parametrize('phase', [3, 30, 50, 75])
def test_second_driver_never_takes_over(phase):
    gate = ScanGate()
    taken = {'first': 0, 'second': 0}
    for number in range(50):
        if number % 10 != 9:  # a scan in ten of the first driver is lost
            taken['first'] += judge(gate, 100 * number) is None
        taken['second'] += judge(gate, 100 * number + phase) is None
    assert taken['first'] == 45
    # One that is nearly in step with the first cannot be told from it where that one is lost.
    assert taken['second'] == (5 if phase == 3 else 0)


@pytest.mark.parametrize('duration', [0, 100])
def test_repeated_scans_are_refused(duration):
    gate = ScanGate()
    judged = [judge(gate, 100 * (number // 2), duration) for number in range(20)]
    assert judged == [None, DropReason.OVERLAP] * 10


@pytest.mark.parametrize('phase', [80, 85, 90])
def test_second_driver_that_overlaps_little_does_not_take_over(phase):
    gate = ScanGate()
    taken = {'first': 0, 'second': 0}
    for number in range(100):
        taken['first'] += judge(gate, 100 * number) is None
        if 10 <= number < 50:
            taken['second'] += judge(gate, 100 * number + phase) is None
    assert taken == {'first': 100, 'second': LEAST_CONFLICTS}
    assert gate.is_disproved((1000 + phase) * MS)


@pytest.mark.parametrize('late', [15, 21, 50, 90])
def test_one_late_stamp_costs_no_other_scan(late):
    gate = ScanGate()
    judged = [judge(gate, 100 * number + late * (number == 20)) for number in range(100)]
    assert judged == [None] * 100
    assert gate.is_disproved((2000 + late) * MS) == (late > 20)


@pytest.mark.parametrize('times', [1, 2])
def test_scans_that_jitter_pass(times):
    gate = ScanGate()
    jitter = np.random.default_rng(0).normal(0.0, 4.0, 200)
    taken = [
        judge(gate, 100 * number + jitter[number]) is None
        for number in range(200) for _ in range(times)
    ]
    assert sum(taken) >= 199


@pytest.mark.parametrize('duration', [0, 50])
def test_stamps_a_microsecond_apart_are_refused(duration):
    gate = ScanGate()
    judged = [judge(gate, 100 + 0.001 * number, duration, period=None) for number in range(100)]
    assert judged == [None] + [DropReason.OVERLAP] * 99


def test_frame_and_layout_of_the_first_scan_hold():
    gate = ScanGate()
    assert judge(gate, 100) is None
    assert judge(gate, 200, frame='camera') is DropReason.WRONG_FRAME
    assert judge(gate, 200, layout='yxz') is DropReason.OTHER_LAYOUT
    assert judge(gate, 200) is None


def test_time_may_begin_anew():
    gate = ScanGate()
    assert judge(gate, 100) is None
    gate.forget_times()
    assert judge(gate, 100) is None
