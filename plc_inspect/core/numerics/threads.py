# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Calls kernels in threads, for work in few, large pieces."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
import time
from typing import TypeVar

from numba import get_num_threads, set_num_threads

T = TypeVar('T')

LEAST_WORK = 0.003
"""
Least work shared among threads, which take time to start and to wait for the GIL [s].
Source: numerical: time alone depends on it.
"""

POINTS_OF_A_THREAD = 400_000
"""
Points of a cloud for each thread.
Source: measured, two cores, a pass in one thread and in two: 41,000 points 0.18 and 0.21 s, beside
one busy program 0.19 and 0.25 s; 152,000 points 0.24 and 0.27 s; 928,000 points 0.90 and 0.84 s.
"""


@cache
def _open_pool() -> ThreadPoolExecutor:
    """Return the threads that all calls share: starting new ones took a tenth of a run."""
    return ThreadPoolExecutor(thread_name_prefix='call_each')


def call_in_few(num_points: int, function: Callable[[], T]) -> T:
    """
    Call a function in which kernels and `call_each` use no more threads than points are worth.

    A pass over few points is a hundred and more short parallel regions, at whose ends all threads
    wait for the last one: the longer, the less of the machine is free.
    """
    before = get_num_threads()
    set_num_threads(min(before, max(1, num_points // POINTS_OF_A_THREAD)))
    try:
        return function()
    finally:
        set_num_threads(before)


def call_each(function: Callable[[int], T], num: int) -> list[T]:
    """
    Call a function with 0 to num - 1, and return the results in order.

    Runs in as many threads as numba may use; the function should spend its time in a kernel that
    releases the GIL.  The first call predicts the time of the others; below LEAST_WORK they are
    made one by one.  numba's own threads were slower, and compile a parallel kernel, with all it
    calls, once more.  After an error no call is begun; the error of the least number is raised.
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
        if not helper.cancel():  # do not wait for one that has not begun
            helper.result()
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(num)]
