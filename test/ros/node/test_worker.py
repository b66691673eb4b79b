# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The worker's thread, and what it leaves behind."""

import threading
import weakref

import pytest

from plc_inspect.ros.node import worker as worker_module


class Thing:
    """Something that a job makes."""


@pytest.mark.parametrize('fails', [False, True])
def test_tidies_up_after_each_job_when_all_were_told(monkeypatch, fails):
    calls, done, made = [], threading.Event(), []

    def tidy_up():
        calls.append('tidy up')
        done.set()

    def job():
        thing = Thing()
        made.append(weakref.ref(thing))
        if fails:
            raise ValueError('no')
        return thing

    monkeypatch.setattr(worker_module, 'give_back_memory', tidy_up)
    worker = worker_module.Worker(lambda: calls.append('told'))
    worker.submit(job)
    assert done.wait(10.0)
    outcome = worker.take()
    assert calls == ['told', 'tidy up']
    assert (outcome.value is None) == fails
    del outcome
    assert made[0]() is None, 'the worker still holds what its last job made'
    assert worker.stop(10.0)
