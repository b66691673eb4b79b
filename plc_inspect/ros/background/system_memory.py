# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the process asks of the system about its memory."""

from collections.abc import Iterable
import ctypes
import mmap
from threading import Event
from typing import Any

from numpy.typing import NDArray

MADV_POPULATE_WRITE = 23
"""Of Linux since 5.14: back pages with memory as if written to, and leave what they hold."""
CHUNK = 1 << 21
"""Taken at once [bytes]; whoever else needs new memory waits as long."""


def take_memory(arrays: Iterable[NDArray[Any]], stop: Event | None = None) -> None:
    """
    Take the memory of arrays from the system now, not page by page when they are first written.

    What is in the arrays stays, and other threads may read and write them meanwhile.  A system
    that cannot do this is left to do as it always does.

    Parameters
    ----------
    arrays : iterable of arrays
        Any shapes and types, contiguous.
    stop : threading.Event or None
        Return soon when it is set.

    """
    advise = getattr(ctypes.CDLL(None), 'madvise', None)
    for array in arrays:
        first = array.ctypes.data // mmap.PAGESIZE * mmap.PAGESIZE
        last = array.ctypes.data + array.nbytes
        for start in range(first, last, CHUNK):
            if advise is None or (stop is not None and stop.is_set()):
                return
            size = ctypes.c_size_t(min(CHUNK, last - start))
            if advise(ctypes.c_void_p(start), size, MADV_POPULATE_WRITE):
                return


def give_back_memory() -> None:
    """
    Give memory that is free back to the system.

    The C library keeps what a tick used and frees, in pieces between what stays, so the process
    would grow over a long flight.  It takes about a millisecond; other C libraries than glibc
    have no such call and are left alone.
    """
    trim = getattr(ctypes.CDLL(None), 'malloc_trim', None)
    if trim is not None:
        trim(0)
