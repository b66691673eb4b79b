# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the node does at its start, and after it when there is time."""

import threading

import pytest
from rig import FIRST_DEADLINE, Rig, wait_for

from plc_inspect.ros.background import tick_job
from plc_inspect.ros.node import intake as intake_module


@pytest.fixture
def start(monkeypatch):
    """Return a function that starts a node whose rare kernels are made ready by a function."""
    rigs, calls, prepare = [], [], tick_job.prepare

    def begin(prepare_rest):
        def make_ready(settings, *, rare=False):
            calls.append('rest' if rare else 'start')
            return prepare_rest() if rare else prepare(settings)

        def take_memory(arrays, stop):
            calls.append('memory')

        monkeypatch.setattr(tick_job, 'prepare', make_ready)
        monkeypatch.setattr(intake_module, 'take_memory', take_memory)
        rigs.append(Rig(ready=False))
        wait_for(lambda: 'rest' in calls, 'rest', FIRST_DEADLINE)
        return rigs[0], calls

    yield begin
    for rig in rigs:
        rig.close()


def test_memory_and_rare_kernels_follow_the_start(start):
    rig, calls = start(lambda: None)
    wait_for(lambda: len(calls) == 3, 'three steps')
    assert calls[0] == 'start'
    assert sorted(calls[1:]) == ['memory', 'rest']
    rig.check_alive()
    assert calls[3:] == ['memory']  # the map was made anew by the reset
    assert rig.node.health.last_error == ''


def test_nobody_is_told_that_rare_kernels_failed(start):
    released = threading.Event()

    def fail():
        assert released.wait(30.0)
        raise ValueError('no')

    rig, _ = start(fail)
    rig.feed()
    threading.Timer(0.3, released.set).start()
    answer = rig.call('segment')
    assert answer.success, answer.message
    assert rig.node.health.last_error == 'rest: ValueError: no'
    assert rig.node.health.num_failed == 0


def test_a_reset_waits_for_nothing(start):
    released = threading.Event()
    rig, calls = start(lambda: released.wait(30.0) and None)
    assert rig.call('reset').success
    released.set()
    rig.check_alive()
    assert calls.count('rest') == 1
