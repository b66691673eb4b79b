# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Memory that is asked for ahead, and memory that is given back."""

import mmap
import os
from pathlib import Path
import platform
import re
import threading

import numpy as np
import pytest

from plc_inspect.ros.background.system_memory import give_back_memory, take_memory

MEGABYTE = 1_000_000


def can_take_memory():
    """Tell whether the system takes memory when asked: Linux since 5.14."""
    numbers = re.match(r'(\d+)\.(\d+)', platform.release())
    return platform.system() == 'Linux' and tuple(map(int, numbers.groups())) >= (5, 14)


def read_resident():
    """Return the resident memory of this process [bytes]."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE')


@pytest.mark.skipif(not can_take_memory(), reason='the system cannot be asked')
def test_memory_is_there_before_it_is_written():
    fresh = np.frombuffer(mmap.mmap(-1, 100 * MEGABYTE), dtype=np.uint8)  # not from what was freed
    arrays = [fresh, np.zeros((10, 1, 0)), np.zeros(3)]
    before = read_resident()
    take_memory(arrays)
    assert read_resident() - before > 90 * MEGABYTE


@pytest.mark.skipif(not can_take_memory(), reason='the system cannot be asked')
def test_it_stops_when_told():
    stop = threading.Event()
    stop.set()
    before = read_resident()
    take_memory([np.frombuffer(mmap.mmap(-1, 100 * MEGABYTE), dtype=np.uint8)], stop)
    assert read_resident() - before < 10 * MEGABYTE


def test_what_is_there_and_what_is_written_meanwhile_stays():
    array = np.zeros(30 * MEGABYTE, dtype=np.int64)
    array[::1000] = 7
    thread = threading.Thread(target=take_memory, args=([array],))
    thread.start()
    array[500::1000] += 1
    while thread.is_alive():
        array[500::1000] += 1
    thread.join()
    assert array[500] > 0
    assert (array[::1000] == 7).all()
    assert (array[500::1000] == array[500]).all()
    assert array.sum() == 7 * 30_000 + 30_000 * int(array[500])


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason='only glibc can be asked')
def test_memory_between_what_stays_is_given_back():
    give_back_memory()
    before = read_resident()
    blocks = [np.ones(10_000) for _ in range(4000)]  # 80 kB each, below what is mapped alone
    kept = blocks[::100]
    full = read_resident()
    del blocks
    give_back_memory()
    after = read_resident()
    assert len(kept) == 40
    assert full - before > 250e6
    assert after - before < 0.2 * (full - before)
