# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import ctypes
import os
import subprocess
import sys

import pytest

# Makes and drops four arrays twice; prints the pages that the second ones had to be given.
CODE = """
import resource
import numpy as np
from plc_inspect.offline.commands.allocator import keep_freed_memory

if {keep} is not None:
    keep_freed_memory(of_any_size={keep})

def fill():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones({size}) for _ in range(4)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

fill()
print(fill())
"""


def count_faults(keep, size=3_000_000):
    done = subprocess.run(
        [sys.executable, '-c', CODE.format(keep=keep, size=size)], capture_output=True, check=True,
        text=True, env={**os.environ, 'NUMPY_MADVISE_HUGEPAGE': '0'}, timeout=60,
    )
    return int(done.stdout)


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), 'mallopt'), reason='only glibc maps large arrays anew'
)
def test_freed_memory_is_used_again():
    # in pages of 4 KB the arrays have 24,000, in large ones 48
    assert count_faults(keep=False) < 0.2 * count_faults(keep=None)


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), 'mallopt'), reason='only glibc maps large arrays anew'
)
def test_freed_memory_of_any_size_is_used_again_by_a_grid():
    size = 6_000_000  # 48 MB, more than glibc keeps of its own
    assert count_faults(keep=True, size=size) < 0.2 * count_faults(keep=False, size=size)
