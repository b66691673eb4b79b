# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the C library does with memory that arrays no longer need."""

import ctypes

TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = -1, -2, -3
"""Parameters of mallopt, from malloc.h of glibc."""


def keep_freed_memory() -> None:
    """
    Let this process keep the memory of freed arrays for the next ones.

    By default glibc gives the memory of large arrays back, and the system clears its pages for the
    next ones.  Arrays of more than 32 MB, the most that glibc allows, are mapped anew still.  For
    processes that work once and end; the node gives memory back instead.  Other C libraries have
    no such call and are left alone.
    """
    set_option = getattr(ctypes.CDLL(None), 'mallopt', None)
    if set_option is not None:
        set_option(MMAP_THRESHOLD, 32 << 20)
        set_option(TRIM_THRESHOLD, 2**31 - 1)
        set_option(TOP_PAD, 64 << 20)
