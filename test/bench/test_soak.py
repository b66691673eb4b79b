# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The soak: faults that a seed draws, scans that are all counted, limits that can be missed."""

import importlib
from pathlib import Path
import sys
from types import SimpleNamespace

from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rig import BASE, make_cloud, put_stamp

sys.path.insert(0, str(Path(__file__).parents[2] / 'bench'))
soak = importlib.import_module('soak')
changes = importlib.import_module('common.odometry_changes')
sys.path.pop(0)
SECONDS, WARM_UP = 600.0, 50.0


def test_a_seed_draws_all_faults_before_one_comes_again():
    first, again, other = (
        soak.draw_faults(WARM_UP, 3600.0, 60.0, seed) for seed in (1, 1, 2)
    )
    assert first == again != other
    assert {name for _, name in first[: len(soak.FAULT_NAMES)]} == set(soak.FAULT_NAMES)
    begins = np.array([begin for begin, _ in first])
    assert begins[0] >= WARM_UP
    assert (np.diff(begins) >= soak.SLICE).all()
    assert begins[-1] + soak.SLICE <= 3600.0


@pytest.fixture
def there_and_back():
    """Return a flight of small scans at 10 Hz, there and back."""
    events = []
    for number in range(round(soak.LEG * 10)):
        scan = make_cloud(np.full((6, 3), 5.0), 0.1 * number)
        pose = Odometry()
        put_stamp(pose, 0.1 * number + 0.05)
        pose.pose.pose.position.x = 0.8 * number
        pose.pose.pose.orientation.w = 1.0
        events += [soak.Event(0.1 * number, 'scan', scan),
                   soak.Event(0.1 * number + 0.05, 'odometry', pose)]
    return changes.turn_back(events, soak.LEG)


class Clock:
    """Feeder and probe of a flight in no time, and its clock."""

    def __init__(self, monkeypatch):
        self.now, self.stamps, self.samples = 0.0, [], 0
        self.publishers = {
            kind: SimpleNamespace(publish=lambda message, kind=kind: self.stamps.append(
                (kind, message.header.stamp.sec - BASE + 1e-9 * message.header.stamp.nanosec)
            )) for kind in ('scan', 'second', 'odometry')
        }
        monkeypatch.setattr(soak, 'time', SimpleNamespace(
            monotonic=lambda: self.now, sleep=self._wait,
        ))

    def _wait(self, seconds):
        self.now += seconds

    def sample(self):
        self.samples += 1


def test_rounds_follow_each_other_and_withheld_scans_are_counted(monkeypatch, there_and_back):
    clock = Clock(monkeypatch)
    flight = soak.Flight(clock, clock)
    flight.fly(there_and_back, [(70.0, 'driver away for 3 s')], 150.0)
    stamps = np.array([stamp for kind, stamp in clock.stamps if kind == 'scan'])
    gaps = np.diff(stamps)
    assert flight.sent == len(stamps)
    assert 28 <= flight.withheld <= 30
    assert flight.sent + flight.withheld == pytest.approx(1500, abs=2)
    assert ((gaps > 0.05) & (gaps < 0.21)).sum() == len(gaps) - 1  # all but the fault's
    assert clock.samples == pytest.approx(150, abs=3)


def test_a_fault_leaves_the_flight_itself_as_it_was(monkeypatch, there_and_back):
    before = [(event.time, event.kind, str(event.message)) for event in there_and_back]
    clock = Clock(monkeypatch)
    flight = soak.Flight(clock, clock)
    flight.fly(there_and_back, [(5.0, 'two drivers, the second 2 m lower')], 60.0)
    assert [(event.time, event.kind, str(event.message)) for event in there_and_back] == before
    seconds = sum(kind == 'second' for kind, _ in clock.stamps)
    assert seconds == pytest.approx(200, abs=2)
    assert flight.sent == sum(kind != 'odometry' for kind, _ in clock.stamps)


def judge(num_scans=6000, memory=0.0, ticks=0.0):
    """Judge a flight of 6,000 scans whose memory and ticks grow by shares."""
    times = np.arange(0.0, SECONDS)
    zeros = ('scans inserted', 'scans dropped', 'messages malformed', 'ticks', 'ticks postponed',
             'ticks failed', 'map restarts')
    probe = SimpleNamespace(
        values=dict.fromkeys(zeros, '0') | {
            'scans': str(num_scans), 'scans lost': '20', 'callbacks p99 [ms]': '1',
        },
        usage=[(at, at, 1e9 * (1.0 + memory * at / SECONDS)) for at in times],
        ticks=[(at, 100.0 * (1.0 + ticks * at / SECONDS)) for at in times],
    )
    flight = SimpleNamespace(sent=6000, withheld=20, began=0.0)
    return [item.name for item in soak.judge(flight, probe, WARM_UP, SECONDS) if not item.kept]


def test_a_steady_flight_keeps_the_limits():
    assert judge() == []


@pytest.mark.parametrize(('change', 'missed'), [
    ({'num_scans': 5999}, 'scans lost unseen'),
    ({'memory': 0.1}, 'growth of memory in the second half'),
    ({'ticks': 0.2}, 'growth of p95 of ticks'),
])
def test_what_grows_or_is_lost_is_told(change, missed):
    assert judge(**change) == [missed]
