# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the C library's memory allocator."""

import ctypes

TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD, MMAP_MAX = -1, -2, -3, -4
"""Parameters of mallopt, from malloc.h of glibc."""


def keep_freed_memory(of_any_size: bool = False) -> None:
    """
    Let this process keep the memory of freed arrays for the next ones.

    By default glibc returns the memory of large arrays, and the system must clear pages for the
    next ones. Arrays of more than 32 MB, the limit of glibc, are still mapped anew, unless memory
    ``of_any_size`` is kept, as for tile after tile of a grid.  For processes that work once and
    end; the node gives memory back instead.  Other C libraries have no such call and are left
    alone.
    """
    set_option = getattr(ctypes.CDLL(None), 'mallopt', None)
    if set_option is not None:
        set_option(MMAP_THRESHOLD, 32 << 20)
        set_option(TRIM_THRESHOLD, 2**31 - 1)
        set_option(TOP_PAD, 64 << 20)
        if of_any_size:
            set_option(MMAP_MAX, 0)
