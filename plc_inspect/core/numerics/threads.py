# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Calls of kernels side by side, for work that comes in few and large pieces."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
import time
from typing import TypeVar

from numba import get_num_threads

T = TypeVar('T')

LEAST_WORK = 0.003
"""
Least work that is shared among threads, which take time to start and to wait for the GIL [s].
Source: numerical: time alone depends on it.
"""


def call_each(function: Callable[[int], T], num: int) -> list[T]:
    """
    Return what a function gives for 0 to num - 1, in their order.

    It is called in as many threads as numba may use, and should spend its time in a kernel that
    releases the GIL.  The first call tells how long the others will take; where that is next to
    nothing they follow one by one.  Threads of numba's own were slower, and each kernel that
    starts them is compiled with all it calls once more.  Where calls fail no more are begun, and
    the error of the first of them is raised.
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

    with ThreadPoolExecutor(threads - 1) as pool:
        for _ in range(threads - 1):
            pool.submit(work)
        work()
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(num)]
