# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Ticks in a process of their own find the same, and their process may end at any time."""

from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from rig import Rig, wait_for

from plc_inspect.config import MapSettings, SegmentSettings, Settings
from plc_inspect.core.hazards.clearance_rules import plain_rules
from plc_inspect.core.live.session import Session
from plc_inspect.core.live.warm_up import make_sample
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.offline.records.flight import copy_everything, Flight, Snapshot
from plc_inspect.ros.background.tick_job import run_tick
from plc_inspect.ros.background.tick_process import TickProcess, TickProcessError
from plc_inspect.ros.node.diagnostics import measure_memory


@pytest.fixture(scope='module')
def ticks():
    """Start a process of the ticks."""
    ticks = TickProcess()
    yield ticks
    ticks.close()


@pytest.fixture(scope='module')
def snapshot():
    """Return what a flight past the line of the sample has seen."""
    settings = Settings()
    voxels = VoxelMap(MapSettings(max_voxels=100_000))
    voxels.insert(make_sample())
    flight = Flight(
        settings=settings, rules=plain_rules(settings.hazards), frame_id='odom',
        first_stamp_ns=0, counts={},
    )
    window = copy_everything(voxels)
    cells = np.floor(window.points[:, :2] / window.cell_size).astype(np.int64)
    return Snapshot(
        window=replace(window, fresh=np.unique(cells, axis=0)),
        flight=flight, stamp_ns=5, vehicle=np.zeros(3),
        complete=True,
    )


@pytest.mark.slow
def test_a_tick_finds_the_same_there(ticks, snapshot):
    here, there = run_tick(Session(), snapshot), ticks.run_tick(Session(), snapshot)
    assert len(here.state.spans) == len(there.state.spans) == 6
    for one, other in zip(here.state.spans, there.state.spans, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.span.start, other.span.start)
    np.testing.assert_array_equal(here.labels, there.labels)
    np.testing.assert_array_equal(here.points, there.points)
    np.testing.assert_array_equal(here.slots, there.slots)
    assert here.bundle.lines == there.bundle.lines
    assert here.bundle.markers == there.bundle.markers


def test_ticks_follow_each_other(ticks, snapshot):
    """What did not change is the same object for the record; the session given stays as it was."""
    window = snapshot.window
    nothing = replace(snapshot, window=replace(
        window, slots=window.slots[:0], points=window.points[:0], fresh=window.fresh[:0],
    ))
    session = Session()
    first = ticks.run_tick(session, snapshot)
    assert not session.state.spans
    second = ticks.run_tick(first.session, nothing)
    assert len(second.kept.spans.spans) == 6
    for one, other in zip(first.kept.spans.spans, second.kept.spans.spans, strict=True):
        assert one is other
    known = frozenset(item.key for item in second.kept.spans.spans)
    third = ticks.run_tick(
        second.session, replace(snapshot, window=replace(window, spans=known))
    )
    for one, other in zip(second.kept.spans.spans, third.kept.spans.spans, strict=True):
        assert one is not other


def test_what_fails_there_fails_here(ticks, snapshot):
    with pytest.raises(AttributeError, match='NoneType'):
        ticks.run_tick(Session(), None)
    assert len(ticks.run_tick(Session(), snapshot).state.spans) == 6


@pytest.mark.slow
def test_a_process_that_was_killed_is_followed_by_another_one(ticks, snapshot):
    before = ticks.pid
    os.kill(before, signal.SIGSTOP)  # so that the tick does not end before
    os.kill(before, signal.SIGKILL)
    with pytest.raises(TickProcessError, match='code -9; the next tick begins another'):
        ticks.run_tick(Session(), snapshot)
    assert len(ticks.run_tick(Session(), snapshot).state.spans) == 6
    assert ticks.pid != before


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_are_for_the_node(ticks, snapshot, number):
    ticks.prepare(snapshot.flight.settings)  # it is there
    os.kill(ticks.pid, number)
    assert len(ticks.run_tick(Session(), snapshot).state.spans) == 6


BEGIN = """
import time
from plc_inspect.ros.background.tick_job import run_tick
from plc_inspect.ros.background.tick_process import TickProcess
ticks = TickProcess()
print(ticks.pid, flush=True)
time.sleep(60.0)
"""


def test_it_ends_with_a_node_that_is_killed():
    node = subprocess.Popen([sys.executable, '-c', BEGIN], stdout=subprocess.PIPE, text=True)
    pid = int(node.stdout.readline())
    node.kill()
    node.wait()
    node.stdout.close()
    wait_for(lambda: not Path(f'/proc/{pid}').exists() or 'Z' in Path(
        f'/proc/{pid}/stat').read_text().rpartition(')')[2][:3], 'end of the process')


@pytest.mark.slow
def test_it_lets_others_go_first_as_it_is_told(snapshot):
    ticks = TickProcess()
    try:
        for wanted, niceness in ((0, 0), (3, 3), (2, 3)):
            settings = Settings(segment=SegmentSettings(niceness=wanted))
            ticks.run_tick(Session(), replace(
                snapshot, flight=replace(snapshot.flight, settings=settings)
            ))
            before = os.getpriority(os.PRIO_PROCESS, 0)
            assert os.getpriority(os.PRIO_PROCESS, ticks.pid) == min(before + niceness, 19)
    finally:
        ticks.close()


@pytest.mark.slow
def test_a_flight_goes_on_after_the_process_of_its_ticks_was_killed():
    ticks = TickProcess()
    rig = Rig(ticks=ticks)
    try:
        rig.feed(4)
        assert rig.call('segment').success
        before = rig.node.health.num_ticks
        os.kill(ticks.pid, signal.SIGKILL)
        rig.feed(2)
        wait_for(lambda: ticks._process.poll() is not None, 'end of the process')
        assert rig.call('segment').success  # by another one
        os.kill(ticks.pid, signal.SIGSTOP)
        threading.Timer(0.5, lambda: os.kill(ticks.pid, signal.SIGKILL)).start()
        rig.feed(2)
        answer = rig.call('segment')
        assert not answer.success
        assert 'ended with code -9' in answer.message
        assert rig.node.health.num_failed == 1
        rig.feed(2)
        assert rig.call('segment').success
        assert rig.node.health.num_ticks >= before + 2
        assert rig.inserted() == rig.counters().num_scans
        last = ticks.pid
    finally:
        rig.close()
        ticks.close()
    assert not Path(f'/proc/{last}').exists()


def test_diagnostics_tell_the_memory_of_both_processes(ticks, snapshot):
    ticks.run_tick(Session(), snapshot)
    alone, both = measure_memory(), measure_memory(ticks.pid)
    assert 50e6 < both - alone < 1e9
    assert measure_memory(2**22 + 1) == pytest.approx(alone, rel=0.05)  # has ended
