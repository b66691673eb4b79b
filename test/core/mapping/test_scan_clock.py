# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import pytest

from plc_inspect.core.mapping.scan_clock import MIN_PERIODS, ScanClock

MS = 1_000_000


def run_clock(stamps_ms):
    clock = ScanClock()
    missing = [clock.add(stamp * MS) for stamp in stamps_ms]
    return clock, missing


def test_regular_scans_with_jitter_lose_nothing():
    clock, _ = run_clock([0, 101, 199, 303, 398, 500, 590, 712, 800])
    assert clock.num_lost == 0
    assert clock.period == pytest.approx(0.1, abs=0.005)


def test_gaps_count_what_fits_into_them():
    clock, missing = run_clock([*range(0, 1000, 100), 1100, 1200, 1700, 1800])
    assert missing[-4:] == [1, 0, 4, 0]
    assert clock.num_lost == 5


def test_no_judgement_before_the_period_is_known():
    clock, _ = run_clock([0, 100, 500, 600])
    assert (clock.period, clock.num_lost) == (None, 0)
    assert run_clock(range(0, 100 * (MIN_PERIODS + 1), 100))[0].period == pytest.approx(0.1)


def test_a_long_pause_is_an_interruption():
    clock, _ = run_clock([*range(0, 1000, 100), 60_000, 60_100])
    assert (clock.num_lost, clock.num_interruptions) == (0, 1)


def test_a_stamp_in_the_future_costs_one_interruption():
    clock, _ = run_clock([*range(0, 1000, 100), 10**7, 1000, 1100, 1200])
    assert (clock.num_lost, clock.num_interruptions) == (0, 1)


def test_restart_keeps_the_counts():
    clock, _ = run_clock([*range(0, 1000, 100), 1200])
    restarted = clock.restarted()
    restarted.add(0)
    assert (restarted.num_lost, restarted.period) == (2, None)
