# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import os
import subprocess
import sys
import threading
import time

from numba import get_num_threads, set_num_threads
import pytest

from plc_inspect.core.numerics import threads as threads_module
from plc_inspect.core.numerics.threads import (
    call_each,
    call_in_few,
    POINTS_OF_A_THREAD,
)


@pytest.fixture(params=[1, 2])
def threads(request):
    set_num_threads(request.param)
    yield request.param
    set_num_threads(2)


@pytest.mark.parametrize('least', [0.0, 60.0])
@pytest.mark.parametrize('num', [0, 1, 2, 50])
def test_results_are_in_order(num, least, threads, monkeypatch):
    monkeypatch.setattr(threads_module, 'LEAST_WORK', least)
    assert call_each(lambda k: k * k, num) == [k * k for k in range(num)]


@pytest.mark.parametrize(('num', 'most'), [(0, 1), (1, 1), (2, 2), (9, 2)])
def test_few_points_get_few_threads(num, most, threads):
    assert call_in_few(num * POINTS_OF_A_THREAD, get_num_threads) == min(most, threads)
    assert get_num_threads() == threads
    with pytest.raises(ZeroDivisionError):
        call_in_few(num, lambda: 1 // 0)
    assert get_num_threads() == threads


def test_work_is_shared(threads):
    names = call_each(lambda k: (time.sleep(0.01), threading.get_ident())[1], 20)
    assert len(set(names)) == threads


def test_the_first_error_is_raised_and_no_more_calls_begin(threads):
    begun = []

    def fail(number):
        begun.append(number)
        time.sleep(0.01)
        if number in (2, 3):
            raise ValueError(str(number))

    with pytest.raises(ValueError, match='2'):
        call_each(fail, 100)
    assert len(begun) < 10


def test_short_work_stays_in_the_thread_that_asks(threads, monkeypatch):
    monkeypatch.setattr(threads_module, 'LEAST_WORK', 60.0)
    names = call_each(lambda k: (time.sleep(0.001), threading.get_ident())[1], 20)
    assert set(names) == {threading.get_ident()}


def test_threads_are_started_once():
    call_each(lambda k: time.sleep(0.01), 20)
    known = set(threading.enumerate())
    for _ in range(5):
        call_each(lambda k: time.sleep(0.01), 20)
    assert set(threading.enumerate()) == known


def test_a_helper_without_a_core_is_not_waited_for(threads):
    pool = threads_module._open_pool()
    go_on = threading.Event()
    busy = [pool.submit(go_on.wait, 60.0) for _ in range(pool._max_workers)]
    try:
        assert call_each(lambda k: (time.sleep(0.01), k)[1], 20) == list(range(20))
        assert not any(task.done() for task in busy)
    finally:
        go_on.set()


WAITING = """
import plc_inspect
from plc_inspect.core.numerics.arrays import put
from numba import njit, prange
import numpy as np

@njit(parallel=True)
def add(values):
    for k in prange(len(values)):
        values[k] += k

add(np.zeros(1000))
"""


@pytest.mark.parametrize(('given', 'line'), [
    (None, "GOMP_SPINCOUNT = '2000'"), ('active', "OMP_WAIT_POLICY = 'ACTIVE'"),
])
def test_threads_that_wait_spin_for_a_moment_only(given, line):
    known = ('OMP_WAIT_POLICY', 'GOMP_SPINCOUNT')
    environment = {key: value for key, value in os.environ.items() if key not in known}
    environment |= {'OMP_DISPLAY_ENV': 'verbose', 'NUMBA_NUM_THREADS': '2'}
    environment |= {'OMP_WAIT_POLICY': given} if given else {}
    done = subprocess.run(
        [sys.executable, '-c', WAITING], env=environment, capture_output=True, text=True,
        check=True,
    )
    assert line in done.stderr
