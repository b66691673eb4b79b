# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

import ctypes
import os
import subprocess
import sys

import pytest

# Makes and drops arrays of 96 MB twice; prints the pages that the second ones had to be given.
CODE = """
import resource
import numpy as np
from plc_inspect.offline.commands.allocator import keep_freed_memory

if {keep}:
    keep_freed_memory()

def fill():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones(3_000_000) for _ in range(4)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

fill()
print(fill())
"""


def count_faults(keep):
    done = subprocess.run(
        [sys.executable, '-c', CODE.format(keep=keep)], capture_output=True, check=True, text=True,
        env={**os.environ, 'NUMPY_MADVISE_HUGEPAGE': '0'}, timeout=60,
    )
    return int(done.stdout)


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), 'mallopt'), reason='only glibc maps large arrays anew'
)
def test_freed_memory_is_used_again():
    # in pages of 4 KB the arrays have 24,000, in large ones 48
    assert count_faults(keep=True) < 0.2 * count_faults(keep=False)
