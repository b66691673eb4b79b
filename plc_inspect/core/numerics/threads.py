# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Calls kernels in threads, for work that comes in few and large pieces."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
import time
from typing import TypeVar

from numba import get_num_threads

T = TypeVar('T')

LEAST_WORK = 0.003
"""
Least work that is shared among threads, which take time to start and to wait for the GIL [s].
Source: numerical: time alone depends on it.
"""


@cache
def _open_pool() -> ThreadPoolExecutor:
    """Return the threads that all calls share: to start some for each took a tenth of a run."""
    return ThreadPoolExecutor(thread_name_prefix='call_each')


def call_each(function: Callable[[int], T], num: int) -> list[T]:
    """
    Call a function with 0 to num - 1, and return the results in this order.

    It runs in as many threads as numba may use, and should spend its time in a kernel that
    releases the GIL.  The first call predicts the time of the others; below LEAST_WORK they
    follow one by one.  numba's own threads were slower, and each kernel that starts them is
    compiled once more with all it calls.  After a failure no call is begun; the first error, by
    number, is raised.
    """
    if not num:
        return []
    started = time.perf_counter()
    first = function(0)
    threads = min(get_num_threads(), num - 1)
    if threads < 2 or (time.perf_counter() - started) * (num - 1) < LEAST_WORK:
        return [first, *(function(number) for number in range(1, num))]
    numbers = iter(range(1, num))  # shared: a thread that is done takes the next
    results: dict[int, T] = {0: first}
    errors: dict[int, BaseException] = {}

    def work() -> None:
        for number in numbers:
            try:
                results[number] = function(number)
            except BaseException as error:
                errors[number] = error
                deque(numbers, maxlen=0)  # empty it, so that no thread goes on

    helpers = [_open_pool().submit(work) for _ in range(threads - 1)]
    work()
    for helper in helpers:
        if not helper.cancel():  # one that had no core to begin on is not waited for
            helper.result()
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(num)]
